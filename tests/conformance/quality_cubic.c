/* SPDX-License-Identifier: Apache-2.0
 *
 * The published figures of the cubic kernel (Crawfis & Max 1993, in the coefficients of the
 * mathematics page): how even a constant field comes out, in space and as one layer's footprint.
 * They are a matter of the kernel alone, so no backend takes part.
 */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "splat/cubic.h"

enum { STEPS = 100 }; /* places a voxel edge */

/* Σ g over all voxels, at a place inside the cell. */
static double sum_kernels(double x, double y, double z) {
    double sum = 0;
    for (int k = -2; k <= 3; k++)
        for (int j = -2; j <= 3; j++)
            for (int i = -2; i <= 3; i++)
                sum += sp_cubic(sqrt((x - i) * (x - i) + (y - j) * (y - j) + (z - k) * (z - k)));
    return sum;
}

/* Σ F over the voxels of one layer, seen along the third axis. */
static double sum_footprints(double x, double y) {
    double sum = 0;
    for (int j = -2; j <= 3; j++)
        for (int i = -2; i <= 3; i++)
            sum += sp_cubic_footprint(hypot(x - i, y - j));
    return sum;
}

/* The published number to `digits` decimals. */
static bool check(const char *what, double got, double published, int digits) {
    bool ok = fabs(got - published) <= 0.5 * pow(10, -digits);
    printf("%-6s %-40s %+.7f, published %+.*f\n", ok ? "ok" : "FAILED", what, got, digits,
           published);
    return ok;
}

struct extreme {
    double value, at[3];
};

struct ripple { /* of Σ g over a cell, relative to its mean */
    double rms;
    struct extreme high, low; /* in the eighth of the cell next to a voxel; the rest mirrors it */
};

static struct ripple measure_ripple(void) {
    struct ripple r = { .high.value = 0, .low.value = 2 };
    double count = (double)STEPS * STEPS * STEPS, mean = 0, square = 0;
    for (int k = 0; k < STEPS; k++)
        for (int j = 0; j < STEPS; j++)
            for (int i = 0; i < STEPS; i++) {
                double x = (double)i / STEPS, y = (double)j / STEPS, z = (double)k / STEPS;
                double sum = sum_kernels(x, y, z);
                mean += sum / count;
                square += sum * sum / count;
                if (2 * i > STEPS || 2 * j > STEPS || 2 * k > STEPS)
                    continue;
                if (sum > r.high.value)
                    r.high = (struct extreme){ sum, { x, y, z } };
                if (sum < r.low.value)
                    r.low = (struct extreme){ sum, { x, y, z } };
            }
    r.rms = sqrt(square / (mean * mean) - 1);
    r.high.value = r.high.value / mean - 1;
    r.low.value = r.low.value / mean - 1;
    return r;
}

int main(void) {
    struct ripple r = measure_ripple();
    const double *high = r.high.at, *low = r.low.at;
    printf("largest at (%.2f, %.2f, %.2f), smallest at (%.2f, %.2f, %.2f)\n", high[0], high[1],
           high[2], low[0], low[1], low[2]);
    bool ok = high[0] + high[1] + high[2] == 1 && fmin(high[0], fmin(high[1], high[2])) == 0;
    for (int a = 0; a < 3; a++)
        ok = ok && (high[a] == 0 || high[a] == 0.5) && fabs(low[a] - 0.26) < 0.015;
    if (!ok)
        printf("FAILED: published at (0.5, 0.5, 0) and near (0.26, 0.26, 0.26)\n");
    ok = check("rms deviation (0.00119 to 0.00120)", r.rms, 0.001195, 5) && ok;
    ok = check("largest deviation", r.high.value, 0.00534, 5) && ok;
    ok = check("smallest deviation", r.low.value, -0.00233, 5) && ok;
    ok = check("one layer's projection at (1/2, 1/2)", sum_footprints(0.5, 0.5), 1.00249, 5) && ok;
    ok =
        check("one layer's projection at (1/4, 1/4)", sum_footprints(0.25, 0.25), 0.99845, 5) && ok;
    return ok ? EXIT_SUCCESS : EXIT_FAILURE;
}
