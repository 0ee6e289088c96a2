/* SPDX-License-Identifier: Apache-2.0
 *
 * What a transfer function shows, as intervals of values: where its opacity is more than 0. They
 * rise, and do not meet.
 */
#ifndef SP_CLASSIFY_VISIBLE_RANGES_H
#define SP_CLASSIFY_VISIBLE_RANGES_H

#include "classify/transfer.h"

struct sp_visible_ranges {
    uint32_t count;
    struct sp_visible_interval {
        double low, high;
        bool has_low, has_high; /* whether the ends are part of it */
    } interval[SP_TF_POINTS_MAX];
};

/* In values of the volume. */
void sp_visible_ranges_init(struct sp_visible_ranges *ranges,
                            const struct sp_transfer_function *tf);

/* In values as pixels have them (order post): floats, counted from `base`. */
void sp_visible_ranges_init_keys(struct sp_visible_ranges *ranges,
                                 const struct sp_transfer_function *tf, double base);

/* Whether any value in [low, high] is shown; low > high: none is. */
bool sp_visible_ranges_meet(const struct sp_visible_ranges *ranges, double low, double high);

#endif
