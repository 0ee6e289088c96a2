/* SPDX-License-Identifier: Apache-2.0
 *
 * The position, value, gradient, colour, opacity and shading of a sample of a volume, for the
 * integrator (truth.h) and the formulas (formula.h). In double precision, without quantisation;
 * written from the mathematics page and the documentation of the view, not from the renderer.
 */
#ifndef TESTS_SUPPORT_SAMPLE_H
#define TESTS_SUPPORT_SAMPLE_H

#include <stddef.h>

#include "sp/view.h"
#include "sp/volume.h"

/* Returns a sample as a double; `index` counts voxels. NaN and infinities stay unchanged. */
double test_sample(const void *voxels, enum sp_type type, size_t index);

/* Index of the sample i (i0 fastest). */
size_t test_sample_index(const struct sp_grid *grid, const uint32_t i[3]);

/* Sets the position of a sample in world space. */
void test_sample_place(const struct sp_grid *grid, const uint32_t i[3], double world[3]);

/* The gradient in world space [data unit per world unit] by central differences, (f₊ - f₋)/(c₊ -
 * c₋) along each axis; one-sided at a border and beside a sample that is not finite. */
void test_gradient(const struct sp_volume_info *info, const void *voxels, const uint32_t i[3],
                   double gradient[3]);

/* The transfer function at a value and a gradient's magnitude: colour (sRGB display values) and
 * opacity, both linear between the points and constant outside. */
void test_classify(const struct sp_transfer_function *tf, double value, double magnitude,
                   double color[3], double *opacity);

/* True if the colour or the opacity depends on the gradient. */
bool test_needs_gradient(const struct sp_view *view);

/* Axes of camera space: right, down, forward as rows of W (u = W (t - position)). */
void test_camera_axes(const struct sp_camera *camera, double w[3][3]);

/* px per unit of u0/u2 (perspective: f) or per world unit (orthographic: s). */
double test_camera_scale(const struct sp_view *view);

/* Blinn and Phong, two-sided; does nothing unless the view asks for it.
 *   c' = c·(ambient + diffuse·Σ l |N·L|) + specular·Σ l |N·H|^exponent, not bounded;
 * without a gradient N·L = 1 and there is no highlight. `ahead` is the unit vector from the eye to
 * the place that is shaded, in world space. */
void test_shade(const struct sp_view *view, const double ahead[3], const double gradient[3],
                double color[3]);

/* The same for a place that light reaches in part: share[0] of ambient and diffuse light, share[1]
 * of the first light. */
void test_shade_shares(const struct sp_view *view, const double ahead[3], const double gradient[3],
                       const double share[2], double color[3]);

/* Unit vector towards a light of the view, in world space. */
void test_light_direction(const struct sp_view *view, uint32_t l, double world[3]);

#endif
