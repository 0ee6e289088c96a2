/* SPDX-License-Identifier: Apache-2.0
 *
 * The budget of video memory: all GPU memory counts towards it, frames are drawn within it, and
 * memory that only one frame needed is released later.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/backend.h"
#include "backend/gl/memory.h"
#include "backend/gl/state.h"
#include "sp/log.h"
#include "support/compare.h"
#include "support/data.h"
#include "support/gl.h"
#include "support/image.h"
#include "support/sanitized.h"

/* Rounds of a test: the second round begins with the cached data of the first round. */
enum { MIB = 1 << 20, WIDE = 500, SMALL = 24, ROUNDS = TEST_SANITIZED ? 1 : 2 };

struct rig {
    const struct sp_backend *backend;
    struct gl_state *state;
    struct sp_frame_pool *pool;
    struct sp_volume *volume;
};

static bool open_rig(struct rig *rig, uint64_t video_bytes, struct sp_error *err) {
    const struct sp_backend_options options = { .threads = 1,
                                                .memory_bytes = (uint64_t)1 << 30,
                                                .video_bytes = video_bytes,
                                                .isa = "auto",
                                                .gpu = -1 };
    *rig = (struct rig){ .backend = test_backend(test_gl()) };
    rig->state = rig->backend->create(&options, err);
    if (!rig->state)
        return false;
    assert_non_null(rig->pool = sp_frame_pool_create(0, err));
    assert_non_null(rig->volume = sp_volume_load("demo:phantom?size=20", NULL, err));
    return true;
}

static void must_open(struct rig *rig, uint64_t video_bytes) {
    struct sp_error err;
    if (!open_rig(rig, video_bytes, &err))
        fail_msg("%s", err.text);
}

static void close_rig(struct rig *rig) {
    rig->backend->destroy(rig->state);
    sp_volume_unref(&rig->volume);
    sp_frame_pool_destroy(&rig->pool);
}

static bool draw(struct rig *rig, uint32_t width, struct test_image *image, struct sp_error *err) {
    struct sp_view view;
    sp_view_init(&view, sp_volume_info(rig->volume), "v");
    view.size[0] = width;
    view.size[1] = width / 2;
    struct sp_frame *frame = sp_frame_create(rig->pool, width, width / 2, SP_RGBAF32, err);
    const struct sp_backend_job job = { .volume = rig->volume, .view = &view, .frame = frame };
    assert_non_null(frame);
    bool ok = rig->backend->render(rig->state, &job, err);
    if (ok && image)
        assert_true(test_image_from_frame(image, frame));
    sp_frame_unref(&frame);
    return ok;
}

static void must_draw(struct rig *rig, uint32_t width, struct test_image *image) {
    struct sp_error err;
    if (!draw(rig, width, image, &err))
        fail_msg("%s", err.text);
}

static uint64_t all_bytes(const struct rig *rig) {
    return gl_residency_bytes(&rig->state->residency, NULL) + gl_draw_bytes(rig->state);
}

static void a_small_budget_draws_in_smaller_pieces(void **state) {
    (void)state;
    struct rig rig;
    struct test_image wanted, got;
    must_open(&rig, 0);
    must_draw(&rig, WIDE, &wanted);
    uint64_t whole = all_bytes(&rig);
    close_rig(&rig);
    assert_compare(whole, >, 8 * MIB);
    must_open(&rig, 8 * MIB);
    must_draw(&rig, WIDE, &got);
    assert_compare(all_bytes(&rig), <=, 8 * MIB);
    assert_compare(rig.state->slots[0].y, >, 0);
    close_rig(&rig);
    assert_compare(test_image_psnr(&got, &wanted), >=, 110);
    test_image_finish(&wanted);
    test_image_finish(&got);
}

static void everything_counts(void **state) {
    (void)state;
    struct rig rig;
    must_open(&rig, 0);
    must_draw(&rig, SMALL, NULL);
    uint64_t own = rig.backend->memory(rig.state, rig.volume);
    uint64_t small = rig.backend->memory(rig.state, NULL);
    assert_compare(small, >, own); /* render buffers belong to no volume */
    must_draw(&rig, WIDE, NULL);
    uint64_t pixels = WIDE * WIDE / 2;
    assert_compare(rig.backend->memory(rig.state, NULL), >=, small + pixels * (48 + 16 + 16) / 2);
    assert_int_equal(rig.backend->memory(rig.state, rig.volume), own);
    close_rig(&rig);
}

static void an_insufficient_budget_is_refused_with_both_numbers(void **state) {
    (void)state;
    struct rig rig;
    struct sp_error err;
    must_open(&rig, 8 * MIB);
    must_draw(&rig, SMALL, NULL);
    rig.state->residency.limit_bytes = MIB / 16;
    assert_false(draw(&rig, SMALL, NULL, &err)); /* the voxels alone need more */
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, "take "));
    assert_non_null(strstr(err.text, " 65536 are allowed"));
    rig.state->residency.limit_bytes = 8 * MIB;
    must_draw(&rig, SMALL, NULL);
    close_rig(&rig);
}

/* The render buffers of an earlier frame are released before a view is refused. */
static void scratch_is_released_for_a_view(void **state) {
    (void)state;
    struct rig rig;
    must_open(&rig, 0);
    must_draw(&rig, SMALL, NULL);
    uint64_t small = all_bytes(&rig);
    must_draw(&rig, WIDE, NULL);
    assert_compare(gl_draw_bytes(rig.state), >, small);
    rig.state->residency.limit_bytes = small + rig.state->slots[0].readback.buffer.bytes +
                                       rig.state->slots[1].readback.buffer.bytes;
    must_draw(&rig, SMALL, NULL);
    assert_compare(all_bytes(&rig), <=, rig.state->residency.limit_bytes);
    close_rig(&rig);
}

/* Makes this the volume of the rig. */
static void replace_volume(struct rig *rig, struct sp_volume *volume) {
    assert_non_null(volume);
    rig->backend->evict(rig->state, rig->volume);
    sp_volume_unref(&rig->volume);
    rig->volume = volume;
}

static struct sp_volume *make_cube(uint32_t n, uint32_t every) {
    const struct sp_grid grid = { .dims = { n, n, n },
                                  .spacing = { 1, 1, 1 },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    size_t count = (size_t)n * n * n;
    unsigned char *values = calloc(count, 1);
    struct sp_error err;
    assert_non_null(values);
    for (size_t i = 1; i < count; i += every)
        values[i] = (unsigned char)(200 + i % 2);
    struct sp_volume *volume = sp_volume_create(&grid, SP_UINT8, values, "cube", &err);
    free(values);
    assert_non_null(volume);
    return volume;
}

static void unused_render_buffers_are_released(void **state) {
    (void)state;
    struct rig rig;
    must_open(&rig, 0);
    replace_volume(&rig, make_cube(2, 1)); /* hundreds of frames are drawn */
    must_draw(&rig, SMALL, NULL);
    uint64_t small = gl_draw_bytes(rig.state);
    must_draw(&rig, WIDE, NULL);
    for (int i = 0; i < 100; i++)
        must_draw(&rig, SMALL, NULL);
    assert_compare(gl_draw_bytes(rig.state), >,
                   2 * small); /* the buffers may be needed again soon */
    for (int i = 0; i < GL_IN_FLIGHT; i++)
        rig.state->slots[i].frames |= 255 - 3; /* as after many more frames */
    for (int i = 0; i < 2 * 256 * GL_IN_FLIGHT && gl_draw_bytes(rig.state) > 2 * small; i++)
        must_draw(&rig, SMALL, NULL);
    assert_compare(gl_draw_bytes(rig.state), <=, 2 * small);
    close_rig(&rig);
}

static bool render(struct rig *rig, struct sp_volume *volume, const struct sp_view *view,
                   struct sp_error *err) {
    struct sp_frame *frame =
        sp_frame_create(rig->pool, view->size[0], view->size[1], SP_RGBA8, err);
    const struct sp_backend_job job = { .volume = volume, .view = view, .frame = frame };
    assert_non_null(frame);
    bool ok = rig->backend->render(rig->state, &job, err);
    sp_frame_unref(&frame);
    return ok;
}

static void must_render(struct rig *rig, struct sp_volume *volume, const struct sp_view *view) {
    struct sp_error err;
    if (!render(rig, volume, view, &err))
        fail_msg("%s", err.text);
    assert_compare(all_bytes(rig), <=, rig->state->residency.limit_bytes);
}

/* Records of a view with many planes are large: the pieces shrink until they fit the budget. */
static void many_planes_fit_any_budget(void **state) {
    (void)state;
    static const uint64_t budgets[] = { 3 * MIB, 6 * MIB, 12 * MIB };
    for (size_t i = 0; i < sizeof budgets / sizeof *budgets; i += TEST_SANITIZED ? 3 : 1) {
        struct rig rig;
        must_open(&rig, budgets[i]);
        replace_volume(&rig, sp_volume_load("demo:phantom?size=48", NULL, NULL));
        struct sp_view view;
        sp_view_init(&view, sp_volume_info(rig.volume), "v");
        view.size[0] = view.size[1] = 32;
        view.level_of_detail = SP_LOD_OFF;
        view.clip.plane_count = SP_CLIP_PLANES_MAX;
        for (int k = 0; k < SP_CLIP_PLANES_MAX; k++) {
            view.clip.planes[k].normal[0] = 1;
            view.clip.planes[k].normal[1] = 0.1 * k;
            view.clip.planes[k].normal[2] = 0;
            view.clip.planes[k].offset = -1000;
        }
        for (int k = 0; k < 3; k++) {
            view.clip.box[0][k] = 0.001;
            view.clip.box[1][k] = 0.999;
        }
        must_render(&rig, rig.volume, &view);
        assert_compare(rig.state->partition.batch_count, >, 1); /* in pieces */
        close_rig(&rig);
    }
}

static struct sp_view view_of(const struct sp_volume *volume, uint32_t size) {
    struct sp_view view;
    sp_view_init(&view, sp_volume_info(volume), "v");
    view.size[0] = view.size[1] = size;
    view.level_of_detail = SP_LOD_OFF;
    return view;
}

/* Samples and entries leave little memory, so pieces must be smaller than half of the budget. */
static void pieces_fit_into_what_the_lists_leave(void **state) {
    (void)state;
    struct rig rig;
    must_open(&rig, 3 * MIB);
    replace_volume(&rig, make_cube(64, 1));
    struct sp_volume *other = make_cube(64, 50);
    const struct sp_view view = view_of(rig.volume, 16);
    for (int i = 0; i < ROUNDS; i++) {
        must_render(&rig, other, &view);
        must_render(&rig, rig.volume, &view);
        assert_int_equal(gl_residency_voxels(&rig.state->residency, rig.volume)->refusals, 0);
    }
    rig.backend->evict(rig.state, other);
    sp_volume_unref(&other);
    close_rig(&rig);
}

static struct test_image picture_of(struct rig *rig, struct sp_volume *volume,
                                    const struct sp_view *view) {
    struct sp_frame *frame = sp_frame_create(rig->pool, 16, 16, SP_RGBAF32, NULL);
    const struct sp_backend_job job = { .volume = volume, .view = view, .frame = frame };
    struct test_image image;
    struct sp_error err;
    assert_non_null(frame);
    if (!rig->backend->render(rig->state, &job, &err))
        fail_msg("%s", err.text);
    assert_true(test_image_from_frame(&image, frame));
    assert_compare(all_bytes(rig), <=, rig->state->residency.limit_bytes);
    sp_frame_unref(&frame);
    return image;
}

/* The lists leave a fifth of the budget. Small pieces have many bricks, which are uploaded in
 * passes. */
static void many_bricks_are_uploaded_in_turns(void **state) {
    (void)state;
    if (TEST_SANITIZED)
        skip(); /* many seconds of software GL; pieces_fit_into_what_the_lists_leave runs the same
                   code */
    struct rig large, tight;
    must_open(&large, 1 << 30);
    must_open(&tight, 2 * MIB);
    replace_volume(&tight, make_cube(64, 1));
    const struct sp_view view = view_of(tight.volume, 16);
    struct test_image wanted = picture_of(&large, tight.volume, &view);
    uint64_t before = large.state->upload.bytes;
    struct test_image got = picture_of(&tight, tight.volume, &view);
    assert_compare(test_image_psnr(&got, &wanted), >=, 90);
    test_image_finish(&got);
    const struct gl_upload *upload = &tight.state->upload;
    assert_compare(upload->chunk_end - upload->chunk_first, <, tight.state->partition.chunk_count);
    struct test_image again = picture_of(&large, tight.volume, &view);
    assert_in_range(large.state->upload.bytes - before, 1,
                    2000); /* only constants: the bricks are already there */
    test_image_finish(&again);
    test_image_finish(&wanted);
    large.backend->evict(large.state, tight.volume);
    close_rig(&large);
    close_rig(&tight);
}

static const struct gl_voxels *voxels_of(const struct rig *rig) {
    for (int i = 0; i < GL_VOLUMES; i++)
        if (rig->state->residency.voxels[i].volume == rig->volume)
            return &rig->state->residency.voxels[i];
    fail();
    return NULL;
}

/* The render buffers of an earlier frame are released before a volume falls back to the CPU. */
static void scratch_is_released_for_samples(void **state) {
    (void)state;
    struct rig rig;
    must_open(&rig, 26 * MIB / 10);
    struct sp_volume *other = make_cube(16, 1);
    replace_volume(&rig, make_cube(128, 5000));
    struct sp_view large = view_of(other, 192);
    large.compositing.mode = SP_COMPOSITE_SLAB;
    const struct sp_view small = view_of(rig.volume, 32);
    must_render(&rig, other, &large);
    assert_compare(gl_draw_bytes(rig.state) + ((uint64_t)1 << 21), >,
                   rig.state->residency.limit_bytes);
    must_render(&rig, rig.volume, &small);
    assert_int_equal(voxels_of(&rig)->refusals, 0);
    assert_compare(voxels_of(&rig)->samples.bytes, >, 0);
    rig.backend->evict(rig.state, other);
    sp_volume_unref(&other);
    close_rig(&rig);
}

/* A volume that did not fit is tried again, after a longer wait each time. */
static void a_refused_volume_is_tried_again(void **state) {
    (void)state;
    if (TEST_SANITIZED)
        skip(); /* it draws the same frame many times */
    struct rig rig;
    must_open(&rig, 0);
    replace_volume(&rig, make_cube(128, 5000));
    const struct sp_view view = view_of(rig.volume, 16);
    uint64_t limit = rig.state->residency.limit_bytes;
    rig.state->residency.limit_bytes = 2 * MIB;
    gl_memory_limit(rig.state);
    for (int i = 0; i < 1 + GL_REFUSED_FRAMES; i++)
        must_render(&rig, rig.volume, &view);
    assert_int_equal(voxels_of(&rig)->refusals, 1);
    must_render(&rig, rig.volume, &view);
    assert_int_equal(voxels_of(&rig)->refusals, 2);
    rig.state->residency.limit_bytes = limit;
    for (int i = 0; i < 2 * GL_REFUSED_FRAMES; i++)
        must_render(&rig, rig.volume, &view);
    assert_compare(voxels_of(&rig)->samples.bytes, ==, 0);
    must_render(&rig, rig.volume, &view);
    assert_compare(voxels_of(&rig)->samples.bytes, >, 0);
    close_rig(&rig);
}

int main(void) {
    struct rig rig;
    struct sp_error err;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    if (TEST_SANITIZED)
        printf(
            "reduced under a sanitizer: one budget of three, one round of two, two tests less\n");
    if (!open_rig(&rig, 0, &err)) {
        printf("skipped: no software GL here: %s\n", err.text);
        return TEST_SKIPPED;
    }
    close_rig(&rig);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_small_budget_draws_in_smaller_pieces),
        cmocka_unit_test(everything_counts),
        cmocka_unit_test(an_insufficient_budget_is_refused_with_both_numbers),
        cmocka_unit_test(scratch_is_released_for_a_view),
        cmocka_unit_test(unused_render_buffers_are_released),
        cmocka_unit_test(many_planes_fit_any_budget),
        cmocka_unit_test(pieces_fit_into_what_the_lists_leave),
        cmocka_unit_test(many_bricks_are_uploaded_in_turns),
        cmocka_unit_test(scratch_is_released_for_samples),
        cmocka_unit_test(a_refused_volume_is_tried_again),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
