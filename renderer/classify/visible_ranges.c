/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/visible_ranges.h"

static void begin(struct sp_visible_ranges *ranges, double low, bool has_low) {
    ranges->interval[ranges->count++] =
        (struct sp_visible_interval){ low, INFINITY, has_low, true };
}

/* at: the values of the points. */
static void list_intervals(struct sp_visible_ranges *ranges, const struct sp_transfer_function *tf,
                           const double *at) {
    bool is_open = tf->points[0].opacity > 0;
    ranges->count = 0;
    if (is_open)
        begin(ranges, -INFINITY, true);
    for (uint32_t i = 0; i < tf->point_count; i++) {
        bool here = tf->points[i].opacity > 0;
        bool after = here || (i + 1 < tf->point_count && tf->points[i + 1].opacity > 0);
        if (is_open && !here) {
            ranges->interval[ranges->count - 1].high = at[i];
            ranges->interval[ranges->count - 1].has_high = false;
        }
        if (after && !(is_open && here))
            begin(ranges, at[i], here);
        is_open = after;
    }
}

void sp_visible_ranges_init(struct sp_visible_ranges *ranges,
                            const struct sp_transfer_function *tf) {
    double at[SP_TF_POINTS_MAX];
    for (uint32_t i = 0; i < tf->point_count; i++)
        at[i] = tf->points[i].value;
    list_intervals(ranges, tf, at);
}

void sp_visible_ranges_init_keys(struct sp_visible_ranges *ranges,
                                 const struct sp_transfer_function *tf, double base) {
    double at[SP_TF_POINTS_MAX];
    for (uint32_t i = 0; i < tf->point_count; i++)
        at[i] = (double)(float)(tf->points[i].value - base);
    list_intervals(ranges, tf, at);
}

bool sp_visible_ranges_overlap(const struct sp_visible_ranges *ranges, double low, double high) {
    for (uint32_t i = 0; low <= high && i < ranges->count; i++) {
        const struct sp_visible_interval *in = &ranges->interval[i];
        if ((high > in->low || (in->has_low && high == in->low)) &&
            (low < in->high || (in->has_high && low == in->high)))
            return true;
    }
    return false;
}
