/* SPDX-License-Identifier: Apache-2.0 */
#include "unit/backend/gl/resample_rig.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "support/compare.h"
#include "support/gl.h"

static const double alike = 70; /* dB: the floor of conformance.resample between kernels */

bool resample_rig_open(struct resample_rig *rig, struct sp_error *err) {
    const struct sp_backend_options options = {
        .threads = 1, .memory_bytes = (uint64_t)1 << 30, .isa = "scalar", .gpu = -1
    };
    *rig = (struct resample_rig){ .backends = { test_backend("cpu"), test_backend(test_gl()) } };
    for (int b = 0; b < BACKENDS; b++)
        if (!(rig->states[b] = rig->backends[b]->create(&options, err)))
            return false;
    rig->pool = sp_frame_pool_create((size_t)64 << 20, err);
    return rig->pool != NULL;
}

void resample_rig_close(struct resample_rig *rig) {
    for (int b = 0; b < BACKENDS; b++)
        if (rig->states[b])
            rig->backends[b]->destroy(rig->states[b]);
    if (rig->pool)
        sp_frame_pool_destroy(&rig->pool);
}

struct gl_state *resample_rig_gl(const struct resample_rig *rig) {
    return rig->states[GL];
}

bool resample_try(struct resample_rig *rig, int by, const struct resample_shot *shot,
                  struct test_image *image, struct sp_frame_stats *stats, struct sp_error *err) {
    const struct sp_view *view = shot->view;
    struct sp_frame *frame =
        sp_frame_create(rig->pool, view->size[0], view->size[1], SP_RGBAF32, err);
    assert_non_null(frame);
    struct sp_backend_job job = { .volume = shot->volume,
                                  .view = view,
                                  .mip_level = shot->mip_level,
                                  .frame = frame,
                                  .cancel = shot->cancel };
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].type >= SP_LAYER_POINTS)
            job.layer_volumes[i] = shot->layer_volumes[view->layers[i].type - SP_LAYER_POINTS];
        else if (sp_volume_elements(shot->volume))
            job.layer_volumes[i] = shot->volume;
    bool ok = rig->backends[by]->render(rig->states[by], &job, err);
    if (ok && image)
        assert_true(test_image_from_frame(image, frame));
    if (stats)
        *stats = frame->stats;
    sp_frame_unref(&frame);
    return ok;
}

struct test_image resample_draw(struct resample_rig *rig, int by, const struct resample_shot *shot,
                                struct sp_frame_stats *stats) {
    struct test_image image;
    struct sp_error err;
    if (!resample_try(rig, by, shot, &image, stats, &err))
        fail_msg("backend %s: %s", rig->backends[by]->entry.name, err.text);
    return image;
}

/* Gives the pixel of `a` that differs most the value that it has in `b`. */
static void forgive_pixel(struct test_image *a, const struct test_image *b) {
    struct test_difference d = test_image_difference(a, b);
    memcpy(test_image_at(a, d.x, d.y), test_image_at(b, d.x, d.y), 4 * sizeof a->rgba[0]);
}

/* Both backends draw it, and must agree. */
void resample_check(struct resample_rig *rig, const char *what, const struct resample_shot *shot) {
    struct sp_frame_stats stats[BACKENDS];
    struct test_image images[BACKENDS];
    for (int b = 0; b < BACKENDS; b++)
        images[b] = resample_draw(rig, b, shot, &stats[b]);
    for (unsigned i = 0; i < rig->edge_pixels; i++)
        forgive_pixel(&images[GL], &images[CPU]);
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

void resample_report(struct resample_rig *rig) {
    print_message("  %u views, %.1f dB at least\n", rig->drawn, rig->worst);
    rig->drawn = 0;
}

static double ball(double x, double y, double z) {
    return fmax(0, 1 - 0.11 * sqrt(x * x + y * y + z * z / 2));
}

/* A ball whose values are low + share·(high − low), in samples of a type. */
struct sp_volume *resample_make_ball(enum sp_type type, double low, double high, bool has_holes,
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
void resample_make_view(struct sp_view *view, const struct sp_volume *volume, double low,
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
