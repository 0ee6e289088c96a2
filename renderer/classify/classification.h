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

/* Brings the lists of job->levels up to date. A new colour costs a table (and the coarse levels). A
 * new set of visible values costs the bricks that have such values if there are lists to copy from
 * (change.h), otherwise a pass over the volume. On failure stale data is dropped: SP_ERR_MEMORY,
 * SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_classification_update(struct sp_classification *c, const struct sp_classify_job *job,
                              struct sp_error *err);

/* How well the list serves another transfer function. A list may hold voxels that are not visible:
 * their depth is 0, the splat stage skips them, and the image is the same. So an edit that hides
 * values needs a new table only; so does one that shows values that a widened list already holds.
 */
struct sp_fit {
    uint64_t visible; /* visible voxels under the other function */
    uint64_t missing; /* visible voxels that are not in the list */
    uint64_t excess;  /* voxels in the list that are not visible */
};

/* Fills *fit. False if the list cannot serve at all: there is none, the order differs, or the type
 * has no table. *err is set (SP_ERR_MEMORY) only if memory is the reason. */
bool sp_classification_fit(struct sp_classification *c, const struct sp_transfer *to,
                           const struct sp_classify_job *job, struct sp_fit *fit,
                           struct sp_error *err);

/* True if a list that misses nothing is short enough: at most a quarter too long. */
bool sp_fit_is_close(const struct sp_fit *fit);

/* Returns the bytes that are kept, without the volume itself. */
uint64_t sp_classification_bytes(const struct sp_classification *c);

#endif
