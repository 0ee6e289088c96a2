/* SPDX-License-Identifier: Apache-2.0
 *
 * Computes the pixels of a slice, and the part of the image that a part of the volume covers.
 */
#ifndef SP_SLICES_QUAD_H
#define SP_SLICES_QUAD_H

#include "draw/slices/plan.h"
#include "splat/camera.h"

/* The rays of an image in distances along the axes of the grid. */
struct sp_quad_rays {
    struct sp_camera_transform camera;
    double eye[3];     /* where the ray through the image's centre begins */
    double axes[3][3]; /* right, down, forward */
};

void sp_quad_rays_init(struct sp_quad_rays *rays, const struct sp_interpolator *grid,
                       const struct sp_view *view);

/* Writes the values of a piece of a slice at n ≤ SP_INTERPOLATE_RUN pixels of row y, from column x
 * on; NaN = the ray misses the piece. Also writes the share of each pixel that the piece covers,
 * [0, 1]; it is below 1 along the border. Writes the depth of the pixel's centre on the plane of
 * the slice; infinite = the ray does not meet the plane. The value is taken at the pixel's centre,
 * or at a point of the border close to the centre. */
void sp_quad_sample(const struct sp_quad_rays *rays, const struct sp_interpolator *grid,
                    const struct sp_compose_plan *plan, const struct sp_compose_step *step,
                    uint32_t x, uint32_t y, size_t n, double *values, double *coverage,
                    double *depths);

/* Writes the box of pixels [low, high) that the part of the volume inside `clip` can cover. */
void sp_quad_outline(const struct sp_interpolator *grid, const struct sp_camera_transform *camera,
                     const struct sp_clip *clip, const uint32_t size[2], uint32_t low[2],
                     uint32_t high[2]);

#endif
