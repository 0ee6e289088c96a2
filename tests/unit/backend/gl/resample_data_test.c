/* SPDX-License-Identifier: Apache-2.0
 *
 * Sheets of interpolated values on software GL: work that is divided, data that stays on the GPU,
 * views that are refused, and order auto.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/compare.h"
#include "support/data.h"
#include "support/gl.h"
#include "support/render.h"
#include "support/scene.h"
#include "unit/backend/gl/resample_rig.h"

static void pieces_add_up_to_the_whole_image(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *volume = resample_make_ball(SP_UINT16, 0, 1000, false, false);
    struct sp_view view;
    resample_make_view(&view, volume, 0, 1000);
    view.shading.mode = SP_SHADING_PHONG;
    for (int a = 0; a < 3; a++) /* the images of three axes are mixed */
        view.camera.position[a] = 20 + a;
    const struct resample_shot shot = { &view, volume, 0, NULL, NULL };
    const struct gl_limits limits = gl->workload.limits;
    struct test_image whole = resample_draw(rig, GL, &shot, NULL);
    for (int n = 0; n < 4; n++) {
        gl->workload.limits.tiles = n & 1 ? 1 : limits.tiles; /* one row of tiles per band */
        gl->resample.work = n & 2 ? 1 : gl->resample.work;    /* and per dispatch */
        struct test_image pieces = resample_draw(rig, GL, &shot, NULL);
        assert_compare(test_image_psnr(&pieces, &whole), >=, 110);
        test_image_finish(&pieces);
    }
    gl->workload.limits = limits;
    test_image_finish(&whole);
    sp_volume_unref(&volume);
}

static void dispatches_stay_short(void **state) {
    (void)state;
    struct gl_resample resample;
    gl_resample_init(&resample);
    uint32_t first = resample.work;
    gl_resample_adapt(&resample, 10, 25);
    assert_int_equal(resample.work, first);
    gl_resample_adapt(&resample, 30, 25);
    assert_int_equal(resample.work, first / 2);
    gl_resample_adapt(&resample, 1, 25);
    assert_int_equal(resample.work, first);
    for (int i = 0; i < 40; i++)
        gl_resample_adapt(&resample, 100, 25);
    assert_in_range(resample.work, 1, first);
    for (int i = 0; i < 40; i++)
        gl_resample_adapt(&resample, 0, 25);
    assert_in_range(resample.work, first, (uint32_t)1 << 24);
    gl_resample_init(&resample);
    gl_resample_adapt(&resample, 1000, INFINITY); /* software GL */
    assert_in_range(resample.work, first, (uint32_t)1 << 24);
}

static void what_is_resident_is_not_uploaded_again(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    const uint64_t voxels = X * Y * Z, table = CURVE_BYTES;
    for (int is_double = 0; is_double < 2; is_double++) {
        struct sp_volume *volume =
            resample_make_ball(is_double ? SP_FLOAT64 : SP_FLOAT32, 0, 1, false, false);
        struct sp_view view;
        resample_make_view(&view, volume, 0, 1);
        const struct resample_shot shot = { &view, volume, 0, NULL, NULL };
        uint64_t uploaded = gl->residency.uploaded;
        struct test_image image = resample_draw(rig, GL, &shot, NULL);
        test_image_finish(&image);
        assert_compare(gl->residency.uploaded - uploaded, >=, voxels * sizeof(float) + table);
        uploaded = gl->residency.uploaded;
        view.camera.position[0] += 2; /* the same axis */
        image = resample_draw(rig, GL, &shot, NULL);
        test_image_finish(&image);
        assert_compare(gl->residency.uploaded, ==, uploaded);
        view.transfer_function.points[1].opacity *= 0.5f;
        resample_check(rig, "after an edit", &shot);
        uint64_t edit = gl->residency.uploaded - uploaded;
        assert_compare(edit, >=, table); /* levels are made for a transfer function */
        assert_compare(edit, <, table + voxels * (is_double ? sizeof(float) + 1 : 1));
        view.transfer_function.points[1].opacity *= 2; /* back */
        uploaded = gl->residency.uploaded;
        resample_check(rig, "after another edit", &shot);
        assert_compare(gl->residency.uploaded, ==, uploaded);
        rig->backends[GL]->evict(gl, volume);
        assert_compare(rig->backends[GL]->memory(gl, volume), ==, 0);
        sp_volume_unref(&volume);
    }
    resample_report(rig);
}

static void a_frame_that_does_not_fit_is_refused(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *volume = resample_make_ball(SP_UINT16, 0, 1000, false, false);
    struct sp_view view;
    resample_make_view(&view, volume, 0, 1000);
    const struct resample_shot shot = { &view, volume, 0, NULL, NULL };
    uint64_t limit = gl->residency.limit_bytes, memory = gl->memory_bytes;
    struct sp_error err;
    gl->residency.limit_bytes = 1000;
    assert_false(resample_try(rig, GL, &shot, NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, " 1000 "));
    gl->residency.limit_bytes = limit;
    rig->backends[GL]->evict(gl, volume);
    gl->memory_bytes = 1000;
    assert_false(resample_try(rig, GL, &shot, NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    gl->memory_bytes = memory;
    resample_check(rig, "after it", &shot);
    /* Enough for one of two volumes: each frame evicts the data of the other one. */
    struct sp_volume *other = resample_make_ball(SP_FLOAT64, 0, 1000, false, false);
    gl->residency.limit_bytes =
        gl_draw_bytes(gl) + gl_residency_bytes(&gl->residency, volume) + X * Y * Z * sizeof(float);
    for (int n = 0; n < 4; n++)
        resample_check(rig, "in turn",
                       &(struct resample_shot){ &view, n % 2 ? volume : other, 0, NULL, NULL });
    gl->residency.limit_bytes = limit;
    sp_volume_unref(&volume);
    sp_volume_unref(&other);
    resample_report(rig);
}

/* Without memory for the sheets of a second axis, the image has sheets of one axis only. */
static void an_axis_that_does_not_fit_is_left_out(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *volume = resample_make_ball(SP_FLOAT32, 0, 1000, false, false);
    struct sp_view view;
    resample_make_view(&view, volume, 0, 1000);
    memcpy(view.camera.position, (double[3]){ 25, 24.5, 3 }, sizeof view.camera.position);
    const struct resample_shot shot = { &view, volume, 0, NULL, NULL };
    struct test_image both = resample_draw(rig, GL, &shot, NULL);
    uint64_t needed = gl_draw_bytes(gl) + gl_residency_bytes(&gl->residency, volume);
    uint64_t limit = gl->residency.limit_bytes;
    gl->residency.limit_bytes = needed - 1;
    rig->backends[GL]->evict(gl, volume);
    struct test_image one = resample_draw(rig, GL, &shot, NULL);
    double psnr = test_image_psnr(&one, &both);
    assert_true(psnr < 100);
    assert_true(psnr > 25);
    gl->residency.limit_bytes = limit;
    test_image_finish(&both);
    test_image_finish(&one);
    sp_volume_unref(&volume);
}

static void a_cancelled_frame_leaves_nothing_behind(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *volume = resample_make_ball(SP_FLOAT64, 0, 1, false, false);
    struct sp_view view;
    atomic_bool cancel = true;
    struct sp_error err;
    resample_make_view(&view, volume, 0, 1);
    assert_false(resample_try(rig, GL, &(struct resample_shot){ &view, volume, 0, &cancel, NULL },
                              NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    resample_check(rig, "after it", &(struct resample_shot){ &view, volume, 0, NULL, NULL });
    sp_volume_unref(&volume);
    resample_report(rig);
}

static void auto_chooses_interpolated_values(void **state) {
    struct resample_rig *rig = *state;
    struct sp_renderer_options options = { .backend = test_gl(), .threads = 1 };
    struct sp_error err;
    struct sp_renderer *renderer = sp_renderer_create(&options, &err);
    struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, false);
    struct sp_frame *frames[2];
    struct sp_view view;
    assert_non_null(renderer);
    resample_make_view(&view, volume, 0, 255);
    for (int i = 0; i < 2; i++) {
        view.transfer_function.order = i ? SP_TF_AUTO : SP_TF_POST;
        frames[i] = sp_renderer_render(renderer, volume, &view, rig->pool, NULL, &err);
        if (!frames[i])
            fail_msg("%s", err.text);
    }
    assert_true(test_frames_equal(frames[0], frames[1]));
    for (int i = 0; i < 2; i++)
        sp_frame_unref(&frames[i]);
    view.shading.mode = SP_SHADING_PHONG; /* light is refused, not drawn without it */
    view.shading.shadow = 0.5f;
    assert_null(sp_renderer_render(renderer, volume, &view, rig->pool, NULL, &err));
    assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
    assert_string_equal(err.place, "/shading/shadow");
    sp_renderer_destroy(&renderer);
    sp_volume_unref(&volume);
}

static double small_ball(const void *user, double x, double y, double z) {
    (void)user;
    x -= 64, y -= 64, z -= 32;
    return fmax(0, 60000 - 6000 * sqrt(x * x + y * y + z * z));
}

/* The samples take more video memory than there is, the visible voxels much less. */
static void auto_is_pre_if_the_samples_do_not_fit(void **state) {
    struct resample_rig *rig = *state;
    struct sp_renderer_options options = { .backend = test_gl(),
                                           .threads = 1,
                                           .video_bytes = (uint64_t)7 << 18 };
    struct sp_error err;
    struct sp_renderer *renderer = sp_renderer_create(&options, &err);
    struct test_scene scene;
    test_view_init(&scene.view);
    test_scene_points(&scene, (const double[][5]){ { 20000, 1, 0, 0, 0 }, { 60000, 1, 1, 0, 0.3 } },
                      2);
    assert_true(test_scene_voxels(&scene, "ball", (uint32_t[]){ 128, 128, 64 },
                                  (double[]){ 1, 1, 1 }, SP_UINT16, small_ball, NULL));
    struct sp_volume *volume = test_scene_volume(&scene, NULL);
    assert_non_null(volume);
    assert_non_null(renderer);
    test_scene_orbit(&scene, NULL, 30, 20, 60);
    scene.view.size[0] = scene.view.size[1] = 24;
    scene.view.filter.mode = SP_FILTER_ADAPTIVE;
    scene.view.compositing.mode = SP_COMPOSITE_SHEET;
    scene.view.transfer_function.order = SP_TF_POST;
    assert_null(sp_renderer_render(renderer, volume, &scene.view, rig->pool, NULL, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    struct sp_frame *frames[2];
    for (int i = 0; i < 2; i++) {
        scene.view.transfer_function.order = i ? SP_TF_AUTO : SP_TF_PRE;
        frames[i] = sp_renderer_render(renderer, volume, &scene.view, rig->pool, NULL, &err);
        if (!frames[i])
            fail_msg("%s", err.text);
    }
    assert_true(test_frames_equal(frames[0], frames[1]));
    for (int i = 0; i < 2; i++)
        sp_frame_unref(&frames[i]);
    sp_renderer_destroy(&renderer);
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
}

static void light_is_refused(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, false);
    struct sp_view view;
    struct sp_error err;
    resample_make_view(&view, volume, 0, 255);
    view.shading.mode = SP_SHADING_PHONG;
    view.shading.occlusion = 0.5f;
    assert_false(resample_try(rig, GL, &(struct resample_shot){ &view, volume, 0, NULL, NULL },
                              NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
    assert_string_equal(err.place, "/shading");
    sp_volume_unref(&volume);
}

int main(void) {
    struct resample_rig rig;
    struct sp_error err;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    if (!resample_rig_open(&rig, &err)) {
        printf("skipped: no software GL here: %s\n", err.text);
        resample_rig_close(&rig);
        return TEST_SKIPPED;
    }
#define ON(test)                                                                                   \
    { #test, test, NULL, NULL, &rig }
    const struct CMUnitTest tests[] = {
        ON(pieces_add_up_to_the_whole_image),        ON(dispatches_stay_short),
        ON(what_is_resident_is_not_uploaded_again),  ON(a_frame_that_does_not_fit_is_refused),
        ON(a_cancelled_frame_leaves_nothing_behind), ON(auto_chooses_interpolated_values),
        ON(auto_is_pre_if_the_samples_do_not_fit),   ON(light_is_refused),
        ON(an_axis_that_does_not_fit_is_left_out),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    resample_rig_close(&rig);
    return failed;
}
