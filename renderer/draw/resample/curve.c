/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/resample/curve.h"

#include <math.h>
#include <string.h>

/* Values farther from the visible ones than this many times the span of these are moved there, so
 * that codes stay fine where the transfer function changes. */
static const double spans_beyond = 16;

bool sp_curve_shows(const struct sp_transfer_function *tf, double low, double high) {
    const struct sp_tf_point *p = tf->points;
    uint32_t last = tf->point_count - 1;
    if (!(low <= high))
        return false;
    if ((low <= p[0].value && p[0].opacity > 0) || (high >= p[last].value && p[last].opacity > 0))
        return true;
    for (uint32_t i = 0; i <= last; i++)
        if (low <= p[i].value && high >= p[i].value && p[i].opacity > 0)
            return true;
    for (uint32_t i = 0; i < last; i++)
        if (low < p[i + 1].value && high > p[i].value && (p[i].opacity > 0 || p[i + 1].opacity > 0))
            return true;
    return false;
}

bool sp_curve_shows_all(const struct sp_transfer_function *tf, double low, double high) {
    const struct sp_tf_point *p = tf->points;
    uint32_t last = tf->point_count - 1;
    if ((low < p[0].value && !(p[0].opacity > 0)) ||
        (high > p[last].value && !(p[last].opacity > 0)))
        return false;
    for (uint32_t i = 0; i < last; i++)
        if (low < p[i + 1].value && high > p[i].value && !(p[i].opacity > 0) &&
            !(p[i + 1].opacity > 0))
            return false;
    return true;
}

struct bins {
    const struct sp_curve *curve;
    double low, step; /* value where bin 0 begins; width of a bin */
};

/* Writes the mean of the class over bin i, times its depth, to integral[i + 2]. */
static void fill_bins(void *user, size_t begin, size_t end, unsigned worker) {
    enum { PARTS = 8 };
    const struct bins *bins = user;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        double sum[4] = { 0 };
        for (int k = 0; k < PARTS; k++) {
            struct sp_class class;
            double value = bins->low + ((double)i + (k + 0.5) / PARTS) * bins->step;
            sp_transfer_function_eval(bins->curve->tf, value, &class);
            for (int c = 0; c < 3; c++)
                sum[c] += (double)class.color[c] * (double)class.depth / PARTS;
            sum[3] += (double)class.depth / PARTS;
        }
        for (int c = 0; c < 4; c++)
            bins->curve->integral[i + 2][c] = (float)sum[c];
    }
}

/* Fills the integral. Optical depths take most of the time, so they are found on all threads. */
static void integrate(const struct sp_curve *curve, double low, double step, struct sp_pool *pool) {
    struct bins bins = { curve, low, step };
    memset(curve->integral[0], 0, 2 * sizeof curve->integral[0]);
    sp_parallel_for(pool, CURVE_BINS, CURVE_BINS / 32, fill_bins, &bins);
    for (uint32_t i = 2; i < CURVE_BINS + 2; i++)
        for (int c = 0; c < 4; c++)
            curve->integral[i][c] += curve->integral[i - 1][c];
}

/* The values between which the transfer function may show something different. Where its first
 * point is visible, all lower values are; where its last point is, all higher values look like it.
 */
static void bound_visible(const struct sp_transfer_function *tf, double low, double high,
                          double visible[2]) {
    uint32_t first = 0, last = tf->point_count - 1;
    while (first < last && !(tf->points[first].opacity > 0))
        first++;
    while (last > first && !(tf->points[last].opacity > 0))
        last--;
    visible[0] = first > 0 ? tf->points[first - 1].value : low;
    visible[1] = tf->points[last + 1 < tf->point_count ? last + 1 : last].value;
    visible[0] = fmin(fmax(visible[0], low), high);
    visible[1] = fmin(fmax(visible[1], low), high);
}

void sp_curve_init(struct sp_curve *curve, const struct sp_transfer_function *tf,
                   const double range[2], float (*integral)[4], struct sp_pool *pool) {
    const double most = 8e307; /* so that differences do not overflow */
    double low = fmax(range[0], -most), high = fmin(range[1], most), visible[2];
    bound_visible(tf, low, high, visible);
    double span = visible[1] - visible[0];
    if (span > 0) {
        low = fmax(low, visible[0] - spans_beyond * span);
        high = fmin(high, visible[1] + spans_beyond * span);
    }
    if (!(high > low)) {
        low -= 0.5 * fmax(1, fabs(low));
        high += 0.5 * fmax(1, fabs(high));
    }
    *curve = (struct sp_curve){ .base = low,
                                .data = { -INFINITY, INFINITY },
                                .codes_per_unit = (CURVE_CODE_MAX - CURVE_CODE_MIN) / (high - low),
                                .integral = integral,
                                .tf = tf };
    /* If the smallest value may be visible, the bins begin half way down to CURVE_CODE_NONE. */
    struct sp_class ends[2];
    sp_transfer_function_eval(tf, low, &ends[0]);
    sp_transfer_function_eval(tf, high, &ends[1]);
    bool is_lowest = ends[0].depth > 0;
    double from = is_lowest ? low - CURVE_CODE_MIN / 2 / curve->codes_per_unit : visible[0];
    double to = visible[1] > from ? visible[1] : from + (high - low) / CURVE_BINS;
    double step = (to - from) / (CURVE_BINS - 1);
    integrate(curve, from, step, pool);
    double per_code = 1 / (step * curve->codes_per_unit);
    double code = CURVE_CODE_MIN + (from - low) * curve->codes_per_unit;
    curve->bins_per_code = (float)per_code;
    curve->first_bin = (float)(1 - code * per_code);
    curve->visible[0] = (float)code;
    for (int c = 0; c < 4; c++)
        curve->above[c] = (c < 3 ? ends[1].color[c] : 1) * ends[1].depth;
    curve->has_above = ends[1].depth > 0;
    curve->visible[1] =
        ends[1].depth > 0 ? INFINITY : (float)(CURVE_CODE_MIN + (to - low) * curve->codes_per_unit);
}
