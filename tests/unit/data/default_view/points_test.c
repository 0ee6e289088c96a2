/* SPDX-License-Identifier: Apache-2.0
 *
 * The first view of points: how large they are, and from where they are seen.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "sp/view.h"
#include "support/compare.h"

enum { SIDE = 8, COUNT = SIDE * SIDE * SIDE };

/* A lattice with the gap `height` along z. The space around every tenth point is `wide` times as
 * wide as that around the others. */
static struct sp_view view_of(float height, float wide) {
    static float positions[COUNT][3], factors[COUNT][6], values[COUNT], volumes[COUNT];
    struct sp_elements elements = { .shape = { SP_KIND_POINTS, COUNT, 0, 0 },
                                    .positions = positions,
                                    .factors = factors,
                                    .values = values,
                                    .volumes = volumes };
    struct sp_error err;
    struct sp_view view;
    for (int i = 0; i < COUNT; i++) {
        const float size = i % 10 ? 1 : wide;
        positions[i][0] = (float)(i % SIDE);
        positions[i][1] = (float)(i / SIDE % SIDE);
        positions[i][2] = height * (float)(i / SIDE / SIDE);
        values[i] = (float)i;
        volumes[i] = size * size * size;
        factors[i][0] = factors[i][2] = factors[i][5] = 0.7f * size;
    }
    struct sp_volume *volume = sp_volume_create_elements(&elements, "points", &err);
    assert_non_null(volume);
    sp_view_choose(&view, volume, "v");
    assert_true(sp_view_validate(&view, NULL));
    sp_volume_unref(&volume);
    return view;
}

/* The sine of the angle at which the camera stands above the points. */
static double rise(const struct sp_view *view) {
    const struct sp_camera *c = &view->camera;
    double away[3], length = 0;
    for (int a = 0; a < 3; a++) {
        away[a] = c->position[a] - c->target[a];
        length += away[a] * away[a];
    }
    return away[2] / sqrt(length);
}

static void even_points_fill_the_space_around_them(void **state) {
    (void)state;
    const struct sp_view same = view_of(1, 1), similar = view_of(1, 1.5f);
    assert_compare(same.layers[0].size, ==, 1);
    assert_compare(similar.layers[0].size, ==, 1);
}

static void uneven_points_are_smaller(void **state) {
    (void)state;
    const struct sp_view view = view_of(1, 4);
    assert_float_equal(view.layers[0].size, pow(0.25 / 0.6, 2), 1e-6);
    const struct sp_view least = view_of(1, 1000);
    assert_compare(least.layers[0].size, ==, 0.1);
}

static void flat_points_are_seen_from_above(void **state) {
    (void)state;
    const struct sp_view block = view_of(1, 1), ground = view_of(0.1f, 1);
    assert_compare(rise(&block), <, 0.5);
    assert_compare(rise(&ground), >, 0.6);
}

/* They hardly cover each other, so the opacity of a volume would leave them almost invisible. */
static void few_points_of_one_value_are_seen(void **state) {
    (void)state;
    float position[1][3] = { { 1, 2, 3 } }, factor[1][6] = { { 0.7f, 0, 0.7f, 0, 0, 0.7f } };
    float value[1] = { 4 }, volume[1] = { 1 };
    struct sp_elements elements = { .shape = { SP_KIND_POINTS, 1, 0, 0 },
                                    .positions = position,
                                    .factors = factor,
                                    .values = value,
                                    .volumes = volume };
    struct sp_volume *one = sp_volume_create_elements(&elements, "one", NULL);
    struct sp_view view;
    assert_non_null(one);
    sp_view_choose(&view, one, "v");
    sp_volume_unref(&one);
    assert_int_equal(view.transfer_function.point_count, 1);
    assert_float_equal(view.transfer_function.points[0].opacity, 0.9, 1e-6);
    assert_compare(view.layers[0].size, ==, 1);
    assert_compare(view.camera.height, >, 4 * 0.7); /* the kernel is in the image */
}

/* Each is opaque whatever its value, and narrower than the distance to the others. */
static void few_points_are_seen_one_by_one(void **state) {
    (void)state;
    float positions[3][3] = { { 0, 0, 0 }, { 4, 0, 0 }, { 0, 3, 0 } }, values[3] = { 1, 2, 9 };
    float factors[3][6], volumes[3];
    struct sp_elements elements = { .shape = { SP_KIND_POINTS, 3, 0, 0 },
                                    .positions = positions,
                                    .factors = factors,
                                    .values = values,
                                    .volumes = volumes };
    for (int wide = 0; wide < 2; wide++) {
        const float space = wide ? 2 : 0.5f;
        for (int i = 0; i < 3; i++) {
            memset(factors[i], 0, sizeof factors[i]);
            factors[i][0] = factors[i][2] = factors[i][5] = 0.7f * space;
            volumes[i] = space * space * space;
        }
        struct sp_volume *few = sp_volume_create_elements(&elements, "few", NULL);
        struct sp_view view;
        assert_non_null(few);
        sp_view_choose(&view, few, "v");
        sp_volume_unref(&few);
        for (uint32_t i = 0; i < view.transfer_function.point_count; i++)
            assert_float_equal(view.transfer_function.points[i].opacity, 0.9, 1e-6);
        assert_compare(view.layers[0].size * 2 * 0.7 * (double)space, <, 1.3);
        if (wide)
            assert_compare(view.layers[0].size, <, 1);
        else
            assert_compare(view.layers[0].size, ==, 1);
        assert_true(sp_view_validate(&view, NULL));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(even_points_fill_the_space_around_them),
        cmocka_unit_test(uneven_points_are_smaller),
        cmocka_unit_test(few_points_of_one_value_are_seen),
        cmocka_unit_test(few_points_are_seen_one_by_one),
        cmocka_unit_test(flat_points_are_seen_from_above),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
