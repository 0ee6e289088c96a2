/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/splat.h"

#include "tile/footprint.h"

enum { CHECK_EVERY = 256 }; /* splats between two looks at the transmittance of a whole tile */

static void composite_row(bool linear, const struct sp_splat *s, const struct sp_row *row,
                          float *restrict done) {
    enum { D = SP_TILE * SP_TILE };
    for (int i = 0; i < row->n; i++) {
        float pass, w = row->weight[i], f = sp_attenuate(linear, w * s->depth, &pass) * w * done[i];
        done[D + i] += f * s->emission[0];
        done[2 * D + i] += f * s->emission[1];
        done[3 * D + i] += f * s->emission[2];
        done[i] *= pass;
    }
}

void sp_splat_add(struct sp_tile *tile, const struct sp_blend *blend,
                  const struct sp_splats *records, uint32_t n) {
    const struct sp_splat *s = &records->splat[n];
    struct sp_box box = sp_tile_box(tile, s);
    for (int y = box.y0; y < box.y1; y++) {
        struct sp_row row;
        sp_footprint_weights(blend, tile, s, records->cut ? &records->cut[n] : NULL, &box, y, &row);
        composite_row(blend->linear, s, &row, &tile->done[0][y][box.x0]);
    }
    if (++tile->closed % CHECK_EVERY == 0)
        sp_tile_check(tile);
}
