/* SPDX-License-Identifier: Apache-2.0
 *
 * The measurements of one scene. Times are wall-clock milliseconds per frame unless the name says
 * cpu.
 */
#ifndef BENCH_MEASURE_H
#define BENCH_MEASURE_H

#include "bench/options.h"

/* Sums over the frames of one setting. */
struct bench_times {
    double *ms; /* per frame, `frames` values; sorted after the measurement */
    unsigned frames;
    double cpu_ms, splats, fragments;
    double stage_ms[SP_STAGES_MAX];
    double cold_classify_ms; /* of the first frame of all */
    uint64_t allocations;
    struct sp_frame_stats last;
};

struct bench_cancels {
    unsigned stopped;           /* frames that were cancelled while rendering */
    unsigned finished;          /* frames that finished before the flag was set */
    double median_ms, worst_ms; /* from setting the flag to the return of the call */
    double random_range_ms;     /* the flag is set in [0, this] ms after the call */
};

struct bench_result {
    struct bench_times times, against; /* against.frames is 0 without --against */
    bool has_psnr;
    double psnr_db, psnr_worst_db; /* of all views together, of the worst view; EQUAL_DB if equal */
    struct bench_cancels cancels;
};
#define BENCH_EQUAL_DB 999.0

/* A setting in the form that the renderer takes. */
struct bench_way {
    struct sp_view view;
    struct sp_render_options render;
    enum bench_edit edit;
};

/* The source of frames. The caller sets the first four members, bench_measure() the rest. */
struct bench_studio {
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
    const struct bench_scene *scene;
    const struct bench_options *options;
    struct bench_way way, against;
};

/* Takes the measurements that the options select. False with *err set; finish the result in any
 * case. */
bool bench_measure(struct bench_result *r, struct bench_studio *studio, struct sp_error *err);
void bench_result_finish(struct bench_result *r);

/* Renders frame n of the measurement with camera k; the caller owns the frame. Call after
 * bench_measure(). */
struct sp_frame *bench_draw(const struct bench_studio *studio, const struct bench_way *way,
                            unsigned k, unsigned n, struct sp_error *err);

/* Returns the number of frames in flight during time measurements: at most what the backend
 * supports. */
unsigned bench_in_flight(const struct bench_studio *studio);

double bench_median(const struct bench_times *t);
double bench_percentile95(const struct bench_times *t);
double bench_mean(const struct bench_times *t);

#endif
