/* SPDX-License-Identifier: Apache-2.0
 *
 * Level of detail: which level of the pyramid (classify/mip.h) each part of a frame is drawn at,
 * so that the cost of a minified volume follows the pixels that it covers, not its voxels.
 *
 *   level l of a brick: 16³ cells of 2^l × 2^l × 2^l voxels, over 2 × 2 × 2 bricks of level l − 1
 *   a frame: a cut through that octree, which holds each voxel once
 *
 * A cell is small enough where it spans at most SP_DETAIL_PIXELS times the low-pass filter's
 * standard deviation in the picture, judged at the corner of the brick that is nearest to the eye.
 * There the pixel's filter hides the lattice, and what is left of the cell's size is taken out of
 * its kernel: averaging is a box of variance (4^l − 1)/12 voxels², and a kernel of
 *
 *   σ_l² = σ² − (4^l − 1)/12  voxels²    (at least SP_DETAIL_SIGMA cells)
 *
 * after it leaves the footprint's variance as it was.
 *
 * Gaussian kernels have levels, and the filters that have a low-pass; the others are drawn whole.
 * So is post-classification: what a transfer function makes of an averaged scalar is another
 * object.
 */
#ifndef SP_SPLAT_DETAIL_H
#define SP_SPLAT_DETAIL_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "sp/view.h"
#include "splat/camera.h"
#include "volume/grid.h"

#define SP_DETAIL_PIXELS 0.9
#define SP_DETAIL_SIGMA 0.1

/* A brick of a level, to be drawn. */
struct sp_detail_brick {
    uint32_t brick; /* of its level, as in visible.h */
    uint8_t level;
    bool is_enlarged; /* coarser than its size in the picture allows, because the frame must be
                         quick: its kernels keep σ cells, or there would be holes */
};

struct sp_detail {
    struct sp_detail_brick *bricks; /* the arena's */
    uint32_t count;
    uint32_t levels; /* bit l: some brick is of level l */
};

struct sp_detail_job {
    const struct sp_camera_frame *camera;
    const struct sp_grid *grid; /* finest; at most 2^25 bricks */
    const struct sp_view *view;
    unsigned floor;  /* no brick is finer */
    unsigned levels; /* that may be used: 0 … levels − 1; > floor */
};

/* Levels of a grid, up to the one of a single brick, and at most `most`. */
unsigned sp_detail_levels(const uint32_t dims[3], unsigned most);

/* Cells of a level along an axis. */
static inline uint32_t sp_detail_cells(uint32_t dim, unsigned level) {
    return (uint32_t)((dim + (UINT64_C(1) << level) - 1) >> level);
}

/* Whether the view can be drawn at levels that it does not ask for. */
bool sp_detail_is_possible(const struct sp_view *view);

/* The cut. False when the arena could not allocate. */
bool sp_detail_choose(const struct sp_detail_job *job, struct sp_arena *arena,
                      struct sp_detail *detail);

/* The filter of a level's own grid: its kernel takes less room (see above), unless it is enlarged.
 */
struct sp_filter sp_detail_filter(const struct sp_filter *filter, unsigned level, bool is_enlarged);

#endif
