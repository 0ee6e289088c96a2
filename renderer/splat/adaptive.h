/* SPDX-License-Identifier: Apache-2.0
 *
 * The adaptive filter (Chen et al. 2004, eq. 7) decides per brick (visible.h) which filter
 * dominates the footprints. R = f·r_k/u2 is the radius of a kernel in the image and r_h the radius
 * of the low-pass filter; both are standard deviations in px:
 *
 *   R·c_min > r_h for the smallest kernel radius and the farthest corner   → reconstruction
 *   R·c_max < r_h for the largest kernel radius and the nearest corner     → lowpass
 *   else                                                                   → ewa
 *
 * A brick uses a cheaper filter only if the condition holds for all of its voxels.
 */
#ifndef SP_SPLAT_ADAPTIVE_H
#define SP_SPLAT_ADAPTIVE_H

#include <stdint.h>

#include "classify/visible.h"
#include "sp/view.h"
#include "splat/camera.h"

struct sp_adaptive {
    enum sp_projection projection;
    double scale; /* f [px] or s [px per world unit] */
    const struct sp_grid *grid;
    double radius[2]; /* smallest and largest standard deviation of a kernel at the mean spacing,
                         world units */
    double lowpass;   /* r_h, px */
    double c_min, c_max;
    double depth[3], base; /* u2 = base + Σ depth·distance along the axis */
    uint32_t blocks[3];    /* bricks per axis */
};

/* Returns the view's c_max, or its default for the camera: 2.5·(1 + 2·tan²(fov/2)),
 * orthographic 2.5. */
double sp_adaptive_c_max(const struct sp_filter *filter, const struct sp_camera *camera);

/* Returns the standard deviation of the view's kernel [voxels]. */
double sp_kernel_sigma(const struct sp_filter *filter);

/* Returns the radius where the view's kernel ends [voxels]. */
double sp_kernel_reach(const struct sp_filter *filter);

/* Computes the smallest and the largest standard deviation of any kernel of the grid in any
 * direction [world unit]. */
void sp_kernel_radii(const struct sp_grid *grid, double sigma, double radius[2]);

/* Fills *adaptive for a frame. `filter` replaces the filter of the view; the grid is borrowed. */
void sp_adaptive_init(struct sp_adaptive *adaptive, const struct sp_camera_transform *camera,
                      const struct sp_grid *grid, const struct sp_view *view,
                      const struct sp_filter *filter);

/* Returns the filter for kernels with standard deviations in [radius[0], radius[1]] and u2 in
 * [nearest, farthest] [world unit]. */
enum sp_filter_mode sp_adaptive_mode(const struct sp_adaptive *adaptive, const double radius[2],
                                     double nearest, double farthest);

/* Returns the filter of one brick. */
enum sp_filter_mode sp_adaptive_block(const struct sp_adaptive *adaptive, const uint32_t block[3]);

/* Returns the number of bricks of a grid. */
uint64_t sp_adaptive_count(const struct sp_grid *grid);

/* Fills modes[sp_adaptive_count()], axis 0 fastest. Returns the mode of all bricks if they have one
 * mode, otherwise SP_FILTER_ADAPTIVE. */
enum sp_filter_mode sp_adaptive_fill(const struct sp_adaptive *adaptive, uint8_t *modes);

#endif
