/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples of a need in memory. They are an array, or blocks (data/volume/blocks.h), of which
 * those of bricks that are not wanted have one sample.
 */
#ifndef SP_BRICKS_BOX_H
#define SP_BRICKS_BOX_H

#include "data/bricks/need.h"
#include "data/volume/blocks.h"

struct sp_brick_box_samples {
    const struct sp_brick_need *need;
    void *samples;             /* of the box of the need; NULL = they lie in blocks */
    struct sp_blocks *blocks;  /* or NULL */
    const float (*vectors)[3]; /* of the box; NULL = the need has none */
    const uint8_t *lost;       /* by brick of the box: its arrays (need.h) that are coarse */
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

/* Blocks of a need, for a volume of its own. The memory of bricks may be shared by several. */
struct sp_brick_blocks;

/* Bytes of the memory of bricks that a need takes. */
uint64_t sp_brick_blocks_bytes(const struct sp_brick_file *file, const struct sp_brick_need *need);

/* Makes the blocks of a need. All samples are 0; bricks that a coarser level shows have none. NULL
 * with *err set. */
struct sp_blocks *sp_brick_blocks_create(const struct sp_brick_file *file,
                                         const struct sp_brick_need *need, struct sp_error *err);

/* Makes blocks of the same bricks that share their memory. Those of which has[i] is 0 have none: a
 * coarser level shows them, too. */
struct sp_blocks *sp_brick_blocks_share(const struct sp_brick_file *file,
                                        const struct sp_brick_need *need,
                                        const struct sp_blocks *from, const uint8_t *has,
                                        struct sp_error *err);

/* Releases them (sp_voxel_source_release). */
void sp_brick_blocks_release(void *blocks, size_t bytes);

/* Memory for samples, all 0; NULL with *err set. sp_brick_unmap() releases it. */
void *sp_brick_map(size_t bytes, struct sp_error *err);
void sp_brick_unmap(void *samples, size_t bytes);

/* Bytes of memory that a window of the need takes, including the ranges that frames compute from
 * it. In an array, rows of bricks of which nothing is wanted and whose values are 0 take no memory.
 */
uint64_t sp_brick_need_cost(const struct sp_brick_file *file, const struct sp_brick_need *need);

#endif
