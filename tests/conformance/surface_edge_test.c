/* SPDX-License-Identifier: Apache-2.0
 *
 * Inner silhouettes: where one part of a surface ends in front of another. A single wrong pixel is
 * visible as a dot. So the worst pixel counts, against rays through the interpolant
 * (support/isosurface.h), on every backend and instruction set.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>

#include <cmocka.h>

#include "support/compare.h"
#include "support/isosurface.h"
#include "support/render.h"

static void make(struct test_scene *scene, const char *name, const uint32_t dims[3],
                 test_value_fn *value) {
    struct sp_view *view = &scene->view;
    test_view_init(view);
    view->shading.mode = SP_SHADING_PHONG;
    view->filter.mode = SP_FILTER_ADAPTIVE;
    view->size[0] = view->size[1] = 96;
    view->layer_count = 1;
    view->layers[0] = (struct sp_layer){ .type = SP_LAYER_SURFACE,
                                         .visible = true,
                                         .value = 128,
                                         .color = { 0.9f, 0.85f, 0.75f },
                                         .opacity = 1,
                                         .flatness = INFINITY };
    assert_true(
        test_scene_voxels(scene, name, dims, (double[]){ 1, 1, 1 }, SP_FLOAT32, value, NULL));
}

/* Returns the value at a distance to the surface; positive distances lie inside. */
static double value_of(double inside) {
    return 128 + 30 * fmax(-4, fmin(inside, 4));
}

static double away_from(double x, double y, double z, const double center[3]) {
    return hypot(hypot(x - center[0], y - center[1]), z - center[2]);
}

static double torus_value(const void *user, double x, double y, double z) {
    (void)user;
    return value_of(4.5 - hypot(hypot(x - 20.3, y - 20.1) - 12, z - 7.6));
}

static void torus(struct test_scene *scene) {
    make(scene, "torus", (uint32_t[]){ 41, 41, 16 }, torus_value);
    test_scene_orbit(scene, NULL, 75, 12, 90);
}

/* Half a ball that the volume's first slice cuts open, with cavities and a rough surface, over a
 * floor. From above the cut, the first sheets of many rays are seen from inside. */
static double bowl_value(const void *user, double x, double y, double z) {
    (void)user;
    static const double middle[3] = { 21.6, 22.2, 0 };
    static const double cavities[2][4] = { { 17, 17, 5, 3.4 }, { 26, 24, 4, 2.6 } };
    double rough = 0.35 * sin(2.1 * x) * sin(1.9 * y) * sin(2.3 * z);
    double ball = 14.4 - away_from(x, y, z, middle) + rough;
    for (int i = 0; i < 2; i++)
        ball = fmin(ball, away_from(x, y, z, cavities[i]) - cavities[i][3]);
    return value_of(fmax(ball, z - 17.2));
}

static void bowl(struct test_scene *scene) {
    make(scene, "bowl", (uint32_t[]){ 44, 45, 20 }, bowl_value);
    test_scene_orbit(scene, NULL, 220, 25, 100);
}

/* A wall of 2.5 cells before a flat cavity, whose edges must not be seen through it. */
static double wall_value(const void *user, double x, double y, double z) {
    (void)user;
    double ball = 16 - away_from(x, y, z, (double[]){ 19.4, 19.7, 19.1 });
    double across = hypot(x - 20, y - 19) - 6, lens = 1 - hypot(fmax(across, 0), z - 7.4);
    return value_of(fmin(ball, fmin(z - 4.2, -lens)));
}

static void wall(struct test_scene *scene) {
    make(scene, "wall", (uint32_t[]){ 40, 40, 38 }, wall_value);
    test_scene_orbit(scene, NULL, 190, 20, 100);
}

static void parallel_bowl(struct test_scene *scene) {
    bowl(scene);
    scene->view.camera.projection = SP_ORTHOGRAPHIC;
    scene->view.camera.height = 42;
}

static void small_bowl(struct test_scene *scene) {
    bowl(scene);
    scene->view.size[0] = scene->view.size[1] = 40;
}

struct row {
    const char *name;
    void (*make)(struct test_scene *scene);
    double most; /* of 1; a fifth above the measured value */
};

static const struct row rows[] = {
    { "torus", torus, 0.066 },
    { "bowl", bowl, 0.15 },
    { "parallel bowl", parallel_bowl, 0.18 },
    { "small bowl", small_bowl, 0.12 },
    { "wall", wall, 0.12 },
};
enum { ROWS = sizeof rows / sizeof rows[0] };

/* Returns the largest difference of a channel, clamped to 1 as on the screen, in the pixels that
 * the surface fills. */
static double worst_pixel(const struct test_image *got, const struct test_image *wanted) {
    double worst = 0;
    for (size_t i = 0; i < (size_t)wanted->width * wanted->height; i++)
        for (size_t c = 4 * i; c < 4 * i + 3 && wanted->rgba[4 * i + 3] > 0.999; c++)
            worst = fmax(worst, fabs(fmin(got->rgba[c], 1) - fmin(wanted->rgba[c], 1)));
    return worst;
}

static void make_truth(const struct test_scene *scene, struct test_image *wanted) {
    const double blur = 0.5; /* px; half of the view's low-pass filter, which is adaptive */
    struct test_isosurface iso;
    assert_true(test_isosurface_init(&iso, scene));
    assert_true(test_isosurface_render(&iso, 3, blur, wanted));
    test_isosurface_finish(&iso);
}

static void inner_silhouettes_have_no_dots(void **state) {
    (void)state;
    struct test_target target;
    struct test_scene scenes[ROWS] = { 0 };
    struct test_image wanted[ROWS];
    int failed = 0;
    for (int i = 0; i < ROWS; i++) {
        rows[i].make(&scenes[i]);
        make_truth(&scenes[i], &wanted[i]);
    }
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 2, NULL))
            continue;
        for (int i = 0; i < ROWS; i++) {
            struct test_image got;
            assert_true(test_render_scene(&renderer, &scenes[i], &got, NULL));
            const double worst = worst_pixel(&got, &wanted[i]);
            printf("%-14s %-11s %-8s worst pixel %.3f\n", rows[i].name, target.backend, target.isa,
                   worst);
            if (worst > rows[i].most)
                test_image_dump(rows[i].name, &got, &wanted[i], 4);
            failed += worst > rows[i].most;
            test_image_finish(&got);
        }
        test_renderer_close(&renderer);
    }
    for (int i = 0; i < ROWS; i++) {
        test_image_finish(&wanted[i]);
        test_scene_finish(&scenes[i]);
    }
    assert_int_equal(failed, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(inner_silhouettes_have_no_dots) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
