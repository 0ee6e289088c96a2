/* SPDX-License-Identifier: Apache-2.0
 *
 * Lights an interval between two sheets: the normal where it is seen, and light by that normal.
 */
#ifndef SP_RESAMPLE_LIT_H
#define SP_RESAMPLE_LIT_H

#include "draw/resample/cut_face.h"
#include "draw/resample/gradient.h"
#include "draw/resample/interval.h"
#include "draw/resample/normal.h"
#include "draw/resample/shares.h"
#include "draw/resample/smooth.h"

/* The unit normal of the interval [world space]; zero if there is none. Behind a surface gradients
 * are small: noise, ringing of the interpolation and rounding would give the material there any
 * normal. So the surface's gradient stays, a quarter as long after each slice. A gradient that is
 * shorter than 0.8 of it, or than rounding, is mixed with it (normal.h). */
static inline void compute_normal(const struct sp_interval_work *work, const struct sp_interval *in,
                                  sp_wide normal[3]) {
    const float share = 0.8f, faint = 64, rounding = work->t->r->rounding;
    struct sp_resample_block *block = work->block;
    const sp_wide one = sp_wide_all(1);
    sp_wide old[3], past[3], dot = sp_wide_all(0), length;
    for (int c = 0; c < 3; c++) {
        old[c] = sp_wide_load(block->normal[c] + in->begin);
        past[c] = old[c] * work->decay;
    }
    sp_wide past_square = past[0] * past[0] + past[1] * past[1] + past[2] * past[2];
    sp_wide least = past_square * (share * share) + rounding * rounding;
    sp_wide firm = sp_wide_min(in->square * sp_wide_inverse(least), one);
    sp_wide weight = sp_wide_min(in->opacity * faint, one); /* what is not seen is no surface */
    length = sp_normal_mix(in->gradient, in->square, past, past_square, firm, normal);
    for (int c = 0; c < 3; c++)
        dot += old[c] * normal[c];
    sp_wide side = sp_wide_copysign(one, dot);
    for (int c = 0; c < 3; c++) {
        old[c] *= side;
        sp_wide_store(block->normal[c] + in->begin,
                      old[c] + weight * (length * normal[c] - old[c]));
    }
}

/* Mixes the smooth gradient at the place where the interval is seen into the fine gradient. Pixels
 * that get little of their light here keep the fine gradient. */
static inline void smooth_gradient(const struct sp_interval_work *work, struct sp_interval *in) {
    const struct sp_resample *r = work->t->r;
    const float faint = 1 / 32.0f; /* share of a pixel's light */
    struct sp_rays rays = sp_load_rays(work->block, in->begin);
    sp_wide share = sp_wide_load(work->light + in->begin) * in->opacity, smooth[3];
    sp_wide_mask lanes = sp_wide_lt(sp_wide_all(faint), share);
    if (!sp_wide_any(lanes))
        return;
    sp_smooth_gradient(work->t, &rays, work->start + in->seen * work->width, lanes, smooth);
    sp_gradient_mix(smooth, sp_wide_all(r->noise_square), sp_wide_all(r->keep_max), lanes,
                    in->gradient);
    const sp_wide *g = in->gradient;
    in->square = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];
}

/* Computes the light at s on rays by a normal: the lit colour is colour · lit + shine. square: of
 * the length of the gradient there. */
static inline void compute_light(const struct sp_resample_open_tile *t, const struct sp_rays *rays,
                                 sp_wide s, const sp_wide normal[3], sp_wide square,
                                 const sp_wide to_eye[3], sp_wide lit[3], sp_wide shine[3]) {
    const struct sp_resample *r = t->r;
    sp_wide share[2];
    if (r->light)
        sp_compute_shares(t, rays, s, normal, square, to_eye, share);
    sp_shade_terms(r->shade, normal, to_eye, r->light ? share : NULL, lit, shine);
}

/* Lights a colour of the interval by a normal. square: of the length of the gradient there. */
static inline void light_color(const struct sp_interval_work *work, const struct sp_interval *in,
                               const sp_wide normal[3], sp_wide square, sp_wide color[3]) {
    struct sp_rays rays = sp_load_rays(work->block, in->begin);
    sp_wide to_eye[3], lit[3], shine[3];
    for (int c = 0; c < 3; c++)
        to_eye[c] = sp_wide_load(work->block->to_eye[c] + in->begin);
    compute_light(work->t, &rays, work->start + in->seen * work->width, normal, square, to_eye, lit,
                  shine);
    for (int c = 0; c < 3; c++)
        color[c] = color[c] * lit[c] + shine[c];
}

/* Mixes in the light of the face of a cut before the interval. plain: the interval's colour before
 * it was lit. */
static inline void light_face(const struct sp_interval_work *work, const sp_wide plain[3],
                              struct sp_interval *in) {
    const sp_wide place = work->start + in->seen * work->width;
    sp_wide face[3], cut[3] = { plain[0], plain[1], plain[2] }, square;
    if (!sp_cut_face_find(work->t->r, work->block, in->begin, place, face, &square))
        return;
    light_color(work, in, face, square, cut);
    sp_wide share = square * sp_wide_inverse(sp_wide_max(square + in->square, sp_wide_all(1e-20f)));
    for (int c = 0; c < 3; c++)
        in->color[c] += share * (cut[c] - in->color[c]);
}

/* Lights the interval's colour by its gradient, and by the face of a cut before it. */
static inline void sp_light_interval(const struct sp_interval_work *work, struct sp_interval *in) {
    const sp_wide plain[3] = { in->color[0], in->color[1], in->color[2] };
    sp_wide normal[3];
    if (work->t->r->is_smoothed)
        smooth_gradient(work, in);
    compute_normal(work, in, normal);
    light_color(work, in, normal, in->square, in->color);
    if (work->block->has_faces)
        light_face(work, plain, in);
}

#endif
