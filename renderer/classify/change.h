/* SPDX-License-Identifier: Apache-2.0
 *
 * What a new transfer function changes: the values that appear or vanish, and so the bricks whose
 * lists must be rebuilt. All other bricks are copied. (Chen et al. 2004, section 4.3, keep lists
 * by value; here each brick knows the range of its values.)
 *
 *   old, new transfer ─► values whose visibility differs ─► bricks whose range meets them
 */
#ifndef SP_CLASSIFY_CHANGE_H
#define SP_CLASSIFY_CHANGE_H

#include "classify/visible.h"

struct sp_change {
    /* Types with a table: prefix sums, how many values before this one differ; [count + 1], owned.
     */
    uint32_t *before;
    /* Other types: all values that differ lie in [low, high], relative to the base; low > high =
     * none. */
    float low, high;
};

/* True if a list made for `from` can be updated for `to`: keys mean the same in both, and both
 * select voxels by their own value. */
bool sp_change_is_possible(const struct sp_transfer *from, const struct sp_transfer *to);

/* Compares two transfer functions. has, wants (types with a table): by key, 1 if the old list holds
 * and the new list must hold voxels of that key. SP_ERR_MEMORY. */
bool sp_change_init(struct sp_change *change, const struct sp_transfer *from, const uint8_t *has,
                    const struct sp_transfer *to, const uint8_t *wants, struct sp_error *err);
void sp_change_finish(struct sp_change *change);

/* True if any value of the range changes. */
bool sp_change_affects(const struct sp_change *change, const struct sp_range *range);

#endif
