/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples of a grid in blocks of 64³, so that memory holds only the needed blocks: a subvolume
 * of a volume that is larger than memory (data/bricks/README.md).
 *
 *   ┌────┬────┬────┐   a block has samples of its own: A, B,
 *   │ A  │ 0  │ B  │   or one value, which all of its samples have: 0, 9,
 *   ├────┼────┼────┤   or none: ~. A coarser grid stands in for it.
 *   │ 0  │ 9  │ ~  │
 *   └────┴────┴────┘   block[(z / 64 · count[1] + y / 64) · count[0] + x / 64]
 */
#ifndef SP_VOLUME_BLOCKS_H
#define SP_VOLUME_BLOCKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/volume.h"

enum { SP_BLOCK_BITS = 6, SP_BLOCK_SIDE = 1 << SP_BLOCK_BITS };

struct sp_block {
    const void *samples; /* 64³, the first axis fastest; samples beyond the grid are not set. NULL =
                            the samples come from the coarser grid */
    bool is_constant;    /* `samples` has one sample, which stands for all */
};

/* A coarser grid of the same type: sample i of the blocks lies at first + step·i of it. */
struct sp_blocks_coarse {
    const void *samples;            /* an array; NULL = the samples lie in `blocks` */
    const struct sp_blocks *blocks; /* or NULL */
    uint32_t dims[3];
    double first[3], step[3]; /* 0 < step <= 1 */
};

struct sp_blocks {
    uint32_t dims[3];  /* of the grid */
    uint32_t count[3]; /* of blocks; the last ones may reach beyond the grid */
    enum sp_type type;
    struct sp_block *block; /* [count] */
    struct sp_blocks_coarse coarse;
};

/* Copies `n` samples along an axis, from sample `at` on, to `out`. All of them must lie in the
 * grid. */
void sp_blocks_read(const struct sp_blocks *blocks, unsigned axis, const uint32_t at[3], size_t n,
                    void *out);

static inline const struct sp_block *sp_blocks_at(const struct sp_blocks *blocks,
                                                  const uint32_t at[3]) {
    const size_t x = at[0] >> SP_BLOCK_BITS, y = at[1] >> SP_BLOCK_BITS, z = at[2] >> SP_BLOCK_BITS;
    return &blocks->block[(z * blocks->count[1] + y) * blocks->count[0] + x];
}

#endif
