/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/footprints/splat.h"

#include "draw/footprints/footprint.h"
#include "draw/footprints/insert.h"
#include "draw/footprints/tile_depth.h"

enum { CHECK_EVERY = 256 }; /* splats between two checks of a whole tile's transmittance */

/* Adds a splat behind planes of colour; returns what passes both. */
static inline sp_wide add(bool linear, const struct sp_splat *s, sp_wide weight, sp_wide through,
                          float *restrict planes, size_t step) {
    sp_wide pass;
    sp_wide f = sp_wide_attenuate(linear, weight * s->depth, &pass) * weight * through;
    for (size_t c = 0; c < 3; c++) {
        float *colour = planes + (c + 1) * step;
        sp_wide_store(colour, sp_wide_load(colour) + f * s->emission[c]);
    }
    return through * pass;
}

/* Composites a splat onto pixels from (x, y) of the tile on. */
static inline void composite(bool linear, const struct sp_splat *s, sp_wide weight,
                             struct sp_tile *tile, int x, int y) {
    float *done = &tile->done[0][y][x];
    sp_wide through = sp_wide_load(done);
    sp_wide left = add(linear, s, weight, through, done, SP_TILE_AREA);
    sp_wide_store(done, left);
    if (tile->depth)
        sp_moments_add(&tile->depth->moment[0][y][x], &tile->depth->moment[1][y][x], through - left,
                       sp_wide_all(sp_tile_depth_at(tile->depth, s->sheet)));
}

/* Composites the share of a splat before the fragments of its pixels, and adds the rest to what
 * lies behind them. */
static inline void add_divided(struct sp_tile *tile, const struct sp_blend *blend,
                               const struct sp_splats *records, uint32_t n,
                               const struct sp_box *box, int x, int y) {
    const struct sp_splat *s = &records->splat[n];
    const struct sp_span *span = &records->span[n];
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1), tail = sp_wide_all(5);
    float *done = &tile->done[0][y][x], *behind = sp_sums_row(tile, blend, 0, y) + x;
    struct sp_pixels px;
    sp_footprint_pixels(blend, tile, s, records->cut ? &records->cut[n] : NULL, box, x, y, &px);
    sp_wide_mask counts = sp_wide_lt(zero, px.weight) & sp_wide_lt(zero, sp_wide_load(done));
    if (!sp_wide_any(counts))
        return;
    sp_wide mean = span->distance + span->slope[0] * px.dx + span->slope[1] * px.dy;
    sp_wide face = (sp_wide_load(&tile->insert->share[y * SP_TILE + x]) - mean) * span->sharpness;
    sp_wide low = zero, high = one;
    if (s->cuts) {
        low = sp_footprint_share(blend, px.exponent, px.low);
        high = sp_wide_max(sp_footprint_share(blend, px.exponent, px.high), low);
    }
    if (!sp_wide_any(counts & sp_wide_lt(face, tail))) {
        composite(blend->linear, s, px.weight * (high - low), tile, x, y);
        return;
    }
    sp_wide middle = sp_footprint_share(blend, px.exponent, face);
    middle = sp_wide_max(sp_wide_min(middle, high), low);
    composite(blend->linear, s, px.weight * (middle - low), tile, x, y);
    sp_wide through = 1 - sp_wide_load(behind), rest = px.weight * (high - middle);
    sp_wide_store(behind, 1 - add(blend->linear, s, rest, through, behind, SP_TILE));
}

void sp_splat_add(struct sp_tile *tile, const struct sp_blend *blend,
                  const struct sp_splats *records, uint32_t n) {
    const struct sp_splat *s = &records->splat[n];
    struct sp_box box = sp_tile_box(tile, s);
    if (blend->insert)
        sp_insert_before(tile, blend->insert, &box, s->sheet);
    for (int y = box.y0; y < box.y1; y++)
        for (int x = sp_column_first(&box); x < box.x1; x += SP_WIDE) {
            struct sp_pixels px;
            if (blend->insert) {
                add_divided(tile, blend, records, n, &box, x, y);
                continue;
            }
            sp_footprint_weights(blend, tile, s, records->cut ? &records->cut[n] : NULL, &box, x, y,
                                 &px);
            composite(blend->linear, s, px.weight, tile, x, y);
        }
    if (++tile->closed % CHECK_EVERY == 0)
        sp_tile_check(tile);
}
