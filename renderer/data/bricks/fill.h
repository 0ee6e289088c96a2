/* SPDX-License-Identifier: Apache-2.0
 *
 * Reads bricks of one level into memory, as the samples of a volume.
 */
#ifndef SP_BRICKS_FILL_H
#define SP_BRICKS_FILL_H

#include "base/parallel_for.h"
#include "data/bricks/box.h"

struct sp_brick_fill_job {
    struct sp_brick_file *file;
    const struct sp_brick_need *need;
    /* The whole level `coarse.need->level`, in place of damaged bricks; samples NULL = there is
     * none, and they get one value. */
    struct sp_brick_box_samples coarse;
    const struct sp_brick_box_samples *known; /* bricks that are copied instead of read */
    size_t known_count;
    struct sp_pool *pool;
    bool (*is_cancelled)(void *user); /* from any thread */
    /* Called by the caller's thread after some bricks were read: is it time to tell which? Then
     * has[i] = 1: brick i of the box is there. NULL = never. */
    bool (*is_due)(void *user);
    void (*progress)(void *user, const uint8_t *has);
    void *user;
    void *samples;            /* of the box: all 0, as the system maps memory; or NULL and */
    struct sp_blocks *blocks; /* those of the need (sp_brick_blocks_create()) */
    float (*vectors)[3];      /* of the box, all 0, too; NULL = the need has none */
    uint8_t *lost; /* [bricks of the box], all 0: gets the arrays that could not be read */
};

/* Fills the samples: of wanted bricks, those of the file; of others, one value of the brick's
 * range, which shows no more than the brick does. The bricks that matter most are read first
 * (need.h); of chunks, those that hold the most important brick. Wanted bricks that cannot be read
 * get the samples of the coarse level. Vectors are those of wanted bricks, and 0 in others. Samples
 * and vectors of a brick are read one by one: if one cannot be read, the other is as in the file.
 * *why is the error of one of them; SP_OK = there is none. False if it was cancelled, or out of
 * memory: SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_brick_fill(const struct sp_brick_fill_job *job, struct sp_error *why, struct sp_error *err);

#endif
