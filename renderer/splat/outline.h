/* SPDX-License-Identifier: Apache-2.0
 *
 * From the place of a kernel in camera space to the outline of its footprint in the image, SP_WIDE
 * kernels at a time. ewa.h has the derivation. For kernel sources only (splat_kernels()).
 */
#ifndef SP_SPLAT_OUTLINE_H
#define SP_SPLAT_OUTLINE_H

#include "splat/ewa_frame.h"
#include "splat/exp2.h"

/* The largest half of a flat rectangle, over the distance of the eye from its centre. */
#define SP_FLAT_NEAR 0.7f

/* Where kernels fade [standard deviations] (sp_place_fade()). */
#define SP_FADE_GONE 1.0f
#define SP_FADE_WHOLE 3.0f

/* Voxels while they are projected, SP_WIDE at a time. */
struct sp_places {
    sp_wide u[3];
    sp_wide kernel[3][3]; /* rows of K */
    sp_wide inv;          /* 1/u2 */
    sp_wide m[2][3];      /* the first two rows of J·K */
    float h2;
};

/* The splats of the projected voxels; fields as in struct sp_splat. */
struct sp_outlines {
    sp_wide x, y, a, b, c, area;
    sp_wide x0, y0, x1, y1; /* whole numbers */
    sp_wide gain;           /* |det J| times the footprint's value at its centre */
};

static inline sp_wide sp_place_clamp(sp_wide x, float bound) {
    const sp_wide low = sp_wide_all(-bound), high = sp_wide_all(bound);
    return sp_wide_select(sp_wide_lt(x, low), low, sp_wide_select(sp_wide_lt(high, x), high, x));
}

/* Computes the first two rows of J·K; returns |det J|. */
static inline sp_wide sp_place_project(const struct sp_ewa_frame *f, struct sp_places *p) {
    if (f->projection == SP_ORTHOGRAPHIC) {
        for (int i = 0; i < 2; i++)
            for (int a = 0; a < 3; a++)
                p->m[i][a] = f->scale * p->kernel[i][a];
        return sp_wide_all(f->scale * f->scale);
    }
    sp_wide fx = f->scale * p->inv, ratio[2];
    for (int i = 0; i < 2; i++) {
        ratio[i] = sp_place_clamp(p->u[i] * p->inv, f->ratio_max[i]);
        for (int a = 0; a < 3; a++)
            p->m[i][a] = fx * (p->kernel[i][a] - ratio[i] * p->kernel[2][a]);
    }
    return fx * fx * sp_wide_sqrt(1 + ratio[0] * ratio[0] + ratio[1] * ratio[1]);
}

static inline sp_wide sp_place_cross(const sp_wide m[2][3]) {
    sp_wide cx = m[0][1] * m[1][2] - m[0][2] * m[1][1];
    sp_wide cy = m[0][2] * m[1][0] - m[0][0] * m[1][2];
    sp_wide cz = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    return cx * cx + cy * cy + cz * cz;
}

/* Computes V̂ + h²I in v = (V00, V01, V11); returns its determinant. */
static inline sp_wide sp_place_variance(const sp_wide m[2][3], float h2, sp_wide v[3]) {
    sp_wide v00 = m[0][0] * m[0][0] + m[0][1] * m[0][1] + m[0][2] * m[0][2];
    sp_wide v11 = m[1][0] * m[1][0] + m[1][1] * m[1][1] + m[1][2] * m[1][2];
    v[0] = v00 + h2;
    v[1] = m[0][0] * m[1][0] + m[0][1] * m[1][1] + m[0][2] * m[1][2];
    v[2] = v11 + h2;
    return sp_place_cross(m) + h2 * (v00 + v11) + h2 * h2;
}

/* Swan et al. (1997), section 4.3: scales both axes of m by one factor, so that the smaller
 * variance of V̂ is at least h². */
static inline void sp_place_widen(sp_wide m[2][3], float h2) {
    sp_wide v[3], det = sp_place_variance((const sp_wide(*)[3])m, 0, v),
                  half = 0.5f * (v[0] + v[2]);
    sp_wide apart = sp_wide_sqrt(0.25f * (v[0] - v[2]) * (v[0] - v[2]) + v[1] * v[1]);
    sp_wide smaller = det / (half + apart); /* half − apart would lose its digits by cancellation */
    sp_wide_mask is_small = sp_wide_lt(smaller, sp_wide_all(h2));
    sp_wide scale = sp_wide_sqrt(h2 / sp_wide_max(smaller, sp_wide_all(1e-12f * h2)));
    scale = sp_wide_select(is_small, scale, sp_wide_all(1));
    for (int i = 0; i < 2; i++)
        for (int a = 0; a < 3; a++)
            m[i][a] *= scale;
}

/* Computes the variance of the footprint for the filter mode; returns its determinant. Sets p->h2
 * to the part of the variance that the low-pass filter adds. */
static inline sp_wide sp_place_filter(const struct sp_ewa_frame *f, enum sp_filter_mode mode,
                                      struct sp_places *p, sp_wide v[3]) {
    p->h2 = f->lowpass2;
    switch (mode) {
    case SP_FILTER_LOWPASS:
        v[0] = v[2] = sp_wide_all(p->h2);
        v[1] = sp_wide_all(0);
        return sp_wide_all(p->h2 * p->h2);
    case SP_FILTER_SWAN:
        sp_place_widen(p->m, p->h2);
        p->h2 = SP_VARIANCE_MIN;
        break;
    case SP_FILTER_RECONSTRUCTION:
    case SP_FILTER_NONE:
        p->h2 = SP_VARIANCE_MIN;
        break;
    case SP_FILTER_EWA:
    case SP_FILTER_ADAPTIVE:
        break;
    }
    return sp_place_variance((const sp_wide(*)[3])p->m, p->h2, v);
}

static inline sp_wide sp_place_ceiling(sp_wide x) {
    return -sp_wide_floor(-x);
}

/* Computes the half-open range of the pixels in [low, high) whose centres lie within ±reach of x.
 * False if the range is empty or a value is not a number. */
static inline sp_wide_mask sp_place_cover(sp_wide x, sp_wide reach, int low, int high,
                                          sp_wide *begin, sp_wide *end) {
    *begin = sp_place_ceiling(sp_wide_clamp(x - reach + 0.5f - 1, low, high));
    *end = sp_wide_floor(sp_wide_clamp(x + reach + 0.5f, low, high));
    return sp_wide_lt(*begin, *end);
}

/* Like sp_place_cover() for centres in [x − reach, x + reach): a width of one pixel contains
 * exactly one centre. */
static inline sp_wide_mask sp_place_cover_flat(sp_wide x, sp_wide reach, int low, int high,
                                               sp_wide *begin, sp_wide *end) {
    *begin = sp_place_ceiling(sp_wide_clamp(x - reach - 0.5f, low, high));
    *end = sp_place_ceiling(sp_wide_clamp(x + reach - 0.5f, low, high));
    return sp_wide_lt(*begin, *end);
}

/* The largest half of a flat rectangle [px]: a share of the distance of the eye, and the distance
 * from the near plane. So no rectangle covers the image, and none vanishes at once. */
static inline sp_wide sp_outline_limit(const struct sp_ewa_frame *f, const struct sp_places *p) {
    const sp_wide away = sp_wide_sqrt(p->u[0] * p->u[0] + p->u[1] * p->u[1] + p->u[2] * p->u[2]);
    const sp_wide beyond = sp_wide_max(p->u[2] - f->near, sp_wide_all(0));
    return f->scale * p->inv * sp_wide_min(SP_FLAT_NEAR * away, beyond);
}

/* Flat rectangles are 1.6 voxels wide, less close to the eye, and at least one pixel, so that a
 * small rectangle covers exactly the nearest pixel. */
static inline sp_wide_mask sp_outline_flat(const struct sp_ewa_frame *f, const struct sp_places *p,
                                           const sp_wide v[3], struct sp_outlines *o) {
    const sp_wide pixel = sp_wide_all(0.5f);
    sp_wide rx = sp_wide_max(f->flat * sp_wide_sqrt(v[0]), pixel);
    sp_wide ry = sp_wide_max(f->flat * sp_wide_sqrt(v[2]), pixel);
    o->a = o->b = o->c = sp_wide_all(0);
    o->area = 4 * rx * ry;
    o->gain *= 1 / o->area;
    if (f->projection == SP_PERSPECTIVE) {
        const sp_wide limit = sp_wide_max(sp_outline_limit(f, p), pixel);
        rx = sp_wide_min(rx, limit);
        ry = sp_wide_min(ry, limit);
        o->area = 4 * rx * ry;
    }
    return sp_place_cover_flat(o->y, ry, f->rows[0], f->rows[1], &o->y0, &o->y1) &
           sp_place_cover_flat(o->x, rx, 0, f->size[0], &o->x0, &o->x1);
}

static inline sp_wide_mask sp_outline_ellipse(const struct sp_ewa_frame *f, const sp_wide v[3],
                                              sp_wide det, struct sp_outlines *o) {
    sp_wide rx = f->radius * sp_wide_sqrt(v[0]), ry = f->radius * sp_wide_sqrt(v[2]);
    sp_wide root = sp_wide_sqrt(det), half = 0.5f * SP_LOG2E / det;
    o->a = half * v[2];
    o->b = -2 * half * v[1];
    o->c = half * v[0];
    o->area = (float)M_PI * f->radius * f->radius * root;
    o->gain = o->gain * f->peak / root;
    return sp_place_cover(o->y, ry, f->rows[0], f->rows[1], &o->y0, &o->y1) &
           sp_place_cover(o->x, rx, 0, f->size[0], &o->x0, &o->x1);
}

/* Projects the kernels and their centres. Returns the lanes whose centre lies beyond the near
 * plane, as seen from the eye. */
static inline sp_wide_mask sp_place_centres(const struct sp_ewa_frame *f, struct sp_places *p,
                                            struct sp_outlines *o) {
    p->inv = f->projection == SP_ORTHOGRAPHIC ? sp_wide_all(1) : 1 / p->u[2];
    o->x = f->centre[0] + f->scale * (p->u[0] * p->inv);
    o->y = f->centre[1] + f->scale * (p->u[1] * p->inv);
    o->gain = sp_place_project(f, p);
    return sp_wide_le(sp_wide_all(f->near), p->u[2]) & sp_wide_lt(p->u[2], sp_wide_all(1e18f));
}

/* Computes the geometry of splats, but not their colours and depths. Returns the lanes whose splat
 * touches the rows that are being drawn. */
static inline sp_wide_mask sp_place_splats(const struct sp_ewa_frame *f, struct sp_places *p,
                                           enum sp_filter_mode mode, struct sp_outlines *o) {
    sp_wide v[3];
    sp_wide_mask seen = sp_place_centres(f, p, o);
    sp_wide det = sp_place_filter(f, mode, p, v);
    seen &= sp_wide_lt(det, sp_wide_all(1e36f));
    seen &= mode == SP_FILTER_NONE ? sp_outline_flat(f, p, v, o) : sp_outline_ellipse(f, v, det, o);
    return seen & sp_wide_lt(sp_wide_all(0), o->gain);
}

/* Affine footprints of kernels that the plane of the eye cuts would cover the image. Therefore they
 * fade with the depth of their centre: from SP_FADE_WHOLE standard deviations before the eye, where
 * all of them is drawn, to none at SP_FADE_GONE. deep2: variance of the depth. */
static inline sp_wide sp_place_fade(const struct sp_ewa_frame *f, sp_wide u2, sp_wide deep2) {
    const float scale = 1 / (SP_FADE_WHOLE - SP_FADE_GONE);
    if (f->projection == SP_ORTHOGRAPHIC)
        return sp_wide_all(1);
    sp_wide t = sp_wide_clamp(scale * (u2 / sp_wide_sqrt(deep2) - SP_FADE_GONE), 0, 1);
    return t * t * (3 - 2 * t);
}

/* Computes the unit vectors towards the eye, in camera space. */
static inline void sp_place_eye(const struct sp_ewa_frame *f, const sp_wide u[3],
                                sp_wide to_eye[3]) {
    if (f->projection == SP_ORTHOGRAPHIC) {
        to_eye[0] = to_eye[1] = sp_wide_all(0);
        to_eye[2] = sp_wide_all(-1);
        return;
    }
    sp_wide inv = -1 / sp_wide_sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    for (int r = 0; r < 3; r++)
        to_eye[r] = u[r] * inv;
}

#endif
