/* SPDX-License-Identifier: Apache-2.0
 *
 * Light of a ball whose samples have noise: every backend and instruction set against Lambert's law
 * for the ball's surface. Normals follow smooth gradients as far as noise explains
 * (draw/resample/gradient.h), so the images have less noise than images from fine gradients.
 */
#include <math.h>
#include <stdio.h>

#include "sp/log.h"
#include "support/render.h"

enum { SIDE = 48, PIXELS = 128 };

static const double radius = 16, centre = (SIDE - 1) / 2.0, surface = 125;

struct row {
    const char *name;
    enum sp_type type;
    double deviation; /* of the noise; the ball has 200, its surroundings 50 */
    /* The rms difference: at least with smoothing 0; at most by default, and with smoothing 1. So
     * no row passes without smooth gradients. */
    double fine, automatic, smooth;
};

static const struct row rows[] = {
    { "8 bits", SP_UINT8, 0, 0.0061, 0.0060, 0.0059 },
    { "8 bits, noise 2", SP_UINT8, 2, 0.0140, 0.0086, 0.0069 },
    { "16 bits, noise 6", SP_UINT16, 6, 0.0370, 0.0183, 0.0113 },
    { "signed 16 bits, noise 6", SP_INT16, 6, 0.0370, 0.0183, 0.0113 },
    { "floats, noise 6", SP_FLOAT32, 6, 0.0370, 0.0183, 0.0113 },
    { "doubles, noise 6", SP_FLOAT64, 6, 0.0370, 0.0183, 0.0113 },
};

/* A number from [0, 1) for each sample and k. */
static double uniform(double x, double y, double z, uint32_t k) {
    uint32_t h = (uint32_t)x * 73856093u ^ (uint32_t)y * 19349663u ^ (uint32_t)z * 83492791u ^
                 k * 2654435761u;
    h = (h ^ h >> 13) * 0x5bd1e995u;
    h = (h ^ h >> 15) * 0x2c1b3c6du;
    return (h >> 8) / 16777216.0;
}

static double ball(const void *user, double x, double y, double z) {
    const struct row *row = user;
    double distance = sqrt(pow(x - centre, 2) + pow(y - centre, 2) + pow(z - centre, 2)), sum = -6;
    for (uint32_t k = 0; k < 12; k++)
        sum += uniform(x, y, z, k);
    return surface - 75 * tanh((distance - radius) / 1.5) + row->deviation * sum;
}

static bool make(const struct row *row, double smoothing, struct test_scene *scene) {
    const double points[][5] = { { surface - 5, 0.9, 0.8, 0.7, 0 },
                                 { surface + 5, 0.9, 0.8, 0.7, 0.95 } };
    const double unit[3] = { 1, 1, 1 };
    test_view_init(&scene->view);
    scene->view.size[0] = scene->view.size[1] = PIXELS;
    test_scene_points(scene, points, 2);
    if (!test_scene_voxels(scene, "ball", (uint32_t[]){ SIDE, SIDE, SIDE }, unit, row->type, ball,
                           row))
        return false;
    test_scene_orbit(scene, NULL, 25, 18, 100);
    scene->view.camera.projection = SP_ORTHOGRAPHIC;
    scene->view.camera.height = 2 * radius;
    scene->view.compositing.mode = SP_COMPOSITE_SHEET;
    scene->view.transfer_function.order = SP_TF_POST;
    scene->view.shading = (struct sp_shading){
        .mode = SP_SHADING_PHONG,
        .ambient = 0.1,
        .diffuse = 0.8,
        .exponent = 24,
        .reach = 0.2,
        .smoothing = smoothing,
        .light_count = 1,
        .lights = { { { 0, 0, 1 }, SP_LIGHT_CAMERA, { 1, 1, 1 } } },
    };
    return true;
}

/* The rms difference from Lambert's law, where the surface is less than 50 degrees oblique. */
static double compare(const struct test_scene *scene, const struct test_image *image) {
    double sum = 0;
    unsigned count = 0;
    for (unsigned y = 0; y < PIXELS; y++)
        for (unsigned x = 0; x < PIXELS; x++) {
            const double scale = 2.0 / PIXELS; /* radii per pixel */
            double square = pow((x + 0.5) * scale - 1, 2) + pow((y + 0.5) * scale - 1, 2);
            if (square > 0.58)
                continue;
            for (int c = 0; c < 3; c++, count++) {
                double light = 0.1 + 0.8 * sqrt(1 - square);
                double color = (double)scene->view.transfer_function.points[0].color[c];
                sum += pow((double)test_image_at(image, x, y)[c] - color * light, 2);
            }
        }
    return sqrt(sum / count);
}

static bool draw(const struct test_renderer *renderer, const struct row *row, double smoothing,
                 double *rms, struct sp_error *err) {
    struct test_scene scene;
    struct test_image image;
    if (!make(row, smoothing, &scene) || !test_render_scene(renderer, &scene, &image, err))
        return false;
    *rms = compare(&scene, &image);
    test_image_finish(&image);
    test_scene_finish(&scene);
    return true;
}

static unsigned check_target(const struct test_target *target,
                             const struct test_renderer *renderer) {
    static const double smoothing[] = { 0, NAN, 1 };
    unsigned failed = 0;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const struct row *row = &rows[i];
        struct sp_error err = { .text = "out of memory" };
        double rms[3];
        printf("%s %s, %s:", target->backend, target->isa, row->name);
        for (int k = 0; k < 3; k++) {
            if (!draw(renderer, row, smoothing[k], &rms[k], &err)) {
                printf(" %s FAILED\n", err.text);
                return failed + 1;
            }
            printf(" %.4f", rms[k]);
        }
        bool is_good = rms[0] >= row->fine && rms[1] <= row->automatic && rms[2] <= row->smooth;
        printf(is_good ? "\n" : " FAILED\n");
        failed += !is_good;
    }
    return failed;
}

int main(void) {
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    printf("rms difference from Lambert's law: smoothing 0, automatic, 1\n");
    return test_check_targets(1, check_target) > 0;
}
