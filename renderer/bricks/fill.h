/* SPDX-License-Identifier: Apache-2.0
 *
 * A box of bricks of one level, put beside each other in memory as the samples of a volume.
 */
#ifndef SP_BRICKS_FILL_H
#define SP_BRICKS_FILL_H

#include "base/parallel_for.h"
#include "bricks/file.h"

/* Which bricks of a level a frame needs. */
struct sp_brick_need {
    unsigned level;
    uint32_t first[3], count[3]; /* bricks of a box, which is not empty */
    uint8_t *wanted;             /* malloc'ed [count]: 1 = may show something; i0 fastest */
};

static inline uint64_t sp_brick_need_count(const struct sp_brick_need *need) {
    return (uint64_t)need->count[0] * need->count[1] * need->count[2];
}

/* Number, in its level, of brick i of the box. */
uint64_t sp_brick_need_at(const struct sp_brick_need *need, const struct sp_brick_level *level,
                          uint64_t i);

/* The samples of the box: the first one, and how many. */
void sp_brick_need_box(const struct sp_brick_need *need, const struct sp_brick_level *level,
                       uint32_t first[3], uint32_t size[3]);

/* Bytes of the samples of the box. */
uint64_t sp_brick_need_bytes(const struct sp_brick_file *file, const struct sp_brick_need *need);

/* Bytes of memory that a window of the need takes, with the ranges that frames find of it: rows of
 * bricks of which nothing is wanted and whose values are 0 take no memory. */
uint64_t sp_brick_need_cost(const struct sp_brick_file *file, const struct sp_brick_need *need);

/* Finds brick i of the box of `need` in the box of `in`, of the same level: its number there. False
 * if it lies outside. */
bool sp_brick_need_find(const struct sp_brick_need *need, uint64_t i,
                        const struct sp_brick_need *in, uint64_t *at);

/* True if each wanted brick of `need` is one of `have`, of the same level. */
bool sp_brick_need_is_in(const struct sp_brick_need *need, const struct sp_brick_need *have);

/* Copies, also `wanted`. False without memory. */
bool sp_brick_need_copy(const struct sp_brick_need *need, struct sp_brick_need *copy);

/* The samples of a box in memory. */
struct sp_brick_box_samples {
    const struct sp_brick_need *need;
    const void *samples; /* of the box of the need */
    const uint8_t *lost; /* by brick of the box: 1 = its samples are coarse */
};

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
    void *user;
    void *samples; /* of the box: all 0, as the system maps memory */
    uint8_t *lost; /* [bricks of the box], set to 1 where a brick could not be read */
};

/* Fills the samples: of wanted bricks, those of the file; of others, one value of the brick's
 * range, which shows no more than the brick does. Wanted bricks that cannot be read get the samples
 * of the coarse level. *why is the error of one of them; SP_OK = there is none. False if it was
 * cancelled, or out of memory: SP_ERR_CANCELLED, SP_ERR_MEMORY. */
bool sp_brick_fill(const struct sp_brick_fill_job *job, struct sp_error *why, struct sp_error *err);

#endif
