/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads a refined sheet at pixels: linear between refined samples, which are half a sample apart.
 * Gradients are differences of two such values one sample apart, so they change continuously.
 */
#include "resample/fetch.h"
#include "resample/kernels.h"

/* Where SP_WIDE pixels lie on a refined sheet. */
struct place {
    int32_t index[SP_WIDE];
    sp_wide part[2]; /* towards the next refined sample, [0, 1) */
};

/* The block's coordinates along axis a, kept inside the slice and the sheet [refined samples of the
 * sheet]. */
static inline sp_wide coordinate(const struct sp_resample_open_tile *t, int a, const float *at,
                                 const float *change, const struct sp_resample_sheet *sheet) {
    float shift = -2.0f * (float)sheet->origin[a], border = shift + 2.0f * (float)(t->dims[a] - 1);
    const sp_wide first = sp_wide_all(shift > 0 ? shift : 0);
    /* The last column has a next one, so places up to the next one are inside the sheet. */
    float inside = (float)sheet->last[a] + 0.998f;
    const sp_wide last = sp_wide_all(border < inside ? border : inside);
    sp_wide x = sp_wide_fma(sp_wide_load(change), sp_wide_all(sheet->s), sp_wide_load(at));
    for (int i = 0; t->map[a] && i < SP_WIDE; i++)
        x[i] = sp_resample_index(t, a, x[i]);
    return sp_wide_min(sp_wide_max(2.0f * x + shift, first), last);
}

static inline void find_place(const struct sp_resample_open_tile *t,
                              const struct sp_resample_block *block,
                              const struct sp_resample_sheet *sheet, int begin,
                              struct place *place) {
    sp_wide u = coordinate(t, 0, block->u + begin, block->du + begin, sheet);
    sp_wide v = coordinate(t, 1, block->v + begin, block->dv + begin, sheet);
    sp_wide_int column = sp_wide_to_int(u), row = sp_wide_to_int(v);
    place->part[0] = u - sp_wide_from_int(column);
    place->part[1] = v - sp_wide_from_int(row);
    sp_wide_int_store(place->index, row * sheet->width + column);
}

/* The value at the place, moved by `offset` refined samples. */
static inline sp_wide value_at(const int16_t *refined, const struct place *place, int width,
                               int offset) {
    sp_wide_int above = sp_fetch_pairs(refined + offset, place->index);
    sp_wide_int below = sp_fetch_pairs(refined + offset + width, place->index);
    sp_wide left = sp_wide_from_int(above << 16 >> 16), right = sp_wide_from_int(above >> 16);
    sp_wide top = left + place->part[0] * (right - left);
    left = sp_wide_from_int(below << 16 >> 16);
    right = sp_wide_from_int(below >> 16);
    return top + place->part[1] * (left + place->part[0] * (right - left) - top);
}

void sp_resample_sample(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                        int number) {
    const struct sp_resample_sheet *sheet = &t->scratch->sheets[number % RESAMPLE_SHEETS];
    float *value = block->value[number & 3];
    struct place place;
    block->has_slope[number & 3] = 0;
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        find_place(t, block, sheet, i, &place);
        sp_wide_store(value + i, value_at(sheet->refined, &place, sheet->width, 0));
    }
    t->scratch->sampled += RESAMPLE_PIXELS;
}

/* Gradients per sample → per unit of the coordinate. */
static inline void rescale(const struct sp_resample_open_tile *t, int a, const float *at,
                           const float *change, float s, float *slope) {
    for (int i = 0; t->map[a] && i < SP_WIDE; i++) {
        int last = t->dims[a] - 1, k = (int)sp_resample_index(t, a, at[i] + s * change[i]);
        k = k < last ? k : last - 1;
        if (last > 0)
            slope[i] /= t->map[a]->place[k + 1] - t->map[a]->place[k];
    }
}

void sp_resample_find_slope(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                            int number, int begin) {
    const struct sp_resample_sheet *sheet = &t->scratch->sheets[number % RESAMPLE_SHEETS];
    float(*slope)[RESAMPLE_PIXELS] = block->slope[number & 3];
    uint64_t bit = UINT64_C(1) << begin;
    struct place place;
    if (block->has_slope[number & 3] & bit)
        return;
    block->has_slope[number & 3] |= bit;
    find_place(t, block, sheet, begin, &place);
    sp_wide_store(slope[0] + begin, value_at(sheet->refined, &place, sheet->width, 1) -
                                        value_at(sheet->refined, &place, sheet->width, -1));
    sp_wide_store(slope[1] + begin,
                  value_at(sheet->refined, &place, sheet->width, sheet->width) -
                      value_at(sheet->refined, &place, sheet->width, -sheet->width));
    rescale(t, 0, block->u + begin, block->du + begin, sheet->s, slope[0] + begin);
    rescale(t, 1, block->v + begin, block->dv + begin, sheet->s, slope[1] + begin);
}
