/* SPDX-License-Identifier: Apache-2.0
 *
 * What a new transfer function changes (Chen et al. 2004, section 4.3, keep lists by value; here
 * bricks know the range of their values): the values that appear or vanish, and so the bricks whose
 * lists have to be made anew. All others are copied.
 *
 *   old, new transfer ─► values whose visibility differs ─► bricks whose range meets them
 */
#ifndef SP_CLASSIFY_CHANGE_H
#define SP_CLASSIFY_CHANGE_H

#include "classify/visible.h"

struct sp_change {
    /* Types with a table: how many of the values before each one differ; [count + 1], owned. */
    uint32_t *before;
    /* Other types: all that differ lie in here, from the base on; low > high: none. */
    float low, high;
};

/* Whether a list made for `from` can serve `to` at all: keys mean the same in both, and both ask
 * for voxels by their own value. */
bool sp_change_is_possible(const struct sp_transfer *from, const struct sp_transfer *to);

/* Types with a table: has, wants: by key, what the one list holds and the other is to hold. False
 * with SP_ERR_MEMORY. */
bool sp_change_init(struct sp_change *change, const struct sp_transfer *from, const uint8_t *has,
                    const struct sp_transfer *to, const uint8_t *wants, struct sp_error *err);
void sp_change_finish(struct sp_change *change);

/* Whether any value of the range changes. */
bool sp_change_meets(const struct sp_change *change, const struct sp_range *range);

#endif
