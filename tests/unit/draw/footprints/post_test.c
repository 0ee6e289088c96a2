/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares the transfer function of pixels (order post) with the transfer function of voxels: at a
 * value, and as a mean over an interval of values.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "draw/footprints/post.h"
#include "support/compare.h"

static const double everything[2] = { -1e9, 1e9 };

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

static struct sp_transfer_function random_function(uint32_t count, double base) {
    struct sp_transfer_function tf = { .reference_length = 1, .point_count = count };
    double value = base;
    for (uint32_t i = 0; i < count; i++) {
        value += uniform(0, 1) < 0.2 ? 1e-3 : uniform(1, 40);
        tf.points[i] = (struct sp_tf_point){
            .value = value,
            .color = { (float)uniform(0, 1), (float)uniform(0, 1), (float)uniform(0, 1) },
            .opacity = rand() % 3 ? (float)uniform(0, 0.99) : 0,
        };
    }
    return tf;
}

/* Integrates extinction, and colour times extinction, by brute force. */
static void mean(const struct sp_transfer_function *tf, double value, double half, double sum[4]) {
    enum { STEPS = 20000 };
    for (int k = 0; k < 4; k++)
        sum[k] = 0;
    for (int i = 0; i < STEPS; i++) {
        struct sp_class c;
        sp_transfer_function_eval(tf, value + half * (2 * (i + 0.5) / STEPS - 1), &c);
        sum[0] += (double)c.depth / STEPS;
        for (int k = 0; k < 3; k++)
            sum[k + 1] += (double)c.color[k] * (double)c.depth / STEPS;
    }
}

static void pixels_are_classified_as_voxels_are(void **state) {
    (void)state;
    static double integral[SP_POST_NODES + 1][4];
    srand(3);
    for (int n = 0; n < 60; n++) {
        double base = n % 3 ? uniform(-1000, 1000) : 0;
        struct sp_transfer_function tf = random_function((uint32_t)(n % 12) + 1, base);
        struct sp_post_curve curve;
        sp_post_curve_init(&curve, &tf, everything, base, 1, integral);
        double first = tf.points[0].value, last = tf.points[tf.point_count - 1].value;
        for (int i = 0; i < 400; i++) {
            double value = uniform(first - 10, last + 10);
            struct sp_class want, got = sp_post_class(&curve, (float)(value - base), 0, 0);
            sp_transfer_function_eval(&tf, (double)(float)(value - base) + base, &want);
            /* Steep segments amplify the rounding of the value. */
            double slack = 1e-4 + 2e-3 * (double)want.depth;
            bool steep = fabs((double)(got.depth - want.depth)) > slack;
            for (uint32_t k = 1; steep && k < tf.point_count; k++)
                if (tf.points[k].value - tf.points[k - 1].value < 0.01 &&
                    fabs(value - tf.points[k].value) < 0.02)
                    steep = false;
            assert_false(steep);
        }
    }
}

static void intervals_are_averaged(void **state) {
    (void)state;
    static double integral[SP_POST_NODES + 1][4];
    srand(4);
    for (int n = 0; n < 40; n++) {
        struct sp_transfer_function tf = random_function((uint32_t)(n % 12) + 2, 0);
        struct sp_post_curve curve;
        sp_post_curve_init(&curve, &tf, everything, 0, 1, integral);
        double first = tf.points[0].value, last = tf.points[tf.point_count - 1].value;
        for (int i = 0; i < 8; i++) {
            double value = uniform(first - 20, last + 20), sum[4];
            double half = (last - first) * pow(10, uniform(-2.5, 0.5));
            struct sp_class got = sp_post_class(&curve, (float)value, (float)half, 0);
            mean(&tf, value, half, sum);
            /* Nodes are 1/4096 of the range apart; the mean is constant between them. */
            double slack = 1e-3 + 3e-3 * sum[0] + 5 * (last - first) / 4096 / half * 0.01;
            assert_compare(fabs((double)got.depth - sum[0]), <, slack);
            for (int k = 0; k < 3; k++)
                assert_compare(fabs((double)got.color[k] * (double)got.depth - sum[k + 1]), <,
                               slack);
        }
    }
}

static void the_gradient_scales_the_opacity(void **state) {
    (void)state;
    static double integral[SP_POST_NODES + 1][4];
    struct sp_transfer_function tf = { .reference_length = 1,
                                       .point_count = 2,
                                       .points = { { 0, { 1, 1, 1 }, 0.5f },
                                                   { 9, { 1, 1, 1 }, 0.5f } },
                                       .gradient_count = 2,
                                       .gradient = { { 10, 0.2f }, { 30, 1 } } };
    struct sp_post_curve curve;
    sp_post_curve_init(&curve, &tf, everything, 0, 100,
                       integral); /* gradient magnitudes in steps of 100 */
    for (double m = 0; m < 50; m += 2.5) {
        double scale = m < 10 ? 0.2 : m < 30 ? 0.2 + 0.04 * (m - 10) : 1;
        for (int around = 0; around < 2; around++) {
            struct sp_class c = sp_post_class(&curve, 4, around ? 3 : 0, (float)(m / 100));
            assert_compare(fabs((double)c.depth + log1p(-0.5 * scale)), <, 1e-5);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pixels_are_classified_as_voxels_are),
        cmocka_unit_test(intervals_are_averaged),
        cmocka_unit_test(the_gradient_scales_the_opacity),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
