/* SPDX-License-Identifier: Apache-2.0
 *
 * The largest optical depth of each slice of each brick: what a sheet can add to a pixel at most.
 */
#ifndef SP_CLASSIFY_DEPTHS_H
#define SP_CLASSIFY_DEPTHS_H

#include "classify/level.h"

/* Makes the depths of the slices along the list's axis if there are none. They are kept when the
 * list is turned. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_depths_update(struct sp_level *level, const struct sp_classify_job *job,
                      struct sp_error *err);

#endif
