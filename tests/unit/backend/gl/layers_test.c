/* SPDX-License-Identifier: Apache-2.0
 *
 * Surfaces, shells and vectors, alone and inside the volume, on software GL beside the scalar
 * kernels of the CPU. conformance.layers compares surfaces with a closed form.
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

#include "backend/gl/memory.h"
#include "sp/log.h"
#include "support/compare.h"
#include "support/data.h"
#include "support/gl.h"
#include "support/render.h"
#include "support/sanitized.h"
#include "unit/backend/gl/resample_rig.h"

/* The layers of a view of the ball, whose values go from 0 to 255. */
enum layers { SURFACE, SURFACES, SHELL, ALL, LAYERS };

static void add_surface(struct sp_view *view, double value, float opacity) {
    struct sp_layer *layer = &view->layers[view->layer_count++];
    *layer = sp_layer_default(SP_LAYER_SURFACE);
    layer->value = value;
    layer->opacity = opacity;
    layer->color[0] = view->layer_count & 1 ? 0.2f : 0.9f;
}

static void add_shell(struct sp_view *view) {
    struct sp_layer *layer = &view->layers[view->layer_count++];
    *layer = sp_layer_default(SP_LAYER_SHELL);
    layer->low = 0.02;
    layer->high = 0.4;
}

static void add_layers(struct sp_view *view, enum layers which) {
    switch (which) {
    case SURFACE:
        add_surface(view, 130, 1);
        break;
    case SURFACES:
        add_surface(view, 90, 0.3f);
        add_surface(view, 190, 0.6f);
        break;
    case SHELL:
        add_shell(view);
        break;
    case ALL:
        add_surface(view, 90, 0.3f);
        add_shell(view);
        add_surface(view, 210, 1);
        break;
    case LAYERS:
        break;
    }
}

static const struct {
    const char *name;
    enum sp_compositing mode;
    enum sp_tf_order order;
    enum sp_filter_mode filter;
} orders[] = {
    { "resampled", SP_COMPOSITE_SHEET, SP_TF_POST, SP_FILTER_ADAPTIVE },
    { "sheets", SP_COMPOSITE_SHEET, SP_TF_PRE, SP_FILTER_ADAPTIVE },
    { "slabs", SP_COMPOSITE_SLAB, SP_TF_PRE, SP_FILTER_ADAPTIVE },
    { "splats", SP_COMPOSITE_SPLAT, SP_TF_PRE, SP_FILTER_NONE },
    { "slabs, post", SP_COMPOSITE_SLAB, SP_TF_POST, SP_FILTER_EWA },
};
enum { ORDERS = sizeof orders / sizeof *orders };

static void make_view(struct sp_view *view, const struct sp_volume *volume, int order) {
    resample_make_view(view, volume, 0, 255);
    view->compositing.mode = orders[order].mode;
    view->transfer_function.order = orders[order].order;
    view->filter.mode = orders[order].filter;
}

/* Other choices by the bits of n. */
static void vary(struct sp_view *view, int n) {
    view->camera.projection = n & 1 ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
    view->shading.mode = n & 2 ? SP_SHADING_PHONG : SP_SHADING_NONE;
    view->clip.box[0][0] = n & 4 ? 0.3 : 0;
    view->clip.plane_count = n & 4 ? 1 : 0;
    view->clip.planes[0] = (struct sp_clip_plane){ { 0.5, 1, 0.7 }, -2 };
    view->compositing.attenuation = n & 8 ? SP_ATTENUATION_LINEAR : SP_ATTENUATION_EXPONENTIAL;
}

static void layers_inside_the_volume(void **state) {
    struct resample_rig *rig = *state;
    if (test_gl_is_software())
        print_message("  reduced: software GL draws each choice with one of two grids\n");
    for (int is_rectilinear = 0; is_rectilinear < (TEST_SANITIZED ? 1 : 2); is_rectilinear++) {
        struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, is_rectilinear);
        for (int order = 0; order < ORDERS; order++)
            for (int which = 0; which < LAYERS; which += 1 + TEST_SANITIZED) {
                if (test_gl_is_software() && !TEST_SANITIZED &&
                    (order + which) % 2 != is_rectilinear)
                    continue;
                struct sp_view view;
                char what[60];
                int n = 5 * order + 3 * which + 7 * is_rectilinear;
                make_view(&view, volume, order);
                add_layers(&view, (enum layers)which);
                vary(&view, n);
                snprintf(what, sizeof what, "%s, layers %d, axes %d, choice %d", orders[order].name,
                         which, is_rectilinear, n % 16);
                resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
            }
        sp_volume_unref(&volume);
    }
    resample_report(rig);
}

static void layers_without_the_volume(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, false);
    for (int which = 0; which <= LAYERS; which++)
        for (int n = 0; n < (TEST_SANITIZED ? 2 : 8); n++) {
            struct sp_view view;
            char what[60];
            make_view(&view, volume, n % ORDERS);
            view.layer_count = 0;
            add_layers(&view, (enum layers)which);
            vary(&view, n);
            view.background[3] = 0.4f;
            snprintf(what, sizeof what, "layers %d without the volume, choice %d", which, n);
            resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
        }
    sp_volume_unref(&volume);
    resample_report(rig);
}

/* Images of several axes are mixed; each has all fragments. */
static void mixed_images(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, false);
    static const double angles[][2] = { { 44, 10 }, { 45, 35.3 }, { 35, 15 }, { 30, 25 } };
    for (size_t i = 0; i < sizeof angles / sizeof *angles; i++) {
        struct sp_view view;
        double a = angles[i][0] * M_PI / 180, e = angles[i][1] * M_PI / 180;
        char what[40];
        make_view(&view, volume, 0);
        add_layers(&view, ALL);
        vary(&view, (int)i);
        view.camera.position[0] = 40 * sin(a) * cos(e);
        view.camera.position[1] = -40 * cos(a) * cos(e);
        view.camera.position[2] = 40 * sin(e);
        snprintf(what, sizeof what, "angles %zu", i);
        resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
    }
    sp_volume_unref(&volume);
    resample_report(rig);
}

/* Eight surfaces, close enough that they fill the image: twice as many fragments in most pixels as
 * there is memory for at first. */
static void make_nested(struct sp_view *view, const struct sp_volume *volume, int order) {
    make_view(view, volume, order);
    view->layer_count = 1;
    for (int i = 0; i < 7; i++)
        add_surface(view, 60 + 20 * i, 0.2f);
    view->camera.position[0] = 7;
    view->camera.position[1] = -16;
    view->camera.position[2] = 4;
    view->size[0] = 19;
    view->size[1] = 13;
}

/* Frees the memory that earlier frames needed. */
static void release(struct gl_state *gl) {
    struct sp_error err;
    if (!gl_context_bind(gl->context, &err))
        fail_msg("%s", err.text);
    gl_memory_release(gl);
    gl_context_unbind(gl->context);
}

/* Points take several passes, bands are one row of tiles high, and fragments need more memory. */
static void pieces_add_up(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, false);
    const struct gl_limits whole = gl->workload.limits;
    for (int n = 0; n < 4; n++) {
        struct sp_view view;
        char what[40];
        make_nested(&view, volume, n % 2);
        snprintf(what, sizeof what, "pieces %d", n);
        release(gl);
        /* Several passes, or one: eight surfaces close to the eye have more points than the limit
         * of software GL lets one pass draw. */
        gl->workload.limits.loops = n & 1 ? 800 : 1 << 24;
        gl->workload.limits.tiles = n & 2 ? 1 : whole.tiles;
        resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
        assert_compare(gl->surfaces.per_pixel, >, 2.5);
        assert_int_equal(gl->buffers.sheets.name != 0, n & 1);
        gl->workload.limits = whole;
    }
    sp_volume_unref(&volume);
    resample_report(rig);
}

/* The same for the voxels of a shell, alone and beside a surface. */
static void pieces_of_shells_add_up(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, true);
    const struct gl_limits whole = gl->workload.limits;
    for (int n = 0; n < 6; n++) {
        struct sp_view view;
        char what[40];
        make_view(&view, volume, 0);
        view.layer_count = n < 4;
        add_shell(&view);
        if (n < 2)
            add_surface(&view, 190, 0.5f);
        view.layers[n < 4].detail = n % 2 ? SP_SHELL_FAST : SP_SHELL_HIGH;
        snprintf(what, sizeof what, "pieces of shells %d", n);
        release(gl);
        gl->workload.limits.loops = 2000;
        gl->workload.limits.tiles = 1;
        resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
        assert_int_equal(gl->buffers.sheets.name != 0, n < 4);
        gl->workload.limits = whole;
    }
    sp_volume_unref(&volume);
    resample_report(rig);
}

/* A volume of the ball's samples, with vectors around its axis, some of them 0. */
static struct sp_volume *make_vortex(bool is_rectilinear) {
    struct sp_volume *ball = resample_make_ball(SP_UINT8, 0, 255, false, is_rectilinear);
    const struct sp_grid *grid = &sp_volume_info(ball)->grid;
    const uint32_t count = grid->dims[0] * grid->dims[1] * grid->dims[2];
    float(*vectors)[3] = calloc(count, sizeof *vectors);
    assert_non_null(vectors);
    for (uint32_t n = 0; n < count; n++) {
        float x = (float)(n % grid->dims[0]) - 0.5f * (float)grid->dims[0];
        float y = (float)(n / grid->dims[0] % grid->dims[1]) - 0.5f * (float)grid->dims[1];
        if (n % 11 == 0)
            continue;
        vectors[n][0] = -y;
        vectors[n][1] = x;
        vectors[n][2] = (float)(n % 5);
    }
    struct sp_volume *volume = sp_volume_create_vectors(grid, SP_UINT8, sp_volume_voxels(ball),
                                                        (const float(*)[3])vectors, "vortex", NULL);
    assert_non_null(volume);
    free(vectors);
    sp_volume_unref(&ball);
    return volume;
}

/* Streaks of both styles: alone, beside a shell and a surface, inside the volume, in pieces, and on
 * two kinds of grids. */
static void vectors_look_the_same(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *volumes[2] = { make_vortex(false), make_vortex(true) };
    const struct gl_limits whole = gl->workload.limits;
    for (int n = 0; n < (TEST_SANITIZED ? 4 : 12); n++) {
        struct sp_volume *volume = volumes[n % 3 == 2];
        struct sp_view view;
        char what[40];
        make_view(&view, volume, n % 2);
        vary(&view, n);
        view.layer_count = n % 4 == 3; /* the volume */
        struct sp_layer *layer = &view.layers[view.layer_count++];
        *layer = sp_layer_default(SP_LAYER_VECTORS);
        layer->style = n & 1 ? SP_VECTORS_BLEND : SP_VECTORS_MODULATE;
        layer->phase = 0.17 * n - floor(0.17 * n);
        layer->stretch = 1 + 0.3 * n;
        layer->density = 1;
        if (n % 4 == 2) {
            add_shell(&view);
            add_surface(&view, 190, 0.5f);
        }
        if (n > 8)
            gl->workload.limits.loops = 2000;
        snprintf(what, sizeof what, "vectors %d", n);
        resample_check(rig, what, &(struct resample_shot){ &view, volume, 0, NULL, NULL });
        gl->workload.limits = whole;
    }
    sp_volume_unref(&volumes[0]);
    sp_volume_unref(&volumes[1]);
    resample_report(rig);
}

/* Points are uploaded once, and not kept after the volume is evicted. */
static void points_stay_on_the_gpu(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *volume = resample_make_ball(SP_INT16, 0, 255, false, false);
    struct sp_view view;
    make_view(&view, volume, 0);
    view.layer_count = 0;
    add_surface(&view, 100, 1);
    const struct resample_shot shot = { &view, volume, 0, NULL, NULL };
    uint64_t before = gl->residency.uploaded;
    resample_check(rig, "first", &shot);
    uint64_t points = gl->residency.uploaded - before;
    assert_compare(points, >, 1000 * 20);
    assert_compare(gl_residency_bytes(&gl->residency, volume), >=, points);
    view.camera.position[0] += 3;
    resample_check(rig, "another direction", &shot);
    assert_compare(gl->residency.uploaded - before, ==, points);
    for (int b = 0; b < BACKENDS; b++)
        rig->backends[b]->evict(rig->states[b], volume);
    assert_compare(rig->backends[GL]->memory(rig->states[GL], volume), ==, 0);
    resample_check(rig, "again", &shot);
    assert_compare(gl->residency.uploaded - before, ==, 2 * points);
    sp_volume_unref(&volume);
    resample_report(rig);
}

/* The renderer draws parts of the volume between slices, each with its part of the layers. */
static void slices_cut_layers(void **state) {
    (void)state;
    const struct test_target targets[BACKENDS] = { { "cpu", "scalar" }, { test_gl(), "auto" } };
    struct sp_volume *volume = resample_make_ball(SP_UINT8, 0, 255, false, false);
    struct test_renderer renderers[BACKENDS];
    struct sp_error err;
    for (int b = 0; b < BACKENDS; b++)
        if (!test_renderer_open(&renderers[b], &targets[b], 1, &err))
            fail_msg("%s: %s", targets[b].backend, err.text);
    for (int which = SURFACE; which < LAYERS; which++) {
        struct test_image images[BACKENDS];
        struct sp_view view;
        make_view(&view, volume, which % 2);
        add_layers(&view, (enum layers)which);
        vary(&view, which);
        view.slices.mode = SP_SLICES_ORTHOGONAL;
        view.slices.in_3d = true;
        view.slices.planes[0] = view.slices.planes[1] = true;
        view.slices.position[0] = 1.3;
        for (int b = 0; b < BACKENDS; b++)
            if (!test_render(&renderers[b], volume, &view, &images[b], &err))
                fail_msg("%s: %s", targets[b].backend, err.text);
        double psnr = test_image_psnr(&images[GL], &images[CPU]);
        print_message("  slices, layers %d: %.1f dB\n", which, psnr);
        assert_compare(psnr, >=, 70);
        for (int b = 0; b < BACKENDS; b++)
            test_image_finish(&images[b]);
    }
    for (int b = 0; b < BACKENDS; b++)
        test_renderer_close(&renderers[b]);
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
    const struct CMUnitTest tests[] = { ON(layers_inside_the_volume),
                                        ON(layers_without_the_volume),
                                        ON(mixed_images),
                                        ON(pieces_add_up),
                                        ON(pieces_of_shells_add_up),
                                        ON(vectors_look_the_same),
                                        ON(points_stay_on_the_gpu),
                                        ON(slices_cut_layers) };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    resample_rig_close(&rig);
    return failed;
}
