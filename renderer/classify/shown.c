/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/shown.h"

static void begin(struct sp_shown *shown, double low, bool has_low) {
    shown->interval[shown->count++] = (struct sp_shown_interval){ low, INFINITY, has_low, true };
}

/* at: the values of the points. */
static void find_intervals(struct sp_shown *shown, const struct sp_transfer_function *tf,
                           const double *at) {
    bool is_open = tf->points[0].opacity > 0;
    shown->count = 0;
    if (is_open)
        begin(shown, -INFINITY, true);
    for (uint32_t i = 0; i < tf->point_count; i++) {
        bool here = tf->points[i].opacity > 0;
        bool after = here || (i + 1 < tf->point_count && tf->points[i + 1].opacity > 0);
        if (is_open && !here) {
            shown->interval[shown->count - 1].high = at[i];
            shown->interval[shown->count - 1].has_high = false;
        }
        if (after && !(is_open && here))
            begin(shown, at[i], here);
        is_open = after;
    }
}

void sp_shown_init(struct sp_shown *shown, const struct sp_transfer_function *tf) {
    double at[SP_TF_POINTS_MAX];
    for (uint32_t i = 0; i < tf->point_count; i++)
        at[i] = tf->points[i].value;
    find_intervals(shown, tf, at);
}

void sp_shown_init_keys(struct sp_shown *shown, const struct sp_transfer_function *tf,
                        double base) {
    double at[SP_TF_POINTS_MAX];
    for (uint32_t i = 0; i < tf->point_count; i++)
        at[i] = (double)(float)(tf->points[i].value - base);
    find_intervals(shown, tf, at);
}

bool sp_shown_meets(const struct sp_shown *shown, double low, double high) {
    for (uint32_t i = 0; low <= high && i < shown->count; i++) {
        const struct sp_shown_interval *in = &shown->interval[i];
        if ((high > in->low || (in->has_low && high == in->low)) &&
            (low < in->high || (in->has_high && low == in->high)))
            return true;
    }
    return false;
}
