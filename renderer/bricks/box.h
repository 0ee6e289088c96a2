/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples of a need in memory. They are an array, or blocks (volume/blocks.h), of which those
 * of bricks that are not wanted have one sample.
 */
#ifndef SP_BRICKS_BOX_H
#define SP_BRICKS_BOX_H

#include "bricks/need.h"
#include "volume/blocks.h"

struct sp_brick_box_samples {
    const struct sp_brick_need *need;
    void *samples;             /* of the box of the need; NULL = they lie in blocks */
    struct sp_blocks *blocks;  /* or NULL */
    const float (*vectors)[3]; /* of the box; NULL = the need has none */
    const uint8_t *lost;       /* by brick of the box: 1 = its samples are coarse */
};

/* Where the samples of a brick lie. */
struct sp_brick_place {
    char *samples;
    size_t row, slice; /* bytes from row to row, and from slice to slice */
    uint32_t size[3];  /* samples of the brick, or 1 for a block of one sample */
};

/* Of brick i of the box. */
struct sp_brick_place sp_brick_place(const struct sp_brick_box_samples *box,
                                     const struct sp_brick_level *level, size_t sample, uint64_t i);

/* Bytes of memory for the blocks of a need. */
uint64_t sp_brick_blocks_bytes(const struct sp_brick_file *file, const struct sp_brick_need *need);

/* Bytes of memory that a window of the need takes, including the ranges that frames compute from
 * it. In an array, rows of bricks of which nothing is wanted and whose values are 0 take no memory.
 */
uint64_t sp_brick_need_cost(const struct sp_brick_file *file, const struct sp_brick_need *need);

/* Writes the blocks of a need to the beginning of such memory, which is all 0 and 64-byte aligned.
 * All samples are 0. */
struct sp_blocks *sp_brick_blocks_init(const struct sp_brick_file *file,
                                       const struct sp_brick_need *need, void *memory);

#endif
