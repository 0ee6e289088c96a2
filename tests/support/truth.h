/* SPDX-License-Identifier: Apache-2.0
 *
 * The ground truth for renderers: the volume rendering integral (Zwicker, eq. 1 and 2) along rays
 * through the continuous field of the same kernels (support/field.h), by brute force in double
 * precision. It shares no code with the renderer; it follows only the mathematics page.
 *
 *   pre     g(t) = Σ_k g_k r_k(t)              c(t) g(t) = Σ_k c_k g_k r_k(t)   [1/world unit]
 *   post    f(t) = Σ_k f_k r_k(t) / R(t),      R(t) = Σ_k r_k(t), over all samples that are finite
 *           g(t) = g(f(t))·R(t)                c(t) = c(f(t)); with the gradient axis or Phong from
 *                                              Σ_k ∇_k r_k(t) / R(t)
 *   pixel   I(x) = ∫ c g exp(-∫ g) dl   along the ray of the image point x, l from the eye
 *   image   (I * G_h)(pixel centre), then over the background
 *
 * Clip planes and the clip box multiply g by the indicator of the region that they keep. The region
 * is convex, so it keeps one interval of a ray. The steps begin and end at the ends of the
 * interval.
 *
 *      eye *- - - -|--x--x--x--x--x--|   steps of equal length; at each the exact sum over all
 *                  |   the volume    |   kernels within `radius` σ; constant within a step,
 *                  |    + radius     |   attenuated by exp exactly
 *
 * The midpoint rule with equal steps is almost exact for a smooth field that fades out on both
 * sides. Where a face cuts the field, each step uses the two points of the Gauss-Legendre rule.
 *
 * There are `samples` × `samples` rays per pixel on a regular raster. The number is odd, so the
 * middle ray passes through the pixel's centre: it gives the image without a low-pass filter. The
 * convolution uses all rays.
 */
#ifndef TESTS_SUPPORT_TRUTH_H
#define TESTS_SUPPORT_TRUTH_H

#include <stdbool.h>

#include "sp/view.h"
#include "sp/volume.h"
#include "support/image.h"

struct test_truth_options {
    unsigned samples; /* rays per pixel side, odd, [1, 15]; 0 = 3 */
    unsigned margin;  /* px around the image, for the convolution; 0 = 5 */
    double step;      /* voxels per step (of the smallest voxel of a rectilinear grid), > 0; 0 = 0.4
                         for Gaussian kernels, 0.2 for cubic ones, which are less smooth, 0.1 for
                         order post, where the transfer function has corners (truth_modes_test.c) */
    double radius;    /* Gaussians are summed out to at least this many σ; 0 = 4.5 */
    unsigned threads; /* 0 = one per core */
};

/* The integral along every ray: (width + 2·margin)·samples by (height + 2·margin)·samples,
 * associated, over nothing. */
struct test_rays {
    struct test_image image;
    unsigned samples, margin;
};

/* Uses these parts of `view`: size, camera, transfer function, filter.kernel and filter.sigma,
 * shading, clip. Ignores voxels nearer than camera.near. Rays start at the camera (perspective) or
 * at the plane of the camera (orthographic). `options` may be NULL. False with *err set when out of
 * memory or when the direction matrix is singular. */
bool test_truth_integrate(const struct sp_volume_info *info, const void *voxels,
                          const struct sp_view *view, const struct test_truth_options *options,
                          struct test_rays *rays, struct sp_error *err);
void test_rays_finish(struct test_rays *rays);

/* Makes the image of `width` × `height` px: the rays convolved with a Gaussian of standard
 * deviation `lowpass` px (0 = the rays through the pixel centres), over the background. Requires
 * margin ≥ 5·lowpass. */
bool test_truth_image(const struct test_rays *rays, double lowpass, const float background[4],
                      struct test_image *image);

#endif
