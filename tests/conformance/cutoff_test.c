/* SPDX-License-Identifier: Apache-2.0
 *
 * filter.cutoff beyond 3 standard deviations, on every backend and instruction set. A footprint
 * ends at the cutoff c. The whole Gaussian has the part exp(−c²/2) beyond c, so the footprint is
 * 1/(1 − exp(−c²/2)) times as high. A larger cutoff draws an image that is nearer to the whole
 * Gaussian. Post-convolved sheets draw the whole Gaussian for every cutoff from 3 on.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/render.h"

enum { SIDE = 121, SAMPLES = 3 };

static const double SIGMA = 0.7, SCALE = 10; /* voxels; px per voxel */
static const double OPACITY = 0.9;

static double middle(const void *user, double x, double y, double z) {
    (void)user;
    return x == 1 && y == 1 && z == 1 ? 255 : 0;
}

static bool build(struct test_scene *scene) {
    static const double unit[3] = { 1, 1, 1 };
    struct sp_view *v = &scene->view;
    test_view_init(v);
    test_scene_points(scene, (const double[][5]){ { 128, 1, 1, 1, 0 }, { 255, 1, 1, 1, OPACITY } },
                      2);
    v->transfer_function.order = SP_TF_PRE;
    v->size[0] = v->size[1] = SIDE;
    v->camera = (struct sp_camera){ .projection = SP_ORTHOGRAPHIC,
                                    .position = { 0, 0, -50 },
                                    .up = { 0, -1, 0 },
                                    .fov_y = 30,
                                    .height = SIDE / SCALE,
                                    .near = 0.1 };
    return test_scene_voxels(scene, "voxel", (uint32_t[]){ SAMPLES, SAMPLES, SAMPLES }, unit,
                             SP_UINT8, middle, NULL);
}

/* Numbers that are measured in the image of a single voxel. */
struct footprint {
    double outer;    /* part of the optical depth that lies beyond 3 standard deviations */
    double expected; /* the same of a Gaussian that ends at the cutoff */
    double farthest; /* distance of a pixel that shows something [standard deviations] */
    double error;    /* largest distance from the Gaussian without an end, over its height */
};

/* cutoff: INFINITY = the Gaussian has no end. */
static struct footprint measure(const struct test_image *image, double sigma_px, double cutoff) {
    const double visible = 1e-6;
    const double height = -log(1 - OPACITY) / (2 * M_PI * pow(sigma_px / SCALE, 2));
    struct footprint f = { 0 };
    double sum = 0, sum_expected = 0;
    for (unsigned y = 0; y < SIDE; y++)
        for (unsigned x = 0; x < SIDE; x++) {
            double r = hypot(x - (SIDE - 1) / 2.0, y - (SIDE - 1) / 2.0) / sigma_px;
            double depth = -log1p(-test_image_at(image, x, y)[3]) / height;
            double gaussian = exp(-0.5 * r * r), cut = r <= cutoff ? gaussian : 0;
            sum += depth;
            sum_expected += cut;
            f.outer += r > 3 ? depth : 0;
            f.expected += r > 3 ? cut : 0;
            f.farthest = depth > visible ? fmax(f.farthest, r) : f.farthest;
            f.error = fmax(f.error, fabs(depth - gaussian));
        }
    f.outer /= sum;
    f.expected /= sum_expected;
    return f;
}

/* Returns the number of failures. */
static unsigned check_cutoff(const struct test_target *target, const struct test_renderer *renderer,
                             const struct test_scene *scene, double cutoff) {
    const double beyond = exp(-0.5 * cutoff * cutoff);
    const bool has_end = !test_uses_postconv(target, scene);
    const bool is_filtered = scene->view.filter.mode != SP_FILTER_RECONSTRUCTION;
    const double sigma_px = hypot(SIGMA * SCALE, is_filtered ? scene->view.filter.lowpass : 0);
    /* Post-convolved sheets are made of B-splines. */
    const double outer_rounding = has_end ? 1e-5 : 1e-3, rounding = has_end ? 1e-5 : 9e-3;
    const double error = has_end ? beyond / (1 - beyond) : 0;
    struct test_image image;
    struct sp_error err;
    if (!test_render_scene(renderer, scene, &image, &err)) {
        printf("FAILED: %s: %s\n", target->backend, err.text);
        return 1;
    }
    struct footprint f = measure(&image, sigma_px, has_end ? cutoff : INFINITY);
    test_image_finish(&image);
    bool is_good = fabs(f.outer - f.expected) < outer_rounding && fabs(f.error - error) < rounding;
    if (has_end && cutoff <= 5) /* farther out it is too faint */
        is_good = is_good && f.farthest > cutoff - 0.1 && f.farthest < cutoff + 1e-3;
    printf(
        "  %-11s %-7s mode %d, filter %d, cutoff %.1f: %.5f beyond 3 (%.5f), ends at %.2f, error "
        "%.6f (%.6f)%s\n",
        target->backend, target->isa, (int)scene->view.compositing.mode,
        (int)scene->view.filter.mode, cutoff, f.outer, f.expected, f.farthest, f.error, error,
        is_good ? "" : " FAILED");
    return !is_good;
}

/* The splats of a shell end at the cutoff as well. */
static unsigned check_shell(const struct test_target *target, const struct test_renderer *renderer,
                            struct test_scene *scene) {
    unsigned failed = 0;
    scene->view.filter.mode = SP_FILTER_EWA;
    scene->view.compositing.mode = SP_COMPOSITE_SHEET;
    scene->view.layer_count = 1;
    scene->view.layers[0] = sp_layer_default(SP_LAYER_SHELL);
    scene->view.layers[0].detail = SP_SHELL_HIGH;
    for (int c = 3; c <= 5; c++) {
        struct test_image image;
        struct sp_error err;
        scene->view.filter.cutoff = c;
        if (!test_render_scene(renderer, scene, &image, &err)) {
            printf("FAILED: %s: %s\n", target->backend, err.text);
            return 1;
        }
        struct footprint f = measure(&image, hypot(SIGMA * SCALE, scene->view.filter.lowpass), c);
        test_image_finish(&image);
        bool is_good =
            fabs(f.outer - f.expected) < 1e-5 && f.farthest > c - 0.1 && f.farthest < c + 1e-3;
        printf("  %-11s %-7s shell, cutoff %d: %.5f beyond 3 (%.5f), ends at %.2f, error %.6f%s\n",
               target->backend, target->isa, c, f.outer, f.expected, f.farthest, f.error,
               is_good ? "" : " FAILED");
        failed += !is_good;
    }
    return failed;
}

static unsigned check(const struct test_target *target, const struct test_renderer *renderer) {
    static const enum sp_compositing modes[] = { SP_COMPOSITE_SPLAT, SP_COMPOSITE_SHEET,
                                                 SP_COMPOSITE_SLAB };
    static const enum sp_filter_mode filters[] = { SP_FILTER_EWA, SP_FILTER_ADAPTIVE,
                                                   SP_FILTER_RECONSTRUCTION };
    static const double cutoffs[] = { 3, 3.5, 4, 5, 6 };
    struct test_scene scene;
    unsigned failed = 0;
    if (!build(&scene))
        return 1;
    for (int m = 0; m < 3; m++)
        for (int f = 0; f < 3; f++)
            for (int c = 0; c < 5; c++) {
                scene.view.compositing.mode = modes[m];
                scene.view.filter.mode = filters[f];
                scene.view.filter.cutoff = cutoffs[c];
                failed += check_cutoff(target, renderer, &scene, cutoffs[c]);
            }
    failed += check_shell(target, renderer, &scene);
    test_scene_finish(&scene);
    return failed;
}

int main(void) {
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    unsigned failed = test_check_targets(2, check);
    if (failed)
        printf("%u checks FAILED\n", failed);
    return failed > 0;
}
