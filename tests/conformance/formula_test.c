/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares every backend with the formulas in double precision (support/formula.h), on random
 * scenes. A seed determines the scene: sample type, sides from 1 voxel, spacing, rectilinear axes,
 * rotation, shear, mirroring, projection, kernel, cutoff, filter, compositing, attenuation, clip
 * planes and box, gradient axis, order of classification, background, image size, shading.
 *
 *   test_conformance_formula [SEED [END [ISA]]]   only the scene SEED, or the scenes [SEED, END);
 *                                                 only the targets with instruction set ISA
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec.h"
#include "data/volume/grid.h"
#include "sp/log.h"
#include "support/data.h"
#include "support/formula.h"
#include "support/render.h"
#include "support/sanitized.h"

/* Floors of the PSNR [dB]. Lowest values of the scalar CPU backend over the test's scenes:
 *   89.5 in general;
 *   77.1 for scenes that use gradients, because gradients are quantised;
 *   93.6 for flat rectangles; 57.2 over the seeds 0 … 999, because rounding decides on which side
 * of a pixel centre an edge is. Of the seeds 0 … 999 three lie below the floors: 302, 426 and 766
 * (66.5, 74.8 and 53.4 dB). Post-convolved sheets are compared with kernels that end at the cutoff
 * and with kernels that end at CUTOFF_FAR; the higher PSNR counts. It is 55.5 or more over the
 * seeds 0 … 599, where some bricks of an image use footprints and others do not, and 69 or more in
 * all other images. */
enum {
    SCENES = 100,
    FLOOR = 80,
    FLOOR_QUANTISED = 70,
    FLOOR_FLAT = 50,
    FLOOR_SHEETS = 55,
    CUTOFF_FAR = 6,
    SUBJECTS_MAX = 16
};

/* Compositing `splat` sorts by distance in ranges of this length, in edges of a cell. */
#define RANGE (1.0 / 16)

struct generator {
    uint64_t state;
};

/* Returns a random number in [low, high). It is an xorshift generator, so that a seed gives the
 * same scene on every platform. */
static double between(struct generator *d, double low, double high) {
    d->state ^= d->state << 13;
    d->state ^= d->state >> 7;
    d->state ^= d->state << 17;
    return low + (high - low) * (double)(d->state >> 11) * 0x1p-53;
}

static bool one_in(struct generator *d, double n) {
    return between(d, 0, n) < 1;
}

static double waves(const void *user, double x, double y, double z) {
    const double *k = user;
    return 50 + 60 * sin(k[0] * x + k[1] * y + k[2] * z + 5 * k[3]) +
           40 * sin(k[4] * k[5] * x + k[1] * z) * cos(k[2] * y);
}

static void draw_filter(struct generator *d, struct sp_filter *f) {
    f->sigma = one_in(d, 4) ? between(d, 0.35, 1.6) : 0.7;
    f->cutoff = one_in(d, 4) ? between(d, 1, 6) : 3;
    f->lowpass = one_in(d, 4) ? between(d, 0, 4) : 1;
    if (one_in(d, 4))
        f->kernel = SP_KERNEL_CUBIC;
    if (one_in(d, 5))
        f->mode = SP_FILTER_RECONSTRUCTION;
    else if (one_in(d, 6) && f->lowpass > 0.2)
        f->mode = SP_FILTER_LOWPASS;
    else if (one_in(d, 4))
        f->mode = SP_FILTER_SWAN;
    else if (one_in(d, 5))
        f->mode = SP_FILTER_NONE;
}

static void draw_compositing(struct generator *d, struct sp_view *v) {
    v->compositing.mode = (enum sp_compositing)between(d, 0, 3);
    v->compositing.slab = exp(between(d, -1.2, 1.2));
    if (one_in(d, 4))
        v->compositing.attenuation = SP_ATTENUATION_LINEAR;
    if (v->compositing.mode == SP_COMPOSITE_SLAB && one_in(d, 3))
        v->transfer_function.order = SP_TF_POST;
}

/* Planes near the middle of the volume, a box, or both. */
static void draw_clip(struct generator *d, struct test_scene *s, double size) {
    struct sp_clip *clip = &s->view.clip;
    int planes = one_in(d, 3) ? (int)between(d, 1, 4) : 0;
    for (int i = 0; i < planes; i++) {
        double normal[3], point[3], length = exp(between(d, -5, 5));
        for (int a = 0; a < 3; a++) {
            normal[a] = length * between(d, -1, 1);
            point[a] = size * between(d, -0.15, 0.15);
        }
        test_scene_cut(s, normal, point);
    }
    for (int a = 0; a < 3; a++) {
        if (!one_in(d, 6))
            continue;
        clip->box[0][a] = one_in(d, 2) ? 0 : between(d, 0, 0.5);
        clip->box[1][a] = one_in(d, 2) ? 1 : between(d, 0.5, 1);
    }
}

/* Makes an axis rectilinear: its gaps differ by up to a factor of 4; its length stays the same. */
static bool draw_gaps(struct generator *d, struct test_scene *s, int axis) {
    struct sp_grid *grid = &s->info.grid;
    uint32_t n = grid->dims[axis];
    double *c = malloc(n * sizeof *c);
    if (!c)
        return false;
    c[0] = 0;
    for (uint32_t i = 1; i < n; i++)
        c[i] = c[i - 1] + exp(between(d, -0.7, 0.7));
    for (uint32_t i = 1; i < n; i++)
        c[i] *= grid->spacing[axis] * (n - 1) / c[n - 1];
    if (n > 1)
        grid->spacing[axis] = c[n - 1] / (n - 1);
    grid->coordinates[axis] = s->coordinates[axis] = c;
    return true;
}

static void draw_gradient_axis(struct generator *d, struct test_scene *s) {
    struct sp_transfer_function *tf = &s->view.transfer_function;
    const double *spacing = s->info.grid.spacing;
    double magnitude = 10 / cbrt(spacing[0] * spacing[1] * spacing[2]);
    tf->gradient_count = 1 + (uint32_t)between(d, 0, 4);
    for (uint32_t i = 0; i < tf->gradient_count; i++) {
        magnitude *= between(d, 1.1, 3);
        tf->gradient[i] = (struct sp_gradient_point){ magnitude, (float)between(d, 0, 1) };
    }
}

static void draw_view(struct generator *d, struct test_scene *s, double size) {
    struct sp_view *v = &s->view;
    double target[3];
    for (int a = 0; a < 3; a++)
        target[a] = between(d, -0.15, 0.15) * size;
    double azimuth = one_in(d, 5) ? 90 * floor(between(d, 0, 4)) : between(d, -180, 180);
    double elevation = one_in(d, 5) ? 0 : between(d, -85, 85);
    double distance = between(d, 1.0, 2.5) * size;
    test_scene_orbit(s, target, azimuth, elevation, distance);
    for (int a = 0; a < 3; a++)
        v->camera.up[a] += between(d, -0.4, 0.4);
    if (one_in(d, 3)) {
        v->camera.projection = SP_ORTHOGRAPHIC;
        v->camera.height = size * between(d, 0.3, 1.2);
    }
    v->camera.fov_y = one_in(d, 4) ? between(d, 60, 110) : between(d, 10, 55);
    v->camera.near = one_in(d, 4) ? between(d, 0.7, 1) * distance : 0.05 * size;
    v->transfer_function.reference_length = exp(between(d, -1, 1));
    draw_filter(d, &v->filter);
    draw_compositing(d, v);
    draw_clip(d, s, size);
    for (int c = 0; c < 4; c++)
        v->background[c] = one_in(d, 2) ? (float)between(d, 0, 1) : (float)(c == 3);
    v->size[0] = 16 + (uint32_t)between(d, 0, 80);
    v->size[1] = 16 + (uint32_t)between(d, 0, 80);
    if (one_in(d, 4))
        v->shading.mode = SP_SHADING_PHONG;
    if (one_in(d, 4))
        draw_gradient_axis(d, s);
}

static bool draw(struct test_scene *s, unsigned seed) {
    struct generator generator = { UINT64_C(0x9e3779b97f4a7c15) * (seed + 1) }, *d = &generator;
    uint32_t dims[3];
    double k[6], spacing[3], size = 0, points[4][5] = { { 20 }, { 60 }, { 80 }, { 120 } };
    for (int i = 0; i < 6; i++)
        k[i] = between(d, -0.6, 0.6);
    for (int a = 0; a < 3; a++) {
        dims[a] = (uint32_t)(one_in(d, 6) ? between(d, 1, 4) : between(d, 4, 29));
        spacing[a] = exp(between(d, -1.2, 1.2));
        size += pow(dims[a] * spacing[a], 2);
    }
    double dense = one_in(d, 3) ? between(d, 0.5, 0.995) : between(d, 0.01, 0.4);
    enum sp_type type = (enum sp_type)between(d, 0, SP_TYPE_COUNT);
    for (int i = 0; i < 4; i++) {
        for (int c = 1; c < 4; c++)
            points[i][c] = between(d, 0, 1);
        points[i][4] = i == 3 ? dense : i == 1 ? 0.3 * dense : 0;
    }
    test_view_init(&s->view);
    test_scene_points(s, points, 4);
    if (!test_scene_voxels(s, "random", dims, spacing, type, waves, k))
        return false;
    if (one_in(d, 2)) {
        double degrees[3] = { between(d, -180, 180), between(d, -180, 180), between(d, -180, 180) };
        double mirror = one_in(d, 2) ? 1 : -1;
        test_scene_direction(s, degrees, mirror, one_in(d, 2) ? between(d, -0.7, 0.7) : 0);
    }
    for (int a = 0; a < 3; a++)
        if (one_in(d, 6) && !draw_gaps(d, s, a))
            return false;
    draw_view(d, s, sqrt(size));
    return true;
}

/* Returns the edge of a cube with the volume of a cell. */
static double cell(const struct sp_grid *grid) {
    struct sp_mat3 m;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            m.m[r][a] = grid->direction[r][a] * grid->spacing[a];
    return cbrt(fabs(sp_mat3_determinant(&m)));
}

/* The property of a scene that limits its PSNR. */
enum kind { PLAIN, QUANTISED, FLAT, SHEETS, KINDS };

static enum kind kind_of(const struct test_target *target, const struct test_scene *scene) {
    const struct sp_view *v = &scene->view;
    if (test_uses_postconv(target, scene))
        return SHEETS;
    bool quantised = v->shading.mode == SP_SHADING_PHONG || v->transfer_function.gradient_count > 0;
    return v->filter.mode == SP_FILTER_NONE ? FLAT : quantised ? QUANTISED : PLAIN;
}

static void describe(const struct test_scene *s, unsigned seed, double psnr) {
    static const char *const filters[] = { "adaptive", "ewa",  "reconstruction",
                                           "lowpass",  "swan", "none" };
    static const char *const compositings[] = { "splat", "sheet", "slab" };
    const struct sp_view *v = &s->view;
    const uint32_t *dims = s->info.grid.dims;
    printf("seed %u: %.1f dB; %u×%u×%u voxels, %s%s%s%s %s%s", seed, psnr, dims[0], dims[1],
           dims[2], filters[v->filter.mode], v->filter.kernel == SP_KERNEL_CUBIC ? " cubic" : "",
           v->camera.projection == SP_ORTHOGRAPHIC ? " orthographic" : "",
           sp_grid_is_rectilinear(&s->info.grid) ? " rectilinear" : "",
           compositings[v->compositing.mode],
           v->compositing.attenuation == SP_ATTENUATION_LINEAR ? " linear" : "");
    if (v->compositing.mode == SP_COMPOSITE_SLAB)
        printf(" %.2f%s", v->compositing.slab,
               v->transfer_function.order == SP_TF_POST ? " post" : "");
    printf("%s%s, %u planes, sigma %.2f, cutoff %.2f, low-pass %.2f\n",
           v->shading.mode == SP_SHADING_PHONG ? " phong" : "",
           v->transfer_function.gradient_count ? " gradient axis" : "", v->clip.plane_count,
           v->filter.sigma, v->filter.cutoff, v->filter.lowpass);
}

struct tally {
    unsigned ran, failed, unsupported;
    double worst[KINDS]; /* dB */
};

/* A backend with an instruction set, and its results. */
struct subject {
    struct test_target target;
    struct test_renderer renderer;
    char name[64];
    unsigned step; /* draws every step-th scene */
    struct tally tally;
};

/* A scene and its images by the formulas, which all targets share. */
struct task {
    unsigned seed;
    struct test_scene scene;
    struct test_image wanted;
    struct test_image uncut; /* with CUTOFF_FAR; rendered on demand, rgba is NULL before */
};

static bool begin_task(struct task *task, unsigned seed) {
    *task = (struct task){ .seed = seed };
    return draw(&task->scene, seed) &&
           test_formula_render(&task->scene, RANGE * cell(&task->scene.info.grid), &task->wanted);
}

static void end_task(struct task *task) {
    test_image_finish(&task->wanted);
    test_image_finish(&task->uncut);
    test_scene_finish(&task->scene);
}

static double compare_uncut(struct task *task, const struct test_image *image) {
    struct test_scene far = task->scene;
    far.view.filter.cutoff = CUTOFF_FAR;
    if (!task->uncut.rgba && !test_formula_render(&far, RANGE * cell(&far.info.grid), &task->uncut))
        return NAN;
    return test_image_psnr(image, &task->uncut);
}

static void report_failure(const struct task *task, const char *name,
                           const struct test_image *image, double psnr) {
    struct test_difference d = test_image_difference(image, &task->wanted);
    char dump[128];
    printf("FAILED %s: largest difference at (%u,%u) channel %u: %.5f, expected %.5f; ", name, d.x,
           d.y, d.channel, d.a, d.b);
    describe(&task->scene, task->seed, psnr);
    snprintf(dump, sizeof dump, "formula-%u", task->seed);
    test_image_dump(dump, image, &task->wanted, 20);
}

static bool check(struct subject *subject, struct task *task) {
    static const double floors[KINDS] = { FLOOR, FLOOR_QUANTISED, FLOOR_FLAT, FLOOR_SHEETS };
    struct test_image image;
    struct sp_error err;
    if (!test_render_scene(&subject->renderer, &task->scene, &image, &err)) {
        if (err.code == SP_ERR_UNSUPPORTED && strcmp(subject->target.backend, "cpu") != 0) {
            subject->tally.unsupported++;
            return true;
        }
        printf("FAILED %s seed %u: %s: %s\n", subject->name, task->seed, err.place, err.text);
        return false;
    }
    enum kind kind = kind_of(&subject->target, &task->scene);
    double psnr = test_image_psnr(&image, &task->wanted);
    if (kind == SHEETS)
        psnr = fmax(psnr, compare_uncut(task, &image));
    bool ok = psnr >= floors[kind];
    subject->tally.worst[kind] = fmin(subject->tally.worst[kind], psnr);
    if (!ok)
        report_failure(task, subject->name, &image, psnr);
    test_image_finish(&image);
    return ok;
}

/* Opens the targets with this instruction set (NULL = all targets). Returns the number of targets
 * that start on this machine. */
static unsigned open_all(struct subject subjects[], const char *isa, bool is_range) {
    struct test_target target;
    unsigned count = 0;
    for (unsigned i = 0; test_target_at(i, &target) && count < SUBJECTS_MAX; i++) {
        struct subject *subject = &subjects[count];
        struct sp_error err;
        if (isa && strcmp(isa, target.isa) != 0)
            continue;
        *subject = (struct subject){ .target = target, .step = 1 };
        for (int k = 0; k < KINDS; k++)
            subject->tally.worst[k] = INFINITY;
        snprintf(subject->name, sizeof subject->name, "%s/%s", target.backend, target.isa);
        /* Software GL is slow: it draws a tenth of the scenes. */
        if (strcmp(target.backend, "gl-software") == 0 && !is_range)
            subject->step = 10;
        if (test_renderer_open(&subject->renderer, &target, 2, &err))
            count++;
        else
            printf("skipped: %s: %s\n", subject->name, err.text);
    }
    return count;
}

static void run(struct subject subjects[], unsigned count, unsigned first, unsigned end,
                unsigned step) {
    for (unsigned seed = first; seed < end; seed += step) {
        struct task task;
        bool has_task = begin_task(&task, seed);
        if (!has_task)
            printf("FAILED seed %u: out of memory\n", seed);
        for (unsigned i = 0; i < count; i++)
            if ((seed - first) % subjects[i].step == 0) {
                subjects[i].tally.ran++;
                subjects[i].tally.failed += !has_task || !check(&subjects[i], &task);
            }
        end_task(&task);
    }
}

int main(int argc, char **argv) {
    struct subject subjects[SUBJECTS_MAX];
    unsigned first = 0, end = SCENES, ran = 0, failed = 0;
    unsigned step = TEST_SANITIZED && argc < 2 ? 8 : 1;
    if (argc > 1) {
        first = (unsigned)strtoul(argv[1], NULL, 10);
        end = argc > 2 ? (unsigned)strtoul(argv[2], NULL, 10) : first + 1;
    }
    sp_log_init(NULL, NULL, SP_LOG_ERROR); /* refusals are printed here as skips */
    unsigned count = open_all(subjects, argc > 3 ? argv[3] : NULL, argc > 1);
    if (step > 1)
        printf("reduced under a sanitizer: one of every %u scenes\n", step);
    run(subjects, count, first, end, step);
    for (unsigned i = 0; i < count; i++) {
        const struct tally *t = &subjects[i].tally;
        printf("%s: lowest PSNR %.1f dB, with quantised gradients %.1f dB, flat %.1f dB, "
               "post-convolved sheets %.1f dB; %u scenes are not supported\n",
               subjects[i].name, t->worst[PLAIN], t->worst[QUANTISED], t->worst[FLAT],
               t->worst[SHEETS], t->unsupported);
        test_renderer_close(&subjects[i].renderer);
        ran += t->ran - t->unsupported;
        failed += t->failed;
    }
    printf("%u of %u scenes failed\n", failed, ran);
    return failed ? EXIT_FAILURE : ran ? EXIT_SUCCESS : TEST_SKIPPED;
}
