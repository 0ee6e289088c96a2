/* SPDX-License-Identifier: Apache-2.0
 *
 * The first view of samples that are no amounts of matter: labels, distances, values of both signs,
 * fields that span many powers of ten.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/volume.h"
#include "sp/view.h"
#include "support/compare.h"

enum { SIDE = 48 };

typedef double value_at(double x, double y, double z);

static void release(void *voxels, size_t bytes) {
    (void)bytes;
    free(voxels);
}

static struct sp_volume *make(enum sp_type type, enum sp_meaning meaning, value_at *value) {
    struct sp_volume_info info = { .type = type, .meaning = meaning, .source = "test" };
    const size_t count = (size_t)SIDE * SIDE * SIDE;
    const size_t capacity = (count * sp_type_size(type) + 63) & ~(size_t)63;
    void *voxels = aligned_alloc(64, capacity);
    assert_non_null(voxels);
    for (int a = 0; a < 3; a++) {
        info.grid.dims[a] = SIDE;
        info.grid.spacing[a] = info.grid.direction[a][a] = 1;
    }
    for (size_t i = 0; i < count; i++) {
        const double v =
            value((double)(i % SIDE), (double)(i / SIDE % SIDE), (double)(i / SIDE / SIDE));
        if (type == SP_FLOAT32)
            ((float *)voxels)[i] = (float)v;
        else
            ((uint16_t *)voxels)[i] = (uint16_t)(int32_t)v; /* or int16_t */
    }
    struct sp_volume *volume = sp_volume_adopt(&info, voxels, NULL, capacity, release, NULL);
    assert_non_null(volume);
    return volume;
}

static struct sp_view choose(const struct sp_volume *volume) {
    struct sp_view view;
    struct sp_error err;
    sp_view_choose(&view, volume, "v");
    if (!sp_view_validate(&view, &err))
        fail_msg("%s: %s", err.place, err.text);
    return view;
}

/* Colour and opacity of a value, in out[3]. */
static void look_of(const struct sp_view *view, double value, double out[4]) {
    const struct sp_tf_point *p = view->transfer_function.points,
                             *end = p + view->transfer_function.point_count;
    while (p < end && p->value <= value)
        p++;
    const struct sp_tf_point *before = p == view->transfer_function.points ? p : p - 1;
    const struct sp_tf_point *after = p == end ? p - 1 : p;
    const double length = after->value - before->value;
    const double t = length > 0 ? (value - before->value) / length : 0;
    for (int c = 0; c < 4; c++) {
        const double a = c < 3 ? (double)before->color[c] : (double)before->opacity;
        const double b = c < 3 ? (double)after->color[c] : (double)after->opacity;
        out[c] = (1 - t) * a + t * b;
    }
}

static double opacity_of(const struct sp_view *view, double value) {
    double look[4];
    look_of(view, value, look);
    return look[3];
}

static double radius(double x, double y, double z) {
    const double m = (SIDE - 1) / 2.0;
    return sqrt((x - m) * (x - m) + (y - m) * (y - m) + (z - m) * (z - m));
}

/* Blocks of nine numbers, and a block with a large number. */
static double blocks(double x, double y, double z) {
    if (x < 4 || y < 4 || z < 4 || x >= 44 || y >= 44 || z >= 44)
        return 0;
    const int cell = (int)((x - 4) / 14) + 3 * (int)((y - 4) / 14);
    return z < 24 ? cell + 1 : cell == 4 ? 2035 : 0;
}

/* Each label is visible in a colour of its own, and no value between two labels is drawn. */
static void check_labels(const struct sp_view *view) {
    double last[4] = { 0 };
    assert_int_equal(view->transfer_function.order, SP_TF_PRE);
    assert_float_equal(opacity_of(view, 0), 0, 1e-9);
    for (int label = 1; label <= 9; label++) {
        double look[4];
        look_of(view, label, look);
        assert_compare(look[3], >, 0.02);
        double difference = 0;
        for (int c = 0; c < 3; c++)
            difference += fabs(look[c] - last[c]);
        assert_compare(difference, >, 0.2);
        memcpy(last, look, sizeof last);
    }
    assert_compare(opacity_of(view, 2035), >, 0.02);
}

static void labels_have_colours_of_their_own(void **state) {
    (void)state;
    struct sp_volume *volume = make(SP_UINT16, SP_MEANING_UNKNOWN, blocks);
    struct sp_view view = choose(volume);
    check_labels(&view);
    sp_volume_unref(&volume);
    volume = make(SP_FLOAT32, SP_MEANING_LABELS, blocks);
    view = choose(volume);
    check_labels(&view);
    sp_volume_unref(&volume);
}

static double many(double x, double y, double z) {
    return 1 + (int)(x / 4) + 12 * (int)(y / 4) + 144 * (int)(z / 4);
}

static void more_labels_than_points_are_all_visible(void **state) {
    (void)state;
    struct sp_volume *volume = make(SP_UINT16, SP_MEANING_LABELS, many);
    const struct sp_view view = choose(volume);
    for (int label = 1; label <= 12 * 12 * 12; label += 7)
        assert_compare(opacity_of(&view, label), >, 0.01);
    sp_volume_unref(&volume);
}

/* Noise, a gradient and a mask are no labels. */
static double gradient(double x, double y, double z) {
    return floor(100 + 2 * x + y + z);
}

static double mask(double x, double y, double z) {
    return radius(x, y, z) < 15 ? 255 : 0;
}

static void amounts_are_no_labels(void **state) {
    (void)state;
    value_at *const values[] = { gradient, mask };
    for (size_t i = 0; i < 2; i++) {
        struct sp_volume *volume = make(SP_UINT16, SP_MEANING_UNKNOWN, values[i]);
        assert_int_equal(choose(volume).transfer_function.order, SP_TF_AUTO);
        sp_volume_unref(&volume);
    }
}

static double ball_distance(double x, double y, double z) {
    return radius(x, y, z) - 15;
}

static double narrow_band(double x, double y, double z) {
    return fmin(fmax(ball_distance(x, y, z), -3), 3);
}

static double inside_out(double x, double y, double z) {
    return -ball_distance(x, y, z);
}

static double in_hundredths(double x, double y, double z) {
    return round(100 * ball_distance(x, y, z));
}

static double in_thirties(double x, double y, double z) {
    return ball_distance(x, y, z) / 30;
}

static double half_space(double x, double y, double z) {
    (void)y, (void)z;
    return x - 20;
}

static void distances_show_their_surface(void **state) {
    (void)state;
    static const struct {
        enum sp_type type;
        value_at *value;
        double inside;
    } cases[] = { { SP_FLOAT32, ball_distance, -2 },
                  { SP_FLOAT32, narrow_band, -2 },
                  { SP_FLOAT32, inside_out, 2 },
                  { SP_INT16, in_hundredths, -200 },
                  { SP_FLOAT32, in_thirties, -2 / 30.0 } };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sp_volume *volume = make(cases[i].type, SP_MEANING_UNKNOWN, cases[i].value);
        const struct sp_view view = choose(volume);
        assert_int_equal(view.layer_count, 1);
        assert_int_equal(view.layers[0].type, SP_LAYER_SURFACE);
        assert_float_equal(view.layers[0].value, 0, 0);
        assert_compare(opacity_of(&view, cases[i].inside), >, 0.5);
        assert_float_equal(opacity_of(&view, -cases[i].inside), 0, 1e-6);
        for (int a = 0; a < 3; a++)
            assert_float_equal(view.camera.target[a], (SIDE - 1) / 2.0, 1);
        sp_volume_unref(&volume);
    }
    struct sp_volume *volume = make(SP_FLOAT32, SP_MEANING_DISTANCE, half_space);
    assert_int_equal(choose(volume).layers[0].type, SP_LAYER_SURFACE);
    sp_volume_unref(&volume);
    volume = make(SP_FLOAT32, SP_MEANING_UNKNOWN, half_space); /* a coordinate */
    assert_int_equal(choose(volume).layers[0].type, SP_LAYER_VOLUME);
    sp_volume_unref(&volume);
}

static double two_lobes(double x, double y, double z) {
    return exp(-pow(radius(x - 9, y, z) / 5, 2)) - exp(-pow(radius(x + 9, y, z) / 5, 2));
}

static void both_signs_are_shown(void **state) {
    (void)state;
    struct sp_volume *volume = make(SP_FLOAT32, SP_MEANING_UNKNOWN, two_lobes);
    const struct sp_view view = choose(volume);
    double low[4], high[4];
    look_of(&view, -0.8, low);
    look_of(&view, 0.8, high);
    assert_float_equal(opacity_of(&view, 0), 0, 1e-9);
    assert_compare(low[3], >, 0.05);
    assert_float_equal(low[3], high[3], 0.05);
    assert_compare(low[2], >, low[0]);   /* blue */
    assert_compare(high[0], >, high[2]); /* red */
    sp_volume_unref(&volume);
}

static double orbital(double x, double y, double z) {
    return exp(-0.8 * radius(x, y, z));
}

/* Values ten thousand times fainter than the nucleus stay visible. */
static void values_over_many_powers_of_ten_are_visible(void **state) {
    (void)state;
    struct sp_volume *volume = make(SP_FLOAT32, SP_MEANING_UNKNOWN, orbital);
    const struct sp_view view = choose(volume);
    assert_compare(opacity_of(&view, orbital(34, 24, 24)), >, 0.001);
    assert_compare(opacity_of(&view, orbital(25, 24, 24)), >, 0.05);
    sp_volume_unref(&volume);
}

static double waves(double x, double y, double z) {
    return 40 + 20 * sin(x / 9) + 10 * cos(y / 11) + z / 8;
}

/* A field without surroundings shows all of itself, and its colours rise evenly. */
static void all_of_a_field_is_visible(void **state) {
    (void)state;
    struct sp_volume *volume = make(SP_FLOAT32, SP_MEANING_UNKNOWN, waves);
    const struct sp_volume_info *info = sp_volume_info(volume);
    const struct sp_view view = choose(volume);
    double before = -1;
    for (int i = 0; i <= 10; i++) {
        double look[4];
        look_of(&view, info->range[0] + (info->range[1] - info->range[0]) * i / 10, look);
        const double lightness = 0.2126 * look[0] + 0.7152 * look[1] + 0.0722 * look[2];
        assert_compare(look[3], >, 0.0005);
        assert_compare(lightness, >, before);
        before = lightness;
    }
    sp_volume_unref(&volume);
}

/* A bright core in a wide haze: the camera stands outside of the haze. */
static double cloud(double x, double y, double z) {
    const double r = radius(x, y, z);
    return r < 4 ? 1 : r < 23 ? 0.3 : 0;
}

static void the_camera_stands_outside(void **state) {
    (void)state;
    struct sp_volume *volume = make(SP_FLOAT32, SP_MEANING_UNKNOWN, cloud);
    const struct sp_view view = choose(volume);
    const double *eye = view.camera.position;
    assert_compare(radius(eye[0], eye[1], eye[2]), >, 24);
    sp_volume_unref(&volume);
}

/* A head whose face the scan cut off, at the side that would be in front. */
static double cut_head(double x, double y, double z) {
    return y + z < 1e3 && hypot(hypot(x - 24, 1.0 * (y - 6)), z - 24) < 20 ? 150 : 2;
}

static void a_cut_face_is_turned_away(void **state) {
    (void)state;
    struct sp_volume *volume = make(SP_UINT16, SP_MEANING_UNKNOWN, cut_head);
    const struct sp_view view = choose(volume);
    assert_compare(view.camera.position[1], >, view.camera.target[1]);
    sp_volume_unref(&volume);
}

static double with_mark(double x, double y, double z) {
    return x < 12 ? 1e20 : y < 12 ? -9999 : waves(x, y, z);
}

static double with_upper_mark(double x, double y, double z) {
    return x < 12 ? 9999 : waves(x, y, z);
}

static void missing_values_are_transparent(void **state) {
    (void)state;
    struct sp_volume *volume = make(SP_FLOAT32, SP_MEANING_UNKNOWN, with_mark);
    const struct sp_view view = choose(volume);
    assert_float_equal(opacity_of(&view, 1e20), 0, 0);
    assert_float_equal(opacity_of(&view, -9999), 0, 0);
    assert_compare(opacity_of(&view, 45), >, 0.0005);
    sp_volume_unref(&volume);
    volume = make(SP_FLOAT32, SP_MEANING_UNKNOWN, with_upper_mark);
    const struct sp_view other = choose(volume);
    assert_float_equal(opacity_of(&other, 9999), 0, 0);
    assert_compare(opacity_of(&other, 45), >, 0.0005);
    sp_volume_unref(&volume);
}

/* A cell in bright field: dark in a white surrounding. */
static double dark_ball(double x, double y, double z) {
    const double waves_of_it = 10 * sin(x) * cos(y + z);
    return radius(x, y, z) < 15 ? 120 + waves_of_it : 245 + waves_of_it;
}

static void bright_surroundings_are_transparent(void **state) {
    (void)state;
    struct sp_volume *volume = make(SP_UINT16, SP_MEANING_UNKNOWN, dark_ball);
    const struct sp_view view = choose(volume);
    const struct sp_transfer_function *tf = &view.transfer_function;
    assert_float_equal(opacity_of(&view, 245), 0, 0);
    assert_compare(opacity_of(&view, 115), >, 0.005);
    for (uint32_t i = 1; i < tf->point_count; i++)
        assert_compare(tf->points[i].value, >, tf->points[i - 1].value);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(labels_have_colours_of_their_own),
        cmocka_unit_test(more_labels_than_points_are_all_visible),
        cmocka_unit_test(amounts_are_no_labels),
        cmocka_unit_test(distances_show_their_surface),
        cmocka_unit_test(both_signs_are_shown),
        cmocka_unit_test(values_over_many_powers_of_ten_are_visible),
        cmocka_unit_test(all_of_a_field_is_visible),
        cmocka_unit_test(the_camera_stands_outside),
        cmocka_unit_test(a_cut_face_is_turned_away),
        cmocka_unit_test(missing_values_are_transparent),
        cmocka_unit_test(bright_surroundings_are_transparent),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
