/* SPDX-License-Identifier: Apache-2.0
 *
 * Iso-surfaces close to the eye, against rays through the interpolated samples: the eye half a
 * voxel to eight voxels above a ball, looking along its surface, and inside a gyroid.
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
#include "support/sanitized.h"

static void surface_view(struct test_scene *scene) {
    struct sp_view *view = &scene->view;
    test_view_init(view);
    view->size[0] = view->size[1] = 56;
    view->filter.mode = SP_FILTER_ADAPTIVE;
    view->layer_count = 1;
    view->layers[0] = (struct sp_layer){ .type = SP_LAYER_SURFACE,
                                         .visible = true,
                                         .value = 128,
                                         .color = { 1, 0.9f, 0.8f },
                                         .opacity = 1,
                                         .flatness = INFINITY };
    view->shading.mode = SP_SHADING_PHONG;
    view->camera.fov_y = 60;
}

static void set_camera(struct sp_camera *camera, const double from[3], const double ahead[3],
                       const double up[3]) {
    for (int r = 0; r < 3; r++) {
        camera->position[r] = from[r];
        camera->target[r] = from[r] + ahead[r];
        camera->up[r] = up[r];
    }
}

enum { BALL = 52, RADIUS = 20 }; /* voxels */

static double ball(const void *user, double x, double y, double z) {
    const double middle = (BALL - 1) / 2.0;
    (void)user;
    x -= middle, y -= middle, z -= middle;
    return 128 + 5 * (RADIUS - sqrt(x * x + y * y + z * z));
}

/* The eye at a height above the surface [voxels], looking along it, 20 degrees down. */
static void make_ball(struct test_scene *scene, double height) {
    const double out[3] = { 0.48, 0.6, 0.64 };
    const double along[3] = { 0.8, 0, -0.6 }, tilt = 20 * M_PI / 180;
    double from[3], ahead[3];
    surface_view(scene);
    assert_true(test_scene_voxels(scene, "ball", (uint32_t[]){ BALL, BALL, BALL },
                                  (double[]){ 1, 1, 1 }, SP_FLOAT32, ball, NULL));
    for (int r = 0; r < 3; r++) {
        from[r] = (RADIUS + height) * out[r];
        ahead[r] = cos(tilt) * along[r] - sin(tilt) * out[r];
    }
    set_camera(&scene->view.camera, from, ahead, out);
}

static double gyroid(const void *user, double x, double y, double z) {
    const double k = 2 * M_PI / 20;
    (void)user;
    x *= k, y *= k, z *= k;
    return 128 + 60 * (sin(x) * cos(y) + sin(y) * cos(z) + sin(z) * cos(x));
}

/* The eye in a channel. */
static void make_gyroid(struct test_scene *scene, double turn) {
    const double angle = turn * M_PI / 180;
    surface_view(scene);
    assert_true(test_scene_voxels(scene, "gyroid", (uint32_t[]){ 96, 96, 96 },
                                  (double[]){ 1, 1, 1 }, SP_FLOAT32, gyroid, NULL));
    set_camera(&scene->view.camera, (double[]){ 3.5, 1.5, 0.5 },
               (double[]){ cos(angle), 0.3, sin(angle) }, (double[]){ 0, 1, 0 });
}

static double mean_alpha(const struct test_image *image) {
    double sum = 0;
    const size_t n = (size_t)image->width * image->height;
    for (size_t i = 0; i < n; i++)
        sum += image->rgba[4 * i + 3];
    return sum / (double)n;
}

/* The scenes, what rays see of them, and floors half a decibel below the measured values. */
static struct close_case {
    double height, turn; /* NaN = not this scene */
    double floor;        /* dB */
    struct test_scene scene;
    struct test_image wanted;
} cases[] = {
    { .height = 8, .turn = NAN, .floor = 44.4 },   { .height = 4, .turn = NAN, .floor = 44.8 },
    { .height = 2.5, .turn = NAN, .floor = 46.4 }, { .height = 2, .turn = NAN, .floor = 47.2 },
    { .height = 1, .turn = NAN, .floor = 46.3 },   { .height = 0.5, .turn = NAN, .floor = 45.7 },
    { .height = 0.3, .turn = NAN, .floor = 44.3 }, { .height = NAN, .turn = 100, .floor = 45.4 },
    { .height = NAN, .turn = 220, .floor = 36.5 },
};
enum { CASES = sizeof cases / sizeof *cases };

static int open_cases(void **state) {
    (void)state;
    for (int i = 0; i < CASES; i++) {
        struct close_case *c = &cases[i];
        struct test_isosurface iso;
        if (isnan(c->turn))
            make_ball(&c->scene, c->height);
        else
            make_gyroid(&c->scene, c->turn);
        if (!test_isosurface_init(&iso, &c->scene) ||
            !test_isosurface_render(&iso, 3, 0.5, &c->wanted))
            return -1;
        test_isosurface_finish(&iso);
    }
    return 0;
}

static int close_cases(void **state) {
    (void)state;
    for (int i = 0; i < CASES; i++) {
        test_scene_finish(&cases[i].scene);
        test_image_finish(&cases[i].wanted);
    }
    return 0;
}

static unsigned compare_all(const struct test_target *target,
                            const struct test_renderer *renderer) {
    unsigned failures = 0;
    for (int i = 0; i < CASES; i++) {
        const struct close_case *c = &cases[i];
        struct test_image got;
        assert_true(test_render_scene(renderer, &c->scene, &got, NULL));
        const double db = test_image_psnr(&got, &c->wanted);
        const char *name = c->scene.info.name;
        printf("%s %s, %s, height %g, turn %g: %.1f dB, covered %.4f of %.4f\n", target->backend,
               target->isa, name, c->height, c->turn, db, mean_alpha(&got), mean_alpha(&c->wanted));
        if (db < c->floor)
            test_image_dump(name, &got, &c->wanted, 4);
        failures += db < c->floor;
        test_image_finish(&got);
    }
    return failures;
}

static void surfaces_near_the_eye_are_exact(void **state) {
    (void)state;
    assert_int_equal(test_check_targets(2, compare_all), 0);
}

/* Cells are split while the eye comes near, which pixels hardly show. All targets split the same
 * cells. Every frame runs the same code: a sanitizer sees the first ones. */
enum { FRAMES = TEST_SANITIZED ? 10 : 100 };
static void nothing_jumps_where_discs_get_smaller(void **state) {
    static const struct {
        double from, step, bound;
    } ways[] = { { 5.5, 0.02, 0.06 }, { 1.1, 0.002, 0.06 } };
    struct test_renderer renderer;
    (void)state;
    assert_true(test_renderer_open(&renderer, &(struct test_target){ "cpu", "auto" }, 2, NULL));
    for (size_t w = 0; w < sizeof ways / sizeof *ways; w++) {
        struct test_image frames[3] = { { 0 } };
        double worst = 0, where = 0;
        for (int i = 0; i < FRAMES; i++) {
            const double height = ways[w].from - ways[w].step * i;
            struct test_scene scene = { 0 };
            test_image_finish(&frames[0]);
            frames[0] = frames[1];
            frames[1] = frames[2];
            make_ball(&scene, height);
            assert_true(test_render_scene(&renderer, &scene, &frames[2], NULL));
            test_scene_finish(&scene);
            const double bend = i < 2 ? 0 : test_image_bend(frames);
            where = bend > worst ? height : where;
            worst = fmax(worst, bend);
        }
        printf("from %g above a ball, in steps of %g: a pixel bends by %.4f at most, at %.3f\n",
               ways[w].from, ways[w].step, worst, where);
        assert_compare(worst, <, ways[w].bound);
        for (int i = 0; i < 3; i++)
            test_image_finish(&frames[i]);
    }
    test_renderer_close(&renderer);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(surfaces_near_the_eye_are_exact),
        cmocka_unit_test(nothing_jumps_where_discs_get_smaller),
    };
    return cmocka_run_group_tests(tests, open_cases, close_cases);
}
