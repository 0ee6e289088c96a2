/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/splat.h"

#include "tile/footprint.h"
#include "tile/insert.h"

enum { CHECK_EVERY = 256 }; /* splats between two checks of a whole tile's transmittance */

static inline void composite(bool linear, const struct sp_splat *s, sp_wide weight,
                             float *restrict done) {
    enum { D = SP_TILE_AREA };
    sp_wide pass, through = sp_wide_load(done);
    sp_wide f = sp_wide_attenuate(linear, weight * s->depth, &pass) * weight * through;
    for (int c = 0; c < 3; c++) {
        float *colour = done + (c + 1) * D;
        sp_wide_store(colour, sp_wide_load(colour) + f * s->emission[c]);
    }
    sp_wide_store(done, through * pass);
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
            sp_footprint_weights(blend, tile, s, records->cut ? &records->cut[n] : NULL, &box, x, y,
                                 &px);
            composite(blend->linear, s, px.weight, &tile->done[0][y][x]);
        }
    if (++tile->closed % CHECK_EVERY == 0)
        sp_tile_check(tile);
}
