/* SPDX-License-Identifier: Apache-2.0
 *
 * Layers of trained Gaussians against the published formulas (support/trained.h), on every backend
 * and instruction set: degrees of the harmonics, projections, conventions, transforms, close-ups.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "support/compare.h"
#include "support/render.h"
#include "support/trained.h"

enum { COUNT = 400 };

struct scene {
    const char *name;
    unsigned degree;
    double distance, size; /* of the eye; of the Gaussians */
    bool is_parallel, is_normalised, is_turned;
    double floor; /* dB; half a decibel below the measured value */
};

static const struct scene scenes[] = {
    { "degree 0", 0, 30, 0.5, false, false, false, 108.7 },
    { "degree 1", 1, 30, 0.5, false, false, false, 143.1 },
    { "degree 2", 2, 30, 0.5, false, false, false, 144.2 },
    { "degree 3", 3, 30, 0.5, false, false, false, 112.4 },
    { "parallel", 3, 30, 0.5, true, false, false, 100.5 },
    { "normalised", 2, 60, 0.1, false, true, false, 161.5 },
    { "turned", 3, 30, 0.5, false, false, true, 113.4 },
    { "turned parallel", 3, 30, 0.5, true, false, true, 144.8 },
    { "inside", 1, 1, 0.3, false, false, false, 140.2 },
    { "thin", 1, 30, 0.02, false, true, false, 170.8 },
};
enum { SCENES = sizeof scenes / sizeof scenes[0] };

static double random_in(unsigned *seed, double low, double high) {
    *seed = *seed * 1664525u + 1013904223u;
    return low + (high - low) * (*seed >> 8) / 16777216.0;
}

static void make_gaussians(const struct scene *scene, struct test_gaussian gaussians[COUNT]) {
    unsigned seed = 7 + scene->degree;
    for (int i = 0; i < COUNT; i++) {
        struct test_gaussian *g = &gaussians[i];
        for (int a = 0; a < 3; a++) {
            g->position[a] = random_in(&seed, -5, 5);
            g->scales[a] = scene->size * exp(random_in(&seed, -2, 0.7));
        }
        for (int a = 0; a < 4; a++)
            g->rotation[a] = random_in(&seed, -1, 1);
        g->opacity = random_in(&seed, 0, 1);
        for (int k = 0; k < 48; k++)
            g->harmonics[k / 3][k % 3] = random_in(&seed, -1, 1) / (1 + k / 3);
    }
}

/* The floats that the renderer gets, so that both draw the same Gaussians. */
static void round_gaussians(struct test_gaussian gaussians[COUNT]) {
    for (int i = 0; i < COUNT; i++)
        for (int a = 0; a < 3; a++)
            gaussians[i].position[a] = (float)gaussians[i].position[a];
}

static struct sp_volume *make_volume(const struct scene *scene,
                                     const struct test_gaussian gaussians[COUNT]) {
    static float positions[COUNT][3], factors[COUNT][6], opacities[COUNT], harmonics[COUNT * 48];
    const struct sp_elements elements = {
        .shape = { .kind = SP_KIND_GAUSSIANS, .count = COUNT, .degree = scene->degree },
        .positions = positions,
        .factors = factors,
        .opacities = opacities,
        .harmonics = harmonics
    };
    for (unsigned i = 0; i < COUNT; i++)
        test_gaussian_store(&gaussians[i], &elements, i);
    return sp_volume_create_elements(&elements, scene->name, NULL);
}

static void make_view(const struct scene *scene, const struct sp_volume *volume,
                      struct sp_view *view) {
    sp_view_init(view, sp_volume_info(volume), "");
    view->size[0] = 96;
    view->size[1] = 80;
    for (int c = 0; c < 4; c++)
        view->background[c] = 0.25f * (float)c;
    view->camera =
        (struct sp_camera){ .projection = scene->is_parallel ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE,
                            .position = { 0.3 * scene->distance, 0.2 * scene->distance,
                                          -scene->distance },
                            .up = { 0.1, -1, 0 },
                            .fov_y = 35,
                            .height = 13,
                            .near = 0.2 };
    struct sp_layer *layer = &view->layers[0];
    layer->convention = scene->is_normalised ? SP_CONVENTION_NORMALISED : SP_CONVENTION_INRIA;
    layer->opacity = 0.9f;
    if (scene->is_turned) { /* by a right angle about two axes, half as large, moved */
        static const double turn[16] = { 0, 0, 0.5, 1, 0.5, 0, 0, -2, 0, 0.5, 0, 0.5, 0, 0, 0, 1 };
        for (int i = 0; i < 16; i++)
            layer->transform[i] = turn[i];
    }
}

static void gaussians_follow_the_formulas(void **state) {
    static struct test_gaussian gaussians[COUNT];
    struct test_image wanted[SCENES];
    struct sp_volume *volumes[SCENES];
    struct sp_view views[SCENES];
    struct test_target target;
    int failed = 0;
    (void)state;
    for (int i = 0; i < SCENES; i++) {
        make_gaussians(&scenes[i], gaussians);
        round_gaussians(gaussians);
        volumes[i] = make_volume(&scenes[i], gaussians);
        assert_non_null(volumes[i]);
        make_view(&scenes[i], volumes[i], &views[i]);
        assert_true(test_trained_render(gaussians, COUNT, scenes[i].degree, &views[i],
                                        &views[i].layers[0], &wanted[i]));
    }
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        if (!test_renderer_open(&renderer, &target, 2, NULL))
            continue;
        for (int i = 0; i < SCENES; i++) {
            struct test_image got;
            struct sp_error err = { .code = SP_OK };
            if (!test_render(&renderer, volumes[i], &views[i], &got, &err))
                fail_msg("%s: %s", scenes[i].name, err.text);
            double psnr = test_image_psnr(&got, &wanted[i]);
            printf("%-16s %-11s %-8s %6.2f dB\n", scenes[i].name, target.backend, target.isa, psnr);
            if (!(psnr >= scenes[i].floor))
                test_image_dump(scenes[i].name, &got, &wanted[i], 10);
            failed += !(psnr >= scenes[i].floor);
            test_image_finish(&got);
        }
        test_renderer_close(&renderer);
    }
    for (int i = 0; i < SCENES; i++) {
        test_image_finish(&wanted[i]);
        sp_volume_unref(&volumes[i]);
    }
    assert_int_equal(failed, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(gaussians_follow_the_formulas) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
