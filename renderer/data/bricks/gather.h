/* SPDX-License-Identifier: Apache-2.0
 *
 * Cuts bricks from chunks. Each chunk is read once; all readers of the source share the work.
 */
#ifndef SP_BRICKS_GATHER_H
#define SP_BRICKS_GATHER_H

#include "base/parallel_for.h"
#include "data/bricks/box.h"

struct sp_gather_job {
    struct sp_brick_file *file; /* made of chunks */
    const struct sp_brick_need *need;
    const uint8_t *missing; /* [bricks of the box]: 1 = this brick must be read */
    uint8_t *failed; /* [bricks of the box], all 0: set to 1 where a chunk could not be read */
    uint8_t *has;    /* [bricks of the box]: set to 1 when the brick is read, before progress() */
    struct sp_pool *pool;             /* of at most as many threads as the source has readers */
    bool (*is_cancelled)(void *user); /* from any thread; NULL = never */
    bool (*is_due)(void *user);
    void (*progress)(void *user, const uint8_t *has); /* both as in struct sp_brick_fill_job */
    void *user;
    const struct sp_brick_box_samples *box; /* of the need */
};

/* Writes the samples of missing bricks and stores their ranges. The chunks of the most important
 * bricks are read first (need.h). *why is the error of a chunk; SP_OK = all were read. False if it
 * was cancelled, or out of memory: SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_gather(const struct sp_gather_job *job, struct sp_error *why, struct sp_error *err);

#endif
