/* SPDX-License-Identifier: Apache-2.0
 *
 * Images of sheets of interpolated values on software GL: types of samples, directions, mip levels,
 * clipping. conformance.resample compares more scenes.
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
#include "support/scene.h"
#include "unit/backend/gl/resample_rig.h"

static void every_type_of_samples(void **state) {
    struct resample_rig *rig = *state;
    static const struct {
        enum sp_type type;
        double low, high;
        bool has_holes;
    } cases[] = {
        { SP_UINT8, 0, 255, false },        { SP_INT8, -128, 127, false },
        { SP_UINT16, 100, 1100, false },    { SP_UINT16, 64000, 65535, false },
        { SP_INT16, -30000, 30000, false }, { SP_INT32, -2e9, 2e9, false },
        { SP_INT32, 1e9, 1e9 + 40, false }, { SP_FLOAT32, -1, 1, false },
        { SP_FLOAT32, 1000, 1001, true },   { SP_FLOAT32, 0, 1e-33, false },
        { SP_FLOAT32, -3e38, 3e38, false }, { SP_FLOAT64, 1e9, 1e9 + 1, true },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int is_lit = i % 2;
        struct sp_volume *volume = resample_make_ball(cases[i].type, cases[i].low, cases[i].high,
                                                      cases[i].has_holes, is_lit);
        struct sp_view view;
        char what[40];
        resample_make_view(&view, volume, cases[i].low, cases[i].high);
        view.shading.mode = is_lit ? SP_SHADING_PHONG : SP_SHADING_NONE;
        snprintf(what, sizeof what, "type %d, case %zu, lit %d", (int)cases[i].type, i, is_lit);
        resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
        for (int b = 0; b < BACKENDS; b++)
            rig->backends[b]->evict(rig->states[b], volume);
        assert_compare(rig->backends[GL]->memory(rig->states[GL], volume), ==, 0);
        sp_volume_unref(&volume);
    }
    resample_report(rig);
}

static void every_direction(void **state) {
    struct resample_rig *rig = *state;
    for (int is_rectilinear = 0; is_rectilinear < 2; is_rectilinear++) {
        struct sp_volume *volume = resample_make_ball(SP_UINT16, 0, 1000, false, is_rectilinear);
        for (int n = is_rectilinear; n < 27; n += 1 + is_rectilinear) {
            struct sp_view view;
            char what[40];
            const int to[3] = { n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1 };
            resample_make_view(&view, volume, 0, 1000);
            if (n == 13)
                continue;
            view.camera.projection = n % 2 ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
            view.shading.mode = n % 4 < 2 ? SP_SHADING_NONE : SP_SHADING_PHONG;
            for (int a = 0; a < 3; a++) {
                view.camera.position[a] =
                    30 * to[a] + (double[]){ -10, 2, 6 }[a]; /* no two axes are equally near */
                view.camera.up[a] = (double[]){ 0.1, 0.9, 0.2 }[a];
            }
            snprintf(what, sizeof what, "from %d %d %d, axes %d", to[0], to[1], to[2],
                     is_rectilinear);
            resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
        }
        sp_volume_unref(&volume);
    }
    resample_report(rig);
}

static void other_choices(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, false);
    for (int n = 0; n < 16; n++) {
        struct sp_view view;
        char what[40];
        resample_make_view(&view, volume, 0, 255);
        view.compositing.attenuation = n & 1 ? SP_ATTENUATION_LINEAR : SP_ATTENUATION_EXPONENTIAL;
        view.transfer_function.gradient_count = n & 2 ? 2 : 0;
        view.transfer_function.gradient[0] = (struct sp_gradient_point){ 3, 0.1f };
        view.transfer_function.gradient[1] = (struct sp_gradient_point){ 25, 1 };
        view.clip.box[0][0] = n & 4 ? 0.3 : 0;
        view.clip.plane_count = n & 4 ? 1 : 0;
        view.clip.planes[0] = (struct sp_clip_plane){ { 0.5, 1, 0.7 }, -2 };
        view.shading.mode = n & 8 ? SP_SHADING_PHONG : SP_SHADING_NONE;
        view.background[3] = n & 1 ? 1 : 0.3f;
        snprintf(what, sizeof what, "choice %d", n);
        resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
    }
    sp_volume_unref(&volume);
    resample_report(rig);
}

/* Around a switch of the slices' axis two or three images are mixed, and where rays are about as
 * steep as half sheets require, two more. */
static void mixed_images(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, false);
    static const double angles[][2] = { { 44, 10 },   { 45, 0 },  { 45.5, 20 }, { 45, 35.3 },
                                        { 10, 44.5 }, { 35, 15 }, { 30, 25 } };
    for (size_t n = 0; n < sizeof angles / sizeof *angles; n++) {
        struct sp_view view;
        char what[40];
        double a = angles[n][0] * M_PI / 180, e = angles[n][1] * M_PI / 180;
        resample_make_view(&view, volume, 0, 255);
        view.camera.position[0] = 40 * sin(a) * cos(e);
        view.camera.position[1] = -40 * cos(a) * cos(e);
        view.camera.position[2] = 40 * sin(e);
        view.shading.mode = n % 2 ? SP_SHADING_PHONG : SP_SHADING_NONE;
        view.size[0] = 90;
        snprintf(what, sizeof what, "mixed image %zu", n);
        resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
    }
    sp_volume_unref(&volume);
    resample_report(rig);
}

/* Wide views, the eye in the volume, and tiles with another axis than the image. */
static void wide_views(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, false);
    static const double eyes[][3] = { { 1, 2, 3 }, { -6, 5, 7 }, { 9, 10.5, 12 }, { 14, 0, 0.5 } };
    for (int n = 0; n < 8; n++) {
        struct sp_view view;
        char what[40];
        resample_make_view(&view, volume, 0, 255);
        memcpy(view.camera.position, eyes[n / 2], sizeof eyes[0]);
        view.camera.fov_y = n % 2 ? 150 : 90;
        view.size[0] = 150;
        view.size[1] = 70;
        view.shading.mode = n % 2 ? SP_SHADING_PHONG : SP_SHADING_NONE;
        snprintf(what, sizeof what, "wide view %d", n);
        resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
    }
    sp_volume_unref(&volume);
    resample_report(rig);
}

static double waves(const void *user, double x, double y, double z) {
    (void)user;
    return 128 + 100 * sin(0.21 * x) * cos(0.17 * y + 0.3) * sin(0.19 * z + 0.5);
}

/* The camera moves from near to far away: with mip levels, and without mip levels, where blocks see
 * many samples. */
static void levels_of_detail(void **state) {
    struct resample_rig *rig = *state;
    struct test_scene scene;
    test_view_init(&scene.view);
    test_scene_points(&scene, (const double[][5]){ { 150, 1, 0, 0, 0 }, { 220, 1, 1, 0, 0.3 } }, 2);
    assert_true(test_scene_voxels(&scene, "waves", (uint32_t[]){ 96, 80, 88 },
                                  (double[]){ 1, 1, 1 }, SP_UINT8, waves, NULL));
    struct sp_volume *volume = test_scene_volume(&scene, NULL);
    assert_non_null(volume);
    scene.view.compositing.mode = SP_COMPOSITE_SHEET;
    scene.view.transfer_function.order = SP_TF_POST;
    scene.view.size[0] = scene.view.size[1] = 24;
    for (int n = 0; n < 12; n++) {
        static const double distances[] = { 150, 600, 1500 };
        char what[40];
        test_scene_orbit(&scene, NULL, 31 * n, 20, distances[n % 3]);
        scene.view.camera.fov_y = n % 3 == 2 ? 5 : 20;
        scene.view.level_of_detail = n / 3 % 2 ? SP_LOD_OFF : SP_LOD_AUTO;
        scene.view.shading.mode = n / 6 ? SP_SHADING_PHONG : SP_SHADING_NONE;
        snprintf(what, sizeof what, "detail %d", n);
        resample_check(rig, what,
                       &(struct resample_shot){ &scene.view, volume, n % 2 ? 1 : 0, NULL, NULL });
    }
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
    resample_report(rig);
}

static double ramp(const void *user, double x, double y, double z) {
    (void)user;
    return 60 + 20 * x + 15 * y + 10 * z;
}

/* Volumes of one or two samples along an axis. */
static void thin_volumes(void **state) {
    struct resample_rig *rig = *state;
    static const uint32_t sizes[][3] = {
        { 1, 1, 1 }, { 2, 2, 2 }, { 1, 7, 5 }, { 6, 1, 2 }, { 2, 5, 1 }
    };
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        for (int side = 0; side < 3; side++) {
            struct test_scene scene;
            char what[40];
            test_view_init(&scene.view);
            test_scene_points(
                &scene, (const double[][5]){ { 40, 1, 0, 0, 0.1 }, { 220, 1, 1, 0, 0.6 } }, 2);
            assert_true(test_scene_voxels(&scene, "ramp", sizes[i], (double[]){ 1, 1, 1 }, SP_UINT8,
                                          ramp, NULL));
            struct sp_volume *volume = test_scene_volume(&scene, NULL);
            assert_non_null(volume);
            scene.view.compositing.mode = SP_COMPOSITE_SHEET;
            scene.view.transfer_function.order = SP_TF_POST;
            scene.view.shading.mode = SP_SHADING_PHONG;
            scene.view.size[0] = scene.view.size[1] = 24;
            scene.view.camera.fov_y = 60;
            test_scene_orbit(&scene, NULL, side == 0 ? 80 : 10, side == 1 ? 75 : 12,
                             i < 2 ? 2.5 : 9);
            snprintf(what, sizeof what, "thin %zu, side %d", i, side);
            resample_check(rig, what,
                           &(struct resample_shot){ &scene.view, volume, 0, NULL, NULL });
            sp_volume_unref(&volume);
            test_scene_finish(&scene);
        }
    resample_report(rig);
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
        ON(every_type_of_samples), ON(every_direction), ON(other_choices),
        ON(mixed_images),          ON(wide_views),      ON(levels_of_detail),
        ON(thin_volumes),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    resample_rig_close(&rig);
    return failed;
}
