/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses the axis of the slices. Slices of two axes give slightly different images, so that the
 * image would jump when the camera turns from one axis to another (popping). To avoid that, both
 * images are drawn and mixed within a narrow band of angles around the switch:
 *
 *   share of an axis  ~  max(0, 1 − (its angle to the view direction − the smallest one)/band)
 */
#ifndef SP_RESAMPLE_AXES_H
#define SP_RESAMPLE_AXES_H

#include "base/parallel_for.h"
#include "sp/frame.h"

/* Fills the share of each axis in the image; the shares add up to 1. along: the components of the
 * ray through the image's centre along the axes, in any unit. Returns the axis with the largest
 * share. */
int sp_axes_choose(const double along[3], double share[3]);

/* Replaces the frame's pixels by (1 − share)·frame + share·from, where `from` has the frame's
 * format and stride. */
void sp_axes_mix(struct sp_frame *frame, const struct sp_frame *from, double share,
                 struct sp_pool *pool);

#endif
