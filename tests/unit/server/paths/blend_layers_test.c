/* SPDX-License-Identifier: Apache-2.0
 *
 * Layers between two keyframes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <string.h>

#include "paths/blend.h"
#include "support/compare.h"

static struct sp_view make_view(double value, float opacity, uint32_t points) {
    struct sp_view view;
    memset(&view, 0, sizeof view);
    view.layer_count = 1;
    view.layers[0] = sp_layer_default(SP_LAYER_CHANNEL);
    view.layers[0].point_count = points;
    for (uint32_t i = 0; i < points; i++) {
        view.layers[0].points[i].value = value + i;
        view.layers[0].points[i].color[1] = opacity;
        view.layers[0].points[i].opacity = opacity;
    }
    return view;
}

static void points_of_channels_move(void **state) {
    (void)state;
    const struct sp_view a = make_view(10, 0.2f, 2), b = make_view(20, 0.6f, 2);
    struct sp_view out = a;
    srv_blend_layers(&a, &b, 0.25, &out);
    assert_int_equal(out.layers[0].point_count, 2);
    for (int i = 0; i < 2; i++) {
        const struct sp_tf_point *p = &out.layers[0].points[i];
        assert_compare(p->value, ==, 12.5 + i);
        assert_float_equal(p->opacity, 0.3f, 1e-6f);
        assert_float_equal(p->color[1], 0.3f, 1e-6f);
    }
    srv_blend_layers(&a, &b, 1, &out);
    assert_memory_equal(&out.layers[0], &b.layers[0], sizeof out.layers[0]);
}

static void other_numbers_of_points_wait_for_the_end(void **state) {
    (void)state;
    const struct sp_view a = make_view(10, 0.2f, 2), b = make_view(20, 0.6f, 3);
    struct sp_view out = a;
    srv_blend_layers(&a, &b, 0.75, &out);
    assert_int_equal(out.layers[0].point_count, 2);
    assert_memory_equal(out.layers[0].points, a.layers[0].points, sizeof a.layers[0].points);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_of_channels_move),
        cmocka_unit_test(other_numbers_of_points_wait_for_the_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
