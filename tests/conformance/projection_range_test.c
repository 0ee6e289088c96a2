/* SPDX-License-Identifier: Apache-2.0
 *
 * Maximum and minimum projections of volumes with steep edges: on every backend and instruction
 * set, a pixel shows nothing above the largest and nothing below the smallest sample of the cells
 * that its ray crosses.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/interpolated.h"
#include "support/render.h"
#include "support/sample.h"

enum { STEPS = 32, SIDE = 72, BLOCK = 3, LAST = 4095 };

/* Blocks of constant values, whose edges are steep, with some noise. Two of the samples are far
 * from all others, so that limits to the range of all data keep nothing else. */
static double blocks(const void *user, double x, double y, double z) {
    const unsigned at[3] = { (unsigned)x, (unsigned)y, (unsigned)z };
    unsigned block = 0, sample = 0;
    (void)user;
    if (at[0] + at[1] + at[2] == 0 || (at[0] == 1 && at[1] + at[2] == 0))
        return at[0] * LAST;
    for (int a = 0; a < 3; a++) {
        block = (block ^ (at[a] / BLOCK)) * 0x9e3779b1u;
        sample = (sample ^ at[a]) * 0x85ebca6bu;
    }
    return 1000 + 900 * (block >> 16) % 2700 + (sample >> 16) % 60;
}

/* Widens `range` to the samples of all cells between two places [sample indices]. */
static void add_cells(const struct test_scene *scene, const double a[3], const double b[3],
                      double range[2]) {
    const struct sp_grid *grid = &scene->info.grid;
    uint32_t first[3], last[3], i[3];
    for (int r = 0; r < 3; r++) {
        first[r] = (uint32_t)fmin(a[r], b[r]);
        last[r] = (uint32_t)fmin(fmax(a[r], b[r]) + 1, grid->dims[r] - 1);
    }
    for (i[2] = first[2]; i[2] <= last[2]; i[2]++)
        for (i[1] = first[1]; i[1] <= last[1]; i[1]++)
            for (i[0] = first[0]; i[0] <= last[0]; i[0]++) {
                double value =
                    test_sample(scene->voxels, scene->info.type, test_sample_index(grid, i));
                range[0] = fmin(range[0], value);
                range[1] = fmax(range[1], value);
            }
}

static bool is_inside(const struct test_scene *scene, const double world[3],
                      const double index[3]) {
    const struct sp_clip *clip = &scene->view.clip;
    for (int r = 0; r < 3; r++)
        if (index[r] < -0.5 || index[r] > scene->info.grid.dims[r] - 0.5)
            return false;
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        const double *n = clip->planes[i].normal;
        if (n[0] * world[0] + n[1] * world[1] + n[2] * world[2] < clip->planes[i].offset)
            return false;
    }
    return true;
}

/* Writes the smallest and the largest sample of the cells, and the length of the ray inside the
 * volume. The value in the interval between two sheets comes from both sheets, also where the
 * border of the volume or a clip plane lies between them: so the ray counts from one interval
 * before its first place inside to one interval behind the last one. */
static void follow(void *user, const double eye[3], const double ahead[3], double from, double to,
                   double step, double *number) {
    const struct test_scene *scene = user;
    const double interval = sqrt(3);
    double begin = INFINITY, end = -INFINITY, before[3] = { 0 };
    number[0] = INFINITY;
    number[1] = -INFINITY;
    for (int pass = 0; pass < 2; pass++)
        for (double l = from - interval; l < to + interval; l += step) {
            double world[3], index[3], at[3];
            for (int r = 0; r < 3; r++) {
                world[r] = eye[r] + l * ahead[r];
                index[r] = world[r] - scene->info.grid.origin[r];
                at[r] = fmin(fmax(index[r], 0), scene->info.grid.dims[r] - 1);
            }
            if (pass == 0 && l > from && is_inside(scene, world, index)) {
                begin = fmin(begin, l);
                end = l;
            } else if (pass == 1 && l >= begin - interval && l <= end + interval) {
                add_cells(scene, l - step < begin - interval ? at : before, at, number);
            }
            memcpy(before, at, sizeof before);
        }
    number[3] = fmax(end - begin, 0);
}

struct row {
    const char *name;
    double azimuth, elevation, distance;
    bool is_cut;
};

static const struct row rows[] = {
    { "along an axis", 0, 0, 90, false }, { "oblique", 25, 15, 90, false },
    { "half sheets", 44, 33, 90, false }, { "clip plane", 25, 15, 90, true },
    { "from inside", 70, -20, 4, false },
};

static bool build(const struct row *row, struct test_scene *scene) {
    static const double unit[3] = { 1, 1, 1 };
    test_view_init(&scene->view);
    test_scene_points(scene, (const double[][5]){ { 0, 1, 1, 1, 0.5 } }, 1);
    if (!test_scene_voxels(scene, row->name, (uint32_t[]){ 26, 30, 24 }, unit, SP_UINT16, blocks,
                           NULL))
        return false;
    scene->view.size[0] = scene->view.size[1] = SIDE;
    scene->view.level_of_detail = SP_LOD_OFF;
    test_scene_orbit(scene, NULL, row->azimuth, row->elevation, row->distance);
    if (row->is_cut)
        test_scene_cut(scene, (double[]){ 0.5, 0.3, 0.8 }, (double[]){ 0.3, 0.2, 0.1 });
    scene->view.compositing.center = LAST / 2.0;
    scene->view.compositing.width = LAST;
    return true;
}

static const struct row *row_now;
static const struct test_scene *scene_now;
static const struct test_image *ranges_now;

static unsigned check_mode(const struct test_target *target, const struct test_renderer *renderer,
                           enum sp_compositing mode) {
    const double rounding = 1e-4 * LAST;
    struct test_scene scene = *scene_now;
    struct test_image image;
    struct sp_error err;
    double above = 0, below = 0, sum = 0;
    unsigned compared = 0;
    scene.view.compositing.mode = mode;
    if (!test_render_scene(renderer, &scene, &image, &err)) {
        printf("FAILED: %s: %s\n", target->backend, err.text);
        return 1;
    }
    for (unsigned y = 0; y < SIDE; y++)
        for (unsigned x = 0; x < SIDE; x++) {
            const double *range = test_image_at(ranges_now, x, y);
            double number = test_image_at(&image, x, y)[0] * LAST;
            if (range[3] < 3.0 / STEPS) /* along the silhouette */
                continue;
            above = fmax(above, number - range[1]);
            below = fmax(below, range[0] - number);
            sum += (number - range[0]) / (range[1] - range[0]);
            compared++;
        }
    test_image_finish(&image);
    printf("  %-14s %-11s %-7s %s: above %.2f, below %.2f of 255; mean place %.3f of %u pixels\n",
           row_now->name, target->backend, target->isa,
           mode == SP_COMPOSITE_MAXIMUM ? "maximum" : "minimum", above / LAST * 255,
           below / LAST * 255, sum / compared, compared);
    /* A projection that shows something else than extremes fails also: the mean place between the
     * smallest and the largest sample is near one of them. */
    double place = mode == SP_COMPOSITE_MAXIMUM ? sum / compared : 1 - sum / compared;
    bool is_good =
        compared > SIDE * SIDE / 10 && above <= rounding && below <= rounding && place > 0.8;
    if (!is_good)
        printf("  FAILED\n");
    return !is_good;
}

static unsigned check(const struct test_target *target, const struct test_renderer *renderer) {
    return check_mode(target, renderer, SP_COMPOSITE_MAXIMUM) +
           check_mode(target, renderer, SP_COMPOSITE_MINIMUM);
}

int main(void) {
    unsigned failed = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct test_scene scene;
        struct test_image ranges = { 0 };
        if (!build(&rows[i], &scene) || !test_each_ray(&scene, STEPS, follow, &scene, &ranges)) {
            printf("FAILED: out of memory\n");
            return 1;
        }
        row_now = &rows[i];
        scene_now = &scene;
        ranges_now = &ranges;
        failed += test_check_targets(2, check);
        test_image_finish(&ranges);
        test_scene_finish(&scene);
    }
    if (failed)
        printf("%u checks FAILED\n", failed);
    return failed > 0;
}
