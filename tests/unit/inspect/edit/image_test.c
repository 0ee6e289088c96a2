/* SPDX-License-Identifier: Apache-2.0
 *
 * Removed matter is invisible in every kind of image, also where no value is transparent.
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

#include "sp/log.h"
#include "support/compare.h"
#include "support/gl.h"
#include "support/render.h"
#include "support/sanitized.h"

enum { N = 32, LEAST = 40, MOST = 200 };

/* Waves from LEAST to MOST. */
static double waves(const void *user, double x, double y, double z) {
    (void)user;
    double wave = sin(0.5 * x) + sin(0.4 * y) + sin(0.6 * z);
    return LEAST + (MOST - LEAST) * (0.5 + wave / 6);
}

static struct sp_volume *make_volume(struct test_scene *scene, enum sp_type type) {
    static float vectors[N * N * N][3];
    test_view_init(&scene->view);
    assert_true(test_scene_voxels(scene, "waves", (const uint32_t[3]){ N, N, N },
                                  (const double[3]){ 1, 1, 1 }, type, waves, NULL));
    for (int i = 0; i < N * N * N; i++)
        vectors[i][i % 3] = 1;
    struct sp_volume *volume = sp_volume_create_vectors(&scene->info.grid, type, scene->voxels,
                                                        (const float(*)[3])vectors, "waves", NULL);
    assert_non_null(volume);
    struct sp_camera *camera = &scene->view.camera;
    camera->projection = SP_ORTHOGRAPHIC; /* x goes to the right, two pixels per sample */
    camera->height = 32;
    return volume;
}

enum kind {
    SHEETS,
    SHEETS_PER_VOXEL,
    SLABS,
    SPLATS,
    LARGEST,
    SMALLEST,
    MEAN,
    SUM,
    SURFACE,
    SHELL,
    VECTORS,
    ALL_LAYERS,
    SLICES,
    KINDS
};

static const char *const names[KINDS] = {
    "sheets", "sheets per voxel", "slabs", "splats",  "maximum",    "minimum", "mean",
    "sum",    "surface",          "shell", "vectors", "all layers", "slices"
};

static void set_kind(struct sp_view *view, enum kind kind) {
    static const enum sp_compositing modes[] = {
        [SHEETS] = SP_COMPOSITE_SHEET,    [SHEETS_PER_VOXEL] = SP_COMPOSITE_SHEET,
        [SLABS] = SP_COMPOSITE_SLAB,      [SPLATS] = SP_COMPOSITE_SPLAT,
        [LARGEST] = SP_COMPOSITE_MAXIMUM, [SMALLEST] = SP_COMPOSITE_MINIMUM,
        [MEAN] = SP_COMPOSITE_MEAN,       [SUM] = SP_COMPOSITE_SUM
    };
    struct sp_layer surface = sp_layer_default(SP_LAYER_SURFACE);
    surface.value = 120;
    view->compositing.mode = kind < SURFACE ? modes[kind] : SP_COMPOSITE_SHEET;
    view->transfer_function.order =
        kind == SHEETS_PER_VOXEL || kind == SPLATS ? SP_TF_PRE : SP_TF_POST;
    if (kind == SLICES) {
        view->slices.mode = SP_SLICES_ORTHOGONAL;
        view->slices.in_3d = true;
        view->slices.planes[2] = true;
        view->slices.width = 100;
        view->slices.center = 100;
    }
    if (kind == SURFACE)
        view->layers[0] = surface;
    if (kind == SHELL)
        view->layers[0] = sp_layer_default(SP_LAYER_SHELL);
    if (kind == VECTORS)
        view->layers[0] = sp_layer_default(SP_LAYER_VECTORS);
    if (kind == ALL_LAYERS) {
        view->layers[view->layer_count++] = surface;
        view->layers[view->layer_count++] = sp_layer_default(SP_LAYER_SHELL);
        view->layers[view->layer_count++] = sp_layer_default(SP_LAYER_VECTORS);
    }
}

/* The largest of the four channels in columns [begin, end) of an image, without its border, and the
 * mean opacity. */
static double measure_columns(const struct test_image *image, unsigned begin, unsigned end,
                              double *mean) {
    double largest = 0, sum = 0;
    for (unsigned y = 8; y < image->height - 8; y++)
        for (unsigned x = begin; x < end; x++) {
            const double *rgba = test_image_at(image, x, y);
            for (int c = 0; c < 4; c++)
                largest = fmax(largest, rgba[c]);
            sum += rgba[3];
        }
    *mean = sum / ((image->height - 16) * (end - begin));
    return largest;
}

/* The points of two transfer functions. The first shows all values; the second hides the largest.
 */
static const double points[2][2][5] = { { { 0, 1, 0.5, 0, 0.3 }, { 255, 0, 0.5, 1, 0.6 } },
                                        { { LEAST, 1, 0.5, 0, 0.6 }, { MOST, 0, 0.5, 1, 0 } } };

static bool is_software_gl(const struct test_target *target) {
    return strcmp(target->backend, "gl-software") == 0;
}

/* True if a target draws the type with a transfer function here. Software GL is slow: it draws the
 * narrowest type with the first and the widest type with the second. */
static bool is_drawn(const struct test_target *target, int type, int types, int function) {
    if (TEST_SANITIZED && type > 0)
        return false;
    return !is_software_gl(target) || type == function * (types - 1);
}

/* Samples from the middle of axis 0 on are removed: the image is empty there, except for a border
 * that kernels reach. */
static void check_kind(const struct test_renderer *renderer, const struct test_target *target,
                       struct test_scene *scene, struct sp_volume *volume, enum kind kind) {
    struct test_image image;
    struct sp_error err;
    scene->view.layer_count = 1;
    struct sp_view view = scene->view;
    set_kind(&view, kind);
    view.edits[0] = (struct sp_edit){ .type = SP_EDIT_BOX, .box = { { 0.5, 0, 0 }, { 1, 1, 1 } } };
    view.edit_count = 1;
    if (!test_render(renderer, volume, &view, &image, &err))
        fail_msg("%s, %s: %s", target->backend, names[kind], err.text);
    const double rounding = 1e-5;
    double shown, rest;
    measure_columns(&image, 8, image.width / 2 - 8, &shown);
    unsigned reach = kind == VECTORS || kind == ALL_LAYERS ? 20 : 12; /* of kernels, px */
    double left = measure_columns(&image, image.width / 2 + reach, image.width, &rest);
    if (left > rounding || shown < 0.1)
        fail_msg("%s %s, %s: %g where all is removed, opacity %g elsewhere", target->backend,
                 target->isa, names[kind], left, shown);
    test_image_finish(&image);
}

static void removed_matter_is_invisible(void **state) {
    static const enum sp_type types[] = { SP_UINT8, SP_INT16, SP_FLOAT32, SP_INT32 };
    const struct test_target targets[] = { { "cpu", "scalar" },
                                           { "cpu", "auto" },
                                           { test_gl(), "auto" } };
    (void)state;
    for (int b = 0; b < 3; b++) {
        struct test_renderer renderer;
        struct sp_error err;
        if (!test_renderer_open(&renderer, &targets[b], 1, &err)) {
            print_message("  without %s: %s\n", targets[b].backend, err.text);
            continue;
        }
        if (is_software_gl(&targets[b]))
            print_message("  reduced: software GL draws each transfer function with one type\n");
        for (int t = 0; t < 4; t++) {
            struct test_scene scene = { 0 };
            struct sp_volume *volume = make_volume(&scene, types[t]);
            for (int f = 0; f < 2; f++) {
                if (!is_drawn(&targets[b], t, 4, f))
                    continue;
                test_scene_points(&scene, points[f], 2);
                for (int kind = 0; kind < KINDS; kind++)
                    check_kind(&renderer, &targets[b], &scene, volume, (enum kind)kind);
            }
            sp_volume_unref(&volume);
            test_scene_finish(&scene);
        }
        test_renderer_close(&renderer);
    }
}

int main(void) {
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    const struct CMUnitTest tests[] = { cmocka_unit_test(removed_matter_is_invisible) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
