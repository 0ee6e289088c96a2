/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdint.h>

#include "support/scene.h"

static const double unit[3] = { 1, 1, 1 };

static double constant(const void *user, double x, double y, double z) {
    (void)x, (void)y, (void)z;
    return *(const double *)user;
}

bool test_scene_constant_cube(struct test_scene *scene) {
    const double value = 200;
    test_view_init(&scene->view);
    test_scene_points(
        scene, (const double[][5]){ { 0, 0.9, 0.6, 0.3, 0 }, { 250, 0.9, 0.6, 0.3, 0.06 } }, 2);
    if (!test_scene_voxels(scene, "constant-cube", (uint32_t[]){ 24, 24, 24 }, unit, SP_UINT8,
                           constant, &value))
        return false;
    test_scene_orbit(scene, NULL, 35, 25, 80);
    return true;
}

/* Distance from the middle of a 40³ grid. */
static double radius40(double x, double y, double z) {
    return sqrt((x - 19.5) * (x - 19.5) + (y - 19.5) * (y - 19.5) + (z - 19.5) * (z - 19.5));
}

/* Shells of radius 7, 12 and 17 voxels, each about 1.5 voxels thick; values 100, 200, 300. */
static double shells(const void *user, double x, double y, double z) {
    (void)user;
    double r = radius40(x, y, z), value = 0;
    for (int i = 0; i < 3; i++) {
        double d = (r - (7 + 5 * i)) / 0.9;
        if (fabs(d) < 2.5)
            value = 100 * (i + 1) - 50 * (1 - exp(-0.5 * d * d));
    }
    return value;
}

bool test_scene_thin_shells(struct test_scene *scene) {
    static const double points[][5] = {
        { 60, 1, 0.3, 0.1, 0 },  { 100, 1, 0.3, 0.1, 0.35 }, { 140, 1, 0.3, 0.1, 0 },
        { 160, 0.2, 1, 0.2, 0 }, { 200, 0.2, 1, 0.2, 0.15 }, { 240, 0.2, 1, 0.2, 0 },
        { 260, 0.2, 0.4, 1, 0 }, { 300, 0.2, 0.4, 1, 0.1 },
    };
    test_view_init(&scene->view);
    test_scene_points(scene, points, 8);
    if (!test_scene_voxels(scene, "thin-shells", (uint32_t[]){ 40, 40, 40 }, unit, SP_INT16, shells,
                           NULL))
        return false;
    test_scene_orbit(scene, NULL, 20, 15, 82);
    return true;
}

/* Slightly bent layers across the third axis, on a disc. */
static double layers(const void *user, double x, double y, double z) {
    (void)user;
    double r = hypot(x - 19.5, y - 19.5), bend = z + 0.02 * (x - 19.5) * (y - 19.5) / 4;
    return r < 17 ? 0.5 + 0.5 * cos(2 * M_PI * bend / 4) : 0;
}

bool test_scene_anisotropic(struct test_scene *scene) {
    static const double points[][5] = {
        { 0.1, 0.1, 0.3, 0.9, 0 },
        { 0.5, 0.1, 0.9, 0.4, 0.03 },
        { 1.0, 1.0, 0.7, 0.2, 0.15 },
    };
    test_view_init(&scene->view);
    test_scene_points(scene, points, 3);
    if (!test_scene_voxels(scene, "anisotropic", (uint32_t[]){ 40, 40, 12 }, (double[]){ 1, 1, 4 },
                           SP_FLOAT32, layers, NULL))
        return false;
    test_scene_orbit(scene, NULL, 55, 20, 110);
    return true;
}

static double checks(const void *user, double x, double y, double z) {
    (void)user, (void)z;
    return (((int)x >> 2) + ((int)y >> 2)) & 1 ? 220 : 40;
}

bool test_scene_checkerboard(struct test_scene *scene) {
    test_view_init(&scene->view);
    test_scene_points(
        scene, (const double[][5]){ { 40, 0.1, 0.2, 0.9, 0.05 }, { 220, 1, 0.9, 0.2, 0.3 } }, 2);
    if (!test_scene_voxels(scene, "checkerboard", (uint32_t[]){ 96, 96, 3 }, unit, SP_UINT8, checks,
                           NULL))
        return false;
    test_scene_orbit(scene, NULL, 20, 50, 230);
    return true;
}

/* Six ellipsoids of a head phantom in a 48³ grid, with edges that are one voxel wide. */
static double head(const void *user, double x, double y, double z) {
    (void)user;
    static const double parts[][7] = {
        /* middle, half axes (fractions of 24), value that is added inside */
        { 0, 0, 0, 0.69, 0.92, 0.81, 2000 },       { 0, -0.0184, 0, 0.6624, 0.874, 0.78, -1400 },
        { 0.22, 0, 0, 0.11, 0.31, 0.22, -300 },    { -0.22, 0, 0, 0.16, 0.41, 0.28, -300 },
        { 0, 0.35, -0.15, 0.21, 0.25, 0.41, 300 }, { 0, -0.3, 0.2, 0.1, 0.12, 0.1, 500 },
    };
    double value = 0;
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        const double *p = parts[i];
        double a = ((x - 23.5) / 24 - p[0]) / p[3], b = ((y - 23.5) / 24 - p[1]) / p[4],
               c = ((z - 23.5) / 24 - p[2]) / p[5];
        double outside = (sqrt(a * a + b * b + c * c) - 1) * 24 * fmin(p[3], fmin(p[4], p[5]));
        value += p[6] * fmin(fmax(0.5 - outside, 0), 1);
    }
    return value;
}

bool test_scene_phantom(struct test_scene *scene) {
    static const double points[][5] = {
        { 100, 0.2, 0.2, 0.3, 0 },     { 350, 0.3, 0.5, 0.9, 0.02 }, { 650, 0.9, 0.5, 0.4, 0.015 },
        { 900, 0.95, 0.9, 0.3, 0.12 }, { 1500, 1, 1, 1, 0.1 },       { 2000, 1, 1, 1, 0.15 },
    };
    test_view_init(&scene->view);
    test_scene_points(scene, points, 6);
    if (!test_scene_voxels(scene, "phantom", (uint32_t[]){ 48, 48, 48 }, unit, SP_UINT16, head,
                           NULL))
        return false;
    scene->view.camera.fov_y = 12;
    test_scene_orbit(scene, (double[]){ 3, -4, 0 }, 150, 10, 60);
    return true;
}

static double one_shell(const void *user, double x, double y, double z) {
    (void)user;
    double d = (radius40(x, y, z) - 15) / 1.2;
    return exp(-0.5 * d * d) * (0.75 + 0.25 * sin(0.9 * x) * cos(0.8 * y + 0.3 * z));
}

bool test_scene_oblique(struct test_scene *scene) {
    static const double points[][5] = {
        { 0.2, 0.1, 0.2, 0.8, 0 },
        { 0.6, 0.2, 0.8, 0.5, 0.15 },
        { 1.0, 1.0, 0.6, 0.2, 0.5 },
    };
    test_view_init(&scene->view);
    test_scene_points(scene, points, 3);
    if (!test_scene_voxels(scene, "oblique", (uint32_t[]){ 40, 40, 40 }, unit, SP_FLOAT64,
                           one_shell, NULL))
        return false;
    test_scene_orbit(scene, (double[]){ 6, 3, 0 }, 40, 30, 30);
    scene->view.camera.fov_y = 50;
    return true;
}

static double blobs(const void *user, double x, double y, double z) {
    static const double at[][5] = {
        /* middle, radius, height */
        { 14, 14, 15, 5, 90 },  { 26, 16, 22, 6, 120 },   { 19, 27, 14, 4, 100 },
        { 23, 24, 28, 5, -80 }, { 12, 24, 27, 3.5, 110 },
    };
    (void)user;
    double value = 0;
    for (size_t i = 0; i < sizeof at / sizeof *at; i++) {
        double r2 = pow(x - at[i][0], 2) + pow(y - at[i][1], 2) + pow(z - at[i][2], 2);
        value += at[i][4] * exp(-0.5 * r2 / (at[i][3] * at[i][3]));
    }
    return value;
}

static const double blob_points[][5] = {
    { 10, 0.1, 0.2, 0.8, 0 },
    { 50, 0.2, 0.7, 0.9, 0.03 },
    { 90, 1.0, 0.5, 0.1, 0.12 },
    { 120, 1.0, 0.9, 0.6, 0.3 },
};

static bool blob_scene(struct test_scene *scene, const char *name, const double spacing[3],
                       enum sp_type type) {
    test_view_init(&scene->view);
    test_scene_points(scene, blob_points, 4);
    return test_scene_voxels(scene, name, (uint32_t[]){ 40, 40, 40 }, spacing, type, blobs, NULL);
}

bool test_scene_blobs(struct test_scene *scene) {
    if (!blob_scene(scene, "blobs", unit, SP_FLOAT32))
        return false;
    test_scene_orbit(scene, NULL, -30, 20, 66);
    return true;
}

bool test_scene_orthographic(struct test_scene *scene) {
    if (!blob_scene(scene, "orthographic", unit, SP_INT32))
        return false;
    test_scene_orbit(scene, NULL, 115, -25, 90);
    scene->view.camera.projection = SP_ORTHOGRAPHIC;
    scene->view.camera.height = 34;
    return true;
}

static bool turned(struct test_scene *scene, const char *name, double mirror, double shear) {
    if (!blob_scene(scene, name, (double[]){ 1, 1.5, 2 }, SP_FLOAT32))
        return false;
    test_scene_direction(scene, (double[]){ 25, -40, 70 }, mirror, shear);
    test_scene_orbit(scene, NULL, 10, 15, 105);
    return true;
}

bool test_scene_rotated(struct test_scene *scene) {
    return turned(scene, "rotated", 1, 0);
}

bool test_scene_left_handed(struct test_scene *scene) {
    return turned(scene, "left-handed", -1, 0);
}

bool test_scene_sheared(struct test_scene *scene) {
    return turned(scene, "sheared", 1, 0.45);
}

bool test_scene_inside(struct test_scene *scene) {
    static const double points[][5] = {
        { 0.2, 0.1, 0.2, 0.8, 0 },
        { 0.6, 0.2, 0.8, 0.5, 0.1 },
        { 1.0, 1.0, 0.6, 0.2, 0.25 },
    };
    test_view_init(&scene->view);
    test_scene_points(scene, points, 3);
    if (!test_scene_voxels(scene, "inside", (uint32_t[]){ 40, 40, 40 }, unit, SP_FLOAT32, one_shell,
                           NULL))
        return false;
    test_scene_orbit(scene, (double[]){ 14, 2, 3 }, 230, 5, 18);
    scene->view.camera.fov_y = 70;
    scene->view.camera.near = 1;
    return true;
}

bool test_scene_wide_kernel(struct test_scene *scene) {
    if (!blob_scene(scene, "wide-kernel", unit, SP_INT8))
        return false;
    test_scene_orbit(scene, NULL, 70, 40, 64);
    scene->view.filter.sigma = 1;
    scene->view.filter.cutoff = 4;
    scene->view.size[0] = 80;
    scene->view.size[1] = 56;
    static const float background[4] = { 0.2F, 0.5F, 0.3F, 0.8F };
    for (int c = 0; c < 4; c++)
        scene->view.background[c] = background[c];
    return true;
}

bool test_scene_lit_shell(struct test_scene *scene) {
    if (!blob_scene(scene, "lit-shell", (double[]){ 1, 1.2, 1.5 }, SP_FLOAT32))
        return false;
    test_scene_points(
        scene, (const double[][5]){ { 40, 0.8, 0.7, 0.6, 0 }, { 70, 0.8, 0.7, 0.6, 0.4 } }, 2);
    test_scene_direction(scene, (double[]){ 10, 20, 30 }, 1, 0);
    test_scene_orbit(scene, NULL, -30, 20, 78);
    struct sp_shading *s = &scene->view.shading;
    s->mode = SP_SHADING_PHONG;
    s->ambient = 0.15;
    s->diffuse = 0.6;
    s->specular = 0.35;
    s->exponent = 16;
    s->light_count = 2;
    s->lights[0] = (struct sp_light){ { 0.5, 0.7, 0.6 }, SP_LIGHT_CAMERA, { 1, 0.9, 0.8 } };
    s->lights[1] = (struct sp_light){ { -1, 0.1, 0.2 }, SP_LIGHT_WORLD, { 0.1F, 0.2F, 0.5F } };
    return true;
}
