/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses the cells of a tree that a frame draws as one point: the cells that are small in the
 * image.
 */
#ifndef SP_CLOUD_CUT_H
#define SP_CLOUD_CUT_H

#include "base/arena.h"
#include "classify/visible_ranges.h"
#include "draw/layers/cloud/order.h"
#include "draw/layers/cloud/tree.h"

struct sp_cloud_cut {
    const struct sp_cloud_tree *tree;
    const struct sp_cloud *cloud;
    const struct sp_voxel_frame *frame;
    const struct sp_visible_ranges *visible; /* values; NULL = all are visible */
    float pixels;
};

/* Chooses the points and merged points that are drawn: one merged point for each cell that is at
 * most `pixels` wide [px], and the points of all other cells. Leaves out most invisible points:
 * clipped, outside the image, or transparent. The choice is the same for any number of threads.
 * False if memory runs out; the arena names the allocation. */
bool sp_cloud_cut(const struct sp_cloud_cut *input, struct sp_pool *pool, struct sp_arena *arena,
                  struct sp_cloud_choice *choice);

#endif
