/* SPDX-License-Identifier: Apache-2.0
 *
 * What is measured of one scene. Times are wall milliseconds a frame unless they say cpu.
 */
#ifndef BENCH_MEASURE_H
#define BENCH_MEASURE_H

#include "bench/options.h"

/* Sums over the frames of one setting. */
struct bench_times {
    double *ms; /* a frame, `frames` of them; sorted once measured */
    unsigned frames;
    double cpu_ms, splats, fragments;
    double stage_ms[SP_STAGES_MAX];
    double cold_classify_ms; /* of the very first frame */
    uint64_t allocations;
    struct sp_frame_stats last;
};

struct bench_cancels {
    unsigned stopped;           /* frames that were cancelled on the way */
    unsigned finished;          /* frames that were done before */
    double median_ms, worst_ms; /* from setting the flag to the return of the call */
    double random_range_ms;     /* the moment lies in [0, this] after the call */
};

struct bench_result {
    struct bench_times times, against; /* against.frames is 0 without --against */
    bool has_psnr;
    double psnr_db, psnr_worst_db; /* of all views together, and of the worst; EQUAL_DB if equal */
    struct bench_cancels cancels;
};
#define BENCH_EQUAL_DB 999.0

/* A setting as the renderer wants it. */
struct bench_way {
    struct sp_view view;
    struct sp_render_options render;
    enum bench_edit edit;
};

/* Where frames come from. The caller sets the first four; bench_measure() the rest. */
struct bench_studio {
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
    const struct bench_scene *scene;
    const struct bench_options *options;
    struct bench_way way, against;
};

/* Measures what the options ask for. False with *err set; finish the result in any case. */
bool bench_measure(struct bench_result *r, struct bench_studio *studio, struct sp_error *err);
void bench_result_finish(struct bench_result *r);

/* Draws camera k, frame n of all; the frame is the caller's. After bench_measure(). */
struct sp_frame *bench_draw(const struct bench_studio *studio, const struct bench_way *way,
                            unsigned k, unsigned n, struct sp_error *err);

/* Frames that are in flight while times are measured: no more than the backend takes. */
unsigned bench_in_flight(const struct bench_studio *studio);

double bench_median(const struct bench_times *t);
double bench_percentile95(const struct bench_times *t);
double bench_mean(const struct bench_times *t);

#endif
