/* SPDX-License-Identifier: Apache-2.0
 *
 * The silhouette of the drawn part of a volume. This part is convex, so the rays that meet it fill
 * a convex polygon of the image:
 *
 *        ·────────╲       each side is the image of an edge between a face that rays enter
 *       ╱          ╲      and a face that they leave
 *      ╱  volume    │
 *     └─────────────┘
 *
 * A pixel that a side crosses shows the volume in a part of its area only (cover.c). One ray
 * through its centre would show it in all of the area or in none: opaque material that clipping
 * cuts would have jagged outlines.
 *
 * With the gap g of a half space, normal·(start of the ray) + g = offset, and the rise r =
 * normal·(direction of the ray), a ray meets the faces i, which it enters, and j, which it leaves,
 * in this order if
 *
 *   g_i/r_i <= g_j/r_j,  which is  g_i·r_j − g_j·r_i >= 0   since r_i > 0 and r_j < 0.
 *
 * In perspective g is constant and r is linear in the pixel, and in orthographic views r is
 * constant and g is linear. So the left side is linear: the line of the edge. (Ours.)
 */
#ifndef SP_RESAMPLE_SILHOUETTE_H
#define SP_RESAMPLE_SILHOUETTE_H

#include "draw/resample/resample.h"

/* Computes the silhouette of a channel from its half spaces and its camera. The sides that no pixel
 * sees are left out; none is left if there are more than RESAMPLE_SIDES_MAX. */
void sp_silhouette_init(struct sp_silhouette *silhouette, const struct sp_resample *r);

/* True if both have equally many sides, and each side of `a` is within 0.01 px of one of `b`. */
bool sp_silhouette_is_equal(const struct sp_silhouette *a, const struct sp_silhouette *b);

#endif
