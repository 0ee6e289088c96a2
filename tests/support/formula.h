/* SPDX-License-Identifier: Apache-2.0
 *
 * A second opinion: the splatting formulas of the mathematics page in double precision, voxel by
 * voxel and pixel by pixel, without a thought for speed. Where the integral bounds what splatting
 * can reach (40 to 60 dB), this is what a backend must compute (above 80 dB): it finds what the
 * integral cannot tell from the method's own error. Written from the page, not from the renderer.
 *
 *   V̂ + V_h  →  τ_k(x) = g_k v_k |det J| G(x - x_k) / (1 - exp(-r²/2)) inside the radius r
 *   a sheet: T = Σ τ_k, E = Σ c_k τ_k, α = 1 - exp(-T), C = (E/T)·α; sheets front to back
 */
#ifndef TESTS_SUPPORT_FORMULA_H
#define TESTS_SUPPORT_FORMULA_H

#include "support/scene.h"
#include "support/truth.h"

/* Sheet compositing, exponential attenuation, filter ewa, reconstruction or lowpass, shading none
 * or Phong (from gradients that nothing has quantised). The eye must be outside the volume. False
 * when out of memory. */
bool test_formula_render(const struct test_scene *scene, struct test_image *image);

#endif
