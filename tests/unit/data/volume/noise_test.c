/* SPDX-License-Identifier: Apache-2.0
 *
 * The estimate of noise against noise of known deviation.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "base/parallel_for.h"
#include "data/volume/noise.h"
#include "data/volume/sample.h"

enum { SIDE = 48, COUNT = SIDE * SIDE * SIDE };

static uint32_t random_bits;

/* Uniform in [0, 1). */
static double uniform(void) {
    random_bits = random_bits * 1664525u + 1013904223u;
    return (random_bits >> 8) / 16777216.0;
}

/* About normal, of deviation 1. */
static double normal(void) {
    double sum = -6;
    for (int i = 0; i < 12; i++)
        sum += uniform();
    return sum;
}

/* A ball of value 200 in 50, with an edge of about two samples. */
static double ball(const double x[3]) {
    double square = 0;
    for (int a = 0; a < 3; a++)
        square += (x[a] - 24) * (x[a] - 24);
    return 125 - 75 * tanh((sqrt(square) - 16) / 1.5);
}

struct volume {
    struct sp_volume_info info;
    char voxels[COUNT * sizeof(double)];
};

static struct volume *make(enum sp_type type, double deviation, double step) {
    struct volume *v = calloc(1, sizeof *v);
    assert_non_null(v);
    v->info = (struct sp_volume_info){ .type = type, .data = { 0, 255 } };
    random_bits = 1;
    for (int a = 0; a < 3; a++) {
        v->info.grid.dims[a] = SIDE;
        v->info.grid.spacing[a] = a == 2 ? step : 1;
    }
    for (size_t i = 0; i < COUNT; i++) {
        const double x[3] = { (double)(i % SIDE), (double)(i / SIDE % SIDE),
                              24 + step * ((double)(i / SIDE / SIDE) - 24) };
        const double value = fmin(fmax(ball(x) + deviation * normal(), 0), 255);
        sp_sample_set(v->voxels, type, i, type == SP_FLOAT32 ? value : rint(value));
    }
    return v;
}

static double estimate_by(const struct volume *v, unsigned threads) {
    struct sp_error err;
    struct sp_pool *pool = sp_pool_create(threads, &err);
    double noise = NAN;
    assert_non_null(pool);
    assert_true(sp_noise_estimate(&v->info, v->voxels, pool, &noise));
    sp_pool_destroy(&pool);
    return noise;
}

static double estimate(const struct volume *v) {
    return estimate_by(v, 1);
}

static void the_estimate_is_the_noise_s_deviation(void **state) {
    static const enum sp_type types[] = { SP_UINT8, SP_INT16, SP_FLOAT32 };
    (void)state;
    for (int t = 0; t < 3; t++)
        for (double deviation = 2; deviation < 10; deviation *= 2)
            for (double step = 1; step < 3; step++) {
                struct volume *v = make(types[t], deviation, step);
                double found = estimate(v);
                assert_true(found > 0.75 * deviation && found < 1.3 * deviation);
                free(v);
            }
}

static void exact_values_have_nearly_none(void **state) {
    struct volume *v = make(SP_FLOAT32, 0, 1);
    (void)state;
    assert_true(estimate(v) < 0.003 * 150);
    free(v);
}

/* Labels, small volumes, and volumes of one value have no surfaces with noise. */
static void some_volumes_have_no_noise(void **state) {
    struct volume *v = make(SP_UINT8, 6, 1);
    (void)state;
    v->info.meaning = SP_MEANING_LABELS;
    assert_true(estimate(v) == 0);
    v->info.meaning = SP_MEANING_UNKNOWN;
    v->info.grid.dims[1] = 6;
    assert_true(estimate(v) == 0);
    v->info.grid.dims[1] = SIDE;
    for (size_t i = 0; i < COUNT; i++)
        v->voxels[i] = 9;
    assert_true(estimate(v) == 0);
    free(v);
}

/* Neither NaN nor the value that stands for missing data counts as an edge. */
static void missing_samples_are_left_out(void **state) {
    struct volume *v = make(SP_FLOAT32, 3, 1);
    (void)state;
    for (size_t i = 0; i < COUNT; i += 97)
        ((float *)(void *)v->voxels)[i] = i % 2 ? NAN : -9999;
    double found = estimate(v);
    assert_true(found > 0.75 * 3 && found < 1.3 * 3);
    free(v);
}

static void threads_change_nothing(void **state) {
    struct volume *v = make(SP_UINT8, 4, 1);
    (void)state;
    assert_true(estimate_by(v, 4) == estimate_by(v, 1));
    free(v);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_estimate_is_the_noise_s_deviation),
        cmocka_unit_test(exact_values_have_nearly_none),
        cmocka_unit_test(some_volumes_have_no_noise),
        cmocka_unit_test(missing_samples_are_left_out),
        cmocka_unit_test(threads_change_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
