/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads a refined sheet at pixels: linear between refined samples, which are half a sample apart. A
 * gradient is the difference of two interpolated values one sample apart, so that gradients change
 * continuously.
 */
#ifndef SP_RESAMPLE_SHEET_SAMPLE_H
#define SP_RESAMPLE_SHEET_SAMPLE_H

#include "base/fetch.h"
#include "draw/resample/kernels.h"

/* SP_WIDE rays. */
struct sp_rays {
    sp_wide u, v, du, dv; /* at s = 0, and per slice [samples] */
};

/* The places on the rays at s: coordinates along the volume's axes. */
static inline void sp_place_on_rays(const struct sp_resample_open_tile *t,
                                    const struct sp_rays *rays, sp_wide s, sp_wide at[3]) {
    at[t->axis[0]] = rays->u + s * rays->du;
    at[t->axis[1]] = rays->v + s * rays->dv;
    at[t->axis[2]] = t->is_backwards ? t->reference - s : t->reference + s;
}

enum { SAMPLE_ONE = 1 << 14 }; /* the sum of two weights */

/* Where SP_WIDE pixels lie on a refined sheet. */
struct place {
    sp_wide_int index;
    sp_wide_int weights; /* of this refined sample and of the next one in its row, as a pair */
    sp_wide down;        /* share of the next row, [0, 1) */
};

/* Returns the coordinates of the rays along axis a, limited to the slice and the sheet [refined
 * samples of the sheet]. */
static inline sp_wide coordinate(const struct sp_resample_open_tile *t, int a, sp_wide at,
                                 sp_wide change, const struct sp_resample_sheet *sheet) {
    sp_wide x = sp_wide_fma(change, sp_wide_all(sheet->s), at);
    for (int i = 0; t->map[a] && i < SP_WIDE; i++)
        x[i] = sp_resample_index(t, a, x[i]);
    x = sp_wide_fma(x, sp_wide_all(2), sp_wide_all(sheet->shift[a]));
    return sp_wide_clamp(x, sheet->first[a], sheet->last[a]);
}

static inline void compute_place(const struct sp_resample_open_tile *t,
                                 const struct sp_resample_sheet *sheet, const struct sp_rays *rays,
                                 struct place *place) {
    sp_wide u = coordinate(t, 0, rays->u, rays->du, sheet);
    sp_wide v = coordinate(t, 1, rays->v, rays->dv, sheet);
    sp_wide column = sp_wide_floor(u), row = sp_wide_floor(v);
    sp_wide_int across = sp_wide_to_int((u - column) * SAMPLE_ONE + 0.5f);
    place->weights = (across << 16) - across + SAMPLE_ONE;
    place->down = v - row;
    place->index = sp_wide_to_int(sp_wide_fma(row, sp_wide_all((float)sheet->width), column));
}

/* Cuts an interval between two sheets to the part of the rays, from pixel i on, that lies inside
 * all half spaces. The interval begins at s = `start` and is `width` long. `value` describes a
 * polynomial of degree 2 by its values at the start, in the middle and at the end of the interval.
 * Returns the share of the interval that is left; front: the share before it. */
static inline sp_wide sp_cut_interval(const struct sp_resample_block *block, int i, float start,
                                      float width, sp_wide value[3], sp_wide *front) {
    const sp_wide one = sp_wide_all(1);
    const float scale = 1 / width;
    sp_wide from = (sp_wide_load(block->begin + i) - start) * scale;
    sp_wide to = (sp_wide_load(block->end + i) - start) * scale;
    from = sp_wide_clamp(from, 0, 1);
    to = sp_wide_max(sp_wide_min(to, one), from);
    *front = from;
    sp_wide first = value[0], change = value[2] - first;
    sp_wide bend = value[1] - (first + 0.5f * change), middle = 0.5f * (from + to);
    value[0] = first + from * change + 4 * from * (1 - from) * bend;
    value[1] = first + middle * change + 4 * middle * (1 - middle) * bend;
    value[2] = first + to * change + 4 * to * (1 - to) * bend;
    return to - from;
}

static inline sp_wide mix(sp_wide a, sp_wide b, sp_wide part) {
    return a + part * (b - a);
}

/* Returns the interpolated value at a place between a pair of samples and the pair below it, times
 * SAMPLE_ONE. */
static inline sp_wide mix_pairs(const struct place *place, sp_wide_int above, sp_wide_int below) {
    sp_wide a = sp_wide_from_int(sp_fetch_dot(above, place->weights));
    sp_wide b = sp_wide_from_int(sp_fetch_dot(below, place->weights));
    return mix(a, b, place->down);
}

/* Returns the values where the rays cross sheet `number`. */
static inline sp_wide sp_sample_values(const struct sp_resample_open_tile *t,
                                       const struct sp_rays *rays, int number) {
    const struct sp_resample_sheet *sheet = &t->scratch->sheets[number % RESAMPLE_SHEETS];
    struct place place;
    compute_place(t, sheet, rays, &place);
    sp_wide_int above = sp_fetch_pairs(sheet->refined, place.index);
    sp_wide_int below = sp_fetch_pairs(sheet->refined + sheet->width, place.index);
    return mix_pairs(&place, above, below) * (1.0f / SAMPLE_ONE);
}

/* Converts gradients along axis a of the tile from "per sample" to "per unit of the coordinate".
 * at: coordinates. */
static inline void sp_rescale_slopes(const struct sp_resample_open_tile *t, int a, sp_wide at,
                                     sp_wide *slope) {
    for (int i = 0; t->map[a] && i < SP_WIDE; i++) {
        int last = t->dims[a] - 1, k = (int)sp_resample_index(t, a, at[i]);
        k = k < last ? k : last - 1;
        if (last > 0)
            (*slope)[i] /= t->map[a]->place[k + 1] - t->map[a]->place[k];
    }
}

/* Returns the values, and fills the gradients along u and v [codes per sample]: differences of
 * values one sample apart. The place lies between the refined samples 1 and 2 of the rows 1 and 2
 * of four. The differences are
 *
 *   across: samples 2, 3 and 0, 1 of a row      down: samples 1, 2 of rows 2 and 0, and 3 and 1
 */
static inline sp_wide sp_sample_slopes(const struct sp_resample_open_tile *t,
                                       const struct sp_rays *rays, int number, sp_wide slope[2]) {
    const struct sp_resample_sheet *sheet = &t->scratch->sheets[number % RESAMPLE_SHEETS];
    const int16_t *from = sheet->refined;
    const int width = sheet->width;
    struct place place;
    sp_wide_int quad[2][2], middle[2], across[2], down[2];
    compute_place(t, sheet, rays, &place);
    for (int k = 0; k < 2; k++) {
        sp_fetch_quads(from + k * width - 1, place.index, quad[k]);
        middle[k] = (sp_wide_int)((sp_wide_bits)quad[k][0] >> 16) | quad[k][1] << 16;
        across[k] = sp_fetch_difference(quad[k][1], quad[k][0]);
    }
    down[0] = sp_fetch_difference(middle[1], sp_fetch_pairs(from - width, place.index));
    down[1] = sp_fetch_difference(sp_fetch_pairs(from + 2 * width, place.index), middle[0]);
    slope[0] = mix_pairs(&place, across[0], across[1]) * (1.0f / SAMPLE_ONE);
    slope[1] = mix_pairs(&place, down[0], down[1]) * (1.0f / SAMPLE_ONE);
    sp_rescale_slopes(t, 0, rays->u + sheet->s * rays->du, &slope[0]);
    sp_rescale_slopes(t, 1, rays->v + sheet->s * rays->dv, &slope[1]);
    return mix_pairs(&place, middle[0], middle[1]) * (1.0f / SAMPLE_ONE);
}

#endif
