/* SPDX-License-Identifier: Apache-2.0
 *
 * Sheets of interpolated values on software GL, compared with the scalar kernels of the CPU: types
 * of samples, directions, mip levels, clipping, and work that is divided. conformance.resample
 * compares more scenes.
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

#include "backend/backend.h"
#include "backend/gl/state.h"
#include "sp/log.h"
#include "support/compare.h"
#include "support/data.h"
#include "support/image.h"
#include "support/render.h"
#include "support/sanitized.h"
#include "support/scene.h"

enum { CPU, GL, BACKENDS, X = 21, Y = 17, Z = 25 };

static const double alike = 70; /* dB: the floor of conformance.resample between kernels */

struct rig {
    const struct sp_backend *backends[BACKENDS];
    void *states[BACKENDS];
    struct sp_frame_pool *pool;
    unsigned drawn;
    double worst; /* dB */
};

static const struct sp_backend *find_backend(const char *name) {
    for (unsigned i = 0; sp_registry_at(i); i++)
        if (strcmp(sp_registry_at(i)->entry.name, name) == 0)
            return sp_registry_at(i);
    return NULL;
}

static bool open_rig(struct rig *rig, struct sp_error *err) {
    const struct sp_backend_options options = {
        .threads = 1, .memory_bytes = (uint64_t)1 << 30, .isa = "scalar", .gpu = -1
    };
    *rig = (struct rig){ .backends = { find_backend("cpu"), find_backend("gl-software") } };
    for (int b = 0; b < BACKENDS; b++)
        if (!(rig->states[b] = rig->backends[b]->create(&options, err)))
            return false;
    rig->pool = sp_frame_pool_create((size_t)64 << 20, err);
    return rig->pool != NULL;
}

static void close_rig(struct rig *rig) {
    for (int b = 0; b < BACKENDS; b++)
        if (rig->states[b])
            rig->backends[b]->destroy(rig->states[b]);
    if (rig->pool)
        sp_frame_pool_destroy(&rig->pool);
}

static struct gl_state *gl_of(const struct rig *rig) {
    return rig->states[GL];
}

struct shot {
    const struct sp_view *view;
    struct sp_volume *volume;
    unsigned mip_level;
    const atomic_bool *cancel;
};

static bool try_draw(struct rig *rig, int by, const struct shot *shot, struct test_image *image,
                     struct sp_frame_stats *stats, struct sp_error *err) {
    const struct sp_view *view = shot->view;
    struct sp_frame *frame =
        sp_frame_create(rig->pool, view->size[0], view->size[1], SP_RGBAF32, err);
    assert_non_null(frame);
    const struct sp_backend_job job = { .volume = shot->volume,
                                        .view = view,
                                        .mip_level = shot->mip_level,
                                        .frame = frame,
                                        .cancel = shot->cancel };
    bool ok = rig->backends[by]->render(rig->states[by], &job, err);
    if (ok && image)
        assert_true(test_image_from_frame(image, frame));
    if (stats)
        *stats = frame->stats;
    sp_frame_unref(&frame);
    return ok;
}

static struct test_image draw(struct rig *rig, int by, const struct shot *shot,
                              struct sp_frame_stats *stats) {
    struct test_image image;
    struct sp_error err;
    if (!try_draw(rig, by, shot, &image, stats, &err))
        fail_msg("backend %s: %s", rig->backends[by]->entry.name, err.text);
    return image;
}

/* Both backends draw it, and must agree. */
static void check(struct rig *rig, const char *what, const struct shot *shot) {
    struct sp_frame_stats stats[BACKENDS];
    struct test_image images[BACKENDS];
    for (int b = 0; b < BACKENDS; b++)
        images[b] = draw(rig, b, shot, &stats[b]);
    double psnr = test_image_psnr(&images[GL], &images[CPU]), mean, variance;
    test_image_statistics(&images[CPU], 3, &mean, &variance);
    if (!(psnr >= alike)) {
        test_image_dump(what, &images[GL], &images[CPU], 8);
        fail_msg("%s: %.1f dB", what, psnr);
    }
    if (!(mean > 0.01))
        fail_msg("%s: nothing is visible", what);
    assert_int_equal(stats[GL].mip_level, stats[CPU].mip_level);
    assert_compare(stats[GL].visible_voxels, ==, stats[CPU].visible_voxels);
    rig->worst = rig->drawn++ ? fmin(rig->worst, psnr) : psnr;
    for (int b = 0; b < BACKENDS; b++)
        test_image_finish(&images[b]);
}

static void report(struct rig *rig) {
    print_message("  %u views, %.1f dB at least\n", rig->drawn, rig->worst);
    rig->drawn = 0;
}

static double ball(double x, double y, double z) {
    return fmax(0, 1 - 0.11 * sqrt(x * x + y * y + z * z / 2));
}

/* A ball whose values are low + share·(high − low), in samples of a type. */
static struct sp_volume *make_ball(enum sp_type type, double low, double high, bool has_holes,
                                   bool is_rectilinear) {
    static double at[3][Z];
    static union {
        uint8_t u8[X * Y * Z];
        int8_t i8[X * Y * Z];
        uint16_t u16[X * Y * Z];
        int16_t i16[X * Y * Z];
        int32_t i32[X * Y * Z];
        float f32[X * Y * Z];
        double f64[X * Y * Z];
    } voxels;
    struct sp_grid grid = { .dims = { X, Y, Z },
                            .spacing = { 1, 1, 1.5 },
                            .origin = { -10, -8, -18 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    for (unsigned a = 0; is_rectilinear && a < 3; a++) {
        for (uint32_t i = 1; i < grid.dims[a]; i++)
            at[a][i] = at[a][i - 1] + 0.4 + 0.08 * fabs(i - 0.5 * grid.dims[a]);
        grid.spacing[a] = at[a][grid.dims[a] - 1] / (grid.dims[a] - 1);
        grid.coordinates[a] = at[a];
        grid.origin[a] = -0.5 * at[a][grid.dims[a] - 1];
    }
    for (int i = 0; i < X * Y * Z; i++) {
        double value = low + ball(i % X - 10, i / X % Y - 8, i / X / Y - 12) * (high - low);
        if (has_holes && i % 97 == 0)
            value = i % 2 ? (double)NAN : (double)INFINITY;
        switch (type) {
        case SP_UINT8:
            voxels.u8[i] = (uint8_t)lrint(value);
            break;
        case SP_INT8:
            voxels.i8[i] = (int8_t)lrint(value);
            break;
        case SP_UINT16:
            voxels.u16[i] = (uint16_t)lrint(value);
            break;
        case SP_INT16:
            voxels.i16[i] = (int16_t)lrint(value);
            break;
        case SP_INT32:
            voxels.i32[i] = (int32_t)lrint(value);
            break;
        case SP_FLOAT32:
            voxels.f32[i] = (float)value;
            break;
        default:
            voxels.f64[i] = value;
        }
    }
    struct sp_error err;
    struct sp_volume *volume = sp_volume_create(&grid, type, &voxels, "ball", &err);
    if (!volume)
        fail_msg("%s", err.text);
    return volume;
}

/* Shows the ball from `low` on. */
static void make_view(struct sp_view *view, const struct sp_volume *volume, double low,
                      double high) {
    double span = high - low;
    sp_view_init(view, sp_volume_info(volume), "v");
    view->size[0] = 40;
    view->size[1] = 27;
    view->transfer_function = (struct sp_transfer_function){
        .order = SP_TF_POST,
        .reference_length = 1,
        .point_count = 3,
        .points = { { low + 0.1 * span, { 1, 0.5f, 0.2f }, 0 },
                    { low + 0.4 * span, { 0.2f, 0.6f, 1 }, 0.2f },
                    { low + 0.9 * span, { 0.2f, 1, 0.3f }, 0.6f } },
    };
    view->background[3] = 0;
    view->compositing.mode = SP_COMPOSITE_SHEET;
    view->shading.mode = SP_SHADING_NONE;
    for (int a = 0; a < 3; a++) {
        view->camera.target[a] = 0;
        view->camera.position[a] = (double[]){ 20, -45, 12 }[a];
    }
    view->camera.height = 30;
}

static void every_type_of_samples(void **state) {
    struct rig *rig = *state;
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
        struct sp_volume *volume =
            make_ball(cases[i].type, cases[i].low, cases[i].high, cases[i].has_holes, is_lit);
        struct sp_view view;
        char what[40];
        make_view(&view, volume, cases[i].low, cases[i].high);
        view.shading.mode = is_lit ? SP_SHADING_PHONG : SP_SHADING_NONE;
        snprintf(what, sizeof what, "type %d, case %zu, lit %d", (int)cases[i].type, i, is_lit);
        check(rig, what, &(struct shot){ &view, volume, 0, NULL });
        for (int b = 0; b < BACKENDS; b++)
            rig->backends[b]->evict(rig->states[b], volume);
        assert_compare(rig->backends[GL]->memory(rig->states[GL], volume), ==, 0);
        sp_volume_unref(&volume);
    }
    report(rig);
}

static void every_direction(void **state) {
    struct rig *rig = *state;
    for (int is_rectilinear = 0; is_rectilinear < 2; is_rectilinear++) {
        struct sp_volume *volume = make_ball(SP_UINT16, 0, 1000, false, is_rectilinear);
        for (int n = is_rectilinear; n < 27; n += 1 + is_rectilinear) {
            struct sp_view view;
            char what[40];
            const int to[3] = { n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1 };
            make_view(&view, volume, 0, 1000);
            if (n == 13)
                continue;
            view.camera.projection = n % 2 ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
            view.shading.mode = n % 4 < 2 ? SP_SHADING_NONE : SP_SHADING_PHONG;
            for (int a = 0; a < 3; a++) {
                view.camera.position[a] = 30 * to[a] + 1.5 * (a - 1);
                view.camera.up[a] = (double[]){ 0.1, 0.9, 0.2 }[a];
            }
            snprintf(what, sizeof what, "from %d %d %d, axes %d", to[0], to[1], to[2],
                     is_rectilinear);
            check(rig, what, &(struct shot){ &view, volume, 0, NULL });
        }
        sp_volume_unref(&volume);
    }
    report(rig);
}

static void other_choices(void **state) {
    struct rig *rig = *state;
    struct sp_volume *volume = make_ball(SP_UINT8, 0, 255, false, false);
    for (int n = 0; n < 16; n++) {
        struct sp_view view;
        char what[40];
        make_view(&view, volume, 0, 255);
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
        check(rig, what, &(struct shot){ &view, volume, 0, NULL });
    }
    sp_volume_unref(&volume);
    report(rig);
}

/* Wide views, the eye in the volume, and tiles with another axis than the image. */
static void wide_views(void **state) {
    struct rig *rig = *state;
    struct sp_volume *volume = make_ball(SP_UINT8, 0, 255, false, false);
    static const double eyes[][3] = { { 1, 2, 3 }, { -6, 5, 7 }, { 9, 9, 9 }, { 14, 0, 0.5 } };
    for (int n = 0; n < 8; n++) {
        struct sp_view view;
        char what[40];
        make_view(&view, volume, 0, 255);
        memcpy(view.camera.position, eyes[n / 2], sizeof eyes[0]);
        view.camera.fov_y = n % 2 ? 150 : 90;
        view.size[0] = 150;
        view.size[1] = 70;
        view.shading.mode = n % 2 ? SP_SHADING_PHONG : SP_SHADING_NONE;
        snprintf(what, sizeof what, "wide view %d", n);
        check(rig, what, &(struct shot){ &view, volume, 0, NULL });
    }
    sp_volume_unref(&volume);
    report(rig);
}

static double waves(const void *user, double x, double y, double z) {
    (void)user;
    return 128 + 100 * sin(0.21 * x) * cos(0.17 * y + 0.3) * sin(0.19 * z + 0.5);
}

/* From near to far away: mip levels, and without them blocks that see many samples. */
static void levels_of_detail(void **state) {
    struct rig *rig = *state;
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
        check(rig, what, &(struct shot){ &scene.view, volume, n % 2 ? 1 : 0, NULL });
    }
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
    report(rig);
}

static double ramp(const void *user, double x, double y, double z) {
    (void)user;
    return 60 + 20 * x + 15 * y + 10 * z;
}

/* Volumes of one or two samples along an axis. */
static void thin_volumes(void **state) {
    struct rig *rig = *state;
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
            check(rig, what, &(struct shot){ &scene.view, volume, 0, NULL });
            sp_volume_unref(&volume);
            test_scene_finish(&scene);
        }
    report(rig);
}

static void pieces_add_up_to_the_whole_image(void **state) {
    struct rig *rig = *state;
    struct gl_state *gl = gl_of(rig);
    struct sp_volume *volume = make_ball(SP_UINT16, 0, 1000, false, false);
    struct sp_view view;
    make_view(&view, volume, 0, 1000);
    view.shading.mode = SP_SHADING_PHONG;
    const struct shot shot = { &view, volume, 0, NULL };
    const struct gl_limits limits = gl->workload.limits;
    struct test_image whole = draw(rig, GL, &shot, NULL);
    for (int n = 0; n < 4; n++) {
        gl->workload.limits.tiles = n & 1 ? 1 : limits.tiles; /* one row of tiles per band */
        gl->resample.work = n & 2 ? 1 : gl->resample.work;    /* and per dispatch */
        struct test_image pieces = draw(rig, GL, &shot, NULL);
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
    struct rig *rig = *state;
    struct gl_state *gl = gl_of(rig);
    const uint64_t voxels = X * Y * Z, table = CURVE_BYTES;
    for (int is_double = 0; is_double < 2; is_double++) {
        struct sp_volume *volume =
            make_ball(is_double ? SP_FLOAT64 : SP_FLOAT32, 0, 1, false, false);
        struct sp_view view;
        make_view(&view, volume, 0, 1);
        const struct shot shot = { &view, volume, 0, NULL };
        uint64_t uploaded = gl->residency.uploaded;
        struct test_image image = draw(rig, GL, &shot, NULL);
        test_image_finish(&image);
        assert_compare(gl->residency.uploaded - uploaded, >=, voxels * sizeof(float) + table);
        uploaded = gl->residency.uploaded;
        view.camera.position[0] += 2; /* the same axis */
        image = draw(rig, GL, &shot, NULL);
        test_image_finish(&image);
        assert_compare(gl->residency.uploaded, ==, uploaded);
        view.transfer_function.points[1].opacity *= 0.5f;
        check(rig, "after an edit", &shot);
        uint64_t edit = gl->residency.uploaded - uploaded;
        assert_compare(edit, >=, table); /* levels are made for a transfer function */
        assert_compare(edit, <, table + voxels * (is_double ? sizeof(float) + 1 : 1));
        view.transfer_function.points[1].opacity *= 2; /* back */
        uploaded = gl->residency.uploaded;
        check(rig, "after another edit", &shot);
        assert_compare(gl->residency.uploaded, ==, uploaded);
        rig->backends[GL]->evict(gl, volume);
        assert_compare(rig->backends[GL]->memory(gl, volume), ==, 0);
        sp_volume_unref(&volume);
    }
    report(rig);
}

static void a_frame_that_does_not_fit_is_refused(void **state) {
    struct rig *rig = *state;
    struct gl_state *gl = gl_of(rig);
    struct sp_volume *volume = make_ball(SP_UINT16, 0, 1000, false, false);
    struct sp_view view;
    make_view(&view, volume, 0, 1000);
    const struct shot shot = { &view, volume, 0, NULL };
    uint64_t limit = gl->residency.limit_bytes, memory = gl->memory_bytes;
    struct sp_error err;
    gl->residency.limit_bytes = 1000;
    assert_false(try_draw(rig, GL, &shot, NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, " 1000 "));
    gl->residency.limit_bytes = limit;
    rig->backends[GL]->evict(gl, volume);
    gl->memory_bytes = 1000;
    assert_false(try_draw(rig, GL, &shot, NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    gl->memory_bytes = memory;
    check(rig, "after it", &shot);
    /* Enough for one of two volumes: each frame evicts the data of the other one. */
    struct sp_volume *other = make_ball(SP_FLOAT64, 0, 1000, false, false);
    gl->residency.limit_bytes =
        gl_draw_bytes(gl) + gl_residency_bytes(&gl->residency, volume) + X * Y * Z * sizeof(float);
    for (int n = 0; n < 4; n++)
        check(rig, "in turn", &(struct shot){ &view, n % 2 ? volume : other, 0, NULL });
    gl->residency.limit_bytes = limit;
    sp_volume_unref(&volume);
    sp_volume_unref(&other);
    report(rig);
}

static void a_cancelled_frame_leaves_nothing_behind(void **state) {
    struct rig *rig = *state;
    struct sp_volume *volume = make_ball(SP_FLOAT64, 0, 1, false, false);
    struct sp_view view;
    atomic_bool cancel = true;
    struct sp_error err;
    make_view(&view, volume, 0, 1);
    assert_false(try_draw(rig, GL, &(struct shot){ &view, volume, 0, &cancel }, NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    check(rig, "after it", &(struct shot){ &view, volume, 0, NULL });
    sp_volume_unref(&volume);
    report(rig);
}

static void auto_chooses_interpolated_values(void **state) {
    struct rig *rig = *state;
    struct sp_renderer_options options = { .backend = "gl-software", .threads = 1 };
    struct sp_error err;
    struct sp_renderer *renderer = sp_renderer_create(&options, &err);
    struct sp_volume *volume = make_ball(SP_UINT8, 0, 255, false, false);
    struct sp_frame *frames[2];
    struct sp_view view;
    assert_non_null(renderer);
    make_view(&view, volume, 0, 255);
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

static void light_is_refused(void **state) {
    struct rig *rig = *state;
    struct sp_volume *volume = make_ball(SP_UINT8, 0, 255, false, false);
    struct sp_view view;
    struct sp_error err;
    make_view(&view, volume, 0, 255);
    view.shading.mode = SP_SHADING_PHONG;
    view.shading.occlusion = 0.5f;
    assert_false(try_draw(rig, GL, &(struct shot){ &view, volume, 0, NULL }, NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
    assert_string_equal(err.place, "/shading");
    sp_volume_unref(&volume);
}

int main(void) {
    struct rig rig;
    struct sp_error err;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    if (!open_rig(&rig, &err)) {
        printf("skipped: no software GL here: %s\n", err.text);
        close_rig(&rig);
        return TEST_SKIPPED;
    }
#define ON(test)                                                                                   \
    { #test, test, NULL, NULL, &rig }
    const struct CMUnitTest tests[] = {
        ON(every_type_of_samples),
        ON(every_direction),
        ON(other_choices),
        ON(wide_views),
        ON(levels_of_detail),
        ON(thin_volumes),
        ON(pieces_add_up_to_the_whole_image),
        ON(dispatches_stay_short),
        ON(what_is_resident_is_not_uploaded_again),
        ON(a_frame_that_does_not_fit_is_refused),
        ON(a_cancelled_frame_leaves_nothing_behind),
        ON(auto_chooses_interpolated_values),
        ON(light_is_refused),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    close_rig(&rig);
    return failed;
}
