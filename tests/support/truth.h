/* SPDX-License-Identifier: Apache-2.0
 *
 * The truth that renderers are held to: the volume rendering integral (Zwicker, eq. 1 and 2) along
 * rays through the continuous field of the same Gaussian kernels, by brute force in double
 * precision. It shares no code with the renderer; it knows the mathematics page alone.
 *
 *   extinction   g(t)      = Σ_k g_k r_k(t)                               [1/world unit]
 *   emission     c(t) g(t) = Σ_k c_k g_k r_k(t)
 *   kernel       r_k(t)    = v_k G_{V''}(t - t_k)
 *   pixel        I(x)      = ∫ c g exp(-∫ g) dl   along the ray of the image point x, l from the
 * eye image        (I * G_h)(pixel centre), then over the background
 *
 * On a grid V'' = σ²·M Mᵀ with M = direction·diag(spacing), and v_k = |det M|. So in index space
 * i = M⁻¹(t - origin) the kernel is the product of three normal densities of deviation σ voxels,
 * whatever the spacing, rotation, shear or handedness. The integrator marches there:
 *
 *      eye *- - - -|--x--x--x--x--x--|   steps of equal length in voxels; at each the exact sum
 *                  |   the volume    |   over all kernels within `radius` σ; constant within a
 *                  |    + radius     |   step, attenuated by exp exactly
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

/* The colour that voxel `index` (i0 fastest) emits: `color` holds the transfer function's and may
 * be replaced. Called once a visible voxel, from one thread. */
typedef void test_emission_fn(void *user, const uint32_t i[3], double color[3]);

struct test_truth_options {
    unsigned samples;           /* rays a pixel side, odd, [1, 15]; 0 = 3 */
    unsigned margin;            /* px around the image, for the convolution; 0 = 5 */
    double step;                /* voxels a step, > 0; 0 = 0.4 */
    double radius;              /* kernels are summed out to at least this many σ; 0 = 4.5 */
    unsigned threads;           /* 0 = one a core */
    test_emission_fn *emission; /* NULL = the transfer function's colour */
    void *user;
};

/* The integral along every ray: (width + 2·margin)·samples by (height + 2·margin)·samples,
 * associated, over nothing. */
struct test_rays {
    struct test_image image;
    unsigned samples, margin;
};

/* Uses of `view`: size, camera, transfer function (1-D), filter.sigma. Voxels nearer than
 * camera.near are left out, and rays start at the eye (perspective) or at the eye's plane
 * (orthographic). `options` may be NULL. False with *err set when out of memory or when the
 * direction matrix is singular. */
bool test_truth_integrate(const struct sp_volume_info *info, const void *voxels,
                          const struct sp_view *view, const struct test_truth_options *options,
                          struct test_rays *rays, struct sp_error *err);
void test_rays_finish(struct test_rays *rays);

/* The image of `width` × `height` px, convolved with a Gaussian of standard deviation `lowpass` px
 * (0 = the rays through the pixel centres), over the background. Wants margin ≥ 5·lowpass. */
bool test_truth_image(const struct test_rays *rays, double lowpass, const float background[4],
                      struct test_image *image);

/* One sample as a double; `index` counts voxels. NaN and infinities as they are. */
double test_sample(const void *voxels, enum sp_type type, size_t index);

/* The transfer function at a value: colour (sRGB display values) and opacity, linear between the
 * points, constant outside. */
void test_classify(const struct sp_transfer_function *tf, double value, double color[3],
                   double *opacity);

/* Axes of camera space: right, down, forward as rows of W (u = W (t - position)). */
void test_camera_axes(const struct sp_camera *camera, double w[3][3]);

/* Blinn-Phong colours from central differences that nothing has quantised (one-sided at the
 * border), as a test_emission_fn with a struct test_phong as user:
 *   c' = c·(ambient + diffuse·Σ l |N·L|) + specular·Σ l |N·H|^exponent, not bounded;
 * without a gradient N·L = 1 and there is no highlight. */
struct test_phong {
    const struct sp_volume_info *info;
    const void *voxels;
    const struct sp_view *view;
};
void test_phong_emission(void *user, const uint32_t i[3], double color[3]);

#endif
