/* SPDX-License-Identifier: Apache-2.0
 *
 * Composites the interval of the rays between two sheets.
 *
 *   sheet   0      1      2      3         the value half way is that of the polynomial of
 *           ·──────·──┬───·──────·         degree 3 through four sheets; in each half the value
 *                  └half┘                  changes linearly, and the curve's integral classifies it
 */
#include "draw/resample/depth.h"
#include "draw/resample/insert.h"
#include "draw/resample/opacity.h"
#include "draw/resample/quads.h"

/* The bin of a value, and how far the value lies below all bins or above them. */
static inline sp_wide compute_bin(const struct sp_curve *curve, sp_wide value, sp_wide *beyond) {
    sp_wide x = value * curve->bins_per_code + curve->first_bin;
    sp_wide inside = sp_wide_clamp(x, 0, CURVE_BINS);
    *beyond = x - inside;
    return sp_wide_floor(inside);
}

/* The curve's entries where the interval begins. Where the last one of these rays ended here, they
 * are known. */
static inline sp_wide begin_mean(const struct sp_interval_work *work, int begin, sp_wide bin,
                                 struct sp_entries *entries) {
    const struct sp_resample_block *block = work->block;
    if (block->entry_sheet[begin] == work->number && !work->is_cut) {
        for (int k = 0; k < 4; k++)
            entries->part[k] = sp_wide_load(block->entry[k] + begin);
        return sp_wide_load(block->entry_bin + begin);
    }
    *entries = sp_fetch_entries((const float(*)[4])work->t->r->curve.integral, sp_wide_to_int(bin));
    return bin;
}

static inline void end_mean(const struct sp_interval_work *work, int begin, sp_wide bin,
                            const struct sp_entries *entries) {
    struct sp_resample_block *block = work->block;
    sp_wide_store(block->entry_bin + begin, bin);
    for (int k = 0; k < 4; k++)
        sp_wide_store(block->entry[k] + begin, entries->part[k]);
    block->entry_sheet[begin] = work->is_cut ? -1 : work->number + 1;
}

/* Sets the visible part of half an interval. beyond: how far the values at its ends lie outside the
 * bins. width, above: its parts in the bins and above them [bins]. inverse: 1 / all of it. */
static inline void compute_half(const struct sp_curve *curve, const sp_wide beyond[2],
                                sp_wide above, sp_wide width, sp_wide inverse,
                                struct sp_seen_half *half) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    sp_wide before = curve->has_above ? sp_wide_max(-beyond[0], zero) : sp_wide_abs(beyond[0]);
    half->front = sp_wide_min(before * inverse, one);
    half->length = sp_wide_min((sp_wide_abs(width) + above) * inverse, one - half->front);
}

/* The mean of the curve over the interval: over its first half, where the value goes from
 * value[0] to value[1], and over its second one. */
static inline void compute_mean(const struct sp_interval_work *work, struct sp_interval *in) {
    const struct sp_resample *r = work->t->r;
    const struct sp_curve *curve = &r->curve;
    const sp_wide zero = sp_wide_all(0);
    struct sp_entries entries[3];
    sp_wide bin[3], beyond[3], share[2], above[2] = { zero, zero };
    for (int k = 0; k < 3; k++)
        bin[k] = compute_bin(curve, in->value[k], &beyond[k]);
    bin[0] = begin_mean(work, in->begin, bin[0], &entries[0]);
    for (int k = 0; k < 2; k++) {
        /* A half is at least one bin wide. It is as wide as the whole bins whose integral is taken,
         * so that quantisation cancels, and what lies below all bins, which is transparent, or
         * above them. */
        sp_wide_mask is_equal = sp_wide_eq(bin[k], bin[k + 1]);
        bin[k + 1] = sp_wide_select(is_equal, bin[k] + 1.0f, bin[k + 1]);
        entries[k + 1] =
            sp_fetch_entries((const float(*)[4])curve->integral, sp_wide_to_int(bin[k + 1]));
        sp_wide width = bin[k + 1] - bin[k];
        sp_wide all = sp_wide_abs(width) + sp_wide_abs(beyond[k + 1] - beyond[k]);
        sp_wide inverse = sp_wide_inverse(all);
        if (curve->has_above)
            above[k] = sp_wide_abs(sp_wide_max(beyond[k + 1], zero) - sp_wide_max(beyond[k], zero));
        if (r->needs_gradient)
            compute_half(curve, beyond + k, above[k], width, inverse, &in->half[k]);
        above[k] *= 0.5f * inverse;
        share[k] = sp_wide_copysign(0.5f * inverse, width);
    }
    sp_fetch_sum(entries, share, in->mean);
    for (int c = 0; curve->has_above && c < 4; c++)
        in->mean[c] += (above[0] + above[1]) * curve->above[c];
    if (r->needs_gradient)
        sp_fetch_change(&entries[0], &entries[1], in->first);
    for (int c = 0; r->needs_gradient && c < 4; c++)
        in->first[c] = share[0] * in->first[c] + above[0] * curve->above[c];
    end_mean(work, in->begin, bin[2], &entries[2]);
}

/* Reads the values of the rays from pixel `begin` on, and the gradients along u and v. */
static inline sp_wide read_slopes(const struct sp_resample_open_tile *t,
                                  struct sp_resample_block *block, const struct sp_rays *rays,
                                  int begin, int number) {
    sp_wide slope[2], value = sp_sample_slopes(t, rays, number, slope);
    for (int a = 0; a < 2; a++)
        sp_wide_store(block->slope[number & 3][a] + begin, slope[a]);
    block->has_slope[number & 3] |= UINT64_C(1) << begin;
    return value;
}

/* The gradient along u and v on sheet `number` [codes per sample]. */
static inline void compute_slope(const struct sp_interval_work *work, const struct sp_rays *rays,
                                 int begin, int number, sp_wide slope[2]) {
    if (!(work->block->has_slope[number & 3] >> begin & 1))
        read_slopes(work->t, work->block, rays, begin, number);
    for (int a = 0; a < 2; a++)
        slope[a] = sp_wide_load(work->block->slope[number & 3][a] + begin);
}

/* Returns (h² − ¼)/3, the part of the factor of `turn` that depends on h (compute_gradient()), for
 * sheets half a slice apart. There the difference from p − ½ to p + ½ spans less than one sample of
 * the ray, and h² = 1/(1 + du² + dv²) would span one. 0.7 of the way is nearest to exact images
 * (measured). */
static inline sp_wide widen(const struct sp_rays *rays) {
    sp_wide square = 1 + rays->du * rays->du + rays->dv * rays->dv;
    return 0.7f / 3 * (sp_wide_fast_inverse(square) - 0.25f);
}

/* The gradient where the interval is seen, at p between its sheets. Across the ray it is that of
 * the polynomial of degree 3 through the gradients on the four sheets. Along the ray it is the
 * difference of the values' polynomial from p − h to p + h over 2h; h = ½, or larger between sheets
 * half a slice apart (widen()):
 *
 *   rise + past·bend + (past² + (h² − ¼)/3)·turn        past = p − ½
 *
 * so that all three are differences over about one sample: none is blurred more than the others. */
static inline void compute_gradient(const struct sp_interval_work *work, struct sp_interval *in) {
    const struct sp_resample_open_tile *t = work->t;
    const sp_wide *value = in->sheet, p = in->seen;
    struct sp_rays rays = sp_load_rays(work->block, in->begin);
    sp_wide slope[3] = { sp_wide_all(0), sp_wide_all(0) };
    sp_wide outer = p * (1 - p) * (1 / 6.0f), inner = (1 + p) * (2 - p) * 0.5f;
    const sp_wide share[4] = { (p - 2) * outer, (1 - p) * inner, p * inner, (-1 - p) * outer };
    for (int k = 0; k < 4; k++) {
        sp_wide across[2];
        compute_slope(work, &rays, in->begin, work->number - 1 + k, across);
        for (int a = 0; a < 2; a++)
            slope[a] += share[k] * across[a];
    }
    sp_wide rise = value[2] - value[1], past = p - 0.5f;
    sp_wide bend = 0.5f * (value[0] + value[3] - value[1] - value[2]);
    sp_wide turn = 0.5f * (value[3] - value[0]) - 1.5f * rise;
    sp_wide more = t->sheets_per_slice > 1 ? widen(&rays) : sp_wide_all(0);
    rise += past * bend + (past * past + more) * turn;
    slope[2] = rise * (1 / work->width) - rays.du * slope[0] - rays.dv * slope[1];
    if (t->is_backwards)
        slope[2] = -slope[2];
    for (int w = 0; w < 3; w++) {
        in->gradient[w] = sp_wide_all(0);
        for (int a = 0; a < 3; a++)
            in->gradient[w] += t->r->to_world[w][t->axis[a]] * slope[a];
    }
    const sp_wide *g = in->gradient;
    in->square = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];
}

/* Notes what the material shows where rays enter by a cut. */
static inline void enter_faces(const struct sp_interval_work *work, const struct sp_interval *in) {
    const struct sp_resample *r = work->t->r;
    struct sp_entries entries[2];
    sp_wide change[4], beyond, bin = compute_bin(&r->curve, in->value[0], &beyond);
    for (int k = 0; k < 2; k++)
        entries[k] =
            sp_fetch_entries((const float(*)[4])r->curve.integral, sp_wide_to_int(bin + (float)k));
    sp_fetch_change(&entries[0], &entries[1], change);
    sp_wide depth = sp_wide_select(sp_wide_lt(sp_wide_all(0), beyond),
                                   sp_wide_all(r->curve.above[3]), change[3]);
    depth *= sp_wide_load(work->block->length + in->begin);
    sp_cut_face_enter(work->block, in->begin, work->start, work->width, 1 - sp_transmit(r, depth));
}

/* Reads the values of the rays from pixel `begin` on; false if they show nothing. */
static inline bool read_interval(const struct sp_interval_work *work, int begin,
                                 struct sp_interval *in) {
    const struct sp_resample_block *block = work->block;
    const struct sp_resample *r = work->t->r;
    in->begin = begin;
    for (int k = 0; k < 4; k++)
        in->sheet[k] = sp_wide_load(block->value[(work->number - 1 + k) & 3] + begin);
    in->value[0] = in->sheet[1];
    in->value[1] =
        (in->sheet[1] + in->sheet[2]) * (9 / 16.0f) - (in->sheet[0] + in->sheet[3]) * (1 / 16.0f);
    in->value[1] = sp_wide_max(in->value[1], sp_wide_all(r->lowest)); /* it overshoots */
    in->value[2] = in->sheet[2];
    in->length = sp_wide_load(block->length + begin) * work->width;
    in->front = sp_wide_all(0);
    in->share = sp_wide_all(1);
    sp_wide low = sp_wide_min(sp_wide_min(in->value[0], in->value[2]), in->value[1]);
    sp_wide high = sp_wide_max(sp_wide_max(in->value[0], in->value[2]), in->value[1]);
    return sp_wide_any(sp_wide_lt(sp_wide_all(r->curve.visible[0]), high) &
                       sp_wide_lt(low, sp_wide_all(r->curve.visible[1])));
}

/* Opens the interval behind sheet `number`; light: transmittance of the pixels so far. Returns
 * false if all pixels are opaque. */
static inline bool open_work(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                             const float *light, int number, struct sp_interval_work *work) {
    const sp_wide dark = sp_wide_all(t->r->dark);
    float end = sp_resample_sheet_s(t, number + 1);
    bool is_alive = false;
    work->t = t;
    work->block = block;
    work->light = light;
    work->number = number;
    work->start = sp_resample_sheet_s(t, number);
    work->width = end - work->start;
    work->decay = t->scratch->sheets[number % RESAMPLE_SHEETS].decay;
    work->is_cut = !(block->inside[0] <= work->start && end <= block->inside[1]);
    work->count = 0;
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        if (!sp_wide_any(sp_wide_lt(dark, sp_wide_load(light + i))))
            continue;
        is_alive = true;
        work->count += read_interval(work, i, &work->parts[work->count]) ? 1 : 0;
    }
    return is_alive;
}

static inline void classify(const struct sp_resample *r, struct sp_interval *in) {
    sp_wide inverse = sp_wide_inverse(sp_wide_max(in->mean[3], sp_wide_all(1e-20f)));
    in->depth = in->mean[3] * in->length;
    in->opacity = 1 - sp_transmit(r, in->depth);
    for (int c = 0; c < 3; c++)
        in->color[c] = inverse * in->mean[c];
}

/* Computes the place where the interval is seen. Black material is seen by its highlights. */
static inline void compute_seen(const struct sp_resample *r, struct sp_interval *in) {
    const float highlight = 0.01f;
    const sp_wide zero = sp_wide_all(0);
    sp_wide first = sp_wide_max(in->first[3], zero), brightness = zero, all = zero;
    for (int c = 0; c < 3; c++) {
        brightness += in->first[c];
        all += in->mean[c];
    }
    const sp_wide depth[2] = { first, sp_wide_max(in->mean[3] - first, zero) };
    const sp_wide light[2] = { brightness, all - brightness };
    for (int k = 0; k < 2; k++) {
        in->half[k].depth = depth[k] * in->length;
        in->half[k].light = sp_wide_max(light[k], zero) + highlight * depth[k];
    }
    const sp_wide opacity[2] = { 1 - sp_transmit(r, in->half[0].depth), in->opacity };
    in->seen = in->front + in->share * sp_seen_place(in->half, opacity);
}

/* Scales the opacity by the gradient where the interval is seen. */
static inline void scale_opacity(const struct sp_resample *r, struct sp_interval *in) {
    const struct sp_transfer_function *tf = &r->view->transfer_function;
    sp_wide scale = sp_gradient_scale(tf, sp_wide_sqrt(in->square) * r->gradient_unit);
    in->depth = sp_scale_depth(in->mean[3], scale) * in->length;
    in->opacity = 1 - sp_transmit(r, in->depth);
}

/* Adds the interval behind what the rays have met. */
static inline void composite(const struct sp_interval_work *work, const struct sp_interval *in) {
    struct sp_resample_block *block = work->block;
    sp_wide light = sp_wide_load(block->light + in->begin), share = light * in->opacity;
    for (int c = 0; c < 3; c++) {
        float *color = block->color[c] + in->begin;
        sp_wide_store(color, sp_wide_load(color) + share * in->color[c]);
    }
    sp_wide_store(block->light + in->begin, light - share);
    if (work->t->r->has_depth)
        sp_resample_add_depth(block, in->begin, share, work->start + in->seen * work->width);
}

/* The same for rays with fragments of other layers in the interval. */
static void composite_around(const struct sp_interval_work *work, const struct sp_interval *in) {
    const struct sp_resample_part part = { .pixel = in->begin,
                                           .begin = work->start,
                                           .end = work->start + work->width,
                                           .opacity = in->opacity,
                                           .color = { in->color[0], in->color[1], in->color[2] } };
    sp_resample_insert(work->t, work->block, &part);
}

/* Computes what the interval behind sheet `number` shows; light and result as above. */
static inline bool compute_interval(const struct sp_resample_open_tile *t,
                                    struct sp_resample_block *block, const float *light, int number,
                                    struct sp_interval_work *work) {
    const struct sp_resample *r = t->r;
    bool is_alive = open_work(t, block, light, number, work);
    for (int k = 0; work->is_cut && k < work->count; k++) {
        struct sp_interval *in = &work->parts[k];
        in->share =
            sp_cut_interval(block, in->begin, work->start, work->width, in->value, &in->front);
        in->length *= in->share;
    }
    for (int k = 0; block->has_faces && k < work->count; k++)
        enter_faces(work, &work->parts[k]);
    for (int k = 0; k < work->count; k++)
        compute_mean(work, &work->parts[k]);
    for (int k = 0; k < work->count; k++)
        classify(r, &work->parts[k]);
    for (int k = 0; r->needs_gradient && k < work->count; k++)
        compute_seen(r, &work->parts[k]);
    for (int k = 0; (r->has_depth || r->has_quads) && !r->needs_gradient && k < work->count; k++)
        work->parts[k].seen =
            work->parts[k].front + work->parts[k].share * sp_seen_share(work->parts[k].depth);
    for (int k = 0; r->needs_gradient && k < work->count; k++)
        compute_gradient(work, &work->parts[k]);
    for (int k = 0; r->view->transfer_function.gradient_count > 0 && k < work->count; k++)
        scale_opacity(r, &work->parts[k]);
    for (int k = 0; r->shade && !r->has_quads && k < work->count; k++)
        sp_light_interval(work, &work->parts[k]);
    if (r->has_quads)
        sp_light_quads(work);
    return is_alive;
}

/* Composites it, and the fragments before it and in it. */
static inline void composite_interval(const struct sp_interval_work *work) {
    struct sp_resample_block *block = work->block;
    const sp_wide end = sp_wide_all(work->start + work->width);
    sp_resample_open_depth(block, work->start);
    if (block->has_fragments)
        sp_resample_insert_before(work->t, block, work->start);
    for (int k = 0; k < work->count; k++) {
        const struct sp_interval *in = &work->parts[k];
        if (block->has_fragments &&
            sp_wide_any(sp_wide_lt(sp_wide_load(block->next_s + in->begin), end)))
            composite_around(work, in);
        else
            composite(work, in);
    }
}

static void read_sheet(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                       int number) {
    const int slot = number & 3;
    if (block->value_sheet[slot] == number)
        return;
    block->value_sheet[slot] = number;
    block->has_slope[slot] = 0;
    for (int i = 0; i < RESAMPLE_PIXELS; i += SP_WIDE) {
        struct sp_rays rays = sp_load_rays(block, i);
        /* Rays that saw something in the last interval also need gradients in the next one. */
        bool needs_slope = t->r->needs_gradient && block->entry_sheet[i] == number - 2;
        sp_wide_store(block->value[slot] + i, needs_slope ? read_slopes(t, block, &rays, i, number)
                                                          : sp_sample_values(t, &rays, number));
    }
    t->scratch->sampled += RESAMPLE_PIXELS;
}

static void read_sheets(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                        int last) {
    for (int k = last - 3; k <= last; k++)
        read_sheet(t, block, k);
}

/* What all channels show in an interval. */
struct mixture {
    struct sp_interval_work work;       /* colours times optical depth, until they are mixed */
    sp_wide brightness[INTERVAL_PARTS]; /* largest components of the colours times optical depth */
    unsigned filled;                    /* a bit for each part that is not empty */
};

static inline sp_wide largest(const sp_wide color[3]) {
    return sp_wide_max(sp_wide_max(color[0], color[1]), color[2]);
}

static inline void add_channel(const struct sp_interval_work *work, struct mixture *mixture) {
    for (int k = 0; k < work->count; k++) {
        const struct sp_interval *in = &work->parts[k];
        const int i = in->begin / SP_WIDE;
        struct sp_interval *to = &mixture->work.parts[i];
        if (!(mixture->filled >> i & 1)) {
            *to = (struct sp_interval){ .begin = in->begin };
            mixture->brightness[i] = sp_wide_all(0);
        }
        mixture->filled |= 1u << i;
        to->depth += in->depth;
        to->seen += in->depth * in->seen;
        mixture->brightness[i] += in->depth * largest(in->color);
        for (int c = 0; c < 3; c++)
            to->color[c] += in->depth * in->color[c];
    }
}

/* Mixes the channels. Extinctions add up. Colours add up as light does, so red and green give
 * yellow: the mixture has the hue of their sum by extinction, and their mean brightness. A mean of
 * the colours themselves would be grey. */
static inline void mix_channels(const struct sp_resample *r, struct mixture *mixture) {
    const sp_wide least = sp_wide_all(1e-20f);
    for (int i = 0; i < INTERVAL_PARTS; i++) {
        struct sp_interval *in = &mixture->work.parts[mixture->work.count];
        if (!(mixture->filled >> i & 1))
            continue;
        *in = mixture->work.parts[i];
        const sp_wide inverse = sp_wide_inverse(sp_wide_max(in->depth, least));
        const sp_wide scale = mixture->brightness[i] * inverse *
                              sp_wide_inverse(sp_wide_max(largest(in->color), least));
        in->opacity = 1 - sp_transmit(r, in->depth);
        for (int c = 0; c < 3; c++)
            in->color[c] *= scale;
        in->seen *= inverse;
        mixture->work.count++;
    }
}

/* Composites the interval behind sheet n − 2 of all channels of block b that show something there.
 * Returns false if all pixels are opaque. */
static bool add_mixture(const struct sp_resample_open_tile *first,
                        const struct sp_resample_batch *batch, int n, int b) {
    struct sp_resample_block *block = &first->scratch->blocks[b];
    struct sp_interval_work work;
    struct mixture mixture = { .filled = 0 };
    bool is_alive = true;
    for (const struct sp_resample_open_tile *t = first; t; t = t->next, batch++) {
        struct sp_resample_block *own = &t->scratch->blocks[b];
        if (!(batch->now[n - batch->first] >> b & 1))
            continue;
        read_sheets(t, own, n + t->shift);
        is_alive = compute_interval(t, own, block->light, n + t->shift - 2, &work);
        add_channel(&work, &mixture);
    }
    mixture.work.t = first;
    mixture.work.block = block;
    mixture.work.start = work.start;
    mixture.work.width = work.width;
    mix_channels(first->r, &mixture);
    composite_interval(&mixture.work);
    return is_alive;
}

/* True if a channel shows something in the interval behind sheet n − 2. */
static bool is_any_now(const struct sp_resample_open_tile *t, const struct sp_resample_batch *batch,
                       int n, int b) {
    for (; t; t = t->next, batch++)
        if (batch->now[n - batch->first] >> b & 1)
            return true;
    return false;
}

static bool integrate_channels(const struct sp_resample_open_tile *t,
                               const struct sp_resample_batch *batches, int b) {
    for (int n = batches->first; n <= batches->last; n++)
        if (is_any_now(t, batches, n, b) && !add_mixture(t, batches, n, b))
            return false;
    return true;
}

bool sp_resample_integrate(const struct sp_resample_open_tile *t,
                           const struct sp_resample_batch *batch, int b) {
    struct sp_resample_block *block = &t->scratch->blocks[b];
    if (block->has_fragments)
        sp_resample_prefetch_fragments(block, sp_resample_sheet_s(t, batch->last - 1));
    if (t->next)
        return integrate_channels(t, batch, b);
    for (int n = batch->first; n <= batch->last; n++) {
        struct sp_interval_work work;
        if (!(batch->now[n - batch->first] >> b & 1))
            continue;
        read_sheets(t, block, n);
        bool is_alive = compute_interval(t, block, block->light, n - 2, &work);
        composite_interval(&work);
        if (!is_alive)
            return false;
    }
    return true;
}
