/* SPDX-License-Identifier: Apache-2.0
 *
 * Which voxels of a volume are visible, and their gradients: the list of the finest level.
 */
#ifndef SP_CLASSIFY_COLLECT_H
#define SP_CLASSIFY_COLLECT_H

#include "classify/change.h"
#include "classify/classification.h"

/* Where bricks that nothing changes for are copied from. */
struct sp_collect_source {
    const struct sp_level *level; /* NULL = nowhere */
    struct sp_change change;
};

/* Counts the visible voxels brick by brick: level->visible has everything but its entries. Measures
 * the bricks' ranges if the level has none and job->from cannot give them. *source is what
 * sp_collect_fill() wants, and the caller's to finish (its change), also after a failure.
 * SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_collect_count(struct sp_level *level, const struct sp_volume *volume,
                      const struct sp_classify_job *job, struct sp_collect_source *source,
                      struct sp_error *err);

/* Allocates and writes the entries; with normals only when the job asks for them and the source has
 * some: then those of voxels that stay are copied. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_collect_fill(struct sp_level *level, const struct sp_volume *volume,
                     const struct sp_classify_job *job, const struct sp_collect_source *source,
                     struct sp_error *err);

/* Voxels of the volume by key, of a type with a table: malloc'ed. NULL with SP_ERR_MEMORY. */
uint64_t *sp_collect_histogram(const struct sp_transfer *transfer, const struct sp_volume *volume,
                               struct sp_pool *pool, struct sp_error *err);

/* Adds the normals. SP_ERR_MEMORY, SP_ERR_CANCELLED; the list is then as before. */
bool sp_collect_normals(struct sp_level *level, const struct sp_volume *volume,
                        const struct sp_classify_job *job, struct sp_error *err);

#endif
