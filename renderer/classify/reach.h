/* SPDX-License-Identifier: Apache-2.0
 *
 * Finds the voxels that can matter in post-classification, which splats the scalar and classifies
 * pixels. A voxel can matter although it is not visible: a pixel between a low and a high sample
 * may have a value between both. The value of a pixel is a mean of the samples within the kernel's
 * radius of its ray. A voxel is therefore left out only if no value between the smallest and the
 * largest sample within two radii of it can be visible. This is decided for cells of 4³ voxels, 64
 * per brick.
 *
 * Values are compared in the form that pixels use, in single precision relative to the transfer's
 * base. So a background at the foot of a ramp is left out.
 *
 *   samples ─► range per cell ─► range of the cells around it ─► one bit per cell
 */
#ifndef SP_CLASSIFY_REACH_H
#define SP_CLASSIFY_REACH_H

#include "classify/level.h"

enum { SP_CELL = 4, SP_CELL_SHIFT = 2 };

/* Computes, for each of `count` cells along an axis, the first and the last cell whose values a
 * pixel may mix with the values of the cell; `reach` is the radius of the kernels [voxels]. For a
 * cell outside the volume both are the cell itself. */
void sp_reach_ends(const struct sp_grid *grid, unsigned axis, double reach, uint32_t count,
                   uint32_t *first, uint32_t *last);

/* Fills cells[bricks of the level's list]: bit x + 4·y + 16·z of a brick is its cell (x, y, z). The
 * level has its transfer; job->reach is the kernel's radius in voxels. SP_ERR_MEMORY,
 * SP_ERR_CANCELLED. */
bool sp_reach_fill(const struct sp_level *level, const struct sp_volume *volume,
                   const struct sp_classify_job *job, uint64_t *cells, struct sp_error *err);

/* True if the voxel at `local` (visible.h) of a brick with these cells can matter. */
static inline bool sp_reach_has(uint64_t cells, uint32_t local) {
    return cells >> (local >> 2 & 3) >> (local >> 4 & 12) >> (local >> 6 & 48) & 1;
}

#endif
