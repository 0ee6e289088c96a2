/* SPDX-License-Identifier: Apache-2.0
 *
 * Slab compositing (Mueller and Crawfis 1998): image-aligned slabs, bounded by equal distance from
 * the eye, so that nothing pops when the view turns. Each kernel is cut by the slabs' faces:
 *
 *   eye *      |  0  |  1  |  2  |  3  |
 *                 (   kernel   )
 *   share of slab j = Φ((z_{j+1} − μ)/s) − Φ((z_j − μ)/s)
 *   μ, s: mean and deviation of the kernel's depth on the pixel's ray; cubic: its own distribution
 *
 * The tails of the distribution beyond the kernel's reach count as parts of its first and last
 * slab, so that the shares add up to 1. With thinner slabs the image converges to the integral
 * along the ray.
 *
 * A tile keeps as many slabs open as a kernel can span. A splat that begins in slab k closes all
 * slabs before k. This is correct because the order of the layers ensures that no later splat
 * touches an earlier slab.
 */
#ifndef SP_FOOTPRINTS_SLAB_H
#define SP_FOOTPRINTS_SLAB_H

#include "base/isa.h"
#include "draw/footprints/blend.h"

/* Adds splat n of the records to the tile's slabs. */
void sp_slab_add(struct sp_tile *tile, const struct sp_blend *blend,
                 const struct sp_splats *records, uint32_t n);

#endif
