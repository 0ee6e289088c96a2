/* SPDX-License-Identifier: Apache-2.0
 *
 * Interpolates the transform of a layer of elements from a (u = 0) to b (u = 1).
 *
 * If both transforms turn and scale evenly, so does the transform from a to b: p ↦ s·R·p + t, where
 * R is a rotation by θ about the unit vector n. At u it is the screw p ↦ s^u·R^u·p + t(u) of
 * constant speed:
 *
 *   t(u) = f(ln s)·t∥ + Re f(ln s + iθ)·t⊥ + Im f(ln s + iθ)·(n × t⊥)
 *   f(z) = (e^{uz} − 1) / (e^z − 1),   f(0) = u
 *
 * t∥ is the part of t along n, t⊥ the rest. A fixed point of the rotation, such as the centre of a
 * layer that turns about its centre, stays in place; a translation alone is straight. A rotation
 * takes the shorter way.
 *
 * Otherwise the numbers are interpolated linearly. If that passes through a singular matrix,
 * because one of the transforms mirrors, the transform is a until u = 1.
 */
#ifndef SRV_PATHS_BLEND_TRANSFORM_H
#define SRV_PATHS_BLEND_TRANSFORM_H

/* a, b: row by row, affine. The result is bit-equal to a at u <= 0 and to b at u >= 1. */
void srv_blend_transform(const double a[16], const double b[16], double u, double out[16]);

#endif
