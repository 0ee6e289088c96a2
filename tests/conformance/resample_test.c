/* SPDX-License-Identifier: Apache-2.0
 *
 * Sheets that are classified after interpolation (resample/): every instruction set against the
 * integral by brute force, and against the scalar reference; the image does not depend on threads.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "sp/log.h"
#include "support/data.h"
#include "support/interpolated.h"
#include "support/render.h"
#include "support/sanitized.h"

struct row {
    const char *name;
    test_scene_fn *scene;
    double floor[2]; /* of sheets and of slabs; dB, half a decibel below what was measured */
};

static double block(const void *user, double x, double y, double z) {
    const double half = 6.2, *value = user;
    return fabs(x - 11.5) < half && fabs(y - 11.5) < half && fabs(z - 11.5) < half ? *value : 0;
}

/* A block of one value in another one, 24³. */
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

/* It undershoots the smallest one, which is visible, too. */
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

/* The rays at one side go against those at the other one, along the axis of the slices. */
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
    { "faint", faint, { 66.8, 69.5 } },
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
    { "lit shell", test_scene_lit_shell, { 64.1, 64.1 } },
    { "layers", test_scene_layers, { 34.0, 42.6 } },
    { "near shell", test_scene_near_shell, { 52.2, 51.8 } },
    { "rectilinear blobs", test_scene_rectilinear_blobs, { 69.1, 76.0 } },
    { "clip plane", test_scene_clip_plane, { 68.2, 74.8 } },
    { "clip box", test_scene_clip_box, { 68.4, 74.5 } },
    { "clip edge", test_scene_clip_edge, { 70.7, 79.6 } },
    { "clip corner", test_scene_clip_corner, { 69.6, 72.3 } },
    { "gradient axis", test_scene_gradient_axis, { 54.5, 56.9 } },
    { "post peak", test_scene_post_peak, { 59.8, 59.8 } },
    { "post lit", test_scene_post_lit, { 60.4, 60.4 } },
};

static bool check_row(const struct row *row, bool is_slab) {
    struct test_scene scene;
    struct test_image truth = { 0 }, scalar = { 0 };
    struct sp_error err = { 0 };
    bool is_good = true;
    if (!row->scene(&scene))
        return false;
    scene.view.compositing.mode = is_slab ? SP_COMPOSITE_SLAB : SP_COMPOSITE_SHEET;
    scene.view.filter.mode = SP_FILTER_ADAPTIVE; /* slabs are splatted if a filter is chosen */
    scene.view.compositing.attenuation = SP_ATTENUATION_EXPONENTIAL;
    scene.view.transfer_function.order = SP_TF_POST;
    scene.view.level_of_detail = SP_LOD_OFF;
    if (!TEST_SANITIZED && !test_interpolated(&scene, 24, &truth))
        return false;
    printf("%-18s %s", row->name, is_slab ? "slab " : "sheet");
    struct test_target target;
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer r;
        struct test_image image;
        if (!test_renderer_open(&r, &target, t % 2 + 1, &err)) {
            printf("  %s %s skipped (%s)", target.backend, target.isa, err.text);
            continue;
        }
        if (!test_render_scene(&r, &scene, &image, &err)) {
            printf("  %s: %s\n", target.isa, err.text);
            return false;
        }
        double psnr = TEST_SANITIZED ? INFINITY : test_image_psnr(&image, &truth);
        double same = t ? test_image_psnr(&image, &scalar) : INFINITY;
        printf("  %s %.1f (%.0f)", target.isa, psnr, same);
        if (!(psnr >= row->floor[is_slab]) || !(same >= 70)) {
            is_good = false;
            printf(" FAILED");
            test_image_dump(row->name, &image, TEST_SANITIZED ? &scalar : &truth, 8);
        }
        if (t == 0)
            scalar = image;
        else
            test_image_finish(&image);
        test_renderer_close(&r);
    }
    printf("\n");
    test_image_finish(&scalar);
    test_image_finish(&truth);
    test_scene_finish(&scene);
    return is_good;
}

int main(void) {
    unsigned failed = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    printf("PSNR [dB] to the integral, and in parentheses to the scalar reference\n");
    if (TEST_SANITIZED)
        printf("under a sanitizer the integral is left out\n");
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        for (int is_slab = 0; is_slab < 2; is_slab++)
            failed += !check_row(&rows[i], is_slab);
    if (failed)
        printf("%u scenes FAILED\n", failed);
    return failed > 0;
}
