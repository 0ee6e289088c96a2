/* SPDX-License-Identifier: Apache-2.0
 *
 * Layers of vectors and points whose colours come from other numbers than their values (color_by):
 * a constant number gives one colour and keeps the opacities, numbers in any unit give the same
 * image as the lengths that they come from, and the colours lie where the numbers say.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "support/render.h"

enum { SIDE = 16, COUNT = SIDE * SIDE * SIDE };

/* Grids of one field with other numbers on the same samples, or points. */
enum { GRID, POINTS, KINDS };
enum { OWN, CONSTANT, FAR, ALONG, FIELDS };
static const char *const ids[FIELDS] = { "own", "constant", "far", "along" };

struct volumes {
    struct sp_volume *fields[FIELDS];
};

/* Lengths from 0 to 2 along y. */
static double length_at(uint32_t n) {
    return 2.0 * (n / SIDE % SIDE) / (SIDE - 1);
}

static float value_at(int field, uint32_t n) {
    switch (field) {
    case CONSTANT:
        return 0.25f;
    case FAR:
        return (float)(1000 + 50 * length_at(n));
    case ALONG:
        return n == 5 ? NAN : (float)(n % SIDE);
    default:
        return (float)(n / (SIDE * SIDE)) / (SIDE - 1);
    }
}

static void vector_at(uint32_t n, float v[3]) {
    const double angle = 0.4 * n;
    v[0] = (float)(length_at(n) * cos(angle));
    v[1] = (float)(length_at(n) * sin(angle));
    v[2] = 0;
}

static struct sp_volume *make_grid(const float *values, const float (*vectors)[3]) {
    struct sp_grid grid = { .dims = { SIDE, SIDE, SIDE } };
    for (int a = 0; a < 3; a++) {
        grid.spacing[a] = grid.direction[a][a] = 1;
        grid.origin[a] = -0.5 * (SIDE - 1);
    }
    return sp_volume_create_vectors(&grid, SP_FLOAT32, values, vectors, "field", NULL);
}

static struct sp_volume *make_points(float *values, float (*vectors)[3]) {
    static float positions[COUNT][3], factors[COUNT][6], volumes[COUNT];
    for (uint32_t n = 0; n < COUNT; n++) {
        const uint32_t at[3] = { n % SIDE, n / SIDE % SIDE, n / SIDE / SIDE };
        for (int a = 0; a < 3; a++) {
            positions[n][a] = (float)at[a] - 0.5f * (SIDE - 1);
            factors[n][a * (a + 3) / 2] = 0.7f;
        }
        volumes[n] = 1;
    }
    const struct sp_elements points = {
        .shape = { .kind = SP_KIND_POINTS, .count = COUNT, .has_vectors = true },
        .positions = positions,
        .factors = factors,
        .values = values,
        .volumes = volumes,
        .vectors = vectors
    };
    return sp_volume_create_elements(&points, "field", NULL);
}

static void make(struct volumes *v, int kind) {
    static float values[COUNT], vectors[COUNT][3];
    for (uint32_t n = 0; n < COUNT; n++)
        vector_at(n, vectors[n]);
    for (int f = 0; f < FIELDS; f++) {
        for (uint32_t n = 0; n < COUNT; n++)
            values[n] = value_at(f, n);
        v->fields[f] = kind == GRID ? make_grid(values, (const float(*)[3])vectors)
                                    : make_points(values, vectors);
        assert_non_null(v->fields[f]);
    }
}

static void finish(struct volumes *v) {
    for (int f = 0; f < FIELDS; f++)
        sp_volume_unref(&v->fields[f]);
}

static struct sp_volume *find_volume(void *user, const char *id) {
    const struct volumes *v = user;
    for (int f = 0; f < FIELDS; f++)
        if (strcmp(id, ids[f]) == 0)
            return sp_volume_ref(v->fields[f]);
    return NULL;
}

static void make_view(struct sp_view *view, enum sp_layer_type type) {
    test_view_init(view);
    view->transfer_function.points[0] = (struct sp_tf_point){ 0, { 1, 0.2f, 0 }, 0.02f };
    view->transfer_function.points[1] = (struct sp_tf_point){ 1, { 0, 0.6f, 1 }, 0.3f };
    view->camera.position[2] = -60;
    view->layers[0] = sp_layer_default(type);
    view->layers[0].density = 1;
}

static void draw(const struct test_renderer *renderer, struct volumes *v,
                 const struct sp_view *view, struct test_image *image) {
    const struct sp_render_options options = { .format = SP_RGBAF32,
                                               .find = find_volume,
                                               .user = v };
    struct sp_error err = { 0 };
    struct sp_frame *frame = sp_renderer_render(renderer->renderer, v->fields[OWN], view,
                                                renderer->pool, &options, &err);
    if (!frame)
        fail_msg("%s: %s", err.place, err.text);
    assert_true(test_image_from_frame(image, frame));
    sp_frame_unref(&frame);
}

/* Returns how close the images of the two views are [dB]. */
static double compare(const struct test_renderer *renderer, struct volumes *v,
                      const struct sp_view *a, const struct sp_view *b) {
    struct test_image images[2];
    draw(renderer, v, a, &images[0]);
    draw(renderer, v, b, &images[1]);
    const double psnr = test_image_psnr(&images[0], &images[1]);
    test_image_finish(&images[0]);
    test_image_finish(&images[1]);
    return psnr;
}

static void set_color_by(struct sp_view *view, const char *id, double low, double high) {
    struct sp_layer *layer = &view->layers[0];
    snprintf(layer->color_by, sizeof layer->color_by, "%s", id);
    layer->color_low = low;
    layer->color_high = high;
}

/* A quarter of the way through the colours, with the opacities of the values. */
static double compare_constant(const struct test_renderer *renderer, struct volumes *v,
                               enum sp_layer_type type) {
    struct sp_view one, other;
    make_view(&one, type);
    make_view(&other, type);
    set_color_by(&other, "constant", 0, 1);
    for (int i = 0; i < 2; i++) {
        float *color = one.transfer_function.points[i].color;
        color[0] = 0.75f;
        color[1] = 0.3f;
        color[2] = 0.25f;
    }
    return compare(renderer, v, &one, &other);
}

static double compare_units(const struct test_renderer *renderer, struct volumes *v,
                            enum sp_layer_type type) {
    struct sp_view lengths, numbers;
    make_view(&lengths, type);
    make_view(&numbers, type);
    set_color_by(&lengths, SP_COLOR_BY_LENGTH, NAN, NAN); /* 0 to 2 */
    set_color_by(&numbers, "far", 1000, 1100);
    return compare(renderer, v, &lengths, &numbers);
}

/* Numbers rise along x, from the left to the right of the image; red falls, and blue rises. */
static void check_places(const struct test_renderer *renderer, struct volumes *v,
                         enum sp_layer_type type) {
    struct test_image image;
    struct sp_view view;
    double sums[2][3] = { { 0 } };
    make_view(&view, type);
    set_color_by(&view, "along", NAN, NAN);
    draw(renderer, v, &view, &image);
    for (unsigned y = 0; y < image.height; y++)
        for (unsigned x = 0; x < image.width; x++)
            for (int c = 0; c < 3; c++)
                sums[x >= image.width / 2][c] += test_image_at(&image, x, y)[c];
    test_image_finish(&image);
    assert_compare(sums[0][0], >, 0);
    assert_compare(sums[0][0] * sums[1][2], >, 4 * sums[1][0] * sums[0][2]);
}

static void check_layer(const struct test_renderer *renderer, const char *name, struct volumes *v,
                        enum sp_layer_type type) {
    struct sp_error err;
    struct sp_view view;
    make_view(&view, type);
    if (!sp_renderer_supports(renderer->renderer, &view, &err))
        return;
    const double constant = compare_constant(renderer, v, type);
    const double units = compare_units(renderer, v, type);
    printf("%-8s one colour %.1f dB, lengths in another unit %.1f dB\n", name, constant, units);
    assert_compare(constant, >=, 95);
    assert_compare(units, >=, 75);
    check_places(renderer, v, type);
}

static void colors_follow_other_numbers(void **state) {
    struct volumes v[KINDS];
    struct test_target target;
    (void)state;
    for (int kind = 0; kind < KINDS; kind++)
        make(&v[kind], kind);
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 2, NULL))
            continue;
        check_layer(&renderer, target.isa, &v[GRID], SP_LAYER_VECTORS);
        check_layer(&renderer, target.isa, &v[POINTS], SP_LAYER_VECTORS);
        check_layer(&renderer, target.isa, &v[POINTS], SP_LAYER_POINTS);
        test_renderer_close(&renderer);
    }
    for (int kind = 0; kind < KINDS; kind++)
        finish(&v[kind]);
}

static void expect_error(const struct test_renderer *renderer, struct volumes *v,
                         const char *color_by, enum sp_code code, const char *text) {
    const struct sp_render_options options = { .format = SP_RGBAF32,
                                               .find = find_volume,
                                               .user = v };
    struct sp_error err = { 0 };
    struct sp_view view;
    make_view(&view, sp_volume_elements(v->fields[OWN]) ? SP_LAYER_POINTS : SP_LAYER_VECTORS);
    set_color_by(&view, color_by, NAN, NAN);
    assert_null(sp_renderer_render(renderer->renderer, v->fields[OWN], &view, renderer->pool,
                                   &options, &err));
    assert_int_equal(err.code, code);
    assert_string_equal(err.place, "/layers/0/color_by");
    if (!strstr(err.text, text))
        fail_msg("%s", err.text);
}

/* No volume, and a volume with other samples. */
static void numbers_that_do_not_fit_are_refused(void **state) {
    const struct test_target scalar = { "cpu", "scalar" };
    struct test_renderer renderer;
    struct volumes v[KINDS];
    (void)state;
    assert_true(test_renderer_open(&renderer, &scalar, 1, NULL));
    for (int kind = 0; kind < KINDS; kind++)
        make(&v[kind], kind);
    for (int kind = 0; kind < KINDS; kind++) {
        struct volumes mixed = v[kind];
        mixed.fields[FAR] = v[1 - kind].fields[FAR];
        expect_error(&renderer, &mixed, "none", SP_ERR_VOLUME_UNKNOWN, "\"none\"");
        expect_error(&renderer, &mixed, "far", SP_ERR_INVALID, "\"far\" has other samples");
    }
    for (int kind = 0; kind < KINDS; kind++)
        finish(&v[kind]);
    test_renderer_close(&renderer);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(colors_follow_other_numbers),
        cmocka_unit_test(numbers_that_do_not_fit_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
