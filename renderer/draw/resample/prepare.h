/* SPDX-License-Identifier: Apache-2.0
 *
 * Prepares a frame before its pixels are drawn, for all backends: the mip level and its samples,
 * sample coordinates, clipping as half spaces, the metric, and tables of rectilinear axes.
 */
#ifndef SP_RESAMPLE_PREPARE_H
#define SP_RESAMPLE_PREPARE_H

#include "draw/resample/resample.h"

/* Fills *r and its channels, except refined_max, and the stats that are known before drawing. *r
 * borrows the data of the input. It is valid until the arena is reset or another frame is prepared
 * with the same cache. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_resample_prepare(const struct sp_resample_input *input, struct sp_resample *r,
                         struct sp_error *err);

/* Turns one channel to slices of another axis: gets its samples and sets r->axis. Errors as
 * above. */
bool sp_resample_turn(const struct sp_resample_input *input, struct sp_resample *r, int axis,
                      struct sp_error *err);

#endif
