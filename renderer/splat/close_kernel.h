/* SPDX-License-Identifier: Apache-2.0
 *
 * One kernel close to the eye, in double precision. close.h has the formulas.
 */
#ifndef SP_SPLAT_CLOSE_KERNEL_H
#define SP_SPLAT_CLOSE_KERNEL_H

#include <math.h>

#include "splat/close.h"

/* Kernels with a smaller share stay affine. */
#define SP_CLOSE_LEAST 1e-3

/* One kernel. */
struct sp_close_kernel {
    double u[3], v[3][3];       /* Σ */
    double s[3][3], det, su[3]; /* S; det Σ; S u */
    double square;              /* ρ² */
    double size;                /* trace of Σ without the filter */
    double own;                 /* without the low-pass filter: ρ²·det Σ */
};

/* The transposed cofactors of a symmetric matrix; returns its determinant. */
static inline double sp_close_invert(const double v[3][3], double s[3][3]) {
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            const int r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
            s[r][c] = v[r1][c1] * v[r2][c2] - v[r1][c2] * v[r2][c1];
        }
    return v[0][0] * s[0][0] + v[0][1] * s[0][1] + v[0][2] * s[0][2];
}

static inline double sp_close_form(const double s[3][3], const double u[3]) {
    double sum = 0;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            sum += s[r][c] * u[r] * u[c];
    return sum;
}

/* u: the centre; kernel: rows of K; filter2: variance of the low-pass filter at the depth 1. */
static inline void sp_close_kernel_init(struct sp_close_kernel *k, const double u[3],
                                        const double kernel[3][3], double filter2) {
    k->size = k->square = 0;
    for (int r = 0; r < 3; r++) {
        k->u[r] = u[r];
        for (int c = 0; c < 3; c++)
            k->v[r][c] = kernel[r][0] * kernel[c][0] + kernel[r][1] * kernel[c][1] +
                         kernel[r][2] * kernel[c][2];
        k->size += k->v[r][r];
    }
    for (int r = 0; r < 3; r++) /* flat kernels get a thousandth of their size: Σ has an inverse */
        k->v[r][r] += 1e-6 * k->size;
    sp_close_invert((const double(*)[3])k->v, k->s);
    k->own = sp_close_form((const double(*)[3])k->s, k->u);
    for (int r = 0; r < 2; r++)
        k->v[r][r] += filter2 * u[2] * u[2];
    k->det = sp_close_invert((const double(*)[3])k->v, k->s);
    for (int r = 0; r < 3; r++) {
        k->su[r] = 0;
        for (int c = 0; c < 3; c++) {
            k->s[r][c] /= k->det;
            k->su[r] += k->s[r][c] * u[c];
        }
        k->square += u[r] * k->su[r];
    }
}

/* e^{(s − ρ²)/2}, where s is ρ² as stored. */
static inline double sp_close_fold(const struct sp_close_kernel *k, const struct sp_close *to) {
    return exp(0.5 * ((double)sp_close_square(to->square) - k->square));
}

/* The share w of a kernel. The depth of the centre decides, not its distance, because the error of
 * the affine map grows with both the size over the distance and the tangent of the angle from the
 * axis of the view; so kernels beside the eye are exact at any distance. Flat trained kernels that
 * face the image are never close, because the affine map is exact for a plane; but integrals
 * through them are not. */
static inline double sp_close_share(const struct sp_close_kernel *k, bool is_integral) {
    const double exact = (double)SP_CLOSE_EXACT, affine = (double)SP_CLOSE_AFFINE;
    const double depth = fmax(k->u[2], 0);
    double distance = depth * sqrt(3 / k->size);
    if (!is_integral)
        distance = (double)SP_CLOSE_TRAINED * fmax(distance, depth / sqrt(k->v[2][2]));
    const double w = fmax(fmin((affine - distance) / (affine - exact), 1), 0);
    return w * w * (3 - 2 * w);
}

/* u_i/u2 in the Jacobian of the affine map: limited (ewa.h) where w is 0, and less so the more it
 * is exact. */
static inline double sp_close_ratio(const struct sp_close_kernel *k, int i, double ratio_max,
                                    double share) {
    const double ratio = k->u[i] / k->u[2], limited = fmax(fmin(ratio, ratio_max), -ratio_max);
    return limited + share * (ratio - limited);
}

#endif
