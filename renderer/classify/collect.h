/* SPDX-License-Identifier: Apache-2.0
 *
 * Makes the list of the finest level: the visible voxels of a volume and their gradients.
 */
#ifndef SP_CLASSIFY_COLLECT_H
#define SP_CLASSIFY_COLLECT_H

#include "classify/change.h"
#include "classify/level.h"

/* The list from which unchanged bricks are copied. */
struct sp_collect_source {
    const struct sp_level *level; /* borrowed; NULL = none */
    struct sp_change change;
};

/* Counts the visible voxels of each brick: level->visible is then complete except for its entries.
 * Computes the ranges of the bricks if neither the level nor job->from has them. Fills *source for
 * sp_collect_fill(); the caller finishes source->change, also after a failure. SP_ERR_MEMORY,
 * SP_ERR_CANCELLED. */
bool sp_collect_count(struct sp_level *level, const struct sp_volume *volume,
                      const struct sp_classify_job *job, struct sp_collect_source *source,
                      struct sp_error *err);

/* Allocates and writes the entries. Writes normals only if the job asks for them and the source has
 * normals; it copies the normals of voxels that are in both lists. SP_ERR_MEMORY,
 * SP_ERR_CANCELLED. */
bool sp_collect_fill(struct sp_level *level, const struct sp_volume *volume,
                     const struct sp_classify_job *job, const struct sp_collect_source *source,
                     struct sp_error *err);

/* Counts the voxels of each key, for a type with a table. Returns an array that the caller frees
 * with free(). NULL with *err set: SP_ERR_MEMORY. */
uint64_t *sp_collect_histogram(const struct sp_transfer *transfer, const struct sp_volume *volume,
                               struct sp_pool *pool, struct sp_error *err);

/* Adds normals to the list. On failure the list does not change: SP_ERR_MEMORY, SP_ERR_CANCELLED.
 */
bool sp_collect_normals(struct sp_level *level, const struct sp_volume *volume,
                        const struct sp_classify_job *job, struct sp_error *err);

#endif
