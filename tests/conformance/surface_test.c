/* SPDX-License-Identifier: Apache-2.0
 *
 * Iso-surfaces against rays that are intersected with the trilinear interpolant
 * (support/isosurface.h), every instruction set against the reference, and any number of threads.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "support/isosurface.h"
#include "support/render.h"

static double ball_value(const void *user, double x, double y, double z) {
    const double *m = user; /* middle and radius */
    return 128 + 30 * (m[3] - sqrt((x - m[0]) * (x - m[0]) + (y - m[1]) * (y - m[1]) +
                                   (z - m[2]) * (z - m[2])));
}

static void surface_view(struct test_scene *scene, double value) {
    struct sp_view *view = &scene->view;
    test_view_init(view);
    view->shading.mode = SP_SHADING_PHONG;
    view->filter.mode = SP_FILTER_ADAPTIVE;
    view->layer_count = 1;
    view->layers[0] = (struct sp_layer){ .type = SP_LAYER_SURFACE,
                                         .visible = true,
                                         .value = value,
                                         .color = { 0.9f, 0.85f, 0.75f },
                                         .opacity = 1,
                                         .flatness = INFINITY };
}

static void ball(struct test_scene *scene) {
    static const double m[4] = { 19.3, 20.1, 19.6, 14 };
    surface_view(scene, 128);
    scene->view.size[0] = scene->view.size[1] = 72;
    assert_true(test_scene_voxels(scene, "ball", (uint32_t[]){ 40, 40, 40 }, (double[]){ 1, 1, 1 },
                                  SP_FLOAT32, ball_value, m));
    test_scene_orbit(scene, NULL, 25, 30, 90);
}

static double blobs_value(const void *user, double x, double y, double z) {
    (void)user;
    static const double centers[5][4] = { { 12, 14, 15, 7 },
                                          { 24, 20, 12, 6 },
                                          { 16, 26, 24, 6 },
                                          { 27, 10, 26, 5 },
                                          { 22, 22, 22, 3 } };
    double sum = 0;
    for (int i = 0; i < 5; i++) {
        const double *c = centers[i];
        double d = (x - c[0]) * (x - c[0]) + (y - c[1]) * (y - c[1]) + (z - c[2]) * (z - c[2]);
        sum += exp(-d / (c[3] * c[3]));
    }
    return fmin(255, 200 * sum);
}

static void blobs(struct test_scene *scene) {
    surface_view(scene, 90);
    scene->view.size[0] = scene->view.size[1] = 72;
    assert_true(test_scene_voxels(scene, "blobs", (uint32_t[]){ 38, 38, 38 }, (double[]){ 1, 1, 1 },
                                  SP_UINT8, blobs_value, NULL));
    test_scene_orbit(scene, NULL, 25, 30, 80);
}

static void two(struct test_scene *scene) {
    blobs(scene);
    scene->view.layer_count = 2;
    scene->view.layers[0].opacity = 0.4f;
    scene->view.layers[1] = scene->view.layers[0];
    scene->view.layers[1].value = 160;
    scene->view.layers[1].opacity = 1;
    scene->view.layers[1].color[1] = 0.3f;
}

static void far_blobs(struct test_scene *scene) {
    blobs(scene);
    scene->view.size[0] = scene->view.size[1] = 32;
    test_scene_orbit(scene, NULL, 25, 30, 140);
}

static void near_blobs(struct test_scene *scene) {
    blobs(scene);
    test_scene_orbit(scene, NULL, 25, 30, 30);
    scene->view.camera.fov_y = 50;
}

static void cut_blobs(struct test_scene *scene) {
    blobs(scene);
    test_scene_cut(scene, (double[]){ 0.3, 0.2, -1 }, (double[]){ 0, 0, -2 });
}

static void parallel_blobs(struct test_scene *scene) {
    blobs(scene);
    scene->view.camera.projection = SP_ORTHOGRAPHIC;
    scene->view.camera.height = 40;
}

static void sheared_blobs(struct test_scene *scene) {
    blobs(scene);
    test_scene_direction(scene, (double[]){ 20, 35, 10 }, -1, 0.3);
}

static void layered_blobs(struct test_scene *scene) {
    surface_view(scene, 90);
    scene->view.size[0] = scene->view.size[1] = 72;
    assert_true(test_scene_voxels(scene, "blobs", (uint32_t[]){ 38, 38, 14 }, (double[]){ 1, 1, 3 },
                                  SP_UINT16, blobs_value, NULL));
    test_scene_orbit(scene, NULL, 25, 30, 80);
}

struct row {
    const char *name;
    void (*make)(struct test_scene *scene);
    double floor; /* dB, half a decibel below the measured value */
};

static const struct row rows[] = {
    { "ball", ball, 45.7 },
    { "blobs", blobs, 40.5 },
    { "two surfaces", two, 42.9 },
    { "far", far_blobs, 38.4 },
    { "near", near_blobs, 36.7 },
    { "cut", cut_blobs, 39.5 },
    { "parallel", parallel_blobs, 41.1 },
    { "sheared", sheared_blobs, 39.2 },
    { "layered", layered_blobs, 39.4 },
};
enum { ROWS = sizeof rows / sizeof rows[0] };

static void open_renderer(struct test_renderer *renderer, const char *isa, unsigned threads) {
    struct sp_error err = { 0 };
    const struct test_target target = { "cpu", isa };
    if (!test_renderer_open(renderer, &target, threads, &err))
        fail_msg("%s", err.text);
}

static void images_match_rays(void **state) {
    (void)state;
    const double blur = 0.5; /* px; half of the view's low-pass filter, which is adaptive */
    struct test_renderer renderer;
    open_renderer(&renderer, "auto", 2);
    for (int i = 0; i < ROWS; i++) {
        struct test_scene scene = { 0 };
        struct test_isosurface iso;
        struct test_image got, wanted;
        rows[i].make(&scene);
        assert_true(test_render_scene(&renderer, &scene, &got, NULL));
        assert_true(test_isosurface_init(&iso, &scene));
        assert_true(test_isosurface_render(&iso, 3, blur, &wanted));
        double psnr = test_image_psnr(&got, &wanted);
        printf("%-14s %6.2f dB\n", rows[i].name, psnr);
        if (!(psnr >= rows[i].floor))
            test_image_dump(rows[i].name, &got, &wanted, 4);
        assert_compare(psnr, >=, rows[i].floor);
        test_isosurface_finish(&iso);
        test_image_finish(&got);
        test_image_finish(&wanted);
        test_scene_finish(&scene);
    }
    test_renderer_close(&renderer);
}

static void backends_and_instruction_sets_match_the_reference(void **state) {
    (void)state;
    struct test_target target;
    struct test_image wanted[ROWS];
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 1, NULL))
            continue;
        for (int i = 0; i < ROWS; i++) {
            struct test_scene scene = { 0 };
            struct test_image got;
            rows[i].make(&scene);
            assert_true(test_render_scene(&renderer, &scene, t ? &got : &wanted[i], NULL));
            test_scene_finish(&scene);
            if (!t)
                continue;
            double psnr = test_image_psnr(&got, &wanted[i]);
            printf("%-14s %-11s %-8s %6.2f dB\n", rows[i].name, target.backend, target.isa, psnr);
            assert_compare(psnr, >=, 70);
            test_image_finish(&got);
        }
        test_renderer_close(&renderer);
    }
    for (int i = 0; i < ROWS; i++)
        test_image_finish(&wanted[i]);
}

static void threads_do_not_change_a_bit(void **state) {
    (void)state;
    struct test_image first, other;
    for (unsigned threads = 1; threads <= 3; threads++) {
        struct test_renderer renderer;
        struct test_scene scene = { 0 };
        two(&scene);
        open_renderer(&renderer, "auto", threads);
        assert_true(test_render_scene(&renderer, &scene, threads == 1 ? &first : &other, NULL));
        if (threads > 1) {
            size_t bytes = (size_t)first.width * first.height * 4 * sizeof *first.rgba;
            assert_memory_equal(first.rgba, other.rgba, bytes);
            test_image_finish(&other);
        }
        test_renderer_close(&renderer);
        test_scene_finish(&scene);
    }
    test_image_finish(&first);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(images_match_rays),
                                        cmocka_unit_test(
                                            backends_and_instruction_sets_match_the_reference),
                                        cmocka_unit_test(threads_do_not_change_a_bit) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
