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
 * It depends on the place alone: not on the ray, nor on the axis of the slices. As elsewhere in
 * this stage, samples without data count as the lowest code.
 *
 * Drafts also take the fine gradient from these samples (quads.h): per axis, the difference of the
 * polynomial of degree 3 through the four samples from f − ½ to f + ½, and its value along both
 * other axes.
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

/* The samples of a row in words: one of four samples of 8 bits, two of two samples of 16 bits, or
 * four with the bits of a float each: [row][word][lane]. */
typedef int32_t sp_smooth_words[SMOOTH_ROWS][SMOOTH_SIDE][SP_WIDE];

/* Weights of the samples of a row [1/SMOOTH_ONE]: as numbers, and in pairs for integers. */
struct sp_smooth_weights {
    sp_wide mean[SMOOTH_SIDE], change[SMOOTH_SIDE];
    sp_wide_int mean_pair[2], change_pair[2];
};

/* Weights along one of the other axes. */
struct sp_smooth_across {
    sp_wide mean[SMOOTH_SIDE], change[SMOOTH_SIDE];
};

/* All weights of a gradient, and the factors of its components. */
struct sp_smooth_kernel {
    struct sp_smooth_weights row;
    struct sp_smooth_across down, deep;
    float scale[3];
};

/* at: along the volume's axes [samples]. Near the volume's faces, places move inwards by up to a
 * sample. */
static inline void sp_smooth_place(const struct sp_samples *s, const sp_wide at[3],
                                   struct sp_smooth_places *places) {
    for (int a = 0; a < 3; a++) {
        const int last = (int)s->dims[a] - SMOOTH_SIDE; /* the largest first one */
        sp_wide x = sp_wide_clamp(at[a], 1, (float)(last + 2));
        sp_wide whole = sp_wide_min(sp_wide_floor(x), sp_wide_all((float)(last + 1)));
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

/* Samples around places, and the lanes whose places lie among them. With samples wider than pixels
 * several rays share them. */
struct sp_smooth_groups {
    int count;
    struct sp_smooth_cube cubes[SP_WIDE];
    sp_wide_mask lanes[SP_WIDE];
    _Alignas(8) char copies[SP_WIDE][SMOOTH_ROWS * SMOOTH_SIDE * sizeof(uint32_t)];
};

/* size: of a sample, at most 4 bytes. */
static inline void sp_smooth_group(const struct sp_samples *s,
                                   const struct sp_smooth_places *places, size_t size,
                                   struct sp_smooth_groups *groups) {
    sp_wide_int all[3];
    memcpy(all, places->first, sizeof all);
    groups->count = 0;
    for (uint32_t left = places->lanes; left;) {
        const int i = __builtin_ctz(left), n = groups->count++;
        const uint32_t first[3] = { places->first[0][i], places->first[1][i], places->first[2][i] };
        groups->lanes[n] = sp_wide_int_eq(all[0], sp_wide_int_all((int32_t)first[0])) &
                           sp_wide_int_eq(all[1], sp_wide_int_all((int32_t)first[1])) &
                           sp_wide_int_eq(all[2], sp_wide_int_all((int32_t)first[2]));
        groups->cubes[n] = sp_smooth_open(s, first, size, groups->copies[n]);
        left &= ~sp_wide_mask_bits(groups->lanes[n]);
    }
}

/* Reads word w of each row as it is. */
static inline void sp_smooth_read(const struct sp_smooth_groups *groups, int w,
                                  sp_smooth_words to) {
    sp_wide_int rows[SMOOTH_ROWS];
    for (int row = 0; row < SMOOTH_ROWS; row++)
        rows[row] = (sp_wide_int){ 0 };
    for (int n = 0; n < groups->count; n++) {
        const struct sp_smooth_cube *cube = &groups->cubes[n];
        for (int row = 0; row < SMOOTH_ROWS; row++) {
            int32_t word;
            memcpy(&word,
                   cube->first + (size_t)(row / SMOOTH_SIDE) * cube->slice +
                       (size_t)(row % SMOOTH_SIDE) * cube->row + 4 * w,
                   sizeof word);
            rows[row] = sp_wide_int_select_all(groups->lanes[n], word, rows[row]);
        }
    }
    for (int row = 0; row < SMOOTH_ROWS; row++)
        sp_wide_int_store(to[row][w], rows[row]);
}

/* The same of samples that become codes above CURVE_CODE_MIN. */
static inline void sp_smooth_convert(const struct sp_smooth_cube *cube,
                                     const struct sp_curve *curve, enum sp_type type, int lane,
                                     sp_smooth_words to) {
    const double low = curve->data[0], high = curve->data[1], base = curve->base;
#define SMOOTH_CONVERT(T)                                                                          \
    for (int row = 0; row < SMOOTH_ROWS; row++) {                                                  \
        const T *from = (const void *)(cube->first + (size_t)(row / SMOOTH_SIDE) * cube->slice +   \
                                       (size_t)(row % SMOOTH_SIDE) * cube->row);                   \
        for (int p = 0; p < SMOOTH_SIDE; p++) {                                                    \
            const double x = (double)from[p];                                                      \
            const float code = (float)((x - base) * curve->codes_per_unit);                        \
            const float known = x >= low && x <= high && isfinite(x) ? code : 0;                   \
            memcpy(&to[row][p][lane], &known, sizeof known);                                       \
        }                                                                                          \
    }
    switch (type) { SP_TYPE_CASES(SMOOTH_CONVERT) }
#undef SMOOTH_CONVERT
}

/* Packs the weights in pairs. is_split: the pairs hold samples 0 and 2, 1 and 3; otherwise 0 and 1,
 * 2 and 3. */
static inline void sp_smooth_pack(bool is_split, struct sp_smooth_weights *w) {
    for (int h = 0; h < 2; h++) {
        const int low = is_split ? h : 2 * h, high = is_split ? h + 2 : 2 * h + 1;
        w->mean_pair[h] =
            sp_wide_to_int(w->mean[high]) << 16 | (sp_wide_to_int(w->mean[low]) & 0xffff);
        w->change_pair[h] =
            sp_wide_to_int(w->change[high]) << 16 | (sp_wide_to_int(w->change[low]) & 0xffff);
    }
}

static inline void sp_smooth_weigh_row(sp_wide f, bool is_split, struct sp_smooth_weights *w) {
    const float quarter = SMOOTH_ONE / 4;
    const sp_wide q = sp_wide_floor(f * quarter + 0.5f), one = sp_wide_all(quarter);
    const sp_wide means[SMOOTH_SIDE] = { one - q, 2 * one - q, one + q, q };
    const sp_wide changes[SMOOTH_SIDE] = { 2 * (q - one), -2 * q, 2 * (one - q), 2 * q };
    memcpy(w->mean, means, sizeof means);
    memcpy(w->change, changes, sizeof changes);
    sp_smooth_pack(is_split, w);
}

/* Four times the means and twice the differences. */
static inline void sp_smooth_weigh_across(sp_wide f, struct sp_smooth_across *w) {
    const sp_wide means[SMOOTH_SIDE] = { 1 - f, 2 - f, 1 + f, f };
    const sp_wide changes[SMOOTH_SIDE] = { f - 1, -f, 1 - f, f };
    memcpy(w->mean, means, sizeof means);
    memcpy(w->change, changes, sizeof changes);
}

static inline void sp_smooth_weigh(const struct sp_smooth_places *places, bool is_split,
                                   struct sp_smooth_kernel *kernel) {
    const float scale[3] = { 1.0f / 16, 1.0f / 8, 1.0f / 8 };
    sp_smooth_weigh_row(places->part[0], is_split, &kernel->row);
    sp_smooth_weigh_across(places->part[1], &kernel->down);
    sp_smooth_weigh_across(places->part[2], &kernel->deep);
    memcpy(kernel->scale, scale, sizeof scale);
}

/* Weights of the polynomial of degree 3 through four samples, at f behind the second one. */
static inline void sp_cubic_weights(sp_wide f, sp_wide w[SMOOTH_SIDE]) {
    const sp_wide outer = f * (1 - f) * (1 / 6.0f), inner = (1 + f) * (2 - f) * 0.5f;
    w[0] = (f - 2) * outer;
    w[1] = (1 - f) * inner;
    w[2] = f * inner;
    w[3] = (-1 - f) * outer;
}

static inline void sp_fine_weigh_across(sp_wide f, struct sp_smooth_across *w) {
    sp_wide before[SMOOTH_SIDE];
    sp_cubic_weights(f, w->mean);
    sp_cubic_weights(f + 0.5f, w->change);
    sp_cubic_weights(f - 0.5f, before);
    for (int i = 0; i < SMOOTH_SIDE; i++)
        w->change[i] -= before[i];
}

/* Rounds weights of the given sum. */
static inline void sp_fine_round(const sp_wide from[SMOOTH_SIDE], float sum,
                                 sp_wide to[SMOOTH_SIDE]) {
    sp_wide left = sp_wide_all(sum * SMOOTH_ONE);
    for (int i = 0; i < SMOOTH_SIDE; i++) {
        to[i] = sp_wide_floor(from[i] * SMOOTH_ONE + 0.5f);
        left -= to[i];
    }
    to[1] += left;
}

static inline void sp_fine_weigh(const struct sp_smooth_places *places, bool is_split,
                                 struct sp_smooth_kernel *kernel) {
    struct sp_smooth_across row;
    sp_fine_weigh_across(places->part[0], &row);
    sp_fine_round(row.mean, 1, kernel->row.mean);
    sp_fine_round(row.change, 0, kernel->row.change);
    sp_smooth_pack(is_split, &kernel->row);
    sp_fine_weigh_across(places->part[1], &kernel->down);
    sp_fine_weigh_across(places->part[2], &kernel->deep);
    kernel->scale[0] = kernel->scale[1] = kernel->scale[2] = 1;
}

/* Sums a row of integers. They are limited to the range of the codes. */
static inline void sp_smooth_sum_integers(const struct sp_rows *reader,
                                          const int32_t words[SMOOTH_SIDE][SP_WIDE],
                                          const struct sp_smooth_weights *w, sp_wide *mean,
                                          sp_wide *change) {
    const bool is_byte = reader->size == 1,
               has_sign = reader->type == SP_INT8 || reader->type == SP_INT16;
    const struct sp_rows_scaling *range = &reader->scaling;
    const bool is_limited = range->low > 0 || range->high < (is_byte ? 255 : 65535);
    const int signs = (int)(is_byte ? 0x80808080u : 0x80008000u);
    sp_wide_int sums[2] = { { 0 }, { 0 } };
    for (int h = 0; h < 2; h++) {
        sp_wide_int x = sp_wide_int_load(words[is_byte ? 0 : h]);
        x = has_sign ? x ^ signs : x; /* from the smallest number on */
        x = is_byte ? x >> 8 * h & 0xff00ff : x;
        if (is_limited)
            x = (sp_wide_int)sp_wide_short_max(
                sp_wide_short_min((sp_wide_short)x, sp_wide_short_all(range->high)),
                sp_wide_short_all(range->low));
        x = is_byte ? x : x ^ signs; /* sp_fetch_dot() takes numbers with a sign */
        sums[0] += sp_fetch_dot(x, w->mean_pair[h]);
        sums[1] += sp_fetch_dot(x, w->change_pair[h]);
    }
    *mean = sp_wide_from_int(sums[0]);
    *change = sp_wide_from_int(sums[1]);
}

/* The same of floats: samples if is_raw, otherwise codes above CURVE_CODE_MIN. */
static inline void sp_smooth_sum_reals(const struct sp_curve *curve, bool is_raw,
                                       const int32_t words[SMOOTH_SIDE][SP_WIDE],
                                       const struct sp_smooth_weights *w, sp_wide *mean,
                                       sp_wide *change) {
    const sp_wide low = sp_wide_all((float)curve->data[0]),
                  high = sp_wide_all((float)curve->data[1]);
    const float base = (float)curve->base, unit = (float)curve->codes_per_unit;
    *mean = *change = sp_wide_all(0);
    for (int p = 0; p < SMOOTH_SIDE; p++) {
        const sp_wide x = (sp_wide)sp_wide_int_load(words[p]);
        sp_wide code = x;
        if (is_raw)
            code = sp_wide_keep(sp_wide_le(low, x) & sp_wide_le(x, high) &
                                    sp_wide_lt(sp_wide_abs(x), sp_wide_all(INFINITY)),
                                (x - base) * unit);
        code = sp_wide_clamp(code, 0, CURVE_CODE_MAX - CURVE_CODE_MIN);
        *mean += w->mean[p] * code;
        *change += w->change[p] * code;
    }
}

/* Fills the words of the lanes. */
static inline void sp_smooth_fill(const struct sp_resample *r, const struct sp_rows *reader,
                                  const struct sp_smooth_places *places, sp_smooth_words words) {
    const size_t size = (size_t)reader->size;
    if (size <= 2 || reader->is_float_exact) {
        struct sp_smooth_groups groups;
        sp_smooth_group(r->samples, places, size, &groups);
        for (int w = 0; w < (int)size; w++)
            sp_smooth_read(&groups, w, words);
        return;
    }
    memset(words, 0, sizeof(sp_smooth_words));
    for (uint32_t left = places->lanes; left; left &= left - 1) {
        _Alignas(8) char copy[SMOOTH_ROWS * SMOOTH_SIDE * sizeof(double)];
        const int i = __builtin_ctz(left);
        const uint32_t first[3] = { places->first[0][i], places->first[1][i], places->first[2][i] };
        struct sp_smooth_cube cube = sp_smooth_open(r->samples, first, size, copy);
        sp_smooth_convert(&cube, &r->curve, reader->type, i, words);
    }
}

/* Computes a gradient from the samples around [codes per sample]. */
static inline void sp_smooth_convolve(const struct sp_resample *r, const struct sp_rows *reader,
                                      const sp_smooth_words words,
                                      const struct sp_smooth_kernel *kernel, sp_wide gradient[3]) {
    const sp_wide zero = sp_wide_all(0);
    const struct sp_smooth_across *down = &kernel->down, *deep = &kernel->deep;
    const bool is_integer = reader->size <= 2;
    for (int a = 0; a < 3; a++)
        gradient[a] = zero;
    for (int k = 0; k < SMOOTH_SIDE; k++) {
        sp_wide across = zero, along = zero, level = zero; /* of a slice */
        for (int j = 0; j < SMOOTH_SIDE; j++) {
            const int32_t(*row)[SP_WIDE] = (const int32_t(*)[SP_WIDE])words[SMOOTH_SIDE * k + j];
            sp_wide mean, change;
            if (is_integer)
                sp_smooth_sum_integers(reader, row, &kernel->row, &mean, &change);
            else
                sp_smooth_sum_reals(&r->curve, reader->is_float_exact, row, &kernel->row, &mean,
                                    &change);
            across += down->mean[j] * change;
            along += down->change[j] * mean;
            level += down->mean[j] * mean;
        }
        gradient[0] += deep->mean[k] * across;
        gradient[1] += deep->mean[k] * along;
        gradient[2] += deep->change[k] * level;
    }
    const float unit = (is_integer ? (float)r->curve.codes_per_unit : 1) / SMOOTH_ONE;
    for (int a = 0; a < 3; a++)
        gradient[a] *= unit * kernel->scale[a];
}

/* Computes the smooth gradient at the places [codes per sample]. */
static inline void sp_smooth_slopes(const struct sp_resample *r, const struct sp_rows *reader,
                                    const struct sp_smooth_places *places, sp_wide gradient[3]) {
    _Alignas(64) sp_smooth_words words;
    struct sp_smooth_kernel kernel;
    sp_smooth_fill(r, reader, places, words);
    sp_smooth_weigh(places, reader->size == 1, &kernel);
    sp_smooth_convolve(r, reader, words, &kernel, gradient);
}

/* Computes the fine gradient at the places, and the smooth one unless it is NULL. */
static inline void sp_fine_slopes(const struct sp_resample *r, const struct sp_rows *reader,
                                  const struct sp_smooth_places *places, sp_wide gradient[3],
                                  sp_wide *smooth) {
    _Alignas(64) sp_smooth_words words;
    struct sp_smooth_kernel kernel;
    sp_smooth_fill(r, reader, places, words);
    sp_fine_weigh(places, reader->size == 1, &kernel);
    sp_smooth_convolve(r, reader, words, &kernel, gradient);
    if (!smooth)
        return;
    sp_smooth_weigh(places, reader->size == 1, &kernel);
    sp_smooth_convolve(r, reader, words, &kernel, smooth);
}

/* Sets where the rays are at s, and returns the coordinates along the volume's axes in `at`. */
static inline void sp_smooth_open_places(const struct sp_resample_open_tile *t,
                                         const struct sp_rays *rays, sp_wide s, sp_wide_mask lanes,
                                         sp_wide at[3], struct sp_smooth_places *places) {
    sp_wide index[3];
    places->lanes = sp_wide_mask_bits(lanes);
    sp_place_on_rays(t, rays, s, at);
    for (int a = 0; a < 3; a++) {
        index[t->axis[a]] = at[t->axis[a]];
        for (int i = 0; t->map[a] && i < SP_WIDE; i++)
            index[t->axis[a]][i] = sp_resample_index(t, a, at[t->axis[a]][i]);
    }
    sp_smooth_place(t->r->samples, index, places);
}

/* Turns slopes along the axes at a place into a gradient in world space. */
static inline void sp_smooth_turn(const struct sp_resample_open_tile *t, const sp_wide at[3],
                                  sp_wide slope[3], sp_wide gradient[3]) {
    for (int a = 0; a < 3; a++)
        sp_rescale_slopes(t, a, at[t->axis[a]], &slope[t->axis[a]]);
    for (int w = 0; w < 3; w++) {
        const float *to = t->r->to_world[w];
        gradient[w] = to[0] * slope[0] + to[1] * slope[1] + to[2] * slope[2];
    }
}

/* Computes the smooth gradient in world space [gradient_unit], where the rays are at s, in the
 * lanes of a mask. Each axis has at least RESAMPLE_SMOOTH samples. */
static inline void sp_smooth_gradient(const struct sp_resample_open_tile *t,
                                      const struct sp_rays *rays, sp_wide s, sp_wide_mask lanes,
                                      sp_wide gradient[3]) {
    struct sp_smooth_places places;
    sp_wide at[3], slope[3];
    sp_smooth_open_places(t, rays, s, lanes, at, &places);
    sp_smooth_slopes(t->r, &t->reader, &places, slope);
    sp_smooth_turn(t, at, slope, gradient);
}

/* The same for the fine gradient, and for the smooth one unless it is NULL. */
static inline void sp_fine_gradient(const struct sp_resample_open_tile *t,
                                    const struct sp_rays *rays, sp_wide s, sp_wide_mask lanes,
                                    sp_wide gradient[3], sp_wide *smooth) {
    struct sp_smooth_places places;
    sp_wide at[3], slope[2][3];
    sp_smooth_open_places(t, rays, s, lanes, at, &places);
    sp_fine_slopes(t->r, &t->reader, &places, slope[0], smooth ? slope[1] : NULL);
    sp_smooth_turn(t, at, slope[0], gradient);
    if (smooth)
        sp_smooth_turn(t, at, slope[1], smooth);
}

#endif
