/* SPDX-License-Identifier: Apache-2.0
 *
 * Slab compositing (Mueller & Crawfis 1998): image-aligned slabs, bounded by equal distance from
 * the eye, so that nothing changes at once when the view turns. Each kernel is cut by the slabs'
 * faces:
 *
 *   eye *      |  0  |  1  |  2  |  3  |        share of slab j = Φ((z_{j+1} − μ)/s) − Φ((z_j −
 * μ)/s) ( kernel )                   μ, s: mean and deviation of depth on the pixel's ray
 *
 * (cubic: its own distribution). What lies beyond the kernel's reach is counted with its first and
 * last slab, so that the shares add to 1. As the slabs get thinner this tends to the integral.
 *
 * A tile keeps as many slabs open as a kernel may span; a splat that begins in slab k closes all
 * before k. Splats come in the order of layers none of which lies behind the first slab they touch.
 */
#ifndef SP_TILE_SLAB_H
#define SP_TILE_SLAB_H

#include "base/isa.h"
#include "tile/blend.h"

/* Adds splat n of the records to the tile's slabs. */
void sp_slab_add(struct sp_tile *tile, const struct sp_blend *blend,
                 const struct sp_splats *records, uint32_t n);

#endif
