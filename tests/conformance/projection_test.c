/* SPDX-License-Identifier: Apache-2.0
 *
 * Projections (resample/reduction.h): every backend and instruction set against brute force, and
 * against the scalar reference; what is left out where samples are not finite.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/projected.h"
#include "support/render.h"
#include "support/sanitized.h"

enum { TARGETS_MAX = 16, STEPS = 24, MODES = 5 };

/* dB, half a decibel below what was measured. By column: maximum, minimum, mean, sum, absorption.
 */
struct row {
    const char *name;
    test_scene_fn *scene;
    double floor[MODES];
};

static const struct row rows[] = {
    { "blobs", test_scene_blobs, { 74, 100, 85.2, 72.6, 75.7 } },
    { "orthographic", test_scene_orthographic, { 67.6, 100, 81.7, 72.2, 74.9 } },
    { "sheared", test_scene_sheared, { 74.4, 100, 88.2, 75.3, 76.9 } },
    { "anisotropic", test_scene_anisotropic, { 47.6, 100, 59.2, 65.8, 63.5 } },
    { "rectilinear blobs", test_scene_rectilinear_blobs, { 74, 100, 83.9, 77.1, 79.6 } },
    { "phantom", test_scene_phantom, { 28, 100, 56.9, 57.1, 54.2 } },
    { "inside", test_scene_inside, { 33.1, 100, 64.1, 68, 59.8 } },
    { "clip plane", test_scene_clip_plane, { 75, 110.6, 79.9, 69.3, 69.7 } },
    { "clip box", test_scene_clip_box, { 69.3, 90.3, 78.6, 70.4, 70.1 } },
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
    /* Where two images with other sheets are mixed, GL mixes colours, and the CPU numbers. */
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
static bool find_range(struct test_scene *scene) {
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
    c->zero = column == 4 ? low + 0.1 * span : NAN;
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

/* Returns how many of the columns fail. The numbers of most of them are the same. */
static unsigned check_row(const struct run *run, const struct row *row) {
    static const char *const names[MODES] = { "maximum", "minimum", "mean", "sum", "absorption" };
    struct test_scene scene;
    struct test_image numbers = { 0 };
    unsigned failed = 0;
    double known = NAN; /* zero of the numbers */
    if (!row->scene(&scene) || !find_range(&scene))
        return MODES;
    scene.view.level_of_detail = SP_LOD_OFF;
    for (int column = 0; column < MODES; column++) {
        struct test_image truth = { 0 };
        choose(&scene, column);
        double zero =
            isnan(scene.view.compositing.zero) ? scene.info.range[0] : scene.view.compositing.zero;
        if (!TEST_SANITIZED && zero != known) {
            test_image_finish(&numbers);
            known = zero;
            if (!test_projected(&scene, STEPS, zero, &numbers))
                return MODES;
        }
        printf("%-18s %-10s", row->name, names[column]);
        if (!TEST_SANITIZED && !test_projected_image(&scene.view, &numbers, zero, &truth))
            return MODES;
        failed += !check_images(run, row->name, &scene, &numbers, TEST_SANITIZED ? NULL : &truth,
                                row->floor[column]);
        test_image_finish(&truth);
    }
    test_image_finish(&numbers);
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

/* One pixel per sample, seen along the third axis: where all samples around are finite the numbers
 * are those of a slope, whatever lies beside them. */
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
                /* Pixels lie on samples: those at the border of what is known see both sides. */
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
