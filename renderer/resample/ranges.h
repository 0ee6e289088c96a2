/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_RESAMPLE_RANGES_H
#define SP_RESAMPLE_RANGES_H

#include "resample/samples.h"

/* Fills samples->range: what interpolation inside of each region may give. Incomplete after a
 * cancellation. */
void sp_ranges_find(struct sp_samples *samples, struct sp_pool *pool,
                    const struct sp_interrupt *interrupt);

/* What interpolation between samples with the range `own` may give; `wide`: the range of these and
 * of those one sample farther. {∞, −∞} if that is empty. */
void sp_ranges_widen(const float own[2], const float wide[2], float range[2]);

#endif
