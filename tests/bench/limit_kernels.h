/* SPDX-License-Identifier: Apache-2.0
 *
 * The minimum cost of a splat, for each instruction set: adding footprints to a tile that stays in
 * the L1 cache, and setting footprints up. A renderer that handles each splat separately can
 * approach the sum of the two; it cannot be faster.
 */
#ifndef BENCH_LIMIT_KERNELS_H
#define BENCH_LIMIT_KERNELS_H

#include "base/isa.h"

#ifdef SP_ISA
#define bench_limit_table SP_ISA_NAME(bench_limit_table)
#endif

enum {
    LIMIT_TILE = 32,        /* px, width and height */
    LIMIT_ROW = 48,         /* floats per row: the widest vector may start at the last pixel */
    LIMIT_PLANES = 4,       /* depth, red, green, blue */
    LIMIT_FOOTPRINTS = 256, /* few enough to stay in the cache as well */
    LIMIT_VOXELS = 1024,    /* a multiple of the widest vector */
    LIMIT_WIDTHS = 4
};

/* A Gaussian in a box: 2^(k0 + k1·l + k2·l²) in the first row, column l; each row is the row above
 * times 2^(m0 + m1·l), and this ratio falls by `fall` per row. */
struct limit_footprint {
    int offset; /* of the box's corner in a plane of the tile, floats */
    float k0, k1, k2, m0, m1, fall;
    float weight[LIMIT_PLANES];
};

struct limit_tile {
    float plane[LIMIT_PLANES][LIMIT_TILE * LIMIT_ROW];
};

/* Camera space to footprint: a perspective projection of a kernel with one variance matrix. */
struct limit_camera {
    float focal, centre[2]; /* px */
    float variance[6];      /* 00 01 02 11 12 22 */
    float lowpass, radius;  /* px², standard deviations */
};

struct limit_voxels { /* structure of arrays */
    float at[3][LIMIT_VOXELS];
    float centre[2][LIMIT_VOXELS], conic[3][LIMIT_VOXELS], box[2][LIMIT_VOXELS];
};

struct limit_table {
    const char *isa;
    /* Adds all footprints of `width`×`width` px; `width` is one of limit_widths. */
    void (*add)(struct limit_tile *tile, const struct limit_footprint *footprints, int width);
    void (*set_up)(struct limit_voxels *voxels, const struct limit_camera *camera);
};

static const int limit_widths[LIMIT_WIDTHS] = { 3, 5, 7, 11 };

extern const struct limit_table bench_limit_table;

#endif
