/* SPDX-License-Identifier: Apache-2.0
 *
 * Keyframes: interpolation, and the checks of a request.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "paths/keyframes.h"
#include "protocol/view.h"
#include "support/compare.h"
#include "tests/protocol/fixture.h"

static struct sp_view base;

static int set_up(void **state) {
    (void)state;
    base = fixture_view();
    base.camera = (struct sp_camera){ .projection = SP_PERSPECTIVE,
                                      .position = { 0, 0, 100 },
                                      .up = { 0, 1, 0 },
                                      .fov_y = 30,
                                      .height = 50,
                                      .near = 0.1 };
    return 0;
}

/* Reads a path of frames 0 to 100 with these keyframes; NULL with *err set. */
static struct srv_keyframes *try_keys(const char *keys, struct sp_error *err) {
    static const char format[] = "{\"frames\": 101, \"fps\": 10, \"keyframes\": %s}";
    size_t capacity = sizeof format + strlen(keys);
    char *text = malloc(capacity);
    assert_non_null(text);
    int n = snprintf(text, capacity, format, keys);
    proto_json *json = proto_json_parse(text, (size_t)n, err);
    assert_non_null(json);
    struct srv_keyframes *keyframes = srv_keyframes_read(json, &base, &base, 1000, err);
    proto_json_free(&json);
    free(text);
    return keyframes;
}

static struct srv_keyframes *read_keys(const char *keys) {
    struct sp_error err = { .code = SP_OK };
    struct srv_keyframes *keyframes = try_keys(keys, &err);
    if (!keyframes)
        fail_msg("%s: %s", err.place, err.text);
    return keyframes;
}

static struct sp_view frame_of(const struct srv_keyframes *keyframes, uint32_t frame) {
    struct sp_error err = { .code = SP_OK };
    struct sp_view view;
    if (!srv_keyframes_view(keyframes, frame, &view, &err))
        fail_msg("frame %u: %s: %s", frame, err.place, err.text);
    return view;
}

static void assert_near(double a, double b) {
    if (!(fabs(a - b) <= 1e-9 * (1 + fabs(b))))
        fail_msg("%.17g is not %.17g", a, b);
}

static void a_keyframe_is_reproduced_bit_for_bit(void **state) {
    (void)state;
    struct srv_keyframes *keyframes = read_keys(
        "[{\"frame\": 30, \"view\": {\"camera\": {\"position\": [70, 20, 0.3], \"fov_y\": 41.7}, "
        "\"filter\": {\"sigma\": 1.1}, \"background\": [0.1, 0.2, 0.3, 1]}},"
        "{\"time\": 6, \"view\": {\"camera\": {\"up\": [0.3, 1, 0.1]}, \"transfer_function\": "
        "{\"points\": [{\"value\": 3, \"color\": [0.1, 0.7, 1], \"opacity\": 0.3}]},"
        "\"filter\": {}, \"background\": [0.7, 0, 0, 0.5]}}]");
    const uint32_t at[] = { 0, 30, 60 };
    for (unsigned i = 0; i < 3; i++) {
        struct sp_view view = frame_of(keyframes, at[i]);
        const struct sp_view *key = srv_keyframes_key(keyframes, i);
        assert_memory_equal(&view.camera, &key->camera, sizeof view.camera);
        assert_memory_equal(&view.filter, &key->filter, sizeof view.filter);
        assert_memory_equal(view.background, key->background, sizeof view.background);
    }
    struct sp_view last = frame_of(keyframes, 60), held = frame_of(keyframes, 100);
    assert_int_equal(last.transfer_function.point_count, 1);
    assert_memory_equal(&last, &held, sizeof last);
    assert_null(srv_keyframes_key(keyframes, 3));
    srv_keyframes_free(&keyframes);
}

static void the_camera_moves_on_an_arc(void **state) {
    (void)state;
    /* A quarter turn around the up axis, while the distance is quartered and the target moves. */
    struct srv_keyframes *keyframes = read_keys(
        "[{\"frame\": 100, \"view\": {\"camera\": {\"position\": [45, 0, 0], \"target\": [20, 0, "
        "0], \"height\": 200, \"near\": 0.4, \"fov_y\": 50}}}]");
    for (uint32_t f = 0; f <= 100; f++) {
        struct sp_camera c = frame_of(keyframes, f).camera;
        double u = f / 100.0, angle = u * M_PI / 2, distance = 100 * pow(0.25, u);
        assert_near(c.target[0], 20 * u);
        assert_near(c.position[0], 20 * u + distance * sin(angle));
        assert_near(c.position[1], 0);
        assert_near(c.position[2], distance * cos(angle));
        assert_near(c.up[1], 1);
        assert_near(c.height, 50 * pow(4, u));
        assert_near(c.near, 0.1 * pow(4, u));
        assert_near(c.fov_y, 30 + 20 * u);
    }
    srv_keyframes_free(&keyframes);
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Computes the unit axes back, right and up of the camera. */
static void axes_of(const struct sp_camera *c, double axes[3][3]) {
    for (int i = 0; i < 3; i++)
        axes[0][i] = c->position[i] - c->target[i];
    for (int a = 0; a < 3; a++) {
        const double *x = a == 1 ? c->up : axes[0], *y = a == 1 ? axes[0] : axes[1];
        for (int i = 0; a > 0 && i < 3; i++)
            axes[a][i] = x[(i + 1) % 3] * y[(i + 2) % 3] - x[(i + 2) % 3] * y[(i + 1) % 3];
        double length = sqrt(dot(axes[a], axes[a]));
        for (int i = 0; i < 3; i++)
            axes[a][i] /= length;
    }
}

/* Returns the angle of the rotation between the axes of two frames. */
static double turn_between(const struct srv_keyframes *keyframes, uint32_t f, uint32_t g) {
    double a[3][3], b[3][3], trace = 0;
    struct sp_view from = frame_of(keyframes, f), to = frame_of(keyframes, g);
    axes_of(&from.camera, a);
    axes_of(&to.camera, b);
    for (int i = 0; i < 3; i++)
        trace += dot(a[i], b[i]);
    return acos(fmin(1, (trace - 1) / 2));
}

/* Between any two orientations, equal steps of the path turn by equal angles. */
static void the_camera_turns_at_constant_speed(void **state) {
    (void)state;
    static const double to[][6] = { { 50, 80, -30, 0, 0, 1 },  { 0, 0, -100, 0, -1, 0 },
                                    { -90, 1, 2, 1, 1, 0 },    { 1, 99, 1, 0, 0, -1 },
                                    { 0, 0, 100, 1, 0, 0 },    { 0, 1, 100, -1, -1, 0 },
                                    { -100, 0, 0.1, 0, 1, 0 }, { 17, 0, -98, 0, 1, 0 },
                                    { -17, 0, -98, 0, 1, 0 },  { 0, 17, -98, 0, -1, 0 },
                                    { 0, -17, -98, 0, -1, 0 } };
    for (size_t i = 0; i < sizeof to / sizeof *to; i++) {
        char keys[256];
        snprintf(keys, sizeof keys,
                 "[{\"frame\": 100, \"view\": {\"camera\": {\"position\": [%g, %g, %g], \"up\": "
                 "[%g, %g, %g]}}}]",
                 to[i][0], to[i][1], to[i][2], to[i][3], to[i][4], to[i][5]);
        struct srv_keyframes *keyframes = read_keys(keys);
        double step = turn_between(keyframes, 1, 2), sum = 0;
        for (uint32_t f = 0; f < 100; f++) {
            double turn = turn_between(keyframes, f, f + 1);
            sum += turn;
            assert_compare(fabs(turn - step), <, 1e-6);
        }
        assert_compare(step, >, 0.001);
        assert_compare(sum, <, M_PI + 1e-4); /* the shorter way */
        srv_keyframes_free(&keyframes);
    }
}

static double opacity_at(const struct sp_transfer_function *tf, double x) {
    const struct sp_tf_point *p = tf->points;
    uint32_t n = tf->point_count, i = 0;
    while (i < n && p[i].value < x)
        i++;
    if (i == 0 || i == n)
        return (double)p[i ? n - 1 : 0].opacity;
    double u = (x - p[i - 1].value) / (p[i].value - p[i - 1].value);
    return (double)p[i - 1].opacity * (1 - u) + (double)p[i].opacity * u;
}

static double scale_at(const struct sp_transfer_function *tf, double x) {
    struct sp_transfer_function points = { .point_count = tf->gradient_count };
    for (uint32_t i = 0; i < tf->gradient_count; i++)
        points.points[i] = (struct sp_tf_point){ .value = tf->gradient[i].magnitude,
                                                 .opacity = tf->gradient[i].scale };
    return tf->gradient_count ? opacity_at(&points, x) : 1;
}

static void transfer_functions_are_blended_at_every_value(void **state) {
    (void)state;
    struct srv_keyframes *keyframes = read_keys(
        "[{\"frame\": 0, \"view\": {\"transfer_function\": {\"points\": ["
        "{\"value\": 10, \"color\": [1, 0, 0], \"opacity\": 0.1},"
        "{\"value\": 50, \"color\": [0, 1, 0], \"opacity\": 0.9},"
        "{\"value\": 51, \"color\": [0, 1, 0], \"opacity\": 0}]}}},"
        "{\"frame\": 80, \"view\": {\"transfer_function\": {\"points\": ["
        "{\"value\": -5, \"color\": [0, 0, 1], \"opacity\": 0},"
        "{\"value\": 30, \"color\": [0, 0, 1], \"opacity\": 0.5},"
        "{\"value\": 50, \"color\": [1, 1, 1], \"opacity\": 0.2}],"
        "\"gradient\": [{\"magnitude\": 2, \"scale\": 0}, {\"magnitude\": 6, \"scale\": 1}]}}}]");
    const struct sp_transfer_function *a = &srv_keyframes_key(keyframes, 1)->transfer_function;
    const struct sp_transfer_function *b = &srv_keyframes_key(keyframes, 2)->transfer_function;
    for (uint32_t f = 10; f < 80; f += 10) {
        struct sp_view view = frame_of(keyframes, f);
        assert_int_equal(view.transfer_function.point_count,
                         5); /* the point at 50 is in both curves */
        for (double x = -20; x < 70; x += 0.5) {
            double u = f / 80.0;
            double mean = opacity_at(a, x) * (1 - u) + opacity_at(b, x) * u;
            double scale = (1 - u) + scale_at(b, x) * u;
            assert_compare(fabs(opacity_at(&view.transfer_function, x) - mean), <, 1e-6);
            assert_compare(fabs(scale_at(&view.transfer_function, x) - scale), <, 1e-6);
        }
    }
    /* The colour at 30, between red at 10 and green at 50 on one side, blue on the other. */
    struct sp_view view = frame_of(keyframes, 40);
    const struct sp_tf_point *p = &view.transfer_function.points[2];
    assert_near(p->value, 30);
    const double color[3] = { 0.25, 0.25, 0.5 };
    for (int c = 0; c < 3; c++)
        assert_compare(fabs((double)p->color[c] - color[c]), <, 1e-6);
    srv_keyframes_free(&keyframes);
}

static void tracks_are_interpolated_independently(void **state) {
    (void)state;
    struct srv_keyframes *keyframes = read_keys(
        "[{\"frame\": 20, \"view\": {\"filter\": {\"sigma\": 1.7}}},"
        "{\"frame\": 50, \"view\": {\"filter\": {\"lowpass\": 3}, \"clip\": {\"box\": [[0, 0, 0], "
        "[1, 1, 0.5]]}}},"
        "{\"frame\": 100, \"view\": {\"camera\": {\"fov_y\": 130}}}]");
    for (uint32_t f = 0; f <= 100; f++) {
        struct sp_view view = frame_of(keyframes, f);
        assert_near(view.camera.fov_y, 30 + f);
        assert_near(view.filter.sigma, f < 20 ? 0.7 + f / 20.0 : 1.7);
        assert_near(view.filter.lowpass, f < 20 ? 1 : f < 50 ? 1 + 2 * (f - 20) / 30.0 : 3);
        assert_near(view.clip.box[1][2], f < 50 ? 1 - f / 100.0 : 0.5);
    }
    srv_keyframes_free(&keyframes);
}

static void names_change_at_the_next_key(void **state) {
    (void)state;
    struct srv_keyframes *keyframes = read_keys(
        "[{\"frame\": 40, \"view\": {\"transfer_function\": {\"order\": \"post\"}, "
        "\"compositing\": {\"mode\": \"slab\", \"slab\": 3}, \"camera\": {\"projection\": "
        "\"orthographic\"}, \"quality\": {\"level_of_detail\": \"off\"}, \"filter\": {\"kernel\": "
        "\"cubic\", \"c_max\": 7, \"c_min\": 3}}}]");
    for (uint32_t f = 0; f <= 100; f++) {
        struct sp_view view = frame_of(keyframes, f);
        bool is_late = f >= 40;
        assert_int_equal(view.transfer_function.order, is_late ? SP_TF_POST : SP_TF_AUTO);
        assert_int_equal(view.compositing.mode, is_late ? SP_COMPOSITE_SLAB : SP_COMPOSITE_SHEET);
        assert_near(view.compositing.slab, is_late ? 3 : 1 + 2 * f / 40.0);
        assert_int_equal(view.camera.projection, is_late ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE);
        assert_int_equal(view.level_of_detail, is_late ? SP_LOD_OFF : SP_LOD_AUTO);
        assert_int_equal(view.filter.kernel, is_late ? SP_KERNEL_CUBIC : SP_KERNEL_GAUSSIAN);
        assert_int_equal(isnan(view.filter.c_max) != 0, !is_late);
        assert_near(view.filter.c_min, is_late ? 3 : base.filter.c_min);
    }
    srv_keyframes_free(&keyframes);
}

/* One track: compositing. */
static void the_window_of_a_projection_is_blended_in_one_unit(void **state) {
    (void)state;
    struct srv_keyframes *keyframes = read_keys(
        "[{\"frame\": 0, \"view\": {\"compositing\": "
        "{\"mode\": \"sum\", \"window\": {\"center\": 2, "
        "\"width\": 8}, \"zero\": -10}}},"
        "{\"frame\": 20, \"view\": {\"compositing\": "
        "{\"mode\": \"sum\", \"window\": {\"center\": 4, "
        "\"width\": 4}, \"zero\": 10}}},"
        "{\"frame\": 40, \"view\": {\"compositing\": "
        "{\"mode\": \"sum\", \"window\": {\"center\": 1, "
        "\"width\": 2}, \"zero\": 30, \"absorption\": 1}}},"
        "{\"frame\": 60, \"view\": {\"compositing\": "
        "{\"mode\": \"sum\", \"window\": {\"center\": null, \"width\": 6}, \"zero\": null, "
        "\"absorption\": 3}}},"
        "{\"frame\": 80, \"view\": {\"compositing\": "
        "{\"mode\": \"mean\", \"window\": {\"center\": 7, "
        "\"width\": 8}, \"absorption\": 3}}}]");
    const double expected[][5] = {
        /* frame, centre, width, zero, absorption; NAN = automatic */
        { 5, 2.5, 7, -5, NAN }, { 20, 4, 4, 10, NAN },  { 30, 4, 4, 20, NAN },  { 40, 1, 2, 30, 1 },
        { 50, 1, 4, 30, 2 },    { 60, NAN, 6, NAN, 3 }, { 70, NAN, 6, NAN, 3 }, { 80, 7, 8, NAN, 3 }
    };
    for (size_t i = 0; i < sizeof expected / sizeof expected[0]; i++) {
        struct sp_view view = frame_of(keyframes, (uint32_t)expected[i][0]);
        const struct sp_compositing_options *c = &view.compositing;
        const double got[] = { c->center, c->width, c->zero, c->absorption };
        for (int k = 0; k < 4; k++) {
            assert_int_equal(isnan(got[k]) != 0, isnan(expected[i][k + 1]) != 0);
            if (!isnan(got[k]))
                assert_near(got[k], expected[i][k + 1]);
        }
    }
    srv_keyframes_free(&keyframes);
}

static void values_that_cannot_be_blended_stay_until_the_key(void **state) {
    (void)state;
    struct srv_keyframes *keyframes = read_keys(
        "[{\"frame\": 0, \"view\": {\"clip\": {\"planes\": [{\"normal\": [0, 0, 1], \"offset\": "
        "4}]}, \"shading\": {\"lights\": [{\"direction\": [1, 0, 0]}]}}},"
        "{\"frame\": 50, \"view\": {\"clip\": {\"planes\": [{\"normal\": [0, 0, -1], \"offset\": "
        "8}]}, \"shading\": {\"lights\": [{\"direction\": [0, 3, 0], \"color\": [3, 1, 1]}]}}},"
        "{\"frame\": 100, \"view\": {\"shading\": {\"lights\": []}}}]");
    struct sp_view view = frame_of(keyframes, 25);
    assert_near(view.clip.planes[0].normal[2], 1);
    assert_near(view.clip.planes[0].offset, 4);
    assert_near(view.shading.lights[0].direction[0],
                2 * sqrt(0.5)); /* half-way, scaled to length 2 */
    assert_near(view.shading.lights[0].direction[1], 2 * sqrt(0.5));
    assert_near((double)view.shading.lights[0].color[0], 2);
    assert_near(frame_of(keyframes, 50).clip.planes[0].normal[2], -1);
    assert_int_equal(frame_of(keyframes, 99).shading.light_count, 1);
    assert_int_equal(frame_of(keyframes, 100).shading.light_count, 0);
    srv_keyframes_free(&keyframes);
}

static void a_key_may_be_approached_smoothly_or_in_one_step(void **state) {
    (void)state;
    struct srv_keyframes *keyframes =
        read_keys("[{\"frame\": 40, \"ease\": \"smooth\", \"view\": {\"camera\": {\"fov_y\": 70}}},"
                  "{\"frame\": 80, \"ease\": \"step\", \"view\": {\"camera\": {\"fov_y\": 90}}}]");
    assert_near(frame_of(keyframes, 10).camera.fov_y, 30 + 40 * 0.15625); /* 3u² − 2u³ at 1/4 */
    assert_near(frame_of(keyframes, 20).camera.fov_y, 50);
    assert_near(frame_of(keyframes, 79).camera.fov_y, 70);
    assert_near(frame_of(keyframes, 80).camera.fov_y, 90);
    srv_keyframes_free(&keyframes);
}

static void errors_have_a_pointer(void **state) {
    (void)state;
    static const char *const wrong[][2] = {
        { "7", "/keyframes" },
        { "[]", "/keyframes" },
        { "[3]", "/keyframes/0" },
        { "[{\"frame\": 1}]", "/keyframes/0" },
        { "[{\"view\": {}}]", "/keyframes/0" },
        { "[{\"frame\": -1, \"view\": {}}]", "/keyframes/0/frame" },
        { "[{\"frame\": 102, \"view\": {}}]", "/keyframes/0/frame" },
        { "[{\"time\": 11, \"view\": {}}]", "/keyframes/0/time" },
        { "[{\"time\": \"1\", \"view\": {}}]", "/keyframes/0/time" },
        { "[{\"time\": 1, \"frame\": 1, \"view\": {}}]", "/keyframes/0/frame" },
        { "[{\"time\": 1, \"ease\": \"in\", \"view\": {}}]", "/keyframes/0/ease" },
        { "[{\"time\": 1, \"a/b\": 2, \"view\": {}}]", "/keyframes/0/a~1b" },
        { "[{\"frame\": 5, \"view\": {}}, {\"frame\": 5, \"view\": {}}]", "/keyframes/1" },
        { "[{\"frame\": 5, \"view\": {\"size\": [1, 1]}}]", "/keyframes/0/view/size" },
        { "[{\"frame\": 5, \"view\": {\"volume\": \"a\"}}]", "/keyframes/0/view/volume" },
        { "[{\"frame\": 5, \"view\": {\"camera\": {\"fov_y\": 999}}}]",
          "/keyframes/0/view/camera/fov_y" },
        { "[{\"frame\": 5, \"view\": {\"camara\": {}}}]", "/keyframes/0/view/camara" },
        { "[{\"frame\": 5, \"view\": 5}]", "/keyframes/0/view" },
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct sp_error err = { .code = SP_OK };
        struct srv_keyframes *keyframes = try_keys(wrong[i][0], &err);
        if (keyframes || err.code != SP_ERR_INVALID || strcmp(err.place, wrong[i][1]) != 0)
            fail_msg("%s: %s: %s", wrong[i][0], err.place, err.text);
    }
}

static void the_output_of_a_path_is_checked(void **state) {
    (void)state;
    static const char *const wrong[][2] = {
        { "{\"keyframes\": []}", "/frames" },
        { "{\"frames\": 0}", "/frames" },
        { "{\"frames\": 1001}", "/frames" },
        { "{\"frames\": 1.5}", "/frames" },
        { "{\"frames\": 9, \"fps\": 0}", "/fps" },
        { "{\"frames\": 9, \"fps\": 241}", "/fps" },
        { "{\"frames\": 9, \"fps\": \"a\"}", "/fps" },
        { "{\"frames\": 9, \"format\": \"mp4\"}", "/format" },
        { "{\"frames\": 9, \"format\": 4}", "/format" },
        { "{\"frames\": 9, \"quality\": 101}", "/quality" },
        { "{\"frames\": 9}", "/keyframes" },
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct sp_error err = { .code = SP_OK };
        proto_json *json = proto_json_parse(wrong[i][0], strlen(wrong[i][0]), &err);
        struct srv_keyframes *keyframes = srv_keyframes_read(json, &base, &base, 1000, &err);
        if (keyframes || err.code != SP_ERR_INVALID || strcmp(err.place, wrong[i][1]) != 0)
            fail_msg("%s: %s: %s", wrong[i][0], err.place, err.text);
        proto_json_free(&json);
    }
}

/* Writes 200 points, from `first` on and one unit apart. */
static char *many_points(char *at, double first) {
    for (int i = 0; i < 200; i++)
        at += sprintf(at, "%s{\"value\": %g, \"color\": [1, 1, 1], \"opacity\": 0.5}", i ? "," : "",
                      first + i);
    return at;
}

static void too_many_points_of_both_are_refused(void **state) {
    (void)state;
    static const struct {
        double second;
        const char *ease;
        const char *place;
    } cases[] = { { 0.5, "linear", "/keyframes/1/view/transfer_function/points" },
                  { 0.5, "step", NULL },
                  { 50, "linear", NULL } }; /* 150 points are in both curves */
    char *keys = malloc(100000);
    assert_non_null(keys);
    for (size_t i = 0; i < 3; i++) {
        struct sp_error err = { .code = SP_OK };
        char *at = keys + sprintf(keys, "[{\"frame\": 0, \"view\": {\"transfer_function\": "
                                        "{\"points\": [");
        at = many_points(at, 0);
        at += sprintf(at,
                      "]}}}, {\"frame\": 50, \"ease\": \"%s\", \"view\": "
                      "{\"transfer_function\": {\"points\": [",
                      cases[i].ease);
        at = many_points(at, cases[i].second);
        sprintf(at, "]}}}]");
        struct srv_keyframes *keyframes = try_keys(keys, &err);
        assert_int_equal(keyframes == NULL, cases[i].place != NULL);
        if (keyframes)
            frame_of(keyframes, 25);
        else
            assert_string_equal(err.place, cases[i].place);
        srv_keyframes_free(&keyframes);
    }
    free(keys);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_keyframe_is_reproduced_bit_for_bit),
        cmocka_unit_test(the_camera_moves_on_an_arc),
        cmocka_unit_test(the_camera_turns_at_constant_speed),
        cmocka_unit_test(transfer_functions_are_blended_at_every_value),
        cmocka_unit_test(tracks_are_interpolated_independently),
        cmocka_unit_test(names_change_at_the_next_key),
        cmocka_unit_test(the_window_of_a_projection_is_blended_in_one_unit),
        cmocka_unit_test(values_that_cannot_be_blended_stay_until_the_key),
        cmocka_unit_test(a_key_may_be_approached_smoothly_or_in_one_step),
        cmocka_unit_test(errors_have_a_pointer),
        cmocka_unit_test(the_output_of_a_path_is_checked),
        cmocka_unit_test(too_many_points_of_both_are_refused),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
