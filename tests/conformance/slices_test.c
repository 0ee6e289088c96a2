/* SPDX-License-Identifier: Apache-2.0
 *
 * Slices in the image against a closed form: in a medium of constant extinction σ and colour c, the
 * ray that meets its first slice after the length L in the volume shows
 *
 *   c·(1 − e^−σL) + e^−σL·s        s = the colour of a linear field: its window in grey or in a map
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

#include "data/volume/slice_colors.h"
#include "sp/renderer.h"
#include "support/compare.h"
#include "support/image.h"
#include "support/medium.h"
#include "support/render.h"

enum { SIDE = TEST_MEDIUM_SIDE };

/* The distance to the first slice on the ray inside the volume, and its axis; INFINITY, -1 = none.
 */
static double intersect_slices(const struct test_medium *s, const double from[3],
                               const double along[3], const double t[2], int *axis) {
    const struct sp_slices *slices = &s->view.slices;
    double first = INFINITY;
    *axis = -1;
    for (int a = 0; a < (slices->mode == SP_SLICES_OBLIQUE ? 1 : 3); a++) {
        if (slices->mode == SP_SLICES_ORTHOGONAL && !slices->planes[a])
            continue;
        double normal[3], range[2], to[3];
        test_medium_axis(&s->grid, a, normal, range);
        if (slices->mode == SP_SLICES_OBLIQUE)
            memcpy(normal, slices->normal, sizeof normal);
        for (int r = 0; r < 3; r++)
            to[r] = slices->position[r] - from[r];
        double at = test_dot(normal, to) / test_dot(normal, along);
        if (at >= t[0] && at <= t[1] && at < first) {
            first = at;
            *axis = a;
        }
    }
    return first;
}

/* Returns the axis of the slice that is seen; -1 = none. */
static int expect(const struct test_medium *s, double x, double y, double rgb[3]) {
    double from[3], along[3], t[2], inside[2], depth = 0, slice = INFINITY;
    int axis = -1;
    test_medium_ray(&s->view.camera, x, y, from, along);
    if (test_medium_cut(s, from, along, false, t)) /* the clip does not cut slices */
        slice = intersect_slices(s, from, along, t, &axis);
    if (test_medium_cut(s, from, along, true, inside))
        depth = fmax(fmin(inside[1], slice) - inside[0], 0);
    double through = exp(-s->sigma * depth), color[3] = { 0 };
    if (isfinite(slice)) {
        double p[3];
        for (int r = 0; r < 3; r++)
            p[r] = from[r] + slice * along[r];
        const struct sp_slices *w = &s->view.slices;
        color[0] = fmin(fmax((test_medium_value(p) - w->center) / w->width + 0.5, 0), 1);
        color[1] = color[2] = color[0];
        if (w->colors != SP_SLICE_GREY)
            sp_slice_color(&s->view, test_medium_value(p), color);
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = (1 - through) * (double)test_medium_color[c] +
                 through * (isfinite(slice) ? color[c] : (double)s->view.background[c]);
    return axis;
}

/* The mean of the closed form over a pixel. */
static void expect_mean(const struct test_medium *s, uint32_t x, uint32_t y, double rgb[3]) {
    enum { PARTS = 8 };
    rgb[0] = rgb[1] = rgb[2] = 0;
    for (int i = 0; i < PARTS * PARTS; i++) {
        double part[3];
        expect(s, x + (i % PARTS + 0.5) / PARTS, y + (i / PARTS + 0.5) / PARTS, part);
        for (int c = 0; c < 3; c++)
            rgb[c] += part[c] / (PARTS * PARTS);
    }
}

/* True if the expected image changes quickly here, or a border of a slice crosses the pixel, which
 * then shows a mean. */
static bool is_edge(const struct test_medium *s, double x, double y) {
    double middle[3], beside[3];
    const int axis = expect(s, x, y, middle);
    for (int i = 0; i < 8; i++) {
        expect(s, x + 1.5 * cos(i * M_PI / 4), y + 1.5 * sin(i * M_PI / 4), beside);
        for (int c = 0; c < 3; c++)
            if (fabs(beside[c] - middle[c]) > 0.04)
                return true;
    }
    enum { PARTS = 9 };
    for (int i = 0; i < PARTS * PARTS; i++)
        if (expect(s, x + (i % PARTS) / (PARTS - 1.) - 0.5, y + (i / PARTS) / (PARTS - 1.) - 0.5,
                   beside) != axis)
            return true;
    return false;
}

/* Compares the image of one backend with the closed form. */
static void check_target(const struct test_medium *s, const char *what,
                         const struct test_target *target) {
    struct test_renderer renderer;
    struct test_image image;
    struct sp_error err;
    if (!test_renderer_open(&renderer, target, 2, &err)) {
        printf("%-28s %-12s skipped: %s\n", what, target->backend, err.text);
        return;
    }
    if (!test_render(&renderer, s->volume, &s->view, &image, &err))
        fail_msg("%s on %s: %s", what, target->backend, err.text);
    double worst = 0, sum = 0;
    int count = 0;
    for (uint32_t y = 0; y < SIDE; y++)
        for (uint32_t x = 0; x < SIDE; x++) {
            double rgb[3];
            if (is_edge(s, x + 0.5, y + 0.5))
                continue;
            expect(s, x + 0.5, y + 0.5, rgb);
            const double *px = test_image_at(&image, x, y);
            for (int c = 0; c < 3; c++) {
                worst = fmax(worst, fabs(px[c] - rgb[c]));
                sum += fabs(px[c] - rgb[c]);
            }
            count++;
        }
    printf("%-28s %-12s %-7s %5d px, mean %.6f, worst %.5f\n", what, target->backend, target->isa,
           count, sum / (3 * count), worst);
    assert_compare(count, >, 4000);
    assert_compare(sum / (3 * count), <, 1e-4);
    assert_compare(worst, <, 1e-3);
    test_image_finish(&image);
    test_renderer_close(&renderer);
}

static void check(struct test_medium *s, const char *what) {
    struct test_target target;
    for (unsigned i = 0; test_target_at(i, &target); i++)
        check_target(s, what, &target);
    sp_volume_unref(&s->volume);
}

static void orthogonal_slices_split_the_volume(void **state) {
    (void)state;
    for (int projection = SP_PERSPECTIVE; projection <= SP_ORTHOGRAPHIC; projection++) {
        struct test_medium s;
        test_medium_init(&s, (enum sp_projection)projection);
        s.view.slices.mode = SP_SLICES_ORTHOGONAL;
        s.view.slices.position[0] += 3;
        s.view.slices.position[2] -= 2;
        check(&s, projection ? "orthogonal, orthographic" : "orthogonal, perspective");
    }
}

static void an_oblique_slice_splits_the_volume(void **state) {
    (void)state;
    for (int projection = SP_PERSPECTIVE; projection <= SP_ORTHOGRAPHIC; projection++) {
        struct test_medium s;
        test_medium_init(&s, (enum sp_projection)projection);
        s.view.slices.mode = SP_SLICES_OBLIQUE;
        memcpy(s.view.slices.normal, (double[3]){ -2, 3, 1.5 }, sizeof s.view.slices.normal);
        check(&s, projection ? "oblique, orthographic" : "oblique, perspective");
    }
}

static void slices_show_a_colour_map(void **state) {
    (void)state;
    struct test_medium s;
    test_medium_init(&s, SP_PERSPECTIVE);
    s.view.slices.mode = SP_SLICES_ORTHOGONAL;
    s.view.slices.colors = SP_SLICE_BLUE_RED;
    check(&s, "blue to red");
}

/* The camera is behind the volume, or inside of it. */
static void slices_are_seen_from_everywhere(void **state) {
    (void)state;
    struct test_medium s;
    test_medium_init(&s, SP_PERSPECTIVE);
    s.view.slices.mode = SP_SLICES_ORTHOGONAL;
    for (int i = 0; i < 3; i++)
        s.view.camera.position[i] =
            s.view.camera.target[i] - (s.view.camera.position[i] - s.view.camera.target[i]);
    check(&s, "from behind");
    test_medium_init(&s, SP_PERSPECTIVE);
    s.view.slices.mode = SP_SLICES_OBLIQUE;
    s.view.slices.normal[0] = 1;
    for (int i = 0; i < 3; i++)
        s.view.camera.position[i] = s.view.camera.target[i] + (i == 1 ? -7 : 1);
    s.view.camera.near = 1e-3;
    check(&s, "from inside");
}

static void the_clip_cuts_the_volume_but_not_the_slices(void **state) {
    (void)state;
    struct test_medium s;
    test_medium_init(&s, SP_PERSPECTIVE);
    s.view.slices.mode = SP_SLICES_ORTHOGONAL;
    s.view.clip.box[0][1] = 0.4;
    s.view.clip.box[1][2] = 0.8;
    check(&s, "clipped");
}

static void orthogonal_slices_are_switched_singly(void **state) {
    (void)state;
    for (int kept = 0; kept < 3; kept++) {
        struct test_medium s;
        test_medium_init(&s, SP_PERSPECTIVE);
        s.view.slices.mode = SP_SLICES_ORTHOGONAL;
        s.view.slices.position[0] += 3;
        for (int a = 0; a < 3; a++)
            s.view.slices.planes[a] = a == kept;
        check(&s, "one slice");
        test_medium_init(&s, SP_PERSPECTIVE);
        s.view.slices.mode = SP_SLICES_ORTHOGONAL;
        s.view.slices.planes[kept] = false;
        check(&s, "two slices");
    }
}

/* Without a medium, a pixel on a border of a slice shows the mean over its area. Corners are
 * products of two borders, and so less exact. */
static void borders_of_slices_are_smooth(void **state) {
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct test_medium s;
        struct test_target target;
        struct test_renderer renderer;
        struct test_image image;
        test_medium_init(&s, i & 1 ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE);
        s.view.slices.mode = i & 2 ? SP_SLICES_OBLIQUE : SP_SLICES_ORTHOGONAL;
        memcpy(s.view.slices.normal, (double[3]){ -2, 3, 1.5 }, sizeof s.view.slices.normal);
        s.view.transfer_function.points[0].opacity = 0;
        s.sigma = 0;
        assert_true(test_target_at(0, &target));
        assert_true(test_renderer_open(&renderer, &target, 2, NULL));
        assert_true(test_render(&renderer, s.volume, &s.view, &image, NULL));
        double worst = 0, sum = 0;
        int count = 0;
        for (uint32_t y = 0; y < SIDE; y++)
            for (uint32_t x = 0; x < SIDE; x++) {
                double rgb[3];
                if (!is_edge(&s, x + 0.5, y + 0.5))
                    continue;
                expect_mean(&s, x, y, rgb);
                double off = fabs(test_image_at(&image, x, y)[0] - rgb[0]);
                worst = fmax(worst, off);
                sum += off;
                count++;
            }
        printf("borders, %d: %d px, mean %.5f, worst %.5f\n", i, count, sum / count, worst);
        assert_compare(count, >, 200);
        assert_compare(sum / count, <, 0.01);
        assert_compare(worst, <, 0.15);
        test_image_finish(&image);
        test_renderer_close(&renderer);
        sp_volume_unref(&s.volume);
    }
}

static void a_slice_beside_the_volume_draws_nothing(void **state) {
    (void)state;
    struct test_medium s;
    test_medium_init(&s, SP_PERSPECTIVE);
    s.view.slices.mode = SP_SLICES_ORTHOGONAL;
    for (int i = 0; i < 3; i++)
        s.view.slices.position[i] += 1000;
    check(&s, "beside the volume");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(orthogonal_slices_split_the_volume),
        cmocka_unit_test(an_oblique_slice_splits_the_volume),
        cmocka_unit_test(slices_show_a_colour_map),
        cmocka_unit_test(slices_are_seen_from_everywhere),
        cmocka_unit_test(the_clip_cuts_the_volume_but_not_the_slices),
        cmocka_unit_test(a_slice_beside_the_volume_draws_nothing),
        cmocka_unit_test(orthogonal_slices_are_switched_singly),
        cmocka_unit_test(borders_of_slices_are_smooth),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
