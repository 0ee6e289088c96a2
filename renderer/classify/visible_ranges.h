/* SPDX-License-Identifier: Apache-2.0
 *
 * The visible ranges of a transfer function: the intervals of values where its opacity is above 0,
 * in rising order and apart from each other.
 */
#ifndef SP_CLASSIFY_VISIBLE_RANGES_H
#define SP_CLASSIFY_VISIBLE_RANGES_H

#include "classify/transfer.h"

struct sp_visible_ranges {
    uint32_t count;
    struct sp_visible_interval {
        double low, high;
        bool has_low, has_high; /* the interval includes that end */
    } interval[SP_TF_POINTS_MAX];
};

/* Fills the ranges in values of the volume [data unit]. */
void sp_visible_ranges_init(struct sp_visible_ranges *ranges,
                            const struct sp_transfer_function *tf);

/* Fills the ranges in the floats that post-classification computes per pixel, relative to `base`.
 */
void sp_visible_ranges_init_keys(struct sp_visible_ranges *ranges,
                                 const struct sp_transfer_function *tf, double base);

/* True if any value in [low, high] is visible; false if low > high. */
bool sp_visible_ranges_overlap(const struct sp_visible_ranges *ranges, double low, double high);

#endif
