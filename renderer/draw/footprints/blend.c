/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/footprints/blend.h"

#include <string.h>

#include "draw/footprints/insert.h"
#include "draw/footprints/post.h"
#include "draw/footprints/tile_depth.h"

enum { CHECK_EVERY = 4 }; /* layers between two checks of a whole tile's transmittance */

void sp_tile_init(struct sp_tile *tile, int x, int y, const int size[2],
                  const struct sp_blend *blend) {
    memset(tile->sums, 0, sizeof(float) * SP_TILE_AREA * blend->slots * blend->planes);
    memset(tile->dirty, 0, sizeof *tile->dirty * blend->slots);
    memset(tile->done, 0, sizeof tile->done);
    tile->x = x;
    tile->y = y;
    tile->sheet = SP_NO_SHEET;
    tile->closed = 0;
    tile->saturated = false;
    int width = size[0] - x < SP_TILE ? size[0] - x : SP_TILE;
    int height = size[1] - y < SP_TILE ? size[1] - y : SP_TILE;
    for (int row = 0; row < height; row++)
        for (int i = 0; i < width; i++)
            tile->done[0][row][i] = 1;
    if (blend->places) {
        memset(tile->depth->moment, 0, sizeof tile->depth->moment);
        tile->depth->places = blend->places;
        tile->depth->origin = NAN;
    } else {
        tile->depth = NULL;
    }
    if (blend->insert)
        sp_insert_open(tile, blend->insert);
}

/* Composites columns [begin, end) of a row. May include neighbouring columns, whose sums are zero.
 * moment: of the row's pixels; NULL = none. d: where the layer lies. */
static inline void close_row(bool linear, float *restrict sum, float *restrict done, int begin,
                             int end, float *restrict moment, float d) {
    enum { S = SP_TILE, D = SP_TILE_AREA }; /* distance between planes [floats] */
    for (int x = begin & -SP_WIDE; x < end; x += SP_WIDE) {
        sp_wide pass, through = sp_wide_load(done + x);
        sp_wide f = sp_wide_attenuate(linear, sp_wide_load(sum + x), &pass) * through;
        for (int p = 1; p < SP_PLANES; p++)
            sp_wide_store(done + p * D + x,
                          sp_wide_load(done + p * D + x) + f * sp_wide_load(sum + p * S + x));
        sp_wide_store(done + x, through * pass);
        if (moment)
            sp_moments_add(moment + x, moment + D + x, through - through * pass, sp_wide_all(d));
    }
}

void sp_tile_check(struct sp_tile *tile) {
    float most[SP_TILE] = { 0 };
    for (int y = 0; y < SP_TILE; y++)
        for (int x = 0; x < SP_TILE; x++)
            most[x] = tile->done[0][y][x] > most[x] ? tile->done[0][y][x] : most[x];
    tile->saturated = true;
    for (int x = 0; x < SP_TILE; x++)
        if (!(most[x] < SP_TRANSMITTANCE_MIN))
            tile->saturated = false;
}

void sp_layer_close(struct sp_tile *tile, const struct sp_blend *blend, int64_t layer) {
    uint32_t slot = layer < 0 ? 0 : (uint32_t)((uint64_t)layer % blend->slots);
    struct sp_box *box = &tile->dirty[slot];
    if (box->x1 <= box->x0)
        return;
    const float d = tile->depth ? sp_tile_depth_at(tile->depth, (uint32_t)layer) : 0;
    for (int y = box->y0; y < box->y1; y++) {
        float *moment = tile->depth ? tile->depth->moment[0][y] : NULL;
        float *sum = sp_sums_row(tile, blend, slot, y), *done = tile->done[0][y];
        if (blend->post)
            sp_post_classify(blend->post, tile->x, tile->y + y, sum, box->x0, box->x1);
        if (blend->insert)
            sp_insert_row(tile, blend->insert, (uint32_t)layer, y, box->x0, box->x1, blend->linear,
                          sum);
        if (blend->linear)
            close_row(true, sum, done, box->x0, box->x1, moment, d);
        else
            close_row(false, sum, done, box->x0, box->x1, moment, d);
        memset(sum, 0, sizeof(float) * SP_TILE * blend->planes);
    }
    *box = (struct sp_box){ 0 };
    if (++tile->closed % CHECK_EVERY == 0)
        sp_tile_check(tile);
}

void sp_tile_close(struct sp_tile *tile, const struct sp_blend *blend) {
    for (uint32_t k = 0; k < blend->slots && tile->sheet != SP_NO_SHEET; k++)
        sp_layer_close(tile, blend, tile->sheet + k);
    tile->sheet = SP_NO_SHEET;
    if (blend->insert)
        sp_insert_rest(tile, blend->insert);
}
