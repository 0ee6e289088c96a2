/* SPDX-License-Identifier: Apache-2.0
 *
 * Which backend a renderer starts with, and when it changes to another.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "unit/backend/fakes.h"

static const char *started(const struct sp_renderer_options *options) {
    struct sp_renderer *renderer = sp_renderer_create(options, NULL);
    struct sp_renderer_info info = { .backend = "none" };
    if (renderer) {
        sp_renderer_info(renderer, &info);
        assert_string_equal(info.failover_reason, "");
    }
    sp_renderer_destroy(&renderer);
    return info.backend;
}

static void refuses(const struct sp_renderer_options *options, enum sp_code code,
                    const char *words) {
    struct sp_error err;
    assert_null(sp_renderer_create(options, &err));
    assert_int_equal(err.code, code);
    if (!strstr(err.text, words))
        fail_msg("\"%s\" has no \"%s\"", err.text, words);
}

static void auto_takes_the_first_that_starts(void **state) {
    (void)state;
    assert_string_equal(started(NULL), "gpu");
    assert_string_equal(fakes_warnings, "");
    fakes[GPU].starts = false;
    assert_string_equal(started(NULL), "plain");
    assert_string_equal(fakes_warnings, "backend gpu does not start: gpu is broken\n");
    fakes[PLAIN].starts = false; /* backends that must be named are not tried */
    refuses(NULL, SP_ERR_BACKEND, "plain is broken");
    assert_int_equal(fakes_count_warnings(), 3);
    assert_string_equal(started(&(struct sp_renderer_options){ .backend = "last" }), "last");
}

static void a_named_backend_has_no_fallback(void **state) {
    (void)state;
    fakes[GPU].starts = false;
    refuses(&(struct sp_renderer_options){ .backend = "gpu" }, SP_ERR_BACKEND, "gpu is broken");
    refuses(&(struct sp_renderer_options){ .backend = "abacus" }, SP_ERR_INVALID,
            "available: auto, gpu, plain, last");
}

static void a_gpu_that_draws_wrong_images_does_not_start(void **state) {
    (void)state;
    fakes[GPU].paint = 1;
    fakes[GPU].painted = 64; /* rounding */
    assert_string_equal(started(NULL), "gpu");
    assert_string_equal(fakes_warnings, "");
    fakes[GPU].painted = 16384; /* 48.1 dB */
    assert_string_equal(started(NULL), "plain");
    assert_int_equal(fakes_count_warnings(), 1);
    assert_non_null(strstr(fakes_warnings,
                           "backend gpu does not start: it draws wrong images: 48.1 dB "
                           "from backend plain"));
    refuses(&(struct sp_renderer_options){ .backend = "gpu" }, SP_ERR_BACKEND, "wrong images");
    fakes[GPU].painted = 0;
    fakes[GPU].failures = 1;
    refuses(&(struct sp_renderer_options){ .require_gpu = true }, SP_ERR_BACKEND, "gpu hung");
    /* Only GPU backends are compared with the CPU. */
    fakes[LAST].paint = 200;
    fakes[LAST].painted = 16384;
    assert_string_equal(started(&(struct sp_renderer_options){ .backend = "last" }), "last");
    assert_int_equal(fakes[LAST].renders, 0);
}

static void note_refusal(void *user, const char *backend, const struct sp_error *why) {
    char *refusals = user;
    size_t used = strlen(refusals);
    snprintf(refusals + used, 256 - used, "%s: %s; ", backend, why->text);
}

static void refused_backends_are_reported_to_the_caller(void **state) {
    (void)state;
    char refusals[256] = "";
    struct sp_renderer_options options = { .refused = note_refusal, .user = refusals };
    assert_string_equal(started(&options), "gpu");
    assert_string_equal(refusals, "");
    fakes[GPU].starts = false;
    assert_string_equal(started(&options), "plain");
    assert_string_equal(refusals, "gpu: gpu is broken; ");
}

static void the_gpu_is_chosen_by_its_number(void **state) {
    (void)state;
    started(NULL);
    assert_int_equal(fakes[GPU].options.gpu, -1);
    started(&(struct sp_renderer_options){ .gpu = "auto" });
    assert_int_equal(fakes[GPU].options.gpu, -1);
    started(&(struct sp_renderer_options){ .gpu = "3" });
    assert_int_equal(fakes[GPU].options.gpu, 3);
    static const char *const wrong[] = { "",   "-1", "+1", " 1", "1x", "64", "99999999999999999999",
                                         "0x1" };
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++)
        refuses(&(struct sp_renderer_options){ .gpu = wrong[i] }, SP_ERR_INVALID, "[0, 63]");
}

static void a_gpu_can_be_required(void **state) {
    (void)state;
    struct sp_renderer_options options = { .require_gpu = true };
    assert_string_equal(started(&options), "gpu");
    options.backend = "gpu";
    assert_string_equal(started(&options), "gpu");
    options.backend = "plain";
    refuses(&options, SP_ERR_INVALID, "backend plain does not use one");
    options.backend = NULL;
    fakes[GPU].starts = false;
    refuses(&options, SP_ERR_BACKEND, "gpu is broken");
}

static void the_next_backend_takes_over_after_three_failures(void **state) {
    (void)state;
    struct fakes_scene s;
    struct sp_renderer_info info;
    fakes_scene_init(&s, NULL);
    fakes[GPU].failures = 3;
    assert_string_equal(fakes_draw(&s),
                        "plain"); /* the frame that failed is drawn by the fallback */
    assert_int_equal(fakes[GPU].renders, 3);
    assert_int_equal(fakes[GPU].running, 0); /* the failed backend was destroyed */
    assert_int_equal(fakes_count_warnings(), 4);
    assert_non_null(strstr(fakes_warnings, "backend gpu failed: gpu hung\n"));
    assert_non_null(
        strstr(fakes_warnings, "gpu failed 3 times in a row: gpu hung; backend plain has"));
    sp_renderer_info(s.renderer, &info);
    assert_string_equal(info.backend, "plain");
    assert_string_equal(info.device, "device of plain");
    assert_string_equal(info.failover_reason, "backend gpu failed 3 times in a row: gpu hung");
    assert_int_equal(sp_renderer_memory(s.renderer, s.volume), 10);
    sp_renderer_evict(s.renderer, s.volume);
    assert_int_equal(fakes[PLAIN].evictions, 1);
    assert_string_equal(fakes_draw(&s), "plain"); /* the change is permanent */
    assert_int_equal(fakes[GPU].renders, 3);
    /* It is the last one: a backend that must be named is not a fallback. */
    fakes[PLAIN].failures = 100;
    assert_string_equal(fakes_draw(&s), "");
    assert_int_equal(s.err.code, SP_ERR_BACKEND);
    assert_string_equal(s.err.text, "plain hung");
    fakes[PLAIN].failures = 0;
    assert_string_equal(fakes_draw(&s), "plain");
    fakes_scene_finish(&s);
}

static void two_failures_lose_no_frame(void **state) {
    (void)state;
    struct fakes_scene s;
    fakes_scene_init(&s, NULL);
    for (int i = 0; i < 4; i++) { /* a frame that succeeds resets the count */
        fakes[GPU].failures = 2;
        assert_string_equal(fakes_draw(&s), "gpu");
    }
    assert_int_equal(fakes[GPU].renders, 12);
    assert_int_equal(fakes[PLAIN].running, 0);
    fakes_scene_finish(&s);
}

static void failures_add_up_over_frames(void **state) {
    (void)state;
    struct fakes_scene s;
    fakes_scene_init(&s, NULL);
    fakes[GPU].failures = 100;
    fakes[GPU].cancels = &s.cancel; /* each frame fails once and is not retried */
    for (int i = 0; i < 2; i++) {
        assert_string_equal(fakes_draw(&s), "");
        assert_int_equal(fakes[GPU].renders, i + 1);
        atomic_store(&s.cancel, false);
    }
    fakes[GPU].cancels = NULL;
    assert_string_equal(fakes_draw(&s), "plain");
    assert_int_equal(fakes[GPU].renders, 3);
    fakes_scene_finish(&s);
}

static void only_backend_failures_count(void **state) {
    (void)state;
    static const enum sp_code codes[] = { SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED };
    struct fakes_scene s;
    fakes_scene_init(&s, &(struct sp_renderer_options){ .backend = "gpu" });
    unsigned before = fakes[GPU].renders;
    for (size_t i = 0; i < sizeof codes / sizeof codes[0]; i++) {
        fakes[GPU].code = codes[i];
        fakes[GPU].failures = 4;
        for (int k = 0; k < 4; k++) {
            assert_string_equal(fakes_draw(&s), "");
            assert_int_equal(s.err.code, codes[i]);
        }
    }
    assert_int_equal(fakes[GPU].renders, before + 12); /* one failure per call */
    assert_string_equal(fakes_warnings, "");
    assert_string_equal(fakes_draw(&s), "gpu");
    fakes_scene_finish(&s);
}

static void a_named_backend_or_required_gpu_is_not_replaced(void **state) {
    (void)state;
    static const struct sp_renderer_options options[] = { { .backend = "gpu" },
                                                          { .require_gpu = true } };
    for (int i = 0; i < 2; i++) {
        struct fakes_scene s;
        fakes_scene_init(&s, &options[i]);
        fakes[GPU].failures = 5;
        assert_string_equal(fakes_draw(&s), ""); /* the first frame is tried three times */
        assert_string_equal(s.err.text, "gpu hung");
        assert_string_equal(fakes_draw(&s), ""); /* later frames are tried once */
        assert_string_equal(fakes_draw(&s), "");
        assert_string_equal(fakes_draw(&s), "gpu");
        assert_int_equal(fakes[PLAIN].running, 0);
        fakes_scene_finish(&s);
    }
}

static void a_backend_without_fallback_stays(void **state) {
    (void)state;
    struct fakes_scene s;
    fakes_scene_init(&s, NULL);
    fakes[GPU].failures = 3;
    fakes[PLAIN].starts = false;
    assert_string_equal(fakes_draw(&s), "");
    assert_string_equal(s.err.text, "gpu hung");
    assert_non_null(strstr(fakes_warnings, "backend plain does not start: plain is broken\n"));
    assert_string_equal(fakes_draw(&s), "gpu");
    fakes_scene_finish(&s);
}

static void the_fallback_backend_must_support_the_view(void **state) {
    (void)state;
    struct fakes_scene s;
    fakes_scene_init(&s, NULL);
    s.view.clip.plane_count = 1;
    s.view.clip.planes[0].normal[0] = 1;
    assert_string_equal(fakes_draw(&s), "gpu");
    assert_true(sp_renderer_supports(s.renderer, &s.view, NULL));
    fakes[GPU].failures = 3;
    assert_string_equal(fakes_draw(&s), "");
    assert_int_equal(s.err.code, SP_ERR_UNSUPPORTED);
    assert_string_equal(s.err.place, "/clip/planes");
    assert_int_equal(fakes[PLAIN].renders, 0);
    assert_false(sp_renderer_supports(s.renderer, &s.view, NULL));
    s.view.clip.plane_count = 0;
    assert_string_equal(fakes_draw(&s), "plain");
    fakes_scene_finish(&s);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, fakes_reset, fakes_check_all_ended)

int main(void) {
    const struct CMUnitTest tests[] = {
        TEST(auto_takes_the_first_that_starts),
        TEST(a_named_backend_has_no_fallback),
        TEST(a_gpu_that_draws_wrong_images_does_not_start),
        TEST(refused_backends_are_reported_to_the_caller),
        TEST(the_gpu_is_chosen_by_its_number),
        TEST(a_gpu_can_be_required),
        TEST(the_next_backend_takes_over_after_three_failures),
        TEST(two_failures_lose_no_frame),
        TEST(failures_add_up_over_frames),
        TEST(only_backend_failures_count),
        TEST(a_named_backend_or_required_gpu_is_not_replaced),
        TEST(the_fallback_backend_must_support_the_view),
        TEST(a_backend_without_fallback_stays),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
