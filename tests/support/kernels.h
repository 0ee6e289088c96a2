/* SPDX-License-Identifier: Apache-2.0
 *
 * Images of single kernels by rays, in double precision: each kernel is integrated along the ray
 * of each pixel from the near plane on, and composited by rank, and by the depths of the centres.
 * Nothing is projected. It shares no code with the renderer.
 */
#ifndef TESTS_SUPPORT_KERNELS_H
#define TESTS_SUPPORT_KERNELS_H

#include <stdbool.h>

#include "sp/view.h"
#include "support/image.h"

/* A Gaussian with the variance L·Lᵀ, L = lower triangular: L00, L10, L11, L20, L21, L22. */
struct test_kernel {
    double position[3], factor[6];
    double mass;    /* optical depth over the reference length, times the volume over that length */
    double opacity; /* trained Gaussians: at the centre; mass is 0 */
    double color[3];
    double rank; /* kernels of one rank are composited by the depth of their centres */
};

/* Draws kernels with a perspective view. Kernels with a mass end at view->filter.cutoff; those with
 * an opacity follow Kerbl et al. (2023), with the largest value along the ray, of which the part
 * beyond the near plane counts. `lowpass`: variance
 * that each kernel gains along both axes of the image, at the depth of its centre [px²]. False when
 * out of memory. */
bool test_kernels_render(const struct test_kernel *kernels, unsigned count,
                         const struct sp_view *view, double lowpass, struct test_image *image);

#endif
