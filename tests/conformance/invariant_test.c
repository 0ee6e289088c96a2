/* SPDX-License-Identifier: Apache-2.0
 *
 * Settings that must not change the image, or must change it in a known way: threads, filters,
 * compositors, the order of classification, the format of the frame. Each test runs on every
 * backend, on the CPU with the scalar reference and with the best instruction set. geometry_test.c
 * does the same for the geometry of the scene.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "conformance/invariant.h"
#include "support/compare.h"
#include "support/data.h"

/* True if the frames are equal, up to the rounding of the backend. The CPU draws identical bytes
 * with any number of threads. A GPU adds in any order, so the last bits differ. Rounding then
 * decides which splat saturates a tile; the difference is at most 1/512. */
static bool is_same_frame(const struct test_target *target, const struct sp_frame *a,
                          const struct sp_frame *b) {
    struct test_image x, y;
    if (strcmp(target->backend, "cpu") == 0)
        return test_frames_equal(a, b);
    assert_true(test_image_from_frame(&x, a));
    assert_true(test_image_from_frame(&y, b));
    double psnr = test_image_psnr(&x, &y), step = test_image_difference(&x, &y).largest;
    test_image_finish(&x);
    test_image_finish(&y);
    return psnr >= 70 && step < 1.01 / 255;
}

static void check_threads(struct invariant_context *c, const struct test_scene *scene,
                          enum sp_pixel_format format) {
    static const unsigned threads[] = { 2, 7, 16 };
    struct sp_render_options o = { .format = format };
    struct sp_error err = { 0 };
    struct test_renderer alone, many;
    struct sp_volume *volume = test_scene_volume(scene, &err);
    assert_non_null(volume);
    invariant_skip_unsupported(c, scene);
    assert_true(test_renderer_open(&alone, &c->target, 1, &err));
    struct sp_frame *one =
        sp_renderer_render(alone.renderer, volume, &scene->view, alone.pool, &o, &err);
    if (!one)
        fail_msg("%s: %s: %s", scene->info.name, err.place, err.text);
    /* Other backends do not use these threads and start slowly: one number of threads. */
    size_t tries = strcmp(c->target.backend, "cpu") == 0 ? sizeof threads / sizeof *threads : 1;
    for (size_t t = 0; t < tries; t++) {
        assert_true(test_renderer_open(&many, &c->target, threads[t], &err));
        for (int again = 0; again < (t ? 1 : 2); again++) {
            struct sp_frame *frame =
                sp_renderer_render(many.renderer, volume, &scene->view, many.pool, &o, &err);
            assert_non_null(frame);
            if (!is_same_frame(&c->target, one, frame))
                fail_msg("%s: frame %d of %u threads differs from the frame of one thread",
                         scene->info.name, again, threads[t]);
            sp_frame_unref(&frame);
        }
        test_renderer_close(&many);
    }
    sp_frame_unref(&one);
    test_renderer_close(&alone);
    sp_volume_unref(&volume);
}

static void the_number_of_threads_does_not_change_the_image(void **state) {
    struct invariant_context *c = *state;
    static test_scene_fn *const builds[] = {
        test_scene_thin_shells,  test_scene_anisotropic,
        test_scene_checkerboard, test_scene_oblique,
        test_scene_inside,       test_scene_lit_shell,
        test_scene_clip_corner,  test_scene_rectilinear_blobs,
    };
    for (size_t b = 0; b < sizeof builds / sizeof *builds; b++)
        for (int way = (int)b % 2; way < INVARIANT_WAYS; way += 2) {
            if (strcmp(c->target.backend, "cpu") != 0 && (size_t)way / 2 % 4 != b / 2)
                continue; /* other backends draw each way once */
            struct test_scene scene;
            assert_true(builds[b](&scene));
            /* Not a multiple of the tile size, and large enough for several tiles per worker. */
            scene.view.size[0] = 149;
            scene.view.size[1] = 101;
            invariant_choose_way(&scene.view, way);
            check_threads(c, &scene, way & 2 ? SP_RGBA8 : SP_RGBAF32);
            test_scene_finish(&scene);
        }
}

/* Without a low-pass filter, both filter modes compute the same formula. */
static void reconstruction_is_ewa_without_low_pass(void **state) {
    struct invariant_context *c = *state;
    struct test_scene s;
    assert_true(test_scene_thin_shells(&s));
    s.view.filter.mode = SP_FILTER_RECONSTRUCTION;
    struct test_image a = invariant_render(c, &s);
    s.view.filter.mode = SP_FILTER_EWA;
    s.view.filter.lowpass = 0;
    struct test_image b = invariant_render(c, &s);
    invariant_assert_same("reconstruction", &a, &b, 100);
    test_scene_finish(&s);
}

/* Energy is conserved: the sum of the optical depths of a thin medium does not depend on the
 * filter.
 */
static void filters_conserve_energy(void **state) {
    struct invariant_context *c = *state;
    struct test_scene s;
    double reference = 0;
    assert_true(test_scene_blobs(&s));
    for (uint32_t i = 0; i < s.view.transfer_function.point_count; i++)
        s.view.transfer_function.points[i].opacity *= 0.01F;
    test_scene_orbit(&s, NULL, -30, 20, 90); /* the volume does not touch the image border */
    static const enum sp_filter_mode filters[] = { SP_FILTER_EWA,     SP_FILTER_RECONSTRUCTION,
                                                   SP_FILTER_LOWPASS, SP_FILTER_ADAPTIVE,
                                                   SP_FILTER_SWAN,    SP_FILTER_NONE };
    for (int k = 0; k < 12; k++) {
        s.view.filter.mode = filters[k % 6];
        s.view.filter.kernel = k < 6 ? SP_KERNEL_GAUSSIAN : SP_KERNEL_CUBIC;
        struct test_image a = invariant_render(c, &s);
        double sum = 0;
        for (size_t p = 0; p < (size_t)a.width * a.height; p++)
            sum -= log1p(-a.rgba[p * 4 + 3]);
        if (!k)
            reference = sum;
        print_message("  filter %d, kernel %d: sum of depths %.4f\n", k % 6, k / 6, sum);
        assert_compare(reference, >, 1);
        assert_compare(fabs(sum / reference - 1), <, 0.005);
        test_image_finish(&a);
    }
    test_scene_finish(&s);
}

/* With exponential attenuation, the opacity of a pixel does not depend on which depths are added
 * before they are composited. Compositors therefore differ only in colour. */
static void compositors_agree_on_the_opacity(void **state) {
    struct invariant_context *c = *state;
    static test_scene_fn *const builds[] = { test_scene_blobs, test_scene_layers, test_scene_cubic,
                                             test_scene_rectilinear_blobs, test_scene_clip_corner };
    for (size_t b = 0; b < sizeof builds / sizeof *builds * INVARIANT_MODES; b++) {
        struct test_scene s;
        assert_true(builds[b / INVARIANT_MODES](&s));
        for (uint32_t i = 0; i < s.view.transfer_function.point_count; i++)
            memset(s.view.transfer_function.points[i].color, 0, 3 * sizeof(float));
        struct test_image a = invariant_render(c, &s);
        bool is_postconv = test_uses_postconv(&c->target, &s);
        s.view.compositing.mode = invariant_modes[b % INVARIANT_MODES];
        s.view.compositing.slab = 0.7;
        struct test_image d = invariant_render(c, &s);
        char name[160];
        snprintf(name, sizeof name, "%s-opacity-%zu", s.info.name, b % INVARIANT_MODES);
        invariant_assert_same(name, &d, &a,
                              is_postconv && b % INVARIANT_MODES ? INVARIANT_POSTCONV_FLOOR : 80);
        test_scene_finish(&s);
    }
}

/* The optical depths of the part that a clip plane keeps and of the part that it removes add up to
 * the depth of the whole volume. */
static void opposite_clip_planes_add_up_to_the_whole(void **state) {
    struct invariant_context *c = *state;
    /* Not for INVARIANT_POST_WAY: post-classification runs after the cut, so depths do not add up.
     */
    for (int way = 0; way < INVARIANT_POST_WAY; way++) {
        struct test_scene s;
        struct test_image parts[3];
        assert_true(test_scene_blobs(&s));
        invariant_choose_way(&s.view, way);
        s.view.compositing.attenuation = SP_ATTENUATION_EXPONENTIAL;
        parts[2] = invariant_render(c, &s);
        double slack = test_uses_postconv(&c->target, &s) ? INVARIANT_POSTCONV_DEPTH : 2e-4;
        test_scene_cut(&s, (double[]){ 0.3, -0.2, 0.7 }, (double[]){ 1, 0, 2 });
        struct sp_clip_plane *plane = s.view.clip.planes;
        for (int k = 0; k < 2; k++) {
            parts[k] = invariant_render(c, &s);
            for (int a = 0; a < 3; a++)
                plane->normal[a] *= -1;
            plane->offset *= -1;
        }
        double worst = 0, most = 0;
        for (size_t p = 0; p < (size_t)parts[0].width * parts[0].height; p++) {
            double depth[3];
            for (int k = 0; k < 3; k++)
                depth[k] = -log1p(-parts[k].rgba[p * 4 + 3]);
            worst = fmax(worst, fabs(depth[0] + depth[1] - depth[2]));
            most = fmax(most, depth[2]);
        }
        print_message("  way %d: largest depth %.2f, largest error of the sum %.1g\n", way, most,
                      worst);
        assert_compare(most, >, 0.5);
        assert_compare(worst, <, slack * most);
        for (int k = 0; k < 3; k++)
            test_image_finish(&parts[k]);
        test_scene_finish(&s);
    }
}

/* In a constant volume, classification before and after interpolation gives the same image. */
static void a_constant_volume_looks_the_same_in_both_orders(void **state) {
    struct invariant_context *c = *state;
    struct test_scene s;
    assert_true(test_scene_constant_cube(&s));
    s.view.compositing.mode = SP_COMPOSITE_SLAB;
    struct test_image a = invariant_render(c, &s);
    s.view.transfer_function.order = SP_TF_POST;
    struct test_image b = invariant_render(c, &s);
    invariant_assert_same("order", &b, &a, 80);
    test_scene_finish(&s);
}

/* A gradient axis whose scale is 1 everywhere, or 1 at all magnitudes of the volume. */
static void a_gradient_axis_of_scale_one_does_not_change_the_image(void **state) {
    struct invariant_context *c = *state;
    for (int k = 0; k < 4; k++) {
        struct test_scene s;
        assert_true(k & 1 ? test_scene_post_peak(&s) : test_scene_lit_shell(&s));
        struct test_image a = invariant_render(c, &s);
        struct sp_transfer_function *tf = &s.view.transfer_function;
        tf->gradient_count = 2;
        tf->gradient[0] = (struct sp_gradient_point){ k & 2 ? 1e6 : 0, 1 };
        tf->gradient[1] = (struct sp_gradient_point){ k & 2 ? 2e6 : 7, k & 2 ? 0 : 1 };
        struct test_image b = invariant_render(c, &s);
        invariant_assert_same(k & 1 ? "gradient-axis-post" : "gradient-axis", &b, &a, 100);
        test_scene_finish(&s);
    }
}

static void an_rgba8_frame_is_the_rounded_float_frame(void **state) {
    struct invariant_context *c = *state;
    static const float backgrounds[][4] = {
        { 0, 0, 0, 1 }, { 0.3F, 0.6F, 0.9F, 1 }, { 0, 0, 0, 0 }, { 1, 0.5F, 0, 0.5F }
    };
    for (int k = 0; k < 4; k++) {
        struct test_scene s;
        struct test_image floats, bytes;
        struct sp_error err;
        assert_true(test_scene_thin_shells(&s));
        memcpy(s.view.background, backgrounds[k], sizeof s.view.background);
        floats = invariant_render(c, &s);
        struct sp_volume *volume = test_scene_volume(&s, &err);
        assert_non_null(volume);
        struct sp_frame *frame =
            sp_renderer_render(c->renderer.renderer, volume, &s.view, c->renderer.pool, NULL, &err);
        assert_non_null(frame);
        assert_int_equal(frame->format, SP_RGBA8);
        assert_true(test_image_from_frame(&bytes, frame));
        /* Alpha is off by at most half a step. A colour is rounded twice: before and after its
         * multiplication by alpha. */
        struct test_difference d = test_image_difference(&floats, &bytes);
        print_message("  background %d: largest difference %.3f steps\n", k, d.largest * 255);
        assert_compare(d.largest, <, 1.05 / 255);
        if (backgrounds[k][3] >= 1)
            for (size_t p = 0; p < (size_t)bytes.width * bytes.height; p++)
                assert_compare(bytes.rgba[p * 4 + 3], ==, 1);
        sp_frame_unref(&frame);
        sp_volume_unref(&volume);
        test_image_finish(&floats);
        test_image_finish(&bytes);
        test_scene_finish(&s);
    }
}

/* The volume is behind the camera, before the near plane, transparent, or beside the view. */
static void an_empty_view_shows_the_background(void **state) {
    struct invariant_context *c = *state;
    for (int k = 0; k < 4; k++) {
        struct test_scene s;
        assert_true(test_scene_blobs(&s));
        static const float background[4] = { 0.25F, 0.5F, 0.75F, 0.5F };
        memcpy(s.view.background, background, sizeof background);
        struct sp_camera *camera = &s.view.camera;
        for (int a = 0; a < 3; a++)
            if (k == 0)
                camera->target[a] = 2 * camera->position[a];
        if (k == 1)
            camera->near = 1000;
        if (k == 2)
            s.view.transfer_function.points[0].value = 1e6,
            s.view.transfer_function.point_count = 1;
        if (k == 3)
            camera->target[0] = camera->position[0] + 30, camera->target[2] = camera->position[2];
        struct test_image a = invariant_render(c, &s);
        for (size_t p = 0; p < (size_t)a.width * a.height; p++) {
            for (int ch = 0; ch < 3; ch++)
                assert_compare(fabs(a.rgba[p * 4 + (size_t)ch] - 0.5 * (double)background[ch]), <,
                               1e-6);
            assert_compare(fabs(a.rgba[p * 4 + 3] - 0.5), <, 1e-6);
        }
        test_image_finish(&a);
        test_scene_finish(&s);
    }
}

/* Samples that are NaN or infinite are transparent; the image contains no NaN. */
static void samples_that_are_not_finite_are_transparent(void **state) {
    struct invariant_context *c = *state;
    struct test_scene s;
    assert_true(test_scene_blobs(&s));
    float *v = s.voxels;
    for (size_t i = 0; i < (size_t)40 * 40 * 40; i++)
        if (i % 3 == 0)
            v[i] = i % 2 ? NAN : i % 5 ? INFINITY : -INFINITY;
    struct test_image a = invariant_render(c, &s);
    for (size_t i = 0; i < (size_t)40 * 40 * 40; i++)
        if (i % 3 == 0)
            v[i] = 0; /* below the first opaque point of the transfer function: transparent */
    struct test_image b = invariant_render(c, &s);
    invariant_assert_same("not-a-number", &a, &b, 80);
    test_scene_finish(&s);
}

#define ON(test)                                                                                   \
    { #test, test, NULL, NULL, c }

static int run_target(struct invariant_context *c) {
    const struct CMUnitTest tests[] = {
        ON(the_number_of_threads_does_not_change_the_image),
        ON(reconstruction_is_ewa_without_low_pass),
        ON(filters_conserve_energy),
        ON(compositors_agree_on_the_opacity),
        ON(opposite_clip_planes_add_up_to_the_whole),
        ON(a_constant_volume_looks_the_same_in_both_orders),
        ON(a_gradient_axis_of_scale_one_does_not_change_the_image),
        ON(an_rgba8_frame_is_the_rounded_float_frame),
        ON(an_empty_view_shows_the_background),
        ON(samples_that_are_not_finite_are_transparent),
    };
    /* Software GL is slow: it runs only the tests that its comparison with the scalar reference
     * (ewa_test.c) does not cover. */
    const struct CMUnitTest few[] = {
        ON(a_gradient_axis_of_scale_one_does_not_change_the_image),
        ON(an_rgba8_frame_is_the_rounded_float_frame),
        ON(an_empty_view_shows_the_background),
        ON(samples_that_are_not_finite_are_transparent),
    };
    if (strcmp(c->target.backend, "gl-software") == 0)
        return cmocka_run_group_tests(few, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}

int main(void) {
    return invariant_run(run_target);
}
