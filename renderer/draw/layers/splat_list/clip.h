/* SPDX-License-Identifier: Apache-2.0
 *
 * Computes which voxels of the rows of a grid clipping keeps. A voxel is clipped if its centre is
 * clipped. A clip box and clip planes are convex, so that clipping keeps one interval of each row.
 */
#ifndef SP_SPLAT_LIST_CLIP_H
#define SP_SPLAT_LIST_CLIP_H

#include "sp/view.h"

/* Voxels [begin, end) of a row; empty: begin == end. */
struct sp_voxel_interval {
    uint32_t begin, end;
};

/* True if the clip removes anything. */
bool sp_voxel_clips(const struct sp_clip *clip);
bool sp_voxel_clip_equal(const struct sp_clip *a, const struct sp_clip *b);

/* Fills intervals[dims[1] · dims[2]]. */
void sp_voxel_clip_rows(const struct sp_clip *clip, const struct sp_grid *grid,
                        struct sp_voxel_interval *intervals);

#endif
