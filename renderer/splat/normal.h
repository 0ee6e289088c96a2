/* SPDX-License-Identifier: Apache-2.0
 *
 * The normal distribution in single precision, without a call or a branch.
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
