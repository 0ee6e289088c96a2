/* SPDX-License-Identifier: Apache-2.0
 *
 * The truth that renderers are held to: the volume rendering integral (Zwicker, eq. 1 and 2) along
 * rays through the continuous field of the same kernels (support/field.h), by brute force in double
 * precision. It shares no code with the renderer; it knows the mathematics page alone.
 *
 *   pre     g(t) = Σ_k g_k r_k(t)              c(t) g(t) = Σ_k c_k g_k r_k(t)   [1/world unit]
 *   post    f(t) = Σ_k f_k r_k(t) / R(t),      R(t) = Σ_k r_k(t), over all samples that are finite
 *           g(t) = g(f(t))·R(t)                c(t) = c(f(t)); with the gradient axis or Phong from
 *                                              Σ_k ∇_k r_k(t) / R(t)
 *   pixel   I(x) = ∫ c g exp(-∫ g) dl   along the ray of the image point x, l from the eye
 *   image   (I * G_h)(pixel centre), then over the background
 *
 * Clip planes and the clip box multiply g by the indicator of what they keep. That is convex, so it
 * leaves one interval of a ray, and the steps begin and end on its faces.
 *
 *      eye *- - - -|--x--x--x--x--x--|   steps of equal length; at each the exact sum over all
 *                  |   the volume    |   kernels within `radius` σ; constant within a step,
 *                  |    + radius     |   attenuated by exp exactly
 *
 * A sum at the middles of equal steps is as good as exact for a smooth field that fades out on both
 * sides. Where a face cuts it, each step is taken at the two points of Gauss and Legendre.
 *
 * Rays are `samples` × `samples` a pixel on a regular raster. With an odd number the middle one
 * passes through the pixel's centre: that is the image without low-pass; the others serve the
 * convolution.
 */
#ifndef TESTS_SUPPORT_TRUTH_H
#define TESTS_SUPPORT_TRUTH_H

#include <stdbool.h>

#include "sp/view.h"
#include "sp/volume.h"
#include "support/image.h"

struct test_truth_options {
    unsigned samples; /* rays a pixel side, odd, [1, 15]; 0 = 3 */
    unsigned margin;  /* px around the image, for the convolution; 0 = 5 */
    double step;      /* voxels a step (the smallest of a rectilinear grid), > 0; 0 = 0.4 for
                         Gaussian kernels, 0.2 for cubic ones, which are not as smooth, 0.1 for
                         order post, where the transfer function makes corners (see truth_modes) */
    double radius;    /* Gaussians are summed out to at least this many σ; 0 = 4.5 */
    unsigned threads; /* 0 = one per core */
};

/* The integral along every ray: (width + 2·margin)·samples by (height + 2·margin)·samples,
 * associated, over nothing. */
struct test_rays {
    struct test_image image;
    unsigned samples, margin;
};

/* Uses of `view`: size, camera, transfer function, filter.kernel and filter.sigma, shading, clip.
 * Voxels nearer than camera.near are left out, and rays start at the eye (perspective) or at the
 * eye's plane (orthographic). `options` may be NULL. False with *err set when out of memory or when
 * the direction matrix is singular. */
bool test_truth_integrate(const struct sp_volume_info *info, const void *voxels,
                          const struct sp_view *view, const struct test_truth_options *options,
                          struct test_rays *rays, struct sp_error *err);
void test_rays_finish(struct test_rays *rays);

/* The image of `width` × `height` px, convolved with a Gaussian of standard deviation `lowpass` px
 * (0 = the rays through the pixel centres), over the background. Wants margin ≥ 5·lowpass. */
bool test_truth_image(const struct test_rays *rays, double lowpass, const float background[4],
                      struct test_image *image);

#endif
