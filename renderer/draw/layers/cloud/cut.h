/* SPDX-License-Identifier: Apache-2.0
 *
 * Which cells of a tree a frame draws as one point: those that are small in the image.
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
    const struct sp_visible_ranges *visible; /* of values; NULL = all are */
    float pixels;
};

/* Chooses the points and merged points that are drawn: each cell that is at most `pixels` wide
 * [px], and the points of others. Leaves out most of those that cannot be seen, because they are
 * clipped, outside of the image or transparent. The same for any number of threads. False if memory
 * ran out (the arena says for what). */
bool sp_cloud_cut(const struct sp_cloud_cut *input, struct sp_pool *pool, struct sp_arena *arena,
                  struct sp_cloud_choice *choice);

#endif
