/* SPDX-License-Identifier: Apache-2.0
 *
 * The normal distribution in single precision, without calls and branches.
 */
#ifndef SP_SPLAT_NORMAL_H
#define SP_SPLAT_NORMAL_H

#include "splat/exp2.h"

/* Φ(x) = ∫_{−∞}^x of the standard normal density. Absolute error under 3e-7 (Abramowitz & Stegun,
 * Handbook of Mathematical Functions, 7.1.26). */
static inline float sp_normal_share(float x) {
    float z = (x < 0 ? -x : x) * 0.707106781f; /* erfc(z)/2 of the tail */
    float t = 1 / (1 + 0.3275911f * z);
    float p =
        t * (0.254829592f +
             t * (-0.284496736f + t * (1.421413741f + t * (-1.453152027f + t * 1.061405429f))));
    float tail = 0.5f * p * sp_exp2(-SP_LOG2E * z * z);
    return x < 0 ? tail : 1 - tail;
}

#ifdef SP_ISA
/* Φ(x) for SP_WIDE values at a time, without a division: ½ plus x times a polynomial of x² through
 * the values at the Chebyshev nodes of [0, 4.25²]. Absolute error under 3e-5; beyond ±4.25 the
 * result is 0 or 1. */
static inline sp_wide sp_wide_normal_share(sp_wide x) {
    static const float c[] = { 0.398942292f,    -0.0664650947f,  0.00991185289f,
                               -0.00114135689f, 9.92450659e-05f, -6.20723813e-06f,
                               2.58326139e-07f, -6.3066552e-09f, 6.76677187e-11f };
    const sp_wide end = sp_wide_all(4.25f);
    sp_wide_mask inside = sp_wide_lt(sp_wide_abs(x), end);
    sp_wide t = x * x, p = sp_wide_all(c[8]);
    for (int i = 7; i >= 0; i--)
        p = p * t + c[i];
    sp_wide beyond = sp_wide_keep(sp_wide_lt(sp_wide_all(0), x), sp_wide_all(1));
    return sp_wide_select(inside, 0.5f + x * p, beyond);
}
#else
/* The same, SP_WIDE at a time. */
static inline sp_wide sp_wide_normal_share(sp_wide x) {
    sp_wide z = sp_wide_abs(x) * 0.707106781f;
    sp_wide t = 1 / (1 + 0.3275911f * z);
    sp_wide p =
        t * (0.254829592f +
             t * (-0.284496736f + t * (1.421413741f + t * (-1.453152027f + t * 1.061405429f))));
    sp_wide tail = 0.5f * p * sp_wide_exp2(-SP_LOG2E * z * z);
    return sp_wide_select(sp_wide_lt(x, sp_wide_all(0)), tail, 1 - tail);
}
#endif

#endif
