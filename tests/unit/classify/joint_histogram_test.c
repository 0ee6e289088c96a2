/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "sp/histogram.h"
#include "support/compare.h"
#include "unit/classify/volume.h"

static uint64_t sum_of(const struct sp_joint_histogram *h) {
    uint64_t sum = 0;
    for (int g = 0; g < SP_JOINT_GRADIENTS; g++)
        for (int v = 0; v < SP_JOINT_VALUES; v++)
            sum += h->counts[g][v];
    return sum;
}

/* One step between two flat halves: two columns without a gradient, and two layers of voxels with
 * the largest one. */
static void a_step_has_two_flat_values_and_one_edge(void **state) {
    (void)state;
    enum { N = 8 };
    uint8_t values[N * N * N];
    for (int i = 0; i < N * N * N; i++)
        values[i] = i % N < N / 2 ? 0 : 200;
    struct sp_volume *v = classify_make_volume((uint32_t[3]){ N, N, N }, SP_UINT8, values);
    struct sp_joint_histogram *h = malloc(sizeof *h);
    assert_true(sp_joint_histogram_count(v, h, NULL));
    assert_int_equal(h->samples, N * N * N);
    assert_int_equal(sum_of(h), h->samples);
    assert_compare(h->values[0], ==, 0);
    assert_compare(h->values[1], ==, 200);
    assert_compare(fabs(h->gradients[1] - 100), <, 1e-9);
    const int last = SP_JOINT_GRADIENTS - 1;
    assert_int_equal(h->counts[0][0], N * N * (N / 2 - 1));
    assert_int_equal(h->counts[0][SP_JOINT_VALUES - 1], N * N * (N / 2 - 1));
    assert_int_equal(h->counts[last][0], N * N);
    assert_int_equal(h->counts[last][SP_JOINT_VALUES - 1], N * N);
    free(h);
    sp_volume_unref(&v);
}

static void samples_that_are_not_finite_do_not_count(void **state) {
    (void)state;
    float values[27];
    for (int i = 0; i < 27; i++)
        values[i] = 3;
    values[0] = NAN;
    values[5] = INFINITY;
    struct sp_volume *v = classify_make_volume((uint32_t[3]){ 3, 3, 3 }, SP_FLOAT32, values);
    struct sp_joint_histogram *h = malloc(sizeof *h);
    assert_true(sp_joint_histogram_count(v, h, NULL));
    assert_int_equal(h->samples, 25);
    assert_int_equal(h->counts[0][0], 25);
    assert_compare(h->gradients[1], ==, 1);
    free(h);
    sp_volume_unref(&v);
}

/* A volume with more voxels than are counted: each part of it gives one sample. */
static void large_volumes_are_sampled_evenly(void **state) {
    (void)state;
    enum { X = 128, Y = 128, Z = 100, COUNT = X * Y * Z };
    uint16_t *values = malloc(COUNT * sizeof *values);
    assert_non_null(values);
    for (int i = 0; i < COUNT; i++)
        values[i] = (uint16_t)(i / (X * Y) * 100);
    struct sp_volume *v = classify_make_volume((uint32_t[3]){ X, Y, Z }, SP_UINT16, values);
    struct sp_joint_histogram *h = malloc(2 * sizeof *h);
    assert_true(sp_joint_histogram_count(v, h, NULL));
    assert_true(sp_joint_histogram_count(v, h + 1, NULL));
    assert_int_equal(h->samples, SP_JOINT_SAMPLES);
    assert_memory_equal(h, h + 1, sizeof *h);
    uint64_t lower = 0;
    for (int g = 0; g < SP_JOINT_GRADIENTS; g++)
        for (int b = 0; b < SP_JOINT_VALUES / 2; b++)
            lower += h->counts[g][b];
    assert_compare(fabs((double)lower / SP_JOINT_SAMPLES - 0.5), <, 0.01);
    free(h);
    free(values);
    sp_volume_unref(&v);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_step_has_two_flat_values_and_one_edge),
        cmocka_unit_test(samples_that_are_not_finite_do_not_count),
        cmocka_unit_test(large_volumes_are_sampled_evenly),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
