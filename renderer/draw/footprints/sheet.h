/* SPDX-License-Identifier: Apache-2.0
 *
 * Sheet compositing (Westover 1990; Zwicker et al. 2001): splats of one sheet are added, sheets are
 * composited front to back (blend.h).
 */
#ifndef SP_FOOTPRINTS_SHEET_H
#define SP_FOOTPRINTS_SHEET_H

#include "base/isa.h"
#include "draw/footprints/blend.h"

/* Adds splat n of the records to the tile's open sheet. If it belongs to another sheet, the open
 * one is composited first. The splat's box must overlap the tile. */
void sp_sheet_add(struct sp_tile *tile, const struct sp_blend *blend,
                  const struct sp_splats *records, uint32_t n);

#endif
