/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_RESAMPLE_RANGES_H
#define SP_RESAMPLE_RANGES_H

#include <math.h>

#include "base/isa.h"
#include "draw/resample/mip_samples.h"

/* Fills samples->range with the values that interpolation in each region may give. Incomplete after
 * a cancellation. */
typedef void sp_ranges_compute_fn(struct sp_samples *samples, struct sp_pool *pool,
                                  const struct sp_interrupt *interrupt);
sp_ranges_compute_fn sp_ranges_compute;

/* Computes the range of the values that interpolation between samples may give. `own`: the range of
 * these samples; `wide`: the range of these and of the samples one farther. {∞, −∞} if `wide` is
 * empty. */
static inline void sp_ranges_widen(const float own[2], const float wide[2], float range[2]) {
    /* Interpolation overshoots. It hardly ever exceeds the samples around a cell by more than this
     * share of the range of those one sample farther; what does may be missing from the image. */
    const float overshoot = 0.25f, margin = overshoot * (wide[1] - wide[0]);
    range[0] = INFINITY;
    range[1] = -INFINITY;
    if (!(wide[1] > -INFINITY))
        return;
    bool is_finite = margin < INFINITY;
    /* A region without finite samples of its own is reached from beside it. */
    range[0] = is_finite ? (own[0] < wide[1] ? own[0] : wide[1]) - margin : -INFINITY;
    range[1] = is_finite ? (own[1] > wide[0] ? own[1] : wide[0]) + margin : INFINITY;
}

#endif
