/* SPDX-License-Identifier: Apache-2.0
 *
 * GET /metrics: counters, and gauges of the current state, in the text format of Prometheus.
 */
#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "http/routes.h"
#include "ops/metrics.h"
#include "render/brick_cache.h"
#include "render/frame_memory.h"

/* Volumes with a series of their own. The other volumes are added up under the name "*". */
enum { VOLUMES_MAX = 64 };

static void gauge(FILE *out, const char *name, const char *help, double value) {
    srv_metrics_family(out, name, "gauge", help);
    fprintf(out, "%s %.17g\n", name, value);
}

static void counter(FILE *out, const char *name, const char *help, double value) {
    srv_metrics_family(out, name, "counter", help);
    fprintf(out, "%s %.17g\n", name, value);
}

static void print_sessions(const struct srv_request *request, FILE *out) {
    struct srv_hub_numbers n;
    srv_hub_numbers(request->app->hub, &n);
    gauge(out, "splatd_sessions", "Open sessions", n.sessions);
    gauge(out, "splatd_sessions_hibernated", "Hibernated sessions", n.hibernated);
    srv_metrics_family(out, "splatd_participants", "gauge", "Open streams by their role");
    fprintf(out, "splatd_participants{role=\"control\"} %u\n", n.participants[SRV_ROLE_CONTROL]);
    fprintf(out, "splatd_participants{role=\"view\"} %u\n", n.participants[SRV_ROLE_VIEW]);
    gauge(out, "splatd_connections", "Open connections, including streams",
          (double)srv_http_connections(request->http));
    gauge(out, "splatd_pictures_waiting", "Snapshots that were requested and are not answered yet",
          srv_snapshot_queue_unanswered(srv_render_pool_snapshots(request->app->render_pool)));
}

static void print_volume(FILE *out, const char *id, const uint64_t *voxels,
                         const uint64_t cached[SRV_RENDERERS],
                         const struct sp_renderer_info *info) {
    static const char *const workers[SRV_RENDERERS] = { "interactive", "snapshot", "preemption" };
    if (voxels) {
        fprintf(out, "splatd_volume_bytes{volume=");
        srv_metrics_label(out, id);
        fprintf(out, "} %" PRIu64 "\n", *voxels);
        return;
    }
    for (int l = 0; l < SRV_RENDERERS; l++) {
        if (!info[l].backend)
            continue;
        fprintf(out, "splatd_derived_bytes{volume=");
        srv_metrics_label(out, id);
        fprintf(out, ",backend=\"%s\",worker=\"%s\"} %" PRIu64 "\n", info[l].backend, workers[l],
                cached[l]);
    }
}

/* Prints one family over all volumes: the size of their voxels, or of the renderers' cached data.
 */
static void print_volumes(const struct srv_request *request, bool voxels,
                          const struct sp_renderer_info *info, FILE *out) {
    struct srv_volume_status status;
    uint64_t rest = 0, cached_rest[SRV_RENDERERS] = { 0 };
    unsigned i = 0;
    for (; srv_catalog_at(request->app->catalog, i, &status); i++) {
        sp_volume_unref(&status.volume);
        rest += i < VOLUMES_MAX ? 0 : status.voxel_bytes;
        for (int l = 0; l < SRV_RENDERERS; l++)
            cached_rest[l] += i < VOLUMES_MAX ? 0 : status.cached_per_renderer[l];
        if (i < VOLUMES_MAX)
            print_volume(out, status.id, voxels ? &status.voxel_bytes : NULL,
                         status.cached_per_renderer, info);
    }
    if (i > VOLUMES_MAX)
        print_volume(out, "*", voxels ? &rest : NULL, cached_rest, info);
}

static void print_frame_memory(const struct srv_frame_memory *memory, FILE *out) {
    static const char *const kinds[SP_BUDGET_KINDS] = { "arenas", "images", "encoders", "answers" };
    for (int k = 0; k < SP_BUDGET_KINDS; k++)
        fprintf(out, "splatd_memory_bytes{kind=\"%s\"} %" PRIu64 "\n", kinds[k],
                sp_budget_used(memory->sessions, (enum sp_budget_kind)k) +
                    sp_budget_used(memory->snapshots, (enum sp_budget_kind)k));
    gauge(out, "splatd_frame_memory_budget_bytes", "Limit of --render-bytes",
          (double)(sp_budget_limit(memory->sessions) + sp_budget_limit(memory->snapshots)));
}

static void print_memory(const struct srv_request *request, FILE *out) {
    struct sp_renderer_info info[SRV_RENDERERS];
    uint64_t used, budget, brick_bytes;
    srv_render_pool_info(request->app->render_pool, info);
    srv_catalog_memory(request->app->catalog, &used, &budget, &brick_bytes);
    srv_metrics_family(out, "splatd_memory_bytes", "gauge",
                       "Memory in use: voxels (of --memory); of frames (--render-bytes) what they "
                       "are drawn in, pixels, encoders, encoded images that clients have not read "
                       "or that are cached");
    fprintf(out, "splatd_memory_bytes{kind=\"voxels\"} %" PRIu64 "\n", used);
    print_frame_memory(request->app->frame_memory, out);
    gauge(out, "splatd_subvolume_bytes",
          "Samples of brick files in memory, bytes; they share what --memory has left",
          (double)brick_bytes);
    gauge(out, "splatd_memory_budget_bytes", "Limit of --memory", (double)budget);
    srv_metrics_family(
        out, "splatd_volume_bytes", "gauge",
        "Size of the voxels and vectors per volume; volumes after the first 64 together as *");
    print_volumes(request, true, info, out);
    srv_metrics_family(out, "splatd_derived_bytes", "gauge",
                       "Cached data of a renderer, per volume, backend and worker");
    print_volumes(request, false, info, out);
}

static void print_cache(const struct srv_request *request, FILE *out) {
    struct srv_brick_cache_stats n;
    if (!request->app->cache)
        return;
    srv_brick_cache_stats(request->app->cache, &n);
    gauge(out, "splatd_cache_files", "Brick files in --cache", (double)n.files);
    gauge(out, "splatd_cache_bytes", "Size of the brick files in --cache", (double)n.bytes);
    gauge(out, "splatd_cache_bytes_limit", "Limit of splatd_cache_bytes (--cache-size); 0 = none",
          (double)n.bytes_max);
    counter(out, "splatd_cache_conversions_total", "Volumes converted for --cache",
            (double)n.conversions);
    counter(out, "splatd_cache_removals_total", "Brick files removed from --cache",
            (double)n.removals);
}

static void print_store(const struct srv_request *request, FILE *out) {
    static const char *const kinds[SRV_KINDS] = { "volume", "session", "view",
                                                  "preset", "path",    "clock" };
    struct srv_store_status s;
    srv_store_status(request->app->store, &s);
    srv_metrics_family(out, "splatd_stored_records", "gauge", "Records in the store, by kind");
    for (int k = 0; k < SRV_KINDS; k++)
        fprintf(out, "splatd_stored_records{kind=\"%s\"} %u\n", kinds[k], s.records[k]);
    gauge(out, "splatd_stored_bytes", "Size of the records in the store", (double)s.bytes);
    gauge(out, "splatd_state_waiting", "Changes that are not on disk yet", s.waiting);
    gauge(out, "splatd_state_failing", "1 while the state cannot be written", s.is_failing);
    counter(out, "splatd_state_writes_total", "Transactions written", (double)s.writes);
    counter(out, "splatd_state_failures_total", "Transactions that failed", (double)s.failures);
    gauge(out, "splatd_state_write_seconds", "Duration of the last transaction", s.write_ms / 1000);
}

static void print_paths(const struct srv_request *request, FILE *out) {
    struct srv_paths_stats n;
    srv_paths_stats(request->app->paths, &n);
    gauge(out, "splatd_paths", "Camera paths, finished or not", n.paths);
    gauge(out, "splatd_paths_unfinished", "Camera paths that are not finished", n.unfinished);
    gauge(out, "splatd_paths_waiting",
          "Unfinished camera paths that wait for a volume, memory or capacity", n.waiting);
    gauge(out, "splatd_path_bytes", "Size of the files of all camera paths", (double)n.bytes);
    gauge(out, "splatd_path_bytes_limit", "Limit of splatd_path_bytes (--path-bytes)",
          (double)request->app->config->path_bytes);
}

/* The functions below return false when out of memory. A value that the system does not provide is
 * 0. */

static bool is_short(const void *opened) {
    return !opened && errno == ENOMEM;
}

/* Reads when the system started, in seconds since 1970. */
static bool boot_time(double *seconds) {
    char line[256];
    FILE *stat = fopen("/proc/stat", "re");
    bool ok = !is_short(stat);
    *seconds = 0;
    while (stat && *seconds == 0 && fgets(line, sizeof line, stat))
        if (sscanf(line, "btime %lf", seconds) != 1)
            *seconds = 0;
    if (stat)
        fclose(stat);
    return ok;
}

/* Reads when this process started, in seconds since 1970. */
static bool start_time(double *seconds) {
    char text[1024] = "";
    double ticks = 0, boot;
    bool ok = boot_time(&boot);
    FILE *stat = fopen("/proc/self/stat", "re");
    ok = ok && !is_short(stat);
    size_t size = stat ? fread(text, 1, sizeof text - 1, stat) : 0;
    if (stat)
        fclose(stat);
    text[size] = 0;
    const char *field =
        strrchr(text, ')'); /* the end of the second field, a name that may contain blanks */
    for (int i = 2; field && i < 22; i++)
        field = strchr(field + 1, ' ');
    bool is_known = boot > 0 && field && sscanf(field, "%lf", &ticks) == 1;
    *seconds = is_known ? boot + ticks / (double)sysconf(_SC_CLK_TCK) : 0;
    return ok;
}

/* Reads the resident memory in pages and the number of open file descriptors. */
static bool sizes(long *resident_pages, long *files) {
    long pages;
    FILE *statm = fopen("/proc/self/statm", "re");
    bool ok = !is_short(statm);
    if (!statm || fscanf(statm, "%ld %ld", &pages, resident_pages) != 2)
        *resident_pages = 0;
    if (statm)
        fclose(statm);
    DIR *folder = opendir("/proc/self/fd");
    ok = ok && !is_short(folder);
    *files = folder ? -3 : 0; /* ".", "..", and the folder itself */
    while (folder && readdir(folder))
        ++*files;
    if (folder)
        closedir(folder);
    return ok;
}

static double max_files(void) {
    struct rlimit limit;
    return getrlimit(RLIMIT_NOFILE, &limit) == 0 ? (double)limit.rlim_cur : 0;
}

/* Prints the standard process metrics of Prometheus. */
static bool print_process(FILE *out) {
    struct rusage usage;
    long resident, files;
    double start;
    bool ok = sizes(&resident, &files);
    ok = start_time(&start) && ok;
    getrusage(RUSAGE_SELF, &usage);
    gauge(out, "process_resident_memory_bytes", "Resident memory",
          (double)resident * (double)sysconf(_SC_PAGESIZE));
    gauge(out, "process_open_fds", "Open file descriptors", (double)files);
    gauge(out, "process_max_fds", "Limit of open file descriptors", max_files());
    gauge(out, "process_start_time_seconds", "Start time of the process in seconds since 1970",
          start);
    counter(out, "process_cpu_seconds_total", "Processor time of all threads",
            (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
                (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec) * 1e-6);
    return ok;
}

static void print_build(const struct srv_request *request, FILE *out) {
    struct sp_renderer_info info[SRV_RENDERERS];
    srv_render_pool_info(request->app->render_pool, info);
    srv_metrics_family(out, "splatd_build_info", "gauge",
                       "Always 1; the labels name version, backend, device and instruction set");
    fprintf(out, "splatd_build_info{version=\"" SPLATD_VERSION "\",backend=\"%s\",device=",
            info[0].backend);
    srv_metrics_label(out, info[0].device);
    fprintf(out, ",isa=\"%s\"} 1\n", info[0].isa);
}

void srv_get_metrics(struct srv_request *request, struct srv_reply *reply) {
    char *text = NULL;
    size_t size = 0;
    bool ok = false;
    FILE *out = open_memstream(&text, &size);
    if (out) {
        print_build(request, out);
        print_sessions(request, out);
        srv_metrics_print(request->app->metrics, out);
        print_memory(request, out);
        print_cache(request, out);
        print_store(request, out);
        print_paths(request, out);
        ok = print_process(out) && !ferror(out);
    }
    if (!out || fclose(out) != 0 || !ok) {
        free(text);
        srv_reply_problem(reply, 503, NULL, "out of memory for the metrics");
        return;
    }
    reply->status = 200;
    reply->mime = "text/plain; version=0.0.4; charset=utf-8";
    reply->body = reply->owned = text;
    reply->size = size;
    srv_reply_header(reply, "Cache-Control", "no-store");
}
