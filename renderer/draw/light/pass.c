/* SPDX-License-Identifier: Apache-2.0
 *
 * Light that arrives at the cells of a slice, and what passes it (sweep.c).
 */
#include "base/wide.h"
#include "draw/light/kernels.h"
#include "splat/exp2.h"

enum { TILE = 16 };

/* The extinction of a row of cells, with zeros around it. */
static void load_row(const struct sp_light_slice *s, ptrdiff_t row, float *out) {
    const int n = s->dims[0];
    out[-1] = 0;
    if (row >= 0 && row < s->dims[1])
        memcpy(out, s->extinction + (size_t)row * s->stride, (size_t)n * sizeof *out);
    else
        memset(out, 0, (size_t)n * sizeof *out);
    for (int i = n; i < n + 1 + LIGHT_PAD; i++)
        out[i] = 0;
}

/* Four rays of the previous slice at SP_WIDE cells. */
static inline sp_wide read_rays(const struct sp_light_step *step, const float *above,
                                const float *below) {
    return step->weight[0] * sp_wide_load(above) + step->weight[1] * sp_wide_load(above + 1) +
           step->weight[2] * sp_wide_load(below) + step->weight[3] * sp_wide_load(below + 1);
}

/* The first ray of row 0 that a direction reads. */
static inline const float *first_ray(const struct sp_light_slice *s, int d, size_t at) {
    const struct sp_light_step *step = &s->steps[d];
    return s->from + (size_t)d * s->plane + at + step->shift[0] +
           (ptrdiff_t)step->shift[1] * s->width;
}

/* Directions with equal steps share the transmittance of a cell. */
static int group_directions(const struct sp_light_slice *s, int group[LIGHT_DIRECTIONS],
                            float depth[LIGHT_DIRECTIONS]) {
    int count = 0;
    for (int d = 0; d < s->count; d++) {
        int g = 0;
        while (g < count && depth[g] != s->steps[d].depth)
            g++;
        depth[g] = s->steps[d].depth;
        group[d] = g;
        count = g == count ? count + 1 : count;
    }
    return count;
}

/* Packs four moments into one word, a byte each. The word is added to a word of the field. */
static inline sp_wide_int pack_moments(const sp_wide moment[4]) {
    sp_wide_bits word = (sp_wide_bits)sp_wide_int_all(0);
    for (int k = 0; k < 4; k++)
        word |= (sp_wide_bits)sp_wide_to_int(moment[k] + 128.5f) << (8 * k);
    return (sp_wide_int)(word - LIGHT_MOMENT_ZERO);
}

static void pass_ambient(const struct sp_light_slice *s, size_t row, const float *extinction,
                         uint32_t *const words[LIGHT_WORDS]) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    const size_t at = (row + LIGHT_MARGIN) * (size_t)s->width + LIGHT_MARGIN;
    int group[LIGHT_DIRECTIONS];
    float group_depth[LIGHT_DIRECTIONS];
    int groups = group_directions(s, group, group_depth);
    for (int i = 0; i < s->dims[0]; i += SP_WIDE) {
        sp_wide passed[LIGHT_DIRECTIONS], all[LIGHT_MOMENTS] = { zero };
        sp_wide depth = sp_wide_load(extinction + i);
        sp_wide_mask is_row = sp_wide_first(s->dims[0] - i);
        bool is_clear = !sp_wide_any(sp_wide_lt(zero, depth));
        for (int g = 0; !is_clear && g < groups; g++)
            passed[g] = sp_wide_exp2(depth * group_depth[g]);
        for (int d = 0; d < s->count; d++) {
            const float *above = first_ray(s, d, at) + i;
            sp_wide light = read_rays(&s->steps[d], above, above + s->width), dark = one - light;
            for (int k = 0; k < LIGHT_MOMENTS; k++)
                all[k] += s->moment[d][k] * dark;
            if (!is_clear)
                light *= passed[group[d]];
            light = one - (one - light) * s->steps[d].fading;
            sp_wide_store(s->to + (size_t)d * s->plane + at + i,
                          sp_wide_select(is_row, light, one));
        }
        sp_wide_int_store((int32_t *)words[0] + i, sp_wide_to_int(all[0] + 0.5f));
        sp_wide_int_store((int32_t *)words[1] + i, pack_moments(all + 1));
        sp_wide_int_store((int32_t *)words[2] + i, pack_moments(all + 5));
    }
}

/* Turns a row of extinction into transmittance. */
static void transmit_row(const struct sp_light_slice *s, float *row) {
    for (int i = 0; i <= s->dims[0]; i += SP_WIDE) {
        sp_wide depth = sp_wide_load(row + i), passed = sp_wide_all(1);
        if (sp_wide_any(sp_wide_lt(sp_wide_all(0), depth)))
            passed = sp_wide_exp2(depth * s->steps[0].depth);
        sp_wide_store(row + i, passed);
    }
    row[-1] = 1;
}

/* `passed`: the transmittance of the row and of the one before it. */
static void pass_beams(const struct sp_light_slice *s, size_t row, float *const passed[2],
                       uint32_t *words) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    const size_t at = (row + LIGHT_MARGIN) * (size_t)s->width + LIGHT_MARGIN;
    for (int i = 0; i <= s->dims[0]; i += SP_WIDE) {
        sp_wide all = zero, cell[4];
        sp_wide_mask is_row = sp_wide_first(s->dims[0] + 1 - i);
        for (int k = 0; k < 4; k++)
            cell[k] = sp_wide_load(passed[k >> 1] + i - (k & 1));
        sp_wide_mask has_depth = sp_wide_lt(cell[0] + cell[1] + cell[2] + cell[3], 4 * one);
        bool is_clear = !sp_wide_any(has_depth);
        for (int d = 0; d < s->count; d++) {
            const struct sp_light_step *step = &s->steps[d];
            const float *above = first_ray(s, d, at) + i;
            sp_wide arrives = read_rays(step, above, above + s->width);
            sp_wide light = step->is_spread ? arrives : sp_wide_load(above);
            all += arrives;
            if (!is_clear) {
                sp_wide share = zero;
                for (int k = 0; k < 4; k++)
                    share += step->between[k] * cell[k];
                light *= share;
            }
            sp_wide_store(s->to + (size_t)d * s->plane + at + i,
                          sp_wide_select(is_row, light, one));
        }
        sp_wide sum = sp_wide_min(all * s->moment[0][0] + 0.5f, sp_wide_all(255));
        sp_wide_int_store((int32_t *)words + i, sp_wide_to_int(sum));
    }
}

static inline void write_cell(uint32_t *cell, bool is_ambient, uint32_t word) {
    *cell = is_ambient ? *cell + word : (*cell & ~0xff00u) | word << 8;
}

static void write_row(const struct sp_light_slice *s, size_t row,
                      uint32_t *const words[LIGHT_WORDS]) {
    const size_t first = row * s->stride;
    if (s->staged) {
        for (size_t k = 0; k < (s->is_ambient ? LIGHT_WORDS : 1); k++)
            memcpy(s->staged + k * s->staged_next + first, words[k],
                   (size_t)s->dims[0] * sizeof *words[k]);
        return;
    }
    for (int i = 0; i < s->dims[0]; i++)
        write_cell(s->field + first + i, s->is_ambient, words[0][i]);
    for (int i = 0; s->is_ambient && i < s->dims[0]; i++)
        for (int k = 0; k < 2; k++)
            s->moments[first + (size_t)i][k] += words[1 + k][i];
}

void sp_light_turn_in(const struct sp_light_turn *t, size_t row) {
    const float *from = t->extinction + row * t->row;
    float *to = t->depth + row * t->stride;
    for (int i = 0; i < t->length; i += TILE) {
        int end = i + TILE < t->length ? i + TILE : t->length;
        for (int k = 0; k < t->count; k++)
            for (int j = i; j < end; j++)
                to[(size_t)k * t->slice + (size_t)j] = from[(size_t)j * t->cell + (size_t)k];
    }
}

/* `from`: words of row 0 of the first slice; `step`: from one cell of `to` to the next one. */
static void turn_words(const struct sp_light_turn *t, const uint32_t *from, uint32_t *to,
                       size_t step) {
    for (int i = 0; i < t->length; i += TILE) {
        int end = i + TILE < t->length ? i + TILE : t->length;
        for (int j = i; j < end; j++)
            for (int k = 0; k < t->count; k++)
                write_cell(to + ((size_t)j * t->cell + (size_t)k) * step, t->is_ambient,
                           from[(size_t)k * t->slice + (size_t)j]);
    }
}

void sp_light_turn_out(const struct sp_light_turn *t, size_t row) {
    const uint32_t *from = t->words + row * t->stride;
    turn_words(t, from, t->field + row * t->row, 1);
    for (size_t k = 0; t->is_ambient && k < 2; k++)
        turn_words(t, from + (1 + k) * LIGHT_TURN * t->slice, t->moments[row * t->row] + k, 2);
}

void sp_light_pass(const struct sp_light_slice *s, size_t begin, size_t end, unsigned worker) {
    float *row = s->rows + worker * 2 * s->row_floats + LIGHT_PAD;
    float *rows[2] = { row, row + s->row_floats };
    uint32_t *words[LIGHT_WORDS];
    for (size_t k = 0; k < LIGHT_WORDS; k++)
        words[k] = s->words + (worker * LIGHT_WORDS + k) * s->row_floats;
    if (!s->is_ambient)
        load_row(s, (ptrdiff_t)begin - 1, rows[1]);
    if (!s->is_ambient)
        transmit_row(s, rows[1]);
    for (size_t r = begin; r < end; r++) {
        load_row(s, (ptrdiff_t)r, rows[0]);
        if (s->is_ambient) {
            pass_ambient(s, r, rows[0], words);
        } else {
            transmit_row(s, rows[0]);
            pass_beams(s, r, rows, words[0]);
        }
        if (r < (size_t)s->dims[1])
            write_row(s, r, words);
        float *last = rows[1];
        rows[1] = rows[0];
        rows[0] = last;
    }
}
