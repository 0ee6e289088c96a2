/* SPDX-License-Identifier: Apache-2.0
 *
 * The way of a layer of elements from the transform a (u = 0) to b (u = 1).
 *
 * If both turn and scale evenly, so does what leads from a to b: p ↦ s·R·p + t, with R a turn by θ
 * about the unit vector n. At u it is the screw p ↦ s^u·R^u·p + t(u) whose speed is constant:
 *
 *   t(u) = f(ln s)·t∥ + Re f(ln s + iθ)·t⊥ + Im f(ln s + iθ)·(n × t⊥),   f(z) = (e^{uz} − 1)/(e^z −
 * 1)
 *
 * with t∥ along n, and f(0) = u. What the turn keeps, such as the middle of a layer that turns
 * about it, stays where it is; a move alone is straight. A turn goes the shorter way.
 *
 * Else numbers are linear; where that would pass through a singular matrix, because one of both
 * mirrors, the transform is a until u = 1.
 */
#ifndef SRV_PATHS_BLEND_TRANSFORM_H
#define SRV_PATHS_BLEND_TRANSFORM_H

/* a, b: row by row, affine. The result is bit-equal to a at u <= 0 and to b at u >= 1. */
void srv_blend_transform(const double a[16], const double b[16], double u, double out[16]);

#endif
