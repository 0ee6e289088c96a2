/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "inspect/part/connect.h"
#include "sp/part.h"
#include "support/compare.h"
#include "support/scene.h"

enum { N = 52, R = 20 };

/* Values fall by 50 per world unit across the surface, which has the value 100. */
struct shape {
    double spacing[3];
    double radius, ring; /* of a ball; of a torus around the third axis, if ring > 0 */
    double away;         /* of a second, small ball */
};

static double distance_to(const struct shape *shape, double x, double y, double z) {
    double ring = shape->ring > 0 ? sqrt(x * x + y * y) - shape->ring : sqrt(x * x + y * y);
    return sqrt(ring * ring + z * z) - shape->radius;
}

static double value_of(const void *user, double i, double j, double k) {
    const struct shape *shape = user;
    double x = (i - 0.5 * (N - 1)) * shape->spacing[0], y = (j - 0.5 * (N - 1)) * shape->spacing[1];
    double z = (k - 0.5 * (N - 1)) * shape->spacing[2];
    double distance = distance_to(shape, x, y, z);
    if (shape->away > 0) {
        double dx = x - shape->away, dy = y - shape->away, dz = z - shape->away;
        distance = fmin(distance, sqrt(dx * dx + dy * dy + dz * dz) - 2);
    }
    return fmin(fmax(100 - 50 * distance, 0), 200);
}

static struct sp_volume *make(const struct shape *shape, enum sp_type type) {
    struct test_scene scene;
    memset(&scene, 0, sizeof scene);
    assert_true(test_scene_voxels(&scene, "shape", (const uint32_t[3]){ N, N, N }, shape->spacing,
                                  type, value_of, shape));
    struct sp_volume *volume = test_scene_volume(&scene, NULL);
    assert_non_null(volume);
    test_scene_finish(&scene);
    return volume;
}

static void check_within(const char *what, double value, double truth, double part) {
    printf("%-24s %10.3f, truth %10.3f: %+.2f %%\n", what, value, truth, 100 * (value / truth - 1));
    assert_compare(fabs(value / truth - 1), <, part);
}

static void a_ball_has_its_volume_and_area(void **state) {
    (void)state;
    const struct shape ball = { .spacing = { 1, 1, 1 }, .radius = R, .away = 22 };
    struct sp_volume *volume = make(&ball, SP_UINT8);
    struct sp_part part = { .point = { 0, 0, 0 }, .range = { 100, 1e9 } };
    struct sp_part_size size;
    assert_true(sp_part_measure(volume, &part, &size, NULL));
    assert_true(size.is_found);
    check_within("ball: volume", size.volume, 4 * M_PI / 3 * R * R * R, 0.02);
    check_within("ball: area", size.area, 4 * M_PI * R * R, 0.02);
    assert_compare(size.samples, ==, size.volume);
    assert_false(size.is_open);
    part.point[0] = part.point[1] = part.point[2] = 22; /* the other ball */
    assert_true(sp_part_measure(volume, &part, &size, NULL));
    assert_compare(size.volume, <, 60);
    check_within("small ball: area", size.area, 4 * M_PI * 2 * 2, 0.1);
    part.range[0] = -1e9; /* the whole volume has no surface inside */
    assert_true(sp_part_measure(volume, &part, &size, NULL));
    assert_true(size.is_open);
    assert_true(size.area <= 0);
    sp_volume_unref(&volume);
}

static void a_torus_on_flat_cells_has_its_volume_and_area(void **state) {
    (void)state;
    const struct shape torus = { .spacing = { 1, 1.2, 0.7 }, .radius = 7, .ring = 14 };
    struct sp_volume *volume = make(&torus, SP_FLOAT32);
    struct sp_part part = { .point = { 14, 0, 0 }, .range = { 100, 1e9 } };
    struct sp_part_size size;
    assert_true(sp_part_measure(volume, &part, &size, NULL));
    check_within("torus: volume", size.volume, 2 * M_PI * M_PI * 14 * 7 * 7, 0.02);
    check_within("torus: area", size.area, 4 * M_PI * M_PI * 14 * 7, 0.02);
    sp_volume_unref(&volume);
}

/* A shell between two values has two surfaces. */
static void a_range_has_two_surfaces(void **state) {
    (void)state;
    const struct shape ball = { .spacing = { 1, 1, 1 }, .radius = R };
    struct sp_volume *volume = make(&ball, SP_FLOAT32);
    struct sp_part part = { .point = { 19.3, 0, 0 }, .range = { 60, 180 } };
    const double outer = R + 40 / 50., inner = R - 80 / 50.;
    struct sp_part_size size;
    assert_true(sp_part_measure(volume, &part, &size, NULL));
    check_within("shell: area", size.area, 4 * M_PI * (outer * outer + inner * inner), 0.02);
    check_within("shell: volume", size.volume,
                 4 * M_PI / 3 * (outer * outer * outer - inner * inner * inner), 0.02);
    sp_volume_unref(&volume);
}

static void on_ball(double azimuth, double elevation, double out[3]) {
    out[0] = R * cos(azimuth) * cos(elevation);
    out[1] = R * sin(azimuth) * cos(elevation);
    out[2] = R * sin(elevation);
}

static void paths_on_a_ball_are_great_circles(void **state) {
    (void)state;
    static const double spacings[2][3] = { { 1, 1, 1 }, { 1, 0.9, 1.6 } };
    static const double angles[][4] = { { 0, 0, 1.2, 0.4 },
                                        { 0.3, -0.7, 2.4, 0.9 },
                                        { 0.1, 0.2, 0.35, 0.3 } };
    for (int s = 0; s < 2; s++) {
        struct shape ball = { .radius = R };
        memcpy(ball.spacing, spacings[s], sizeof ball.spacing);
        struct sp_volume *volume = make(&ball, SP_FLOAT32);
        for (size_t i = 0; i < sizeof angles / sizeof angles[0]; i++) {
            struct sp_part part = { .range = { 100, 1e9 } };
            struct sp_part_path path;
            double to[3], dot = 0, square = 0;
            on_ball(angles[i][0], angles[i][1], part.point);
            on_ball(angles[i][2], angles[i][3], to);
            for (int r = 0; r < 3; r++) {
                dot += part.point[r] * to[r] / (R * R);
                square += (part.point[r] - to[r]) * (part.point[r] - to[r]);
            }
            assert_true(sp_part_find_path(volume, &part, to, &path, NULL));
            assert_true(path.is_found);
            check_within("path on a ball", path.length, R * acos(dot), 0.01);
            assert_float_equal(path.straight, sqrt(square), 0.05);
            for (uint32_t k = 0; k < path.count; k++)
                assert_float_equal(sqrt(path.points[k][0] * path.points[k][0] +
                                        path.points[k][1] * path.points[k][1] +
                                        path.points[k][2] * path.points[k][2]),
                                   R, 0.1);
        }
        sp_volume_unref(&volume);
    }
}

/* On the inner side of a torus the shortest way round is a circle of radius ring − radius. */
static void a_path_goes_around_a_hole(void **state) {
    (void)state;
    const struct shape torus = { .spacing = { 1, 1, 1 }, .radius = 6, .ring = 16 };
    struct sp_volume *volume = make(&torus, SP_FLOAT32);
    struct sp_part part = { .point = { 10, 0, 0 }, .range = { 100, 1e9 } };
    struct sp_part_path path;
    assert_true(sp_part_find_path(volume, &part, (const double[3]){ -9.8, 2, 0 }, &path, NULL));
    assert_true(path.is_found);
    check_within("path in a torus", path.length, 10 * (M_PI - atan2(2, 9.8)), 0.03);
    sp_volume_unref(&volume);
}

static void what_is_not_there_is_not_measured(void **state) {
    (void)state;
    const struct shape ball = { .spacing = { 1, 1, 1 }, .radius = 8, .away = 20 };
    struct sp_volume *volume = make(&ball, SP_UINT8);
    struct sp_part part = { .point = { 20, 20, -20 }, .range = { 100, 1e9 } };
    struct sp_part_size size;
    struct sp_part_path path;
    assert_true(sp_part_measure(volume, &part, &size, NULL));
    assert_false(size.is_found);
    assert_compare(size.volume, ==, 0);
    assert_true(sp_part_find_path(volume, &part, (const double[3]){ 0, 0, 8 }, &path, NULL));
    assert_false(path.is_found);
    memset(part.point, 0, sizeof part.point); /* two different parts */
    assert_true(sp_part_find_path(volume, &part, (const double[3]){ 20, 20, 20 }, &path, NULL));
    assert_false(path.is_found);
    /* From a point to itself. */
    part.point[2] = 8;
    assert_true(sp_part_find_path(volume, &part, part.point, &path, NULL));
    assert_true(path.is_found);
    assert_compare(path.length, <, 0.01);
    assert_int_equal(path.count >= 2, 1);
    sp_volume_unref(&volume);
}

/* Everything is in the range: the part is the whole volume, without a surface. */
static void the_whole_volume_has_no_surface(void **state) {
    (void)state;
    const struct shape ball = { .spacing = { 1, 2, 0.5 }, .radius = 8 };
    struct sp_volume *volume = make(&ball, SP_INT16);
    struct sp_part part = { .range = { -1e9, 1e9 } };
    struct sp_part_size size;
    assert_true(sp_part_measure(volume, &part, &size, NULL));
    assert_compare(size.volume, ==, N * N * N);
    assert_compare(size.area, ==, 0);
    sp_volume_unref(&volume);
}

/* Growth by bits against its definition, across words and at the ends of rows. */
static void masks_grow_by_one_sample(void **state) {
    (void)state;
    enum { X = 131, Y = 5, Z = 4 };
    const uint32_t dims[3] = { X, Y, Z };
    struct sp_mask mask, from;
    struct sp_pool *pool = sp_pool_create(2, NULL);
    assert_true(sp_mask_init(&mask, dims, NULL) && sp_mask_init(&from, dims, NULL));
    uint32_t random = 7;
    for (uint32_t i = 0; i < X * Y * Z; i++) {
        random = random * 1664525 + 1013904223;
        if (random >> 26 == 0)
            sp_mask_row(&mask, i / X % Y, i / X / Y)[i % X / 64] |= UINT64_C(1) << i % X % 64;
    }
    sp_mask_grow(&mask, &from, pool);
    for (int i = 0; i < X * Y * Z; i++) {
        const int x = i % X, y = i / X % Y, z = i / X / Y;
        bool wanted = false;
        for (int k = 0; k < 27; k++) {
            int at[3] = { x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1 };
            if (at[0] >= 0 && at[0] < X && at[1] >= 0 && at[1] < Y && at[2] >= 0 && at[2] < Z)
                wanted =
                    wanted || sp_mask_has(&from, (uint32_t)at[0], (uint32_t)at[1], (uint32_t)at[2]);
        }
        assert_int_equal(sp_mask_has(&mask, (uint32_t)x, (uint32_t)y, (uint32_t)z), wanted);
    }
    assert_int_equal(sp_mask_row(&mask, 0, 0)[2] >> 3, 0); /* beyond the row */
    sp_mask_finish(&mask);
    sp_mask_finish(&from);
    sp_pool_destroy(&pool);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_ball_has_its_volume_and_area),
        cmocka_unit_test(a_torus_on_flat_cells_has_its_volume_and_area),
        cmocka_unit_test(a_range_has_two_surfaces),
        cmocka_unit_test(paths_on_a_ball_are_great_circles),
        cmocka_unit_test(a_path_goes_around_a_hole),
        cmocka_unit_test(what_is_not_there_is_not_measured),
        cmocka_unit_test(the_whole_volume_has_no_surface),
        cmocka_unit_test(masks_grow_by_one_sample),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
