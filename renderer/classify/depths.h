/* SPDX-License-Identifier: Apache-2.0
 *
 * The largest optical depth of each slice of each brick: an upper bound of what a sheet can add to
 * a pixel.
 */
#ifndef SP_CLASSIFY_DEPTHS_H
#define SP_CLASSIFY_DEPTHS_H

#include "classify/level.h"

/* Computes the depths of the slices along the list's axis unless the level has them. The level
 * keeps the depths of all axes when the list is turned. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_depths_update(struct sp_level *level, const struct sp_classify_job *job,
                      struct sp_error *err);

#endif
