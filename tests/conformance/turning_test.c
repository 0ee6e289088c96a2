/* SPDX-License-Identifier: Apache-2.0
 *
 * A volume with fine details that turns by a tenth of a degree per frame, its samples as narrow as
 * pixels: every backend and instruction set against means of 16 rays per pixel. With one ray per
 * pixel, details alias and shimmer; the low-pass filter of pixels (frame/antialias.h) keeps most of
 * that away.
 */
#include <math.h>
#include <stdio.h>

#include "sp/log.h"
#include "support/render.h"

enum { SIDE = 64, PIXELS = 64, RAYS = 4, FRAMES = 2 };

struct row {
    const char *name;
    double px; /* width of a sample */
    bool is_lit;
    double change; /* rms from frame to frame: at most, in changes of the means */
    double floor;  /* PSNR to the means, dB */
};

static const struct row rows[] = {
    { "lit, 1 px", 1, true, 1.45, 35.5 },
    { "not lit, 1 px", 1, false, 1.55, 37.2 },
    { "lit, 1.8 px", 1.8, true, 1.2, 38.1 },
    { "not lit, 1.8 px", 1.8, false, 1.15, 57.6 },
};
enum { ROWS = sizeof rows / sizeof rows[0] };
static struct test_image means[ROWS][FRAMES];

/* A ball with dents, in a shell with holes. */
static double field(const void *user, double x, double y, double z) {
    (void)user;
    const double c = (SIDE - 1) / 2.0, p[3] = { x - c, y - c, z - c };
    const double r = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    const double waves = sin(0.9 * p[0]) * sin(0.8 * p[1]) * sin(0.7 * p[2]);
    const double ball = 20 + 2 * waves - r, shell = 1.6 - fabs(r - 27) - 2 * fabs(waves);
    return 128 + 100 * tanh(0.7 * fmax(ball, shell));
}

static bool make(const struct row *row, struct test_scene *scene) {
    const double points[][5] = { { 110, 0.9, 0.7, 0.5, 0 }, { 150, 0.9, 0.8, 0.7, 0.7 } };
    test_view_init(&scene->view);
    test_scene_points(scene, points, 2);
    if (!test_scene_voxels(scene, "dents", (uint32_t[]){ SIDE, SIDE, SIDE }, (double[]){ 1, 1, 1 },
                           SP_UINT8, field, NULL))
        return false;
    scene->view.background[3] = 1;
    scene->view.compositing.mode = SP_COMPOSITE_SHEET;
    scene->view.transfer_function.order = SP_TF_POST;
    scene->view.shading.mode = row->is_lit ? SP_SHADING_PHONG : SP_SHADING_NONE;
    return true;
}

/* Draws frame k with `side` pixels per side. */
static bool draw(const struct test_renderer *renderer, const struct row *row, int k, unsigned side,
                 bool is_filtered, struct test_image *image, struct sp_error *err) {
    struct test_scene scene;
    if (!make(row, &scene))
        return false;
    test_scene_orbit(&scene, NULL, 25 + 0.1 * k, 18, 400);
    scene.view.camera.projection = SP_ORTHOGRAPHIC;
    scene.view.camera.height = PIXELS / row->px;
    scene.view.size[0] = scene.view.size[1] = side;
    scene.view.level_of_detail = is_filtered ? SP_LOD_AUTO : SP_LOD_OFF;
    bool ok = test_render_scene(renderer, &scene, image, err);
    test_scene_finish(&scene);
    return ok;
}

static bool draw_mean(const struct test_renderer *renderer, const struct row *row, int k,
                      struct test_image *mean, struct sp_error *err) {
    struct test_image fine;
    if (!test_image_init(mean, PIXELS, PIXELS) ||
        !draw(renderer, row, k, RAYS * PIXELS, false, &fine, err))
        return false;
    for (unsigned y = 0; y < fine.height; y++)
        for (unsigned x = 0; x < fine.width; x++)
            for (int c = 0; c < 4; c++)
                test_image_at(mean, x / RAYS, y / RAYS)[c] +=
                    test_image_at(&fine, x, y)[c] / (RAYS * RAYS);
    test_image_finish(&fine);
    return true;
}

/* rms from frame to frame. */
static double change_of(const struct test_image frames[FRAMES]) {
    double sum = 0;
    for (int k = 1; k < FRAMES; k++)
        sum += pow(10, -test_image_psnr(&frames[k - 1], &frames[k]) / 20) / (FRAMES - 1);
    return sum;
}

/* Fills `means` by row and frame, if they are not yet filled: by the first target for all. */
static bool draw_means(const struct test_renderer *renderer, struct sp_error *err) {
    for (int i = 0; i < ROWS; i++)
        for (int k = 0; k < FRAMES; k++)
            if (!means[i][k].rgba && !draw_mean(renderer, &rows[i], k, &means[i][k], err))
                return false;
    return true;
}

static unsigned check_row(const struct test_renderer *renderer, const struct row *row,
                          const struct test_image wanted[FRAMES]) {
    struct test_image filtered[FRAMES], points[FRAMES];
    struct sp_error err = { .text = "out of memory" };
    for (int k = 0; k < FRAMES; k++)
        if (!draw(renderer, row, k, PIXELS, true, &filtered[k], &err) ||
            !draw(renderer, row, k, PIXELS, false, &points[k], &err)) {
            printf(" %s FAILED\n", err.text);
            return 1;
        }
    const double mean = change_of(wanted), change = change_of(filtered) / mean;
    const double without = change_of(points) / mean;
    const double db = test_image_psnr(&filtered[0], &wanted[0]);
    const double db_without = test_image_psnr(&points[0], &wanted[0]);
    const double gain = 1.4, gain_db = 2; /* of the filter */
    bool is_good = change <= row->change && without >= gain * change && db >= row->floor &&
                   db >= db_without + gain_db;
    printf(" change %.4f, %.2f times; without the filter %.2f times; %.1f dB, without %.1f%s\n",
           mean, change, without, db, db_without, is_good ? "" : " FAILED");
    for (int k = 0; k < FRAMES; k++) {
        test_image_finish(&filtered[k]);
        test_image_finish(&points[k]);
    }
    return !is_good;
}

static unsigned check_target(const struct test_target *target,
                             const struct test_renderer *renderer) {
    unsigned failed = 0;
    struct sp_error err = { .text = "out of memory" };
    if (!draw_means(renderer, &err)) {
        printf("%s FAILED\n", err.text);
        return 1;
    }
    for (int i = 0; i < ROWS; i++) {
        printf("%s %s, %s:", target->backend, target->isa, rows[i].name);
        failed += check_row(renderer, &rows[i], means[i]);
    }
    return failed;
}

int main(void) {
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    unsigned failed = test_check_targets(1, check_target);
    for (int i = 0; i < ROWS * FRAMES; i++)
        test_image_finish(&means[i / FRAMES][i % FRAMES]);
    return failed > 0;
}
