/* SPDX-License-Identifier: Apache-2.0
 *
 * Compositing splat by splat (Westover 1989; Chen et al. 2004: splat-every-sample): each splat is
 * attenuated and composited on its own, in the order of the records. Overlapping splats hide each
 * other although they belong to one field. Therefore colours bleed and darken.
 */
#ifndef SP_FOOTPRINTS_SPLAT_H
#define SP_FOOTPRINTS_SPLAT_H

#include "base/isa.h"
#include "draw/footprints/blend.h"

/* Composites splat n of the records. */
void sp_splat_add(struct sp_tile *tile, const struct sp_blend *blend,
                  const struct sp_splats *records, uint32_t n);

#endif
