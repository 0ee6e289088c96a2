/* SPDX-License-Identifier: Apache-2.0
 *
 * The light of drafts (sp_render_options.draft): per interval, one light for each quad, a square
 * of 2 × 2 pixels. Each pixel keeps its own colour:
 *
 *   ┌───┬───┐   place on the mean ray of the quad: the mean of the places where the four pixels
 *   │ · │ · │   see the interval, weighted by the light that they get from it
 *   ├───┼───┤   gradient there: from the 4 × 4 × 4 samples around (smooth.h)
 *   │ · │ · │   pixel: colour · lit + shine, interpolated between quads by their light
 *   └───┴───┘
 *
 * An interval is as long as the distance of two slices, so that the pixels of a quad that light the
 * same interval are close to each other also at silhouettes.
 */
#ifndef SP_RESAMPLE_QUADS_H
#define SP_RESAMPLE_QUADS_H

#include "draw/resample/lit.h"

enum { QUADS_ACROSS = RESAMPLE_BLOCK / 2 };

/* What quads have in common with their pixels in an interval. */
struct quads {
    _Alignas(64) float share[RESAMPLE_QUADS]; /* of the light of the pixels, sum over the quad */
    float seen[RESAMPLE_QUADS];               /* sum of share · seen */
    float lit[3][RESAMPLE_QUADS], shine[3][RESAMPLE_QUADS];
    float square[RESAMPLE_QUADS]; /* of the length of the gradient */
};

/* Sums the pixels of each quad of a block. */
static inline void sp_quads_sum(const float pixels[RESAMPLE_PIXELS], float quads[RESAMPLE_QUADS]) {
    for (int row = 0; row < QUADS_ACROSS; row++) {
        const float *above = pixels + (ptrdiff_t)2 * row * RESAMPLE_BLOCK;
        const float *below = above + RESAMPLE_BLOCK;
        float *to = quads + (ptrdiff_t)row * QUADS_ACROSS;
        for (int i = 0; i < QUADS_ACROSS; i++)
            to[i] = above[2 * i] + above[2 * i + 1] + below[2 * i] + below[2 * i + 1];
    }
}

static inline void sp_quads_mean(const float pixels[RESAMPLE_PIXELS], float quads[RESAMPLE_QUADS]) {
    sp_quads_sum(pixels, quads);
    for (int i = 0; i < RESAMPLE_QUADS; i++)
        quads[i] *= 0.25f;
}

/* Numbers between the middles of quads down the block: by row of pixels, one for each quad across.
 * Beyond the outer quads their numbers hold. */
struct quad_rows {
    _Alignas(64) float at[RESAMPLE_BLOCK * QUADS_ACROSS + SP_WIDE]; /* as look-ups read */
};

static inline void interpolate_down(const float quads[RESAMPLE_QUADS], struct quad_rows *rows) {
    for (int y = 0; y < RESAMPLE_BLOCK; y++) {
        const int own = y / 2, next = y & 1 ? own + 1 : own - 1;
        const int beside = next < 0 ? 0 : next < QUADS_ACROSS ? next : QUADS_ACROSS - 1;
        for (int i = 0; i < QUADS_ACROSS; i++)
            rows->at[y * QUADS_ACROSS + i] =
                0.75f * quads[own * QUADS_ACROSS + i] + 0.25f * quads[beside * QUADS_ACROSS + i];
    }
}

/* The same across, at SP_WIDE pixels from `begin` on. */
static inline sp_wide interpolate_across(const struct quad_rows *rows, int begin) {
    const float *at = rows->at + (ptrdiff_t)(begin / RESAMPLE_BLOCK * QUADS_ACROSS);
    const sp_wide_int pixel = sp_wide_int_count() + begin % RESAMPLE_BLOCK;
    const sp_wide_int column = pixel & (RESAMPLE_BLOCK - 1), row = (pixel >> 3) * QUADS_ACROSS;
    const sp_wide_int own = column >> 1;
    sp_wide_int next = own + 2 * (column & 1) - 1;
    next += (next >> 31 & 1) - (next >> 2 & 1 & ~(next >> 31)); /* back inside */
    return 0.75f * sp_wide_look_up(at, SP_WIDE, row + own) +
           0.25f * sp_wide_look_up(at, SP_WIDE, row + next);
}

/* Sets where the quads see the interval. */
static inline void open_quads(const struct sp_interval_work *work, struct quads *q) {
    _Alignas(64) float share[RESAMPLE_PIXELS] = { 0 }, seen[RESAMPLE_PIXELS] = { 0 };
    for (int k = 0; k < work->count; k++) {
        const struct sp_interval *in = &work->parts[k];
        const sp_wide own = sp_wide_load(work->light + in->begin) * in->opacity;
        sp_wide_store(share + in->begin, own);
        sp_wide_store(seen + in->begin, own * in->seen);
    }
    sp_quads_sum(share, q->share);
    sp_quads_sum(seen, q->seen);
}

/* Sets the gradient of quads that get light; that of others becomes 0. */
static inline void compute_quad_gradient(const struct sp_interval_work *work,
                                         const struct sp_rays *rays, sp_wide_mask lanes,
                                         struct sp_interval *in) {
    const struct sp_resample *r = work->t->r;
    const sp_wide s = work->start + in->seen * work->width;
    sp_wide smooth[3];
    for (int c = 0; c < 3; c++)
        in->gradient[c] = sp_wide_all(0);
    if (sp_wide_any(lanes))
        sp_fine_gradient(work->t, rays, s, lanes, in->gradient, r->is_smoothed ? smooth : NULL);
    if (r->is_smoothed && sp_wide_any(lanes))
        sp_gradient_mix(smooth, sp_wide_all(r->noise_square), sp_wide_all(r->keep_max), lanes,
                        in->gradient);
    in->square = sp_wide_all(0);
    for (int c = 0; c < 3; c++) {
        in->gradient[c] = sp_wide_keep(lanes, in->gradient[c]);
        in->square += in->gradient[c] * in->gradient[c];
    }
}

/* Lights SP_WIDE quads from number i on. */
static inline void light_quads(const struct sp_interval_work *work, struct quads *q, int i) {
    const struct sp_resample_block *block = work->block;
    const float faint = 1 / 32.0f; /* quads that get less light have no gradient of their own */
    const sp_wide share = sp_wide_load(q->share + i);
    const struct sp_rays rays = { sp_wide_load(block->quad_ray[0] + i),
                                  sp_wide_load(block->quad_ray[1] + i),
                                  sp_wide_load(block->quad_ray[2] + i),
                                  sp_wide_load(block->quad_ray[3] + i) };
    struct sp_interval in = { .begin = i, .opacity = 0.25f * share };
    sp_wide normal[3], to_eye[3], lit[3], shine[3];
    in.seen = sp_wide_load(q->seen + i) * sp_wide_inverse(sp_wide_max(share, sp_wide_all(1e-20f)));
    compute_quad_gradient(work, &rays, sp_wide_lt(sp_wide_all(faint), share), &in);
    compute_normal(work, &in, normal);
    for (int c = 0; c < 3; c++)
        to_eye[c] = sp_wide_load(block->quad_eye[c] + i);
    compute_light(work->t, &rays, work->start + in.seen * work->width, normal, in.square, to_eye,
                  lit, shine);
    const sp_wide weight = share + 1e-6f;
    sp_wide_store(q->share + i, weight);
    sp_wide_store(q->square + i, weight * in.square);
    for (int c = 0; c < 3; c++) {
        sp_wide_store(q->lit[c] + i, weight * lit[c]);
        sp_wide_store(q->shine[c] + i, weight * shine[c]);
    }
}

/* Lights SP_WIDE rays of the interval. rows: weight, lit and shine, and the square of the length of
 * the gradient, all times the weight. */
static inline void light_part(const struct sp_interval_work *work, const struct quad_rows rows[8],
                              struct sp_interval *in) {
    const sp_wide plain[3] = { in->color[0], in->color[1], in->color[2] };
    const sp_wide inverse = sp_wide_fast_inverse(interpolate_across(&rows[0], in->begin));
    for (int c = 0; c < 3; c++)
        in->color[c] = inverse * (plain[c] * interpolate_across(&rows[1 + c], in->begin) +
                                  interpolate_across(&rows[4 + c], in->begin));
    if (!work->block->has_faces)
        return;
    in->square = inverse * interpolate_across(&rows[7], in->begin);
    light_face(work, plain, in);
}

/* Lights all rays of the interval. */
static inline void sp_light_quads(struct sp_interval_work *work) {
    struct quads q;
    struct quad_rows rows[8];
    if (work->count == 0)
        return;
    open_quads(work, &q);
    for (int i = 0; i < RESAMPLE_QUADS; i += SP_WIDE)
        light_quads(work, &q, i);
    interpolate_down(q.share, &rows[0]);
    for (int c = 0; c < 3; c++) {
        interpolate_down(q.lit[c], &rows[1 + c]);
        interpolate_down(q.shine[c], &rows[4 + c]);
    }
    interpolate_down(q.square, &rows[7]);
    for (int k = 0; k < work->count; k++)
        light_part(work, rows, &work->parts[k]);
}

#endif
