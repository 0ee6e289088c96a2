/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads a refined sheet at pixels: linear between refined samples, which are half a sample apart.
 * Gradients are differences of two such values one sample apart, so they change continuously.
 */
#ifndef SP_RESAMPLE_SAMPLE_H
#define SP_RESAMPLE_SAMPLE_H

#include "resample/fetch.h"
#include "resample/kernels.h"

/* SP_WIDE rays. */
struct sp_rays {
    sp_wide u, v, du, dv; /* at s = 0, and per slice [samples] */
};

/* Where SP_WIDE pixels lie on a refined sheet. */
struct place {
    sp_wide_int index;
    sp_wide part[2]; /* towards the next refined sample, [0, 1) */
};

/* The rays' coordinates along axis a, kept inside the slice and the sheet [refined samples of the
 * sheet]. */
static inline sp_wide coordinate(const struct sp_resample_open_tile *t, int a, sp_wide at,
                                 sp_wide change, const struct sp_resample_sheet *sheet) {
    sp_wide x = sp_wide_fma(change, sp_wide_all(sheet->s), at);
    for (int i = 0; t->map[a] && i < SP_WIDE; i++)
        x[i] = sp_resample_index(t, a, x[i]);
    x = sp_wide_fma(x, sp_wide_all(2), sp_wide_all(sheet->shift[a]));
    return sp_wide_min(sp_wide_max(x, sp_wide_all(sheet->first[a])), sp_wide_all(sheet->last[a]));
}

static inline void find_place(const struct sp_resample_open_tile *t,
                              const struct sp_resample_sheet *sheet, const struct sp_rays *rays,
                              struct place *place) {
    sp_wide u = coordinate(t, 0, rays->u, rays->du, sheet);
    sp_wide v = coordinate(t, 1, rays->v, rays->dv, sheet);
    sp_wide column = sp_wide_floor(u), row = sp_wide_floor(v);
    place->part[0] = u - column;
    place->part[1] = v - row;
    place->index = sp_wide_to_int(sp_wide_fma(row, sp_wide_all((float)sheet->width), column));
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

/* The values at which rays cross sheet `number`. */
static inline sp_wide sp_sample_values(const struct sp_resample_open_tile *t,
                                       const struct sp_rays *rays, int number) {
    const struct sp_resample_sheet *sheet = &t->scratch->sheets[number % RESAMPLE_SHEETS];
    struct place place;
    find_place(t, sheet, rays, &place);
    return value_at(sheet->refined, &place, sheet->width, 0);
}

/* Gradients per sample → per unit of the coordinate. */
static inline void rescale(const struct sp_resample_open_tile *t, int a, sp_wide at, sp_wide change,
                           float s, sp_wide *slope) {
    for (int i = 0; t->map[a] && i < SP_WIDE; i++) {
        int last = t->dims[a] - 1, k = (int)sp_resample_index(t, a, at[i] + s * change[i]);
        k = k < last ? k : last - 1;
        if (last > 0)
            (*slope)[i] /= t->map[a]->place[k + 1] - t->map[a]->place[k];
    }
}

/* Their gradients along u and v [levels per sample]. The sheet is one of the last seven. */
static inline void sp_sample_slopes(const struct sp_resample_open_tile *t,
                                    const struct sp_rays *rays, int number, sp_wide slope[2]) {
    const struct sp_resample_sheet *sheet = &t->scratch->sheets[number % RESAMPLE_SHEETS];
    const int width = sheet->width;
    struct place place;
    find_place(t, sheet, rays, &place);
    slope[0] =
        value_at(sheet->refined, &place, width, 1) - value_at(sheet->refined, &place, width, -1);
    slope[1] = value_at(sheet->refined, &place, width, width) -
               value_at(sheet->refined, &place, width, -width);
    rescale(t, 0, rays->u, rays->du, sheet->s, &slope[0]);
    rescale(t, 1, rays->v, rays->dv, sheet->s, &slope[1]);
}

#endif
