/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares images of the CPU backend with values that are known without it: analytic depths, images
 * of the same view in other sizes, the background.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "support/compare.h"
#include "support/gl.h"
#include "unit/backend/rig.h"

/* The filter adaptive may merge thin sheets. That must be invisible with either attenuation. */
static void thin_sheets_attenuate_alike(void **state) {
    (void)state;
    for (int linear = 0; linear < 2; linear++) {
        struct rig rig = rig_make("cpu", 2, rig_make_ball(48, (double[3]){ 1, 1, 1 }));
        rig.view.shading.mode = SP_SHADING_NONE;
        rig.view.compositing.attenuation =
            linear ? SP_ATTENUATION_LINEAR : SP_ATTENUATION_EXPONENTIAL;
        for (uint32_t i = 0; i < rig.view.transfer_function.point_count; i++)
            rig.view.transfer_function.points[i].opacity =
                rig.view.transfer_function.points[i].opacity > 0 ? 0.02f : 0;
        rig.view.camera.projection =
            SP_ORTHOGRAPHIC; /* all footprints are equal, so that sheets are merged */
        rig.view.camera.height = 60;
        rig.view.filter.mode = SP_FILTER_EWA;
        struct sp_frame *ewa = rig_draw(&rig, SP_RGBAF32);
        rig.view.filter.mode = SP_FILTER_ADAPTIVE;
        struct sp_frame *adaptive = rig_draw(&rig, SP_RGBAF32);
        float most = 0;
        for (uint32_t y = 0; y < ewa->height; y++)
            for (uint32_t x = 0; x < ewa->width; x++)
                for (int c = 0; c < 3; c++) {
                    float a = rig_pixel(ewa, x, y)[c], b = rig_pixel(adaptive, x, y)[c];
                    most = fmaxf(most, a);
                    assert_compare(fabsf(a - b), <, 0.006f);
                }
        assert_compare(most, >, 0.1f); /* the volume is visible */
        sp_frame_unref(&ewa);
        sp_frame_unref(&adaptive);
        rig_finish(&rig);
    }
}

static void one_voxel_has_its_analytic_depth(void **state) {
    (void)state;
    struct rig rig = rig_make("cpu", 1, rig_make_voxel());
    rig.view.transfer_function = (struct sp_transfer_function){
        .reference_length = 1, .point_count = 1, .points = { { 0, { 1, 1, 1 }, 0.5f } }
    };
    rig.view.shading.mode = SP_SHADING_NONE;
    rig.view.background[3] = 0;
    rig.view.filter.mode = SP_FILTER_EWA;
    rig.view.filter.lowpass = 0;
    rig.view.size[0] = rig.view.size[1] = 101;
    rig.view.camera = (struct sp_camera){ .projection = SP_ORTHOGRAPHIC,
                                          .position = { 0, 0, -5 },
                                          .up = { 0, -1, 0 },
                                          .fov_y = 30,
                                          .height = 10.1,
                                          .near = 0.1 };
    double top = log(2) / (2 * M_PI * 0.49),
           back = 1 - exp(-4.5); /* g/(2πσ²), and the part beyond the cutoff */
    for (int footprint = 0; footprint < 2; footprint++) {
        rig.view.compositing.mode = footprint ? SP_COMPOSITE_SPLAT : SP_COMPOSITE_SHEET;
        struct sp_frame *frame = rig_draw(&rig, SP_RGBAF32);
        bool is_cut = footprint || strcmp(frame->stats.isa, "scalar") == 0;
        for (int x = 0; x < 101; x++) {
            double r = abs(x - 50) * 0.1 / 0.7, tau = top * exp(-0.5 * r * r);
            if (is_cut)
                tau = r < 3 ? tau / back : 0;
            double error = fabs((double)rig_pixel(frame, (uint32_t)x, 50)[3] - (1 - exp(-tau)));
            /* A post-convolved sheet differs from a Gaussian by its B-splines and its last samples.
             */
            bool is_at_cutoff = is_cut && fabs(r - 3) < 1e-3;
            if (!is_at_cutoff)
                assert_compare(error, <, is_cut ? 1e-5 : 1e-3);
        }
        assert_int_equal(frame->stats.splats, 1);
        sp_frame_unref(&frame);
    }
    rig_finish(&rig);
}

/* The statistics count the points of surfaces, without points outside of the image. */
static void points_of_surfaces_are_counted(void **state) {
    (void)state;
    const char *const backends[] = { "cpu", test_gl() };
    struct sp_error err;
    for (int b = 0; b < 2; b++) {
        const struct sp_renderer_options options = { .backend = backends[b], .threads = 2 };
        struct sp_renderer *probe = sp_renderer_create(&options, &err);
        if (!probe) {
            print_message("skipped: %s\n", err.text);
            continue;
        }
        sp_renderer_destroy(&probe);
        struct rig rig = rig_make(backends[b], 2, rig_make_ball(40, (double[3]){ 1, 1, 1 }));
        rig.view.layers[0] = sp_layer_default(SP_LAYER_SURFACE);
        rig.view.layers[0].value = 500;
        struct sp_frame *frame = rig_draw(&rig, SP_RGBAF32);
        uint64_t all = frame->stats.visible_voxels;
        assert_compare(all, >, 500);
        assert_compare(frame->stats.splats, ==, all);
        sp_frame_unref(&frame);
        for (int k = 0; k < 3; k++) { /* a corner of the ball */
            rig.view.camera.position[k] = 30 + 4 * (k == 0);
            rig.view.camera.target[k] = 30;
        }
        rig.view.camera.fov_y = 20;
        frame = rig_draw(&rig, SP_RGBAF32);
        assert_compare(frame->stats.visible_voxels, ==, all);
        assert_compare(frame->stats.splats, <, all);
        sp_frame_unref(&frame);
        rig_finish(&rig);
    }
}

static void odd_sizes_and_places_are_drawn(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = { { 1, 1 }, { 8192, 1 }, { 1, 8192 }, { 33, 31 } };
    struct rig rig = rig_make("cpu", 2, rig_make_ball(24, (double[3]){ 1, 1, 1 }));
    rig.view.background[3] = 0;
    for (int i = 0; i < 4; i++) {
        memcpy(rig.view.size, sizes[i], sizeof rig.view.size);
        struct sp_frame *frame = rig_draw(&rig, SP_RGBAF32);
        assert_compare(rig_check_finite(frame), >, 0);
        assert_compare(frame->stats.splats, >, 0);
        sp_frame_unref(&frame);
    }
    double middle = 11.5;
    static const double eyes[][3] = {
        { 0, 0, 0 }, { 0.5, 0.5, 0.5 } /* on a voxel */, { 3, 0, 0 }, { 0, 0, 1e-6 }, { -11, 2, 4 }
    };
    for (int i = 0; i < 5; i++)
        for (int projection = 0; projection < 2; projection++)
            for (int wide = 0; wide < 2; wide++) {
                struct sp_camera *c = &rig.view.camera;
                *c = (struct sp_camera){ .projection = (enum sp_projection)projection,
                                         .up = { 0, 0, 1 },
                                         .fov_y = wide ? 170 : 30,
                                         .height = 5,
                                         .near = 1e-9 };
                for (int k = 0; k < 3; k++) {
                    c->position[k] = middle + eyes[i][k];
                    c->target[k] = c->position[k] + (k == 1 ? 5 : 1);
                }
                struct sp_frame *frame = rig_draw(&rig, SP_RGBAF32);
                assert_compare(rig_check_finite(frame), >, 0);
                sp_frame_unref(&frame);
            }
    /* The whole volume is behind the camera: the image equals the background exactly. */
    rig.view.camera.projection = SP_PERSPECTIVE;
    for (int k = 0; k < 3; k++) {
        rig.view.camera.position[k] = 200;
        rig.view.camera.target[k] = 300 + 10 * k;
    }
    rig.view.background[0] = 0.25f;
    rig.view.background[3] = 1;
    struct sp_frame *frame = rig_draw(&rig, SP_RGBAF32);
    assert_int_equal(frame->stats.splats, 0);
    for (uint32_t y = 0; y < frame->height; y++)
        for (uint32_t x = 0; x < frame->width; x++) {
            assert_compare(rig_pixel(frame, x, y)[0], ==, 0.25f);
            assert_compare(rig_pixel(frame, x, y)[3], ==, 1);
        }
    sp_frame_unref(&frame);
    rig_finish(&rig);
}

/* An image of several bands and batches must equal the image that is drawn in one piece. */
static void bands_leave_no_seam(void **state) {
    (void)state;
    struct rig rig = rig_make("cpu", 2, rig_make_ball(24, (double[3]){ 1, 1, 1 }));
    rig.view.camera.projection = SP_ORTHOGRAPHIC;
    rig.view.camera.height = 24;
    rig.view.size[0] = 2048; /* 64 tiles wide: bands of 36 rows of tiles, 1152 px */
    rig.view.size[1] = 1600;
    struct sp_frame *large = rig_draw(&rig, SP_RGBAF32);
    rig.view.size[0] = 1024; /* one band, the middle of the same image */
    struct sp_frame *part = rig_draw(&rig, SP_RGBAF32);
    double worst = 0;
    for (uint32_t y = 0; y < 1600; y++)
        for (uint32_t x = 0; x < 1024; x++)
            for (int c = 0; c < 4; c++)
                worst = fmax(worst, fabs((double)rig_pixel(large, x + 512, y)[c] -
                                         (double)rig_pixel(part, x, y)[c]));
    assert_compare(worst, <, 1e-3);
    assert_compare(rig_check_finite(part), >, 1000);
    sp_frame_unref(&large);
    sp_frame_unref(&part);
    rig_finish(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(thin_sheets_attenuate_alike),
        cmocka_unit_test(one_voxel_has_its_analytic_depth),
        cmocka_unit_test(points_of_surfaces_are_counted),
        cmocka_unit_test(odd_sizes_and_places_are_drawn),
        cmocka_unit_test(bands_leave_no_seam),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
