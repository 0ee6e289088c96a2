/* SPDX-License-Identifier: Apache-2.0
 *
 * The ground truth for projections: numbers of the interpolated field (interpolant.h) along the ray
 * of each pixel's centre, by brute force in double precision. It shares no code with the renderer.
 */
#ifndef TESTS_SUPPORT_PROJECTED_H
#define TESTS_SUPPORT_PROJECTED_H

#include "support/image.h"
#include "support/scene.h"

/* Writes four numbers per pixel: the largest and the smallest value, the integral of
 * max(value − zero, 0) and the length of the ray inside the volume; length 0 = the ray misses it.
 * Follows the rays once for two values of zero, each with an image of its own. Samples must be
 * finite. False when out of memory; the caller finishes both images in this case as well. */
bool test_projected(const struct test_scene *scene, unsigned steps, const double zero[2],
                    struct test_image numbers[2]);

/* Makes the image of the view's projection from these numbers: its window, its colours, over its
 * background. `zero` as above; the view's zero is not read. False when out of memory. */
bool test_projected_image(const struct sp_view *view, const struct test_image *numbers, double zero,
                          struct test_image *image);

#endif
