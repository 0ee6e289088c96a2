/* SPDX-License-Identifier: Apache-2.0
 *
 * Scenes that each test one setting of the view: clipping, rectilinear grids, the gradient axis,
 * post-classification, the cubic kernel. Others are hard to composite.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>

#include "support/scene.h"

static const double unit[3] = { 1, 1, 1 };

/* Wavy layers across the third axis, three samples apart, in a ball. */
static double waved_layers(const void *user, double x, double y, double z) {
    (void)user;
    double r2 = pow(x - 19.5, 2) + pow(y - 19.5, 2) + pow(3 * (z - 7.5), 2);
    double wave = z + 0.4 * sin(0.35 * x) * cos(0.3 * y);
    return r2 < 20 * 20 ? 0.5 + 0.5 * cos(2 * M_PI * wave / 3) : 0;
}

bool test_scene_layers(struct test_scene *scene) {
    static const double points[][5] = {
        { 0.2, 0.2, 0.4, 0.9, 0 },
        { 0.6, 0.3, 0.9, 0.5, 0.055 },
        { 1.0, 1.0, 0.6, 0.2, 0.2 },
    };
    test_view_init(&scene->view);
    test_scene_points(scene, points, 3);
    if (!test_scene_voxels(scene, "layers", (uint32_t[]){ 40, 40, 16 }, (double[]){ 1, 1, 3 },
                           SP_FLOAT32, waved_layers, NULL))
        return false;
    test_scene_orbit(scene, NULL, 45, 35, 88);
    return true;
}

static double ball_shell(const void *user, double x, double y, double z) {
    (void)user;
    double r = sqrt(pow(x - 19.5, 2) + pow(y - 19.5, 2) + pow(z - 19.5, 2)), d = (r - 15) / 1.2;
    return 100 * exp(-0.5 * d * d) * (0.8 + 0.2 * sin(0.7 * x) * cos(0.6 * y - 0.4 * z));
}

bool test_scene_near_shell(struct test_scene *scene) {
    static const double points[][5] = {
        { 20, 0.1, 0.2, 0.8, 0 },
        { 60, 0.2, 0.8, 0.5, 0.1 },
        { 100, 1.0, 0.6, 0.2, 0.4 },
    };
    test_view_init(&scene->view);
    test_scene_points(scene, points, 3);
    if (!test_scene_voxels(scene, "near-shell", (uint32_t[]){ 40, 40, 40 }, unit, SP_FLOAT32,
                           ball_shell, NULL))
        return false;
    test_scene_orbit(scene, NULL, 25, 35, 30);
    scene->view.camera.fov_y = 50;
    return true;
}

/* Blobs in world units around the middle: middle, radius, height. */
static double world_blobs(const void *user, double x, double y, double z) {
    static const double at[][5] = {
        { -6, -5, -4, 5, 90 }, { 7, -3, 3, 6, 120 },   { 0, 8, -6, 4, 100 },
        { 4, 4, 9, 5, -80 },   { -8, 5, 7, 3.5, 110 },
    };
    (void)user;
    double value = 0;
    for (size_t i = 0; i < sizeof at / sizeof *at; i++) {
        double r2 = pow(x - at[i][0], 2) + pow(y - at[i][1], 2) + pow(z - at[i][2], 2);
        value += at[i][4] * exp(-0.5 * r2 / (at[i][3] * at[i][3]));
    }
    return value;
}

/* Sets the distances of n samples. The last gap is `growth` times the first; `length` is the sum of
 * the gaps. */
static void grade(double *coordinates, unsigned n, double length, double growth) {
    coordinates[0] = 0;
    for (unsigned i = 1; i < n; i++)
        coordinates[i] = coordinates[i - 1] + pow(growth, (i - 1.0) / (n - 2.0));
    for (unsigned i = 1; i < n; i++)
        coordinates[i] *= length / coordinates[n - 1];
    coordinates[n - 1] = length;
}

bool test_scene_rectilinear_blobs(struct test_scene *scene) {
    static const double points[][5] = {
        { 10, 0.1, 0.2, 0.8, 0 },
        { 50, 0.2, 0.7, 0.9, 0.03 },
        { 90, 1.0, 0.5, 0.1, 0.12 },
        { 120, 1.0, 0.9, 0.6, 0.3 },
    };
    double x[40], z[36];
    grade(x, 40, 39, 3);
    grade(z, 36, 39, 0.4);
    test_view_init(&scene->view);
    test_scene_points(scene, points, 4);
    if (!test_scene_rectilinear(scene, "rectilinear", (uint32_t[]){ 40, 40, 36 },
                                (const double *[]){ x, NULL, z }, SP_FLOAT32, world_blobs, NULL))
        return false;
    test_scene_direction(scene, (double[]){ 15, 25, -20 }, 1, 0);
    test_scene_orbit(scene, NULL, -30, 20, 70);
    return true;
}

static bool named(struct test_scene *scene, test_scene_fn *build, const char *name) {
    bool ok = build(scene);
    snprintf(scene->info.name, sizeof scene->info.name, "%s", name);
    return ok;
}

bool test_scene_clip_plane(struct test_scene *scene) {
    if (!named(scene, test_scene_blobs, "clip-plane"))
        return false;
    test_scene_cut(scene, (double[]){ 1.2, -0.9, -1.6 }, (double[]){ 0, 1, 2 });
    return true;
}

bool test_scene_clip_box(struct test_scene *scene) {
    if (!named(scene, test_scene_blobs, "clip-box"))
        return false;
    const double box[2][3] = { { 0.28, 0, 0.2 }, { 1, 0.72, 0.66 } };
    for (int side = 0; side < 2; side++)
        for (int a = 0; a < 3; a++)
            scene->view.clip.box[side][a] = box[side][a];
    return true;
}

bool test_scene_clip_edge(struct test_scene *scene) {
    if (!named(scene, test_scene_blobs, "clip-edge"))
        return false;
    /* Across the line of sight, leaning in the image. */
    const double *eye = scene->view.camera.position;
    double right[3] = { eye[2], 0, -eye[0] }, normal[3];
    double length = hypot(eye[0], eye[2]);
    for (int a = 0; a < 3; a++)
        normal[a] = right[a] / length;
    normal[1] += 0.6;
    double along = 0, far = 0;
    for (int a = 0; a < 3; a++) {
        along += normal[a] * eye[a];
        far += eye[a] * eye[a];
    }
    for (int a = 0; a < 3; a++)
        normal[a] -= along / far * eye[a];
    test_scene_cut(scene, normal, eye);
    return true;
}

bool test_scene_clip_corner(struct test_scene *scene) {
    if (!named(scene, test_scene_blobs, "clip-corner"))
        return false;
    /* The apex of the corner points to the camera. */
    const double apex[3] = { -3, 2, 4 };
    test_scene_cut(scene, (double[]){ 0.9, 0.3, -0.7 }, apex);
    test_scene_cut(scene, (double[]){ -0.1, -1, -0.6 }, apex);
    test_scene_cut(scene, (double[]){ 0.1, 0.8, -0.9 }, apex);
    return true;
}

/* Two materials with a soft wall between them, on a gentle slope of values. */
static double walls(const void *user, double x, double y, double z) {
    (void)user;
    double r = sqrt(pow(x - 15.5, 2) + pow(y - 13.5, 2) + pow(1.4 * (z - 12), 2));
    double inner = sqrt(pow(x - 18, 2) + pow(y - 15, 2) + pow(1.4 * (z - 13), 2));
    double slope = 14 * x / 31;
    return 30 + slope + 60 / (1 + exp(1.6 * (r - 12))) + 70 / (1 + exp(1.2 * (inner - 5)));
}

bool test_scene_gradient_axis(struct test_scene *scene) {
    static const double points[][5] = {
        { 40, 0.2, 0.3, 0.9, 0.1 },
        { 80, 0.3, 0.9, 0.4, 0.15 },
        { 160, 1.0, 0.6, 0.2, 0.25 },
    };
    test_view_init(&scene->view);
    test_scene_points(scene, points, 3);
    struct sp_transfer_function *tf = &scene->view.transfer_function;
    tf->gradient_count = 3;
    tf->gradient[0] = (struct sp_gradient_point){ 3, 0 };
    tf->gradient[1] = (struct sp_gradient_point){ 12, 0.6F };
    tf->gradient[2] = (struct sp_gradient_point){ 30, 1 };
    if (!test_scene_voxels(scene, "gradient-axis", (uint32_t[]){ 32, 28, 25 },
                           (double[]){ 1, 1, 1.4 }, SP_UINT8, walls, NULL))
        return false;
    test_scene_direction(scene, (double[]){ -20, 30, 10 }, 1, 0);
    test_scene_orbit(scene, NULL, 50, 25, 78);
    return true;
}

/* Bands of opacity as narrow as the difference between neighbouring samples. A sample falls into a
 * band only by chance, so only post-classification shows closed surfaces. */
static const double peak_points[][5] = {
    { 30, 0.2, 0.5, 1.0, 0 }, { 36, 0.2, 0.5, 1.0, 0.25 }, { 42, 0.2, 0.5, 1.0, 0 },
    { 70, 1.0, 0.5, 0.1, 0 }, { 76, 1.0, 0.5, 0.1, 0.5 },  { 82, 1.0, 0.5, 0.1, 0 },
};

static double tight_blobs(const void *user, double x, double y, double z) {
    static const double at[][5] = { { 9, 10, 12, 4.2, 100 },
                                    { 19, 13, 14, 4.5, 115 },
                                    { 13, 20, 11, 3.4, 95 } };
    (void)user;
    double value = 0;
    for (size_t i = 0; i < sizeof at / sizeof *at; i++) {
        double r2 = pow(x - at[i][0], 2) + pow(y - at[i][1], 2) + pow(z - at[i][2], 2);
        value += at[i][4] * exp(-0.5 * r2 / (at[i][3] * at[i][3]));
    }
    return value;
}

static bool peak_scene(struct test_scene *scene, const char *name) {
    test_view_init(&scene->view);
    test_scene_points(scene, peak_points, 6);
    scene->view.size[0] = scene->view.size[1] = 40;
    scene->view.transfer_function.order = SP_TF_POST;
    scene->view.compositing.mode = SP_COMPOSITE_SLAB;
    if (!test_scene_voxels(scene, name, (uint32_t[]){ 28, 28, 26 }, unit, SP_INT16, tight_blobs,
                           NULL))
        return false;
    test_scene_orbit(scene, NULL, 40, 30, 52);
    return true;
}

bool test_scene_post_peak(struct test_scene *scene) {
    return peak_scene(scene, "post-peak");
}

bool test_scene_post_lit(struct test_scene *scene) {
    if (!peak_scene(scene, "post-lit"))
        return false;
    struct sp_transfer_function *tf = &scene->view.transfer_function;
    tf->gradient_count = 2;
    tf->gradient[0] = (struct sp_gradient_point){ 2, 0.1F };
    tf->gradient[1] = (struct sp_gradient_point){ 14, 1 };
    struct sp_shading *s = &scene->view.shading;
    s->smoothing = 0; /* the integral by brute force has fine gradients */
    s->mode = SP_SHADING_PHONG;
    s->ambient = 0.2;
    s->diffuse = 0.6;
    s->specular = 0.3;
    s->exponent = 12;
    s->lights[0] = (struct sp_light){ { 0.4, 0.8, 0.5 }, SP_LIGHT_CAMERA, { 1, 0.95, 0.9 } };
    return true;
}

bool test_scene_cubic(struct test_scene *scene) {
    if (!named(scene, test_scene_thin_shells, "cubic"))
        return false;
    scene->view.filter.kernel = SP_KERNEL_CUBIC;
    return true;
}
