/* SPDX-License-Identifier: Apache-2.0
 *
 * Post-classification splats the scalar and classifies pixels, so that voxels matter that are not
 * visible themselves: a pixel between a dark and a bright one may show a value that neither has.
 * What a pixel shows is a mean of the samples within the kernel's radius of its ray, hence a voxel
 * is left out only when no value between the smallest and the largest sample within two radii of it
 * can be visible. Decided for cells of 4³ voxels, 64 of them a brick.
 *
 * Values are compared as pixels have them, in single precision from the transfer's base on, so that
 * a volume's background at the foot of a ramp is left out.
 *
 *   samples ─► range a cell ─► smallest and largest of the cells around ─► a bit a cell
 */
#ifndef SP_CLASSIFY_REACH_H
#define SP_CLASSIFY_REACH_H

#include "classify/classification.h"

enum { SP_CELL = 4, SP_CELL_SHIFT = 2 };

/* Along an axis, of each of `count` cells: the first and the last one that its values may be mixed
 * with in a pixel, kernels being `reach` voxels in radius; of cells beyond the volume itself. */
void sp_reach_ends(const struct sp_grid *grid, unsigned axis, double reach, uint32_t count,
                   uint32_t *first, uint32_t *last);

/* Fills cells[bricks of the level's list]: bit x + 4·y + 16·z of a brick is its cell (x, y, z). The
 * level has its transfer; job->reach is the kernel's radius in voxels. SP_ERR_MEMORY,
 * SP_ERR_CANCELLED. */
bool sp_reach_fill(const struct sp_level *level, const struct sp_volume *volume,
                   const struct sp_classify_job *job, uint64_t *cells, struct sp_error *err);

/* Whether the voxel at `local` (visible.h) of a brick with these cells can matter. */
static inline bool sp_reach_has(uint64_t cells, uint32_t local) {
    return cells >> (local >> 2 & 3) >> (local >> 4 & 12) >> (local >> 6 & 48) & 1;
}

#endif
