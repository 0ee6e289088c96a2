/* SPDX-License-Identifier: Apache-2.0 */
#include "support/field.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/grid.h"
#include "support/cubic.h"

enum { REACH_MAX = 20, TAPS_MAX = 2 * REACH_MAX + 1 };

/* Returns the distance of sample i from sample 0; beyond the border the last gap repeats. */
static double place_of(const struct sp_grid *grid, unsigned a, long i) {
    long n = (long)grid->dims[a], inside = i < 0 ? 0 : i >= n ? n - 1 : i;
    return sp_grid_distance(grid, a, (uint32_t)inside) +
           (double)(i - inside) * sp_grid_local_spacing(grid, a, (uint32_t)inside);
}

/* Returns how many samples a kernel can be away from the sample nearest to a point and still reach
 * the point; at most REACH_MAX + 1. A sample is the nearest one up to half a gap away. */
static int axis_reach(const struct sp_grid *grid, unsigned a, double radius) {
    long reach = 1;
    if (!grid->coordinates[a])
        return (int)ceil(fmin(radius, 100) - 0.5 - 1e-9);
    for (long j = 0; j < (long)grid->dims[a]; j++)
        for (long k = -REACH_MAX - 1; k <= REACH_MAX + 1; k++) {
            double edge = 0.5 * (place_of(grid, a, j + k) + place_of(grid, a,
                                                                     j + k -
                                                                         (k > 0   ? 1
                                                                          : k < 0 ? -1
                                                                                  : 0)));
            double r = radius * sp_grid_local_spacing(grid, a, (uint32_t)j);
            if (fabs(edge - place_of(grid, a, j)) < r && labs(k) > reach)
                reach = labs(k);
        }
    return (int)reach;
}

static bool axis_init(struct test_axis *axis, const struct sp_grid *grid, unsigned a, int pad,
                      size_t count) {
    long n = (long)grid->dims[a];
    axis->even = !grid->coordinates[a];
    axis->place = malloc(count * sizeof *axis->place);
    axis->size = malloc(count * sizeof *axis->size);
    axis->step = grid->spacing[a];
    if (!axis->place || !axis->size)
        return false;
    for (long i = 0; i < (long)count; i++) {
        long inside = i - pad < 0 ? 0 : i - pad >= n ? n - 1 : i - pad;
        axis->place[i] = place_of(grid, a, i - pad);
        axis->size[i] = sp_grid_local_spacing(grid, a, (uint32_t)inside);
        axis->step = fmin(axis->step, axis->size[i]);
    }
    return true;
}

bool test_field_init(struct test_field *f, const struct sp_grid *grid,
                     const struct sp_filter *filter, double radius, int quads) {
    *f = (struct test_field){ .quads = quads, .kernel = filter->kernel, .sigma = filter->sigma };
    double voxels = f->kernel == SP_KERNEL_CUBIC ? TEST_CUBIC_RADIUS : radius * f->sigma;
    f->reach = 1;
    for (unsigned a = 0; a < 3; a++) {
        int reach = axis_reach(grid, a, voxels);
        f->reach = reach > f->reach ? reach : f->reach;
    }
    if (f->reach > REACH_MAX)
        return false;
    f->pad = 2 * f->reach + 1;
    size_t count = 1;
    for (int a = 0; a < 3; a++)
        count *= f->dims[a] = grid->dims[a] + 2 * (size_t)f->pad;
    size_t bytes = count * (size_t)quads * sizeof *f->voxels;
    f->voxels = aligned_alloc(sizeof *f->voxels, bytes);
    f->near_by = calloc(count, 1);
    f->lattice = malloc(TAPS_MAX * sizeof *f->lattice);
    if (!f->voxels || !f->near_by || !f->lattice)
        return false;
    memset(f->voxels, 0, bytes);
    for (int k = -f->reach; k <= f->reach; k++)
        f->lattice[k + f->reach] =
            exp(-0.5 * k * k / (f->sigma * f->sigma)) / (sqrt(2 * M_PI) * f->sigma);
    for (unsigned a = 0; a < 3; a++)
        if (!axis_init(&f->axes[a], grid, a, f->pad, f->dims[a]))
            return false;
    return true;
}

void test_field_finish(struct test_field *f) {
    for (int a = 0; a < 3; a++) {
        free(f->axes[a].place);
        free(f->axes[a].size);
    }
    free(f->voxels);
    free(f->near_by);
    free(f->lattice);
    *f = (struct test_field){ 0 };
}

static size_t index_of(const struct test_field *f, size_t x, size_t y, size_t z) {
    return x + f->dims[0] * (y + f->dims[1] * z);
}

void test_field_set(struct test_field *f, const uint32_t i[3], const test_quad *numbers) {
    size_t pad = (size_t)f->pad, at = index_of(f, i[0] + pad, i[1] + pad, i[2] + pad);
    for (int q = 0; q < f->quads; q++)
        f->voxels[at * (size_t)f->quads + (size_t)q] = numbers[q];
    f->near_by[at] = 1;
}

/* Spreads the marks of `near_by` by `reach` along one axis. */
static bool spread(struct test_field *f, int axis) {
    size_t count = f->dims[0] * f->dims[1] * f->dims[2];
    size_t stride = axis == 0 ? 1 : axis == 1 ? f->dims[0] : f->dims[0] * f->dims[1];
    unsigned char *was = malloc(count);
    if (!was)
        return false;
    memcpy(was, f->near_by, count);
    for (size_t i = 0; i < count; i++) {
        if (!was[i])
            continue;
        long at = (long)(i / stride % f->dims[axis]);
        for (long k = -f->reach; k <= f->reach; k++)
            if (at + k >= 0 && at + k < (long)f->dims[axis])
                f->near_by[(size_t)((long)i + k * (long)stride)] = 1;
    }
    free(was);
    return true;
}

bool test_field_close(struct test_field *f) {
    return spread(f, 0) && spread(f, 1) && spread(f, 2);
}

/* Sets the smallest and largest f of the samples whose kernels reach the cell of the padded sample
 * `middle`. */
static void range_around(const struct test_field *f, const long middle[3], double range[2]) {
    long r = f->reach;
    range[0] = INFINITY;
    range[1] = -INFINITY;
    for (long z = middle[2] - r; z <= middle[2] + r; z++)
        for (long y = middle[1] - r; y <= middle[1] + r; y++)
            for (long x = middle[0] - r; x <= middle[0] + r; x++) {
                size_t at = index_of(f, (size_t)x, (size_t)y, (size_t)z) * (size_t)f->quads;
                if (f->voxels[at][1] <= 0)
                    continue;
                range[0] = fmin(range[0], f->voxels[at][0]);
                range[1] = fmax(range[1], f->voxels[at][0]);
            }
}

void test_field_hide(struct test_field *f, test_interval_fn *visible, const void *user) {
    long r = f->reach, i[3];
    for (i[2] = r; i[2] < (long)f->dims[2] - r; i[2]++)
        for (i[1] = r; i[1] < (long)f->dims[1] - r; i[1]++)
            for (i[0] = r; i[0] < (long)f->dims[0] - r; i[0]++) {
                size_t at = index_of(f, (size_t)i[0], (size_t)i[1], (size_t)i[2]);
                double range[2];
                if (!f->near_by[at])
                    continue;
                range_around(f, i, range);
                f->near_by[at] = visible(user, range[0], range[1]);
            }
}

/* Returns the padded sample nearest to p. */
static long nearest(const struct test_field *f, int a, double p) {
    const struct test_axis *axis = &f->axes[a];
    if (axis->even)
        return (long)floor(p / axis->step + 0.5) + f->pad;
    long low = 0, high = (long)f->dims[a] - 1;
    while (high - low > 1) {
        long middle = (low + high) / 2;
        if (axis->place[middle] <= p)
            low = middle;
        else
            high = middle;
    }
    return p - axis->place[low] < axis->place[high] - p ? low : high;
}

/* Sets the normal densities at the 2·reach + 1 lattice points around an offset `d` in [-½, ½]:
 * exp(-(k-d)²/2σ²) = exp(-d²/2σ²)·exp(d/σ²)^k·exp(-k²/2σ²). */
static void lattice_weights(const struct test_field *f, double d, double *w) {
    double s = 1 / (f->sigma * f->sigma), middle = exp(-0.5 * d * d * s), up = exp(d * s);
    double right = middle, left = middle, down = 1 / up;
    w[f->reach] = middle * f->lattice[f->reach];
    for (int k = 1; k <= f->reach; k++) {
        right *= up;
        left *= down;
        w[f->reach + k] = right * f->lattice[f->reach + k];
        w[f->reach - k] = left * f->lattice[f->reach - k];
    }
}

/* Gaussian: the kernels' densities along one axis. Cubic: squared distances in voxels. */
static void axis_weights(const struct test_field *f, int a, double p, long base, double *w) {
    const struct test_axis *axis = &f->axes[a];
    if (axis->even && f->kernel == SP_KERNEL_GAUSSIAN) {
        lattice_weights(f, p / axis->step - (double)(base - f->pad), w);
        return;
    }
    for (int k = -f->reach; k <= f->reach; k++) {
        double d = (p - axis->place[base + k]) / axis->size[base + k];
        w[k + f->reach] = f->kernel == SP_KERNEL_CUBIC
                              ? d * d
                              : f->lattice[f->reach] * exp(-0.5 * d * d / (f->sigma * f->sigma));
    }
}

/* Most of the time of the conformance tests is spent in sum_gaussians(): with AVX2 a quad is one
 * register. No fused operations, so both versions give the same numbers. Sanitizers cannot start
 * with such functions. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) &&                             \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define WITH_AVX2 __attribute__((target_clones("avx2", "default")))
#else
#define WITH_AVX2
#endif

/* Sums the rows y to y + count - 1 of a plane. The sums of the rows do not depend on one another,
 * so the processor adds to all of them at a time. */
static inline __attribute__((always_inline)) void sum_rows(const struct test_field *f,
                                                           const test_quad *first, int count,
                                                           const double *w, test_quad *rows) {
    size_t stride = index_of(f, 0, 1, 0) * (size_t)f->quads;
    for (int i = 0; i < count; i++)
        rows[i] = (test_quad){ 0 };
    for (int x = 0; x < 2 * f->reach + 1; x++)
        for (int i = 0; i < count; i++)
            rows[i] += w[x] * first[(size_t)i * stride + (size_t)(x * f->quads)];
}

WITH_AVX2 static void sum_gaussians(const struct test_field *f, const test_quad *first,
                                    double w[3][TAPS_MAX], test_quad *sum) {
    int taps = 2 * f->reach + 1;
    test_quad all = { 0 };
    for (int z = 0; z < taps; z++) {
        test_quad plane = { 0 }, rows[7];
        for (int y = 0; y < taps;) {
            const test_quad *v = first + index_of(f, 0, (size_t)y, (size_t)z) * (size_t)f->quads;
            int count = taps - y < 8 ? taps - y : 4;
            switch (count) { /* constants, so that the compiler keeps the rows in registers */
            case 4:
                sum_rows(f, v, 4, w[0], rows);
                break;
            case 5:
                sum_rows(f, v, 5, w[0], rows);
                break;
            case 7:
                sum_rows(f, v, 7, w[0], rows);
                break;
            default:
                sum_rows(f, v, count, w[0], rows);
            }
            for (int i = 0; i < count; i++)
                plane += w[1][y++] * rows[i];
        }
        all += w[2][z] * plane;
    }
    *sum = all;
}

static void sum_cubics(const struct test_field *f, const test_quad *first, double r2[3][TAPS_MAX],
                       test_quad *sum) {
    const double end = TEST_CUBIC_RADIUS * TEST_CUBIC_RADIUS;
    int taps = 2 * f->reach + 1;
    test_quad all = { 0 };
    for (int z = 0; z < taps; z++)
        for (int y = 0; y < taps; y++) {
            const test_quad *v = first + index_of(f, 0, (size_t)y, (size_t)z) * (size_t)f->quads;
            double aside = r2[2][z] + r2[1][y];
            for (int x = 0; x < taps && aside < end; x++)
                if (aside + r2[0][x] < end)
                    all += test_cubic(sqrt(aside + r2[0][x])) * v[x * f->quads];
        }
    *sum = all;
}

bool test_field_at(const struct test_field *f, const double p[3], test_quad *sums) {
    double w[3][TAPS_MAX];
    long base[3];
    for (int a = 0; a < 3; a++) {
        base[a] = nearest(f, a, p[a]);
        if (base[a] < f->reach || base[a] >= (long)f->dims[a] - f->reach)
            return false;
    }
    if (!f->near_by[index_of(f, (size_t)base[0], (size_t)base[1], (size_t)base[2])])
        return false;
    size_t corner[3];
    for (int a = 0; a < 3; a++) {
        axis_weights(f, a, p[a], base[a], w[a]);
        corner[a] = (size_t)(base[a] - f->reach);
    }
    const test_quad *first =
        f->voxels + index_of(f, corner[0], corner[1], corner[2]) * (size_t)f->quads;
    for (int q = 0; q < f->quads; q++)
        if (f->kernel == SP_KERNEL_CUBIC)
            sum_cubics(f, first + q, w, &sums[q]);
        else
            sum_gaussians(f, first + q, w, &sums[q]);
    return true;
}

bool test_field_span(const struct test_field *f, const double p[3], const double d[3], double *from,
                     double *to) {
    *from = 0;
    *to = INFINITY;
    for (int a = 0; a < 3; a++) {
        double low = f->axes[a].place[f->reach];
        double high = f->axes[a].place[f->dims[a] - 1 - (size_t)f->reach];
        if (fabs(d[a]) < 1e-300) {
            if (p[a] < low || p[a] > high)
                return false;
            continue;
        }
        double l0 = (low - p[a]) / d[a], l1 = (high - p[a]) / d[a];
        *from = fmax(*from, fmin(l0, l1));
        *to = fmin(*to, fmax(l0, l1));
    }
    return *from < *to;
}
