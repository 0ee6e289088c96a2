/* SPDX-License-Identifier: Apache-2.0
 *
 * Depth of pixels (sp/frame.h). Beside the transmittance T of a pixel, a compositor sums two
 * moments of the places d where the pixel shows something:
 *
 *   m1 = Σ T α d     m2 = Σ T α d²     Σ T α = 1 − T
 *
 * d is a coordinate along the ray in which depth is linear: z = base + factor·d. Compositors count
 * d from about where they first show something, so that m2 does not lose its digits.
 */
#ifndef SP_FRAME_DEPTH_H
#define SP_FRAME_DEPTH_H

#include <math.h>

#include "base/isa.h"
#include "base/wide.h"
#include "sp/frame.h"

/* Adds what SP_WIDE pixels show at d. share: T α. */
static inline void sp_moments_add(float *first, float *second, sp_wide share, sp_wide d) {
    sp_wide part = share * d;
    sp_wide_store(first, sp_wide_load(first) + part);
    sp_wide_store(second, sp_wide_load(second) + part * d);
}

/* Computes depth and spread of `count` pixels. planes: T, m1, m2; place: base, factor. */
void sp_depth_resolve(const float *const planes[3], const float *const place[2], uint32_t count,
                      float *depth, float *spread);

/* Returns where the depths of row y begin; `plane`: frame->depth or frame->spread. */
static inline float *sp_depth_row(const struct sp_frame *frame, float *plane, size_t y) {
    return (float *)(void *)((char *)plane + y * frame->depth_stride_bytes);
}

/* The depth of a pixel while images are combined. */
struct sp_depth {
    float mean, spread, weight; /* weight: Σ T α, or a share of it; 0 = no depth */
};

/* Adds what `more` shows. Its depth may be +infinity: then nothing is added. */
static inline void sp_depth_add(struct sp_depth *sum, const struct sp_depth *more) {
    const float all = sum->weight + more->weight;
    if (!(more->weight > 0) || !isfinite(more->mean))
        return;
    if (!(sum->weight > 0) || !isfinite(sum->mean)) {
        *sum = *more;
        return;
    }
    const float share = more->weight / all, apart = more->mean - sum->mean;
    const float own = sum->spread * sum->spread, other = more->spread * more->spread;
    sum->mean += share * apart;
    sum->spread = sqrtf(own + share * (other - own) + share * (1 - share) * apart * apart);
    sum->weight = all;
}

#endif
