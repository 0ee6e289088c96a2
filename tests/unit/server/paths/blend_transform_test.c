/* SPDX-License-Identifier: Apache-2.0
 *
 * The way between two transforms: what it keeps, its speed, and its ends.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "paths/blend_transform.h"
#include "support/compare.h"

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

static void multiply(const double a[16], const double b[16], double out[16]) {
    double product[16] = { 0 };
    for (int r = 0; r < 4; r++)
        for (int c = 0; c < 4; c++)
            for (int k = 0; k < 4; k++)
                product[4 * r + c] += a[4 * r + k] * b[4 * k + c];
    memcpy(out, product, sizeof product);
}

/* Turns by `degrees` about an axis of the world through a point, scales about it and then moves. */
static void make(int axis, double degrees, double scale, const double at[3], const double move[3],
                 double out[16]) {
    const double angle = degrees * M_PI / 180;
    const int i = (axis + 1) % 3, j = (axis + 2) % 3;
    memset(out, 0, 16 * sizeof *out);
    out[5 * axis] = scale;
    out[5 * i] = out[5 * j] = scale * cos(angle);
    out[4 * j + i] = scale * sin(angle);
    out[4 * i + j] = -scale * sin(angle);
    out[15] = 1;
    for (int r = 0; r < 3; r++) {
        out[4 * r + 3] = at[r] + move[r];
        for (int c = 0; c < 3; c++)
            out[4 * r + 3] -= out[4 * r + c] * at[c];
    }
}

static void apply(const double m[16], const double p[3], double out[3]) {
    for (int r = 0; r < 3; r++)
        out[r] = m[4 * r] * p[0] + m[4 * r + 1] * p[1] + m[4 * r + 2] * p[2] + m[4 * r + 3];
}

static void assert_near(const double *a, const double *b, int count, double tolerance) {
    for (int i = 0; i < count; i++)
        assert_compare(fabs(a[i] - b[i]), <=, tolerance);
}

static const double origin[3] = { 0, 0, 0 }, none[3] = { 0, 0, 0 };

static void a_move_is_straight_and_ends_are_exact(void **state) {
    const double move[3] = { 3, -4, 5e6 };
    double a[16], b[16], out[16], p[3];
    (void)state;
    make(2, 30, 2, origin, none, a);
    make(2, 30, 2, origin, move, b);
    srv_blend_transform(a, b, 0.25, out);
    apply(out, origin, p);
    assert_near(p, (const double[3]){ 0.75, -1, 1.25e6 }, 3, 1e-6);
    assert_near(out, a, 3, 1e-12);
    srv_blend_transform(a, b, 0, out);
    assert_memory_equal(out, a, sizeof a);
    srv_blend_transform(a, b, 1, out);
    assert_memory_equal(out, b, sizeof b);
    srv_blend_transform(a, a, 0.3, out);
    assert_memory_equal(out, a, sizeof a);
}

/* A layer that turns or grows about its middle stays there. */
static void what_a_turn_keeps_stays(void **state) {
    const double middle[3] = { 100, -50, 7 };
    const double cases[][2] = { { 90, 1 }, { 179.999, 1 }, { 180, 1 },   { 1e-7, 1 },
                                { 0, 3 },  { 120, 0.01 },  { -45, 1.5 }, { 0, 1 + 1e-9 } };
    (void)state;
    for (int axis = 0; axis < 3; axis++)
        for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
            for (double u = 0.1; u < 1; u += 0.2) {
                double a[16], b[16], out[16], wanted[16], p[3];
                make(axis, 0, 1, origin, none, a);
                make(axis, cases[i][0], cases[i][1], middle, none, b);
                make(axis, u * cases[i][0], pow(cases[i][1], u), middle, none, wanted);
                srv_blend_transform(a, b, u, out);
                apply(out, middle, p);
                assert_near(p, middle, 3, 1e-6);
                if (fabs(cases[i][0]) < 180) /* else it may turn either way */
                    assert_near(out, wanted, 16, 1e-6);
            }
}

static void random_similarity(double out[16]) {
    double part[16];
    make(0, 0, 1, origin, none, out);
    for (int axis = 0; axis < 3; axis++) {
        const double at[3] = { uniform(-9, 9), uniform(-9, 9), uniform(-9, 9) };
        const double move[3] = { uniform(-9, 9), uniform(-9, 9), uniform(-9, 9) };
        make(axis, uniform(-180, 180), exp(uniform(-1, 1)), at, move, part);
        multiply(part, out, out);
    }
}

/* Halfway twice is the same way: the speed is constant, whatever the ends. */
static void the_way_has_constant_speed(void **state) {
    (void)state;
    srand(3);
    for (int n = 0; n < 200; n++) {
        double a[16], b[16], middle[16], quarter[16], twice[16];
        random_similarity(a);
        random_similarity(b);
        srv_blend_transform(a, b, 0.5, middle);
        srv_blend_transform(a, b, 0.25, quarter);
        srv_blend_transform(a, middle, 0.5, twice);
        assert_near(quarter, twice, 16, 1e-6);
        srv_blend_transform(b, a, 0.75, twice);
        assert_near(quarter, twice, 16, 1e-6);
        srv_blend_transform(a, b, 1 - 1e-9, twice);
        assert_near(twice, b, 16, 1e-6);
    }
}

static void other_matrices_are_linear_unless_one_mirrors(void **state) {
    double a[16] = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 };
    double b[16] = { 1, 0.5, 0, 8, 0, 3, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 }, out[16];
    (void)state;
    srv_blend_transform(a, b, 0.5, out);
    assert_near(out, (const double[16]){ 1, 0.25, 0, 4, 0, 2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 }, 16,
                1e-12);
    b[0] = -1;
    srv_blend_transform(a, b, 0.5, out); /* in between lies a plane */
    assert_memory_equal(out, a, sizeof a);
    a[0] = -1;
    srv_blend_transform(a, b, 0.5, out); /* both do */
    assert_compare(out[0], ==, -1);
    assert_compare(out[3], ==, 4);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_move_is_straight_and_ends_are_exact),
        cmocka_unit_test(what_a_turn_keeps_stays), cmocka_unit_test(the_way_has_constant_speed),
        cmocka_unit_test(other_matrices_are_linear_unless_one_mirrors)
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
