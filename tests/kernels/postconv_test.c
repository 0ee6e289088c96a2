/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares sp_postconv_tile() of every instruction set with the formulas in double precision
 * (support/formula.h). The voxels are random, from a third of a pixel wide to wider than a tile;
 * guard zones surround the memory. The difference between a B-spline with a filter and a Gaussian
 * is small; these tests bound it.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/cpu/kernels.h"
#include "support/compare.h"
#include "support/formula.h"
#include "support/image.h"
#include "support/postconv.h"
#include "support/render.h"
#include "support/sanitized.h"

enum { GUARD = 4096, SETS = 8, SCENES = TEST_SANITIZED ? 40 : 160 };
#define CUTOFF 6 /* of the formulas, and of footprints in bricks that need them */

/* Measured against the formulas: 56.46 dB, largest difference 0.0223. Measured between instruction
 * sets: 102 dB in general; 85 dB where rounding selects another of two neighbouring phases of the
 * tables; 81.8 dB where a pixel becomes opaque one sheet earlier. */
#define FORMULA_FLOOR 56
#define FORMULA_SLACK 0.025
#define SETS_FLOOR 84
#define SEAM 1.2e-3 /* measured: 1.005e-3, for voxels narrower than pixels */

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

/* Finds the instruction sets that this build and this machine support. Returns their number. */
static unsigned collect_sets(struct cpu_kernels sets[SETS]) {
    unsigned count = 0;
    const char *isa;
    for (unsigned i = 0; (isa = cpu_isa_at(i)); i++) {
        struct sp_error err;
        if (!cpu_kernels_init(&sets[count], isa, &err))
            printf("skipped: %s: %s\n", isa, err.text);
        else
            count++;
    }
    return count;
}

/* Allocates `size` bytes between two guard zones. The bytes are zero. */
static void *make_zone(size_t size) {
    size_t whole = (2 * GUARD + size + 63) & ~(size_t)63;
    unsigned char *memory = aligned_alloc(64, whole);
    assert_non_null(memory);
    memset(memory, 0x5a, whole);
    memset(memory + GUARD, 0, size);
    return memory + GUARD;
}

static void free_zone(void *zone, size_t size) {
    unsigned char *memory = (unsigned char *)zone - GUARD;
    for (size_t i = 0; i < GUARD; i++) {
        assert_int_equal(memory[i], 0x5a);
        assert_int_equal(memory[GUARD + size + i], 0x5a);
    }
    free(memory);
}

static void is_zero(const void *memory, size_t size) {
    const uint32_t *words = memory;
    for (size_t i = 0; i < size / 4; i++)
        assert_int_equal(words[i], 0);
}

/* The kernels that draw, and counts of the bricks that they drew. */
struct drawing {
    const struct cpu_kernels *kernels;
    unsigned scales[POSTCONV_SCALES]; /* post-convolved bricks, by the scale of their samples */
    unsigned unfit;                   /* bricks drawn with footprints */
    unsigned diagonal;                /* bricks with a diagonal filter */
};

static void note_bricks(const struct sp_postconv *s, struct drawing *d) {
    for (uint32_t i = 0; i < s->brick_count; i++) {
        const struct sp_postconv_brick *b = &s->bricks[i];
        struct sp_postconv_group g;
        if (b->is_unfit || !sp_postconv_group_init(s, b, b->range, &g)) {
            d->unfit++;
            continue;
        }
        d->scales[g.scale[0]]++;
        d->diagonal += g.diagonal != NULL;
    }
}

/* Draws one tile with its own scratch memory between guard zones. */
static void draw_guarded(const struct sp_postconv *s, struct sp_postconv_scratch *scratch,
                         uint32_t tile) {
    struct drawing *d = test_postconv_of(s)->user;
    size_t runs = (size_t)(s->first[tile + 1] - s->first[tile]) * SP_BRICK * sizeof *scratch->runs;
    size_t starts = (s->layers + (size_t)1) * sizeof *scratch->starts;
    struct sp_postconv_scratch *own = make_zone(sizeof *own);
    size_t grid = POSTCONV_GRID * sizeof *own->grid;
    own->grid = make_zone(grid);
    own->runs = make_zone(runs);
    own->starts = make_zone(starts);
    own->ends = make_zone(starts);
    if (tile == 0)
        note_bricks(s, d);
    d->kernels->postconv_tile(s, own, tile);
    is_zero(own->grid, grid); /* the next tile expects zeros */
    is_zero(own->skew, sizeof own->skew);
    is_zero(own->across, sizeof own->across);
    is_zero(own->sum, sizeof own->sum);
    scratch->splats += own->splats;
    scratch->fragments += own->fragments;
    free_zone(own->grid, grid);
    free_zone(own->runs, runs);
    free_zone(own->starts, starts);
    free_zone(own->ends, starts);
    free_zone(own, sizeof *own);
}

/* Draws the frame. Fails if the bytes between its rows change. */
static void draw(struct test_postconv *t, struct sp_frame *frame, struct drawing *d) {
    struct sp_error err;
    size_t row = (size_t)frame->width * (frame->format == SP_RGBAF32 ? 16 : 4);
    memset(frame->pixels, 0x5a, frame->height * frame->stride_bytes);
    t->user = d;
    t->target = frame;
    assert_true(test_postconv_draw(t, draw_guarded, NULL, &err));
    for (size_t y = 0; y < frame->height; y++)
        for (size_t x = row; x < frame->stride_bytes; x++)
            assert_int_equal(((unsigned char *)frame->pixels)[y * frame->stride_bytes + x], 0x5a);
}

static double sparse(const void *user, double x, double y, double z) {
    const double *density = user;
    (void)x, (void)y, (void)z;
    return uniform(0, 1) < *density ? uniform(20, 120) : 0;
}

/* Makes scene n; n % 8 determines the width of a voxel. */
static void make_scene(struct test_scene *s, int n) {
    static const enum sp_filter_mode filters[] = { SP_FILTER_EWA, SP_FILTER_RECONSTRUCTION,
                                                   SP_FILTER_EWA, SP_FILTER_SWAN,
                                                   SP_FILTER_EWA, SP_FILTER_LOWPASS };
    struct sp_view *v = &s->view;
    double px = pow(2, n % 8 - 1) * uniform(0.7, 1.8), density = px > 8 ? 0.3 : 0.05;
    uint32_t across = (uint32_t)fmax(3, fmin(40, 150 / px)), layers = 1 + (uint32_t)n % 3 * 2;
    test_view_init(v);
    test_scene_points(s,
                      (const double[][5]){ { 10, 1, 0.5, 0, 0 },
                                           { 20, 1, 0.2, 0, 0.05 },
                                           { 80, 0, 0.8, 0.3, 0.3 },
                                           { 120, 0.5, 0.5, 1, 0.7 } },
                      4);
    double wide = n % 5 == 1 ? uniform(1, 2) : 1;
    assert_true(test_scene_voxels(s, "random voxels", (uint32_t[]){ across, across, layers },
                                  (double[]){ wide, 1, n % 2 ? 1 : 2 },
                                  n % 3 == 0 ? SP_FLOAT32 : SP_UINT8, sparse, &density));
    double shear = n % 9 == 4 ? uniform(-0.4, 0.4) : 0;
    test_scene_direction(s, (double[]){ 0, 0, n % 4 < 2 ? 0 : uniform(-45, 45) }, 1, shear);
    v->size[0] = (uint32_t)(64 + (int)uniform(-40, 140));
    v->size[1] = (uint32_t)(64 + (int)uniform(-40, 100));
    bool is_flat = n % 4 == 1;
    double distance = 60 + across, tilt = is_flat ? 0 : 30;
    double elevation = uniform(-tilt, tilt), azimuth = uniform(-tilt, tilt);
    test_scene_orbit(s, NULL, azimuth, elevation, distance);
    v->camera.projection = n % 2 ? SP_PERSPECTIVE : SP_ORTHOGRAPHIC;
    v->camera.height = v->size[1] / px;
    v->camera.fov_y = 360 / M_PI * atan(0.5 * v->size[1] / px / distance);
    v->filter.cutoff = CUTOFF;
    v->filter.lowpass = n % 3 ? 1 : 0.6;
    v->filter.mode = px < 4 ? filters[n % 6] : filters[n % 5];
    v->compositing.attenuation = n % 7 == 3 ? SP_ATTENUATION_LINEAR : SP_ATTENUATION_EXPONENTIAL;
    v->shading.mode = n % 5 == 2 ? SP_SHADING_PHONG : SP_SHADING_NONE;
    if (n % 6 == 5) {
        v->transfer_function.gradient_count = 2;
        v->transfer_function.gradient[0] = (struct sp_gradient_point){ 0, 0.2F };
        v->transfer_function.gradient[1] = (struct sp_gradient_point){ 60, 1 };
    }
    for (int c = 0; c < 4; c++)
        v->background[c] = n % 2 ? (float)uniform(0, 1) : (float)(c == 3);
}

/* The RGBA8 frame must equal the float frame, rounded. */
static void check_bytes(struct test_postconv *t, const struct test_image *floats,
                        struct drawing *d) {
    struct sp_error err;
    struct test_image image;
    struct sp_frame *frame =
        sp_frame_create(t->frames, t->frame->width, t->frame->height, SP_RGBA8, &err);
    assert_non_null(frame);
    draw(t, frame, d);
    assert_true(test_image_from_frame(&image, frame));
    size_t values = (size_t)image.width * image.height * 4;
    for (size_t k = 0; k < values; k++) {
        double alpha = floats->rgba[k | 3]; /* RGBA8 cannot store a colour above alpha */
        assert_compare(fabs(image.rgba[k] - fmin(floats->rgba[k], alpha)), <, 1.05 / 255);
    }
    test_image_finish(&image);
    sp_frame_unref(&frame);
}

static void tiles_match_the_formulas(void **state) {
    (void)state;
    struct cpu_kernels sets[SETS];
    unsigned count = collect_sets(sets);
    struct drawing seen = { 0 };
    double lowest = INFINITY, lowest_between = INFINITY;
    if (!count)
        skip();
    srand(31);
    for (int n = 0; n < SCENES; n++) {
        struct test_scene scene;
        struct test_image wanted, image, first = { 0 };
        struct sp_error err;
        make_scene(&scene, n);
        assert_true(test_formula_render(&scene, 0, &wanted));
        for (unsigned i = 0; i < count; i++) {
            struct test_postconv *t = test_postconv_open(&scene, 1, &err);
            if (!t)
                fail_msg("%s", err.text);
            seen.kernels = &sets[i];
            draw(t, t->frame, &seen);
            assert_true(test_image_from_frame(&image, t->frame));
            check_bytes(t, &image, &seen);
            double psnr = test_image_psnr(&image, &wanted);
            struct test_difference e = test_image_difference(&image, &wanted);
            lowest = fmin(lowest, psnr);
            if (!(psnr >= FORMULA_FLOOR && e.largest < FORMULA_SLACK))
                fail_msg("scene %d, %s: %.2f dB, floor %d; largest difference at (%u,%u) channel "
                         "%u: %g, expected %g within %g",
                         n, sets[i].isa, psnr, FORMULA_FLOOR, e.x, e.y, e.channel, e.a, e.b,
                         FORMULA_SLACK);
            if (i == 0) {
                first = image;
            } else {
                lowest_between = fmin(lowest_between, test_image_psnr(&image, &first));
                assert_compare(lowest_between, >=, SETS_FLOOR);
                test_image_finish(&image);
            }
            test_postconv_close(t);
        }
        test_image_finish(&first);
        test_image_finish(&wanted);
        test_scene_finish(&scene);
    }
    print_message("  lowest PSNR %.2f dB against the formulas, %.2f dB between instruction sets; "
                  "bricks by scale:",
                  lowest, lowest_between);
    for (int j = 0; j < POSTCONV_SCALES; j++) {
        print_message(" %u", seen.scales[j]);
        assert_compare(seen.scales[j], >, 0); /* the scenes cover every scale */
    }
    print_message(", %u with a diagonal filter, %u with footprints\n", seen.diagonal, seen.unfit);
    assert_compare(seen.diagonal, >, 0);
    assert_compare(seen.unfit, >, 0);
}

static double one(const void *user, double x, double y, double z) {
    (void)user, (void)x, (void)y, (void)z;
    return 1;
}

/* Returns the largest relative difference between a pixel and its right or lower neighbour. */
static double compute_step(const struct test_image *image) {
    double most = 0;
    for (unsigned y = 0; y + 1 < image->height; y++)
        for (unsigned x = 0; x + 1 < image->width; x++)
            for (int c = 0; c < 4; c++) {
                double here = test_image_at(image, x, y)[c];
                most = fmax(most, fabs(test_image_at(image, x + 1, y)[c] / here - 1));
                most = fmax(most, fabs(test_image_at(image, x, y + 1)[c] / here - 1));
            }
    return most;
}

/* Inside a wide plate of constant value, the borders of tiles and bricks are invisible. */
static void tiles_have_no_seams(void **state) {
    (void)state;
    static const double widths[] = { 0.7, 2.3, 3, 5.5, 12, 30 }; /* px per voxel */
    struct cpu_kernels sets[SETS];
    unsigned count = collect_sets(sets);
    if (!count)
        skip();
    for (int n = 0; n < 24; n++) {
        double px = widths[n % 6], tilt = n / 12 * 12;
        struct test_scene scene;
        struct test_image image;
        struct sp_error err;
        test_view_init(&scene.view);
        test_scene_points(
            &scene, (const double[][5]){ { 0, 1, 0.6, 0.3, 0.2 }, { 1, 1, 0.6, 0.3, 0.2 } }, 2);
        uint32_t across = (uint32_t)(300 / px) + 24;
        assert_true(test_scene_voxels(&scene, "plate", (uint32_t[]){ across, across, 2 },
                                      (double[]){ 1, 1, 1 }, SP_UINT8, one, NULL));
        struct sp_view *v = &scene.view;
        v->size[0] = 200;
        v->size[1] = 150;
        test_scene_orbit(&scene, NULL, tilt, 0.5 * tilt, 20.0 * across);
        v->camera.projection = n / 6 % 2 ? SP_PERSPECTIVE : SP_ORTHOGRAPHIC;
        v->camera.height = 150 / px;
        v->camera.fov_y = 360 / M_PI * atan(0.5 * 150 / px / (20.0 * across));
        for (unsigned i = 0; i < count; i++) {
            struct drawing seen = { .kernels = &sets[i] };
            struct test_postconv *t = test_postconv_open(&scene, 1, &err);
            assert_non_null(t);
            draw(t, t->frame, &seen);
            assert_true(test_image_from_frame(&image, t->frame));
            double step = compute_step(&image);
            if (!(step < SEAM) || seen.unfit)
                fail_msg("plate %d, %s: neighbouring pixels differ by %g, limit %g; %u bricks use "
                         "footprints, expected 0",
                         n, sets[i].isa, step, SEAM, seen.unfit);
            test_image_finish(&image);
            test_postconv_close(t);
        }
        test_scene_finish(&scene);
    }
}

/* Makes a scene with an extreme but valid camera: inside the volume, at a voxel, with a field of
 * view of up to 170°, in units of length from 1e-9 to 1e9. */
static void make_extreme(struct test_scene *s, int n) {
    static const double units[] = { 1, 1e-6, 1e6, 1e-9, 1e9 };
    struct sp_view *v = &s->view;
    double density = uniform(0.02, 1), unit = units[n % 5], eye[3];
    test_view_init(v);
    test_scene_points(s, (const double[][5]){ { 19, 1, 1, 1, 0 }, { 20, 0, 1, 1, 0.999 } }, 2);
    double spacing[] = { unit, unit * pow(10, uniform(-2, 2)), unit * pow(10, uniform(-1, 1)) };
    uint32_t dims[3];
    for (int a = 0; a < 3; a++)
        dims[a] = 1 + (uint32_t)uniform(0, 40);
    assert_true(test_scene_voxels(s, "extreme", dims, spacing, n % 3 ? SP_UINT8 : SP_FLOAT32,
                                  sparse, &density));
    double shear = uniform(-2, 2);
    test_scene_direction(s, (double[]){ uniform(-180, 180), uniform(-180, 180), 0 }, n % 2 ? 1 : -1,
                         shear);
    const struct sp_grid *grid = &s->info.grid;
    for (int a = 0; a < 3; a++)
        eye[a] = unit * uniform(-1, 1) * grid->dims[a];
    double distance = unit * pow(10, uniform(-3, n % 4 ? 2 : 6));
    double elevation = uniform(-89, 89), azimuth = uniform(-180, 180);
    test_scene_orbit(s, eye, azimuth, elevation, distance);
    v->size[0] = 1 + (uint32_t)uniform(0, 150);
    v->size[1] = 1 + (uint32_t)uniform(0, 150);
    v->camera.projection = n % 4 == 1 ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
    v->camera.height = unit * pow(10, uniform(-3, 4));
    v->camera.fov_y = n % 3 ? 170 : uniform(1, 170);
    v->camera.near = unit * (n % 7 ? 1e-3 : 3);
    v->transfer_function.reference_length = unit * pow(10, uniform(-3, 3));
    v->filter.mode = (enum sp_filter_mode)(n % 5); /* all except none */
    v->filter.sigma = n % 6 ? uniform(0.3, 2) : 2;
    v->filter.lowpass = n % 6 == 1 ? 0 : uniform(0, 4);
    v->compositing.attenuation = n % 2 ? SP_ATTENUATION_LINEAR : SP_ATTENUATION_EXPONENTIAL;
    v->shading.mode = n % 4 == 2 ? SP_SHADING_PHONG : SP_SHADING_NONE;
}

static void extreme_cameras_give_a_finite_image(void **state) {
    (void)state;
    struct cpu_kernels sets[SETS];
    unsigned count = collect_sets(sets), drawn = 0;
    if (!count)
        skip();
    srand(32);
    for (int n = 0; n < 300; n++) {
        struct test_scene scene;
        struct test_image image;
        struct sp_error err;
        struct drawing seen = { .kernels = &sets[(unsigned)n % count] };
        make_extreme(&scene, n);
        if (!sp_view_validate(&scene.view, &err))
            fail_msg("scene %d: %s: %s", n, err.place, err.text);
        struct test_postconv *t = test_postconv_open(&scene, 1, &err);
        if (!t)
            fail_msg("scene %d: %s", n, err.text);
        draw(t, t->frame, &seen);
        drawn += t->frame->stats.splats > 0;
        assert_true(test_image_from_frame(&image, t->frame));
        for (size_t k = 0; k < (size_t)image.width * image.height * 4; k++)
            if (!(image.rgba[k] > -1e-4 && (image.rgba[k] < 1.0001 || k % 4 < 3) &&
                  isfinite(image.rgba[k])))
                fail_msg("scene %d: channel %zu of pixel %zu is out of range: %g", n, k % 4, k / 4,
                         image.rgba[k]);
        test_image_finish(&image);
        test_postconv_close(t);
        test_scene_finish(&scene);
    }
    print_message("  %u of 300 images contain splats\n", drawn);
    assert_compare(drawn, >, 100);
}

static void draw_unguarded(const struct sp_postconv *s, struct sp_postconv_scratch *scratch,
                           uint32_t tile) {
    const struct drawing *d = test_postconv_of(s)->user;
    d->kernels->postconv_tile(s, scratch, tile);
}

/* The image does not depend on the thread that draws a tile, nor on the tiles that this thread drew
 * before. */
static void one_and_five_threads_draw_the_same_frame(void **state) {
    (void)state;
    struct cpu_kernels sets[SETS];
    unsigned count = collect_sets(sets);
    if (!count)
        skip();
    srand(33);
    for (int n = 0; n < 24; n++) {
        struct test_scene scene;
        struct sp_error err;
        struct drawing d = { .kernels = &sets[(unsigned)n % count] };
        struct test_postconv *t[2];
        make_scene(&scene, n);
        scene.view.size[0] = 330;
        scene.view.size[1] = 270;
        scene.view.filter.mode = n % 2 ? SP_FILTER_ADAPTIVE : SP_FILTER_EWA;
        for (int k = 0; k < 2; k++) {
            t[k] = test_postconv_open(&scene, k ? 5 : 1, &err);
            assert_non_null(t[k]);
            t[k]->user = &d;
            assert_true(test_postconv_draw(t[k], draw_unguarded, NULL, &err));
        }
        assert_true(test_frames_equal(t[0]->frame, t[1]->frame));
        assert_int_equal(t[0]->frame->stats.splats, t[1]->frame->stats.splats);
        assert_int_equal(t[0]->frame->stats.fragments, t[1]->frame->stats.fragments);
        for (int k = 0; k < 2; k++)
            test_postconv_close(t[k]);
        test_scene_finish(&scene);
    }
}

/* Overrides how bricks are drawn: all with footprints, or all post-convolved. */
struct forced {
    const struct cpu_kernels *kernels;
    bool is_unfit;
};

static void draw_forced(const struct sp_postconv *s, struct sp_postconv_scratch *scratch,
                        uint32_t tile) {
    const struct forced *forced = test_postconv_of(s)->user;
    size_t bytes = s->brick_count * sizeof *s->bricks;
    struct sp_postconv own = *s;
    own.bricks = malloc(bytes);
    assert_non_null(own.bricks);
    memcpy(own.bricks, s->bricks, bytes);
    for (uint32_t i = 0; i < s->brick_count; i++) {
        own.bricks[i].is_unfit = forced->is_unfit;
        own.bricks[i].scale_max[0] = own.bricks[i].scale_max[1] = 0;
    }
    forced->kernels->postconv_tile(&own, scratch, tile);
    free(own.bricks);
}

/* Samples are limited to the width of a pixel. Post-convolution then applies to the far voxels of a
 * brick only, or to no voxel. The tile must draw the other voxels with footprints, each voxel
 * once. */
static void voxels_that_filters_cannot_draw_get_footprints(void **state) {
    (void)state;
    struct cpu_kernels sets[SETS];
    unsigned count = collect_sets(sets);
    double lowest = INFINITY;
    if (!count)
        skip();
    srand(35);
    for (int n = 0; n < 24; n++) {
        struct test_scene scene;
        struct test_image images[2];
        struct sp_error err;
        double density = 0.3;
        make_scene(&scene, n);
        free(scene.voxels);
        assert_true(test_scene_voxels(&scene, "near", (uint32_t[]){ 30, 30, 20 },
                                      (double[]){ 1, 1, 1 }, SP_UINT8, sparse, &density));
        double elevation = uniform(-40, 40), azimuth = uniform(-40, 40);
        test_scene_orbit(&scene, NULL, azimuth, elevation, 50);
        scene.view.camera.projection = SP_PERSPECTIVE;
        scene.view.camera.fov_y = 360 / M_PI * atan(0.5 * scene.view.size[1] / (50 * 3.5));
        scene.view.filter.mode = SP_FILTER_EWA;
        scene.view.filter.sigma = uniform(0.5, 1.2);
        for (int k = 0; k < 2; k++) {
            struct forced forced = { .kernels = &sets[(unsigned)n % count], .is_unfit = k };
            struct test_postconv *t = test_postconv_open(&scene, 1, &err);
            assert_non_null(t);
            t->user = &forced;
            assert_true(test_postconv_draw(t, draw_forced, NULL, &err));
            assert_compare(t->frame->stats.splats, >, 0);
            assert_true(test_image_from_frame(&images[k], t->frame));
            test_postconv_close(t);
        }
        lowest = fmin(lowest, test_image_psnr(&images[0], &images[1]));
        for (int k = 0; k < 2; k++)
            test_image_finish(&images[k]);
        test_scene_finish(&scene);
    }
    print_message("  lowest PSNR against footprints %.2f dB\n", lowest);
    assert_compare(lowest, >, FORMULA_FLOOR);
}

/* Cancels the frame when its first tile begins. */
struct late_cancel {
    const struct cpu_kernels *kernels;
    atomic_bool cancel;
    uint64_t splats;
};

static void cancel_and_draw(const struct sp_postconv *s, struct sp_postconv_scratch *scratch,
                            uint32_t tile) {
    struct late_cancel *late = test_postconv_of(s)->user;
    atomic_store(&late->cancel, true);
    late->kernels->postconv_tile(s, scratch, tile);
    late->splats += scratch->splats;
}

static void a_tile_stops_when_cancelled(void **state) {
    (void)state;
    struct cpu_kernels sets[SETS];
    unsigned count = collect_sets(sets);
    struct test_scene scene;
    struct sp_error err;
    if (!count)
        skip();
    srand(34);
    make_scene(&scene, 2);
    for (unsigned i = 0; i < count; i++) {
        struct drawing d = { .kernels = &sets[i] };
        struct late_cancel late = { .kernels = &sets[i] };
        struct test_postconv *t = test_postconv_open(&scene, 1, &err);
        assert_non_null(t);
        t->user = &d;
        assert_true(test_postconv_draw(t, draw_unguarded, NULL, &err));
        assert_compare(t->frame->stats.splats, >, 0);
        t->user = &late;
        assert_false(test_postconv_draw(t, cancel_and_draw, &late.cancel, &err));
        assert_int_equal(err.code, SP_ERR_CANCELLED);
        assert_int_equal(late.splats, 0); /* it draws no layer after the cancellation */
        test_postconv_close(t);
    }
    test_scene_finish(&scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tiles_match_the_formulas),
        cmocka_unit_test(tiles_have_no_seams),
        cmocka_unit_test(extreme_cameras_give_a_finite_image),
        cmocka_unit_test(one_and_five_threads_draw_the_same_frame),
        cmocka_unit_test(voxels_that_filters_cannot_draw_get_footprints),
        cmocka_unit_test(a_tile_stops_when_cancelled),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
