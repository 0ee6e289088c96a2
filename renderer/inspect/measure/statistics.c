/* SPDX-License-Identifier: Apache-2.0 */
#include "inspect/measure/statistics.h"

#include <math.h>

/* Copies the finite values. */
static void keep_finite(const struct sp_run *run, struct sp_run *finite) {
    finite->count = 0;
    for (unsigned i = 0; i < run->count; i++) {
        finite->values[finite->count] = run->values[i];
        finite->weights[finite->count] = run->weights[i];
        finite->count += isfinite(run->values[i]) != 0;
    }
}

void sp_sums_add(struct sp_sums *sums, const struct sp_run *run) {
    struct sp_run finite;
    keep_finite(run, &finite);
    sums->nonfinite += run->count - finite.count;
    if (finite.count == 0)
        return;
    double weights = 0, squares = 0, sum = 0, moment = 0, min = INFINITY, max = -INFINITY;
    for (unsigned i = 0; i < finite.count; i++) {
        const double w = finite.weights[i], x = finite.values[i];
        weights += w;
        squares += w * w;
        sum += w * x;
        min = x < min ? x : min;
        max = x > max ? x : max;
    }
    const double mean = sum / weights;
    for (unsigned i = 0; i < finite.count; i++)
        moment += finite.weights[i] * (finite.values[i] - mean) * (finite.values[i] - mean);
    const double both = sums->weights + weights, between = mean - sums->mean;
    sums->moment += moment + between * between * (sums->weights * weights / both);
    sums->mean += between * (weights / both);
    sums->weights = both;
    sums->squares += squares;
    sums->min = sums->count ? fmin(sums->min, min) : min;
    sums->max = sums->count ? fmax(sums->max, max) : max;
    sums->count += finite.count;
}

void sp_sums_finish(const struct sp_sums *sums, struct sp_statistics *statistics) {
    *statistics = (struct sp_statistics){ .count = sums->count,
                                          .nonfinite = sums->nonfinite,
                                          .mean = sums->mean,
                                          .min = sums->min,
                                          .max = sums->max };
    if (sums->count > 1)
        statistics->deviation =
            sqrt(fmax(0, sums->moment / (sums->weights - sums->squares / sums->weights)));
}
