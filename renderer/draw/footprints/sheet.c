/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/footprints/sheet.h"

#include "base/wide.h"
#include "draw/footprints/footprint.h"
#include "splat/exp2.h"

enum { P = SP_TILE }; /* distance between planes of a row [floats] */

static inline void add_to(float *sums, sp_wide weight, float factor) {
    sp_wide_store(sums, sp_wide_load(sums) + weight * factor);
}

static inline void add_weights(const struct sp_splat *s, sp_wide weight, float *sums) {
    add_to(sums, weight, s->depth);
    add_to(sums + P, weight, s->emission[0]);
    add_to(sums + 2 * P, weight, s->emission[1]);
    add_to(sums + 3 * P, weight, s->emission[2]);
}

/* Computes aligned columns of a footprint from x on, by a recurrence down the rows: a step in y
 * multiplies the weight by q, and q by `shrink`. Weights below `floor` count as 0. */
static inline void add_columns(const struct sp_splat *s, float floor, float shrink, float dx,
                               float dy, const struct sp_box *box, int x, float *sums) {
    sp_wide at = dx + sp_wide_from_int(sp_wide_int_count() + (x - box->x0));
    sp_wide weight = sp_wide_exp2(-((s->a * at + s->b * dy) * at + s->c * dy * dy));
    sp_wide q = sp_wide_exp2(-(s->b * at + s->c * (2 * dy + 1)));
    weight = sp_wide_keep(sp_columns_inside(box, x), weight);
    float depth = s->depth, e0 = s->emission[0], e1 = s->emission[1], e2 = s->emission[2];
    for (int y = box->y0; y < box->y1; y++, sums += SP_PLANES * P) {
        sp_wide inside = sp_wide_keep(sp_wide_le(sp_wide_all(floor), weight), weight);
        add_to(sums, inside, depth);
        add_to(sums + P, inside, e0);
        add_to(sums + 2 * P, inside, e1);
        add_to(sums + 3 * P, inside, e2);
        weight *= q;
        q *= shrink;
    }
}

/* The recurrence starts at the box's edge. It is exact as long as no corner's weight underflows. */
static bool is_compact(const struct sp_splat *s, const struct sp_box *box, float dx, float dy) {
    float x = fmaxf(fabsf(dx), fabsf(dx + (float)(box->x1 - box->x0 - 1)));
    float y = fmaxf(fabsf(dy), fabsf(dy + (float)(box->y1 - box->y0 - 1)));
    return (s->a * x + fabsf(s->b) * y) * x + s->c * y * y < 100;
}

/* Adds a Gaussian without cuts, if it is compact. */
static inline bool add_compact(struct sp_tile *tile, const struct sp_blend *blend,
                               const struct sp_splat *s, const struct sp_box *box) {
    float dx = (float)(box->x0 + tile->x) + 0.5f - s->x;
    float dy = (float)(box->y0 + tile->y) + 0.5f - s->y;
    if (!is_compact(s, box, dx, dy))
        return false;
    sp_wide shared = sp_wide_exp2((sp_wide){ -blend->cut, -2 * s->c });
    for (int x = sp_column_first(box); x < box->x1; x += SP_WIDE)
        add_columns(s, shared[0], shared[1], dx, dy, box, x,
                    sp_sums_row(tile, blend, 0, box->y0) + x);
    return true;
}

/* Adds any kernel, with or without cuts. */
static void add_general(struct sp_tile *tile, const struct sp_blend *blend,
                        const struct sp_splat *s, const struct sp_cut *cut,
                        const struct sp_box *box) {
    for (int y = box->y0; y < box->y1; y++)
        for (int x = sp_column_first(box); x < box->x1; x += SP_WIDE) {
            struct sp_pixels px;
            sp_footprint_weights(blend, tile, s, cut, box, x, y, &px);
            add_weights(s, px.weight, sp_sums_row(tile, blend, 0, y) + x);
        }
}

void sp_sheet_add(struct sp_tile *tile, const struct sp_blend *blend,
                  const struct sp_splats *records, uint32_t n) {
    const struct sp_splat *s = &records->splat[n];
    if (tile->sheet != s->sheet) {
        sp_layer_close(tile, blend, tile->sheet);
        tile->sheet = s->sheet;
        if (tile->saturated)
            return;
    }
    struct sp_box box = sp_tile_box(tile, s);
    sp_slot_touch(&tile->dirty[0], &box);
    if (blend->cubic || s->cuts || !add_compact(tile, blend, s, &box))
        add_general(tile, blend, s, records->cut ? &records->cut[n] : NULL, &box);
}
