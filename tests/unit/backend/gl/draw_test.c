/* SPDX-License-Identifier: Apache-2.0
 *
 * Frames of the GPU backend on software GL: in one piece and in pieces of any size, with edits
 * between frames, cancelled, and beyond the memory budget.
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
#include "support/gl.h"
#include "support/image.h"
#include "support/sanitized.h"
#include "support/scene.h"

struct rig {
    const struct sp_backend *backend;
    struct gl_state *state;
    struct sp_frame_pool *pool;
};

static bool open_rig(struct rig *rig, uint64_t memory_bytes, struct sp_error *err) {
    const struct sp_backend_options options = {
        .threads = 2, .memory_bytes = memory_bytes, .isa = "auto", .gpu = -1
    };
    *rig = (struct rig){ .backend = test_backend(test_gl()) };
    rig->state = rig->backend->create(&options, err);
    rig->pool = rig->state ? sp_frame_pool_create((size_t)64 << 20, err) : NULL;
    if (!rig->pool)
        return false;
    /* Tests of pieces choose their sizes: these depend neither on the GPU nor on the time it takes.
     */
    rig->state->workload.limits.stall_factor = 1;
    rig->state->workload.limits.dispatch_ms = INFINITY;
    return true;
}

static void close_rig(struct rig *rig) {
    rig->backend->destroy(rig->state);
    sp_frame_pool_destroy(&rig->pool);
}

/* False with *err set. */
static bool draw(struct rig *rig, struct sp_volume *volume, const struct sp_view *view,
                 const atomic_bool *cancel, struct test_image *image, struct sp_frame_stats *stats,
                 struct sp_error *err) {
    struct sp_frame *frame =
        sp_frame_create(rig->pool, view->size[0], view->size[1], SP_RGBAF32, err);
    assert_non_null(frame);
    struct sp_backend_job job = {
        .volume = volume, .view = view, .frame = frame, .cancel = cancel
    };
    bool ok = rig->backend->render(rig->state, &job, err);
    if (ok && image)
        assert_true(test_image_from_frame(image, frame));
    if (stats)
        *stats = frame->stats;
    sp_frame_unref(&frame);
    return ok;
}

/* Image size in px: not a multiple of the tile size. */
enum { WIDE = 27, HIGH = 19 };

/* Builds a scene and its volume, composited in sheets. Slabs are thick, because each one costs
 * software GL many dispatches. */
static struct sp_volume *make_scene(test_scene_fn *build, struct test_scene *scene) {
    assert_true(build(scene));
    scene->view.compositing.mode = SP_COMPOSITE_SHEET;
    scene->view.compositing.slab = 4;
    scene->view.size[0] = WIDE;
    scene->view.size[1] = HIGH;
    struct sp_volume *volume = test_scene_volume(scene, NULL);
    assert_non_null(volume);
    return volume;
}

static struct test_image draw_ok(struct rig *rig, struct sp_volume *volume,
                                 const struct sp_view *view, struct sp_frame_stats *stats) {
    struct test_image image;
    struct sp_error err;
    if (!draw(rig, volume, view, NULL, &image, stats, &err))
        fail_msg("%s", err.text);
    return image;
}

static void check_same(struct test_image *got, const struct test_image *wanted, const char *what) {
    double psnr = test_image_psnr(got, wanted);
    print_message("  %s: %.1f dB\n", what, psnr);
    assert_compare(psnr, >=, 110);
    test_image_finish(got);
}

/* Clears the limits that earlier frames lowered for lack of memory. */
static void reset(struct rig *rig, const struct gl_limits *limits) {
    struct gl_workload *workload = &rig->state->workload;
    workload->limits = *limits;
    workload->rows = limits->tiles;
    workload->layers = limits->bins;
    workload->records = limits->records;
    workload->passes = 1;
}

static void pieces_add_up_to_the_whole_image(void **state) {
    struct rig *rig = *state;
    static test_scene_fn *const builds[] = { test_scene_blobs, test_scene_inside,
                                             test_scene_rectilinear_blobs,
                                             test_scene_checkerboard };
    static const enum sp_compositing modes[] = { SP_COMPOSITE_SHEET, SP_COMPOSITE_SLAB,
                                                 SP_COMPOSITE_SPLAT, SP_COMPOSITE_SHEET };
    const struct gl_limits whole = rig->state->workload.limits;
    struct gl_limits small[] = { whole, whole, whole, whole, whole, whole, whole };
    small[0].records = SP_BRICK_VOXELS; /* one or two bricks per batch */
    small[1].bins = 1;                  /* one layer per batch */
    small[2].records = SP_BRICK_VOXELS; /* a few bricks per batch, one row of tiles per band */
    small[2].bins = small[2].tiles = 1;
    small[3].pairs = 3000; /* overflow is found after projection */
    small[4].loops = 1000; /* many passes per tile */
    small[5].loops = 2000; /* many passes of many batches */
    small[5].records = SP_BRICK_VOXELS;
    small[6].stall_factor = whole.loops; /* a splat covers at most one row of tiles */
    for (size_t b = 0; b < sizeof builds / sizeof *builds; b += TEST_SANITIZED ? 3 : 1) {
        struct test_scene scene;
        struct sp_volume *volume = make_scene(builds[b], &scene);
        scene.view.compositing.mode = modes[b];
        struct sp_frame_stats stats, own;
        struct test_image wanted = draw_ok(rig, volume, &scene.view, &stats);
        for (size_t i = 0; i < sizeof small / sizeof *small; i++) {
            struct test_image got;
            if (modes[b] != SP_COMPOSITE_SHEET && (small[i].bins == 1 || i % 2))
                continue; /* has many more layers, or is too slow */
            reset(rig, &small[i]);
            if (small[i].pairs < rig->state->workload.pairs)
                rig->state->workload.pairs = small[i].pairs / 2;
            got = draw_ok(rig, volume, &scene.view, &own);
            check_same(&got, &wanted, scene.info.name);
            assert_int_equal(own.splats, stats.splats); /* each splat is drawn once */
            if (small[i].stall_factor > 1 && builds[b] == test_scene_inside)
                assert_compare(rig->state->workload.rows, <, whole.tiles);
            reset(rig, &whole);
        }
        test_image_finish(&wanted);
        rig->backend->evict(rig->state, volume);
        sp_volume_unref(&volume);
        test_scene_finish(&scene);
    }
}

/* Draws one frame with a backend. */
static struct test_image draw_by(const struct sp_backend *backend, void *state,
                                 struct sp_volume *volume, const struct sp_view *view,
                                 unsigned mip_level, struct sp_frame_pool *pool) {
    struct test_image image;
    struct sp_error err;
    struct sp_frame *frame = sp_frame_create(pool, view->size[0], view->size[1], SP_RGBAF32, &err);
    assert_non_null(frame);
    const struct sp_backend_job job = {
        .volume = volume, .view = view, .mip_level = mip_level, .frame = frame
    };
    if (!backend->render(state, &job, &err))
        fail_msg("%s", err.text);
    assert_true(test_image_from_frame(&image, frame));
    sp_frame_unref(&frame);
    return image;
}

/* Choices that the manifest of conformance/ lacks: mip levels, and box footprints of both kernels
 * that planes and slabs cut. */
static void other_choices_match_the_reference(void **state) {
    struct rig *rig = *state;
    const struct sp_backend *cpu = test_backend("cpu");
    const struct sp_backend_options options = {
        .threads = 2, .memory_bytes = (uint64_t)1 << 30, .isa = "scalar", .gpu = -1
    };
    void *reference = cpu->create(&options, NULL);
    struct test_scene scene;
    struct sp_volume *volume = make_scene(test_scene_blobs, &scene);
    assert_non_null(reference);
    for (int n = 0; n < 10; n += TEST_SANITIZED ? 4 : 1) {
        struct sp_view view = scene.view;
        unsigned mip_level = n < 6 ? (unsigned)n % 3 : 0;
        bool is_post = n >= 3 && n != 6 && n != 7;
        if (is_post)
            view.transfer_function.order = SP_TF_POST;
        if (is_post)
            view.compositing.mode = SP_COMPOSITE_SLAB;
        if (n >= 6) {
            view.filter.mode = SP_FILTER_NONE;
            view.filter.kernel = n % 2 ? SP_KERNEL_CUBIC : SP_KERNEL_GAUSSIAN;
            view.clip.box[1][0] = 0.6;
        }
        struct test_image got =
            draw_by(rig->backend, rig->state, volume, &view, mip_level, rig->pool);
        struct test_image wanted = draw_by(cpu, reference, volume, &view, mip_level, rig->pool);
        double psnr = test_image_psnr(&got, &wanted);
        print_message("  %s, mip level %u, filter %d, kernel %d, mode %d: %.1f dB\n",
                      is_post ? "post" : "pre", mip_level, (int)view.filter.mode,
                      (int)view.filter.kernel, (int)view.compositing.mode, psnr);
        assert_compare(psnr, >=, 90);
        test_image_finish(&got);
        test_image_finish(&wanted);
    }
    cpu->evict(reference, volume);
    cpu->destroy(reference);
    rig->backend->evict(rig->state, volume);
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
}

/* Splats over one tile are projected once, however many there are. */
static void many_splats_over_one_tile_are_one_batch(void **state) {
    struct rig *rig = *state;
    struct test_scene scene;
    struct sp_volume *volume = make_scene(test_scene_blobs, &scene);
    const struct gl_limits whole = rig->state->workload.limits;
    struct sp_view view = scene.view;
    view.level_of_detail = SP_LOD_OFF;
    view.size[0] = view.size[1] = 8;
    for (int mode = 0; mode < 3; mode++) {
        view.compositing.mode = (enum sp_compositing)mode;
        reset(rig, &whole);
        struct test_image wanted = draw_ok(rig, volume, &view, NULL);
        rig->state->workload.limits.loops = 4000;
        struct test_image got = draw_ok(rig, volume, &view, NULL);
        print_message("  %u passes\n", rig->state->workload.passes);
        assert_int_equal(rig->state->partition.batch_count, 1);
        assert_compare(rig->state->workload.passes, >, 1);
        check_same(&got, &wanted, "in passes");
        test_image_finish(&wanted);
    }
    reset(rig, &whole);
    rig->backend->evict(rig->state, volume);
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
}

/* The limit on pairs of splats and tiles, and the limit on splats of one depth in one tile. */
static void a_frame_that_exceeds_one_limit_is_refused(void **state) {
    struct rig *rig = *state;
    struct test_scene scene;
    struct sp_volume *volume = make_scene(test_scene_constant_cube, &scene);
    const struct gl_limits whole = rig->state->workload.limits;
    for (int crowded = 0; crowded < (TEST_SANITIZED ? 1 : 2); crowded++) {
        struct sp_error err = { 0 };
        struct sp_view view = scene.view;
        view.size[0] = view.size[1] = GL_TILE; /* one tile, so that there are few rounds */
        const struct sp_view next = view;
        if (crowded) {
            rig->state->workload.limits.loops = 600;
            view.compositing.mode = SP_COMPOSITE_SPLAT;
            view.level_of_detail = SP_LOD_OFF;
        } else {
            rig->state->workload.limits.pairs = rig->state->workload.pairs = 7;
        }
        assert_false(draw(rig, volume, &view, NULL, NULL, NULL, &err));
        assert_int_equal(err.code, SP_ERR_BUDGET);
        assert_non_null(strstr(err.text, crowded ? "sorts at most 25" : "limit is 7"));
        reset(rig, &whole);
        struct test_image image = draw_ok(rig, volume, &next, NULL);
        test_image_finish(&image);
    }
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
}

static void an_edit_uploads_what_it_changes(void **state) {
    struct rig *rig = *state;
    struct test_scene scene;
    struct sp_volume *volume = make_scene(test_scene_constant_cube, &scene);
    scene.view.level_of_detail = SP_LOD_OFF; /* all views draw the same list */
    struct sp_view view = scene.view;
    struct test_image before = draw_ok(rig, volume, &view, NULL);
    uint64_t first = rig->state->residency.uploaded;
    view.camera.position[0] += 5; /* a view change uploads nothing of the volume */
    struct test_image turned = draw_ok(rig, volume, &view, NULL);
    assert_int_equal(rig->state->residency.uploaded, first);
    assert_compare(test_image_psnr(&turned, &before), <, 60);
    view = scene.view;
    for (uint32_t p = 0; p < view.transfer_function.point_count; p++)
        view.transfer_function.points[p].color[1] = 0; /* an edit of colours uploads a table */
    struct test_image tinted = draw_ok(rig, volume, &view, NULL);
    uint64_t table = rig->state->residency.uploaded - first;
    assert_compare(table, >, 0);
    assert_compare(table, <, 70000);
    assert_compare(test_image_psnr(&tinted, &before), <, 60);
    struct test_image again = draw_ok(rig, volume, &scene.view, NULL);
    check_same(&again, &before, "edited back");
    assert_compare(rig->backend->memory(rig->state, volume), >, 0);
    rig->backend->evict(rig->state, volume);
    assert_int_equal(rig->backend->memory(rig->state, volume), 0);
    test_image_finish(&before);
    test_image_finish(&turned);
    test_image_finish(&tinted);
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
}

/* After any edits, a frame equals the frame of a renderer that has no data of the volume. */
static void edits_match_a_fresh_renderer(void **state) {
    struct rig *rig = *state, fresh;
    struct sp_error err;
    struct test_scene scene;
    struct sp_volume *volume = make_scene(test_scene_gradient_axis, &scene);
    struct sp_view view = scene.view;
    struct sp_transfer_function *tf = &view.transfer_function;
    assert_true(open_rig(&fresh, (uint64_t)1 << 30, &err));
    for (int i = 0; i < 12; i += TEST_SANITIZED ? 3 : 1) {
        for (uint32_t p = 0; p < tf->point_count; p++)
            tf->points[p].opacity = rand() % 3 ? 0.1f * (float)(rand() % 10) : 0;
        /* If the gradient axis were removed later, gradients would stay finer than in a new list.
         */
        tf->gradient_count = i < 5 ? 0 : scene.view.transfer_function.gradient_count;
        view.shading.mode = i % 3 ? SP_SHADING_PHONG : SP_SHADING_NONE;
        struct test_image got = draw_ok(rig, volume, &view, NULL);
        struct test_image wanted = draw_ok(&fresh, volume, &view, NULL);
        double psnr = test_image_psnr(&got, &wanted);
        print_message("  edited %d: %.1f dB\n", i, psnr);
        assert_compare(psnr, >=, 90); /* hidden splats may count where a tile becomes opaque */
        test_image_finish(&got);
        test_image_finish(&wanted);
        fresh.backend->evict(fresh.state, volume);
    }
    close_rig(&fresh);
    rig->backend->evict(rig->state, volume);
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
}

/* One mip level; each compositing mode. */
static void a_change_of_view_uploads_a_few_hundred_bytes(void **state) {
    struct rig *rig = *state;
    static test_scene_fn *const builds[] = { test_scene_blobs, test_scene_rectilinear_blobs };
    for (int n = 0; n < 6; n += TEST_SANITIZED ? 4 : 1) {
        struct test_scene scene;
        struct sp_volume *volume = make_scene(builds[n / 3], &scene);
        struct sp_view view = scene.view;
        view.level_of_detail = SP_LOD_OFF;
        view.compositing.mode = (enum sp_compositing)(n % 3);
        struct test_image image = draw_ok(rig, volume, &view, NULL);
        uint64_t before = rig->state->upload.bytes;
        for (int r = 0; r < 3; r++)
            view.camera.position[r] += 0.02 * (r + 1);
        struct test_image turned = draw_ok(rig, volume, &view, NULL);
        uint64_t sent = rig->state->upload.bytes - before;
        print_message("  compositing %d: %lu bytes, %.1f dB\n", n % 3, (unsigned long)sent,
                      test_image_psnr(&turned, &image));
        assert_compare(sent, >, 0);
        assert_compare(sent, <, 600);
        assert_compare(test_image_psnr(&turned, &image), <, 90);
        test_image_finish(&turned);
        test_image_finish(&image);
        rig->backend->evict(rig->state, volume);
        sp_volume_unref(&volume);
        test_scene_finish(&scene);
    }
}

/* One renderer draws changing views of changing volumes. A new renderer draws each of them again.
 */
static void cached_data_of_other_views_changes_nothing(void **state) {
    struct rig *rig = *state;
    static test_scene_fn *const builds[] = { test_scene_blobs, test_scene_inside,
                                             test_scene_rectilinear_blobs };
    struct test_scene scenes[3];
    struct sp_volume *volumes[3];
    for (int i = 0; i < 3; i++)
        volumes[i] = make_scene(builds[i], &scenes[i]);
    srand(3);
    for (int n = 0; n < (TEST_SANITIZED ? 3 : 6); n++) {
        int i = rand() % 3;
        struct rig fresh;
        struct sp_view view = scenes[i].view;
        view.compositing.mode = rand() % 2 ? SP_COMPOSITE_SHEET : SP_COMPOSITE_SLAB;
        view.level_of_detail = rand() % 2 ? SP_LOD_AUTO : SP_LOD_OFF;
        if (rand() % 2) /* from behind, sheets have the opposite order */
            for (int r = 0; r < 3; r++)
                view.camera.position[r] = 2 * view.camera.target[r] - view.camera.position[r];
        view.size[0] = view.size[1] = 24 + 8 * (unsigned)(rand() % 2);
        assert_true(open_rig(&fresh, (uint64_t)1 << 30, NULL));
        struct test_image wanted = draw_ok(&fresh, volumes[i], &view, NULL);
        struct test_image got = draw_ok(rig, volumes[i], &view, NULL);
        check_same(&got, &wanted, scenes[i].info.name);
        test_image_finish(&wanted);
        close_rig(&fresh);
    }
    for (int i = 0; i < 3; i++) {
        rig->backend->evict(rig->state, volumes[i]);
        sp_volume_unref(&volumes[i]);
        test_scene_finish(&scenes[i]);
    }
}

static void a_cancelled_frame_leaves_nothing_behind(void **state) {
    struct rig *rig = *state;
    struct test_scene scene;
    struct sp_volume *volume = make_scene(test_scene_blobs, &scene);
    struct test_image wanted = draw_ok(rig, volume, &scene.view, NULL);
    atomic_bool cancel = true;
    struct sp_error err;
    assert_false(draw(rig, volume, &scene.view, &cancel, NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    struct test_image got = draw_ok(rig, volume, &scene.view, NULL);
    check_same(&got, &wanted, "after a cancelled frame");
    test_image_finish(&wanted);
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
}

static void volumes_share_a_budget_by_least_recent_use(void **state) {
    (void)state;
    struct test_scene scenes[2];
    struct sp_volume *volumes[2] = { make_scene(test_scene_blobs, &scenes[0]),
                                     make_scene(test_scene_constant_cube, &scenes[1]) };
    struct rig rig;
    struct sp_error err;
    for (int i = 0; i < 2; i++) /* one list each */
        scenes[i].view.level_of_detail = SP_LOD_OFF;
    assert_true(open_rig(&rig, (uint64_t)1 << 30, &err));
    for (int i = 0; i < 2; i++) {
        struct test_image image = draw_ok(&rig, volumes[i], &scenes[i].view, NULL);
        test_image_finish(&image);
        assert_compare(gl_residency_bytes(&rig.state->residency, volumes[i]), >, 0);
    }
    uint64_t bytes[2];
    for (int i = 0; i < 2; i++)
        bytes[i] = gl_residency_bytes(&rig.state->residency, volumes[i]);
    int large = bytes[1] > bytes[0], small = !large;
    rig.state->residency.limit_bytes =
        bytes[large] + gl_draw_bytes(rig.state); /* enough for one volume */
    for (int pass = 0; pass < 4;
         pass++) { /* the samples of the large volume are evicted, and its list is still used */
        int now = pass % 2 ? large : small;
        uint64_t uploaded = rig.state->residency.uploaded;
        struct test_image image = draw_ok(&rig, volumes[now], &scenes[now].view, NULL);
        test_image_finish(&image);
        assert_compare(gl_residency_bytes(&rig.state->residency, volumes[small]), ==, bytes[small]);
        assert_in_range(gl_residency_bytes(&rig.state->residency, volumes[large]), 1,
                        bytes[large] - 1);
        assert_compare(rig.state->residency.uploaded, ==, uploaded);
    }
    rig.state->residency.limit_bytes =
        gl_residency_bytes(&rig.state->residency, volumes[large]) + gl_draw_bytes(rig.state);
    for (int pass = 0; pass < 2; pass++) { /* enough for one list */
        int now = pass ? small : large, other = !now;
        struct test_image image = draw_ok(&rig, volumes[now], &scenes[now].view, NULL);
        test_image_finish(&image);
        assert_compare(gl_residency_bytes(&rig.state->residency, volumes[now]), >, 0);
        assert_int_equal(gl_residency_bytes(&rig.state->residency, volumes[other]), 0);
    }
    rig.state->residency.limit_bytes = 1000; /* less than either needs */
    assert_false(draw(&rig, volumes[0], &scenes[0].view, NULL, NULL, NULL, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, " 1000 "));
    close_rig(&rig);
    for (int i = 0; i < 2; i++) {
        sp_volume_unref(&volumes[i]);
        test_scene_finish(&scenes[i]);
    }
}

int main(void) {
    struct rig rig;
    struct sp_error err;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    if (TEST_SANITIZED)
        printf("reduced under a sanitizer: fewer scenes, views and choices\n");
    if (!open_rig(&rig, (uint64_t)1 << 30, &err)) {
        printf("skipped: no software GL here: %s\n", err.text);
        return TEST_SKIPPED;
    }
#define ON(test)                                                                                   \
    { #test, test, NULL, NULL, &rig }
    const struct CMUnitTest tests[] = {
        ON(pieces_add_up_to_the_whole_image),
        ON(other_choices_match_the_reference),
        ON(many_splats_over_one_tile_are_one_batch),
        ON(a_frame_that_exceeds_one_limit_is_refused),
        ON(an_edit_uploads_what_it_changes),
        ON(edits_match_a_fresh_renderer),
        ON(a_change_of_view_uploads_a_few_hundred_bytes),
        ON(cached_data_of_other_views_changes_nothing),
        ON(a_cancelled_frame_leaves_nothing_behind),
        ON(volumes_share_a_budget_by_least_recent_use),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    close_rig(&rig);
    return failed;
}
