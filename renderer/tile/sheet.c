/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/sheet.h"

#include "base/wide.h"
#include "splat/exp2.h"
#include "tile/footprint.h"

enum { WIDE = 16 }; /* px: rows of wider boxes are narrowed to the ellipse */

/* One row of a footprint: exponent (a·dx + l)·dx + q at pixels dx0, dx0 + 1, …; n is a multiple of
 * SP_WIDE. */
static inline void add_row(const struct sp_splat *s, float cut, float dx0, float l, float q, int n,
                           float *restrict t, float *restrict r, float *restrict g,
                           float *restrict b) {
    float a = s->a, depth = s->depth, e0 = s->emission[0], e1 = s->emission[1], e2 = s->emission[2];
    for (int i = 0; i < (n & -SP_WIDE); i++) {
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
    const sp_wide step = sp_wide_count();
    sp_wide x = dx + step, weight = sp_wide_exp2(-((s->a * x + s->b * dy) * x + s->c * dy * dy));
    sp_wide q = sp_wide_exp2(-(s->b * x + s->c * (2 * dy + 1)));
    weight = sp_wide_keep(sp_wide_first(width), weight);
    float depth = s->depth, e0 = s->emission[0], e1 = s->emission[1], e2 = s->emission[2];
    for (int y = 0; y < rows; y++, sums += SP_TILE_ROW) {
        sp_wide inside = sp_wide_keep(sp_wide_le(sp_wide_all(floor), weight), weight);
        add_to(sums, inside, depth);
        add_to(sums + P, inside, e0);
        add_to(sums + 2 * P, inside, e1);
        add_to(sums + 3 * P, inside, e2);
        weight *= q;
        q *= shrink;
    }
}

/* The recurrence starts at the box's edge: it holds where no corner's weight underflows. */
static bool is_compact(const struct sp_splat *s, const struct sp_box *box, float dx, float dy) {
    float x = fmaxf(fabsf(dx), fabsf(dx + (float)(box->x1 - box->x0 - 1)));
    float y = fmaxf(fabsf(dy), fabsf(dy + (float)(box->y1 - box->y0 - 1)));
    return (s->a * x + fabsf(s->b) * y) * x + s->c * y * y < 100;
}

/* A Gaussian that nothing cuts. */
static inline void add_gaussian(struct sp_tile *tile, const struct sp_splat *s, float cut,
                                const struct sp_box *box) {
    float dx0 = (float)(box->x0 + tile->x) + 0.5f - s->x;
    float dy0 = (float)(box->y0 + tile->y) + 0.5f - s->y;
    if (is_compact(s, box, dx0, dy0)) {
        sp_wide shared = sp_wide_exp2((sp_wide){ -cut, -2 * s->c });
        for (int x = box->x0; x < box->x1; x += SP_WIDE)
            add_columns(s, shared[0], shared[1], dx0 + (float)(x - box->x0), dy0, box->x1 - x,
                        box->y1 - box->y0, &tile->sums[0][box->y0][x]);
        return;
    }
    for (int y = box->y0; y < box->y1; y++) {
        float dy = (float)(y + tile->y) + 0.5f - s->y, l = s->b * dy, q = s->c * dy * dy;
        int x0 = box->x0, x1 = box->x1;
        if (x1 - x0 > WIDE)
            narrow_row(s, cut, dx0, l, q, &x0, &x1);
        int n = (x1 - x0 + SP_WIDE - 1) & -SP_WIDE;
        if (n > 0)
            add_row(s, cut, dx0 + (float)(x0 - box->x0), l, q, n, &tile->sums[0][y][x0],
                    &tile->sums[1][y][x0], &tile->sums[2][y][x0], &tile->sums[3][y][x0]);
    }
}

/* Any kernel, cut or not. */
static void add_general(struct sp_tile *tile, const struct sp_blend *blend,
                        const struct sp_splat *s, const struct sp_cut *cut,
                        const struct sp_box *box) {
    enum { P = SP_TILE * SP_TILE_ROW };
    for (int y = box->y0; y < box->y1; y++) {
        struct sp_row row;
        float *sums = &tile->sums[0][y][box->x0];
        sp_footprint_weights(blend, tile, s, cut, box, y, &row);
        for (int i = 0; i < row.n; i++) {
            sums[i] += row.weight[i] * s->depth;
            sums[P + i] += row.weight[i] * s->emission[0];
            sums[2 * P + i] += row.weight[i] * s->emission[1];
            sums[3 * P + i] += row.weight[i] * s->emission[2];
        }
    }
}

void sp_sheet_add(struct sp_tile *tile, const struct sp_blend *blend,
                  const struct sp_splats *records, uint32_t n) {
    const struct sp_splat *s = &records->splat[n];
    if (tile->sheet != s->sheet) {
        sp_layer_close(tile, blend, 0);
        tile->sheet = s->sheet;
        if (tile->saturated)
            return;
    }
    struct sp_box box = sp_tile_box(tile, s);
    sp_slot_touch(&tile->dirty[0], &box);
    if (blend->cubic || s->cuts)
        add_general(tile, blend, s, records->cut ? &records->cut[n] : NULL, &box);
    else
        add_gaussian(tile, s, blend->cut, &box);
}
