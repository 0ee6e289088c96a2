/* SPDX-License-Identifier: Apache-2.0
 *
 * Keeps the cached data of one volume up to date with as little work as a change needs.
 */
#ifndef SP_CLASSIFY_CLASSIFICATION_H
#define SP_CLASSIFY_CLASSIFICATION_H

#include "classify/level.h"

/* Takes one reference to the volume. */
void sp_classification_init(struct sp_classification *c, struct sp_volume *volume);
void sp_classification_finish(struct sp_classification *c);

/* Brings the lists of job->levels up to date. A change of colours only needs a new table and new
 * coarse levels. A change of the visible values rebuilds the bricks that have such values, if there
 * is a list to copy the others from (change.h); otherwise it needs a pass over the volume. On
 * failure drops stale data: SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_classification_update(struct sp_classification *c, const struct sp_classify_job *job,
                              struct sp_error *err);

/* How well the list serves another transfer function. A list may hold voxels that are not visible:
 * their depth is 0, the splat stage skips them, and the image is the same. Therefore an edit that
 * hides values needs only a new table. An edit that shows values which a widened list already holds
 * also needs only a new table. */
struct sp_fit {
    uint64_t visible; /* visible voxels under the other function */
    uint64_t missing; /* visible voxels that are not in the list */
    uint64_t excess;  /* voxels in the list that are not visible */
};

/* Fills *fit. False if the list cannot serve at all: there is no list, the order differs, or the
 * type has no table. *err is set (SP_ERR_MEMORY) only if memory is the reason. */
bool sp_classification_fit(struct sp_classification *c, const struct sp_transfer *to,
                           const struct sp_classify_job *job, struct sp_fit *fit,
                           struct sp_error *err);

/* True if a list that misses nothing is short enough: at most a quarter too long. */
bool sp_fit_is_close(const struct sp_fit *fit);

/* Returns the memory of the cached data, without the volume itself [bytes]. */
uint64_t sp_classification_bytes(const struct sp_classification *c);

#endif
