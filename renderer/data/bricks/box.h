/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples of a need in memory. They are an array, or blocks (data/volume/blocks.h). A block of
 * a brick that is not wanted has one sample.
 */
#ifndef SP_BRICKS_BOX_H
#define SP_BRICKS_BOX_H

#include "data/bricks/need.h"
#include "data/volume/blocks.h"

struct sp_brick_box_samples {
    const struct sp_brick_need *need;
    void *samples;             /* samples of the need's box; NULL = they lie in `blocks` */
    struct sp_blocks *blocks;  /* or NULL */
    const float (*vectors)[3]; /* vectors of the box; NULL = the need has none */
    const uint8_t *lost;       /* per brick of the box: the arrays (need.h) that have coarse data */
};

/* Where the samples of a brick lie. */
struct sp_brick_place {
    char *samples;
    size_t row, slice; /* bytes from row to row, and from slice to slice */
    uint32_t size[3];  /* samples of the brick, or 1 for a block of one sample */
};

/* Returns the place of brick i of the box. */
struct sp_brick_place sp_brick_place(const struct sp_brick_box_samples *box,
                                     const struct sp_brick_level *level, size_t sample, uint64_t i);

/* Blocks of a need, for a volume of its own. The memory of bricks may be shared by several. */
struct sp_brick_blocks;

/* Returns the bytes of memory that the bricks of a need take. */
uint64_t sp_brick_blocks_bytes(const struct sp_brick_file *file, const struct sp_brick_need *need);

/* Makes the blocks of a need. All samples are 0; bricks that a coarser level shows have none. NULL
 * with *err set. */
struct sp_blocks *sp_brick_blocks_create(const struct sp_brick_file *file,
                                         const struct sp_brick_need *need, struct sp_error *err);

/* Makes blocks that share the memory of the bricks of `from`. A brick with has[i] = 0 gets no
 * samples: a coarser level shows it. */
struct sp_blocks *sp_brick_blocks_share(const struct sp_brick_file *file,
                                        const struct sp_brick_need *need,
                                        const struct sp_blocks *from, const uint8_t *has,
                                        struct sp_error *err);

/* Releases blocks (sp_voxel_source_release). */
void sp_brick_blocks_release(void *blocks, size_t bytes);

/* Memory for samples, all 0; NULL with *err set. sp_brick_unmap() releases it. */
void *sp_brick_map(size_t bytes, struct sp_error *err);
void sp_brick_unmap(void *samples, size_t bytes);

/* Returns the bytes of memory that a subvolume of the need takes, including the ranges that frames
 * compute from it. In an array, a row of bricks takes no memory if none of its bricks is wanted and
 * all its values are 0. */
uint64_t sp_brick_need_cost(const struct sp_brick_file *file, const struct sp_brick_need *need);

#endif
