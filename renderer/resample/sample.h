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

static inline sp_wide first_of(sp_wide_int pair) {
    return sp_wide_from_int(pair << 16 >> 16);
}

static inline sp_wide second_of(sp_wide_int pair) {
    return sp_wide_from_int(pair >> 16);
}

static inline sp_wide mix(sp_wide a, sp_wide b, sp_wide part) {
    return a + part * (b - a);
}

static inline sp_wide mix_pair(sp_wide_int pair, sp_wide part) {
    return mix(first_of(pair), second_of(pair), part);
}

/* The values at which rays cross sheet `number`. */
static inline sp_wide sp_sample_values(const struct sp_resample_open_tile *t,
                                       const struct sp_rays *rays, int number) {
    const struct sp_resample_sheet *sheet = &t->scratch->sheets[number % RESAMPLE_SHEETS];
    struct place place;
    find_place(t, sheet, rays, &place);
    sp_wide_int above = sp_fetch_pairs(sheet->refined, place.index);
    sp_wide_int below = sp_fetch_pairs(sheet->refined + sheet->width, place.index);
    return mix(mix_pair(above, place.part[0]), mix_pair(below, place.part[0]), place.part[1]);
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

/* Their gradients along u and v [levels per sample]: differences of values one sample apart, from
 * refined samples 0 to 3 of rows 1 and 2 and samples 1 and 2 of rows 0 and 3. */
static inline void sp_sample_slopes(const struct sp_resample_open_tile *t,
                                    const struct sp_rays *rays, int number, sp_wide slope[2]) {
    const struct sp_resample_sheet *sheet = &t->scratch->sheets[number % RESAMPLE_SHEETS];
    const int16_t *from = sheet->refined;
    const int width = sheet->width;
    struct place place;
    sp_wide_int quad[2];
    sp_wide across[2], value[4];
    find_place(t, sheet, rays, &place);
    const sp_wide u = place.part[0], v = place.part[1];
    value[0] = mix_pair(sp_fetch_pairs(from - width, place.index), u);
    for (int k = 0; k < 2; k++) {
        sp_fetch_quads(from + k * width - 1, place.index, quad);
        across[k] = mix_pair(quad[1], u) - mix_pair(quad[0], u);
        value[k + 1] = mix(second_of(quad[0]), first_of(quad[1]), u);
    }
    value[3] = mix_pair(sp_fetch_pairs(from + 2 * width, place.index), u);
    slope[0] = mix(across[0], across[1], v);
    slope[1] = mix(value[2], value[3], v) - mix(value[0], value[1], v);
    rescale(t, 0, rays->u, rays->du, sheet->s, &slope[0]);
    rescale(t, 1, rays->v, rays->dv, sheet->s, &slope[1]);
}

#endif
