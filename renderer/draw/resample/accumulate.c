/* SPDX-License-Identifier: Apache-2.0
 *
 * Reduces the interval of the rays between two sheets to a number, and adds it to the number of
 * each ray. The value in an interval is the polynomial of degree 2 through its ends and its middle
 * (integrate.c). Its largest value is at its vertex; Simpson's rule integrates it. A maximum or a
 * minimum is kept between the refined samples around the two ends. So it is never beyond the
 * samples of the volume there.
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
    bool has_depth;
    bool is_cut; /* it does not reach from sheet to sheet */
    float start; /* s of the first sheet */
    float width; /* s from sheet to sheet */
};

/* What SP_WIDE rays have in it. */
struct span {
    sp_wide value[3];   /* at its start, in its middle and at its end */
    sp_wide front;      /* where it begins inside: 0 on the first sheet, 1 on the second one */
    sp_wide share;      /* of the interval that is inside all half spaces */
    sp_wide_mask known; /* all samples around are finite */
};

/* Returns the values on the sheet, and sets `range` to the range of the four refined samples around
 * each. */
static inline sp_wide read_values(const struct sp_resample_open_tile *t, const struct sp_rays *rays,
                                  int number, sp_wide range[2]) {
    const struct sp_resample_sheet *sheet = &t->scratch->sheets[number % RESAMPLE_SHEETS];
    struct place place;
    compute_place(t, sheet, rays, &place);
    sp_wide_int above = sp_fetch_pairs(sheet->refined, place.index);
    sp_wide_int below = sp_fetch_pairs(sheet->refined + sheet->width, place.index);
    const sp_wide_short pairs[2] = { (sp_wide_short)above, (sp_wide_short)below };
    sp_wide_int least = (sp_wide_int)sp_wide_short_min(pairs[0], pairs[1]);
    sp_wide_int most = (sp_wide_int)sp_wide_short_max(pairs[0], pairs[1]);
    range[0] = sp_wide_min(sp_wide_from_int(least & 0xffff), sp_wide_from_int(least >> 16));
    range[1] = sp_wide_max(sp_wide_from_int(most & 0xffff), sp_wide_from_int(most >> 16));
    return mix_pairs(&place, above, below) * (1.0f / SAMPLE_ONE);
}

static void read_sheet(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                       int number) {
    const struct sp_reduction *r = &t->r->reduction;
    const int slot = number & 3;
    if (block->value_sheet[slot] == number)
        return;
    block->value_sheet[slot] = number;
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        struct sp_rays rays = { sp_wide_load(block->u + i), sp_wide_load(block->v + i),
                                sp_wide_load(block->du + i), sp_wide_load(block->dv + i) };
        sp_wide range[2], value;
        if (!r->is_extreme && !r->leaves_out) {
            sp_wide_store(block->value[slot] + i, sp_sample_values(t, &rays, number));
            continue;
        }
        value = read_values(t, &rays, number, range);
        if (r->leaves_out) /* the code of no value beside samples that are not finite */
            value = sp_wide_keep(sp_wide_lt(sp_wide_all(none_below), range[0]), value);
        if (r->is_extreme)
            sp_wide_store(block->slope[slot][0] + i, r->sign > 0 ? range[1] : -range[0]);
        sp_wide_store(block->value[slot] + i, value);
    }
    t->scratch->sampled += RESAMPLE_PIXELS;
}

/* Reads the values of the rays from pixel i on. */
static inline void read_span(const struct gap *gap, int i, struct span *span) {
    sp_wide sheet[4];
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
    span->front = sp_wide_all(0);
    span->share = sp_wide_all(1);
    if (gap->is_cut)
        span->share =
            sp_cut_interval(gap->block, i, gap->start, gap->width, span->value, &span->front);
}

/* Returns the largest sign·value in the interval of the rays from pixel i on, or of that and
 * `before`. */
static inline sp_wide compute_most(const struct gap *gap, int i, const struct span *span,
                                   sp_wide before) {
    const struct sp_resample_block *block = gap->block;
    const int first = gap->number & 3, second = (gap->number + 1) & 3; /* sheets */
    const float sign = gap->reduction->sign;
    sp_wide a = sign * span->value[0], b = sign * span->value[1], c = sign * span->value[2];
    sp_wide most = sp_wide_max(sp_wide_max(a, c), b);
    /* The polynomial has a vertex between the ends if its slopes there have other signs. The vertex
     * exceeds the middle by −bend/2 at most. */
    sp_wide bend = a + c - 2 * b, change = c - a;
    if (!gap->is_cut && !sp_wide_any(sp_wide_lt(sp_wide_max(most, before), b - 0.5f * bend)))
        return sp_wide_max(most, before); /* not the middle, unless it is below `before` */
    sp_wide_mask is_inside =
        sp_wide_lt(bend, sp_wide_all(-1e-3f)) & sp_wide_lt(sp_wide_abs(change), -2 * bend);
    sp_wide vertex = b - change * change / (8 * bend);
    most = sp_wide_select(is_inside, sp_wide_max(most, vertex), most);
    /* The polynomial overshoots, and clipping may leave no other part of it. */
    sp_wide low = sp_wide_min(sign * sp_wide_load(block->value[first] + i),
                              sign * sp_wide_load(block->value[second] + i));
    sp_wide high = sp_wide_max(sp_wide_load(block->slope[first][0] + i),
                               sp_wide_load(block->slope[second][0] + i));
    return sp_wide_max(sp_wide_max(sp_wide_min(most, high), low), before);
}

/* Notes where the rays meet a value that is larger than all before: at an end or in the middle. */
static inline void note_depth(const struct gap *gap, int i, const struct span *span,
                              sp_wide_mask is_more) {
    const float sign = gap->reduction->sign;
    float *at = gap->block->moment[0] + i;
    sp_wide place = sp_wide_all(0.5f);
    place = sp_wide_select(sp_wide_lt(sign * span->value[1], sign * span->value[2]), sp_wide_all(1),
                           place);
    place = sp_wide_select(sp_wide_lt(sp_wide_max(sign * span->value[1], sign * span->value[2]),
                                      sign * span->value[0]),
                           sp_wide_all(0), place);
    place = gap->start + gap->width * (span->front + span->share * place);
    sp_wide_store(at, sp_wide_select(is_more, place, sp_wide_load(at)));
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
        after = compute_most(gap, i, &span, before);
    } else {
        sp_wide sum = zero;
        for (int k = 0; k < 3; k++)
            sum += sp_wide_max(span.value[k] - r->zero, zero) * (k == 1 ? 4 / 6.0f : 1 / 6.0f);
        after = before + sum * length;
    }
    after = sp_wide_select(counts, after, before);
    if (gap->has_depth)
        note_depth(gap, i, &span, sp_wide_lt(before, after));
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
                       .has_depth = t->r->has_depth,
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
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        sp_wide_store(block->color[0] + i, sp_wide_all(start));
        if (r->has_depth) /* where the ray enters, until a value counts */
            sp_wide_store(block->moment[0] + i, sp_wide_load(block->begin + i));
    }
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
    if (r->has_depth) /* a value has no spread: the second moment stays 0 */
        sp_wide_store(block->moment[0] + i,
                      sp_wide_keep(is_visible, alpha * sp_wide_load(block->moment[0] + i)));
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

void sp_resample_reduce_add(const struct sp_resample_block *from, bool has_depth,
                            struct sp_resample_block *to) {
    const sp_wide one = sp_wide_all(1);
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        sp_wide own = sp_wide_load(to->light + i), other = sp_wide_load(from->light + i);
        sp_wide light = own * other;
        sp_wide_store(to->light + i, light);
        if (has_depth) {
            sp_wide sum = sp_wide_load(to->moment[0] + i) + sp_wide_load(from->moment[0] + i);
            sum *= (1 - light) / sp_wide_max(2 - own - other, sp_wide_all(1e-6f));
            sp_wide_store(to->moment[0] + i, sum);
        }
        for (int c = 0; c < 3; c++) {
            sp_wide sum = sp_wide_load(to->color[c] + i) + sp_wide_load(from->color[c] + i);
            sp_wide_store(to->color[c] + i, sp_wide_min(sum, one));
        }
    }
}
