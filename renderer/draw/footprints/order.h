/* SPDX-License-Identifier: Apache-2.0
 *
 * The order in which a frame draws the visible voxels: layers, front to back, each with a few
 * entries of many bricks.
 *
 *   layer k ─► runs [first[k], first[k+1]) ─► places of a brick's order ─► entries of the list
 */
#ifndef SP_FOOTPRINTS_ORDER_H
#define SP_FOOTPRINTS_ORDER_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "classify/classification.h"
#include "splat/detail.h"
#include "splat/slices.h"

/* Places [begin, begin + count) of the order of one brick of a level; count > 0. */
struct sp_run {
    uint32_t brick;
    uint16_t begin, count;
    uint8_t level;
    bool is_enlarged; /* detail.h */
};

struct sp_order {
    uint32_t layers;     /* front to back */
    uint64_t *first;     /* [layers + 1] */
    struct sp_run *runs; /* [first[layers]] */
    /* Element visible.first[brick] + place: the number of the entry in the brick. NULL = the number
     * is the place. */
    const uint16_t *order;
};

/* Fills *order with the slices along `axis` as layers: one layer per slice of the finest level. The
 * bricks of all levels must be cut along this axis. Memory comes from the arena. False if the arena
 * cannot allocate. */
bool sp_order_sheets(const struct sp_camera_transform *camera, const struct sp_level *levels,
                     const struct sp_detail *detail, unsigned axis, struct sp_arena *arena,
                     struct sp_order *order);

#endif
