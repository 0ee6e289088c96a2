/* SPDX-License-Identifier: Apache-2.0
 *
 * Curvilinear grids, as points with the kernels of the grid (volume/curvilinear.h): a field sampled
 * on a warped grid gives the image of the same field on a regular one, and a ring of constant
 * extinction the opacity that the length of the ray gives.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "support/compare.h"
#include "support/render.h"
#include "volume/curvilinear.h"

enum { SIDE = 48 };

/* Smooth blobs in [0, SIDE − 1]³, 0 at the border. */
static double field(const double p[3]) {
    static const double blobs[4][4] = {
        { 18, 20, 22, 6 }, { 30, 26, 20, 5 }, { 24, 30, 31, 5.5 }, { 27, 17, 28, 4.5 }
    };
    double sum = 0;
    for (int b = 0; b < 4; b++) {
        double square = 0;
        for (int a = 0; a < 3; a++)
            square += (p[a] - blobs[b][a]) * (p[a] - blobs[b][a]);
        sum += exp(-0.5 * square / (blobs[b][3] * blobs[b][3]));
    }
    return sum;
}

static double field_value(const void *user, double x, double y, double z) {
    (void)user;
    return field((const double[3]){ x, y, z });
}

/* Moves the nodes inside by up to `most` cells; those at the border stay on it. */
static void warp(const double i[3], double most, double p[3]) {
    const double turn = 2 * M_PI / (SIDE - 1);
    for (int a = 0; a < 3; a++) {
        double b = i[(a + 1) % 3], c = i[(a + 2) % 3];
        p[a] = i[a] + most * sin(turn * i[a]) * cos(turn * b) * sin(0.5 * turn * c);
    }
}

static struct sp_elements allocate(uint32_t count) {
    struct sp_elements e = { .shape = { .kind = SP_KIND_POINTS, .count = count },
                             .positions = calloc(count, sizeof *e.positions),
                             .factors = calloc(count, sizeof *e.factors),
                             .values = calloc(count, sizeof *e.values),
                             .volumes = calloc(count, sizeof *e.volumes) };
    assert_true(e.positions && e.factors && e.values && e.volumes);
    return e;
}

static struct sp_volume *finish(struct sp_elements *e, const uint32_t dims[3]) {
    assert_int_equal(sp_curvilinear_finish(e, 0, dims), 0);
    struct sp_volume *volume = sp_volume_create_elements(e, "curvilinear", NULL);
    assert_non_null(volume);
    free(e->positions);
    free(e->factors);
    free(e->values);
    free(e->volumes);
    return volume;
}

/* The field on a warped grid, whose middle is the origin. */
static struct sp_volume *make_warped(double most) {
    const uint32_t dims[3] = { SIDE, SIDE, SIDE };
    struct sp_elements e = allocate(SIDE * SIDE * SIDE);
    for (uint32_t n = 0; n < e.shape.count; n++) {
        const double i[3] = { n % SIDE, n / SIDE % SIDE, n / SIDE / SIDE };
        double p[3];
        warp(i, most, p);
        for (int a = 0; a < 3; a++)
            e.positions[n][a] = (float)(p[a] - 0.5 * (SIDE - 1));
        e.values[n] = (float)field(p);
    }
    return finish(&e, dims);
}

static void make_regular(struct test_scene *scene) {
    static const double points[][5] = { { 0.15, 0.9, 0.3, 0.2, 0 },
                                        { 0.5, 0.3, 0.8, 0.4, 0.05 },
                                        { 1.2, 0.4, 0.6, 1, 0.3 } };
    struct sp_view *view = &scene->view;
    test_view_init(view);
    view->size[0] = view->size[1] = 128;
    view->compositing.mode = SP_COMPOSITE_SPLAT;
    assert_true(test_scene_voxels(scene, "field", (const uint32_t[]){ SIDE, SIDE, SIDE },
                                  (const double[]){ 1, 1, 1 }, SP_FLOAT32, field_value, NULL));
    test_scene_orbit(scene, NULL, 35, 25, 110);
    test_scene_points(scene, points, 3);
}

static void for_each_renderer(void (*check)(const struct test_renderer *, const char *name)) {
    struct test_target target;
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 2, NULL))
            continue;
        check(&renderer, target.isa);
        test_renderer_close(&renderer);
    }
}

/* False if the backend draws no points. */
static bool draws(const struct test_renderer *renderer, const struct sp_view *view) {
    struct sp_error err = { .code = SP_OK };
    if (sp_renderer_supports(renderer->renderer, view, &err))
        return true;
    assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
    return false;
}

/* How far nodes move [cells], and how close the images are [dB]; half a decibel below what was
 * measured. Where cells are larger, the kernels blur the field more. */
static const struct { double most, floor; } warps[] = { { 0, 85.4 }, { 1, 62.8 }, { 3, 51.7 } };

static void check_warps(const struct test_renderer *renderer, const char *name) {
    struct test_scene scene;
    make_regular(&scene);
    struct sp_view view = scene.view;
    struct test_image wanted;
    assert_true(test_render_scene(renderer, &scene, &wanted, NULL));
    view.layers[0] = sp_layer_default(SP_LAYER_POINTS);
    for (size_t i = 0; i < sizeof warps / sizeof warps[0]; i++) {
        struct sp_volume *volume = make_warped(warps[i].most);
        struct test_image got;
        if (draws(renderer, &view)) {
            assert_true(test_render(renderer, volume, &view, &got, NULL));
            double psnr = test_image_psnr(&got, &wanted);
            printf("%-8s warped by %g cells: %.2f dB\n", name, warps[i].most, psnr);
            assert_compare(psnr, >=, warps[i].floor);
            test_image_finish(&got);
        }
        sp_volume_unref(&volume);
    }
    test_image_finish(&wanted);
    test_scene_finish(&scene);
}

static void a_warped_grid_shows_the_same_field(void **state) {
    (void)state;
    for_each_renderer(check_warps);
}

/* A ring of height 20 between the radii 20 and 60 that one value fills. */
static struct sp_volume *make_ring(void) {
    enum { RADII = 40, ANGLES = 180, HEIGHTS = 20 };
    const uint32_t dims[3] = { RADII, ANGLES, HEIGHTS };
    struct sp_elements e = allocate(RADII * ANGLES * HEIGHTS);
    for (uint32_t n = 0; n < e.shape.count; n++) {
        double radius = 20.5 + n % RADII, angle = 2 * M_PI * (n / RADII % ANGLES) / (ANGLES - 1);
        e.positions[n][0] = (float)(radius * cos(angle));
        e.positions[n][1] = (float)(radius * sin(angle));
        e.positions[n][2] = (float)(n / (RADII * ANGLES)) - 9.5f;
        e.values[n] = 1;
    }
    return finish(&e, dims);
}

/* Looks along the axis of the ring: rays between the radii pass through 20 of it. */
static void check_ring(const struct test_renderer *renderer, const char *name) {
    struct sp_volume *volume = make_ring();
    struct test_image image;
    struct sp_view view;
    test_view_init(&view);
    view.size[0] = view.size[1] = 128;
    view.layers[0] = sp_layer_default(SP_LAYER_POINTS);
    view.transfer_function.reference_length = 10;
    view.transfer_function.point_count = 1;
    view.transfer_function.points[0] = (struct sp_tf_point){ 1, { 1, 1, 1 }, 0.5f };
    view.camera = (struct sp_camera){ .projection = SP_ORTHOGRAPHIC,
                                      .position = { 0, 0, -100 },
                                      .up = { 0, -1, 0 },
                                      .fov_y = 30,
                                      .height = 128,
                                      .near = 1 };
    const double expected = 1 - 0.5 * 0.5; /* twice the reference length */
    double least = 1, most = 0;
    if (draws(renderer, &view)) {
        assert_true(test_render(renderer, volume, &view, &image, NULL));
        for (unsigned y = 0; y < 128; y++)
            for (unsigned x = 0; x < 128; x++) {
                double radius = hypot(x - 63.5, y - 63.5), alpha = test_image_at(&image, x, y)[3];
                if (radius < 24 || radius > 56) /* the kernels of the borders are smooth */
                    continue;
                least = fmin(least, alpha);
                most = fmax(most, alpha);
            }
        printf("%-8s opacity %.4f to %.4f, expected %.4f\n", name, least, most, expected);
        assert_compare(least, >=, 0.98 * expected);
        assert_compare(most, <=, 1.02 * expected);
        test_image_finish(&image);
    }
    sp_volume_unref(&volume);
}

static void a_ring_has_the_opacity_of_its_height(void **state) {
    (void)state;
    for_each_renderer(check_ring);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_warped_grid_shows_the_same_field),
        cmocka_unit_test(a_ring_has_the_opacity_of_its_height),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
