/* SPDX-License-Identifier: Apache-2.0
 *
 * Properties of the kernels: the ripple of a constant field, and the contrast that detail keeps. No
 * backend is involved.
 *
 * Claims: the published values of the cubic kernel (Crawfis & Max 1993, with the coefficients of
 * the mathematics page), in space and for the footprint of one layer; and the ripple of Gaussians
 * up to σ = 0.8 voxels, as on the mathematics page.
 */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "splat/cubic.h"

enum { STEPS = 100 }; /* sample points per voxel edge */

/* Returns Σ g over all voxels, at a point inside the cell. */
static double sum_cubics(double x, double y, double z) {
    double sum = 0;
    for (int k = -2; k <= 3; k++)
        for (int j = -2; j <= 3; j++)
            for (int i = -2; i <= 3; i++)
                sum += sp_cubic(sqrt((x - i) * (x - i) + (y - j) * (y - j) + (z - k) * (z - k)));
    return sum;
}

/* Returns Σ F over the voxels of one layer, projected along the third axis. */
static double sum_footprints(double x, double y) {
    double sum = 0;
    for (int j = -2; j <= 3; j++)
        for (int i = -2; i <= 3; i++)
            sum += sp_cubic_footprint(hypot(x - i, y - j));
    return sum;
}

/* Compares with a published value, to `digits` decimals. */
static bool check(const char *what, double got, double published, int digits) {
    bool ok = fabs(got - published) <= 0.5 * pow(10, -digits);
    printf("%-6s %-40s %+.7f, published %+.*f\n", ok ? "ok" : "FAILED", what, got, digits,
           published);
    return ok;
}

struct extreme {
    double value, at[3];
};

/* The deviation of Σ g over a cell, relative to its mean. */
struct ripple {
    double rms;
    struct extreme high, low; /* in the octant next to a voxel; the others are symmetric */
};

static struct ripple measure_ripple(void) {
    struct ripple r = { .high.value = 0, .low.value = 2 };
    double count = (double)STEPS * STEPS * STEPS, mean = 0, square = 0;
    for (int k = 0; k < STEPS; k++)
        for (int j = 0; j < STEPS; j++)
            for (int i = 0; i < STEPS; i++) {
                double x = (double)i / STEPS, y = (double)j / STEPS, z = (double)k / STEPS;
                double sum = sum_cubics(x, y, z);
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

static bool check_cubic(void) {
    struct ripple r = measure_ripple();
    const double *high = r.high.at, *low = r.low.at;
    printf("the cubic kernel: largest at (%.2f, %.2f, %.2f), smallest at (%.2f, %.2f, %.2f)\n",
           high[0], high[1], high[2], low[0], low[1], low[2]);
    bool ok = high[0] + high[1] + high[2] == 1 && fmin(high[0], fmin(high[1], high[2])) == 0;
    for (int a = 0; a < 3; a++)
        ok = ok && (high[a] == 0 || high[a] == 0.5) && fabs(low[a] - 0.26) < 0.015;
    if (!ok)
        printf("FAILED: the published positions are (0.5, 0.5, 0) and about (0.26, 0.26, 0.26)\n");
    ok = check("rms deviation (0.00119 to 0.00120)", r.rms, 0.001195, 5) && ok;
    ok = check("largest deviation", r.high.value, 0.00534, 5) && ok;
    ok = check("smallest deviation", r.low.value, -0.00233, 5) && ok;
    ok = check("one layer's projection at (1/2, 1/2)", sum_footprints(0.5, 0.5), 1.00249, 5) && ok;
    ok =
        check("one layer's projection at (1/4, 1/4)", sum_footprints(0.25, 0.25), 0.99845, 5) && ok;
    return ok;
}

/* Returns the contrast that a wave of this frequency [1/voxel] keeps: the Fourier transform of the
 * kernel at the frequency over that at 0. For a spherical kernel it is ∫ g(r) sin(2πfr)/(2πfr) r²
 * dr. */
static double cubic_contrast(double frequency) {
    enum { PANELS = 4000 };
    double sum = 0, all = 0;
    for (int i = 0; i < PANELS; i++) {
        double r = (i + 0.5) * SP_CUBIC_RADIUS / PANELS, p = 2 * M_PI * frequency * r;
        sum += sp_cubic(r) * r * r * sin(p) / p;
        all += sp_cubic(r) * r * r;
    }
    return sum / all;
}

static double gaussian_contrast(double sigma, double frequency) {
    return exp(-2 * M_PI * M_PI * sigma * sigma * frequency * frequency);
}

/* Returns the relative rms deviation of Σ r over a cell. By Poisson summation, Σ r is a product
 * over the axes of 1 + Σ 2·Ĝ(m) cos 2πmx. */
static double gaussian_ripple(double sigma) {
    double axis = 0; /* mean square of one factor, minus 1 */
    for (int m = 1; m <= 4; m++)
        axis += 2 * pow(gaussian_contrast(sigma, m), 2);
    return sqrt(expm1(3 * log1p(axis)));
}

static bool check_gaussians(void) {
    static const double published[][2] = {
        { 0.5, 1.8e-2 }, { 0.6, 2.0e-3 }, { 0.7, 1.5e-4 },
        { 0.8, 8e-6 },   { 1, 0 }, /* 0: no published value */
    };
    bool all = true;
    printf(
        "kernel         ripple (rms)   contrast left at 1/8    1/4    1/2 of the sampling rate\n");
    for (size_t i = 0; i < sizeof published / sizeof *published; i++) {
        double sigma = published[i][0], ripple = gaussian_ripple(sigma);
        bool ok = !(published[i][1] > 0) || fabs(ripple / published[i][1] - 1) < 0.06;
        printf("gaussian %.1f   %.2e                   %.3f  %.3f  %.3f%s\n", sigma, ripple,
               gaussian_contrast(sigma, 0.125), gaussian_contrast(sigma, 0.25),
               gaussian_contrast(sigma, 0.5),
               ok ? "" : "   FAILED: the ripple differs from the published one");
        all = all && ok;
    }
    printf("cubic          %.2e                   %.3f  %.3f  %.3f\n", measure_ripple().rms,
           cubic_contrast(0.125), cubic_contrast(0.25), cubic_contrast(0.5));
    return all;
}

int main(void) {
    bool cubic = check_cubic(), gaussians = check_gaussians();
    return cubic && gaussians ? EXIT_SUCCESS : EXIT_FAILURE;
}
