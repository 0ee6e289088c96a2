/* SPDX-License-Identifier: Apache-2.0
 *
 * 2^x and log2 x in single precision without calls and branches, so that loops over pixels become
 * vector code. Special values are not handled: NaN gives an unspecified number. The functions of
 * libm do not fit, because libm has no vector version that compilers can inline for every
 * instruction set.
 */
#ifndef SP_SPLAT_EXP2_H
#define SP_SPLAT_EXP2_H

#include <stdint.h>
#include <string.h>

#include "base/wide.h"

#define SP_LOG2E 1.44269504f

/* 2^x for x in [-126, 126]; below it is 2^-126, above 2^126. Relative error under 2e-7. */
static inline float sp_exp2(float x) {
    const float round_up = 12582912.0f; /* 1.5·2^23: adding it leaves an integer */
    x = x < -126.0f ? -126.0f : x;
    x = x > 126.0f ? 126.0f : x;
    float shifted = x + round_up, whole = shifted - round_up, f = x - whole;
    /* Least squares of 2^f over [-½, ½]. Pairs of terms are summed first, so that fewer steps
     * depend on each other. */
    float f2 = f * f, low = f * 6.93147182e-1f + 1.0f, middle = f * 5.55033312e-2f + 2.40226479e-1f;
    float high = f2 * 1.53533619e-4f + (f * 1.33988712e-3f + 9.61843784e-3f);
    float p = f2 * (f2 * high + middle) + low;
    uint32_t bits, power;
    memcpy(&bits, &p, sizeof bits);
    memcpy(&power, &shifted, sizeof power);
    bits += power << 23; /* the low bits of the shifted number are the integer */
    memcpy(&p, &bits, sizeof p);
    return p;
}

/* The same, SP_WIDE at a time. */
static inline sp_wide sp_wide_exp2(sp_wide x) {
    const float round_up = 12582912.0f;
    x = sp_wide_clamp(x, -126.0f, 126.0f);
    sp_wide shifted = x + round_up, f = x - (shifted - round_up), f2 = f * f;
    sp_wide low = f * 6.93147182e-1f + 1.0f;
    sp_wide middle = f * 5.55033312e-2f + 2.40226479e-1f;
    sp_wide high = f2 * 1.53533619e-4f + (f * 1.33988712e-3f + 9.61843784e-3f);
    sp_wide p = f2 * (f2 * high + middle) + low;
    return (sp_wide)((sp_wide_bits)p + ((sp_wide_bits)shifted << 23));
}

/* log2 x for normal x > 0. Absolute error under 3e-6. */
static inline float sp_log2(float x) {
    int32_t bits;
    memcpy(&bits, &x, sizeof bits);
    int32_t power = (bits - 0x3f3504f3) >> 23; /* mantissa in [√½, √2) */
    bits -= (int32_t)((uint32_t)power << 23);
    float m;
    memcpy(&m, &bits, sizeof m);
    /* log2 m = 2/ln 2 · atanh(s), s = (m − 1)/(m + 1) */
    float s = (m - 1) / (m + 1), t = s * s;
    return (float)power +
           s * (2.88539008f + t * (0.961796694f + t * (0.577078016f + t * 0.412198583f)));
}

/* The same, SP_WIDE at a time. */
static inline sp_wide sp_wide_log2(sp_wide x) {
    sp_wide_int bits = (sp_wide_int)x, power = (bits - 0x3f3504f3) >> 23;
    sp_wide m = (sp_wide)(bits - (sp_wide_int)((sp_wide_bits)power << 23));
    sp_wide s = (m - 1) * sp_wide_inverse(m + 1), t = s * s;
    return sp_wide_from_int(power) +
           s * (2.88539008f + t * (0.961796694f + t * (0.577078016f + t * 0.412198583f)));
}

#endif
