/* SPDX-License-Identifier: Apache-2.0
 *
 * The points of an iso-surface: they represent the surface in the cells between samples.
 *
 *   cell of 8 samples ─► one point per piece of surface in it: place, vector area, normal, bend
 *
 * The surface is f = v of the trilinear interpolant f of the samples; f >= v is inside. README.md
 * of this folder derives these quantities. Points are stored in blocks of 8³ cells, so that frames
 * skip and sort whole blocks.
 */
#ifndef SP_SURFACE_POINTS_H
#define SP_SURFACE_POINTS_H

#include "draw/layers/surface/ranges.h"

enum {
    SURFACE_POINTS_BEYOND = 16, /* elements that can be read beyond the end of each array */
    SURFACE_SPLIT_MAX = 4,
    SURFACE_LEVELS = 4 /* a block of cells in groups of 1, 2³, 4³ or 8³ */
};
#define SURFACE_PLACE_STEPS 8192.0f /* per cell */
#define SURFACE_AREA_STEPS 16384.0f /* per face of a cell */
#define SURFACE_NORMAL_STEPS 32767.0f
#define SURFACE_BEND_STEPS 32767.0f

struct sp_surface_block {
    uint32_t corner[3]; /* first cell = first sample */
    uint32_t count;     /* points, at least 1 */
    uint64_t first;
    uint16_t low[3], high[3]; /* bounds of the points, as in `at` */
};

struct sp_surface_points {
    uint32_t block_count;
    uint64_t count;
    uint64_t made;    /* serial number of the contents, unique in the cache */
    uint8_t split[3]; /* parts of a cell along each axis, [1, SURFACE_SPLIT_MAX] */
    uint8_t level;    /* points of 2^level parts per axis are merged */
    struct sp_surface_block *blocks;
    uint16_t *at[3]; /* from the block's corner [cell/SURFACE_PLACE_STEPS] */
    int16_t *
        area[3]; /* from inside to outside, in index space [SURFACE_AREA_STEPS per 4^level faces] */
    int16_t *normal[3]; /* unit gradient, world; 0 = the gradient is 0; shorter if merged normals
                           differ */
    /* How far a disc with the deviation of one voxel moves along the normal, so that it lies on the
     * surface on average [cells/SURFACE_BEND_STEPS]. */
    int16_t *bend;
};

/* Chooses into how many parts the cells of a grid are split along each axis. */
void sp_surface_points_split(const struct sp_grid *grid, uint8_t split[3]);

/* Returns how many numbers of 16 bits the arrays of points->count points have. */
uint64_t sp_surface_points_words(const struct sp_surface_points *points);
/* Puts the arrays into memory of that size. */
void sp_surface_points_lay_out(struct sp_surface_points *points, uint16_t *memory);
/* Allocates the arrays of points->count points. False: out of memory. */
bool sp_surface_points_allocate(struct sp_surface_points *points);
void sp_surface_points_finish(struct sp_surface_points *points);
uint64_t sp_surface_points_bytes(const struct sp_surface_points *points);

#endif
