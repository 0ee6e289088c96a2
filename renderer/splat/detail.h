/* SPDX-License-Identifier: Apache-2.0
 *
 * Level of detail: chooses the mip level (classify/mip.h) for each part of a frame, so that the
 * cost of a minified volume follows the pixels that it covers, not its voxels.
 *
 *   level l of a brick: 16³ cells of 2^l × 2^l × 2^l voxels, over 2 × 2 × 2 bricks of level l − 1
 *   a frame draws a cut through that octree, which contains each voxel once
 *
 * A cell is small enough where it spans at most SP_DETAIL_PIXELS times the low-pass filter's
 * standard deviation in the image, judged at the corner of the brick that is nearest to the eye. At
 * that size the low-pass filter hides the lattice. The remaining error is the order of samples
 * along a ray inside a cell: the front of an opaque cell should hide its back. Therefore cells may
 * span SP_DETAIL_THIN_PIXELS on a level where no cell has an optical depth above SP_DETAIL_THIN.
 *
 * Averaging is a box filter of variance (4^l − 1)/12 voxels². The kernel of level l is narrower, so
 * that footprints have the same variance as at full detail:
 *
 *   σ_l² = σ² − (4^l − 1)/12  voxels²    (at least SP_DETAIL_SIGMA cells)
 *
 * Levels need a Gaussian kernel and a filter mode with a low-pass filter; other views are drawn at
 * full detail. Post-classification is also drawn at full detail, because the transfer function of
 * an averaged scalar shows another object.
 */
#ifndef SP_SPLAT_DETAIL_H
#define SP_SPLAT_DETAIL_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "data/volume/grid.h"
#include "sp/view.h"
#include "splat/camera.h"

#define SP_DETAIL_PIXELS 0.9
#define SP_DETAIL_THIN 1.25 /* optical depth */
#define SP_DETAIL_THIN_PIXELS 1.25
#define SP_DETAIL_SIGMA 0.1

/* One brick of the cut. */
struct sp_detail_brick {
    uint32_t brick; /* number in its level, as in visible.h */
    uint8_t level;
    bool is_enlarged; /* coarser than its size in the image allows, because of `floor`. Its kernels
                         keep σ in cells, because narrower kernels would leave holes */
};

struct sp_detail {
    struct sp_detail_brick *bricks; /* in the arena, until its next reset */
    uint32_t count;
    uint32_t levels; /* bit l = the cut has bricks of level l */
};

struct sp_detail_job {
    const struct sp_camera_transform *camera;
    const struct sp_grid *grid; /* finest; at most 2^25 bricks */
    const struct sp_view *view;
    unsigned floor;  /* finest level to use */
    unsigned levels; /* number of levels to use: 0 … levels − 1; > floor */
};

/* Returns the number of levels of a grid: up to the level that has a single brick, at most
 * `most`. */
unsigned sp_detail_levels(const uint32_t dims[3], unsigned most);

/* Returns how wide a cell of a level may be in the image [standard deviations of the low-pass
 * filter]. */
double sp_detail_pixels(const struct sp_view *view, const struct sp_grid *grid, unsigned level);

/* Returns the number of cells of a level along an axis of `dim` voxels. */
static inline uint32_t sp_detail_cells(uint32_t dim, unsigned level) {
    return (uint32_t)((dim + (UINT64_C(1) << level) - 1) >> level);
}

/* True if coarse levels can replace voxels in this view without a visible difference. */
bool sp_detail_is_possible(const struct sp_view *view);

/* Chooses the cut. False if the arena cannot allocate. */
bool sp_detail_choose(const struct sp_detail_job *job, struct sp_arena *arena,
                      struct sp_detail *detail);

/* Returns the filter for the grid of a level: its kernel is narrower (see above) unless it is
 * enlarged. */
struct sp_filter sp_detail_filter(const struct sp_filter *filter, unsigned level, bool is_enlarged);

#endif
