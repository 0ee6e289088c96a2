/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares dense sheets that are drawn by shear and warp (draw/postconv/shear.h), by every
 * instruction set, with the formulas in double precision (support/formula.h), with each other and
 * with another number of threads; and checks which views are left to tiles of the image.
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

enum { SETS = 8, SCENES = TEST_SANITIZED ? 4 : 24 };

/* Measured: 51.79 dB, and 133.75 dB between instruction sets. */
#define FORMULA_FLOOR 51
#define SETS_FLOOR 110

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

/* Finds the instruction sets that this build and this machine support. Returns their number. */
static unsigned find_sets(struct cpu_kernels sets[SETS]) {
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

/* Waves, and noise of an amplitude; some voxels have no value, if a share of holes is given. */
struct field {
    double noise, holes;
};

static double waves(const void *user, double x, double y, double z) {
    const struct field *f = user;
    if (uniform(0, 1) < f->holes)
        return 0;
    return 128 + 60 * sin(0.4 * x + 0.15 * y) * cos(0.33 * z - 0.2 * y) + f->noise * uniform(-1, 1);
}

/* Makes a volume of 150,000 voxels with opacities up to `opacity`. */
static void make_volume(struct test_scene *s, const uint32_t dims[3], const double spacing[3],
                        enum sp_type type, double opacity, const struct field *field) {
    test_view_init(&s->view);
    test_scene_points(s,
                      (const double[][5]){ { 1, 0.2, 0.4, 1, 0 },
                                           { 60, 0.2, 0.6, 1, 0.05 * opacity },
                                           { 120, 0.3, 0.8, 0.3, 0.2 * opacity },
                                           { 180, 1, 0.5, 0.2, opacity },
                                           { 255, 1, 1, 1, opacity } },
                      5);
    assert_true(test_scene_voxels(s, "waves", dims, spacing, type, waves, field));
    s->view.filter.mode = SP_FILTER_ADAPTIVE;
    s->view.filter.cutoff = 6;
}

/* Makes scene n. */
static void make_scene(struct test_scene *s, int n) {
    static const uint32_t dims[][3] = { { 64, 56, 48 }, { 40, 80, 60 }, { 100, 33, 50 } };
    static const double spacing[][3] = { { 1, 1, 1 }, { 1, 1, 1 }, { 1, 1.5, 1 }, { 1, 1, 2 } };
    static const enum sp_type types[] = { SP_UINT8, SP_FLOAT32, SP_UINT16, SP_UINT8 };
    const struct field field = { n % 3 == 1 ? 60 : 0, n % 5 == 2 ? 0.2 : 0 };
    make_volume(s, dims[n % 3], spacing[n % 4], types[n % 4], n % 2 ? 0.4 : 0.1, &field);
    struct sp_view *v = &s->view;
    test_scene_direction(s, (double[]){ 0, 0, n % 6 == 5 ? uniform(-45, 45) : 0 }, 1, 0);
    double distance = uniform(160, 400);
    test_scene_orbit(s, NULL, uniform(-180, 180), uniform(-80, 80), distance);
    for (int a = 0; n % 4 == 3 && a < 3; a++) /* rolls the camera */
        v->camera.up[a] = uniform(-1, 1);
    v->size[0] = (uint32_t)uniform(90, 160);
    v->size[1] = (uint32_t)uniform(90, 160);
    double px = uniform(0.8, 2.4); /* of a voxel */
    v->camera.fov_y = 360 / M_PI * atan(0.5 * v->size[1] / px / distance);
    for (int c = 0; c < 4; c++)
        v->background[c] = n % 2 ? (float)uniform(0, 1) : (float)(c == 3);
}

/* Draws the scene into an image; false if it is left to tiles. */
static bool draw(const struct test_scene *scene, const struct cpu_kernels *kernels,
                 unsigned threads, struct test_image *image) {
    struct sp_error err;
    bool is_possible;
    struct test_postconv *t = test_postconv_open(scene, threads, &err);
    if (!t)
        fail_msg("%s", err.text);
    if (!test_postconv_draw_sheared(t, &kernels->shear, NULL, &is_possible, &err))
        fail_msg("%s", err.text);
    if (is_possible)
        assert_true(test_image_from_frame(image, t->frame));
    test_postconv_close(t);
    return is_possible;
}

static void sheets_match_the_formulas(void **state) {
    (void)state;
    struct cpu_kernels sets[SETS];
    unsigned count = find_sets(sets), drawn = 0;
    double lowest = INFINITY, lowest_between = INFINITY;
    srand(7);
    for (int n = 0; n < SCENES; n++) {
        struct test_scene scene;
        struct test_image wanted, first, image;
        make_scene(&scene, n);
        if (!draw(&scene, &sets[0], 1, &first)) {
            test_scene_finish(&scene);
            continue;
        }
        drawn++;
        scene.view.filter.mode = SP_FILTER_EWA;
        assert_true(test_formula_render(&scene, 0, &wanted));
        scene.view.filter.mode = SP_FILTER_ADAPTIVE;
        double psnr = test_image_psnr(&first, &wanted);
        lowest = fmin(lowest, psnr);
        if (!(psnr >= FORMULA_FLOOR))
            fail_msg("scene %d: %.2f dB, floor %d", n, psnr, FORMULA_FLOOR);
        for (unsigned i = 1; i < count; i++) {
            assert_true(draw(&scene, &sets[i], 1, &image));
            psnr = test_image_psnr(&image, &first);
            lowest_between = fmin(lowest_between, psnr);
            if (!(psnr >= SETS_FLOOR))
                fail_msg("scene %d, %s: %.2f dB, floor %d", n, sets[i].isa, psnr, SETS_FLOOR);
            test_image_finish(&image);
        }
        test_image_finish(&first);
        test_image_finish(&wanted);
        test_scene_finish(&scene);
    }
    print_message("  %u of %d scenes; lowest PSNR %.2f dB against the formulas, %.2f dB between "
                  "instruction sets\n",
                  drawn, SCENES, lowest, lowest_between);
    assert_compare(drawn, >=, 0.6 * SCENES);
}

static void threads_do_not_change_the_image(void **state) {
    (void)state;
    struct cpu_kernels kernels;
    struct test_scene scene;
    struct test_image one, three;
    assert_true(cpu_kernels_init(&kernels, "auto", NULL));
    const struct field field = { 30, 0.1 };
    make_volume(&scene, (uint32_t[]){ 64, 56, 48 }, (double[]){ 1, 1, 1 }, SP_UINT8, 0.3, &field);
    scene.view.size[0] = 400;
    scene.view.size[1] = 300;
    test_scene_orbit(&scene, NULL, 25, 20, 160);
    assert_true(draw(&scene, &kernels, 1, &one));
    assert_true(draw(&scene, &kernels, 3, &three));
    assert_memory_equal(one.rgba, three.rgba, 4 * sizeof *one.rgba * one.width * one.height);
    test_image_finish(&one);
    test_image_finish(&three);
    test_scene_finish(&scene);
}

static void a_cancelled_frame_ends(void **state) {
    (void)state;
    struct cpu_kernels kernels;
    struct test_scene scene;
    struct sp_error err;
    const atomic_bool cancel = true;
    bool is_possible;
    assert_true(cpu_kernels_init(&kernels, "auto", NULL));
    make_volume(&scene, (uint32_t[]){ 64, 56, 48 }, (double[]){ 1, 1, 1 }, SP_UINT8, 0.3,
                &(struct field){ 0 });
    test_scene_orbit(&scene, NULL, 25, 20, 160);
    struct test_postconv *t = test_postconv_open(&scene, 1, &err);
    assert_non_null(t);
    assert_false(test_postconv_draw_sheared(t, &kernels.shear, &cancel, &is_possible, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    test_postconv_close(t);
    test_scene_finish(&scene);
}

/* Views that this stage must not draw. */
static void other_views_are_left_to_tiles(void **state) {
    (void)state;
    enum {
        LIT,
        ORTHOGRAPHIC,
        LINEAR,
        EXACT,
        SPARSE,
        INSIDE,
        OBLIQUE_GRID,
        SCALED,
        POSSIBLE,
        CASES
    };
    struct cpu_kernels kernels;
    assert_true(cpu_kernels_init(&kernels, "auto", NULL));
    for (int n = 0; n < CASES; n++) {
        struct test_scene scene;
        struct test_image image;
        const struct field field = { 0, n == SPARSE ? 0.7 : 0 };
        make_volume(&scene, (uint32_t[]){ 64, 56, 48 }, (double[]){ 1, 1, 1 }, SP_UINT8, 0.3,
                    &field);
        struct sp_view *v = &scene.view;
        test_scene_orbit(&scene, NULL, 25, 20, n == INSIDE ? 10 : 160);
        v->camera.height = 100;
        v->shading.mode = n == LIT ? SP_SHADING_PHONG : SP_SHADING_NONE;
        v->camera.projection = n == ORTHOGRAPHIC ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
        v->filter.mode = n == EXACT ? SP_FILTER_EWA : SP_FILTER_ADAPTIVE;
        if (n == LINEAR)
            v->compositing.attenuation = SP_ATTENUATION_LINEAR;
        if (n == OBLIQUE_GRID)
            test_scene_direction(&scene, (double[]){ 0, 0, 0 }, 1, 0.3);
        if (n == SCALED) {
            v->transfer_function.gradient_count = 2;
            v->transfer_function.gradient[0] = (struct sp_gradient_point){ 0, 0.2F };
            v->transfer_function.gradient[1] = (struct sp_gradient_point){ 60, 1 };
        }
        bool is_drawn = draw(&scene, &kernels, 1, &image);
        if (is_drawn)
            test_image_finish(&image);
        if (is_drawn != (n == POSSIBLE))
            fail_msg("case %d: drawn %d, expected %d", n, is_drawn, n == POSSIBLE);
        test_scene_finish(&scene);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sheets_match_the_formulas),
        cmocka_unit_test(threads_do_not_change_the_image),
        cmocka_unit_test(a_cancelled_frame_ends),
        cmocka_unit_test(other_views_are_left_to_tiles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
