/* SPDX-License-Identifier: Apache-2.0
 *
 * A reference renderer: evaluates the splatting formulas of the mathematics page in double
 * precision, voxel by voxel and pixel by pixel, without optimisation. Splatting itself differs from
 * the integral (40 to 60 dB), but a backend must agree with these formulas (above 80 dB). The
 * comparison finds errors that the error of the method hides. It is written from the page, not from
 * the renderer.
 *
 *   V = J W V'' Wᵀ Jᵀ,  V̂ = its image part,  d = x - x_k
 *   length(x) = v_k |det J| G_Ṽ(d) / (1 - exp(-r²/2)) inside the radius r           [world unit]
 *     Ṽ: ewa V̂ + h²I; reconstruction V̂; lowpass h²I; swan V̂ scaled until its smaller eigenvalue
 *     is h²; none: a flat rectangle of sides max(1.6 voxels' projection, 1 px)
 *     cubic: v_k |det J| s² F(s √(dᵀṼ⁻¹d)) / √det Ṽ, s its deviation [voxels], no cutoff
 *   depth along the pixel's ray: mean x2_k + V20 E⁻¹ d, variance V22 - V20 E⁻¹ V02
 *   plane n·t ≥ o: mean n·t_k - o + c E⁻¹ d, variance nᵀV''n - c E⁻¹ cᵀ, c = J W V'' n (image part)
 *     E = Ṽ, but V̂ + h²I for lowpass, V̂ for none; cubic: its own distribution on the ray
 *
 * The share of a kernel in a slab, and the part that clip planes keep: a plane whose correlation
 * with the depth on the pixel's ray is above 0.7 bounds the depth interval; the largest lower and
 * the smallest upper bound apply. Any other plane is a factor Φ(mean/deviation). The part beyond
 * the kernel's reach r √V22 belongs to the first and the last slab.
 *
 *   layer (a sheet, a slab, one splat): T = Σ τ_k, E = Σ c_k τ_k, τ_k = g_k length·share
 *     α = 1 - exp(-T) or min(T, 1), C = (E/T)·α; layers front to back
 *   post: W = Σ length·share, S = Σ f_k length·share, N = Σ ∇f_k length·share; T = g·W with the
 *     mean of the transfer function over S/W ± ½ thickness·|N/W along the ray|
 */
#ifndef TESTS_SUPPORT_FORMULA_H
#define TESTS_SUPPORT_FORMULA_H

#include "support/scene.h"
#include "support/truth.h"

/* Renders the scene; any view except filter adaptive. The camera must be outside the volume.
 * Compositing `splat` sorts by the distance from the camera in ranges of `range` world units (0 =
 * by the exact distance), then by the order of the voxels in bricks of 16³. False when out of
 * memory.
 */
bool test_formula_render(const struct test_scene *scene, double range, struct test_image *image);

#endif
