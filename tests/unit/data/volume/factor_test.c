/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "data/volume/factor.h"
#include "support/compare.h"

/* L·Lᵀ. */
static void multiply(const float f[6], double out[3][3]) {
    const double l[3][3] = { { (double)f[0], 0, 0 },
                             { (double)f[1], (double)f[2], 0 },
                             { (double)f[3], (double)f[4], (double)f[5] } };
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            out[i][j] = 0;
            for (int k = 0; k < 3; k++)
                out[i][j] += l[i][k] * l[j][k];
        }
}

static void factors_give_the_variance(void **state) {
    (void)state;
    srand(7);
    for (int trial = 0; trial < 1000; trial++) {
        double m[3][3], got[3][3];
        float factor[6];
        for (int i = 0; i < 9; i++)
            m[i / 3][i % 3] = trial % 7 < i % 3 ? 0 : 2.0 * rand() / RAND_MAX - 1;
        sp_factor((const double(*)[3])m, factor);
        multiply(factor, got);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                assert_float_equal(got[i][j],
                                   m[i][0] * m[j][0] + m[i][1] * m[j][1] + m[i][2] * m[j][2], 1e-6);
        assert_compare(factor[0], >=, 0);
        assert_compare(factor[2], >=, 0);
        assert_compare(factor[5], >=, 0);
    }
}

/* The product M·Mᵀ would lose the small scale: 1e-20 beside 1. */
static void small_scales_stay(void **state) {
    const double scales[3] = { 1, 1, 1e-10 }, turn[4] = { 0, 0, 0, 0 };
    float factor[6];
    (void)state;
    sp_gaussian_factor(scales, turn, factor);
    assert_float_equal(factor[5] / 1e-10f, 1, 1e-6);
}

/* A turn by 120° around the diagonal takes x to y, y to z, and z to x. */
static void quaternions_turn_to_the_right(void **state) {
    const double scales[3] = { 2, 3, 5 }, turn[4] = { 4, 4, 4, 4 };
    float factor[6];
    (void)state;
    sp_gaussian_factor(scales, turn, factor);
    assert_float_equal(factor[0], 5, 1e-6);
    assert_float_equal(factor[2], 2, 1e-6);
    assert_float_equal(factor[5], 3, 1e-6);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(factors_give_the_variance),
        cmocka_unit_test(small_scales_stay),
        cmocka_unit_test(quaternions_turn_to_the_right),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
