/* SPDX-License-Identifier: Apache-2.0
 *
 * Light of surfaces with a plateau behind them, as in scans that are clamped. A ramp rises across a
 * plane, within two samples, to a plateau of noise. Its first visible value is almost opaque, so
 * the visible surface has one normal, and the whole image one colour. Behind the surface the
 * gradient has other directions: an interval between two sheets is lit by the gradient where it is
 * seen (draw/resample/seen.h).
 */
#include <math.h>
#include <stdio.h>

#include "sp/log.h"
#include "support/render.h"

enum { SIDE = 32, PIXELS = 96, AROUND = 24 /* px that see the faces of the volume */ };

static const double visible = 80, rise = 110 /* per sample */, plateau[2] = { 215, 255 };

struct row {
    const char *name;
    double normal[3], azimuth, elevation;
    double most, rms; /* differences; half a decibel above the measured value */
};

static const struct row rows[] = {
    { "along the axis", { 0, 0, 1 }, 14, 10, 0.0034, 0.0009 },
    { "tilted", { 0.3, 0.2, 0.93 }, 20, -8, 0.0239, 0.0106 },
    { "steep", { -0.35, 0.5, 0.8 }, 5, 12, 0.0345, 0.0101 },
    { "diagonal", { 0.62, 0.35, 0.7 }, 30, 25, 0.0203, 0.0041 },
    { "from below", { 0.25, -0.4, 0.88 }, -12, -20, 0.0355, 0.0114 },
};

/* A number in [0, 1] that is different for each sample. */
static double noise(double x, double y, double z) {
    uint32_t h = (uint32_t)x * 73856093u ^ (uint32_t)y * 19349663u ^ (uint32_t)z * 83492791u;
    h = (h ^ h >> 13) * 0x5bd1e995u;
    return ((h ^ h >> 15) % 1024) / 1023.0;
}

/* The first visible value lies half a sample before the middle of the volume. `user`: the normal.
 */
static double ramp(const void *user, double x, double y, double z) {
    const double *normal = user, middle = (SIDE - 1) / 2.0;
    double outside =
        normal[0] * (x - middle) + normal[1] * (y - middle) + normal[2] * (z - middle) - 0.5;
    double top = plateau[1] - (plateau[1] - plateau[0]) * noise(x, y, z);
    return fmin(fmax(visible - rise * outside, 0), top);
}

static bool make(const struct row *row, struct test_scene *scene) {
    const double points[][5] = { { visible, 0.9, 0.8, 0.7, 0 },
                                 { visible + 26, 0.9, 0.8, 0.7, 0.95 } };
    const double unit[3] = { 1, 1, 1 };
    double normal[3], length = 0;
    for (int c = 0; c < 3; c++)
        length += row->normal[c] * row->normal[c];
    for (int c = 0; c < 3; c++)
        normal[c] = row->normal[c] / sqrt(length);
    test_view_init(&scene->view);
    scene->view.size[0] = scene->view.size[1] = PIXELS;
    test_scene_points(scene, points, 2);
    if (!test_scene_voxels(scene, "plateau", (uint32_t[]){ SIDE, SIDE, SIDE }, unit, SP_UINT8, ramp,
                           normal))
        return false;
    test_scene_orbit(scene, NULL, row->azimuth, row->elevation, 100);
    scene->view.camera.projection = SP_ORTHOGRAPHIC;
    scene->view.camera.height = SIDE;
    scene->view.filter.mode = SP_FILTER_ADAPTIVE;
    scene->view.compositing.mode = SP_COMPOSITE_SHEET;
    scene->view.transfer_function.order = SP_TF_POST;
    struct sp_shading *s = &scene->view.shading;
    s->mode = SP_SHADING_PHONG;
    s->smoothing = 0; /* so that the place alone decides */
    s->ambient = 0.1F;
    s->diffuse = 0.8F;
    s->specular = 0;
    s->light_count = 1;
    s->lights[0] = (struct sp_light){ { 0.6F, 0.5F, 0.62F }, SP_LIGHT_WORLD, { 1, 1, 1 } };
    return true;
}

/* The colour of the plane, by Lambert's law. */
static double wanted(const struct row *row, const struct test_scene *scene, int c) {
    const struct sp_shading *s = &scene->view.shading;
    double dot = 0, normal = 0, light = 0;
    for (int a = 0; a < 3; a++) {
        double l = (double)s->lights[0].direction[a];
        dot += row->normal[a] * l;
        normal += row->normal[a] * row->normal[a];
        light += l * l;
    }
    double color = (double)scene->view.transfer_function.points[0].color[c];
    return color * ((double)s->ambient + (double)s->diffuse * fabs(dot) / sqrt(normal * light));
}

/* Compares the middle of the image with the plane's colour. */
static bool check(const struct row *row, const struct test_scene *scene,
                  const struct test_image *image) {
    double most = 0, sum = 0;
    unsigned count = 0;
    for (unsigned y = AROUND; y < PIXELS - AROUND; y++)
        for (unsigned x = AROUND; x < PIXELS - AROUND; x++)
            for (int c = 0; c < 3; c++, count++) {
                double d = fabs(test_image_at(image, x, y)[c] - wanted(row, scene, c));
                most = fmax(most, d);
                sum += d * d;
            }
    double rms = sqrt(sum / count);
    printf(" %.4f %.5f", most, rms);
    return most <= row->most && rms <= row->rms;
}

static unsigned check_target(const struct test_target *target,
                             const struct test_renderer *renderer) {
    unsigned failed = 0;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct test_scene scene;
        struct test_image image;
        struct sp_error err = { .text = "out of memory" };
        printf("%s %s, %s:", target->backend, target->isa, rows[i].name);
        if (!make(&rows[i], &scene) || !test_render_scene(renderer, &scene, &image, &err)) {
            printf(" %s FAILED\n", err.text);
            return failed + 1;
        }
        bool is_good = check(&rows[i], &scene, &image);
        printf(is_good ? "\n" : " FAILED\n");
        failed += !is_good;
        test_image_finish(&image);
        test_scene_finish(&scene);
    }
    return failed;
}

int main(void) {
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    printf("largest and rms difference from the plane's colour\n");
    return test_check_targets(1, check_target) > 0;
}
