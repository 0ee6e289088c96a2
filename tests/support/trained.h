/* SPDX-License-Identifier: Apache-2.0
 *
 * Trained Gaussian scenes by their published formulas (Kerbl et al. 2023; Zwicker et al. 2001), in
 * double precision, pixel by pixel over all Gaussians. It shares no code with the renderer.
 */
#ifndef TESTS_SUPPORT_TRAINED_H
#define TESTS_SUPPORT_TRAINED_H

#include <stdbool.h>

#include "sp/elements.h"
#include "sp/view.h"
#include "support/hit.h"
#include "support/image.h"

/* One Gaussian as scene files describe it. */
struct test_gaussian {
    double position[3], scales[3];
    double rotation[4]; /* quaternion w, x, y, z; any length but 0 */
    double opacity;     /* [0, 1] */
    double harmonics[16][3];
};

/* Fills element `at` of the arrays, whose factors are computed from scales and rotation. */
void test_gaussian_store(const struct test_gaussian *gaussian, const struct sp_elements *to,
                         unsigned at);

/* Draws the Gaussians with the view's camera, size and background, and the layer's transform,
 * opacity and convention. False when out of memory. */
bool test_trained_render(const struct test_gaussian *gaussians, unsigned count, unsigned degree,
                         const struct sp_view *view, const struct sp_layer *layer,
                         struct test_image *image);

/* Returns the Gaussians before they are composited, front to back. NULL when out of memory. */
struct test_trained *test_trained_create(const struct test_gaussian *gaussians, unsigned count,
                                         unsigned degree, const struct sp_view *view,
                                         const struct sp_layer *layer);
void test_trained_destroy(struct test_trained **trained);

/* Fills hits[] with the Gaussians at a point of the image [px], front to back; returns their
 * number, at most `count` of test_trained_create(). */
unsigned test_trained_hits(const struct test_trained *trained, double x, double y,
                           struct test_hit *hits);

#endif
