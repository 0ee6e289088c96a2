/* SPDX-License-Identifier: Apache-2.0
 *
 * Spans and cuts of clipped kernels: the part of a kernel that a pixel sees before a face or inside
 * a half-space. The reference sums over a raster of the kernel.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "splat/cubic.h"
#include "splat/extent.h"
#include "splat/normal.h"
#include "support/compare.h"

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

/* A kernel of any shape. An orthographic camera of `scale` px sees it along the third axis. */
static struct sp_kernel_place random_place(float scale, float h) {
    struct sp_kernel_place p = { .h2 = h * h, .radius = 3 };
    float v[3];
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++) {
            p.kernel[r][a] = (float)uniform(-0.4, 0.4) + (r == a ? 0.8f : 0);
            p.m[r][a] = p.kernel[r][a] * (r < 2 ? scale : 1);
        }
    for (int i = 0; i < 3; i++) { /* xx, xy, yy */
        const float *x = p.m[i / 2], *y = p.m[(i + 1) / 2];
        v[i] = x[0] * y[0] + x[1] * y[1] + x[2] * y[2] + (i == 1 ? 0 : p.h2);
    }
    p.det = v[0] * v[2] - v[1] * v[1];
    p.inverse[0] = v[2] / p.det;
    p.inverse[1] = -v[1] / p.det;
    p.inverse[2] = v[0] / p.det;
    for (int r = 0; r < 3; r++)
        p.u[r] = (float)uniform(-5, 5);
    p.distance = p.u[2];
    return p;
}

/* Returns the part of the kernel with normal·offset + e ≥ 0 that the pixel at (dx, dy) sees through
 * a low-pass filter of variance h². Offsets are from the centre of the kernel, in camera space. */
static double brute_share(const struct sp_kernel_place *p, const double normal[3], double e,
                          double dx, double dy) {
    enum { STEPS = 90 };
    double inside = 0, all = 0, h2 = fmax((double)p->h2, 4e-3);
    for (int n = 0; n < STEPS * STEPS * STEPS; n++) {
        double q[3] = { n % STEPS, n / STEPS % STEPS, n / STEPS / STEPS }, at[3] = { 0 };
        double r2 = 0, x = dx, y = dy;
        for (int a = 0; a < 3; a++) {
            q[a] = (q[a] + 0.5) / STEPS * 9 - 4.5;
            r2 += q[a] * q[a];
            x -= (double)p->m[0][a] * q[a];
            y -= (double)p->m[1][a] * q[a];
            for (int r = 0; r < 3; r++)
                at[r] += (double)p->kernel[r][a] * q[a];
        }
        double w = exp(-0.5 * (r2 + (x * x + y * y) / h2));
        all += w;
        if (normal[0] * at[0] + normal[1] * at[1] + normal[2] * at[2] + e >= 0)
            inside += w;
    }
    return inside / all;
}

static void a_span_is_the_depth_on_a_ray(void **state) {
    (void)state;
    srand(5);
    for (int n = 0; n < 12; n++) {
        struct sp_kernel_place p = random_place(2, n % 2 ? 1 : 0.3f);
        struct sp_span span;
        sp_extent_span(&p, &span);
        double dx = uniform(-1.5, 1.5), dy = uniform(-1.5, 1.5), face = uniform(-1, 1);
        double mean = (double)span.slope[0] * dx + (double)span.slope[1] * dy;
        float depth = (float)(face - mean) * span.sharpness;
        double before = brute_share(&p, (double[3]){ 0, 0, -1 }, face, dx, dy);
        assert_compare(fabs((double)sp_normal_share(depth) - before), <, 4e-3);
    }
}

static void a_cut_is_the_share_inside_the_plane(void **state) {
    (void)state;
    srand(6);
    for (int n = 0; n < 16; n++) {
        struct sp_kernel_place p = random_place(2, n % 2 ? 1 : 0.3f);
        double normal[3], length = 0, dx = uniform(-1.5, 1.5), dy = uniform(-1.5, 1.5), e;
        for (int r = 0; r < 3; r++)
            length += pow(normal[r] = uniform(-1, 1), 2);
        struct sp_clip_frame clip = { .count = 1 };
        struct sp_cut cut;
        e = uniform(-0.8, 0.8);
        clip.planes[0].offset = (float)-e;
        for (int r = 0; r < 3; r++) {
            normal[r] /= sqrt(length);
            clip.planes[0].normal[r] = (float)normal[r];
            clip.planes[0].offset += (float)normal[r] * p.u[r];
        }
        assert_int_equal(sp_extent_cut(&p, &clip, &cut), 1);
        const struct sp_cut_plane *plane = &cut.planes[0];
        double eta = (double)plane->e + (double)plane->k[0] * dx + (double)plane->k[1] * dy;
        double want = brute_share(&p, normal, e, dx, dy);
        assert_compare(fabs((double)sp_normal_share((float)eta) - want), <, 1e-2);
        /* A plane across the ray bounds the depth, on the side to which its normal points. */
        if (fabs(normal[2]) > 0.99)
            assert_int_equal(plane->side, normal[2] > 0 ? 1 : -1);
    }
}

static void far_planes_keep_all_or_nothing(void **state) {
    (void)state;
    srand(7);
    struct sp_kernel_place p = random_place(3, 1);
    struct sp_clip_frame clip = { .count = 1, .planes = { { { 0, 0, 1 }, p.u[2] - 20 } } };
    struct sp_cut cut;
    assert_int_equal(sp_extent_cut(&p, &clip, &cut), 0);
    clip.planes[0].offset = p.u[2] + 20;
    assert_int_equal(sp_extent_cut(&p, &clip, &cut), -1);
    clip.planes[0].offset = NAN; /* with NaN nothing is inside */
    assert_int_equal(sp_extent_cut(&p, &clip, &cut), -1);
}

static void the_normal_share_is_the_error_function(void **state) {
    (void)state;
    for (double x = -9; x <= 9; x += 0.01)
        assert_compare(fabs((double)sp_normal_share((float)x) - 0.5 * erfc(-x * M_SQRT1_2)), <,
                       3e-7);
    assert_compare(sp_normal_share(-1e4f), <, 1e-30f);
    assert_compare(sp_normal_share(1e4f), ==, 1);
}

/* The faces of the box lie at fractions of the extent of all cells; 0 and 1 cut nothing. */
static void the_clip_box_lies_in_the_volume(void **state) {
    (void)state;
    static const double coordinates[4] = { 0, 1, 3, 7 };
    struct sp_grid grid = { .dims = { 4, 10, 10 },
                            .spacing = { 7.0 / 3, 2, 1 },
                            .origin = { 5, 0, 0 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } },
                            .coordinates = { coordinates } };
    struct sp_camera camera = {
        .position = { 0, 0, -50 }, .up = { 0, -1, 0 }, .fov_y = 30, .height = 1, .near = 0.1
    };
    struct sp_camera_transform frame;
    struct sp_clip_frame clip;
    struct sp_clip view = { .box = { { 0.5, 0, 0 }, { 1, 0.25, 1 } },
                            .plane_count = 1,
                            .planes = { { { 0, 0, 1e200 }, 3e200 } } };
    sp_camera_transform_init(&frame, &camera, (uint32_t[2]){ 8, 8 });
    sp_clip_frame_init(&clip, &frame, &grid, &view, 2);
    assert_int_equal(clip.count, 3);
    /* Axis 0 reaches from −0.5 to 9: the middle is 4.25, world 9.25; cells are 2 units. */
    assert_compare(fabsf(fabsf(clip.planes[0].normal[0]) - 1), <, 1e-6f);
    assert_compare(fabsf(clip.planes[0].offset - 9.25f / 2), <, 1e-5f);
    /* Axis 1 reaches from −1 to 19: a quarter of it is 4, and the part below stays. */
    assert_compare(fabsf(clip.planes[1].offset + 4.0f / 2), <, 1e-5f);
    /* z ≥ 3, seen from z = −50. */
    assert_compare(fabsf(clip.planes[2].normal[2] - 1), <, 1e-6f);
    assert_compare(fabsf(clip.planes[2].offset - 53.0f / 2), <, 1e-4f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_span_is_the_depth_on_a_ray),
        cmocka_unit_test(a_cut_is_the_share_inside_the_plane),
        cmocka_unit_test(far_planes_keep_all_or_nothing),
        cmocka_unit_test(the_normal_share_is_the_error_function),
        cmocka_unit_test(the_clip_box_lies_in_the_volume),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
