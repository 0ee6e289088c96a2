/* SPDX-License-Identifier: Apache-2.0
 *
 * One bit per voxel for each state, and the range of values of each block of voxels. The ranges
 * tell which blocks a change of the thresholds or of the transfer function can affect.
 */
#ifndef SP_SHELL_MASKS_H
#define SP_SHELL_MASKS_H

#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "draw/layers/shell/states.h"

/* A block has SP_SHELL_WORD voxels along axis 0, one word of bits, and SP_SHELL_SIDE along the
 * others. */
enum { SP_SHELL_WORD = 64, SP_SHELL_SIDE = 8 };

struct sp_shell_masks {
    uint32_t dims[3];
    uint32_t words;                /* per row */
    uint32_t sides[2];             /* blocks along axes 1 and 2 */
    struct sp_shell_range *ranges; /* [sides[1]][sides[0]][words], owned; NULL = empty */
    uint64_t *bits[2]; /* IN and OPAQUE: [dims[2]][dims[1]][words], owned; beyond a row 0 */
};

/* Allocates the masks: all bits are 0 and the ranges are not filled. SP_ERR_MEMORY. */
bool sp_shell_masks_init(struct sp_shell_masks *masks, const uint32_t dims[3],
                         struct sp_error *err);
void sp_shell_masks_finish(struct sp_shell_masks *masks);

/* Returns the bytes of the masks of a grid. */
uint64_t sp_shell_masks_bytes(const uint32_t dims[3]);

/* Computes the ranges of all blocks. Incomplete after a cancellation. */
void sp_shell_masks_measure(struct sp_shell_masks *masks, const struct sp_volume *volume,
                            struct sp_pool *pool, const struct sp_interrupt *interrupt);

/* Updates the bits of all blocks whose states differ between `from` and `to`; from: NULL = of all
 * blocks. Fills changed[sides[1] · sides[0]]: 1 if any block of the row differs, else 0. Incomplete
 * after a cancellation. */
void sp_shell_masks_update(struct sp_shell_masks *masks, const struct sp_volume *volume,
                           const struct sp_shell_states *from, const struct sp_shell_states *to,
                           uint8_t *changed, struct sp_pool *pool,
                           const struct sp_interrupt *interrupt);

/* Returns row (y, z) of the bits. */
static inline const uint64_t *sp_shell_masks_row(const struct sp_shell_masks *masks, int which,
                                                 uint32_t y, uint32_t z) {
    return masks->bits[which] + ((uint64_t)z * masks->dims[1] + y) * masks->words;
}

#endif
