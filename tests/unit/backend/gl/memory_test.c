/* SPDX-License-Identifier: Apache-2.0
 *
 * The budget of video memory: everything counts in it, pictures are drawn within it, and what was
 * needed once does not stay for ever.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "backend/backend.h"
#include "backend/gl/draw.h"
#include "sp/log.h"
#include "support/data.h"
#include "support/image.h"

enum { MIB = 1 << 20, WIDE = 500, SMALL = 24 };

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
    *rig = (struct rig){ .backend = NULL };
    for (unsigned i = 0; sp_registry_at(i); i++)
        if (strcmp(sp_registry_at(i)->entry.name, "gl-software") == 0)
            rig->backend = sp_registry_at(i);
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
    return gl_lists_bytes(&rig->state->lists, NULL) + gl_draw_bytes(rig->state);
}

static void a_small_budget_draws_in_smaller_pieces(void **state) {
    (void)state;
    struct rig rig;
    struct test_image wanted, got;
    must_open(&rig, 0);
    must_draw(&rig, WIDE, &wanted);
    uint64_t whole = all_bytes(&rig);
    close_rig(&rig);
    assert_true(whole > 8 * MIB);
    must_open(&rig, 8 * MIB);
    must_draw(&rig, WIDE, &got);
    assert_true(all_bytes(&rig) <= 8 * MIB);
    assert_true(rig.state->slots[0].y > 0);
    close_rig(&rig);
    assert_true(test_image_psnr(&got, &wanted) >= 110);
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
    assert_true(small > own); /* pictures belong to no volume */
    must_draw(&rig, WIDE, NULL);
    uint64_t pixels = WIDE * WIDE / 2;
    assert_true(rig.backend->memory(rig.state, NULL) >= small + pixels * (48 + 16 + 16) / 2);
    assert_int_equal(rig.backend->memory(rig.state, rig.volume), own);
    close_rig(&rig);
}

static void a_budget_that_cannot_do_is_told_with_both_numbers(void **state) {
    (void)state;
    struct rig rig;
    struct sp_error err;
    must_open(&rig, 8 * MIB);
    must_draw(&rig, SMALL, NULL);
    rig.state->lists.limit_bytes = MIB;
    assert_false(draw(&rig, SMALL, NULL, &err)); /* the first pairs alone take more */
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, "take "));
    assert_non_null(strstr(err.text, " 1048576 are allowed"));
    rig.state->lists.limit_bytes = 8 * MIB;
    must_draw(&rig, SMALL, NULL);
    close_rig(&rig);
}

/* What an earlier picture was drawn in goes before a view is refused. */
static void scratch_makes_room(void **state) {
    (void)state;
    struct rig rig;
    must_open(&rig, 0);
    must_draw(&rig, SMALL, NULL);
    uint64_t small = all_bytes(&rig);
    must_draw(&rig, WIDE, NULL);
    assert_true(gl_draw_bytes(rig.state) > small);
    rig.state->lists.limit_bytes =
        small + rig.state->slots[0].back.buffer.bytes + rig.state->slots[1].back.buffer.bytes;
    must_draw(&rig, SMALL, NULL);
    assert_true(all_bytes(&rig) <= rig.state->lists.limit_bytes);
    close_rig(&rig);
}

static void what_was_needed_once_goes(void **state) {
    (void)state;
    struct rig rig;
    must_open(&rig, 0);
    must_draw(&rig, SMALL, NULL);
    uint64_t small = gl_draw_bytes(rig.state);
    must_draw(&rig, WIDE, NULL);
    for (int i = 0; i < 100; i++)
        must_draw(&rig, SMALL, NULL);
    assert_true(gl_draw_bytes(rig.state) > 2 * small); /* it may be needed again soon */
    for (int i = 0; i < GL_IN_FLIGHT; i++)
        rig.state->slots[i].frames |= 255 - 3; /* as after many more */
    for (int i = 0; i < 2 * 256 * GL_IN_FLIGHT && gl_draw_bytes(rig.state) > 2 * small; i++)
        must_draw(&rig, SMALL, NULL);
    assert_true(gl_draw_bytes(rig.state) <= 2 * small);
    close_rig(&rig);
}

int main(void) {
    struct rig rig;
    struct sp_error err;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    if (!open_rig(&rig, 0, &err)) {
        printf("skipped: no software GL here: %s\n", err.text);
        return TEST_SKIPPED;
    }
    close_rig(&rig);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_small_budget_draws_in_smaller_pieces),
        cmocka_unit_test(everything_counts),
        cmocka_unit_test(a_budget_that_cannot_do_is_told_with_both_numbers),
        cmocka_unit_test(scratch_makes_room),
        cmocka_unit_test(what_was_needed_once_goes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
