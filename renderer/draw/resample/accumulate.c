/* SPDX-License-Identifier: Apache-2.0
 *
 * Reduces the interval of the rays between two sheets to a number, and adds it to the number of
 * each ray. The value in an interval is the polynomial of degree 2 through its ends and its middle
 * (integrate.c): the largest value is that of its vertex, the integral is Simpson's.
 */
#include "draw/resample/sheet_sample.h"
#include "frame/resolve.h"
#include "splat/exp2.h"

/* Lower codes stand for samples that are not finite. */
static const float none_below = 0.5f * (CURVE_CODE_NONE + CURVE_CODE_MIN);

/* The interval behind a sheet. */
struct gap {
    const struct sp_reduction *reduction;
    struct sp_resample_block *block;
    int number;
    bool is_cut; /* it does not reach from sheet to sheet */
    float start; /* s of the first sheet */
    float width; /* s from sheet to sheet */
};

/* What SP_WIDE rays have in it. */
struct span {
    sp_wide value[3];   /* at its start, in its middle and at its end */
    sp_wide share;      /* of the interval that is inside all half spaces */
    sp_wide_mask known; /* all samples around are finite */
};

/* The value on the sheet; the code of no value beside samples that are not finite. */
static inline sp_wide known_values(const struct sp_resample_open_tile *t,
                                   const struct sp_rays *rays, int number) {
    const struct sp_resample_sheet *sheet = &t->scratch->sheets[number % RESAMPLE_SHEETS];
    struct place place;
    compute_place(t, sheet, rays, &place);
    sp_wide_int pair[2];
    sp_wide least = sp_wide_all(INFINITY);
    for (int k = 0; k < 2; k++) {
        pair[k] = sp_fetch_pairs(sheet->refined + k * sheet->width, place.index);
        least = sp_wide_min(least, sp_wide_from_int(pair[k] & 0xffff));
        least = sp_wide_min(least, sp_wide_from_int(pair[k] >> 16));
    }
    sp_wide value = mix_pairs(&place, pair[0], pair[1]) * (1.0f / SAMPLE_ONE);
    return sp_wide_keep(sp_wide_lt(sp_wide_all(none_below), least), value);
}

static void read_sheet(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                       int number) {
    const int slot = number & 3;
    if (block->value_sheet[slot] == number)
        return;
    block->value_sheet[slot] = number;
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        struct sp_rays rays = { sp_wide_load(block->u + i), sp_wide_load(block->v + i),
                                sp_wide_load(block->du + i), sp_wide_load(block->dv + i) };
        sp_wide_store(block->value[slot] + i, t->r->reduction.leaves_out
                                                  ? known_values(t, &rays, number)
                                                  : sp_sample_values(t, &rays, number));
    }
    t->scratch->sampled += RESAMPLE_PIXELS;
}

/* Reads the values of the rays from pixel i on. */
static inline void read_span(const struct gap *gap, int i, struct span *span) {
    sp_wide sheet[4], front;
    for (int k = 0; k < 4; k++)
        sheet[k] = sp_wide_load(gap->block->value[(gap->number - 1 + k) & 3] + i);
    sp_wide middle = (sheet[1] + sheet[2]) * (9 / 16.0f) - (sheet[0] + sheet[3]) * (1 / 16.0f);
    if (gap->reduction->leaves_out) {
        const sp_wide none = sp_wide_all(none_below);
        span->known = sp_wide_lt(none, sp_wide_min(sheet[1], sheet[2]));
        middle = sp_wide_select(sp_wide_lt(none, sp_wide_min(sheet[0], sheet[3])), middle,
                                0.5f * (sheet[1] + sheet[2]));
    }
    span->value[0] = sheet[1]; /* the polynomial overshoots */
    span->value[1] =
        sp_wide_min(sp_wide_max(middle, sp_wide_all(CURVE_CODE_MIN)), sp_wide_all(CURVE_CODE_MAX));
    span->value[2] = sheet[2];
    span->share = gap->is_cut
                      ? sp_cut_interval(gap->block, i, gap->start, gap->width, span->value, &front)
                      : sp_wide_all(1);
}

/* Returns the largest sign·value in the interval, or of that and `before`. */
static inline sp_wide compute_most(const struct gap *gap, const struct span *span, sp_wide before) {
    const float sign = gap->reduction->sign;
    sp_wide a = sign * span->value[0], b = sign * span->value[1], c = sign * span->value[2];
    sp_wide most = sp_wide_max(sp_wide_max(a, c), sp_wide_max(b, before));
    /* The polynomial has a vertex between the ends if its slopes there have other signs. The vertex
     * exceeds the middle by −bend/2 at most. */
    sp_wide bend = a + c - 2 * b, change = c - a;
    if (!sp_wide_any(sp_wide_lt(most, b - 0.5f * bend)))
        return most;
    sp_wide_mask is_inside =
        sp_wide_lt(bend, sp_wide_all(-1e-3f)) & sp_wide_lt(sp_wide_abs(change), -2 * bend);
    sp_wide vertex = b - change * change / (8 * bend);
    return sp_wide_select(is_inside, sp_wide_max(most, vertex), most);
}

/* Adds the interval to SP_WIDE rays from pixel i on; returns their numbers. */
static inline sp_wide add_span(const struct gap *gap, int i) {
    const struct sp_reduction *r = gap->reduction;
    const sp_wide zero = sp_wide_all(0);
    struct sp_resample_block *block = gap->block;
    float *number = block->color[0] + i, *seen = block->color[1] + i;
    sp_wide before = sp_wide_load(number), after;
    struct span span;
    read_span(gap, i, &span);
    sp_wide_mask counts = sp_wide_lt(zero, span.share);
    sp_wide length = sp_wide_load(block->length + i) * (gap->width * span.share);
    if (r->leaves_out) {
        counts = counts & span.known;
        sp_wide_store(seen, sp_wide_load(seen) + sp_wide_keep(counts, length));
    }
    if (r->is_extreme) {
        after = compute_most(gap, &span, before);
    } else {
        sp_wide sum = zero;
        for (int k = 0; k < 3; k++)
            sum += sp_wide_max(span.value[k] - r->zero, zero) * (k == 1 ? 4 / 6.0f : 1 / 6.0f);
        after = before + sum * length;
    }
    after = sp_wide_select(counts, after, before);
    sp_wide_store(number, after);
    return after;
}

/* Returns false if no larger number changes any pixel. */
static bool add_interval(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                         int number, int b) {
    const float end = sp_resample_sheet_s(t, number + 1);
    struct gap gap = { .reduction = &t->r->reduction,
                       .block = block,
                       .number = number,
                       .start = sp_resample_sheet_s(t, number) };
    const sp_wide none = sp_wide_all(INFINITY);
    sp_wide least = none;
    gap.width = end - gap.start;
    gap.is_cut = !(block->inside[0] <= gap.start && end <= block->inside[1]);
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        sp_wide is = add_span(&gap, i);
        sp_wide_mask meets =
            sp_wide_lt(sp_wide_load(block->begin + i), sp_wide_load(block->end + i));
        least = sp_wide_min(least, sp_wide_select(meets, is, none));
    }
    if (!t->r->reduction.is_extreme)
        return true;
    t->scratch->least[b] = -sp_wide_largest(-least);
    return t->scratch->least[b] < t->r->reduction.full;
}

bool sp_resample_reduce(const struct sp_resample_open_tile *t,
                        const struct sp_resample_batch *batch, int b) {
    struct sp_resample_block *block = &t->scratch->blocks[b];
    for (int n = batch->first; n <= batch->last; n++) {
        if (!(batch->now[n - batch->first] >> b & 1))
            continue;
        for (int k = n - 3; k <= n; k++)
            read_sheet(t, block, k);
        if (!add_interval(t, block, n - 2, b))
            return false;
    }
    return true;
}

void sp_resample_reduce_open(const struct sp_resample *r, struct sp_resample_block *block) {
    const float start = r->reduction.is_extreme ? r->reduction.start : 0;
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE)
        sp_wide_store(block->color[0] + i, sp_wide_all(start));
}

/* Colours by position between the first and the last one, [0, 1]. */
static inline void write_colors(const struct sp_resample *r, sp_wide position,
                                sp_wide_mask is_visible, struct sp_resample_block *block, int i) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    const float most = REDUCTION_COLORS;
    sp_wide place = sp_wide_min(sp_wide_max(position, zero), one) * most;
    sp_wide whole = sp_wide_min(sp_wide_floor(place), sp_wide_all(most - 1)), part = place - whole;
    float at[SP_WIDE], colors[4][SP_WIDE];
    sp_wide_store(at, whole);
    for (int k = 0; k < SP_WIDE; k++) {
        const float *low = r->colors[(int)at[k]];
        const float *high = r->colors[(int)at[k] + 1];
        for (int c = 0; c < 4; c++)
            colors[c][k] = low[c] + part[k] * (high[c] - low[c]);
    }
    sp_wide alpha = sp_wide_keep(is_visible, sp_wide_load(colors[3]));
    for (int c = 0; c < 3; c++)
        sp_wide_store(block->color[c] + i, alpha * sp_wide_load(colors[c]));
    sp_wide_store(block->light + i, one - alpha);
}

void sp_resample_reduce_close(const struct sp_resample *r, struct sp_resample_block *block) {
    const struct sp_reduction *own = &r->reduction;
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1), tiny = sp_wide_all(1e-30f);
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        sp_wide begin = sp_wide_load(block->begin + i), end = sp_wide_load(block->end + i);
        sp_wide number = sp_wide_load(block->color[0] + i);
        sp_wide_mask is_visible = sp_wide_lt(begin, end);
        sp_wide length = (end - begin) * sp_wide_load(block->length + i);
        if (own->leaves_out) {
            length = sp_wide_load(block->color[1] + i);
            is_visible = is_visible & sp_wide_lt(zero, length);
        }
        if (own->is_mean)
            number = number / sp_wide_max(length, tiny);
        if (own->absorption > 0)
            number = one - sp_wide_exp2(number * -own->absorption);
        write_colors(r, number * own->gain + own->offset, is_visible, block, i);
    }
}

void sp_resample_reduce_add(const struct sp_resample_block *from, struct sp_resample_block *to) {
    const sp_wide one = sp_wide_all(1);
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        sp_wide light = sp_wide_load(to->light + i) * sp_wide_load(from->light + i);
        sp_wide_store(to->light + i, light);
        for (int c = 0; c < 3; c++) {
            sp_wide sum = sp_wide_load(to->color[c] + i) + sp_wide_load(from->color[c] + i);
            sp_wide_store(to->color[c] + i, sp_wide_min(sum, one));
        }
    }
}
