/* SPDX-License-Identifier: Apache-2.0
 *
 * Finds what a new transfer function changes: the values that become visible or invisible, and the
 * bricks whose lists must be rebuilt because of them. All other bricks are copied. (Chen et al.
 * 2004, section 4.3, keep lists by value; here each brick has the range of its values.)
 *
 *   old, new transfer ─► values whose visibility differs ─► bricks whose range meets them
 */
#ifndef SP_CLASSIFY_CHANGE_H
#define SP_CLASSIFY_CHANGE_H

#include "classify/visible.h"

struct sp_change {
    /* Types with a table: prefix sums, the number of values below this one whose visibility
     * differs; [count + 1], owned. */
    uint32_t *before;
    /* Other types: all values whose visibility differs lie in [low, high], relative to the base;
     * low > high = no value differs. */
    float low, high;
};

/* True if a list made for `from` can be updated for `to`: both give keys the same meaning, and both
 * select each voxel by its own value. */
bool sp_change_is_possible(const struct sp_transfer *from, const struct sp_transfer *to);

/* Compares two transfer functions. Only for types with a table, by key: has[key] = 1 if the old
 * list holds voxels of the key, wants[key] = 1 if the new list must hold them. SP_ERR_MEMORY. */
bool sp_change_init(struct sp_change *change, const struct sp_transfer *from, const uint8_t *has,
                    const struct sp_transfer *to, const uint8_t *wants, struct sp_error *err);
void sp_change_finish(struct sp_change *change);

/* True if the visibility of any value of the range changes. */
bool sp_change_affects(const struct sp_change *change, const struct sp_range *range);

#endif
