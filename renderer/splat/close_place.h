/* SPDX-License-Identifier: Apache-2.0
 *
 * Sets up the footprints of kernels close to the eye. Few kernels are, so they are set up one by
 * one, in double precision. close.h has the formulas. For kernel sources only.
 */
#ifndef SP_SPLAT_CLOSE_PLACE_H
#define SP_SPLAT_CLOSE_PLACE_H

#include <math.h>

#include "splat/close_kernel.h"
#include "splat/outline.h"

/* The lanes whose kernels may be close and may reach into the image, also from behind the near
 * plane. radius: of the largest footprint [standard deviations]; h2: of the low-pass filter. */
static inline sp_wide_mask sp_close_select(const struct sp_ewa_frame *f, const struct sp_places *p,
                                           float radius, float h2) {
    const float r2 = 1.01f * radius * radius, px2 = h2 / (f->scale * f->scale);
    const sp_wide depth = sp_wide_max(p->u[2], sp_wide_all(0)), before = f->near - p->u[2];
    sp_wide size = sp_wide_all(0);
    if (f->projection == SP_ORTHOGRAPHIC)
        return sp_wide_first(0);
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            size += p->kernel[r][a] * p->kernel[r][a];
    sp_wide_mask close =
        sp_wide_lt(depth * depth, SP_CLOSE_AFFINE * SP_CLOSE_AFFINE / 3 * size) &
        (sp_wide_lt(before, sp_wide_all(0)) | sp_wide_le(before * before, r2 * size));
    for (int i = 0; i < 2 && sp_wide_any(close); i++) {
        const float right = (float)f->size[i] - f->centre[i];
        const float slope = (f->centre[i] > right ? f->centre[i] : right) / f->scale;
        const float stretch = 1 + f->ratio_max[i] * f->ratio_max[i];
        const sp_wide beside = sp_wide_abs(p->u[i]) - slope * p->u[2];
        const sp_wide reach2 = r2 * (stretch * size + px2 * p->u[2] * p->u[2]);
        close &= sp_wide_le(beside, sp_wide_all(0)) | sp_wide_le(beside * beside, reach2);
    }
    return close;
}

static inline void sp_close_measure(const struct sp_ewa_frame *f, const struct sp_places *p,
                                    int lane, float h2, struct sp_close_kernel *k) {
    double u[3], kernel[3][3];
    for (int r = 0; r < 3; r++) {
        u[r] = (double)p->u[r][lane];
        for (int a = 0; a < 3; a++)
            kernel[r][a] = (double)p->kernel[r][a][lane];
    }
    sp_close_kernel_init(k, u, (const double(*)[3])kernel,
                         (double)h2 / ((double)f->scale * (double)f->scale));
}

/* Computes which X = u_i/u2 see the ellipsoid of radius r around the centre, from its silhouette
 * r²Σ − u uᵀ. The ellipsoid reaches beyond the plane of the eye, u2 = 0. */
static inline void sp_close_range(const struct sp_close_kernel *k, int i, double r,
                                  double range[2]) {
    const double u0 = k->u[i], u2 = k->u[2], v0 = k->v[i][i], v2 = k->v[2][2], v = k->v[i][2];
    const double r2 = r * r, last = r2 * v2 - u2 * u2;
    const double root =
        r2 * (v0 * u2 * u2 - 2 * v * u0 * u2 + v2 * u0 * u0 - r2 * (v0 * v2 - v * v));
    const double wide = sqrt(root > 0 ? root : 0);
    range[0] = -INFINITY;
    range[1] = INFINITY;
    if (last < 0) { /* all of it does */
        const double at = u0 / u2, middle = r2 * (v * u2 - v2 * u0) / (u2 * last);
        range[0] = at + middle + wide / last;
        range[1] = at + middle - wide / last;
    } else if (root > 0 && last > 0) {
        const double low = (r2 * v - u0 * u2 - wide) / last;
        const double high = (r2 * v - u0 * u2 + wide) / last;
        const double ahead = (u0 + r * v / sqrt(v2)) / (u2 + r * sqrt(v2));
        if (ahead >= high)
            range[0] = high;
        else if (ahead <= low)
            range[1] = low;
    }
}

/* False if the ellipsoid of radius r lies outside of the image. */
static inline bool sp_close_is_seen(const struct sp_ewa_frame *f, const struct sp_close_kernel *k,
                                    double r) {
    if (k->u[2] + r * sqrt(k->v[2][2]) < (double)f->near)
        return false;
    for (int side = 0; side < 4; side++) {
        const int i = side / 2;
        const double border = side % 2 ? f->size[i] : 0, sign = side % 2 ? -1 : 1;
        const double slope = (border - (double)f->centre[i]) / (double)f->scale;
        const double inside = sign * (k->u[i] - slope * k->u[2]);
        const double variance = k->v[i][i] - 2 * slope * k->v[i][2] + slope * slope * k->v[2][2];
        if (inside < 0 && inside * inside > r * r * variance)
            return false;
    }
    return true;
}

/* Sets the pixels that a range of X covers. False if there are none. */
static inline bool sp_close_cover(const struct sp_ewa_frame *f, int i, const double range[2],
                                  int low, int high, float *begin, float *end) {
    const double scale = (double)f->scale, centre = (double)f->centre[i];
    const double first = ceil(centre + scale * range[0] - 0.5);
    const double last = floor(centre + scale * range[1] + 0.5);
    *begin = (float)(first > low ? first < high ? first : high : low);
    *end = (float)(last < high ? last > low ? last : low : high);
    return *begin < *end;
}

/* Sets the box of a footprint. False if it covers no pixel. */
static inline bool sp_close_set_box(const struct sp_ewa_frame *f, const double range[2][2],
                                    int lane, struct sp_outlines *o) {
    float begin[2], end[2];
    const bool is_wide = sp_close_cover(f, 0, range[0], 0, f->size[0], &begin[0], &end[0]);
    const bool is_high = sp_close_cover(f, 1, range[1], f->rows[0], f->rows[1], &begin[1], &end[1]);
    o->x0[lane] = begin[0];
    o->x1[lane] = end[0];
    o->y0[lane] = begin[1];
    o->y1[lane] = end[1];
    return is_wide && is_high;
}

/* Sets the affine footprint of a kernel aside, by the Jacobian for x = u0/u2 and y = u1/u2. */
static inline void sp_close_place_aside(const struct sp_ewa_frame *f,
                                        const struct sp_close_kernel *k, double x, double y,
                                        int lane, struct sp_outlines *o) {
    const double scale = (double)f->scale / k->u[2];
    const double xx = k->v[0][0] - 2 * x * k->v[0][2] + x * x * k->v[2][2];
    const double xy = k->v[0][1] - x * k->v[1][2] - y * k->v[0][2] + x * y * k->v[2][2];
    const double yy = k->v[1][1] - 2 * y * k->v[1][2] + y * y * k->v[2][2];
    const double det = xx * yy - xy * xy, half = 0.5 * (double)SP_LOG2E / (det * scale * scale);
    o->a[lane] = (float)(half * yy);
    o->b[lane] = (float)(-2 * half * xy);
    o->c[lane] = (float)(half * xx);
    o->gain[lane] = (float)((double)f->peak * sqrt((1 + x * x + y * y) / det));
}

/* Computes which X = u_i/u2 a kernel aside covers, from its centre on: p/D is at most ½·log2 e·r²
 * inside the ellipse √p ≤ R·(1 + w·more·δ). */
static inline void sp_close_range_aside(const struct sp_ewa_frame *f,
                                        const struct sp_close_kernel *k, double r, double w,
                                        const struct sp_outlines *o, int lane,
                                        const struct sp_close *to, double range[2][2]) {
    const double a = (double)o->a[lane], b = 0.5 * (double)o->b[lane], c = (double)o->c[lane];
    const double det = a * c - b * b, own[2] = { c / det, a / det };
    const double h[2] = { w * (double)to->more[0], w * (double)to->more[1] };
    const double slope[2] = { own[0] * h[0] - b / det * h[1], own[1] * h[1] - b / det * h[0] };
    const double r2 = 0.5 * (double)SP_LOG2E * r * r / (1 - r * r * w * w / k->square);
    const double left = 1 - r2 * (slope[0] * h[0] + slope[1] * h[1]);
    for (int i = 0; i < 2; i++) {
        const double middle = r2 * slope[i] / left;
        const double wide = left > 0 ? sqrt(r2 / left * own[i] + middle * middle) : INFINITY;
        range[i][0] = k->u[i] / k->u[2] + (left > 0 ? middle - wide : -wide) / (double)f->scale;
        range[i][1] = k->u[i] / k->u[2] + (left > 0 ? middle + wide : wide) / (double)f->scale;
    }
}

static inline bool sp_close_place_ahead(const struct sp_ewa_frame *f,
                                        const struct sp_close_kernel *k, double r, double share,
                                        bool is_aside, int lane, struct sp_outlines *o,
                                        struct sp_close *to) {
    const double slope = k->u[2] / ((double)f->scale * k->square);
    const int stored = (int)(32767 * share + 0.5);
    const double w = stored / 32767.0;
    double range[2][2];
    to->kind = (uint16_t)(SP_CLOSE_AHEAD | stored);
    to->square = sp_close_store((float)k->square);
    if (is_aside)
        sp_close_place_aside(f, k, sp_close_ratio(k, 0, (double)f->ratio_max[0], w),
                             sp_close_ratio(k, 1, (double)f->ratio_max[1], w), lane, o);
    for (int i = 0; i < 2; i++) {
        const double at = k->u[i] / k->u[2];
        to->more[i] = (float)(slope * k->su[i]);
        sp_close_range(k, i, w * r, range[i]);
        for (int side = 0; side < 2; side++)
            range[i][side] = at + (range[i][side] - at) / w;
    }
    if (is_aside && w < 1)
        sp_close_range_aside(f, k, r, w, o, lane, to, range);
    return sp_close_set_box(f, (const double(*)[2])range, lane, o);
}

static inline bool sp_close_place_around(const struct sp_ewa_frame *f,
                                         const struct sp_close_kernel *k, double r, int lane,
                                         struct sp_outlines *o, struct sp_close *to) {
    const double inverse = 1 / k->s[2][2], root = sqrt(inverse);
    double range[2][2] = { { -INFINITY, INFINITY }, { -INFINITY, INFINITY } };
    to->kind = sp_close_around((float)((double)f->near / root));
    to->square = sp_close_store((float)k->square);
    o->a[lane] = (float)(k->s[0][0] * inverse);
    o->b[lane] = (float)(2 * k->s[0][1] * inverse);
    o->c[lane] = (float)(k->s[1][1] * inverse);
    o->x[lane] = (float)(2 * k->s[0][2] * inverse);
    o->y[lane] = (float)(2 * k->s[1][2] * inverse);
    for (int i = 0; i < 2; i++)
        to->more[i] = (float)(k->su[i] * root);
    o->area[lane] = (float)(k->su[2] * root);
    o->gain[lane] = (float)((double)f->peak * root / sqrt(k->det) * sp_close_fold(k, to));
    for (int i = 0; i < 2 && k->square > r * r; i++)
        sp_close_range(k, i, r, range[i]);
    return sp_close_is_seen(f, k, r) && sp_close_set_box(f, (const double(*)[2])range, lane, o);
}

/* Changes the outline of a kernel that may be close, whose footprint has the radius r, and sets
 * *to. Returns whether it is drawn: `seen` if it is not close. */
static inline bool sp_close_place(const struct sp_ewa_frame *f, const struct sp_close_kernel *k,
                                  double r, bool is_integral, bool seen, int lane,
                                  struct sp_outlines *o, struct sp_close *to) {
    const double most[2] = { (double)f->ratio_max[0], (double)f->ratio_max[1] }, least = r + 1;
    const bool is_aside = fabs(k->u[0]) > most[0] * k->u[2] || fabs(k->u[1]) > most[1] * k->u[2];
    const double w = sp_close_share(k, is_integral);
    const double first = k->u[2] - (w < 1 ? 0 : r * sqrt(k->v[2][2]));
    const bool is_ahead = first >= (double)f->near && k->square >= least * least;
    to->kind = SP_CLOSE_FAR;
    if (!(w > SP_CLOSE_LEAST) || (!is_ahead && w < 1))
        return seen;
    return is_ahead ? sp_close_place_ahead(f, k, r, w, is_aside, lane, o, to)
                    : sp_close_place_around(f, k, r, lane, o, to);
}

/* The same for the lanes `close`. Not inline, because few loops come here. */
static __attribute__((noinline)) unsigned
sp_close_place_lanes(const struct sp_ewa_frame *f, const struct sp_places *p, unsigned close,
                     unsigned seen, struct sp_outlines *o, struct sp_close to[SP_WIDE]) {
    for (; close; close &= close - 1) {
        const int i = __builtin_ctz(close);
        const unsigned bit = 1u << i;
        struct sp_close_kernel k;
        sp_close_measure(f, p, i, p->h2, &k);
        const bool is_seen =
            sp_close_place(f, &k, (double)f->radius, true, seen & bit, i, o, &to[i]);
        seen = is_seen ? seen | bit : seen & ~bit;
    }
    return seen;
}

/* Changes the outlines of close kernels. `seen`: lanes that are drawn if they are not close;
 * returns which lanes are drawn. *close: the lanes for which to[] is set. */
static inline unsigned sp_close_place_all(const struct sp_ewa_frame *f, const struct sp_places *p,
                                          unsigned seen, struct sp_outlines *o, unsigned *close,
                                          struct sp_close to[SP_WIDE]) {
    const sp_wide_mask lanes = sp_close_select(f, p, f->radius, p->h2);
    *close = 0;
    if (!sp_wide_any(lanes))
        return seen;
    *close = sp_wide_mask_bits(lanes);
    return sp_close_place_lanes(f, p, *close, seen, o, to);
}

#endif
