/* SPDX-License-Identifier: Apache-2.0
 *
 * Which backend a renderer gets and when it goes over to another, with backends that fail on
 * command: the linker puts the table below in the place of the registry's (--wrap).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "backend/backend.h"
#include "sp/log.h"
#include "sp/renderer.h"

/* What the fakes are to do, and what happened to them. */
struct fake {
    const char *name;
    bool starts;
    unsigned failures;    /* renders that fail from now on, before one works */
    enum sp_code code;    /* with which they fail */
    atomic_bool *cancels; /* set by each failure */
    uint8_t paint;        /* a byte … */
    size_t painted;       /* … in so many places of its pictures, beside which all is 0 */
    int running;          /* states created and not destroyed */
    unsigned renders, forgotten;
    struct sp_backend_options options; /* of the last start */
};
enum { GPU, PLAIN, LAST, FAKES };
static struct fake fakes[FAKES];

static void *fake_create(struct fake *fake, const struct sp_backend_options *options,
                         struct sp_error *err) {
    fake->options = *options;
    if (!fake->starts) {
        sp_fail(err, SP_ERR_BACKEND, "", "%s is broken", fake->name);
        return NULL;
    }
    fake->running++;
    return fake;
}
static void *gpu_create(const struct sp_backend_options *options, struct sp_error *err) {
    return fake_create(&fakes[GPU], options, err);
}
static void *plain_create(const struct sp_backend_options *options, struct sp_error *err) {
    return fake_create(&fakes[PLAIN], options, err);
}
static void *last_create(const struct sp_backend_options *options, struct sp_error *err) {
    return fake_create(&fakes[LAST], options, err);
}

static void fake_destroy(void *state) {
    ((struct fake *)state)->running--;
}

static void fake_info(const void *state, struct sp_renderer_info *info) {
    const struct fake *fake = state;
    *info = (struct sp_renderer_info){ .backend = fake->name, .isa = "", .threads = 1 };
    snprintf(info->device, sizeof info->device, "device of %s", fake->name);
}

static bool fake_render(void *state, const struct sp_backend_job *job, struct sp_error *err) {
    struct fake *fake = state;
    fake->renders++;
    memset(job->frame->pixels, 0, job->frame->stride_bytes * job->frame->height);
    memset(job->frame->pixels, fake->paint, fake->painted);
    if (fake->failures == 0)
        return true;
    fake->failures--;
    if (fake->cancels)
        atomic_store(fake->cancels, true);
    return sp_fail(err, fake->code, "", "%s hung", fake->name);
}

static void fake_forget(void *state, const struct sp_volume *volume) {
    (void)volume;
    ((struct fake *)state)->forgotten++;
}

static uint64_t fake_memory(const void *state, const struct sp_volume *volume) {
    (void)volume;
    return ((const struct fake *)state)->name[0] == 'g' ? 1000 : 10;
}

#define ALL_BUT_PLANES                                                                             \
    SP_CAN_ALL, SP_CAN_ALL, SP_CAN_ALL, SP_CAN_ALL, SP_CAN_ALL, SP_CAN_ALL, SP_CAN_ALL,            \
        SP_CAN_ALL, SP_CAN_ALL, true, true
#define FAKE(fake)                                                                                 \
    .create = fake##_create, .destroy = fake_destroy, .info = fake_info, .render = fake_render,    \
    .forget = fake_forget, .memory = fake_memory

static const struct sp_backend gpu_backend = {
    .entry = { "gpu", "a GPU" }, .is_gpu = true, .capabilities = { ALL_BUT_PLANES, true }, FAKE(gpu)
};
static const struct sp_backend plain_backend = { .entry = { "plain", "no GPU" },
                                                 .capabilities = { ALL_BUT_PLANES, false },
                                                 FAKE(plain) };
static const struct sp_backend last_backend = { .entry = { "last", "by name" },
                                                .by_name_only = true,
                                                .capabilities = { ALL_BUT_PLANES, true },
                                                FAKE(last) };

const struct sp_backend *__wrap_sp_registry_at(unsigned i);
const struct sp_backend *__wrap_sp_registry_at(unsigned i) {
    static const struct sp_backend *const table[FAKES] = { &gpu_backend, &plain_backend,
                                                           &last_backend };
    return i < FAKES ? table[i] : NULL;
}

/* Warnings, one after the other. */
static char warnings[4096];

static void keep_warning(void *user, enum sp_log_level level, const char *line) {
    (void)user;
    size_t used = strlen(warnings);
    if (level == SP_LOG_WARN)
        snprintf(warnings + used, sizeof warnings - used, "%s\n", line);
}

static unsigned count_lines(void) {
    unsigned n = 0;
    for (const char *c = warnings; *c; c++)
        n += *c == '\n';
    return n;
}

static int reset(void **state) {
    (void)state;
    static const char *const names[FAKES] = { "gpu", "plain", "last" };
    for (int i = 0; i < FAKES; i++)
        fakes[i] = (struct fake){ .name = names[i], .starts = true, .code = SP_ERR_BACKEND };
    warnings[0] = 0;
    sp_log_init(keep_warning, NULL, SP_LOG_INFO);
    return 0;
}

static int check_all_ended(void **state) {
    (void)state;
    for (int i = 0; i < FAKES; i++)
        assert_int_equal(fakes[i].running, 0);
    return 0;
}

static const char *started(const struct sp_renderer_options *options) {
    struct sp_renderer *renderer = sp_renderer_create(options, NULL);
    struct sp_renderer_info info = { .backend = "none" };
    if (renderer) {
        sp_renderer_info(renderer, &info);
        assert_string_equal(info.given_up, "");
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
    assert_string_equal(warnings, "");
    fakes[GPU].starts = false;
    assert_string_equal(started(NULL), "plain");
    assert_string_equal(warnings, "backend gpu does not start: gpu is broken\n");
    fakes[PLAIN].starts = false; /* what is for names alone stays untouched */
    refuses(NULL, SP_ERR_BACKEND, "plain is broken");
    assert_int_equal(count_lines(), 3);
    assert_string_equal(started(&(struct sp_renderer_options){ .backend = "last" }), "last");
}

static void a_name_gets_that_or_nothing(void **state) {
    (void)state;
    fakes[GPU].starts = false;
    refuses(&(struct sp_renderer_options){ .backend = "gpu" }, SP_ERR_BACKEND, "gpu is broken");
    refuses(&(struct sp_renderer_options){ .backend = "abacus" }, SP_ERR_INVALID,
            "there are auto, gpu, plain, last");
}

static void a_gpu_that_draws_wrong_pictures_does_not_start(void **state) {
    (void)state;
    fakes[GPU].paint = 1;
    fakes[GPU].painted = 64; /* rounding */
    assert_string_equal(started(NULL), "gpu");
    assert_string_equal(warnings, "");
    fakes[GPU].painted = 16384; /* 48.1 dB */
    assert_string_equal(started(NULL), "plain");
    assert_int_equal(count_lines(), 1);
    assert_non_null(strstr(warnings, "backend gpu does not start: it draws wrong pictures: 48.1 dB "
                                     "from those of backend plain"));
    refuses(&(struct sp_renderer_options){ .backend = "gpu" }, SP_ERR_BACKEND, "wrong pictures");
    fakes[GPU].painted = 0;
    fakes[GPU].failures = 1;
    refuses(&(struct sp_renderer_options){ .require_gpu = true }, SP_ERR_BACKEND, "gpu hung");
    /* What needs no GPU is compared with nothing. */
    fakes[LAST].paint = 200;
    fakes[LAST].painted = 16384;
    assert_string_equal(started(&(struct sp_renderer_options){ .backend = "last" }), "last");
    assert_int_equal(fakes[LAST].renders, 0);
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
    refuses(&options, SP_ERR_INVALID, "plain does without a GPU");
    options.backend = NULL;
    fakes[GPU].starts = false;
    refuses(&options, SP_ERR_BACKEND, "gpu is broken");
}

struct scene {
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
    struct sp_volume *volume;
    struct sp_view view;
    struct sp_error err;
    atomic_bool cancel;
};

static void init_scene(struct scene *s, const struct sp_renderer_options *options) {
    *s = (struct scene){ .renderer = sp_renderer_create(options, NULL),
                         .pool = sp_frame_pool_create(0, NULL),
                         .volume = sp_volume_load("demo:phantom?size=16", NULL, NULL) };
    assert_true(s->renderer && s->pool && s->volume);
    sp_view_init(&s->view, sp_volume_info(s->volume), "phantom");
    s->view.size[0] = s->view.size[1] = 16;
    for (int i = 0; i < FAKES; i++) /* the check at the start draws, too */
        fakes[i].renders = 0;
}

static void finish_scene(struct scene *s) {
    sp_renderer_destroy(&s->renderer);
    sp_frame_pool_destroy(&s->pool);
    sp_volume_unref(&s->volume);
}

/* The backend that drew the frame, "" with s->err set when none did. */
static const char *draw(struct scene *s) {
    const struct sp_render_options options = { .cancel = &s->cancel };
    struct sp_frame *frame =
        sp_renderer_render(s->renderer, s->volume, &s->view, s->pool, &options, &s->err);
    if (!frame)
        return "";
    const char *backend = frame->stats.backend;
    char device[SP_DEVICE_NAME];
    snprintf(device, sizeof device, "device of %s", backend);
    assert_string_equal(frame->stats.device, device);
    sp_frame_unref(&frame);
    return backend;
}

static void the_next_backend_takes_over_after_three_failures(void **state) {
    (void)state;
    struct scene s;
    struct sp_renderer_info info;
    init_scene(&s, NULL);
    fakes[GPU].failures = 3;
    assert_string_equal(draw(&s), "plain"); /* this very frame */
    assert_int_equal(fakes[GPU].renders, 3);
    assert_int_equal(fakes[GPU].running, 0); /* it is gone, with all it held */
    assert_int_equal(count_lines(), 4);
    assert_non_null(strstr(warnings, "backend gpu fails: gpu hung\n"));
    assert_non_null(strstr(warnings, "gpu failed 3 times in a row: gpu hung; backend plain has"));
    sp_renderer_info(s.renderer, &info);
    assert_string_equal(info.backend, "plain");
    assert_string_equal(info.device, "device of plain");
    assert_string_equal(info.given_up, "backend gpu failed 3 times in a row: gpu hung");
    assert_int_equal(sp_renderer_memory(s.renderer, s.volume), 10);
    sp_renderer_forget(s.renderer, s.volume);
    assert_int_equal(fakes[PLAIN].forgotten, 1);
    assert_string_equal(draw(&s), "plain"); /* for good */
    assert_int_equal(fakes[GPU].renders, 3);
    /* Nothing comes after it: what is by name alone does not step in. */
    fakes[PLAIN].failures = 100;
    assert_string_equal(draw(&s), "");
    assert_int_equal(s.err.code, SP_ERR_BACKEND);
    assert_string_equal(s.err.text, "plain hung");
    fakes[PLAIN].failures = 0;
    assert_string_equal(draw(&s), "plain");
    finish_scene(&s);
}

static void two_failures_lose_no_frame(void **state) {
    (void)state;
    struct scene s;
    init_scene(&s, NULL);
    for (int i = 0; i < 4; i++) { /* a frame that works sets the count back */
        fakes[GPU].failures = 2;
        assert_string_equal(draw(&s), "gpu");
    }
    assert_int_equal(fakes[GPU].renders, 12);
    assert_int_equal(fakes[PLAIN].running, 0);
    finish_scene(&s);
}

static void failures_add_up_over_frames(void **state) {
    (void)state;
    struct scene s;
    init_scene(&s, NULL);
    fakes[GPU].failures = 100;
    fakes[GPU].cancels = &s.cancel; /* each frame is given up after its first failure */
    for (int i = 0; i < 2; i++) {
        assert_string_equal(draw(&s), "");
        assert_int_equal(fakes[GPU].renders, i + 1);
        atomic_store(&s.cancel, false);
    }
    fakes[GPU].cancels = NULL;
    assert_string_equal(draw(&s), "plain");
    assert_int_equal(fakes[GPU].renders, 3);
    finish_scene(&s);
}

static void what_is_not_the_backends_fault_does_not_count(void **state) {
    (void)state;
    static const enum sp_code codes[] = { SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED };
    struct scene s;
    init_scene(&s, NULL);
    for (size_t i = 0; i < sizeof codes / sizeof codes[0]; i++) {
        fakes[GPU].code = codes[i];
        fakes[GPU].failures = 4;
        for (int k = 0; k < 4; k++) {
            assert_string_equal(draw(&s), "");
            assert_int_equal(s.err.code, codes[i]);
        }
    }
    assert_int_equal(fakes[GPU].renders, 12); /* once a call */
    assert_string_equal(warnings, "");
    assert_string_equal(draw(&s), "gpu");
    finish_scene(&s);
}

static void who_names_a_backend_or_requires_a_gpu_keeps_it(void **state) {
    (void)state;
    static const struct sp_renderer_options options[] = { { .backend = "gpu" },
                                                          { .require_gpu = true } };
    for (int i = 0; i < 2; i++) {
        struct scene s;
        init_scene(&s, &options[i]);
        fakes[GPU].failures = 5;
        assert_string_equal(draw(&s), ""); /* three times */
        assert_string_equal(s.err.text, "gpu hung");
        assert_string_equal(draw(&s), ""); /* and once a frame from then on */
        assert_string_equal(draw(&s), "");
        assert_string_equal(draw(&s), "gpu");
        assert_int_equal(fakes[PLAIN].running, 0);
        finish_scene(&s);
    }
}

static void where_nothing_can_take_over_the_backend_stays(void **state) {
    (void)state;
    struct scene s;
    init_scene(&s, NULL);
    fakes[GPU].failures = 3;
    fakes[PLAIN].starts = false;
    assert_string_equal(draw(&s), "");
    assert_string_equal(s.err.text, "gpu hung");
    assert_non_null(strstr(warnings, "backend plain does not start: plain is broken\n"));
    assert_string_equal(draw(&s), "gpu");
    finish_scene(&s);
}

static void who_takes_over_is_asked_whether_it_can(void **state) {
    (void)state;
    struct scene s;
    init_scene(&s, NULL);
    s.view.clip.plane_count = 1;
    s.view.clip.planes[0].normal[0] = 1;
    assert_string_equal(draw(&s), "gpu");
    assert_true(sp_renderer_supports(s.renderer, &s.view, NULL));
    fakes[GPU].failures = 3;
    assert_string_equal(draw(&s), "");
    assert_int_equal(s.err.code, SP_ERR_UNSUPPORTED);
    assert_string_equal(s.err.place, "/clip/planes");
    assert_int_equal(fakes[PLAIN].renders, 0);
    assert_false(sp_renderer_supports(s.renderer, &s.view, NULL));
    s.view.clip.plane_count = 0;
    assert_string_equal(draw(&s), "plain");
    finish_scene(&s);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, reset, check_all_ended)

int main(void) {
    const struct CMUnitTest tests[] = {
        TEST(auto_takes_the_first_that_starts),
        TEST(a_name_gets_that_or_nothing),
        TEST(a_gpu_that_draws_wrong_pictures_does_not_start),
        TEST(the_gpu_is_chosen_by_its_number),
        TEST(a_gpu_can_be_required),
        TEST(the_next_backend_takes_over_after_three_failures),
        TEST(two_failures_lose_no_frame),
        TEST(failures_add_up_over_frames),
        TEST(what_is_not_the_backends_fault_does_not_count),
        TEST(who_names_a_backend_or_requires_a_gpu_keeps_it),
        TEST(who_takes_over_is_asked_whether_it_can),
        TEST(where_nothing_can_take_over_the_backend_stays),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
