/* SPDX-License-Identifier: Apache-2.0
 *
 * Post-classification splats the scalar and classifies pixels, so that voxels matter that are not
 * visible themselves: a pixel between a dark and a bright one may show a value that neither has.
 * What a pixel shows is a mean of the samples within the kernel's radius of its ray, hence a voxel
 * is left out only when no value between the smallest and the largest sample within two radii of it
 * can be visible. Decided for cells of 4³ voxels, 64 of them a brick.
 *
 *   samples ─► range a cell ─► smallest and largest of the cells around ─► a bit a cell
 */
#ifndef SP_CLASSIFY_REACH_H
#define SP_CLASSIFY_REACH_H

#include "classify/classification.h"

enum { SP_CELL = 4, SP_CELL_SHIFT = 2 };

/* Whether any value in [low, high], both relative to the base, is visible. */
bool sp_reach_is_visible(const struct sp_transfer_function *tf, double base, double low,
                         double high);

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
