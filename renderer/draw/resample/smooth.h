/* SPDX-License-Identifier: Apache-2.0
 *
 * The smooth gradient of the samples: per axis, half the difference of the samples before and
 * behind, and the mean (1, 2, 1)/4 along both other axes (Sobel's operator in three dimensions),
 * interpolated linearly between samples. So the 4 × 4 × 4 samples around a place give it. Along
 * each axis, at the share f between the two in the middle, their weights are
 *
 *   mean         (1 − f,  2 − f,  1 + f,  f)/4
 *   difference   (f − 1,     −f,  1 − f,  f)/2
 *
 * It depends on the place alone: not on the ray, nor on the axis of the slices.
 */
#ifndef SP_RESAMPLE_SMOOTH_H
#define SP_RESAMPLE_SMOOTH_H

#include <string.h>

#include "base/fetch.h"
#include "base/minmax.h"
#include "data/volume/sample.h"
#include "draw/resample/sheet_sample.h"

enum {
    SMOOTH_SIDE = RESAMPLE_SMOOTH,
    SMOOTH_ROWS = SMOOTH_SIDE * SMOOTH_SIDE,
    SMOOTH_ONE = 1 << 14 /* sum of the weights of a mean */
};

/* Where the samples around a place lie in memory [bytes]. */
struct sp_smooth_cube {
    const char *first;
    size_t row, slice; /* from row to row, from slice to slice */
};

/* The places of SP_WIDE rays. */
struct sp_smooth_places {
    uint32_t first[3][SP_WIDE]; /* of the samples around, per axis */
    sp_wide part[3];            /* f */
    uint32_t lanes;             /* bits of the lanes that need a gradient */
};

/* The samples as pairs of 16 bits, or four of 8 bits: [row][half][lane]. */
typedef int32_t sp_smooth_words[SMOOTH_ROWS][2][SP_WIDE];

/* at: along the volume's axes [samples]. Near the volume's faces, places move inwards by up to a
 * sample. */
static inline void sp_smooth_place(const struct sp_samples *s, const sp_wide at[3],
                                   struct sp_smooth_places *places) {
    for (int a = 0; a < 3; a++) {
        sp_wide x = sp_wide_clamp(at[a], 1, (float)s->dims[a] - 2.001f);
        sp_wide whole = sp_wide_floor(x);
        int32_t first[SP_WIDE];
        places->part[a] = x - whole;
        sp_wide_int_store(first, sp_wide_to_int(whole) - 1);
        memcpy(places->first[a], first, sizeof first);
    }
}

/* Returns where the samples around a place lie; `copy` takes them if they lie in several blocks. */
static inline struct sp_smooth_cube
sp_smooth_open(const struct sp_samples *s, const uint32_t first[3], size_t size, char *copy) {
    const uint32_t mask = SP_BLOCK_SIDE - 1, side = SMOOTH_SIDE;
    if (!s->blocks) {
        const size_t at = ((size_t)first[2] * s->dims[1] + first[1]) * s->dims[0] + first[0];
        return (struct sp_smooth_cube){ (const char *)s->voxels + at * size, s->dims[0] * size,
                                        (size_t)s->dims[0] * s->dims[1] * size };
    }
    const uint32_t in[3] = { first[0] & mask, first[1] & mask, first[2] & mask };
    const struct sp_block *block = sp_blocks_at(s->blocks, first);
    if (block->samples && !block->is_constant &&
        sp_maxu(sp_maxu(in[0], in[1]), in[2]) + side <= SP_BLOCK_SIDE) {
        const size_t at = (((size_t)in[2] * SP_BLOCK_SIDE) + in[1]) * SP_BLOCK_SIDE + in[0];
        return (struct sp_smooth_cube){ (const char *)block->samples + at * size,
                                        SP_BLOCK_SIDE * size,
                                        (size_t)SP_BLOCK_SIDE * SP_BLOCK_SIDE * size };
    }
    for (uint32_t row = 0; row < SMOOTH_ROWS; row++) {
        const uint32_t at[3] = { first[0], first[1] + row % side, first[2] + row / side };
        sp_blocks_read(s->blocks, 0, at, side, copy + row * side * size);
    }
    return (struct sp_smooth_cube){ copy, side * size, SMOOTH_ROWS * size };
}

/* Reads the samples of a lane as they are. */
static inline void sp_smooth_read(const struct sp_smooth_cube *cube, int words, int lane,
                                  sp_smooth_words to) {
    for (int k = 0; k < SMOOTH_SIDE; k++)
        for (int j = 0; j < SMOOTH_SIDE; j++)
            for (int w = 0; w < words; w++)
                memcpy(&to[SMOOTH_SIDE * k + j][w][lane],
                       cube->first + (size_t)k * cube->slice + (size_t)j * cube->row + 4 * w, 4);
}

/* The same of samples that become codes above CURVE_CODE_MIN. False if one is not finite. */
static inline bool sp_smooth_convert(const struct sp_smooth_cube *cube,
                                     const struct sp_curve *curve, enum sp_type type, int lane,
                                     sp_smooth_words to) {
    bool is_data = true;
    for (unsigned i = 0; i < SMOOTH_ROWS * SMOOTH_SIDE; i++) {
        unsigned row = i / SMOOTH_SIDE, p = i % SMOOTH_SIDE;
        double x = sp_sample(
            cube->first + row / SMOOTH_SIDE * cube->slice + row % SMOOTH_SIDE * cube->row, type, p);
        is_data = is_data && x >= curve->data[0] && x <= curve->data[1];
        double code = is_data ? (x - curve->base) * curve->codes_per_unit : 0;
        uint32_t whole = (uint32_t)fmin(fmax(code + 0.5, 0), CURVE_CODE_MAX - CURVE_CODE_MIN);
        uint32_t *word = (uint32_t *)&to[row][p / 2][lane];
        *word = p % 2 ? *word | whole << 16 : whole;
    }
    return is_data;
}

/* Weights of the two samples of each half of a row [1/SMOOTH_ONE]. is_split: samples 0 and 2, 1
 * and 3; otherwise 0 and 1, 2 and 3. */
static inline void sp_smooth_weigh(sp_wide f, bool is_split, sp_wide_int mean[2],
                                   sp_wide_int change[2]) {
    sp_wide_int q = sp_wide_to_int(f * (SMOOTH_ONE / 4) + 0.5f), one = q * 0 + SMOOTH_ONE / 4;
    const sp_wide_int means[4] = { one - q, 2 * one - q, one + q, q };
    const sp_wide_int changes[4] = { 2 * (q - one), -2 * q, 2 * (one - q), 2 * q };
    for (int h = 0; h < 2; h++) {
        const int low = is_split ? h : 2 * h, high = is_split ? h + 2 : 2 * h + 1;
        mean[h] = means[high] << 16 | means[low];
        change[h] = changes[high] << 16 | (changes[low] & 0xffff);
    }
}

/* Limits pairs of unsigned numbers. */
static inline sp_wide_int sp_smooth_limit(sp_wide_int x, const struct sp_rows_scaling *s) {
    return (sp_wide_int)sp_wide_short_max(
        sp_wide_short_min((sp_wide_short)x, sp_wide_short_all(s->high)), sp_wide_short_all(s->low));
}

/* Returns the two halves of a row as pairs of signed numbers in the range of the codes. */
static inline void sp_smooth_pair(const struct sp_rows *reader, const int32_t words[2][SP_WIDE],
                                  sp_wide_int half[2]) {
    const bool has_sign = reader->type == SP_INT8 || reader->type == SP_INT16;
    const bool is_limited =
        reader->scaling.low > 0 || reader->scaling.high < (reader->size == 1 ? 255 : 65535);
    const int top = (int)0x80008000u;
    sp_wide_int x = sp_wide_int_load(words[0]);
    if (reader->size == 1) {
        x = has_sign ? x ^ (int)0x80808080u : x;
        half[0] = x & 0xff00ff;
        half[1] = x >> 8 & 0xff00ff;
        for (int h = 0; is_limited && h < 2; h++)
            half[h] = sp_smooth_limit(half[h], &reader->scaling);
        return;
    }
    for (int h = 0; h < 2; h++) {
        x = sp_wide_int_load(words[h]);
        if (reader->size == 2)
            x = (is_limited ? sp_smooth_limit(has_sign ? x ^ top : x, &reader->scaling)
                 : has_sign ? x ^ top
                            : x) ^
                top;
        half[h] = x;
    }
}

/* Fills the words of the lanes; returns the lanes whose samples are all finite. */
static inline sp_wide_mask sp_smooth_fill(const struct sp_samples *s, const struct sp_curve *curve,
                                          const struct sp_smooth_places *places,
                                          sp_smooth_words words) {
    const size_t size = sp_type_size(s->type);
    float known[SP_WIDE] = { 0 };
    for (int row = 0; row < SMOOTH_ROWS; row++)
        for (int h = 0; h < (size == 1 ? 1 : 2); h++)
            sp_wide_int_store(words[row][h], (sp_wide_int){ 0 });
    for (uint32_t left = places->lanes; left; left &= left - 1) {
        char copy[SMOOTH_ROWS * SMOOTH_SIDE * sizeof(double)];
        const int i = __builtin_ctz(left);
        const uint32_t first[3] = { places->first[0][i], places->first[1][i], places->first[2][i] };
        struct sp_smooth_cube cube = sp_smooth_open(s, first, size, copy);
        known[i] = 1;
        if (size == 1)
            sp_smooth_read(&cube, 1, i, words);
        else if (size == 2)
            sp_smooth_read(&cube, 2, i, words);
        else
            known[i] = sp_smooth_convert(&cube, curve, s->type, i, words) ? 1 : 0;
    }
    return sp_wide_lt(sp_wide_all(0), sp_wide_load(known));
}

/* Computes the smooth gradient at the places [codes per sample]; returns the lanes that have one.
 */
static inline sp_wide_mask sp_smooth_slopes(const struct sp_resample *r,
                                            const struct sp_rows *reader,
                                            const struct sp_smooth_places *places,
                                            sp_wide gradient[3]) {
    const sp_wide zero = sp_wide_all(0);
    _Alignas(64) sp_smooth_words words;
    sp_wide_int mean[2], change[2];
    sp_wide_mask is_known = sp_smooth_fill(r->samples, &r->curve, places, words);
    sp_smooth_weigh(places->part[0], reader->size == 1, mean, change);
    const sp_wide f = places->part[1], g = places->part[2];
    const sp_wide down[4] = { 1 - f, 2 - f, 1 + f, f }, fall[4] = { f - 1, -f, 1 - f, f };
    const sp_wide deep[4] = { 1 - g, 2 - g, 1 + g, g }, sink[4] = { g - 1, -g, 1 - g, g };
    for (int a = 0; a < 3; a++)
        gradient[a] = zero;
    for (int k = 0; k < SMOOTH_SIDE; k++) {
        sp_wide across = zero, along = zero, level = zero; /* of a slice */
        for (int j = 0; j < SMOOTH_SIDE; j++) {
            sp_wide_int half[2];
            sp_smooth_pair(reader, (const int32_t(*)[SP_WIDE])words[SMOOTH_SIDE * k + j], half);
            sp_wide smooth =
                sp_wide_from_int(sp_fetch_dot(half[0], mean[0]) + sp_fetch_dot(half[1], mean[1]));
            sp_wide rise = sp_wide_from_int(sp_fetch_dot(half[0], change[0]) +
                                            sp_fetch_dot(half[1], change[1]));
            across += down[j] * rise;
            along += fall[j] * smooth;
            level += down[j] * smooth;
        }
        gradient[0] += deep[k] * across;
        gradient[1] += deep[k] * along;
        gradient[2] += sink[k] * level;
    }
    const float unit = reader->size <= 2 ? (float)r->curve.codes_per_unit : 1;
    const float scale[3] = { unit / 16 / SMOOTH_ONE, unit / 8 / SMOOTH_ONE, unit / 8 / SMOOTH_ONE };
    for (int a = 0; a < 3; a++)
        gradient[a] *= scale[a];
    return is_known;
}

/* Computes the smooth gradient in world space where rays are at s [gradient_unit], in the lanes of
 * a mask. Returns the lanes that have one: there is none beside samples that are not finite. Each
 * axis has at least RESAMPLE_SMOOTH samples. */
static inline sp_wide_mask sp_smooth_gradient(const struct sp_resample_open_tile *t,
                                              const struct sp_rays *rays, sp_wide s,
                                              sp_wide_mask lanes, sp_wide gradient[3]) {
    struct sp_smooth_places places = { .lanes = sp_wide_mask_bits(lanes) };
    sp_wide at[3], index[3], slope[3];
    sp_place_on_rays(t, rays, s, at);
    for (int a = 0; a < 3; a++) {
        index[t->axis[a]] = at[t->axis[a]];
        for (int i = 0; t->map[a] && i < SP_WIDE; i++)
            index[t->axis[a]][i] = sp_resample_index(t, a, at[t->axis[a]][i]);
    }
    sp_smooth_place(t->r->samples, index, &places);
    lanes = sp_smooth_slopes(t->r, &t->reader, &places, slope);
    for (int a = 0; a < 3; a++)
        sp_rescale_slopes(t, a, at[t->axis[a]], &slope[t->axis[a]]);
    for (int w = 0; w < 3; w++) {
        const float *to = t->r->to_world[w];
        gradient[w] = to[0] * slope[0] + to[1] * slope[1] + to[2] * slope[2];
    }
    return lanes;
}

#endif
