/* SPDX-License-Identifier: Apache-2.0
 *
 * Light on cells of higher mip levels. Compares the formulas for microflakes with the mean over all
 * normals of a cell.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "splat/shade.h"
#include "support/compare.h"

enum { NORMALS = 256 };

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

static struct sp_vec3 random_direction(void) {
    struct sp_vec3 d;
    do
        d = (struct sp_vec3){ { uniform(-1, 1), uniform(-1, 1), uniform(-1, 1) } };
    while (sp_vec3_dot(d, d) > 1 || sp_vec3_dot(d, d) < 0.01);
    return sp_vec3_normalize(d);
}

/* One light of strength 1 and a random camera: the diffuse part is |n·l|, the specular
 * |n·h|^exponent. */
static struct sp_shade make_shade(double exponent, struct sp_vec3 light) {
    struct sp_vec3 eye = random_direction();
    struct sp_camera camera = { .projection = SP_PERSPECTIVE,
                                .position = { 9 * eye.v[0], 9 * eye.v[1], 9 * eye.v[2] },
                                .up = { 0.1, 0.3, 1 },
                                .fov_y = 40,
                                .near = 0.1 };
    struct sp_shading shading = { .mode = SP_SHADING_PHONG,
                                  .diffuse = 1,
                                  .specular = 1,
                                  .exponent = exponent,
                                  .light_count = 1,
                                  .lights = { { .space = SP_LIGHT_WORLD, .color = { 1, 1, 1 } } } };
    struct sp_camera_transform frame;
    struct sp_shade shade;
    memcpy(shading.lights[0].direction, light.v, sizeof light.v);
    sp_camera_transform_init(&frame, &camera, (uint32_t[2]){ 100, 100 });
    sp_shade_init(&shade, &frame, &shading);
    return shade;
}

struct light {
    double facing, glint;
};

static struct light light_microflakes(const struct sp_shade *shade,
                                      struct sp_microflakes microflakes, const float to_eye[3]) {
    const sp_wide_int word[2] = { sp_wide_int_all((int32_t)microflakes.word[0]),
                                  sp_wide_int_all((int32_t)microflakes.word[1]) };
    const sp_wide eye[3] = { sp_wide_all(to_eye[0]), sp_wide_all(to_eye[1]),
                             sp_wide_all(to_eye[2]) };
    sp_wide lit[3], shine[3];
    sp_shade_microflakes(shade, word, eye, lit, shine);
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < SP_WIDE; i++) {
            assert_compare(lit[c][i], ==, lit[0][0]);
            assert_compare(shine[c][i], ==, shine[0][0]);
        }
    return (struct light){ (double)lit[0][0], (double)shine[0][0] };
}

static struct light light_normal(const struct sp_shade *shade, uint32_t packed,
                                 const float to_eye[3]) {
    const sp_wide eye[3] = { sp_wide_all(to_eye[0]), sp_wide_all(to_eye[1]),
                             sp_wide_all(to_eye[2]) };
    sp_wide white[3], black[3];
    for (int c = 0; c < 3; c++) {
        white[c] = sp_wide_all(1);
        black[c] = sp_wide_all(0);
    }
    sp_shade_apply(shade, sp_wide_int_all((int32_t)packed), eye, white);
    sp_shade_apply(shade, sp_wide_int_all((int32_t)packed), eye, black);
    return (struct light){ (double)white[0][0] - (double)black[0][0], (double)black[0][0] };
}

/* Normals around an axis. Spread 0 gives one direction, spread 10 any direction. */
static struct sp_microflakes spread_normals(double spread, uint32_t packed[NORMALS]) {
    static const struct sp_gradient_grid unit = { .bound = 1 };
    struct sp_vec3 axis = random_direction();
    struct sp_microflakes_sum sum = { 0 };
    for (int i = 0; i < NORMALS; i++) {
        struct sp_vec3 n = sp_vec3_add(axis, sp_vec3_scale(random_direction(), spread));
        n = sp_vec3_scale(sp_vec3_normalize(n), i % 2 ? -0.9 : 0.9); /* both sides count as one */
        packed[i] = sp_gradient_pack(&unit, n.v);
        sp_microflakes_add_normal(&sum, packed[i], 2);
    }
    return sp_microflakes_pack(&sum, 2 * NORMALS);
}

/* Returns the root mean square error of microflakes for one spread and exponent. */
static struct light measure(double spread, double exponent) {
    struct light off = { 0, 0 };
    enum { TRIALS = 400 };
    for (int t = 0; t < TRIALS; t++) {
        uint32_t packed[NORMALS];
        struct sp_microflakes microflakes = spread_normals(spread, packed);
        struct sp_shade shade = make_shade(exponent, random_direction());
        struct sp_vec3 v = random_direction();
        const float to_eye[3] = { (float)v.v[0], (float)v.v[1], (float)v.v[2] };
        struct light got = light_microflakes(&shade, microflakes, to_eye), want = { 0, 0 };
        for (int i = 0; i < NORMALS; i++) {
            struct light one = light_normal(&shade, packed[i], to_eye);
            want.facing += one.facing / NORMALS;
            want.glint += one.glint / NORMALS;
        }
        off.facing += pow(got.facing - want.facing, 2) / TRIALS;
        off.glint += pow(got.glint - want.glint, 2) / TRIALS;
    }
    return (struct light){ sqrt(off.facing), sqrt(off.glint) };
}

static void cells_are_lit_as_their_parts_are(void **state) {
    (void)state;
    static const struct {
        double spread, exponent, facing, glint; /* the largest allowed error */
    } cases[] = {
        { 0, 8, 0.006, 0.003 },    { 0, 24, 0.006, 0.004 }, { 0.2, 8, 0.025, 0.02 },
        { 0.2, 24, 0.02, 0.035 },  { 0.5, 8, 0.045, 0.07 }, { 0.5, 24, 0.045, 0.06 },
        { 0.5, 200, 0.05, 0.015 }, { 1, 2, 0.015, 0.02 },   { 1, 24, 0.015, 0.015 },
        { 10, 2, 0.01, 0.008 },    { 10, 24, 0.01, 0.01 },  { 10, 200, 0.01, 0.005 },
    };
    srand(31);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct light off = measure(cases[i].spread, cases[i].exponent);
        print_message("spread %4.1f, exponent %3.0f: facing off by %.4f, highlight by %.4f\n",
                      cases[i].spread, cases[i].exponent, off.facing, off.glint);
        assert_compare(off.facing, <=, cases[i].facing);
        assert_compare(off.glint, <=, cases[i].glint);
    }
}

/* A part without a normal is lit from all directions and has no highlight. */
static void parts_without_a_normal_are_lit_from_all_sides(void **state) {
    (void)state;
    const float to_eye[3] = { 0, 0, -1 };
    struct sp_shade shade = make_shade(24, random_direction());
    struct sp_microflakes_sum sum = { 0 };
    sp_microflakes_add_normal(&sum, 0, 3);
    struct light none = light_microflakes(&shade, sp_microflakes_pack(&sum, 3), to_eye);
    assert_compare(none.facing, ==, 1);
    assert_compare(none.glint, ==, 0);
    uint32_t packed[NORMALS];
    struct sp_microflakes microflakes = spread_normals(0, packed);
    struct light all = light_microflakes(&shade, microflakes, to_eye);
    sum = (struct sp_microflakes_sum){ { 0 }, 0 };
    sp_microflakes_add(&sum, microflakes, 1);
    struct light some = light_microflakes(&shade, sp_microflakes_pack(&sum, 4), to_eye);
    assert_compare(fabs(some.facing - (0.75 + 0.25 * all.facing)), <, 3e-3);
    assert_compare(fabs(some.glint - 0.25 * all.glint), <, 3e-3);
}

/* A cell made of cells equals a cell made of all their parts, to rounding. */
static void means_of_means_are_means(void **state) {
    (void)state;
    srand(32);
    for (int n = 0; n < 200; n++) {
        struct sp_microflakes_sum all = { 0 }, pairs = { 0 };
        float weight = 0;
        for (int k = 0; k < 8; k++) {
            uint32_t packed[NORMALS];
            spread_normals(0.3 * k, packed);
            struct sp_microflakes_sum part = { 0 };
            float own = 0;
            for (int i = 0; i < 8; i++) {
                float w = (float)uniform(0, 2);
                uint32_t normal = rand() % 3 ? packed[i] : 0;
                sp_microflakes_add_normal(&part, normal, w);
                sp_microflakes_add_normal(&all, normal, w);
                own += w;
            }
            sp_microflakes_add(&pairs, sp_microflakes_pack(&part, own), own);
            weight += own;
        }
        struct sp_microflakes a = sp_microflakes_pack(&all, weight),
                              b = sp_microflakes_pack(&pairs, weight);
        for (int i = 0; i < 7; i++) {
            int x = a.word[i / 4] >> 8 * (i % 4) & 255, y = b.word[i / 4] >> 8 * (i % 4) & 255;
            assert_compare(abs(x - y), <=, 1);
        }
    }
}

/* For any bits, the light is finite and at most the light of the source. */
static void any_bits_give_light_within_bounds(void **state) {
    (void)state;
    srand(33);
    for (int n = 0; n < 200000; n++) {
        struct sp_microflakes microflakes = { { (uint32_t)rand() * 3u, (uint32_t)rand() * 3u } };
        struct sp_shade shade = make_shade(pow(2, n % 11), random_direction());
        struct sp_vec3 v = random_direction();
        float to_eye[3] = { (float)v.v[0], (float)v.v[1], (float)v.v[2] };
        if (n % 100 == 0) /* the camera is opposite to the light: no half vector */
            for (int c = 0; c < 3; c++)
                to_eye[c] = -shade.lights[0].direction[c];
        if (n % 7 == 0)
            microflakes.word[n % 2] = n % 3 ? 0 : UINT32_MAX;
        struct light got = light_microflakes(&shade, microflakes, to_eye);
        assert_compare(got.facing, >=, 0);
        assert_compare(got.facing, <=, 2.5);
        assert_compare(got.glint, >=, 0);
        assert_compare(got.glint, <=, 1);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cells_are_lit_as_their_parts_are),
        cmocka_unit_test(parts_without_a_normal_are_lit_from_all_sides),
        cmocka_unit_test(means_of_means_are_means),
        cmocka_unit_test(any_bits_give_light_within_bounds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
