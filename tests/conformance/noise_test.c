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
    double rms[2];    /* with fine gradients at least, by default at most */
};

static const struct row rows[] = {
    { "8 bits", SP_UINT8, 0, { 0.0060, 0.0061 } },
    { "8 bits, noise 2", SP_UINT8, 2, { 0.0140, 0.0086 } },
    { "16 bits, noise 6", SP_UINT16, 6, { 0.0370, 0.0183 } },
    { "real numbers, noise 6", SP_FLOAT32, 6, { 0.0370, 0.0183 } },
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

static bool draw(struct test_renderer *renderer, const struct row *row, double smoothing,
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

int main(void) {
    enum { ROWS = sizeof rows / sizeof rows[0] };
    struct test_target target;
    struct sp_error err = { .text = "out of memory" };
    unsigned failed = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    printf("rms difference from Lambert's law: fine gradients, default\n");
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 1, &err)) {
            printf("skipped: %s %s: %s\n", target.backend, target.isa, err.text);
            continue;
        }
        for (int i = 0; i < ROWS; i++) {
            double rms[2];
            for (int k = 0; k < 2; k++)
                if (!draw(&renderer, &rows[i], k ? NAN : 0, &rms[k], &err)) {
                    printf("%s: %s\n", rows[i].name, err.text);
                    return 1;
                }
            bool is_good = rms[0] >= rows[i].rms[0] && rms[1] <= rows[i].rms[1];
            printf("%s %s, %s: %.4f %.4f%s\n", target.backend, target.isa, rows[i].name, rms[0],
                   rms[1], is_good ? "" : " FAILED");
            failed += !is_good;
        }
        test_renderer_close(&renderer);
    }
    return failed ? 1 : 0;
}
