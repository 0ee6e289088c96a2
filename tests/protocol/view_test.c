/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/fixture.h"
#include "protocol/view.h"
#include "support/compare.h"

/* cmocka compares floats only; this one prints both doubles. */
static void assert_double(double actual, double expected) {
    if (actual != expected)
        fail_msg("%.17g is not %.17g", actual, expected);
}

static bool apply(const char *text, struct sp_view *view, struct sp_error *err) {
    const struct sp_view defaults = fixture_view();
    proto_json *patch = proto_json_parse(text, strlen(text), err);
    bool ok = patch && proto_view_apply(patch, &defaults, view, err);
    proto_json_free(&patch);
    return ok;
}

static void must_apply(const char *text, struct sp_view *view) {
    struct sp_error err;
    if (!apply(text, view, &err))
        fail_msg("%s: %s: %s", text, err.place, err.text);
}

/* proto_view_merge() accepts a saved view with a bad size; the next patch is checked together with
 * it. */
static void merged_patches_are_checked_together(void **state) {
    (void)state;
    static const char base_text[] = "{\"size\":[0,480],\"camera\":{\"fov_y\":45}}";
    const struct sp_view defaults = fixture_view();
    struct sp_view view = defaults, other;
    struct sp_error err;
    proto_json *base = proto_json_parse(base_text, sizeof base_text - 1, &err);
    assert_true(proto_view_merge(base, &defaults, &view, &err));
    other = view;
    assert_false(apply("{}", &other, &err));
    assert_string_equal(err.place, "/size/0");
    must_apply("{\"size\":[640,480]}", &view);
    assert_double(view.camera.fov_y, 45);
    proto_json_free(&base);
}

static void patches_merge_and_arrays_are_replaced(void **state) {
    (void)state;
    struct sp_view view = fixture_view(), before = view;
    must_apply("{\"camera\":{\"fov_y\":45},\"size\":[640,480]}", &view);
    assert_double(view.camera.fov_y, 45);
    assert_int_equal(view.size[0], 640);
    assert_double(view.camera.near, before.camera.near);
    must_apply("{\"transfer_function\":{\"points\":[{\"value\":3,\"color\":[0,0.5,1],\"opacity\":"
               "0.25}]}}",
               &view);
    assert_int_equal(view.transfer_function.point_count, 1);
    assert_double(view.transfer_function.points[0].opacity, 0.25);
    assert_double(view.transfer_function.points[1].value, 0);
    assert_double(view.camera.fov_y, 45);
    must_apply("{\"shading\":{\"lights\":[]}}", &view);
    assert_int_equal(view.shading.light_count, 0);
}

static void null_resets_a_field_to_its_default(void **state) {
    (void)state;
    struct sp_view view = fixture_view(), defaults = view;
    must_apply(
        "{\"volume\":\"other\",\"size\":[10,10],\"camera\":{\"fov_y\":45,\"up\":[0,1,0]},"
        "\"filter\":{\"sigma\":1,\"c_max\":3},\"shading\":{\"lights\":[],\"mode\":\"none\"},"
        "\"layers\":[{\"type\":\"shell\"},{\"type\":\"surface\",\"value\":7}],\"clip\":{\"box\":[["
        "0,0,0],[1,1,0.5]]},"
        "\"transfer_function\":{\"points\":[{\"value\":3,\"color\":[0,0,0],\"opacity\":0}]}}",
        &view);
    assert_string_equal(view.volume, "other");
    must_apply("{\"camera\":{\"fov_y\":null},\"filter\":{\"c_max\":null}}", &view);
    assert_double(view.camera.fov_y, defaults.camera.fov_y);
    assert_double(view.camera.up[1], 1);
    assert_true(isnan(view.filter.c_max));
    must_apply("{\"volume\":null,\"size\":null,\"camera\":null,\"filter\":null,\"shading\":null,"
               "\"layers\":null,\"clip\":null,\"transfer_function\":{\"points\":null}}",
               &view);
    assert_memory_equal(&view, &defaults, sizeof view);
}

static void defaults_may_be_the_view_itself(void **state) {
    (void)state;
    struct sp_view view = fixture_view();
    must_apply("{\"camera\":{\"fov_y\":45}}", &view);
    struct sp_view before = view;
    struct sp_error err;
    proto_json *patch = proto_json_parse("{\"camera\":null,\"filter\":null}", 29, &err);
    assert_true(proto_view_apply(patch, &view, &view, &err));
    assert_memory_equal(&view, &before, sizeof view);
    proto_json_free(&patch);
}

static void a_refused_patch_changes_nothing(void **state) {
    (void)state;
    struct sp_view view = fixture_view(), before = view;
    struct sp_error err;
    assert_false(apply("{\"size\":[1,1],\"camera\":{\"fov_y\":45,\"near\":\"x\"}}", &view, &err));
    assert_false(apply("{\"size\":[1,1],\"camera\":{\"fov_y\":999}}", &view, &err));
    assert_false(apply("{\"size\":[1,1]", &view, &err));
    assert_memory_equal(&view, &before, sizeof view);
}

static void errors_name_the_field_and_the_remedy(void **state) {
    (void)state;
    static const struct {
        const char *patch, *place, *text;
    } cases[] = {
        { "{\"camra\":{}}", "/camra", "unknown field; did you mean \"camera\"?" },
        { "{\"camera\":{\"fov\":1}}", "/camera/fov", "unknown field; did you mean \"fov_y\"?" },
        { "{\"filter\":{\"Kernal\":1}}", "/filter/Kernal",
          "unknown field; did you mean \"kernel\"?" },
        { "{\"filter\":{\"zzz\":1}}", "/filter/zzz",
          "unknown field; known: mode, kernel, sigma, cutoff, lowpass, c_min, c_max" },
        { "{\"filter\":{\"kernel\":\"box\"}}", "/filter/kernel",
          "must be \"gaussian\" or \"cubic\", not \"box\"" },
        { "{\"compositing\":{\"mode\":7}}", "/compositing/mode",
          "must be \"splat\", \"sheet\", \"slab\", \"maximum\", \"minimum\", \"mean\" or \"sum\", "
          "not a number" },
        { "{\"camera\":{\"up\":[0,1]}}", "/camera/up", "must be an array of 3 numbers, not of 2" },
        { "{\"camera\":{\"up\":\"y\"}}", "/camera/up",
          "must be an array of 3 numbers, not a string" },
        { "{\"clip\":{\"box\":7}}", "/clip/box",
          "must be an array of 2 arrays of 3 numbers, not a number" },
        { "{\"size\":[1.5,1]}", "/size/0", "1.5 is not a whole number in [0, 4294967295]" },
        { "{\"size\":[\"a\",1]}", "/size/0", "must be a whole number, not a string" },
        { "{\"filter\":{\"c_max\":\"a\"}}", "/filter/c_max",
          "must be a number or null, not a string" },
        { "{\"shading\":{\"lights\":[{}]}}", "/shading/lights/0", "\"direction\" is missing" },
        { "{\"volume\":\"\"}", "/volume", "must have 1 to 127 bytes, not 0" },
        { "[]", "", "must be an object, not an array" },
        { "{\"camera\":{\"target\":[1e18,1e18,1e18],\"distance\":1e-9}}", "/camera/distance",
          "the position that the angles and the distance give: position and target are the same "
          "point; move one of them" },
        { "{\"camera\":{\"azimuth\":30},\"size\":[0,1]}", "/size/0", "0 is outside [1, 8192]" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sp_view view = fixture_view();
        struct sp_error err = { 0 };
        assert_false(apply(cases[i].patch, &view, &err));
        assert_int_equal(err.code, SP_ERR_INVALID);
        assert_string_equal(err.place, cases[i].place);
        assert_string_equal(err.text, cases[i].text);
    }
}

static void assert_near3(const double actual[3], double x, double y, double z) {
    const double expected[3] = { x, y, z };
    for (int i = 0; i < 3; i++)
        if (fabs(actual[i] - expected[i]) > 1e-9)
            fail_msg("member %d is %.17g, not %.17g", i, actual[i], expected[i]);
}

/* The default camera of the fixture looks from -y, and up is +z. */
static void a_camera_is_placed_by_angles(void **state) {
    (void)state;
    struct sp_view view = fixture_view(), before = view;
    const double *target = before.camera.target;
    must_apply("{\"camera\":{\"azimuth\":0,\"elevation\":0,\"distance\":100}}", &view);
    assert_near3(view.camera.position, target[0], target[1] - 100, target[2]);
    assert_near3(view.camera.up, 0, 0, 1);
    must_apply("{\"camera\":{\"azimuth\":90}}", &view);
    assert_near3(view.camera.position, target[0] + 100, target[1], target[2]);
    must_apply("{\"camera\":{\"elevation\":30}}", &view);
    assert_near3(view.camera.position, target[0] + 100 * cos(M_PI / 6), target[1], target[2] + 50);
    must_apply("{\"camera\":{\"target\":[1,2,3],\"distance\":10,\"elevation\":0}}", &view);
    assert_near3(view.camera.position, 11, 2, 3);
    must_apply("{\"camera\":{\"target\":[0,0,0],\"roll\":90}}", &view);
    assert_near3(view.camera.position, 10, 0, 0);
    assert_near3(view.camera.up, 0, -1, 0); /* +y is on the right, and the image turns clockwise */
    must_apply("{\"camera\":{\"roll\":0}}", &view);
    assert_near3(view.camera.up, 0, 0, 1);
    must_apply("{\"camera\":{\"target\":null,\"azimuth\":null,\"elevation\":null,"
               "\"distance\":null}}",
               &view);
    assert_near3(view.camera.position, before.camera.position[0], before.camera.position[1],
                 before.camera.position[2]);
}

static void the_poles_have_an_up(void **state) {
    (void)state;
    struct sp_view view = fixture_view();
    const double *target = view.camera.target;
    must_apply("{\"camera\":{\"azimuth\":0,\"elevation\":90,\"distance\":100}}", &view);
    assert_near3(view.camera.position, target[0], target[1], target[2] + 100);
    assert_near3(view.camera.up, 0, 1, 0); /* the front is at the bottom of the image */
    must_apply("{\"camera\":{\"azimuth\":90}}", &view);
    assert_near3(view.camera.up, -1, 0, 0);
    must_apply("{\"camera\":{\"elevation\":0}}", &view); /* the azimuth is remembered */
    assert_near3(view.camera.position, target[0] + 100, target[1], target[2]);
    assert_near3(view.camera.up, 0, 0, 1);
}

/* A camera turned by hand and read as an orbit is placed where it was. */
static void any_camera_has_an_orbit(void **state) {
    (void)state;
    struct sp_view view = fixture_view();
    must_apply("{\"camera\":{\"position\":[50,-60,70],\"target\":[1,2,3],\"up\":[1,2,5]}}", &view);
    struct sp_camera before = view.camera;
    must_apply("{\"camera\":{\"fov_y\":30,\"distance\":200}}", &view);
    double scale = 200 / sqrt(49 * 49 + 62 * 62 + 67 * 67);
    assert_near3(view.camera.position, 1 + scale * 49, 2 - scale * 62, 3 + scale * 67);
    /* Only the part of up across the direction of view shows. */
    double away[3] = { 49, -62, 67 }, dot = 0, square = 0;
    for (int i = 0; i < 3; i++) {
        dot += away[i] * before.up[i];
        square += away[i] * away[i];
    }
    double above[3], length = 0;
    for (int i = 0; i < 3; i++) {
        above[i] = before.up[i] - dot / square * away[i];
        length += above[i] * above[i];
    }
    for (int i = 0; i < 3; i++)
        above[i] /= sqrt(length);
    assert_near3(view.camera.up, above[0], above[1], above[2]);
}

static void opacity_is_never_rounded_up_to_one(void **state) {
    (void)state;
    struct sp_view view = fixture_view();
    must_apply("{\"transfer_function\":{\"points\":[{\"value\":0,\"color\":[0.9999999999,0,1],"
               "\"opacity\":0.9999999999999999}]}}",
               &view);
    assert_double(view.transfer_function.points[0].opacity, nextafterf(1, 0));
    assert_double(view.transfer_function.points[0].color[2], 1);
}

/* xorshift, Marsaglia 2003 */
static double uniform(uint64_t *seed, double low, double high) {
    *seed ^= *seed << 13, *seed ^= *seed >> 7, *seed ^= *seed << 17;
    return low + (high - low) * ((double)(*seed >> 11) / 9007199254740992.0);
}

static struct sp_view random_view(uint64_t *seed) {
    struct sp_view v = fixture_view();
    struct sp_camera *c = &v.camera;
    v.size[0] = (uint32_t)uniform(seed, 1, 8192.9);
    c->projection = uniform(seed, 0, 1) < 0.5 ? SP_PERSPECTIVE : SP_ORTHOGRAPHIC;
    for (int i = 0; i < 3; i++) {
        c->position[i] = uniform(seed, -1e3, 1e3);
        c->target[i] = uniform(seed, -1e-3, 1e-3);
        c->up[i] = uniform(seed, -1, 1);
        v.background[i] = (float)uniform(seed, 0, 1);
    }
    c->fov_y = uniform(seed, 1, 170);
    c->near = exp(uniform(seed, -600, 600));
    struct sp_transfer_function *tf = &v.transfer_function;
    tf->point_count = 1 + (uint32_t)uniform(seed, 0, 255.9);
    memset(tf->points, 0, sizeof tf->points);
    double value = uniform(seed, -1e6, 0);
    for (uint32_t i = 0; i < tf->point_count; i++) {
        tf->points[i].value = value += exp(uniform(seed, -6, 6));
        tf->points[i].opacity = (float)uniform(seed, 0, 0.999);
        for (int k = 0; k < 3; k++)
            tf->points[i].color[k] = (float)uniform(seed, 0, 1);
    }
    tf->gradient_count = 2;
    tf->gradient[1] = (struct sp_gradient_point){ uniform(seed, 1e-9, 1e9), 0.1f };
    v.filter.mode = (enum sp_filter_mode)uniform(seed, 0, 5.9);
    v.filter.c_max = uniform(seed, 0, 1) < 0.5 ? NAN : uniform(seed, 1, 5);
    v.shading.light_count = (uint32_t)uniform(seed, 0, 8.9);
    for (uint32_t i = 0; i < v.shading.light_count; i++)
        v.shading.lights[i] = (struct sp_light){ { uniform(seed, 0.1, 1), -1, 0 },
                                                 SP_LIGHT_WORLD,
                                                 { (float)uniform(seed, 0, 4), 0, 1 } };
    if (v.shading.light_count == 0)
        memset(v.shading.lights, 0, sizeof v.shading.lights);
    v.slices.mode = (enum sp_slice_mode)uniform(seed, 0, 2.9);
    v.slices.colors = (enum sp_slice_colors)uniform(seed, 0, 6.9);
    v.slices.in_3d = uniform(seed, 0, 1) < 0.5;
    v.slices.planes[1] = uniform(seed, 0, 1) < 0.5;
    v.slices.position[1] = uniform(seed, -1e3, 1e3);
    v.slices.width = exp(uniform(seed, -600, 600));
    v.clip.plane_count = 1;
    v.clip.planes[0] = (struct sp_clip_plane){ { 0, uniform(seed, 1, 2), 0 }, 0.1 };
    return v;
}

static char *canonical(const struct sp_view *view) {
    proto_json *json = proto_view_encode(view);
    char *text = proto_json_to_canonical(json, NULL);
    assert_non_null(text);
    proto_json_free(&json);
    return text;
}

static void random_views_round_trip_bit_for_bit(void **state) {
    (void)state;
    uint64_t seed = 0x9e3779b97f4a7c15;
    for (int round = 0; round < 300; round++) {
        struct sp_view view = random_view(&seed), back = fixture_view();
        char *text = canonical(&view);
        must_apply(text, &back);
        if (!isnan(view.filter.c_max))
            assert_compare(back.filter.c_max, ==, view.filter.c_max);
        back.filter.c_max = view.filter.c_max;
        assert_memory_equal(&back, &view, sizeof view);
        char *again = canonical(&back);
        assert_string_equal(again, text);
        free(again);
        free(text);
    }
}

static void the_default_view_round_trips(void **state) {
    (void)state;
    struct sp_view view = fixture_view(), back = view;
    back.camera.fov_y = 99;
    char *text = canonical(&view);
    must_apply(text, &back);
    char *again = canonical(&back);
    assert_string_equal(again, text);
    free(again);
    free(text);
}

static void the_volume_of_a_patch_is_read(void **state) {
    (void)state;
    proto_json *patch = proto_json_parse("{\"volume\":\"engine\"}", 19, NULL);
    assert_string_equal(proto_view_volume(patch), "engine");
    proto_json_free(&patch);
    patch = proto_json_parse("{\"volume\":7}", 12, NULL);
    assert_null(proto_view_volume(patch));
    proto_json_free(&patch);
    assert_null(proto_view_volume(NULL));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(merged_patches_are_checked_together),
        cmocka_unit_test(patches_merge_and_arrays_are_replaced),
        cmocka_unit_test(null_resets_a_field_to_its_default),
        cmocka_unit_test(defaults_may_be_the_view_itself),
        cmocka_unit_test(a_refused_patch_changes_nothing),
        cmocka_unit_test(errors_name_the_field_and_the_remedy),
        cmocka_unit_test(a_camera_is_placed_by_angles),
        cmocka_unit_test(the_poles_have_an_up),
        cmocka_unit_test(any_camera_has_an_orbit),
        cmocka_unit_test(opacity_is_never_rounded_up_to_one),
        cmocka_unit_test(random_views_round_trip_bit_for_bit),
        cmocka_unit_test(the_default_view_round_trips),
        cmocka_unit_test(the_volume_of_a_patch_is_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
