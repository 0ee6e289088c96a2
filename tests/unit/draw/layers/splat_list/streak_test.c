/* SPDX-License-Identifier: Apache-2.0
 *
 * Images of vectors: streaks lie along the vectors and move along them in every orientation, the
 * texture keeps the opacity of the samples, and what has no direction has no streaks.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "backend/cpu/kernels.h"
#include "support/compare.h"
#include "support/sanitized.h"
#include "support/shell.h"

enum { SIDE = 128 };

static double constant(const void *user, double x, double y, double z) {
    (void)user, (void)x, (void)y, (void)z;
    return 100;
}

static void uniform(const void *user, const double at[3], float v[3]) {
    const double *direction = user;
    (void)at;
    for (int c = 0; c < 3; c++)
        v[c] = (float)direction[c];
}

/* A cube of `side` equal samples, seen by a parallel projection of 12 px per sample. */
static void open_uniform(struct test_shell *rig, uint32_t side, const double direction[3],
                         double opacity) {
    const double points[][5] = { { 100, 1, 0.6, 0.2, opacity } };
    struct test_scene scene = { 0 };
    test_view_init(&scene.view);
    test_scene_points(&scene, points, 1);
    assert_true(test_scene_voxels(&scene, "uniform", (const uint32_t[3]){ side, side, side },
                                  (const double[3]){ 1, 1, 1 }, SP_UINT8, constant, NULL));
    test_scene_orbit(&scene, NULL, 0, 0, 100);
    scene.view.camera.projection = SP_ORTHOGRAPHIC;
    scene.view.size[0] = scene.view.size[1] = SIDE;
    scene.view.camera.height = SIDE / 12.0;
    test_shell_open(rig, &scene, 2);
    test_shell_add_vectors(rig, uniform, direction);
    rig->layer = sp_layer_default(SP_LAYER_VECTORS);
    rig->layer.density = 1;
    rig->layer.stretch = 1.5;
}

static void draw(struct test_shell *rig, double phase, struct test_image *image) {
    struct sp_error err = { 0 };
    rig->layer.phase = phase;
    if (!test_shell_draw(rig, image, &err))
        fail_msg("%s: %s", err.place, err.text);
}

/* Returns the optical depth that a pixel shows: -ln(1 - alpha). */
static double depth_at(const struct test_image *image, unsigned x, unsigned y) {
    return -log1p(-fmin(test_image_at(image, x, y)[3], 0.999999));
}

static double between(const struct test_image *image, double x, double y) {
    unsigned i = (unsigned)x, j = (unsigned)y;
    double u = x - i, v = y - j;
    return (1 - v) * ((1 - u) * depth_at(image, i, j) + u * depth_at(image, i + 1, j)) +
           v * ((1 - u) * depth_at(image, i, j + 1) + u * depth_at(image, i + 1, j + 1));
}

/* How well `b`, moved back by (dx, dy), agrees with `a`: the mean square of the difference. */
static double disagree(const struct test_image *a, const struct test_image *b, double dx,
                       double dy) {
    double sum = 0;
    for (unsigned y = 30; y < SIDE - 30; y++)
        for (unsigned x = 30; x < SIDE - 30; x++) {
            double d = between(b, x + dx, y + dy) - depth_at(a, x, y);
            sum += d * d;
        }
    return sum;
}

/* The camera-space direction of a vector: right, down, forward. */
static void to_camera(const struct test_shell *rig, const double d[3], double out[3]) {
    for (int r = 0; r < 3; r++)
        out[r] = rig->camera.w.m[r][0] * d[0] + rig->camera.w.m[r][1] * d[1] +
                 rig->camera.w.m[r][2] * d[2];
}

/* A tenth of a period moves the streaks along the projected vector, by a tenth of the period's
 * projection, whichever way the vector points and the camera looks. */
static void streaks_move_along_vectors(void **state) {
    (void)state;
    static const struct {
        double direction[3], azimuth, elevation;
    } cases[] = {
        { { 1, 0, 0 }, 0, 0 },     { { -1, 0, 0 }, 0, 0 },      { { 0, 1, 0 }, 0, 0 },
        { { 0, -2, 0 }, 0, 0 },    { { 0, 0, 1 }, 90, 0 },      { { 1, 0, 0 }, 180, 0 },
        { { 1, 2, 0.5 }, 25, 40 }, { { 0.3, -1, 1 }, 120, 20 },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct test_shell rig;
        struct test_image first, second;
        double d[3], length = 0, step, best = 0, least = INFINITY, wrong = INFINITY;
        const double *v = cases[i].direction;
        open_uniform(&rig, 9, v, 0.05);
        test_scene_orbit(&rig.scene, NULL, cases[i].azimuth, cases[i].elevation, 100);
        rig.layer.stretch = 2;
        draw(&rig, 0.2, &first);
        draw(&rig, 0.3, &second);
        for (int c = 0; c < 3; c++)
            length += v[c] * v[c];
        to_camera(&rig, v, d);
        double side = hypot(d[0], d[1]) / sqrt(length); /* the foreshortening */
        double wanted = 0.1 * SP_STREAK_PERIOD * rig.scene.view.filter.sigma * 2 * 12 * side;
        for (step = -2 * wanted; step <= 2.01 * wanted; step += wanted / 10) {
            double off = disagree(&first, &second, step * d[0] / hypot(d[0], d[1]),
                                  step * d[1] / hypot(d[0], d[1]));
            if (off < least) {
                least = off;
                best = step;
            }
        }
        wrong = disagree(&first, &second, -wanted * d[1] / hypot(d[0], d[1]),
                         wanted * d[0] / hypot(d[0], d[1])); /* across */
        printf("case %zu: moved %.2f px, wanted %.2f; off %.3g, across %.3g\n", i, best, wanted,
               least, wrong);
        assert_true(fabs(best - wanted) <= 0.25 * wanted);
        assert_compare(least, <, 0.5 * wrong);
        test_image_finish(&first);
        test_image_finish(&second);
        test_shell_close(&rig);
    }
}

static double total_depth(const struct test_image *image) {
    double sum = 0;
    for (unsigned y = 0; y < image->height; y++)
        for (unsigned x = 0; x < image->width; x++)
            sum += depth_at(image, x, y);
    return sum;
}

/* At any phase, a splat with streaks is as opaque as a splat without streaks, to 1 %. So nothing
 * flickers, and no seams show between neighbours. Style blend draws the splat without streaks. */
static void the_texture_keeps_the_energy(void **state) {
    (void)state;
    const double direction[3] = { 1, 0.4, 0.3 };
    struct test_shell rig;
    struct test_image image;
    open_uniform(&rig, 1, direction, 0.1);
    rig.scene.view.camera.height = 5;
    rig.layer.style = SP_VECTORS_BLEND;
    draw(&rig, 0, &image);
    double plain = total_depth(&image), worst = 0;
    test_image_finish(&image);
    rig.layer.style = SP_VECTORS_MODULATE;
    for (int i = 0; i <= 10; i++) {
        draw(&rig, i * 0.1, &image);
        worst = fmax(worst, fabs(total_depth(&image) / plain - 1));
        test_image_finish(&image);
    }
    printf("energy differs by at most %.2f %%\n", 100 * worst);
    assert_compare(worst, <, 0.01);
    test_shell_close(&rig);
}

/* Integer phases look like phase 0, and the stretch keeps the opacity. */
static void phases_repeat_and_stretching_keeps_the_energy(void **state) {
    (void)state;
    const double direction[3] = { 1, 0, 0 };
    struct test_shell rig;
    struct test_image zero, one, back, stretched;
    open_uniform(&rig, 3, direction, 0.1);
    draw(&rig, 0, &zero);
    draw(&rig, 1, &one);
    draw(&rig, -3, &back);
    assert_true(test_image_difference(&zero, &one).largest <= 0);
    assert_true(test_image_difference(&zero, &back).largest <= 0);
    rig.layer.stretch = 3;
    draw(&rig, 0, &stretched);
    double change = fabs(total_depth(&stretched) / total_depth(&zero) - 1);
    printf("stretched: energy differs by %.2f %%\n", 100 * change);
    assert_compare(change, <, 0.015);
    test_image_finish(&zero);
    test_image_finish(&one);
    test_image_finish(&back);
    test_image_finish(&stretched);
    test_shell_close(&rig);
}

/* For a vector without a direction, style modulate draws nothing and style blend draws only the
 * splat. A vector towards the eye gives dots, not streaks, of the same opacity. */
static void vectors_without_a_direction_on_the_image(void **state) {
    (void)state;
    static const double still[3] = { 0, 0, 0 }, bad[3] = { NAN, 1, 0 }, ahead[3] = { 0, 0, 1 };
    struct test_shell rig;
    struct test_image image, splats;
    for (int i = 0; i < 2; i++) {
        open_uniform(&rig, 3, i ? bad : still, 0.1);
        draw(&rig, 0, &image);
        assert_true(total_depth(&image) <= 0);
        test_image_finish(&image);
        rig.layer.style = SP_VECTORS_BLEND;
        rig.layer.color[0] = 0;
        draw(&rig, 0, &image);
        if (i == 0)
            splats = image;
        else
            assert_true(test_image_difference(&image, &splats).largest <= 0);
        if (i == 1)
            test_image_finish(&image);
        test_shell_close(&rig);
    }
    open_uniform(&rig, 3, ahead, 0.1);
    rig.layer.stretch = 1;
    draw(&rig, 0, &image);
    double change = fabs(total_depth(&image) / total_depth(&splats) - 1);
    printf("ahead: energy differs by %.2f %%\n", 100 * change);
    assert_compare(change, <, 0.01);
    test_image_finish(&image);
    test_image_finish(&splats);
    test_shell_close(&rig);
}

/* Both styles, direct and as fragments, on every instruction set and number of threads. */
static void all_paths_agree(void **state) {
    (void)state;
    const double direction[3] = { 1, 0.5, -0.3 };
    const char *isa;
    for (int style = 0; style < 2; style++) {
        struct test_shell rig;
        struct test_image wanted, merged, got;
        open_uniform(&rig, 7, direction, 0.1);
        test_scene_orbit(&rig.scene, NULL, 35, 20, 60);
        rig.scene.view.camera.projection = style ? SP_PERSPECTIVE : SP_ORTHOGRAPHIC;
        rig.scene.view.camera.fov_y = 12;
        rig.layer.style = style ? SP_VECTORS_BLEND : SP_VECTORS_MODULATE;
        draw(&rig, 0.4, &wanted);
        assert_true(test_shell_draw_fragments(&rig, &merged, NULL));
        double psnr = test_image_psnr(&wanted, &merged);
        printf("style %d: fragments %.1f dB\n", style, psnr);
        assert_compare(psnr, >, 33);
        for (unsigned i = 1; (isa = cpu_isa_at(i)); i++) {
            struct cpu_kernels kernels;
            if (!cpu_kernels_init(&kernels, isa, NULL)) {
                printf("skipped: %s\n", isa);
                continue;
            }
            rig.kernels = kernels.voxels;
            draw(&rig, 0.4, &got);
            psnr = test_image_psnr(&wanted, &got);
            test_image_finish(&got);
            assert_true(test_shell_draw_fragments(&rig, &got, NULL));
            printf("%s: %.1f dB, fragments %.1f dB\n", isa, psnr, test_image_psnr(&merged, &got));
            assert_compare(psnr, >, 80);
            assert_compare(test_image_psnr(&merged, &got), >, 60);
            test_image_finish(&got);
        }
        test_image_finish(&wanted);
        test_image_finish(&merged);
        test_shell_close(&rig);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(streaks_move_along_vectors),
        cmocka_unit_test(the_texture_keeps_the_energy),
        cmocka_unit_test(phases_repeat_and_stretching_keeps_the_energy),
        cmocka_unit_test(vectors_without_a_direction_on_the_image),
        cmocka_unit_test(all_paths_agree),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
