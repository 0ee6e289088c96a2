/* SPDX-License-Identifier: Apache-2.0
 *
 * What a transfer function shows, as intervals of values: where its opacity is more than 0. They
 * rise, and do not meet.
 */
#ifndef SP_CLASSIFY_SHOWN_H
#define SP_CLASSIFY_SHOWN_H

#include "classify/transfer.h"

struct sp_shown {
    uint32_t count;
    struct sp_shown_interval {
        double low, high;
        bool has_low, has_high; /* whether the ends are part of it */
    } interval[SP_TF_POINTS_MAX];
};

/* In values of the volume. */
void sp_shown_init(struct sp_shown *shown, const struct sp_transfer_function *tf);

/* In values as pixels have them (order post): floats, counted from `base`. */
void sp_shown_init_keys(struct sp_shown *shown, const struct sp_transfer_function *tf, double base);

/* Whether any value in [low, high] is shown; low > high: none is. */
bool sp_shown_meets(const struct sp_shown *shown, double low, double high);

#endif
