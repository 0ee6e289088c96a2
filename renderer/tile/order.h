/* SPDX-License-Identifier: Apache-2.0
 *
 * The order in which a frame draws the visible voxels: layers, front to back, each of them a few
 * entries of many bricks.
 *
 *   layer k ─► runs [first[k], first[k+1]) ─► places of a brick's order ─► entries of the list
 *
 * Which slices of the grid are the sheets, and in which order they are composited.
 *
 * Sheets lie perpendicular to the view as far as the grid allows: along the axis whose slices'
 * normal is closest to the view direction. A ray from the eye crosses them in the order of their
 * distance from the eye, on either side of it:
 *
 *        6   4   2   0 | 1   3   5        slices, numbered front to back
 *                    eye inside the volume
 *
 * A ray meets the sheets of one side only, so that how the sides are interleaved matters to
 * footprints alone that reach across; nearest first is the order closest to theirs.
 */
#ifndef SP_TILE_ORDER_H
#define SP_TILE_ORDER_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "classify/classification.h"
#include "splat/camera.h"
#include "splat/detail.h"

/* Places [begin, begin + count) of the order of one brick of a level; count > 0. */
struct sp_run {
    uint32_t brick;
    uint16_t begin, count;
    uint8_t level;
    bool is_enlarged; /* detail.h */
};

struct sp_order {
    uint32_t layers;       /* front to back */
    uint64_t *first;       /* [layers + 1] */
    struct sp_run *runs;   /* [first[layers]] */
    const uint16_t *order; /* the entry of the brick at each place, from visible.first[brick] on;
                              NULL = each its own */
};

/* The major axis, 0 … 2; of equal ones the highest. */
unsigned sp_order_axis(const struct sp_camera_frame *camera, const struct sp_grid *grid);

/* Fills slices[dims[axis]]: element k is the index of the sheet that comes k-th, front to back. */
void sp_order_slices(const struct sp_camera_frame *camera, const struct sp_grid *grid,
                     unsigned axis, uint32_t *slices);

/* The place front to back of the sheet that slice `slice` of a level belongs to: the one of the
 * finest level where its centre lies (beyond it, where that is between two). layers: by sheet. */
static inline uint32_t sp_order_layer(const uint32_t *layers, uint32_t count, unsigned level,
                                      uint32_t slice) {
    uint64_t centre = ((uint64_t)slice << level) + (level ? UINT64_C(1) << (level - 1) : 0);
    return layers[centre < count ? centre : count - 1];
}

/* The slices along `axis`, which the levels' bricks are cut along, as layers: as many as the finest
 * level has slices. Memory is the arena's. False when the arena could not allocate. */
bool sp_order_sheets(const struct sp_camera_frame *camera, const struct sp_level *levels,
                     const struct sp_detail *detail, unsigned axis, struct sp_arena *arena,
                     struct sp_order *order);

#endif
