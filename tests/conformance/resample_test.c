/* SPDX-License-Identifier: Apache-2.0
 *
 * Sheets that are classified after interpolation (draw/resample/): every instruction set against
 * the integral by brute force, and against the scalar reference; the image does not depend on
 * threads.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/log.h"
#include "support/data.h"
#include "support/interpolated.h"
#include "support/render.h"
#include "support/sanitized.h"

enum { TARGETS_MAX = 16 };

struct row {
    const char *name;
    test_scene_fn *scene;
    double floor[2]; /* of sheets and of slabs; dB, half a decibel below the measured value */
};

static double block(const void *user, double x, double y, double z) {
    const double half = 6.2, *value = user;
    return fabs(x - 11.5) < half && fabs(y - 11.5) < half && fabs(z - 11.5) < half ? *value : 0;
}

/* A volume of 24³ samples: a block of one value inside another value. */
static bool make_block(struct test_scene *scene, double value, const double (*points)[5],
                       unsigned count) {
    const double unit[3] = { 1, 1, 1 };
    test_view_init(&scene->view);
    test_scene_points(scene, points, count);
    if (!test_scene_voxels(scene, "block", (uint32_t[]){ 24, 24, 24 }, unit, SP_UINT8, block,
                           &value))
        return false;
    test_scene_orbit(scene, NULL, 35, 25, 80);
    return true;
}

/* Interpolation overshoots the largest value, which is visible. */
static bool saturated(struct test_scene *scene) {
    return make_block(scene, 255, (const double[][5]){ { 100, 1, 0, 0, 0 }, { 200, 1, 1, 1, 0.2 } },
                      2);
}

/* The smallest value is also visible; interpolation undershoots it. */
static bool all_visible(struct test_scene *scene) {
    return make_block(scene, 255,
                      (const double[][5]){ { 0, 0, 0, 1, 0.03 }, { 255, 1, 1, 1, 0.1 } }, 2);
}

/* Only the value of a point is visible. */
static bool inner_point(struct test_scene *scene) {
    static const double points[][5] = { { 0, 1, 0, 0, 0 },
                                        { 100, 0, 1, 0, 0.1 },
                                        { 200, 0, 0, 1, 0 } };
    return make_block(scene, 100, points, 3);
}

/* A few pixels, which see a wide angle. */
static bool small_image(struct test_scene *scene) {
    if (!saturated(scene))
        return false;
    scene->view.size[0] = scene->view.size[1] = 16;
    scene->view.camera.fov_y = 60;
    test_scene_orbit(scene, NULL, 10, 5, 24);
    return true;
}

/* Along the axis of the slices, rays at the left and at the right go in opposite directions. */
static bool wide_image(struct test_scene *scene) {
    if (!saturated(scene))
        return false;
    scene->view.size[0] = 256;
    scene->view.size[1] = 48;
    scene->view.camera.fov_y = 80;
    test_scene_orbit(scene, NULL, 42, 0, 9);
    return true;
}

static double far_off_ball(const void *user, double x, double y, double z) {
    (void)user;
    double square = (x - 11.5) * (x - 11.5) + (y - 11.5) * (y - 11.5) + (z - 11.5) * (z - 11.5);
    return 1e9 + 10 * exp(-square / 50);
}

/* Values that a float does not hold. */
static bool far_off(struct test_scene *scene) {
    const double unit[3] = { 1, 1, 1 };
    test_view_init(&scene->view);
    test_scene_points(scene,
                      (const double[][5]){ { 1e9 + 4, 1, 0, 0, 0 },
                                           { 1e9 + 5, 0, 1, 0, 0.2 },
                                           { 1e9 + 6, 0, 0, 1, 0 } },
                      3);
    if (!test_scene_voxels(scene, "far-off", (uint32_t[]){ 24, 24, 24 }, unit, SP_FLOAT64,
                           far_off_ball, NULL))
        return false;
    test_scene_orbit(scene, NULL, 35, 25, 80);
    return true;
}

/* A lit ball of values so small that squares of their gradients vanish in floats. */
static double faint_ball(const void *user, double x, double y, double z) {
    return (far_off_ball(user, x, y, z) - 1e9) * 1e-28;
}

static bool faint(struct test_scene *scene) {
    const double unit[3] = { 1, 1, 1 };
    test_view_init(&scene->view);
    test_scene_points(scene,
                      (const double[][5]){ { 4e-28, 1, 0, 0, 0 }, { 6e-28, 0.5, 1, 0.5, 0.4 } }, 2);
    if (!test_scene_voxels(scene, "faint", (uint32_t[]){ 24, 24, 24 }, unit, SP_FLOAT32, faint_ball,
                           NULL))
        return false;
    test_scene_orbit(scene, NULL, 35, 25, 80);
    scene->view.shading.mode = SP_SHADING_PHONG;
    return true;
}

static const struct row rows[] = {
    { "saturated", saturated, { 58.7, 58.7 } },
    { "all visible", all_visible, { 69.3, 69.3 } },
    { "inner point", inner_point, { 65.9, 65.9 } },
    { "small image", small_image, { 54.6, 57.0 } },
    { "wide image", wide_image, { 55.5, 63.8 } },
    { "far off", far_off, { 78.1, 78.1 } },
    { "faint", faint, { 69.0, 69.5 } },
    { "constant cube", test_scene_constant_cube, { 70.8, 70.8 } },
    { "thin shells", test_scene_thin_shells, { 33.6, 43.5 } },
    { "anisotropic", test_scene_anisotropic, { 51.1, 59.0 } },
    { "phantom", test_scene_phantom, { 38.7, 56.4 } },
    { "oblique", test_scene_oblique, { 40.9, 40.9 } },
    { "blobs", test_scene_blobs, { 68.1, 75.6 } },
    { "orthographic", test_scene_orthographic, { 69.6, 77.2 } },
    { "rotated", test_scene_rotated, { 76.2, 74.0 } },
    { "left-handed", test_scene_left_handed, { 75.6, 74.8 } },
    { "sheared", test_scene_sheared, { 74.6, 74.3 } },
    { "inside", test_scene_inside, { 41.8, 41.8 } },
    { "lit shell", test_scene_lit_shell, { 65.2, 65.2 } },
    { "layers", test_scene_layers, { 34.0, 42.6 } },
    { "near shell", test_scene_near_shell, { 52.2, 51.8 } },
    { "rectilinear blobs", test_scene_rectilinear_blobs, { 69.1, 76.0 } },
    { "clip plane", test_scene_clip_plane, { 68.2, 74.8 } },
    { "clip box", test_scene_clip_box, { 68.4, 74.5 } },
    { "clip edge", test_scene_clip_edge, { 70.7, 79.6 } },
    { "clip corner", test_scene_clip_corner, { 69.6, 72.3 } },
    { "gradient axis", test_scene_gradient_axis, { 56.0, 57.3 } },
    { "post peak", test_scene_post_peak, { 59.8, 59.8 } },
    { "post lit", test_scene_post_lit, { 60.7, 60.7 } },
};

/* All backends and instruction sets of this machine, the scalar reference first. */
struct run {
    struct test_target targets[TARGETS_MAX];
    struct test_renderer renderers[TARGETS_MAX];
    unsigned count;
};

static void open_all(struct run *run) {
    struct test_target target;
    struct sp_error err;
    for (unsigned t = 0; run->count < TARGETS_MAX && test_target_at(t, &target); t++) {
        if (test_renderer_open(&run->renderers[run->count], &target, t % 2 + 1, &err))
            run->targets[run->count++] = target;
        else
            printf("skipped: %s %s: %s\n", target.backend, target.isa, err.text);
    }
}

/* Draws sheets or slabs with every target, and compares the images with the integral `truth` (NULL
 * under a sanitizer) and with the scalar reference. */
static bool check_images(const struct run *run, const struct row *row,
                         const struct test_scene *scene, const struct test_image *truth) {
    struct test_image scalar = { 0 };
    bool is_slab = scene->view.compositing.mode == SP_COMPOSITE_SLAB, is_good = true;
    printf("%-18s %s", row->name, is_slab ? "slab " : "sheet");
    for (unsigned t = 0; t < run->count; t++) {
        const struct test_target *target = &run->targets[t];
        struct test_image image;
        struct sp_error err;
        if (!test_render_scene(&run->renderers[t], scene, &image, &err)) {
            printf("  %s: %s\n", target->isa, err.text);
            return false;
        }
        double psnr = truth ? test_image_psnr(&image, truth) : INFINITY;
        double same = t ? test_image_psnr(&image, &scalar) : INFINITY;
        printf("  %s %s %.1f (%.0f)", target->backend, target->isa, psnr, same);
        if (!(psnr >= row->floor[is_slab]) || !(same >= 70)) {
            is_good = false;
            printf(" FAILED");
            test_image_dump(row->name, &image, truth ? truth : &scalar, 8);
        }
        if (t == 0)
            scalar = image;
        else
            test_image_finish(&image);
    }
    printf("\n");
    test_image_finish(&scalar);
    return is_good;
}

/* Returns how many of sheets and slabs fail. The integral is the same for both. */
static unsigned check_row(const struct run *run, const struct row *row) {
    struct test_scene scene;
    struct test_image truth;
    unsigned failed = 0;
    if (!row->scene(&scene))
        return 1;
    scene.view.filter.mode = SP_FILTER_ADAPTIVE; /* slabs are splatted if a filter is chosen */
    scene.view.compositing.attenuation = SP_ATTENUATION_EXPONENTIAL;
    scene.view.transfer_function.order = SP_TF_POST;
    scene.view.level_of_detail = SP_LOD_OFF;
    if (!TEST_SANITIZED && !test_interpolated(&scene, 24, &truth))
        return 1;
    for (int is_slab = 0; is_slab < 2; is_slab++) {
        scene.view.compositing.mode = is_slab ? SP_COMPOSITE_SLAB : SP_COMPOSITE_SHEET;
        failed += !check_images(run, row, &scene, TEST_SANITIZED ? NULL : &truth);
    }
    if (!TEST_SANITIZED)
        test_image_finish(&truth);
    test_scene_finish(&scene);
    return failed;
}

int main(void) {
    struct run run = { .count = 0 };
    unsigned failed = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    open_all(&run);
    if (run.count == 0 || strcmp(run.targets[0].isa, "scalar") != 0) {
        printf("FAILED: the scalar reference does not start\n");
        return 1;
    }
    printf("PSNR [dB] to the integral, and in parentheses to the scalar reference\n");
    if (TEST_SANITIZED)
        printf("under a sanitizer the integral is left out\n");
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        failed += check_row(&run, &rows[i]);
    for (unsigned t = 0; t < run.count; t++)
        test_renderer_close(&run.renderers[t]);
    if (failed)
        printf("%u scenes FAILED\n", failed);
    return failed > 0;
}
