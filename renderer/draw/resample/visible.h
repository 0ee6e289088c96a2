/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_RESAMPLE_VISIBLE_H
#define SP_RESAMPLE_VISIBLE_H

#include "draw/resample/mip_samples.h"

/* Fills class->visible and class->visible_count from the ranges of the samples, for the transfer
 * function and the axis of the class. False: cancelled and incomplete. */
bool sp_samples_mark_visible(const struct sp_samples *samples, struct sp_samples_class *class,
                             struct sp_pool *pool, const struct sp_interrupt *interrupt);

#endif
