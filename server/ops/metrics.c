/* SPDX-License-Identifier: Apache-2.0 */
#include "ops/metrics.h"

#include <inttypes.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

static const double bounds_s[] = { 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05,
                                   0.1,    0.25,  0.5,    1,     2.5,  5,     10 };
enum { BOUNDS = sizeof bounds_s / sizeof *bounds_s };

struct histogram {
    _Atomic uint64_t
        buckets[BOUNDS + 1]; /* each duration in one bucket; the last has no upper bound */
    _Atomic uint64_t sum_ns;
};

struct srv_metrics {
    _Atomic uint64_t counters[SRV_COUNTERS];
    struct histogram timings[SRV_TIMINGS];
};

static const char *const timing_names[SRV_TIMINGS] = { "queue",  "render", "readback",
                                                       "encode", "send",   "round_trip" };

static const char *const drops[] = { "replaced", "late", "outdated", "failed", "left" };
static const char *const ends[] = { "closed", "stalled", "silent", "protocol", "lost" };
static const char *const directions[] = { "in", "out" };
static const char *const statuses[] = { "1xx", "2xx", "3xx", "4xx", "5xx" };
static const char *const waits[] = { "volume", "disk", "limit", "memory", "backend" };
static const char *const upload_ends[] = { "complete", "expired", "removed" };
static const char *const refusals[] = { "connections", "address", "owner", "handshakes", "tls" };

static const struct family {
    const char *name, *help;
    enum srv_counter first;
    unsigned count;
    const char *label, *const *values; /* NULL = one counter without a label */
} families[] = {
    { "splatd_frames_total", "Frames sent to streams", SRV_COUNT_FRAMES, 1, NULL, NULL },
    { "splatd_pictures_total", "Snapshots rendered for HTTP requests", SRV_COUNT_SNAPSHOTS, 1, NULL,
      NULL },
    { "splatd_drops_total", "Frames that were started and not sent", SRV_COUNT_DROP_REPLACED, 5,
      "reason", drops },
    { "splatd_streams_joined_total", "Streams opened", SRV_COUNT_JOINED, 1, NULL, NULL },
    { "splatd_streams_ended_total", "Streams closed", SRV_COUNT_END_CLOSED, 5, "reason", ends },
    { "splatd_stream_bytes_total", "Bytes received from and sent to streams", SRV_COUNT_BYTES_IN, 2,
      "direction", directions },
    { "splatd_http_requests_total", "HTTP requests by status class", SRV_COUNT_HTTP_1XX, 5,
      "status", statuses },
    { "splatd_http_bytes_total", "Bytes of HTTP request and response bodies",
      SRV_COUNT_HTTP_BYTES_IN, 2, "direction", directions },
    { "splatd_path_frames_total", "Frames rendered for camera paths", SRV_COUNT_PATH_FRAMES, 1,
      NULL, NULL },
    { "splatd_path_waits_total", "Times that a frame of a camera path was postponed",
      SRV_COUNT_PATH_WAIT_VOLUME, 5, "reason", waits },
    { "splatd_path_failures_total", "Camera paths that failed permanently", SRV_COUNT_PATH_FAILED,
      1, NULL, NULL },
    { "splatd_upload_bytes_total", "Bytes received in uploads", SRV_COUNT_UPLOAD_BYTES, 1, NULL,
      NULL },
    { "splatd_uploads_ended_total", "Uploads that were completed, or ended before",
      SRV_COUNT_UPLOAD_COMPLETE, 3, "result", upload_ends },
    { "splatd_connections_refused_total", "Refused connections", SRV_COUNT_REFUSED_FULL, 5,
      "reason", refusals },
};

struct srv_metrics *srv_metrics_create(void) {
    return calloc(1, sizeof(struct srv_metrics));
}

void srv_metrics_destroy(struct srv_metrics **metrics) {
    free(*metrics);
    *metrics = NULL;
}

void srv_metrics_add(struct srv_metrics *metrics, enum srv_counter counter, uint64_t amount) {
    if (metrics)
        atomic_fetch_add_explicit(&metrics->counters[counter], amount, memory_order_relaxed);
}

void srv_metrics_time(struct srv_metrics *metrics, enum srv_timing timing, double ms) {
    if (!metrics)
        return;
    struct histogram *h = &metrics->timings[timing];
    unsigned bucket = 0;
    ms = ms > 0 ? ms : 0;
    while (bucket < BOUNDS && ms > bounds_s[bucket] * 1000)
        bucket++;
    atomic_fetch_add_explicit(&h->buckets[bucket], 1, memory_order_relaxed);
    atomic_fetch_add_explicit(&h->sum_ns, (uint64_t)(ms * 1e6), memory_order_relaxed);
}

void srv_metrics_family(FILE *out, const char *name, const char *type, const char *help) {
    fprintf(out, "# HELP %s %s\n# TYPE %s %s\n", name, help, name, type);
}

void srv_metrics_label(FILE *out, const char *value) {
    fputc('"', out);
    for (const char *c = value; *c; c++) {
        if (*c == '"' || *c == '\\')
            fputc('\\', out);
        if (*c == '\n')
            fputs("\\n", out);
        else
            fputc(*c, out);
    }
    fputc('"', out);
}

static void print_histogram(const struct histogram *h, const char *stage, FILE *out) {
    uint64_t count = 0;
    for (unsigned i = 0; i <= BOUNDS; i++) {
        count += atomic_load_explicit(&h->buckets[i], memory_order_relaxed);
        if (i < BOUNDS)
            fprintf(out, "splatd_stage_seconds_bucket{stage=\"%s\",le=\"%g\"} %" PRIu64 "\n", stage,
                    bounds_s[i], count);
    }
    fprintf(out, "splatd_stage_seconds_bucket{stage=\"%s\",le=\"+Inf\"} %" PRIu64 "\n", stage,
            count);
    fprintf(out, "splatd_stage_seconds_sum{stage=\"%s\"} %.9f\n", stage,
            (double)atomic_load_explicit(&h->sum_ns, memory_order_relaxed) * 1e-9);
    fprintf(out, "splatd_stage_seconds_count{stage=\"%s\"} %" PRIu64 "\n", stage, count);
}

void srv_metrics_print(const struct srv_metrics *metrics, FILE *out) {
    for (size_t f = 0; f < sizeof families / sizeof *families; f++) {
        const struct family *family = &families[f];
        srv_metrics_family(out, family->name, "counter", family->help);
        for (unsigned i = 0; i < family->count; i++) {
            uint64_t value =
                atomic_load_explicit(&metrics->counters[family->first + i], memory_order_relaxed);
            if (family->label)
                fprintf(out, "%s{%s=\"%s\"} %" PRIu64 "\n", family->name, family->label,
                        family->values[i], value);
            else
                fprintf(out, "%s %" PRIu64 "\n", family->name, value);
        }
    }
    srv_metrics_family(out, "splatd_stage_seconds", "histogram",
                       "Time that frames and snapshots spend per stage");
    for (int t = 0; t < SRV_TIMINGS; t++)
        print_histogram(&metrics->timings[t], timing_names[t], out);
}
