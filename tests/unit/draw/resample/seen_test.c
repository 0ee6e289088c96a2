/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "draw/resample/seen.h"

/* Returns the place where an interval is seen. Its half k is visible from front[k] to
 * front[k] + length[k]. */
static double compute_place(const double front[2], const double length[2], const double depth[2],
                            const double brightness[2]) {
    struct sp_seen_half half[2];
    sp_wide opacity[2] = { sp_wide_all((float)-expm1(-depth[0])),
                           sp_wide_all((float)-expm1(-depth[0] - depth[1])) };
    for (int k = 0; k < 2; k++) {
        half[k].front = sp_wide_all((float)front[k]);
        half[k].length = sp_wide_all((float)length[k]);
        half[k].depth = sp_wide_all((float)depth[k]);
        half[k].light = sp_wide_all((float)(brightness[k] * depth[k]));
    }
    return (double)sp_seen_place(half, opacity)[0];
}

/* The mean place of the light by the integral itself. Extinction is constant in each half. */
static double integrate(const double front[2], const double length[2], const double depth[2],
                        const double brightness[2]) {
    enum { STEPS = 2000 };
    double left = 1, sum = 0, light = 0;
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < STEPS; i++) {
            double opacity = left * -expm1(-depth[k] / STEPS), share = brightness[k] * opacity;
            sum += share * 0.5 * (k + front[k] + length[k] * (i + 0.5) / STEPS);
            light += share;
            left -= opacity;
        }
    return sum / light;
}

static void the_share_is_the_mean_place_of_a_layer_s_light(void **state) {
    (void)state;
    for (double d = 1e-6; d < 200; d *= 1.3) {
        double exact = d < 1e-3 ? 0.5 - d / 12 : 1 / d - 1 / expm1(d);
        assert_float_equal((double)sp_seen_share(sp_wide_all((float)d))[0], exact, 0.02);
    }
}

/* If the second half emits more light, halves are seen farther back by up to an eighth. */
static void the_place_is_the_mean_place_of_both_halves(void **state) {
    static const double parts[][2][2] = { { { 0, 1 }, { 0, 1 } },
                                          { { 0.7, 0.3 }, { 0, 1 } },
                                          { { 0, 0.4 }, { 0.9, 0.1 } },
                                          { { 0.2, 0.5 }, { 0.3, 0.7 } } };
    static const double depths[] = { 1e-4, 0.1, 1, 6, 40 };
    static const double colors[][2] = { { 1, 1 }, { 0.1, 3 }, { 2, 0.2 } };
    (void)state;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 75; j++) {
            const double front[2] = { parts[i][0][0], parts[i][1][0] };
            const double length[2] = { parts[i][0][1], parts[i][1][1] };
            const double depth[2] = { depths[j / 5 % 5], depths[j % 5] };
            const double *color = colors[j / 25];
            const double most = depth[0] * color[0] < depth[1] * color[1] ? 0.052 : 0.02;
            assert_float_equal(compute_place(front, length, depth, color),
                               integrate(front, length, depth, color), most);
        }
}

/* Light that rises linearly from zero over both halves comes on average from 2/3. */
static void rising_light_is_seen_farther_back(void **state) {
    const double front[2] = { 0, 0 }, length[2] = { 1, 1 }, bright[2] = { 1, 1 };
    (void)state;
    double even = compute_place(front, length, (double[]){ 2e-3, 2e-3 }, bright);
    double rising = compute_place(front, length, (double[]){ 1e-3, 3e-3 }, bright);
    assert_float_equal(even, 0.5, 1e-3);
    assert_float_equal(rising, 2 / 3.0, 0.03);
}

/* A surface in the second half is seen there, however thin it is; where nothing is seen, the place
 * is still in the interval. */
static void the_place_is_where_something_is_visible(void **state) {
    const double bright[2] = { 1, 1 };
    (void)state;
    double place =
        compute_place((double[]){ 1, 0.98 }, (double[]){ 0, 0.02 }, (double[]){ 0, 1e-5 }, bright);
    assert_float_equal(place, 0.995, 2e-3);
    place =
        compute_place((double[]){ 0.5, 0 }, (double[]){ 0.01, 0 }, (double[]){ 1e-5, 0 }, bright);
    assert_float_equal(place, 0.2525, 2e-3);
    place = compute_place((double[]){ 1, 1 }, (double[]){ 0, 0 }, (double[]){ 0, 0 }, bright);
    assert_float_equal(place, 0.75, 0.25);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_share_is_the_mean_place_of_a_layer_s_light),
        cmocka_unit_test(the_place_is_the_mean_place_of_both_halves),
        cmocka_unit_test(rising_light_is_seen_farther_back),
        cmocka_unit_test(the_place_is_where_something_is_visible),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
