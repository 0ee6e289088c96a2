/* SPDX-License-Identifier: Apache-2.0
 *
 * Settings that must not change the image, or that must change it in a known way: threads, filters,
 * compositors, the order of classification, the format of the frame. Each test runs on every
 * backend and instruction set. geometry_test.c does the same for the geometry of the scene.
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

/* The CPU's threads make the same bytes. A GPU adds in any order, so that the last bits differ;
 * rounding then says from which splat on a tile is saturated, which is one part in 512. */
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

static void same_with_threads(struct invariant_context *c, const struct test_scene *scene,
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
    /* Other backends do not draw with threads, and take long to start. */
    size_t tries = strcmp(c->target.backend, "cpu") == 0 ? sizeof threads / sizeof *threads : 1;
    for (size_t t = 0; t < tries; t++) {
        assert_true(test_renderer_open(&many, &c->target, threads[t], &err));
        for (int again = 0; again < (t ? 1 : 2); again++) {
            struct sp_frame *frame =
                sp_renderer_render(many.renderer, volume, &scene->view, many.pool, &o, &err);
            assert_non_null(frame);
            if (!is_same_frame(&c->target, one, frame))
                fail_msg("%s: %u threads differ from one, frame %d", scene->info.name, threads[t],
                         again);
            sp_frame_unref(&frame);
        }
        test_renderer_close(&many);
    }
    sp_frame_unref(&one);
    test_renderer_close(&alone);
    sp_volume_unref(&volume);
}

static void threads_do_not_matter(void **state) {
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
                continue; /* each way once */
            struct test_scene scene;
            assert_true(builds[b](&scene));
            /* Sides that no tile divides, and enough of it that workers meet. */
            scene.view.size[0] = 149;
            scene.view.size[1] = 101;
            invariant_choose_way(&scene.view, way);
            same_with_threads(c, &scene, way & 2 ? SP_RGBA8 : SP_RGBAF32);
            test_scene_finish(&scene);
        }
}

/* Without low-pass the two filters are one formula. */
static void reconstruction_is_ewa_without_low_pass(void **state) {
    struct invariant_context *c = *state;
    struct test_scene s;
    assert_true(test_scene_thin_shells(&s));
    s.view.filter.mode = SP_FILTER_RECONSTRUCTION;
    struct test_image a = invariant_render(c, &s);
    s.view.filter.mode = SP_FILTER_EWA;
    s.view.filter.lowpass = 0;
    struct test_image b = invariant_render(c, &s);
    invariant_same("reconstruction", &a, &b, 100);
    test_scene_finish(&s);
}

/* Energy is conserved: the summed optical depth of a thin medium does not depend on the filter. */
static void filters_keep_the_energy(void **state) {
    struct invariant_context *c = *state;
    struct test_scene s;
    double reference = 0;
    assert_true(test_scene_blobs(&s));
    for (uint32_t i = 0; i < s.view.transfer_function.point_count; i++)
        s.view.transfer_function.points[i].opacity *= 0.01F;
    test_scene_orbit(&s, NULL, -30, 20, 90); /* nothing reaches the border */
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
        print_message("  filter %d, kernel %d: summed depth %.4f\n", k % 6, k / 6, sum);
        assert_true(reference > 1);
        assert_true(fabs(sum / reference - 1) < 0.005);
        test_image_finish(&a);
    }
    test_scene_finish(&s);
}

/* Attenuation that is exponential multiplies up to the same whatever is added first: compositors
 * differ in colour alone. */
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
        bool is_other = test_uses_postconv(&c->target, &s);
        s.view.compositing.mode = invariant_modes[b % INVARIANT_MODES];
        s.view.compositing.slab = 0.7;
        struct test_image d = invariant_render(c, &s);
        char name[160];
        snprintf(name, sizeof name, "%s-opacity-%zu", s.info.name, b % INVARIANT_MODES);
        invariant_same(name, &d, &a,
                       is_other && b % INVARIANT_MODES ? INVARIANT_POSTCONV_FLOOR : 80);
        test_scene_finish(&s);
    }
}

/* What a plane keeps and what it takes away are the whole: their optical depths add up. */
static void opposite_clip_planes_add_up_to_the_whole(void **state) {
    struct invariant_context *c = *state;
    for (int way = 0; way < INVARIANT_POST_WAY;
         way++) { /* classified after the cut, they need not */
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
        print_message("  way %d: depths up to %.2f add up within %.1g\n", way, most, worst);
        assert_compare(most, >, 0.5);
        assert_compare(worst, <, slack * most);
        for (int k = 0; k < 3; k++)
            test_image_finish(&parts[k]);
        test_scene_finish(&s);
    }
}

/* Where the value is the same everywhere it does not matter when it is classified. */
static void the_order_does_not_matter_to_a_constant(void **state) {
    struct invariant_context *c = *state;
    struct test_scene s;
    assert_true(test_scene_constant_cube(&s));
    s.view.compositing.mode = SP_COMPOSITE_SLAB;
    struct test_image a = invariant_render(c, &s);
    s.view.transfer_function.order = SP_TF_POST;
    struct test_image b = invariant_render(c, &s);
    invariant_same("order", &b, &a, 80);
    test_scene_finish(&s);
}

/* A gradient axis of ones, and one that is reached nowhere. */
static void a_flat_gradient_axis_changes_nothing(void **state) {
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
        invariant_same(k & 1 ? "gradient-axis-post" : "gradient-axis", &b, &a, 100);
        test_scene_finish(&s);
    }
}

static void eight_bits_are_the_rounded_floats(void **state) {
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
        /* Half a step for the alpha; a colour is rounded after and before it is associated. */
        struct test_difference d = test_image_difference(&floats, &bytes);
        print_message("  background %d: largest difference %.3f steps\n", k, d.largest * 255);
        assert_true(d.largest < 1.05 / 255);
        if (backgrounds[k][3] >= 1)
            for (size_t p = 0; p < (size_t)bytes.width * bytes.height; p++)
                assert_true(bytes.rgba[p * 4 + 3] == 1);
        sp_frame_unref(&frame);
        sp_volume_unref(&volume);
        test_image_finish(&floats);
        test_image_finish(&bytes);
        test_scene_finish(&s);
    }
}

/* Nothing in front of the eye, all of it nearer than near, or nothing visible: the background. */
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
                assert_true(fabs(a.rgba[p * 4 + (size_t)ch] - 0.5 * (double)background[ch]) < 1e-6);
            assert_true(fabs(a.rgba[p * 4 + 3] - 0.5) < 1e-6);
        }
        test_image_finish(&a);
        test_scene_finish(&s);
    }
}

/* Samples that are not numbers are transparent: a hole, never a NaN in the image. */
static void nan_samples_are_transparent(void **state) {
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
            v[i] = 0; /* outside the transfer function: transparent */
    struct test_image b = invariant_render(c, &s);
    invariant_same("not-a-number", &a, &b, 80);
    test_scene_finish(&s);
}

#define ON(test)                                                                                   \
    { #test, test, NULL, NULL, c }

static int run_target(struct invariant_context *c) {
    const struct CMUnitTest tests[] = {
        ON(threads_do_not_matter),
        ON(reconstruction_is_ewa_without_low_pass),
        ON(filters_keep_the_energy),
        ON(compositors_agree_on_the_opacity),
        ON(opposite_clip_planes_add_up_to_the_whole),
        ON(the_order_does_not_matter_to_a_constant),
        ON(a_flat_gradient_axis_changes_nothing),
        ON(eight_bits_are_the_rounded_floats),
        ON(an_empty_view_shows_the_background),
        ON(nan_samples_are_transparent),
    };
    /* Software GL is slow: it runs what its comparison to the reference (ewa_test.c) does not
     * cover. */
    const struct CMUnitTest few[] = {
        ON(a_flat_gradient_axis_changes_nothing),
        ON(eight_bits_are_the_rounded_floats),
        ON(an_empty_view_shows_the_background),
        ON(nan_samples_are_transparent),
    };
    if (strcmp(c->target.backend, "gl-software") == 0)
        return cmocka_run_group_tests(few, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}

int main(void) {
    return invariant_run(run_target);
}
