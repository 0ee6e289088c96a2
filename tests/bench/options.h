/* SPDX-License-Identifier: Apache-2.0
 *
 * The command line of splat-bench.
 */
#ifndef BENCH_OPTIONS_H
#define BENCH_OPTIONS_H

#include "bench/scene.h"
#include "sp/renderer.h"

enum bench_edit { EDIT_NONE, EDIT_COLOUR, EDIT_OPACITY, EDIT_RANGE, EDITS };

/* How a scene is rendered; --against renders it with a second setting. */
struct bench_setting {
    struct bench_overrides overrides;
    struct sp_render_options render;
    enum bench_edit edit; /* change of the transfer function before each frame */
};

struct bench_options {
    struct sp_renderer_options renderer;
    struct bench_setting setting, against;
    const char *against_text;        /* KEY=VALUE as given; NULL = nothing to compare with */
    unsigned warm;                   /* frames before the measured ones */
    unsigned cancel;                 /* frames to cancel; 0 = none */
    unsigned in_flight;              /* most frames in flight; limited by the backend */
    bool cold;                       /* evict cached data of the volume before each frame */
    const char *data, *out, *volume; /* NULL = not given */
    const char *save_volume;
    int first_file; /* index in argv of the first scene */
};

enum bench_parsed { BENCH_RUN, BENCH_DONE, BENCH_WRONG };

/* Returns BENCH_DONE after --help or --version, BENCH_WRONG after printing an error. */
enum bench_parsed bench_options_parse(struct bench_options *o, int argc, char **argv);

#endif
