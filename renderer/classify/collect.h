/* SPDX-License-Identifier: Apache-2.0
 *
 * Which voxels of a volume are visible, and their gradients: the list of the finest level.
 */
#ifndef SP_CLASSIFY_COLLECT_H
#define SP_CLASSIFY_COLLECT_H

#include "classify/classification.h"

/* Counts the visible voxels brick by brick: level->visible has everything but its entries.
 * SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_collect_count(struct sp_level *level, const struct sp_volume *volume,
                      const struct sp_classify_job *job, struct sp_error *err);

/* Allocates and writes the entries, without normals. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_collect_fill(struct sp_level *level, const struct sp_volume *volume,
                     const struct sp_classify_job *job, struct sp_error *err);

/* Adds the normals. SP_ERR_MEMORY, SP_ERR_CANCELLED; the list is then as before. */
bool sp_collect_normals(struct sp_level *level, const struct sp_volume *volume,
                        const struct sp_classify_job *job, struct sp_error *err);

#endif
