/* SPDX-License-Identifier: Apache-2.0
 *
 * The texture of a layer of vectors: rows of streaks along the projected vector, which move with
 * the phase (Crawfis and Max 1993, figure 3). The paper stores the texture in tables by phase and
 * foreshortening. Here it is a formula, so that both are continuous and close-ups are sharp. For
 * kernel sources only.
 *
 *   (along, across) = place in standard deviations of the footprint
 *   row   = nearest row of streaks           rows are ROW apart, shifted at random
 *   u     = along · periods − phase + row·golden ratio
 *   I     = bump(u) · bump(distance to the row),    bump(x) = (1 − (2x/w)²)² where positive
 *
 * I has the mean MEAN over the plane, for every phase and foreshortening, and the pattern is
 * 1 + contrast · (I/MEAN − 1): its mean is 1, so a layer of vectors is as opaque as the same
 * samples without streaks. The contrast falls where rows are narrower than two pixels.
 *
 * Foreshortening: the period is a length along the vector, so its projection shortens with the
 * vector, down to a third of a standard deviation, where streaks are dots.
 */
#ifndef SP_SPLAT_LIST_STREAK_H
#define SP_SPLAT_LIST_STREAK_H

#include "draw/layers/splat_list/kernels.h"
#include "splat/outline.h"

#define SP_STREAK_ROW 1.0f   /* distance of rows, standard deviations across the vector */
#define SP_STREAK_WIDTH 0.8f /* of a streak, in distances of rows */
#define SP_STREAK_SHARE 0.7f /* length of a streak, in periods */
#define SP_STREAK_SHORTEST 0.33f
/* Mean of I: each bump has the mean 8/15 of its width. */
#define SP_STREAK_MEAN ((8.0f / 15) * (8.0f / 15) * SP_STREAK_WIDTH * SP_STREAK_SHARE)

/* Splats of a layer of vectors, SP_WIDE at a time. */
struct sp_streak_places {
    sp_wide place[4]; /* a, b, c, d of the record */
    sp_wide periods, contrast;
};

/* Projects a direction in camera space like a column of J·K [px per cell]. */
static inline void sp_streak_project(const struct sp_ewa_frame *f, const struct sp_places *p,
                                     const sp_wide direction[3], sp_wide e[2]) {
    for (int i = 0; i < 2; i++) {
        if (f->projection == SP_ORTHOGRAPHIC) {
            e[i] = f->scale * direction[i];
        } else {
            sp_wide ratio = sp_place_clamp(p->u[i] * p->inv, f->ratio_max[i]);
            e[i] = f->scale * p->inv * (direction[i] - ratio * direction[2]);
        }
    }
}

/* Turns the footprint of variance v and its vector e into the map from pixels to the pattern:
 * v = L·Lᵀ, and the map is L⁻¹, turned so that the vector lies along its first axis. */
static inline void sp_streak_orient(const sp_wide v[3], const sp_wide e[2], sp_wide length,
                                    struct sp_streak_places *s) {
    const sp_wide tiny = sp_wide_all(1e-12f);
    sp_wide l00 = 1 / sp_wide_sqrt(v[0]), l10 = v[1] * l00;
    sp_wide l11 = 1 / sp_wide_sqrt(sp_wide_max(v[2] - l10 * l10, tiny));
    l10 = -l10 * l00 * l11;
    sp_wide along = l00 * e[0], across = l10 * e[0] + l11 * e[1];
    sp_wide size = sp_wide_sqrt(along * along + across * across);
    sp_wide_mask is_side = sp_wide_lt(tiny, size);
    sp_wide inverse = 1 / sp_wide_max(size, tiny);
    sp_wide cosine = sp_wide_select(is_side, along * inverse, sp_wide_all(1));
    sp_wide sine = sp_wide_keep(is_side, across * inverse);
    s->place[0] = cosine * l00 + sine * l10;
    s->place[1] = sine * l11;
    s->place[2] = cosine * l10 - sine * l00;
    s->place[3] = cosine * l11;
    s->periods = 1 / sp_wide_max(length * size, sp_wide_all(SP_STREAK_SHORTEST));
    /* Rows and streaks narrower than one pixel vanish. */
    sp_wide step = sp_wide_sqrt(s->place[2] * s->place[2] + s->place[3] * s->place[3]);
    sp_wide rows = SP_STREAK_ROW / sp_wide_max(step, tiny) - 1;
    s->contrast = sp_wide_clamp(rows, 0, 1);
}

/* Like sp_place_splats() of filter mode EWA, for kernels that are stretched along a direction in
 * camera space, which is a unit vector or 0. sigma: standard deviation along it [cells]. */
static inline sp_wide_mask sp_streak_place(const struct sp_ewa_frame *f,
                                           const struct sp_streaks *streaks, struct sp_places *p,
                                           const sp_wide direction[3], sp_wide sigma,
                                           struct sp_outlines *o, struct sp_streak_places *s) {
    sp_wide v[3], e[2], widen = streaks->widen * sigma * sigma;
    sp_wide_mask seen = sp_place_centres(f, p, o);
    sp_wide det = sp_place_filter(f, SP_FILTER_EWA, p, v);
    sp_streak_project(f, p, direction, e);
    /* det(V + t·e·eᵀ) = det V + t·(V11·e0² − 2·V01·e0·e1 + V00·e1²) */
    det += widen * (v[2] * e[0] * e[0] - 2 * v[1] * e[0] * e[1] + v[0] * e[1] * e[1]);
    v[0] += widen * e[0] * e[0];
    v[1] += widen * e[0] * e[1];
    v[2] += widen * e[1] * e[1];
    sp_streak_orient(v, e, streaks->length * sigma, s);
    sp_wide deep2 = widen * direction[2] * direction[2];
    for (int a = 0; a < 3; a++)
        deep2 += p->kernel[2][a] * p->kernel[2][a];
    o->gain *= sp_place_fade(f, p->u[2], deep2);
    seen &= sp_wide_lt(det, sp_wide_all(1e36f)) & sp_outline_ellipse(f, v, det, o);
    return seen & sp_wide_lt(sp_wide_all(0), o->gain);
}

/* Removes the pattern of samples without a direction. In style modulate, such samples have no
 * splat. Returns the remaining splats. */
static inline sp_wide_mask sp_streak_keep_moving(const struct sp_streaks *streaks,
                                                 sp_wide_mask seen, sp_wide_mask moves,
                                                 struct sp_streak_places *s) {
    s->contrast = sp_wide_keep(moves, s->contrast);
    return streaks->blends ? seen : seen & moves;
}

/* Completes the records of the splats in `bits`. phases: the phases of the samples [65536ths]. */
static inline void sp_streak_write(const struct sp_streaks *streaks, const uint16_t phases[SP_WIDE],
                                   const struct sp_streak_places *s, unsigned bits,
                                   struct sp_voxel_record *r) {
    const unsigned moved = (unsigned)(streaks->phase * 65536);
    for (; bits; bits &= bits - 1, r++) {
        int i = __builtin_ctz(bits);
        r->a = s->place[0][i];
        r->b = s->place[1][i];
        r->c = s->place[2][i];
        r->d = s->place[3][i];
        r->periods = s->periods[i];
        r->contrast = (uint8_t)(s->contrast[i] * 255 + 0.5f);
        r->shift = (uint8_t)(phases[i] * 40503u >> 8);
        r->phase = (uint16_t)(phases[i] + moved);
    }
}

/* Returns x minus the nearest whole number and sets *whole to this number; |x| < 2^22. */
static inline sp_wide sp_streak_part(sp_wide x, sp_wide *whole) {
    const float round_up = 12582912.0f; /* 1.5·2^23: adding it leaves an integer */
    *whole = (x + round_up) - round_up;
    return x - *whole;
}

/* (1 − (x/half)²)² where positive. */
static inline sp_wide sp_streak_bump(sp_wide x, float half) {
    sp_wide y = sp_wide_max(1 - x * x * (1 / (half * half)), sp_wide_all(0));
    return y * y;
}

/* Returns I of pixels at (along, across). */
static inline sp_wide sp_streak_intensity(const struct sp_voxel_record *r, sp_wide along,
                                          sp_wide across) {
    sp_wide row, unused;
    sp_wide beside =
        sp_streak_part(across * (1 / SP_STREAK_ROW) + (float)r->shift * (1.0f / 256), &row);
    sp_wide u = along * r->periods - (float)r->phase * (1.0f / 65536) + row * 0.61803399f;
    return sp_streak_bump(sp_streak_part(u, &unused), 0.5f * SP_STREAK_SHARE) *
           sp_streak_bump(beside, 0.5f * SP_STREAK_WIDTH);
}

#endif
