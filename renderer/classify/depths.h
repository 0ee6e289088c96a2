/* SPDX-License-Identifier: Apache-2.0
 *
 * The largest optical depth of each slice of each brick: what a sheet can add to a pixel at most.
 */
#ifndef SP_CLASSIFY_DEPTHS_H
#define SP_CLASSIFY_DEPTHS_H

#include "classify/level.h"

/* Brings level->depths up to date for the slices along the list's axis. Nothing is done if they
 * are. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_depths_update(struct sp_level *level, const struct sp_classify_job *job,
                      struct sp_error *err);

#endif
