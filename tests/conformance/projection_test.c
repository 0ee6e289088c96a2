/* SPDX-License-Identifier: Apache-2.0
 *
 * Projections (draw/resample/projection.h): every backend and instruction set against brute force,
 * and against the scalar reference; what is left out where samples are not finite. Overshoot:
 * projection_range_test.c.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/projected.h"
#include "support/render.h"
#include "support/sanitized.h"

enum { TARGETS_MAX = 16, STEPS = 28, MODES = 5 };

static const double ZERO = 0.1; /* of the absorption, as a share of the range */

/* dB, half a decibel below the measured value. By column: maximum, minimum, mean, sum, absorption.
 * The expected maximum and minimum come from values that are kept between the samples around
 * (support/interpolant.h).
 */
struct row {
    const char *name;
    test_scene_fn *scene;
    double floor[MODES];
};

static const struct row rows[] = {
    { "blobs", test_scene_blobs, { 74, 100, 86, 73.9, 77.2 } },
    { "orthographic", test_scene_orthographic, { 67.2, 100, 81.8, 73.5, 76.2 } },
    { "sheared", test_scene_sheared, { 75.1, 100, 88.4, 76.4, 78.2 } },
    { "anisotropic", test_scene_anisotropic, { 50.3, 100, 60.8, 67, 64.3 } },
    { "rectilinear blobs", test_scene_rectilinear_blobs, { 74.2, 100, 85.1, 78.7, 81.1 } },
    { "phantom", test_scene_phantom, { 31.3, 100, 58.5, 58.8, 55.8 } },
    { "inside", test_scene_inside, { 34.2, 100, 64.4, 68.3, 60.3 } },
    { "clip plane", test_scene_clip_plane, { 75, 111.1, 80.3, 70.7, 71.2 } },
    { "clip box", test_scene_clip_box, { 70.1, 91.1, 80.2, 71.8, 71.6 } },
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

/* Along the silhouette brute force may step over the volume: a ray that has less than three steps
 * inside, or none beside such rays, is not compared. */
static bool is_silhouette(const struct test_image *numbers, double step, int x, int y) {
    if (test_image_at(numbers, (unsigned)x, (unsigned)y)[3] >= 3 * step)
        return false;
    for (int j = y > 0 ? y - 1 : 0; j <= y + 1 && j < (int)numbers->height; j++)
        for (int i = x > 0 ? x - 1 : 0; i <= x + 1 && i < (int)numbers->width; i++)
            if (test_image_at(numbers, (unsigned)i, (unsigned)j)[3] > 0)
                return true;
    return false;
}

static void leave_silhouette(const struct test_image *numbers, double step,
                             const struct test_image *truth, struct test_image *image) {
    for (unsigned y = 0; y < image->height; y++)
        for (unsigned x = 0; x < image->width; x++)
            if (is_silhouette(numbers, step, (int)x, (int)y))
                memcpy(test_image_at(image, x, y), test_image_at(truth, x, y), 4 * sizeof(double));
}

/* Draws the view with every target, and compares the images with `truth` (NULL = with the scalar
 * reference alone). */
static bool check_images(const struct run *run, const char *name, const struct test_scene *scene,
                         const struct test_image *numbers, const struct test_image *truth,
                         double floor) {
    struct test_image scalar = { 0 };
    const double *spacing = scene->info.grid.spacing;
    const double step = fmin(fmin(spacing[0], spacing[1]), spacing[2]) / STEPS;
    /* Where images of two sets of sheets are mixed, GL mixes colours, and the CPU mixes numbers. */
    const double least_same = 66;
    bool is_good = true;
    for (unsigned t = 0; t < run->count; t++) {
        const struct test_target *target = &run->targets[t];
        struct test_image image;
        struct sp_error err;
        if (!test_render_scene(&run->renderers[t], scene, &image, &err)) {
            printf("  %s: %s\n", target->isa, err.text);
            return false;
        }
        double same = t ? test_image_psnr(&image, &scalar) : INFINITY;
        if (t == 0 && !test_image_init(&scalar, image.width, image.height))
            return false;
        if (t == 0)
            memcpy(scalar.rgba, image.rgba,
                   sizeof *image.rgba * 4 * (size_t)image.width * image.height);
        if (truth)
            leave_silhouette(numbers, step, truth, &image);
        double psnr = truth ? test_image_psnr(&image, truth) : INFINITY;
        printf("  %s %s %.1f (%.0f)", target->backend, target->isa, psnr, same);
        if (!(psnr >= floor) || !(same >= least_same)) {
            is_good = false;
            printf(" FAILED");
            test_image_dump(name, &image, truth ? truth : &scalar, 8);
        }
        test_image_finish(&image);
    }
    printf("\n");
    test_image_finish(&scalar);
    return is_good;
}

/* Scenes do not fill it. */
static bool fill_range(struct test_scene *scene) {
    struct sp_error err;
    struct sp_volume *volume = test_scene_volume(scene, &err);
    if (volume)
        memcpy(scene->info.range, sp_volume_info(volume)->range, sizeof scene->info.range);
    sp_volume_unref(&volume);
    return scene->info.range[1] > scene->info.range[0];
}

/* Chooses the mode of a column, and a window that cuts a little off at both ends. */
static void choose(struct test_scene *scene, int column) {
    struct sp_compositing_options *c = &scene->view.compositing;
    const double low = scene->info.range[0], span = scene->info.range[1] - low;
    double side = 0;
    for (int a = 0; a < 3; a++)
        side += scene->info.grid.spacing[a] * scene->info.grid.dims[a] / 3;
    c->mode = column == 4 ? SP_COMPOSITE_SUM : (enum sp_compositing)(SP_COMPOSITE_MAXIMUM + column);
    c->colors = column == 1 ? SP_COLORS_TRANSFER_FUNCTION : SP_COLORS_GREY;
    c->zero = column == 4 ? low + ZERO * span : NAN;
    c->absorption = column == 4 ? 4 / (side * span) : NAN;
    c->center = low + (column == 0 ? 0.5 : 0.25) * span;
    c->width = (column == 0 ? 0.9 : 0.4) * span;
    if (column == 3) {
        c->center = 0.25 * span * side;
        c->width = 0.48 * span * side;
    } else if (column == 4) {
        c->center = 0.45;
        c->width = 0.8;
    }
}

/* Returns how many of the columns fail. */
static unsigned check_row(const struct run *run, const struct row *row) {
    static const char *const names[MODES] = { "maximum", "minimum", "mean", "sum", "absorption" };
    struct test_scene scene;
    struct test_image numbers[2] = { 0 };
    unsigned failed = 0;
    if (!row->scene(&scene) || !fill_range(&scene))
        return MODES;
    scene.view.level_of_detail = SP_LOD_OFF;
    for (int a = 0; a < 2; a++) /* brute force takes most of the time of the test */
        scene.view.size[a] = scene.view.size[a] * 9 / 16;
    const double *range = scene.info.range;
    const double zeros[2] = { range[0], range[0] + ZERO * (range[1] - range[0]) };
    if (!TEST_SANITIZED && !test_projected(&scene, STEPS, zeros, numbers))
        return MODES;
    for (int column = 0; column < MODES; column++) {
        const int n = column == 4;
        struct test_image truth = { 0 };
        choose(&scene, column);
        printf("%-18s %-10s", row->name, names[column]);
        if (!TEST_SANITIZED && !test_projected_image(&scene.view, &numbers[n], zeros[n], &truth))
            return MODES;
        failed += !check_images(run, row->name, &scene, &numbers[n], TEST_SANITIZED ? NULL : &truth,
                                row->floor[column]);
        test_image_finish(&truth);
    }
    test_image_finish(&numbers[0]);
    test_image_finish(&numbers[1]);
    test_scene_finish(&scene);
    return failed;
}

enum { SIDE = 16, KNOWN = 7 }; /* samples per axis; of them finite along the third */

static double slope(const void *user, double x, double y, double z) {
    (void)user;
    (void)y;
    (void)z;
    return 10 * x;
}

/* Not finite: slices from KNOWN on, and both ends of the first axis. */
static void leave_out(struct test_scene *scene) {
    float *voxel = scene->voxels;
    for (int i = 0; i < SIDE * SIDE * SIDE; i++)
        if (i / (SIDE * SIDE) >= KNOWN || i % SIDE < 2)
            voxel[i] = NAN;
        else if (i % SIDE > 13)
            voxel[i] = INFINITY;
}

/* One pixel per sample, seen along the third axis: where all samples around a pixel are finite, its
 * number is the number of the slope, whatever lies beside these samples. */
static unsigned check_finite(const struct run *run) {
    static const double unit[3] = { 1, 1, 1 };
    const double length = KNOWN - 0.5, inside = 1e-3;
    struct test_scene scene;
    unsigned failed = 0;
    test_view_init(&scene.view);
    test_scene_points(&scene, (const double[][5]){ { 0, 1, 1, 1, 0.5 } }, 1);
    if (!test_scene_voxels(&scene, "partly known", (uint32_t[]){ SIDE, SIDE, SIDE }, unit,
                           SP_FLOAT32, slope, NULL))
        return 1;
    leave_out(&scene);
    scene.view.size[0] = scene.view.size[1] = SIDE;
    scene.view.level_of_detail = SP_LOD_OFF; /* a pixel shows the ray through its centre */
    scene.view.camera = (struct sp_camera){ .projection = SP_ORTHOGRAPHIC,
                                            .position = { 0, 0, -50 },
                                            .target = { 0, 0, 0 },
                                            .up = { 0, -1, 0 },
                                            .fov_y = 30,
                                            .height = SIDE,
                                            .near = 0.1 };
    memcpy(scene.view.background, (float[4]){ 1, 0, 0, 1 }, sizeof scene.view.background);
    for (int column = 0; column < 4; column++)
        for (unsigned t = 0; t < run->count; t++) {
            struct sp_compositing_options *c = &scene.view.compositing;
            struct test_image image;
            struct sp_error err;
            c->mode = (enum sp_compositing)(SP_COMPOSITE_MAXIMUM + column);
            c->zero = 0;
            c->center = 100 * (column == 3 ? length : 1);
            c->width = 2 * c->center;
            if (!test_render_scene(&run->renderers[t], &scene, &image, &err)) {
                printf("%s\n", err.text);
                return 1;
            }
            for (unsigned x = 0; x < SIDE; x++) {
                /* Pixels lie on samples. Pixels at the border of the finite samples see both sides.
                 */
                const double *pixel = test_image_at(&image, x, SIDE / 2);
                double grey = 10.0 * x / 200;
                bool is_known = x > 2 && x < 13, is_border = x == 2 || x == 13;
                double green = is_known ? grey : 0, red = is_known ? grey : 1;
                if (!is_border && (!(fabs(pixel[1] - green) < inside + 1.0 / 255) ||
                                   !(fabs(pixel[0] - red) < inside + 1.0 / 255))) {
                    printf("FAILED: finite, mode %d, %s %s, pixel %u: %g %g is not %g %g\n",
                           c->mode, run->targets[t].backend, run->targets[t].isa, x, pixel[0],
                           pixel[1], red, green);
                    failed++;
                }
            }
            test_image_finish(&image);
        }
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
    printf("PSNR [dB] to brute force, and in parentheses to the scalar reference\n");
    if (TEST_SANITIZED)
        printf("under a sanitizer brute force is left out\n");
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        failed += check_row(&run, &rows[i]);
    failed += check_finite(&run);
    for (unsigned t = 0; t < run.count; t++)
        test_renderer_close(&run.renderers[t]);
    if (failed)
        printf("%u checks FAILED\n", failed);
    return failed > 0;
}
