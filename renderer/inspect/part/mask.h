/* SPDX-License-Identifier: Apache-2.0
 *
 * A mask with one bit per sample, in rows of 64-bit words along axis 0.
 */
#ifndef SP_PART_MASK_H
#define SP_PART_MASK_H

#include <stdbool.h>
#include <stdint.h>

#include "base/parallel_for.h"
#include "sp/status.h"

struct sp_mask {
    uint32_t dims[3];
    uint32_t words; /* per row */
    uint64_t *bits; /* [dims[2]][dims[1]][words], owned; bits beyond a row are 0 */
};

/* Allocates a mask in which all bits are 0. SP_ERR_MEMORY. */
bool sp_mask_init(struct sp_mask *mask, const uint32_t dims[3], struct sp_error *err);
void sp_mask_finish(struct sp_mask *mask);

static inline uint64_t *sp_mask_row(const struct sp_mask *mask, uint32_t y, uint32_t z) {
    return mask->bits + ((uint64_t)z * mask->dims[1] + y) * mask->words;
}

static inline bool sp_mask_has(const struct sp_mask *mask, uint32_t x, uint32_t y, uint32_t z) {
    return sp_mask_row(mask, y, z)[x / 64] >> x % 64 & 1;
}

/* Sets in `part` the bits of `all` that are connected through faces with bit `at` = (x, y, z) of
 * `all`. `part` has the size of `all` and is empty. SP_ERR_MEMORY. */
bool sp_mask_connect(const struct sp_mask *all, const uint32_t at[3], struct sp_mask *part,
                     struct sp_error *err);

/* Sets each bit that has a set neighbour, across a face, an edge or a corner. `from` receives a
 * copy of the old mask. */
void sp_mask_grow(struct sp_mask *mask, struct sp_mask *from, struct sp_pool *pool);

#endif
