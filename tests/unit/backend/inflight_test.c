/* SPDX-License-Identifier: Apache-2.0
 *
 * Frames in flight: several are begun before the first is finished. Checks what happens to them
 * when the backend fails, runs out of memory, or is replaced.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <string.h>

#include "sp/inflight.h"
#include "unit/backend/fakes.h"

/* Begins a frame. Its width in px identifies it. */
static void begin(struct fakes_scene *s, uint32_t width) {
    const struct sp_render_options options = { .cancel = &s->cancel };
    s->view.size[0] = width;
    if (!sp_renderer_begin(s->renderer, s->volume, &s->view, s->pool, &options, &s->err))
        fail_msg("%s", s->err.text);
    s->view.size[0] = 1; /* the renderer keeps a copy of the view */
}

/* Finishes the oldest frame, which must have this width. Returns the name of its backend; "" with
 * s->err set on failure. */
static const char *finish(struct fakes_scene *s, uint32_t width) {
    struct sp_frame *frame = sp_renderer_finish(s->renderer, &s->err);
    if (frame)
        assert_int_equal(frame->width, width);
    return fakes_drawn_by(frame);
}

static void frames_are_finished_as_they_were_begun(void **state) {
    (void)state;
    struct fakes_scene s;
    fakes_scene_init(&s, NULL);
    assert_int_equal(sp_renderer_depth(s.renderer), 2);
    begin(&s, 16);
    for (uint32_t i = 1; i < 5; i++) {
        begin(&s, 16 + i);
        assert_int_equal(fakes[GPU].begun_count, 2);
        assert_string_equal(finish(&s, 15 + i), "gpu");
    }
    assert_string_equal(finish(&s, 20), "gpu");
    assert_int_equal(fakes[GPU].renders, 5);
    assert_string_equal(fakes_warnings, "");
    fakes_scene_finish(&s);
}

/* A backend refuses if it draws one frame at a time, or has too many in flight. */
static void frames_that_the_backend_refuses_wait(void **state) {
    (void)state;
    static const char *const names[] = { "plain", "gpu" };
    for (int n = 0; n < 2; n++) {
        struct fakes_scene s;
        fakes_scene_init(&s, &(struct sp_renderer_options){ .backend = names[n] });
        assert_int_equal(sp_renderer_depth(s.renderer), n + 1);
        for (uint32_t i = 0; i < SP_IN_FLIGHT_MAX; i++)
            begin(&s, 16 + i);
        assert_int_equal(fakes[PLAIN].renders, 0);
        for (uint32_t i = 0; i < SP_IN_FLIGHT_MAX; i++)
            assert_string_equal(finish(&s, 16 + i), names[n]);
        fakes_scene_finish(&s);
        fakes_reset(NULL);
    }
}

static void a_view_that_is_refused_is_not_begun(void **state) {
    (void)state;
    struct fakes_scene s;
    fakes_scene_init(&s, &(struct sp_renderer_options){ .backend = "plain" });
    begin(&s, 16);
    s.view.clip.plane_count = 1;
    s.view.clip.planes[0].normal[0] = 1;
    assert_false(sp_renderer_begin(s.renderer, s.volume, &s.view, s.pool, NULL, &s.err));
    assert_int_equal(s.err.code, SP_ERR_UNSUPPORTED);
    s.view.clip.plane_count = 0;
    begin(&s, 17);
    assert_string_equal(finish(&s, 16), "plain");
    assert_string_equal(finish(&s, 17), "plain");
    fakes_scene_finish(&s);
}

static void a_failure_loses_no_other_frame(void **state) {
    (void)state;
    enum { FIRST, SECOND, NONE }; /* the frame that is refused at begin */
    for (unsigned refused = FIRST; refused <= NONE; refused++)
        for (unsigned failed = 0; failed < 2; failed++) {
            struct fakes_scene s;
            fakes_scene_init(&s, NULL);
            fakes[GPU].refusals = refused == FIRST;
            begin(&s, 16);
            fakes[GPU].refusals = refused == SECOND;
            begin(&s, 17);
            begin(&s, 18); /* no frame begins after a frame that waits */
            assert_int_equal(fakes[GPU].begun_count, refused == NONE ? 2 : 0);
            fakes[GPU].failures = failed;
            for (uint32_t i = 0; i < 3; i++)
                assert_string_equal(finish(&s, 16 + i), "gpu");
            assert_int_equal(fakes_count_warnings(), (refused != NONE) + failed);
            begin(&s, 19); /* continue with two in flight */
            begin(&s, 20);
            assert_int_equal(fakes[GPU].begun_count, 2);
            assert_string_equal(finish(&s, 19), "gpu");
            assert_string_equal(finish(&s, 20), "gpu");
            assert_int_equal(fakes[PLAIN].running, 0);
            fakes_scene_finish(&s);
            fakes_reset(NULL);
        }
}

static void the_fallback_draws_all_begun_frames(void **state) {
    (void)state;
    struct fakes_scene s;
    fakes_scene_init(&s, NULL);
    begin(&s, 16);
    begin(&s, 17);
    fakes[GPU].failures = 3;
    assert_string_equal(finish(&s, 16), "plain");
    assert_int_equal(fakes[GPU].running, 0);
    assert_int_equal(sp_renderer_depth(s.renderer), 1);
    assert_string_equal(finish(&s, 17), "plain");
    assert_int_equal(fakes[GPU].renders, 3);
    fakes_scene_finish(&s);
}

/* Memory runs out at begin, or later while the frame is drawn. */
static void out_of_memory_falls_back_for_that_frame(void **state) {
    (void)state;
    struct fakes_scene s;
    struct sp_renderer_info info;
    fakes_scene_init(&s, NULL);
    static const enum sp_code codes[3] = { SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_UNSUPPORTED };
    unsigned before = fakes[PLAIN].renders;
    for (int n = 0; n < 6; n++) {
        fakes[GPU].code = codes[n % 3];
        fakes[GPU].refusals = n / 3;
        begin(&s, 16);
        begin(&s, 17);
        fakes[GPU].failures = 1 - n / 3;
        assert_string_equal(finish(&s, 16), "plain");
        assert_string_equal(finish(&s, 17), "gpu"); /* the renderer still has its backend */
    }
    assert_int_equal(fakes[PLAIN].renders, before + 6);
    assert_string_equal(fakes_warnings, "backend gpu cannot draw some views, which plain "
                                        "draws: gpu hung\n"); /* once */
    sp_renderer_info(s.renderer, &info);
    assert_string_equal(info.backend, "gpu");
    assert_string_equal(info.fallback_reason,
                        "backend gpu cannot draw some views, which plain draws: gpu hung");
    assert_int_equal(sp_renderer_memory(s.renderer, s.volume), 1010);
    fakes[GPU].evictions = fakes[PLAIN].evictions = 0;
    sp_renderer_evict(s.renderer, s.volume);
    assert_int_equal(fakes[GPU].evictions + fakes[PLAIN].evictions, 2);
    fakes[GPU].code = SP_ERR_BACKEND; /* the fallback is already running when it takes over */
    fakes[GPU].failures = 3;
    assert_string_equal(fakes_draw(&s), "plain");
    assert_int_equal(fakes[PLAIN].running, 1);
    assert_int_equal(fakes[GPU].running, 0);
    fakes_scene_finish(&s);
}

static void without_a_fallback_the_error_is_reported(void **state) {
    (void)state;
    static const struct sp_renderer_options options[] = { { .backend = "gpu" },
                                                          { .require_gpu = true } };
    struct fakes_scene s;
    for (int i = 0; i < 2; i++) {
        fakes_scene_init(&s, &options[i]);
        fakes[GPU].code = SP_ERR_BUDGET;
        fakes[GPU].failures = 1;
        assert_string_equal(fakes_draw(&s), "");
        assert_int_equal(s.err.code, SP_ERR_BUDGET);
        assert_string_equal(s.err.text, "gpu hung");
        assert_int_equal(fakes[PLAIN].running, 0);
        fakes_scene_finish(&s);
        fakes_reset(NULL);
    }
    fakes_scene_init(&s, NULL);
    fakes[PLAIN].starts = false;
    fakes[GPU].code = SP_ERR_MEMORY;
    fakes[GPU].failures = 2;
    for (int i = 0; i < 2; i++) {
        assert_string_equal(fakes_draw(&s), "");
        assert_string_equal(s.err.text, "gpu hung");
    }
    assert_int_equal(fakes_count_warnings(), 1); /* one line: the fallback does not start */
    fakes_scene_finish(&s);
}

static void the_fallback_may_refuse_or_fail(void **state) {
    (void)state;
    struct fakes_scene s;
    fakes_scene_init(&s, NULL);
    fakes[GPU].code = SP_ERR_BUDGET;
    fakes[GPU].failures = 2;
    s.view.clip.plane_count = 1;
    s.view.clip.planes[0].normal[0] = 1;
    assert_string_equal(fakes_draw(&s), "");
    assert_string_equal(s.err.text, "gpu hung");
    s.view.clip.plane_count = 0;
    fakes[PLAIN].code = SP_ERR_MEMORY;
    fakes[PLAIN].failures = 1;
    assert_string_equal(fakes_draw(&s), "");
    assert_string_equal(s.err.text, "plain hung");
    assert_string_equal(fakes_draw(&s), "gpu");
    assert_string_equal(fakes_warnings, ""); /* no other backend drew the frame */
    fakes_scene_finish(&s);
}

static void cancelled_frames_are_not_retried(void **state) {
    (void)state;
    struct fakes_scene s;
    fakes_scene_init(&s, NULL);
    begin(&s, 16);
    begin(&s, 17);
    atomic_store(&s.cancel, true);
    assert_string_equal(finish(&s, 16), "");
    assert_int_equal(s.err.code, SP_ERR_CANCELLED);
    atomic_store(&s.cancel, false);
    assert_string_equal(finish(&s, 17), "gpu");
    begin(&s, 18);
    fakes[GPU].failures = 1;
    fakes[GPU].cancels = &s.cancel;
    assert_string_equal(finish(&s, 18), "");
    assert_int_equal(fakes[GPU].renders, 3);
    fakes_scene_finish(&s);
}

static void unfinished_frames_are_released(void **state) {
    (void)state;
    struct fakes_scene s;
    fakes_scene_init(&s, NULL);
    begin(&s, 16);
    begin(&s, 17);
    fakes_scene_finish(&s); /* the leak checker finds frames that are not released */
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, fakes_reset, fakes_check_all_ended)

int main(void) {
    const struct CMUnitTest tests[] = {
        TEST(frames_are_finished_as_they_were_begun),
        TEST(frames_that_the_backend_refuses_wait),
        TEST(a_view_that_is_refused_is_not_begun),
        TEST(a_failure_loses_no_other_frame),
        TEST(the_fallback_draws_all_begun_frames),
        TEST(out_of_memory_falls_back_for_that_frame),
        TEST(without_a_fallback_the_error_is_reported),
        TEST(the_fallback_may_refuse_or_fail),
        TEST(cancelled_frames_are_not_retried),
        TEST(unfinished_frames_are_released),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
