/* SPDX-License-Identifier: Apache-2.0
 *
 * Depth and spread of sheets and slabs of interpolated values (sp/frame.h) against marched rays:
 * the interpolated field (support/interpolant.h) is classified many times per sample along the ray
 * of each pixel's centre, and the moments of the depth are summed in double precision.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/interpolant.h"
#include "support/interpolated.h"
#include "support/render.h"
#include "support/sample.h"
#include "support/sanitized.h"

struct row {
    const char *name;
    test_scene_fn *scene;
    /* Mean difference of depth and of spread [smallest spacing]: of sheets, then of slabs. A fifth
     * above the measured values. */
    double most[2][2];
};

static const struct row rows[] = {
    { "constant cube", test_scene_constant_cube, { { 0.017, 0.014 }, { 0.017, 0.012 } } },
    { "thin shells", test_scene_thin_shells, { { 0.294, 0.132 }, { 0.092, 0.046 } } },
    { "anisotropic", test_scene_anisotropic, { { 0.026, 0.014 }, { 0.024, 0.012 } } },
    { "phantom", test_scene_phantom, { { 0.359, 0.077 }, { 0.045, 0.017 } } },
    { "oblique", test_scene_oblique, { { 0.059, 0.034 }, { 0.059, 0.034 } } },
    { "blobs", test_scene_blobs, { { 0.005, 0.008 }, { 0.005, 0.005 } } },
    { "orthographic", test_scene_orthographic, { { 0.009, 0.021 }, { 0.005, 0.005 } } },
    { "rotated", test_scene_rotated, { { 0.005, 0.009 }, { 0.005, 0.005 } } },
    { "left-handed", test_scene_left_handed, { { 0.005, 0.009 }, { 0.005, 0.005 } } },
    { "sheared", test_scene_sheared, { { 0.006, 0.005 }, { 0.006, 0.005 } } },
    { "inside", test_scene_inside, { { 0.011, 0.056 }, { 0.011, 0.056 } } },
    { "lit shell", test_scene_lit_shell, { { 0.012, 0.028 }, { 0.012, 0.028 } } },
    { "layers", test_scene_layers, { { 0.147, 0.083 }, { 0.147, 0.083 } } },
    { "near shell", test_scene_near_shell, { { 0.057, 0.018 }, { 0.056, 0.017 } } },
    { "rectilinear", test_scene_rectilinear_blobs, { { 0.005, 0.009 }, { 0.006, 0.005 } } },
    { "clip plane", test_scene_clip_plane, { { 0.010, 0.005 }, { 0.009, 0.005 } } },
    { "clip box", test_scene_clip_box, { { 0.011, 0.008 }, { 0.011, 0.006 } } },
    { "clip edge", test_scene_clip_edge, { { 0.005, 0.008 }, { 0.005, 0.005 } } },
    { "clip corner", test_scene_clip_corner, { { 0.016, 0.006 }, { 0.014, 0.005 } } },
    { "gradient axis", test_scene_gradient_axis, { { 0.060, 0.026 }, { 0.036, 0.017 } } },
    { "post peak", test_scene_post_peak, { { 0.024, 0.014 }, { 0.024, 0.014 } } },
    { "post lit", test_scene_post_lit, { { 0.018, 0.011 }, { 0.018, 0.011 } } },
};

struct marcher {
    const struct sp_view *view;
    struct test_interpolant field;
    double forward[3];
};

/* Writes Σ T α, Σ T α z, Σ T α z². */
static void march(void *user, const double eye[3], const double ahead[3], double from, double to,
                  double step, double *sums) {
    const struct marcher *m = user;
    const struct sp_transfer_function *tf = &m->view->transfer_function;
    double light = 1, cosine = 0, start = 0;
    memset(sums, 0, 4 * sizeof *sums);
    for (int r = 0; r < 3; r++) {
        cosine += m->forward[r] * ahead[r];
        start += m->forward[r] * (eye[r] - m->view->camera.position[r]);
    }
    for (double l = from + step / 2; l < to && light > 1e-6; l += step) {
        double world[3], index[3], gradient[3] = { 0 }, color[3], opacity;
        for (int r = 0; r < 3; r++)
            world[r] = eye[r] + l * ahead[r];
        if (!test_interpolant_to_index(&m->field, world, index))
            continue;
        if (test_needs_gradient(m->view))
            test_interpolant_gradient(&m->field, index, gradient);
        const double length =
            sqrt(gradient[0] * gradient[0] + gradient[1] * gradient[1] + gradient[2] * gradient[2]);
        test_classify(tf, test_interpolant_value(&m->field, index), length, color, &opacity);
        const double share = light * (1 - pow(1 - opacity, step / tf->reference_length));
        const double z = start + l * cosine;
        sums[0] += share;
        sums[1] += share * z;
        sums[2] += share * z * z;
        light -= share;
    }
}

static const float *row_of(const struct sp_frame *frame, const float *plane, uint32_t y) {
    return (const float *)(const void *)((const char *)plane + y * frame->depth_stride_bytes);
}

/* Writes the mean differences; returns the number of pixels compared. */
static unsigned compare(const struct test_image *truth, const struct sp_frame *frame, double unit,
                        double mean[2]) {
    const double clear = 0.1;
    unsigned count = 0;
    mean[0] = mean[1] = 0;
    for (uint32_t y = 0; y < frame->height; y++)
        for (uint32_t x = 0; x < frame->width; x++) {
            const double *sums = test_image_at(truth, x, y);
            const double depth = (double)row_of(frame, frame->depth, y)[x];
            if (!(sums[0] >= clear))
                continue;
            const double z = sums[1] / sums[0], square = sums[2] / sums[0] - z * z;
            mean[0] += fabs(depth - z) / unit;
            mean[1] +=
                fabs((double)row_of(frame, frame->spread, y)[x] - sqrt(fmax(square, 0))) / unit;
            count++;
        }
    mean[0] /= fmax(count, 1);
    mean[1] /= fmax(count, 1);
    return count;
}

enum { TARGETS_MAX = 16 };

/* All backends and instruction sets of this machine. */
struct run {
    struct test_target targets[TARGETS_MAX];
    struct test_renderer renderers[TARGETS_MAX];
    unsigned count;
};

static bool check_target(const struct test_target *target, const struct test_renderer *r,
                         const struct row *row, const struct test_scene *scene,
                         const struct test_image *truth) {
    const struct sp_render_options options = { .format = SP_RGBAF32, .wants_depth = true };
    const double *spacing = scene->info.grid.spacing;
    const double unit = fmin(spacing[0], fmin(spacing[1], spacing[2]));
    const bool is_slab = scene->view.compositing.mode == SP_COMPOSITE_SLAB;
    struct sp_error err;
    double mean[2];
    struct sp_volume *volume = test_scene_volume(scene, &err);
    struct sp_frame *frame =
        volume ? sp_renderer_render(r->renderer, volume, &scene->view, r->pool, &options, &err)
               : NULL;
    struct sp_renderer_info info;
    sp_renderer_info(r->renderer, &info);
    bool ok = frame && (frame->depth || !info.has_depth);
    if (frame && frame->depth) {
        const unsigned count = compare(truth, frame, unit, mean);
        const double *most = row->most[is_slab];
        ok = count >= 50 && mean[0] <= most[0] && mean[1] <= most[1];
        printf("  %s %.3f %.3f", target->isa, mean[0], mean[1]);
        if (count < 50)
            printf(" (%u px)", count);
    }
    printf(ok ? "" : " FAILED");
    sp_frame_unref(&frame);
    if (volume)
        sp_renderer_evict(r->renderer, volume);
    sp_volume_unref(&volume);
    return ok;
}

static unsigned check_row(const struct run *run, const struct row *row) {
    struct test_scene scene;
    struct test_image truth;
    struct marcher m;
    double w[3][3];
    unsigned failed = 0;
    if (!row->scene(&scene))
        return 1;
    scene.view.filter.mode = SP_FILTER_ADAPTIVE;
    scene.view.compositing.attenuation = SP_ATTENUATION_EXPONENTIAL;
    scene.view.transfer_function.order = SP_TF_POST;
    scene.view.level_of_detail = SP_LOD_OFF;
    test_camera_axes(&scene.view.camera, w);
    m.view = &scene.view;
    memcpy(m.forward, w[2], sizeof m.forward);
    if (!test_interpolant_init(&m.field, &scene) || !test_each_ray(&scene, 12, march, &m, &truth)) {
        printf("%s: out of memory\n", row->name);
        return 1;
    }
    for (int is_slab = 0; is_slab < 2; is_slab++) {
        scene.view.compositing.mode = is_slab ? SP_COMPOSITE_SLAB : SP_COMPOSITE_SHEET;
        printf("%-14s %s", row->name, is_slab ? "slab " : "sheet");
        for (unsigned t = 0; t < run->count; t++)
            failed += !check_target(&run->targets[t], &run->renderers[t], row, &scene, &truth);
        printf("\n");
    }
    test_interpolant_finish(&m.field);
    test_image_finish(&truth);
    test_scene_finish(&scene);
    return failed;
}

int main(void) {
    struct run run = { .count = 0 };
    struct test_target target;
    unsigned failed = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    for (unsigned t = 0; run.count < TARGETS_MAX && test_target_at(t, &target); t++) {
        struct sp_error err; /* conformance.depth prints what is skipped */
        if (test_renderer_open(&run.renderers[run.count], &target, 1, &err))
            run.targets[run.count++] = target;
    }
    if (run.count == 0) {
        printf("FAILED: the CPU backend does not start\n");
        return 1;
    }
    printf("Mean differences of depth and of spread [smallest spacing]\n");
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        failed += check_row(&run, &rows[i]);
    for (unsigned t = 0; t < run.count; t++)
        test_renderer_close(&run.renderers[t]);
    if (failed)
        printf("%u images FAILED\n", failed);
    return failed > 0;
}
