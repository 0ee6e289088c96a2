/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/blend.h"

#include <string.h>

#include "splat/exp2.h"
#include "tile/post.h"

enum { CHECK_EVERY = 4 }; /* layers between two looks at the transmittance of a whole tile */

void sp_tile_init(struct sp_tile *tile, int x, int y, const int size[2],
                  const struct sp_blend *blend) {
    memset(tile->sums, 0, sizeof *tile->sums * blend->slots * blend->planes);
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
}

static inline float attenuate(float t, float *transmittance) {
    float e = sp_exp2(-SP_LOG2E * t);
    float exact = (1 - e) / (t > 1e-20f ? t : 1e-20f);
    float series = 1 - t * (0.5f - t * (1.0f / 6));
    *transmittance = t < 0.01f ? 1 - t * series : e;
    return t < 0.01f ? series : exact;
}

static inline float attenuate_linear(float t, float *transmittance) {
    *transmittance = t < 1 ? 1 - t : 0;
    return t > 1 ? 1 / t : 1;
}

float sp_attenuate(bool linear, float t, float *transmittance) {
    return linear ? attenuate_linear(t, transmittance) : attenuate(t, transmittance);
}

enum { S = SP_TILE * SP_TILE_ROW, D = SP_TILE * SP_TILE }; /* floats from plane to plane */

static inline void close_row(bool linear, float *restrict sum, float *restrict done, int n) {
    for (int i = 0; i < n; i++) {
        float pass;
        float f = (linear ? attenuate_linear : attenuate)(sum[i], &pass) * done[i];
        done[D + i] += f * sum[S + i];
        done[2 * D + i] += f * sum[2 * S + i];
        done[3 * D + i] += f * sum[3 * S + i];
        done[i] *= pass;
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

void sp_layer_close(struct sp_tile *tile, const struct sp_blend *blend, uint32_t slot) {
    struct sp_box *box = &tile->dirty[slot];
    sp_plane *sums = tile->sums + (size_t)slot * blend->planes;
    int x0 = box->x0, n = box->x1 - x0;
    if (n <= 0)
        return;
    for (int y = box->y0; y < box->y1; y++) {
        float *sum = &sums[0][y][x0], *done = &tile->done[0][y][x0];
        if (blend->post)
            sp_post_classify(blend->post, tile->x + x0, tile->y + y, sum, n);
        if (blend->linear)
            close_row(true, sum, done, n);
        else
            close_row(false, sum, done, n);
        /* Over the right edge too: rows of footprints were rounded up. */
        for (uint32_t p = 0; p < blend->planes; p++)
            memset(&sums[p][y][x0], 0, (size_t)(n + SP_TILE_STEP) * sizeof(float));
    }
    *box = (struct sp_box){ 0 };
    if (++tile->closed % CHECK_EVERY == 0)
        sp_tile_check(tile);
}

void sp_tile_close(struct sp_tile *tile, const struct sp_blend *blend) {
    if (tile->sheet == SP_NO_SHEET)
        return;
    for (uint32_t k = 0; k < blend->slots; k++)
        sp_layer_close(tile, blend, (uint32_t)((uint64_t)(tile->sheet + k) % blend->slots));
    tile->sheet = SP_NO_SHEET;
}
