/* SPDX-License-Identifier: Apache-2.0
 *
 * Drafts (sp_render_options.draft) against whole frames of the same view, for each instruction set
 * of the CPU. Where a draft changes nothing, the bytes are the same and the frame is no draft. The
 * scene is a ball of shells with noise, so that normals are mixed from two gradients.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/render.h"
#include "support/sanitized.h"

enum { SIDE = 48, PIXELS = TEST_SANITIZED ? 96 : 160 };

enum { LIT = 1, SHADOW = 2, PLANE = 4, SURFACE = 8, GRADIENT = 16, STEEP = 32, SAME = 64 };

struct row {
    const char *name;
    enum sp_type type;
    enum sp_compositing compositing;
    enum sp_tf_order order;
    int what;     /* SAME: a draft changes nothing */
    double floor; /* PSNR to the whole frame, dB */
};

#define SHEET SP_COMPOSITE_SHEET
#define POST SP_TF_POST
static const struct row rows[] = {
    { "uint8, lit", SP_UINT8, SHEET, POST, LIT, 36 },
    { "int16, lit", SP_INT16, SHEET, POST, LIT, 36 },
    { "uint16, lit, steep", SP_UINT16, SHEET, POST, LIT | STEEP, 36 },
    { "float, lit", SP_FLOAT32, SHEET, POST, LIT, 36 },
    { "float64, lit", SP_FLOAT64, SHEET, POST, LIT, 36 },
    { "occlusion and shadow", SP_UINT8, SHEET, POST, LIT | SHADOW, 36 },
    { "face of a cut", SP_UINT8, SHEET, POST, LIT | PLANE, 36 },
    { "surface in it", SP_UINT8, SHEET, POST, LIT | SURFACE, 36 },
    { "opacity by the gradient", SP_UINT8, SHEET, POST, LIT | GRADIENT | STEEP, 36 },
    { "slab", SP_UINT8, SP_COMPOSITE_SLAB, POST, LIT, 36 },
    { "not lit", SP_UINT8, SHEET, POST, STEEP, 40 },
    { "classified voxels", SP_UINT8, SHEET, SP_TF_PRE, LIT | SAME, 0 },
    { "maximum", SP_UINT8, SP_COMPOSITE_MAXIMUM, POST, STEEP | SAME, 0 },
};
enum { ROWS = sizeof rows / sizeof rows[0] };

/* Shells about the middle, and noise of 2 % of the range. */
static double field(const void *user, double x, double y, double z) {
    const double c = (SIDE - 1) / 2.0, a = x - c, b = y - c, d = 1.2 * (z - c);
    const double r = sqrt(a * a + b * b + d * d);
    const double noise = sin(12.9898 * x + 78.233 * y + 37.719 * z) * 43758.5453;
    (void)user;
    return 120 + 90 * cos(r / 3) * exp(-r / 20) - r + 5 * (noise - floor(noise) - 0.5);
}

static bool make(const struct row *row, struct test_scene *scene) {
    const double points[][5] = {
        { 90, 0.8, 0.3, 0.1, 0 },    { 110, 0.8, 0.4, 0.2, 0.02 }, { 125, 0.9, 0.7, 0.4, 0.3 },
        { 150, 0.9, 0.9, 0.8, 0.8 }, { 200, 0.3, 0.6, 1, 0.9 },
    };
    struct sp_view *view = &scene->view;
    test_view_init(view);
    test_scene_points(scene, points, 5);
    if (!test_scene_voxels(scene, "shells", (uint32_t[]){ SIDE, SIDE, SIDE },
                           (double[]){ 1, 1, 1.2 }, row->type, field, NULL))
        return false;
    test_scene_orbit(scene, NULL, row->what & STEEP ? 44 : 12, row->what & STEEP ? 35 : 9,
                     2.6 * SIDE);
    view->camera.fov_y = 30;
    view->size[0] = view->size[1] = PIXELS;
    view->background[3] = 1;
    view->compositing.mode = row->compositing;
    view->transfer_function.order = row->order;
    view->filter.mode = SP_FILTER_ADAPTIVE;
    view->level_of_detail = SP_LOD_AUTO;
    view->shading.mode = row->what & LIT ? SP_SHADING_PHONG : SP_SHADING_NONE;
    if (row->what & SHADOW)
        view->shading.occlusion = view->shading.shadow = 0.7;
    if (row->what & PLANE)
        test_scene_cut(scene, (double[]){ 0.4, 0.3, 1 }, (double[]){ 0, 0, -4 });
    if (row->what & SURFACE) {
        struct sp_layer *layer = &view->layers[view->layer_count++];
        *layer = sp_layer_default(SP_LAYER_SURFACE);
        layer->value = 118;
    }
    if (row->what & GRADIENT) {
        view->transfer_function.gradient_count = 2;
        view->transfer_function.gradient[0] = (struct sp_gradient_point){ 2, 0.2 };
        view->transfer_function.gradient[1] = (struct sp_gradient_point){ 12, 1 };
    }
    return true;
}

static struct sp_frame *render(const struct test_renderer *r, struct sp_volume *volume,
                               const struct sp_view *view, bool draft) {
    const struct sp_render_options options = { .format = SP_RGBAF32,
                                               .wants_depth = true,
                                               .draft = draft };
    struct sp_error err;
    struct sp_frame *frame = sp_renderer_render(r->renderer, volume, view, r->pool, &options, &err);
    if (!frame)
        printf("%s\n", err.text);
    return frame;
}

static double psnr(const struct sp_frame *a, const struct sp_frame *b) {
    double sum = 0;
    for (uint32_t y = 0; y < a->height; y++) {
        const float *p = (const void *)((const char *)a->pixels + y * a->stride_bytes);
        const float *q = (const void *)((const char *)b->pixels + y * b->stride_bytes);
        for (uint32_t x = 0; x < 4 * a->width; x++)
            sum += x % 4 < 3 ? pow((double)p[x] - (double)q[x], 2) : 0;
    }
    return -10 * log10(fmax(sum / (3.0 * a->width * a->height), 1e-20));
}

/* Returns the number of failures. reference: the draft of the scalar kernels; NULL = none. */
static unsigned check(const struct row *row, const struct test_target *target,
                      const struct sp_frame *whole, const struct sp_frame *draft,
                      const struct sp_frame *reference) {
    const double same = 50; /* dB: vectors of all widths end when the last of their rays is dark */
    const bool is_same = row->what & SAME;
    double db = psnr(whole, draft), beside = reference ? psnr(draft, reference) : INFINITY;
    const bool ok = !whole->stats.is_draft && draft->stats.is_draft == !is_same &&
                    (is_same ? test_frames_equal(whole, draft) : db >= row->floor) &&
                    beside >= same;
    printf("%s %s: %s, %.1f dB from the whole frame, %.1f dB from scalar kernels\n",
           ok ? "ok" : "FAIL", target->isa, row->name, db, fmin(beside, 200));
    return !ok;
}

static unsigned check_row(const struct row *row) {
    struct test_scene scene = { 0 };
    struct test_target target;
    struct sp_error err;
    struct sp_frame *reference = NULL;
    unsigned failures = 0, drawn = 0;
    struct sp_volume *volume = make(row, &scene) ? test_scene_volume(&scene, &err) : NULL;
    for (unsigned i = 0; volume && test_target_at(i, &target); i++) {
        struct test_renderer renderer;
        if (strcmp(target.backend, "cpu") || !test_renderer_open(&renderer, &target, 2, &err))
            continue;
        struct sp_frame *whole = render(&renderer, volume, &scene.view, false);
        struct sp_frame *draft = render(&renderer, volume, &scene.view, true);
        failures += whole && draft ? check(row, &target, whole, draft, reference) : 1;
        drawn++;
        sp_frame_unref(&whole);
        if (reference)
            sp_frame_unref(&draft);
        else
            reference = draft;
        test_renderer_close(&renderer);
    }
    sp_frame_unref(&reference);
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
    return drawn ? failures : 1;
}

int main(void) {
    unsigned failures = 0;
    sp_log_set_level(SP_LOG_WARN);
    for (unsigned i = 0; i < ROWS; i++)
        failures += check_row(&rows[i]);
    printf("%u failures\n", failures);
    return failures > 0;
}
