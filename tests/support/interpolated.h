/* SPDX-License-Identifier: Apache-2.0
 *
 * The ground truth for sheets that are classified after interpolation: the volume rendering
 * integral along the ray of each pixel's centre through the interpolated field, by brute force in
 * double precision. It shares no code with the renderer.
 *
 * Field: support/interpolant.h. Occlusion and shadow: support/lit.h.
 *
 * Extinction and colour: the transfer function at the field's value and at the length of its
 * gradient, which is a central difference over half a sample to each side. A point that a clip
 * plane or the clip box removes has no extinction.
 *
 * Samples must be finite, and attenuation exponential.
 */
#ifndef TESTS_SUPPORT_INTERPOLATED_H
#define TESTS_SUPPORT_INTERPOLATED_H

#include "support/image.h"
#include "support/scene.h"

/* Renders the scene over its background with `steps` steps per smallest spacing. False when out of
 * memory. */
bool test_interpolated(const struct test_scene *scene, unsigned steps, struct test_image *image);

/* Called with the ray of a pixel, whose samples are `step` apart. Nothing to draw lies outside the
 * distances [from, to] from the eye. Writes four numbers for the pixel. */
typedef void test_ray_fn(void *user, const double eye[3], const double ahead[3], double from,
                         double to, double step, double *rgba);

/* Follows the ray of each pixel's centre. False when out of memory. */
bool test_each_ray(const struct test_scene *scene, unsigned steps, test_ray_fn *follow, void *user,
                   struct test_image *image);

/* The same for the rows [begin, end) of the view only; the image has only these rows. */
bool test_ray_rows(const struct test_scene *scene, unsigned steps, unsigned begin, unsigned end,
                   test_ray_fn *follow, void *user, struct test_image *image);

#endif
