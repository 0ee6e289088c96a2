/* SPDX-License-Identifier: Apache-2.0
 *
 * One row of a footprint: the weights of its pixels, and where planes cut the kernel on their rays.
 * Every kernel, every compositor; the sheet's own loop over plain Gaussians is a short cut of it.
 */
#ifndef SP_TILE_FOOTPRINT_H
#define SP_TILE_FOOTPRINT_H

#include "base/isa.h"
#include "tile/blend.h"

/* Pixels of a row, from its first on. Weights go on with zeros up to a multiple of SP_WIDE. */
struct sp_row {
    int n;
    float weight[SP_TILE];
    float exponent[SP_TILE];           /* p of sp_splat */
    bool bounded;                      /* low and high are set; otherwise the whole ray counts */
    float low[SP_TILE], high[SP_TILE]; /* bounds of depth, in standard deviations */
};

/* Stands for a bound that there is not. */
#define SP_UNBOUNDED 1e4f

/* Row y (tile px) of the splat's pixels in `box`. `cut` is NULL or its planes: those along the ray
 * are factors of the weights, the others bound the depth. */
void sp_footprint_row(const struct sp_blend *blend, const struct sp_tile *tile,
                      const struct sp_splat *splat, const struct sp_cut *cut,
                      const struct sp_box *box, int y, struct sp_row *row);

/* The same with the bounded share of the ray in the weights. */
void sp_footprint_weights(const struct sp_blend *blend, const struct sp_tile *tile,
                          const struct sp_splat *splat, const struct sp_cut *cut,
                          const struct sp_box *box, int y, struct sp_row *row);

/* Share of the ray's way through the kernel before `depth` [standard deviations from its mean], at
 * a pixel of that exponent. */
float sp_footprint_share(const struct sp_blend *blend, float exponent, float depth);

#endif
