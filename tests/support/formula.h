/* SPDX-License-Identifier: Apache-2.0
 *
 * A second opinion: the splatting formulas of the mathematics page in double precision, voxel by
 * voxel and pixel by pixel, without a thought for speed. Where the integral bounds what splatting
 * can reach (40 to 60 dB), this is what a backend must compute (above 80 dB): it finds what the
 * integral cannot tell from the method's own error. Written from the page, not from the renderer.
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
 * A kernel's share of a slab, and what planes leave of it: a plane that correlates with the depth
 * on the pixel's ray by more than 0.7 bounds the interval of depth, the largest lower and the
 * smallest upper bound count; any other is a factor Φ(mean/deviation). What lies beyond the
 * kernel's reach r √V22 belongs to the first and the last slab.
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

/* Any view but filter adaptive. The eye must be outside the volume. Compositing splat: sorted by
 * distance from the eye in ranges of `range` world units, then as the voxels come in bricks of 16³;
 * 0 = by the exact distance. False when out of memory. */
bool test_formula_render(const struct test_scene *scene, double range, struct test_image *image);

#endif
