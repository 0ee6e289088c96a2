/* SPDX-License-Identifier: Apache-2.0
 *
 * Sheet compositing (Westover 1990; Zwicker et al. 2001): splats of one sheet are added, sheets are
 * composited front to back.
 *
 *   T = Σ τ_k,  E = Σ c_k τ_k,  α = 1 − e^{−T},  C = (E/T)·α
 *   colour += transmittance·C,  transmittance ·= e^{−T}
 *
 * A tile whose pixels all let less than 1/512 through is saturated and takes no more splats.
 */
#ifndef SP_TILE_SHEET_H
#define SP_TILE_SHEET_H

#include "tile/tile.h"

#define SP_TRANSMITTANCE_MIN (1.0f / 512)

/* Adds the splat's footprint to the tile's sums. Their boxes overlap. `cut` as in sp_ewa_frame. */
void sp_sheet_add(struct sp_tile *tile, const struct sp_splat *splat, float cut);

/* Composites the open sheet, if there is one, and clears its sums. */
void sp_sheet_close(struct sp_tile *tile);

#endif
