/* SPDX-License-Identifier: Apache-2.0
 *
 * Minimum, maximum and clamp. The float versions are single instructions, unlike fminf() and
 * fmaxf(): if a or b is NaN, the result is b.
 */
#ifndef SP_BASE_MINMAX_H
#define SP_BASE_MINMAX_H

#include <float.h>
#include <math.h>
#include <stdint.h>

static inline float sp_minf(float a, float b) {
    return a < b ? a : b;
}

static inline float sp_maxf(float a, float b) {
    return a > b ? a : b;
}

/* NaN stays NaN. */
static inline float sp_clampf(float x, float low, float high) {
    return x < low ? low : x > high ? high : x;
}

/* NaN becomes low. */
static inline double sp_clamp(double x, double low, double high) {
    return fmin(fmax(x, low), high);
}

/* Returns the nearest finite float; NaN becomes FLT_MAX. */
static inline float sp_finite_float(double x) {
    return (float)fmax(-(double)FLT_MAX, fmin((double)FLT_MAX, x));
}

static inline int sp_mini(int a, int b) {
    return a < b ? a : b;
}

static inline int sp_maxi(int a, int b) {
    return a > b ? a : b;
}

static inline int sp_clampi(int x, int low, int high) {
    return x < low ? low : x > high ? high : x;
}

static inline uint64_t sp_minu(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

static inline uint32_t sp_maxu(uint32_t a, uint32_t b) {
    return a > b ? a : b;
}

#endif
