/* SPDX-License-Identifier: Apache-2.0
 *
 * The normal between two gradients: of an interval, and of the surface before it. Light falls on
 * both sides of a surface, so a normal is a line without a direction: in thin bone gradients point
 * forwards, then back, and vectors that are added would cancel. Lines are mixed by twice their
 * angles:
 *
 *   past                 a: weight of the interval's gradient, b: weight of the past one
 *    ╲  ╱ normal         θ: angle between both
 *     ╲╱                 m = a·(1, 0) + b·(cos 2θ, sin 2θ)
 *      ╲────► gradient   φ = half the angle of m: from the gradient to the normal
 *
 * For unit vectors g and p this is the direction in which a·g gᵀ + b·p pᵀ is largest. It changes
 * continuously, except where both are equal and at right angles. The past gradient counts less the
 * more it lies across the new one, since it is then more likely to be of another surface.
 */
#ifndef SP_RESAMPLE_NORMAL_H
#define SP_RESAMPLE_NORMAL_H

#include "base/wide.h"

/* Sets a normal of length 1; shorter if both gradients are below 1e-9, and zero if both are zero.
 * The squares are those of their lengths;
 * firm: share of the interval's gradient, [0, 1]. Returns the mean length. */
static inline sp_wide sp_normal_mix(const sp_wide gradient[3], sp_wide square,
                                    const sp_wide past[3], sp_wide past_square, sp_wide firm,
                                    sp_wide normal[3]) {
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1), tiny = sp_wide_all(1e-20f);
    const sp_wide least = sp_wide_all(1e-8f);
    const float across = 0.4f;
    sp_wide dot = zero;
    for (int c = 0; c < 3; c++)
        dot += gradient[c] * past[c];
    sp_wide inverse = sp_wide_inverse_sqrt(sp_wide_max(square, tiny));
    sp_wide past_inverse = sp_wide_inverse_sqrt(sp_wide_max(past_square, tiny));
    sp_wide cosine = sp_wide_clamp(dot * inverse * past_inverse, -1, 1);
    sp_wide sine_square = one - cosine * cosine, sine = sp_wide_sqrt(sine_square);
    sp_wide a = firm * square * inverse;
    sp_wide b = (one - firm) * past_square * past_inverse * (one - across * sine_square);
    sp_wide m[2] = { a + b * (one - 2 * sine_square), 2 * b * cosine * sine };
    /* Of the sine and the cosine of φ, the larger one by a root, the other one by sin 2φ. */
    sp_wide scale = sp_wide_inverse_sqrt(sp_wide_max(m[0] * m[0] + m[1] * m[1], tiny));
    sp_wide larger = sp_wide_sqrt(0.5f + 0.5f * sp_wide_abs(m[0]) * scale);
    sp_wide smaller = 0.5f * sp_wide_abs(m[1]) * scale * sp_wide_inverse(larger);
    sp_wide_mask is_turned = sp_wide_lt(m[0], zero);
    sp_wide aside = sp_wide_copysign(sp_wide_select(is_turned, larger, smaller), cosine) *
                    sp_wide_inverse_sqrt(sp_wide_max(sine_square, least)) * past_inverse;
    sp_wide along =
        sp_wide_select(is_turned, smaller, larger) * inverse - aside * dot * inverse * inverse;
    for (int c = 0; c < 3; c++)
        normal[c] = along * gradient[c] + aside * past[c];
    return a + b;
}

#endif
