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

static const double least_db = 35, least_step_db = 55;

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

/* The scenes and what rays see of them. */
static const double heights[] = { 8, 4, 2.5, 2, 1, 0.5 }, turns[] = { 100, 220 };
enum {
    HEIGHTS = sizeof heights / sizeof *heights,
    TURNS = sizeof turns / sizeof *turns,
    CASES = HEIGHTS + TURNS
};
static struct close_case {
    char name[64];
    struct test_scene scene;
    struct test_image wanted;
} cases[CASES];

static int open_cases(void **state) {
    (void)state;
    for (int i = 0; i < CASES; i++) {
        struct close_case *c = &cases[i];
        struct test_isosurface iso;
        if (i < HEIGHTS) {
            snprintf(c->name, sizeof c->name, "%g above a ball", heights[i]);
            make_ball(&c->scene, heights[i]);
        } else {
            snprintf(c->name, sizeof c->name, "inside a gyroid, %g degrees", turns[i - HEIGHTS]);
            make_gyroid(&c->scene, turns[i - HEIGHTS]);
        }
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
        printf("%s %s, %s: %.1f dB, covered %.4f of %.4f\n", target->backend, target->isa, c->name,
               db, mean_alpha(&got), mean_alpha(&c->wanted));
        if (db < least_db)
            test_image_dump(c->name, &got, &c->wanted, 4);
        failures += db < least_db;
        test_image_finish(&got);
    }
    return failures;
}

static void surfaces_near_the_eye_are_exact(void **state) {
    (void)state;
    assert_int_equal(test_check_targets(2, compare_all), 0);
}

/* Cells are split where the eye comes near. That changes the image no more than a step of the eye
 * by a ten-thousandth of its height. All targets split the same cells. */
static void nothing_jumps_where_discs_get_smaller(void **state) {
    struct test_renderer renderer;
    double worst = INFINITY, where = 0;
    (void)state;
    assert_true(test_renderer_open(&renderer, &(struct test_target){ "cpu", "auto" }, 2, NULL));
    for (double height = 0.5; height < 40; height *= 1.1) {
        struct test_image images[2];
        for (int i = 0; i < 2; i++) {
            struct test_scene scene = { 0 };
            make_ball(&scene, height * (1 + 0.0001 * i));
            assert_true(test_render_scene(&renderer, &scene, &images[i], NULL));
            test_scene_finish(&scene);
        }
        const double db = test_image_psnr(&images[0], &images[1]);
        where = db < worst ? height : where;
        worst = fmin(worst, db);
        for (int i = 0; i < 2; i++)
            test_image_finish(&images[i]);
    }
    printf("two images side by side differ by %.1f dB at most, %.3g above a ball\n", worst, where);
    assert_compare(worst, >, least_step_db);
    test_renderer_close(&renderer);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(surfaces_near_the_eye_are_exact),
        cmocka_unit_test(nothing_jumps_where_discs_get_smaller),
    };
    return cmocka_run_group_tests(tests, open_cases, close_cases);
}
