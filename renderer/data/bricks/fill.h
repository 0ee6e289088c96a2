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
    /* The whole level `coarse.need->level`, which replaces damaged bricks. samples NULL = there is
     * no coarse level, and damaged bricks get one value. */
    struct sp_brick_box_samples coarse;
    const struct sp_brick_box_samples *known; /* bricks that are copied instead of read */
    size_t known_count;
    struct sp_pool *pool;
    bool (*is_cancelled)(void *user); /* from any thread */
    /* Called on the caller's thread after some bricks were read. If is_due() returns true,
     * progress() is called: has[i] = 1 means that brick i of the box is read. NULL = never. */
    bool (*is_due)(void *user);
    void (*progress)(void *user, const uint8_t *has);
    void *user;
    void *samples;            /* samples of the box, all 0; NULL = `blocks` is used */
    struct sp_blocks *blocks; /* blocks of the need (sp_brick_blocks_create()) */
    float (*vectors)[3];      /* vectors of the box, all 0; NULL = the need has none */
    uint8_t *lost; /* [bricks of the box], all 0; output: the arrays that could not be read */
};

/* Fills the samples. A wanted brick gets its samples from the file; any other brick gets one value
 * of its range, which shows no more than the brick does. The most important bricks are read first
 * (need.h); of chunks, the chunks of the most important brick. A wanted brick that cannot be read
 * gets the samples of the coarse level. Wanted bricks get their vectors; in other bricks vectors
 * are 0. Samples and vectors of a brick are read independently: if one array cannot be read, the
 * other is still as in the file. *why is the error of one brick; SP_OK = no error. False if the job
 * was cancelled or memory ran out: SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_brick_fill(const struct sp_brick_fill_job *job, struct sp_error *why, struct sp_error *err);

#endif
