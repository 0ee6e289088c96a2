/* SPDX-License-Identifier: Apache-2.0
 *
 * splat-bench: renders the cameras of scenes and prints one JSON line per scene. The
 * project's performance page explains the keys. Times are wall-clock milliseconds per frame, except
 * keys that say cpu.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "bench/measure.h"
#include "protocol/json.h"
#include "sp/encode.h"

enum { EXIT_USAGE = 2, POOL_BYTES = 256 << 20 };

static int fail(const struct sp_error *err) {
    fprintf(stderr, "splat-bench: %s: %s\n", err->place[0] ? err->place : sp_code_name(err->code),
            err->text);
    return EXIT_FAILURE;
}

/* Returns PREFIXname.SUFFIX with the path separators of the name replaced; malloc'ed, NULL when out
 * of memory. */
static char *path_of(const char *prefix, const struct bench_scene *scene, const char *suffix) {
    char *path = NULL;
    if (asprintf(&path, "%s%s.%s", prefix, scene->name, suffix) < 0)
        return NULL;
    for (char *c = path + strlen(prefix); *c; c++)
        if (*c == '/' || *c == ':' || *c == '?')
            *c = '-';
    return path;
}

static bool write_png(const struct bench_studio *studio, struct sp_error *err) {
    struct sp_encoder *encoder = sp_encoder_create(err);
    struct sp_frame *frame = encoder ? bench_draw(studio, &studio->way, 2, 2, err) : NULL;
    const uint8_t *bytes;
    size_t size;
    bool ok = frame && sp_encode(encoder, frame, SP_IMAGE_PNG, 100, &bytes, &size, err);
    if (ok) {
        char *path = path_of(studio->options->out, studio->scene, "png");
        FILE *file = path ? fopen(path, "wb") : NULL;
        ok = file && fwrite(bytes, 1, size, file) == size;
        if (file && fclose(file) != 0)
            ok = false;
        if (!ok)
            sp_fail(err, SP_ERR_IO, path ? path : "", "cannot be written");
        free(path);
    }
    sp_frame_unref(&frame);
    sp_encoder_destroy(&encoder);
    return ok;
}

static bool save_volume(const struct bench_studio *studio, struct sp_error *err) {
    char *path = path_of(studio->options->save_volume, studio->scene, "nrrd");
    bool ok = path ? bench_scene_save_volume(studio->scene, path, err)
                   : sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a path");
    free(path);
    return ok;
}

static double round2(double x) {
    return round(x * 100) / 100;
}

/* Prints one line on standard output. */
static bool print_json(proto_json *json, struct sp_error *err) {
    char *text = proto_json_to_text(json, NULL);
    proto_json_free(&json);
    if (!text)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the result");
    printf("%s\n", text);
    fflush(stdout);
    free(text);
    return true;
}

/* Leaves out what is not finite, such as the PSNR of equal images. */
static void set_number(proto_json **json, const char *key, double value) {
    if (isfinite(value))
        proto_json_set_number(json, key, value);
}

static proto_json *encode_stages(const struct bench_times *t) {
    proto_json *stages = proto_json_object();
    for (uint32_t i = 0; i < t->last.stage_count; i++)
        set_number(&stages, t->last.stages[i].name, round2(t->stage_ms[i] / t->frames));
    return stages;
}

/* Returns the mean frame time spent outside all stages: with a GPU, submission and waiting. */
static double rest_ms(const struct bench_times *t) {
    double rest = bench_mean(t);
    for (uint32_t i = 0; i < t->last.stage_count; i++)
        rest -= t->stage_ms[i] / t->frames;
    return fmax(rest, 0);
}

static void encode_view(proto_json **j, const struct sp_view *view) {
    static const char *const modes[] = { "adaptive", "ewa",  "reconstruction",
                                         "lowpass",  "swan", "none" };
    static const char *const compositings[] = { "splat",   "sheet", "slab", "maximum",
                                                "minimum", "mean",  "sum" };
    static const char *const orders[] = { "pre", "post", "auto" };
    proto_json_set_integer(j, "size", view->size[0]);
    proto_json_set_string(j, "mode", modes[view->filter.mode]);
    proto_json_set_string(j, "compositing", compositings[view->compositing.mode]);
    proto_json_set_string(j, "order", orders[view->transfer_function.order]);
    proto_json_set_string(j, "shading", view->shading.mode == SP_SHADING_PHONG ? "phong" : "none");
    proto_json_set_string(j, "lod", view->level_of_detail == SP_LOD_OFF ? "off" : "auto");
}

static void encode_times(proto_json **j, const struct bench_times *t) {
    double median = bench_median(t);
    set_number(j, "splats", round(t->splats / t->frames));
    proto_json_set_integer(j, "visible_voxels", (int64_t)t->last.visible_voxels);
    set_number(j, "fragments", round(t->fragments / t->frames));
    set_number(j, "median_ms", round2(median));
    set_number(j, "p95_ms", round2(bench_percentile95(t)));
    set_number(j, "mean_ms", round2(bench_mean(t)));
    set_number(j, "cpu_ms", round2(t->cpu_ms / t->frames));
    set_number(j, "fps", round2(median > 0 ? 1000 / median : 0));
    set_number(j, "splats_per_second",
               round(median > 0 ? 1000 * t->splats / t->frames / median : 0));
    proto_json_set(j, "stages", encode_stages(t));
    set_number(j, "rest_ms", round2(rest_ms(t)));
    set_number(j, "cold_classify_ms", round2(t->cold_classify_ms));
    set_number(j, "allocations", round2((double)t->allocations / t->frames));
}

/* Prints the bytes of the samples, of the data cached from them, and of the process. */
static void encode_memory(proto_json **j, const struct bench_studio *studio) {
    const struct sp_volume_info *info = sp_volume_info(studio->scene->volume);
    uint64_t derived = sp_renderer_memory(studio->renderer, studio->scene->volume);
    uint64_t voxels = (uint64_t)info->grid.dims[0] * info->grid.dims[1] * info->grid.dims[2];
    struct rusage usage_of_process;
    getrusage(RUSAGE_SELF, &usage_of_process);
    proto_json_set_integer(j, "voxels", (int64_t)voxels);
    proto_json_set_integer(j, "bytes", (int64_t)(info->voxel_bytes + derived));
    proto_json_set_integer(j, "derived_bytes", (int64_t)derived);
    set_number(j, "derived_per_voxel", round(1e4 * (double)derived / (double)voxels) / 1e4);
    proto_json_set_integer(j, "peak_rss", (int64_t)usage_of_process.ru_maxrss * 1024);
}

static proto_json *encode_against(const struct bench_result *r, const char *setting) {
    const struct bench_times *t = &r->against;
    proto_json *j = proto_json_object();
    proto_json_set_string(&j, "setting", setting);
    set_number(&j, "splats", round(t->splats / t->frames));
    set_number(&j, "median_ms", round2(bench_median(t)));
    set_number(&j, "cpu_ms", round2(t->cpu_ms / t->frames));
    if (bench_median(&r->times) > 0)
        set_number(&j, "speedup", round2(bench_median(t) / bench_median(&r->times)));
    if (r->times.cpu_ms > 0)
        set_number(&j, "cpu_speedup", round2(t->cpu_ms / r->times.cpu_ms));
    if (r->has_psnr) {
        set_number(&j, "psnr_db", round2(r->psnr_db));
        set_number(&j, "psnr_worst_db", round2(r->psnr_worst_db));
    }
    return j;
}

static proto_json *encode_cancels(const struct bench_cancels *c) {
    proto_json *j = proto_json_object();
    proto_json_set_integer(&j, "stopped", c->stopped);
    proto_json_set_integer(&j, "finished", c->finished);
    set_number(&j, "median_ms", round2(c->median_ms));
    set_number(&j, "worst_ms", round2(c->worst_ms));
    set_number(&j, "range_ms", round2(c->random_range_ms));
    return j;
}

static proto_json *encode_result(const struct bench_studio *studio, const struct bench_result *r) {
    const struct bench_options *o = studio->options;
    const struct sp_frame_stats *stats = &r->times.last;
    proto_json *j = proto_json_object();
    proto_json_set_string(&j, "scene", studio->scene->name);
    proto_json_set_string(&j, "backend", stats->backend);
    proto_json_set_string(&j, "device", stats->device);
    proto_json_set_string(&j, "isa", stats->isa);
    proto_json_set_integer(&j, "threads", stats->threads);
    proto_json_set_integer(&j, "in_flight", bench_in_flight(studio));
    encode_view(&j, &studio->way.view);
    proto_json_set_integer(&j, "coarse", stats->mip_level);
    proto_json_set_integer(&j, "views", studio->scene->camera_count);
    encode_times(&j, &r->times);
    encode_memory(&j, studio);
    if (o->against_text)
        proto_json_set(&j, "against", encode_against(r, o->against_text));
    if (o->cancel)
        proto_json_set(&j, "cancel", encode_cancels(&r->cancels));
    return j;
}

/* The scenes state how many voxels are visible. */
static void check_visible(const struct bench_studio *studio, const struct sp_frame_stats *stats) {
    const struct bench_scene *scene = studio->scene;
    if (scene->visible_voxels < 0 || studio->way.edit != EDIT_NONE || stats->mip_level > 0 ||
        !stats->backend || strcmp(stats->backend, "null") == 0 ||
        stats->visible_voxels == (uint64_t)scene->visible_voxels)
        return;
    fprintf(stderr, "splat-bench: %s: %llu voxels are visible, the scene says %lld\n", scene->name,
            (unsigned long long)stats->visible_voxels, (long long)scene->visible_voxels);
}

static bool run_scene(struct bench_studio *studio, struct sp_error *err) {
    const struct bench_scene *scene = studio->scene;
    const struct bench_options *o = studio->options;
    if (scene->skipped[0]) {
        proto_json *json = proto_json_object();
        proto_json_set_string(&json, "scene", scene->name);
        proto_json_set_string(&json, "skipped", scene->skipped);
        return print_json(json, err);
    }
    struct bench_result r;
    bool ok = bench_measure(&r, studio, err) && print_json(encode_result(studio, &r), err);
    if (ok)
        check_visible(studio, &r.times.last);
    bench_result_finish(&r);
    if (ok && o->out)
        ok = write_png(studio, err);
    if (ok && o->save_volume)
        ok = save_volume(studio, err);
    sp_renderer_evict(studio->renderer, scene->volume);
    return ok;
}

static int run(const struct bench_options *o, char **files, int count) {
    struct sp_error err;
    struct sp_renderer *renderer = sp_renderer_create(&o->renderer, &err);
    struct sp_frame_pool *pool = renderer ? sp_frame_pool_create(POOL_BYTES, &err) : NULL;
    const struct bench_overrides *overrides = &o->setting.overrides;
    int status = pool ? EXIT_SUCCESS : fail(&err);
    if (!renderer && err.code == SP_ERR_INVALID)
        status = EXIT_USAGE;
    for (int i = 0; pool && i < (o->volume ? 1 : count); i++) {
        struct bench_scene scene;
        bool ok = o->volume ? bench_scene_open_volume(&scene, o->volume, o->data, overrides, &err)
                            : bench_scene_open(&scene, files[i], o->data, overrides, &err);
        if (ok) {
            struct bench_studio studio = {
                .renderer = renderer, .pool = pool, .scene = &scene, .options = o
            };
            ok = run_scene(&studio, &err);
            bench_scene_close(&scene);
        }
        if (!ok) {
            const char *source = o->volume ? o->volume : files[i];
            bool known = !err.place[0] || strcmp(err.place, source) == 0;
            fprintf(stderr, "splat-bench: %s%s%s: %s\n", source, known ? "" : ": ",
                    known ? "" : err.place, err.text);
            status = EXIT_FAILURE;
        }
    }
    sp_frame_pool_destroy(&pool);
    sp_renderer_destroy(&renderer);
    return status;
}

int main(int argc, char **argv) {
    struct bench_options o;
    switch (bench_options_parse(&o, argc, argv)) {
    case BENCH_DONE:
        return EXIT_SUCCESS;
    case BENCH_WRONG:
        return EXIT_USAGE;
    case BENCH_RUN:
        break;
    }
    return run(&o, argv + o.first_file, argc - o.first_file);
}
