/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/sheet.h"

#include <string.h>

#include "base/wide.h"
#include "splat/exp2.h"

enum {
    WIDE = 16,       /* px: rows of wider boxes are narrowed to the ellipse */
    CHECK_EVERY = 4, /* sheets between two looks at the transmittance of a whole tile */
};

void sp_tile_init(struct sp_tile *tile, int x, int y, const int size[2]) {
    memset(tile->sums, 0, sizeof tile->sums);
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

static inline int smaller(int a, int b) {
    return a < b ? a : b;
}

static inline int larger(int a, int b) {
    return a > b ? a : b;
}

/* Opens the splat's sheet if another one is open, and grows the dirty box by `box`. */
static void open_sheet(struct sp_tile *tile, uint32_t sheet, const int box[4]) {
    if (tile->sheet != sheet) {
        sp_sheet_close(tile);
        tile->sheet = sheet;
        memcpy(tile->dirty, box, sizeof tile->dirty);
        return;
    }
    for (int i = 0; i < 2; i++) {
        tile->dirty[i] = smaller(tile->dirty[i], box[i]);
        tile->dirty[2 + i] = larger(tile->dirty[2 + i], box[2 + i]);
    }
}

/* One row of a footprint: exponent (a·dx + l)·dx + q at pixels dx0, dx0 + 1, …; n is a multiple of
 * SP_TILE_STEP. */
static inline void add_row(const struct sp_splat *s, float cut, float dx0, float l, float q, int n,
                           float *restrict t, float *restrict r, float *restrict g,
                           float *restrict b) {
    float a = s->a, depth = s->depth, e0 = s->emission[0], e1 = s->emission[1], e2 = s->emission[2];
    for (int i = 0; i < (n & -SP_TILE_STEP); i++) {
        float dx = dx0 + (float)i, p = (a * dx + l) * dx + q;
        float w = sp_exp2(-p);
        w = p <= cut ? w : 0.0f;
        t[i] += w * depth;
        r[i] += w * e0;
        g[i] += w * e1;
        b[i] += w * e2;
    }
}

/* The pixels of a row of [x0, x1) where the exponent is at most the cut, and a little more. */
static inline void narrow_row(const struct sp_splat *s, float cut, float dx0, float l, float q,
                              int *x0, int *x1) {
    float d = l * l - 4 * s->a * (q - cut);
    if (!(d > 0)) {
        *x1 = *x0;
        return;
    }
    float half = 0.5f / s->a, root = sqrtf(d);
    float first = (-l - root) * half - dx0, last = (-l + root) * half - dx0;
    float width = (float)(*x1 - *x0);
    int begin = first > 1 ? (int)(first < width ? first : width) : 0;
    int end = last < width - 2 ? (last > -1 ? (int)last + 2 : 0) : *x1 - *x0;
    *x1 = *x0 + end;
    *x0 += begin;
}

static inline void add_to(float *sums, sp_wide weight, float factor) {
    sp_wide_store(sums, sp_wide_load(sums) + weight * factor);
}

/* SP_WIDE columns of a footprint, from (dx, dy) on, by recurrence down the rows: a step in y
 * multiplies the weight by q, and q by `shrink`. The first `width` columns count, and weights of at
 * least `floor`. */
static inline void add_columns(const struct sp_splat *s, float floor, float shrink, float dx,
                               float dy, int width, int rows, float *sums) {
    enum { P = SP_TILE * SP_TILE_ROW };
    const sp_wide step = { 0, 1, 2, 3 };
    sp_wide x = dx + step, weight = sp_wide_exp2(-((s->a * x + s->b * dy) * x + s->c * dy * dy));
    sp_wide q = sp_wide_exp2(-(s->b * x + s->c * (2 * dy + 1)));
    weight = sp_wide_keep(step < (float)width, weight);
    float depth = s->depth, e0 = s->emission[0], e1 = s->emission[1], e2 = s->emission[2];
    for (int y = 0; y < rows; y++, sums += SP_TILE_ROW) {
        sp_wide inside = sp_wide_keep(weight >= floor, weight);
        add_to(sums, inside, depth);
        add_to(sums + P, inside, e0);
        add_to(sums + 2 * P, inside, e1);
        add_to(sums + 3 * P, inside, e2);
        weight *= q;
        q *= shrink;
    }
}

/* The recurrence starts at the box's edge: it holds where no corner's weight underflows. */
static bool is_compact(const struct sp_splat *s, const int box[4], float dx, float dy) {
    float x = fmaxf(fabsf(dx), fabsf(dx + (float)(box[2] - box[0] - 1)));
    float y = fmaxf(fabsf(dy), fabsf(dy + (float)(box[3] - box[1] - 1)));
    return (s->a * x + fabsf(s->b) * y) * x + s->c * y * y < 100;
}

void sp_sheet_add(struct sp_tile *tile, const struct sp_splat *s, float cut) {
    int box[4] = { larger(s->x0 - tile->x, 0), larger(s->y0 - tile->y, 0),
                   smaller(s->x1 - tile->x, SP_TILE), smaller(s->y1 - tile->y, SP_TILE) };
    open_sheet(tile, s->sheet, box);
    float dx0 = (float)(box[0] + tile->x) + 0.5f - s->x;
    float dy0 = (float)(box[1] + tile->y) + 0.5f - s->y;
    if (is_compact(s, box, dx0, dy0)) {
        sp_wide shared = sp_wide_exp2((sp_wide){ -cut, -2 * s->c });
        for (int x = box[0]; x < box[2]; x += SP_WIDE)
            add_columns(s, shared[0], shared[1], dx0 + (float)(x - box[0]), dy0, box[2] - x,
                        box[3] - box[1], &tile->sums[0][box[1]][x]);
        return;
    }
    for (int y = box[1]; y < box[3]; y++) {
        float dy = (float)(y + tile->y) + 0.5f - s->y, l = s->b * dy, q = s->c * dy * dy;
        int x0 = box[0], x1 = box[2];
        if (x1 - x0 > WIDE)
            narrow_row(s, cut, dx0, l, q, &x0, &x1);
        int n = (x1 - x0 + SP_TILE_STEP - 1) & -SP_TILE_STEP;
        if (n > 0)
            add_row(s, cut, dx0 + (float)(x0 - box[0]), l, q, n, &tile->sums[0][y][x0],
                    &tile->sums[1][y][x0], &tile->sums[2][y][x0], &tile->sums[3][y][x0]);
    }
}

/* (1 − e^{−T})/T, which E is multiplied by, and e^{−T}. */
static inline float attenuate(float t, float *transmittance) {
    float e = sp_exp2(-SP_LOG2E * t);
    float exact = (1 - e) / (t > 1e-20f ? t : 1e-20f);
    float series = 1 - t * (0.5f - t * (1.0f / 6));
    *transmittance = t < 0.01f ? 1 - t * series : e;
    return t < 0.01f ? series : exact;
}

static inline void close_row(float *restrict sum, float *restrict done, int n) {
    enum { S = SP_TILE * SP_TILE_ROW, D = SP_TILE * SP_TILE };
    for (int i = 0; i < n; i++) {
        float pass, f = attenuate(sum[i], &pass) * done[i];
        done[D + i] += f * sum[S + i];
        done[2 * D + i] += f * sum[2 * S + i];
        done[3 * D + i] += f * sum[3 * S + i];
        done[i] *= pass;
    }
}

static bool is_saturated(const struct sp_tile *tile) {
    float most[SP_TILE] = { 0 };
    for (int y = 0; y < SP_TILE; y++)
        for (int x = 0; x < SP_TILE; x++)
            most[x] = tile->done[0][y][x] > most[x] ? tile->done[0][y][x] : most[x];
    for (int x = 0; x < SP_TILE; x++)
        if (!(most[x] < SP_TRANSMITTANCE_MIN))
            return false;
    return true;
}

void sp_sheet_close(struct sp_tile *tile) {
    if (tile->sheet == SP_NO_SHEET)
        return;
    int x0 = tile->dirty[0], n = tile->dirty[2] - x0;
    for (int y = tile->dirty[1]; y < tile->dirty[3]; y++) {
        close_row(&tile->sums[0][y][x0], &tile->done[0][y][x0], n);
        /* Over the right edge too: rows of footprints were rounded up. */
        for (int p = 0; p < SP_PLANES; p++)
            memset(&tile->sums[p][y][x0], 0, (size_t)(n + SP_TILE_STEP) * sizeof(float));
    }
    tile->sheet = SP_NO_SHEET;
    if (++tile->closed % CHECK_EVERY == 0)
        tile->saturated = is_saturated(tile);
}
