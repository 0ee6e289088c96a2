/* SPDX-License-Identifier: Apache-2.0
 *
 * The shares of the axes change continuously when the camera turns, and images are mixed by them.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "draw/resample/axes.h"

static void choose_axis(double azimuth, double elevation, double share[3], int *best) {
    double a = azimuth * M_PI / 180, e = elevation * M_PI / 180;
    const double along[3] = { fabs(sin(a) * cos(e)), fabs(cos(a) * cos(e)), fabs(sin(e)) };
    *best = sp_axes_choose(along, share);
}

static void one_axis_draws_most_views(void **state) {
    double share[3];
    int best;
    (void)state;
    choose_axis(20, 10, share, &best);
    assert_int_equal(best, 1);
    assert_float_equal(share[1], 1, 0);
    choose_axis(89, 50, share, &best);
    assert_int_equal(best, 2);
    assert_float_equal(share[2], 1, 0);
}

static void two_axes_share_the_switch(void **state) {
    double share[3];
    int best;
    (void)state;
    choose_axis(45, 0, share, &best);
    assert_float_equal(share[0], 0.5, 1e-9);
    assert_float_equal(share[1], 0.5, 1e-9);
    choose_axis(44, 0, share, &best); /* half of the band */
    assert_int_equal(best, 1);
    assert_float_equal(share[0], 1.0 / 3, 1e-9);
    choose_axis(42.9, 0, share, &best);
    assert_float_equal(share[0], 0, 0);
}

/* Around the diagonal, where three axes meet. */
static void shares_are_continuous(void **state) {
    const double diagonal = asin(1 / sqrt(3)) * 180 / M_PI, step = 0.01;
    (void)state;
    for (double e = diagonal - 3; e < diagonal + 3; e += 0.3) {
        double last[3], share[3];
        int best;
        choose_axis(40, e, last, &best);
        for (double a = 40 + step; a < 50; a += step) {
            double sum = 0;
            choose_axis(a, e, share, &best);
            for (int k = 0; k < 3; k++) {
                sum += share[k];
                assert_true(fabs(share[k] - last[k]) < 0.01);
                assert_true(share[k] <= share[best] + 1e-12);
            }
            assert_float_equal(sum, 1, 1e-9);
            memcpy(last, share, sizeof last);
        }
    }
}

static void pixels_are_mixed(void **state) {
    _Alignas(64) unsigned char to[64] = { 100, 0, 0, 255, 100, 50, 0, 100, 7, 7, 7, 0 };
    _Alignas(64) unsigned char from[64] = { 200, 40, 0, 255, 200, 50, 0, 0, 9, 9, 9, 0 };
    struct sp_frame frame = {
        .width = 3, .height = 1, .format = SP_RGBA8, .stride_bytes = 64, .pixels = to
    };
    (void)state;
    struct sp_pool *pool = sp_pool_create(1, NULL);
    assert_non_null(pool);
    struct sp_frame other = frame;
    other.pixels = from;
    sp_axes_mix(&frame, &other, 0.25, pool);
    const unsigned char wanted[12] = { 125, 10, 0, 255, 100, 50, 0, 75, 0, 0, 0, 0 };
    assert_memory_equal(to, wanted, sizeof wanted);
    _Alignas(64) float a[16] = { 1, 0.5f, 0, 1 };
    float b[16] = { 0, 1, 0, 1 };
    float depths[4][16] = {
        { 4, 4, INFINITY, INFINITY }, { 0 }, { 8, INFINITY, 8, INFINITY }, { 1 }
    };
    struct sp_frame floats = { .width = 4,
                               .height = 1,
                               .format = SP_RGBAF32,
                               .stride_bytes = 64,
                               .pixels = a,
                               .depth = depths[0],
                               .spread = depths[1],
                               .depth_stride_bytes = 64 };
    other = floats;
    other.pixels = b;
    other.depth = depths[2];
    other.spread = depths[3];
    sp_axes_mix(&floats, &other, 0.25, pool);
    sp_pool_destroy(&pool);
    assert_float_equal(a[0], 0.75, 1e-6);
    assert_float_equal(a[1], 0.625, 1e-6);
    assert_float_equal(depths[0][0], 5, 1e-6); /* 3/4 of 4, 1/4 of 8 ± 1 */
    assert_float_equal(depths[1][0], sqrt(0.75 * 1 + 0.25 * (9 + 1)), 1e-6);
    assert_float_equal(depths[0][1], 4, 0); /* one of them shows nothing */
    assert_float_equal(depths[0][2], 8, 0);
    assert_true(isinf(depths[0][3]));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_axis_draws_most_views),
        cmocka_unit_test(two_axes_share_the_switch),
        cmocka_unit_test(shares_are_continuous),
        cmocka_unit_test(pixels_are_mixed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
