/* SPDX-License-Identifier: Apache-2.0
 *
 * Layers of elements, alone and inside a volume, on software GL beside the scalar kernels of the
 * CPU, which conformance.mesh, points and gaussians hold to other references.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <epoxy/gl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/memory.h"
#include "draw/layers/cloud/order.h"
#include "sp/log.h"
#include "support/compare.h"
#include "support/data.h"
#include "support/gl.h"
#include "support/mesh.h"
#include "support/sanitized.h"
#include "unit/backend/gl/resample_rig.h"

static const struct {
    const char *name;
    enum sp_compositing mode;
    enum sp_tf_order order;
} paths[] = { { "resampled", SP_COMPOSITE_SHEET, SP_TF_POST },
              { "sheets", SP_COMPOSITE_SHEET, SP_TF_PRE },
              { "slabs", SP_COMPOSITE_SLAB, SP_TF_PRE },
              { "splats", SP_COMPOSITE_SPLAT, SP_TF_PRE },
              { "alone", SP_COMPOSITE_SHEET, SP_TF_PRE } };
enum { PATHS = sizeof paths / sizeof *paths, ALONE = PATHS - 1 };

static struct sp_volume *finish_volume(struct sp_elements *e) {
    struct sp_error err;
    struct sp_volume *volume = sp_volume_create_elements(e, "elements", &err);
    if (!volume)
        fail_msg("%s", err.text);
    return volume;
}

/* The volumes of layers of points, Gaussians and geometry. */
enum { POINTS, GAUSSIANS, MESH, KINDS };

static float random_in(unsigned *seed, float low, float high) {
    *seed = *seed * 1664525u + 1013904223u;
    return low + (high - low) * (float)(*seed >> 8) / 16777216.0f;
}

/* Points or Gaussians in a box about the origin, some of which are not drawn. */
static struct sp_volume *make_cloud(int kind, uint32_t count, float size) {
    enum { DEGREE = 2, NUMBERS = 27 };
    unsigned seed = 5;
    struct sp_elements e = { .positions = calloc(count, 3 * sizeof(float)),
                             .factors = calloc(count, 6 * sizeof(float)),
                             .values = calloc(count, sizeof(float)),
                             .volumes = calloc(count, sizeof(float)),
                             .vectors = calloc(count, 3 * sizeof(float)),
                             .harmonics = calloc(count, NUMBERS * sizeof(float)) };
    assert_true(e.positions && e.factors && e.values && e.volumes && e.vectors && e.harmonics);
    e.shape.count = count;
    e.shape.kind = kind == POINTS ? SP_KIND_POINTS : SP_KIND_GAUSSIANS;
    e.shape.degree = kind == POINTS ? 0 : DEGREE;
    e.shape.has_vectors = kind == POINTS;
    for (uint32_t i = 0; i < count; i++) {
        for (int a = 0; a < 3; a++)
            e.positions[i][a] = i % 97 ? random_in(&seed, -8, 8) : NAN;
        for (int k = 0; k < 6; k++)
            e.factors[i][k] = size * random_in(&seed, -1, 1);
        for (int k = 0; k < NUMBERS && kind == GAUSSIANS; k++)
            e.harmonics[NUMBERS * i + (uint32_t)k] = random_in(&seed, -1, 1);
        e.values[i] = random_in(&seed, 0, kind == POINTS ? 255 : 1);
        e.volumes[i] = size * size * size;
        for (int a = 0; a < 3; a++) /* some are 0, and some no numbers */
            e.vectors[i][a] = i % 11 ? (i % 13 ? random_in(&seed, -1, 1) : NAN) : 0;
    }
    e.opacities = e.values;
    struct sp_volume *volume = finish_volume(&e);
    free(e.positions);
    free(e.factors);
    free(e.values);
    free(e.volumes);
    free(e.vectors);
    free(e.harmonics);
    return volume;
}

/* A torus that fades along its circle. */
static struct sp_volume *make_mesh(uint32_t n) {
    struct sp_elements mesh;
    assert_true(test_mesh_torus(&mesh, n, 7, 3));
    for (uint32_t i = 0; i < mesh.shape.vertex_count; i++)
        mesh.colors[i][3] = 0.3f + 0.7f * mesh.colors[i][0];
    struct sp_volume *volume = finish_volume(&mesh);
    test_mesh_finish(&mesh);
    return volume;
}

static struct sp_layer *add_layer(struct sp_view *view, enum sp_layer_type type) {
    struct sp_layer *layer = &view->layers[view->layer_count++];
    *layer = sp_layer_default(type);
    return layer;
}

/* A view of a ball and of elements inside of it, with choices by the bits of n. */
static void make_view(struct sp_view *view, const struct sp_volume *ball, int path, int n) {
    resample_make_view(view, ball, 0, 255);
    view->compositing.mode = paths[path].mode;
    view->transfer_function.order = paths[path].order;
    view->layer_count = path != ALONE;
    view->camera.projection = n & 1 ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
    view->shading.mode = n & 2 ? SP_SHADING_PHONG : SP_SHADING_NONE;
    view->clip.box[0][0] = n & 4 ? 0.3 : 0;
    view->clip.plane_count = n & 4 ? 1 : 0;
    view->clip.planes[0] = (struct sp_clip_plane){ { 0.5, 1, 0.7 }, -2 };
    view->background[3] = 0.4f;
}

/* Inside a volume only one choice is drawn, because each choice needs a program of its own. */
static int last_choice(int path) {
    return path == ALONE ? ALONE + (TEST_SANITIZED ? 2 : 8) : path + 1;
}

static void meshes_look_the_same(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *ball = resample_make_ball(SP_UINT8, 0, 255, false, false);
    struct sp_volume *mesh = make_mesh(16), *const layer_volumes[KINDS] = { [MESH] = mesh };
    for (int path = 0; path < PATHS; path++)
        for (int n = path; n < last_choice(path); n++) {
            struct sp_view view;
            char what[60];
            make_view(&view, ball, path, n);
            add_layer(&view, SP_LAYER_GEOMETRY)->opacity = n & 2 ? 0.6f : 1;
            if (n & 4) { /* two meshes, one of them moved and opaque */
                struct sp_layer *other = add_layer(&view, SP_LAYER_GEOMETRY);
                other->colors = SP_COLORS_OF_LAYER;
                other->transform[3] = 4;
                other->transform[10] = -1.5;
            }
            snprintf(what, sizeof what, "mesh, %s, choice %d", paths[path].name, n);
            resample_check(rig, what,
                           &(struct resample_shot){ &view, ball, 0, NULL, layer_volumes });
        }
    sp_volume_unref(&mesh);
    sp_volume_unref(&ball);
    resample_report(rig);
}

/* Frees the memory that earlier frames needed. */
static void release(struct gl_state *gl) {
    struct sp_error err;
    if (!gl_context_bind(gl->context, &err))
        fail_msg("%s", err.text);
    gl_memory_release(gl);
    gl_context_unbind(gl->context);
}

/* The triangles of a tile take several passes, the triangles of the mesh take several batches, and
 * bands are one row of tiles high. */
static void pieces_of_meshes_add_up(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *ball = resample_make_ball(SP_UINT8, 0, 255, false, false);
    struct sp_volume *mesh = make_mesh(46); /* 4232 triangles: two batches */
    struct sp_volume *const layer_volumes[KINDS] = { [MESH] = mesh };
    const struct gl_limits whole = gl->workload.limits;
    for (int n = 0; n < 2; n++) {
        struct sp_view view;
        char what[40];
        make_view(&view, ball, n ? ALONE : 0, n);
        struct sp_layer *layer = add_layer(&view, SP_LAYER_GEOMETRY);
        layer->opacity = n ? 0.9f : 1;
        snprintf(what, sizeof what, "pieces of meshes %d", n);
        release(gl);
        gl->workload.limits.loops = 16000;
        gl->workload.limits.tiles = 1;
        gl->workload.limits.records = 4096;
        resample_check(rig, what, &(struct resample_shot){ &view, ball, 0, NULL, layer_volumes });
        assert_compare(gl->workload.element_passes, >, 1);
        gl->workload.limits = whole;
        gl_workload_init(&gl->workload);
    }
    sp_volume_unref(&mesh);
    sp_volume_unref(&ball);
    resample_report(rig);
}

static void clouds_look_the_same(void **state) {
    static const enum sp_layer_type types[] = { SP_LAYER_POINTS, SP_LAYER_GAUSSIANS };
    struct resample_rig *rig = *state;
    struct sp_volume *ball = resample_make_ball(SP_UINT8, 0, 255, false, false);
    struct sp_volume *const layer_volumes[KINDS] = { make_cloud(POINTS, 500, 1.2f),
                                                     make_cloud(GAUSSIANS, 300, 0.8f) };
    for (int path = 0; path < PATHS; path++)
        for (int n = path; n < last_choice(path); n++) {
            struct sp_view view;
            char what[60];
            make_view(&view, ball, path, n);
            view.compositing.attenuation =
                n & 8 ? SP_ATTENUATION_LINEAR : SP_ATTENUATION_EXPONENTIAL;
            struct sp_layer *layer = add_layer(&view, types[n % 4 < 2]);
            layer->convention = n & 4 ? SP_CONVENTION_NORMALISED : SP_CONVENTION_INRIA;
            layer->transform[1] = 0.4;
            layer->transform[3] = -2;
            snprintf(what, sizeof what, "cloud, %s, choice %d", paths[path].name, n);
            resample_check(rig, what,
                           &(struct resample_shot){ &view, ball, 0, NULL, layer_volumes });
        }
    for (int k = 0; k < MESH; k++)
        sp_volume_unref(&(struct sp_volume *){ layer_volumes[k] });
    sp_volume_unref(&ball);
    resample_report(rig);
}

/* Points of a volume of its own, which has streaks along their vectors. */
static void vectors_of_points_look_the_same(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *cloud = make_cloud(POINTS, 500, 1.2f);
    struct sp_volume *const layer_volumes[KINDS] = { cloud, cloud };
    for (int n = 0; n < (TEST_SANITIZED ? 2 : 8); n++) {
        struct sp_view view;
        char what[60];
        make_view(&view, cloud, ALONE, n);
        struct sp_layer *layer = add_layer(&view, SP_LAYER_VECTORS);
        layer->style = n & 2 ? SP_VECTORS_BLEND : SP_VECTORS_MODULATE;
        layer->density = n & 1 ? 1 : 0.7;
        layer->phase = 0.4;
        if (n & 4)
            add_layer(&view, SP_LAYER_POINTS)->size = 0.3;
        snprintf(what, sizeof what, "vectors of points, choice %d", n);
        resample_check(rig, what, &(struct resample_shot){ &view, cloud, 0, NULL, layer_volumes });
    }
    sp_volume_unref(&cloud);
    resample_report(rig);
}

/* The GPU sorts elements as the CPU does, except elements whose depths are equal up to rounding,
 * and leaves out the same elements. Several work groups move them. */
static void elements_come_in_order(void **state) {
    enum { COUNT = 20000 };
    static uint32_t got[COUNT];
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    for (int kind = POINTS; kind <= GAUSSIANS; kind++) {
        struct sp_volume *cloud = make_cloud(kind, COUNT, 0.05f);
        struct sp_volume *const layer_volumes[KINDS] = { [GAUSSIANS] = cloud, [POINTS] = cloud };
        struct sp_camera_transform camera;
        struct sp_voxel_source wanted;
        struct sp_cloud cpu;
        struct sp_view view;
        struct sp_error err;
        uint32_t apart = 0;
        make_view(&view, cloud, ALONE, 4);
        add_layer(&view, kind == POINTS ? SP_LAYER_POINTS : SP_LAYER_GAUSSIANS);
        resample_check(rig, "order",
                       &(struct resample_shot){ &view, cloud, 0, NULL, layer_volumes });
        assert_true(gl_context_bind(gl->context, &err));
        glBindBuffer(GL_SHADER_STORAGE_BUFFER, gl->splats.order[0].name);
        glGetBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, sizeof got, got);
        gl_context_unbind(gl->context);
        sp_camera_transform_init(&camera, &view.camera, view.size);
        const struct sp_cloud_input input = { .view = &view,
                                              .layer = &view.layers[0],
                                              .volume = cloud,
                                              .clipped = &sp_volume_info(cloud)->grid,
                                              .camera = &camera,
                                              .trees = &gl->layers.clouds,
                                              .pool = gl->pool,
                                              .arena = &gl->arena };
        sp_arena_reset(&gl->arena);
        assert_true(sp_cloud_prepare(&input, &cpu, &wanted, &err));
        assert_true(sp_cloud_sort(&cpu, NULL, &wanted.frame, NULL, gl->pool, &gl->arena,
                                  &input.interrupt, &wanted.order));
        assert_compare(wanted.order.count, >, COUNT / 4);
        assert_compare(wanted.order.count, <, COUNT / 97 * 96);
        for (uint32_t i = 0; i < COUNT; i++)
            apart += got[i] != (i < wanted.order.count ? wanted.order.voxels[i] : UINT32_MAX);
        print_message("  %u of %u elsewhere\n", apart, wanted.order.count);
        assert_compare(apart, <, COUNT / 50);
        sp_volume_unref(&cloud);
    }
    resample_report(rig);
}

/* Splats take several batches and passes, bands are one row of tiles high, and there are few bins.
 */
static void pieces_of_clouds_add_up(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *ball = resample_make_ball(SP_UINT8, 0, 255, false, false);
    struct sp_volume *cloud = make_cloud(GAUSSIANS, 6000, 0.15f);
    struct sp_volume *const layer_volumes[KINDS] = { [GAUSSIANS] = cloud };
    const struct gl_limits whole = gl->workload.limits;
    for (int n = 0; n < 4; n++) {
        struct sp_view view;
        char what[40];
        make_view(&view, ball, n % 2 ? ALONE : n, n);
        add_layer(&view, SP_LAYER_GAUSSIANS);
        snprintf(what, sizeof what, "pieces of clouds %d", n);
        release(gl);
        gl->workload.limits.loops = 6000;
        gl->workload.limits.tiles = n & 2 ? 1 : whole.tiles;
        gl->workload.limits.records = 4096;
        gl->workload.limits.bins = 400;
        gl->workload.pairs = 900; /* grows */
        resample_check(rig, what, &(struct resample_shot){ &view, ball, 0, NULL, layer_volumes });
        assert_compare(gl->workload.element_passes, >, 1);
        assert_compare(gl->workload.pairs, >, 900);
        gl->workload.limits = whole;
        gl_workload_init(&gl->workload);
    }
    sp_volume_unref(&cloud);
    sp_volume_unref(&ball);
    resample_report(rig);
}

/* Far away, and in previews, cells are drawn as one point (draw/layers/cloud/tree.h). */
static void points_have_levels_of_detail(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *cloud = make_cloud(POINTS, SP_CLOUD_TREE_MIN, 0.1f);
    struct sp_volume *const layer_volumes[KINDS] = { [POINTS] = cloud };
    for (unsigned n = 0; n < 4; n++) { /* mip levels, with colours of values and of lengths */
        struct sp_view view;
        make_view(&view, cloud, ALONE, 0);
        struct sp_layer *layer = add_layer(&view, SP_LAYER_POINTS);
        if (n & 1)
            snprintf(layer->color_by, sizeof layer->color_by, "%s", SP_COLOR_BY_LENGTH);
        const struct resample_shot shot = { &view, cloud, n & 2, NULL, layer_volumes };
        resample_check(rig, n & 1 ? "points coloured by length" : "points", &shot);
    }
    sp_volume_unref(&cloud);
    resample_report(rig);
}

/* Everything in one frame. */
static void all_layers_mix(void **state) {
    struct resample_rig *rig = *state;
    struct sp_volume *ball = resample_make_ball(SP_UINT8, 0, 255, false, false);
    struct sp_volume *const layer_volumes[KINDS] = { make_cloud(POINTS, 60, 1),
                                                     make_cloud(GAUSSIANS, 40, 0.8f),
                                                     make_mesh(12) };
    rig->edge_pixels = test_gl_is_software() ? 0 : 2;
    for (int path = 0; path < PATHS; path++) {
        struct sp_view view;
        char what[60];
        make_view(&view, ball, path, path);
        add_layer(&view, SP_LAYER_SHELL)->high = 0.4;
        add_layer(&view, SP_LAYER_GAUSSIANS);
        add_layer(&view, SP_LAYER_GEOMETRY)->opacity = 0.5f;
        add_layer(&view, SP_LAYER_POINTS);
        snprintf(what, sizeof what, "all, %s", paths[path].name);
        resample_check(rig, what, &(struct resample_shot){ &view, ball, 0, NULL, layer_volumes });
    }
    for (int k = 0; k < KINDS; k++)
        sp_volume_unref(&(struct sp_volume *){ layer_volumes[k] });
    sp_volume_unref(&ball);
    rig->edge_pixels = 0;
    resample_report(rig);
}

/* Elements are uploaded once, and not kept after their volume is evicted. */
static void elements_stay_on_the_gpu(void **state) {
    static const struct {
        enum sp_layer_type type;
        uint64_t bytes; /* of the volume */
    } kinds[KINDS] = { { SP_LAYER_POINTS, 100 * (12 + 24 + 4 + 4) },
                       { SP_LAYER_GAUSSIANS, 100 * (12 + 24 + 4 + 108) },
                       { SP_LAYER_GEOMETRY, 144 * 40 + 288 * 12 } };
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *const layer_volumes[KINDS] = { make_cloud(POINTS, 100, 1),
                                                     make_cloud(GAUSSIANS, 100, 0.8f),
                                                     make_mesh(12) };
    for (int k = 0; k < KINDS; k++) {
        struct sp_view view;
        make_view(&view, layer_volumes[k], ALONE, 0);
        add_layer(&view, kinds[k].type);
        const struct resample_shot shot = { &view, layer_volumes[k], 0, NULL, layer_volumes };
        uint64_t before = gl->residency.uploaded;
        resample_check(rig, "first", &shot);
        assert_compare(gl->residency.uploaded - before, ==, kinds[k].bytes);
        assert_compare(gl_residency_bytes(&gl->residency, layer_volumes[k]), >=, kinds[k].bytes);
        view.camera.position[0] += 3;
        resample_check(rig, "another direction", &shot);
        assert_compare(gl->residency.uploaded - before, ==, kinds[k].bytes);
        for (int b = 0; b < BACKENDS; b++)
            rig->backends[b]->evict(rig->states[b], layer_volumes[k]);
        assert_compare(rig->backends[GL]->memory(rig->states[GL], layer_volumes[k]), ==, 0);
        resample_check(rig, "again", &shot);
        assert_compare(gl->residency.uploaded - before, ==, 2 * kinds[k].bytes);
        sp_volume_unref(&(struct sp_volume *){ layer_volumes[k] });
    }
    resample_report(rig);
}

/* A frame that needs too much memory is refused with both numbers, and the next frame is drawn. */
static void too_little_memory_is_an_error(void **state) {
    struct resample_rig *rig = *state;
    struct gl_state *gl = resample_rig_gl(rig);
    struct sp_volume *mesh = make_mesh(64), *const layer_volumes[KINDS] = { [MESH] = mesh };
    const uint64_t limit = gl->residency.limit_bytes;
    struct sp_view view;
    struct sp_error err;
    make_view(&view, mesh, ALONE, 0);
    add_layer(&view, SP_LAYER_GEOMETRY);
    const struct resample_shot shot = { &view, mesh, 0, NULL, layer_volumes };
    gl->residency.limit_bytes = 200000;
    assert_false(resample_try(rig, GL, &shot, NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, " of a mesh and the render buffers take"));
    assert_non_null(strstr(err.text, "200000 are allowed"));
    gl->residency.limit_bytes = limit;
    resample_check(rig, "after the error", &shot);
    sp_volume_unref(&mesh);
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
        ON(meshes_look_the_same),         ON(pieces_of_meshes_add_up),
        ON(clouds_look_the_same),         ON(vectors_of_points_look_the_same),
        ON(elements_come_in_order),       ON(pieces_of_clouds_add_up),
        ON(points_have_levels_of_detail), ON(all_layers_mix),
        ON(elements_stay_on_the_gpu),     ON(too_little_memory_is_an_error)
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    resample_rig_close(&rig);
    return failed;
}
