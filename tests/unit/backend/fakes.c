/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "support/compare.h"
#include "unit/backend/fakes.h"

struct fake fakes[FAKES];
char fakes_warnings[4096];

static void *fake_create(struct fake *fake, const struct sp_backend_options *options,
                         struct sp_error *err) {
    fake->options = *options;
    if (!fake->starts) {
        sp_fail(err, SP_ERR_BACKEND, "", "%s is broken", fake->name);
        return NULL;
    }
    fake->running++;
    if (!options->passes || options->passes(options->user, fake, err))
        return fake;
    fake->running--;
    return NULL;
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

static bool fake_fail(struct fake *fake, struct sp_error *err) {
    if (fake->code == SP_ERR_BACKEND)
        fake->begun_count = 0;
    return sp_fail(err, fake->code, "", "%s hung", fake->name);
}

static bool fake_draw(struct fake *fake, const struct sp_backend_job *job, struct sp_error *err) {
    fake->renders++;
    memset(job->frame->pixels, 0, job->frame->stride_bytes * job->frame->height);
    memset(job->frame->pixels, fake->paint, fake->painted);
    if (sp_job_is_cancelled(job))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    if (fake->failures == 0)
        return true;
    fake->failures--;
    if (fake->cancels)
        atomic_store(fake->cancels, true);
    return fake_fail(fake, err);
}

static bool fake_render(void *state, const struct sp_backend_job *job, struct sp_error *err) {
    assert_int_equal(((struct fake *)state)->begun_count, 0);
    return fake_draw(state, job, err);
}

static bool fake_begin(void *state, const struct sp_backend_job *job, struct sp_error *err) {
    struct fake *fake = state;
    assert_compare(fake->begun_count, <, 2);
    if (fake->refusals > 0) {
        fake->refusals--;
        return fake_fail(fake, err);
    }
    fake->begun[fake->begun_count++] = job;
    return true;
}

static bool fake_finish(void *state, const struct sp_backend_job *job, struct sp_error *err) {
    struct fake *fake = state;
    assert_compare(fake->begun_count, >, 0);
    assert_ptr_equal(fake->begun[0], job);
    fake->begun_count--;
    memmove(fake->begun, fake->begun + 1, sizeof fake->begun - sizeof fake->begun[0]);
    return fake_draw(fake, job, err);
}

static void fake_evict(void *state, const struct sp_volume *volume) {
    (void)volume;
    ((struct fake *)state)->evictions++;
}

static uint64_t fake_memory(const void *state, const struct sp_volume *volume) {
    (void)volume;
    return ((const struct fake *)state)->name[0] == 'g' ? 1000 : 10;
}

#define ALL_BUT_PLANES                                                                             \
    SP_CAN_ALL, SP_CAN_ALL, SP_CAN_ALL, SP_CAN_ALL, SP_CAN_ALL, SP_CAN_ALL, SP_CAN_ALL,            \
        SP_CAN_ALL, SP_CAN_ALL, true, true, true, true
#define FAKE(fake)                                                                                 \
    .create = fake##_create, .destroy = fake_destroy, .info = fake_info, .render = fake_render,    \
    .evict = fake_evict, .memory = fake_memory

static const struct sp_backend gpu_backend = { .entry = { "gpu", "a GPU" },
                                               .is_gpu = true,
                                               .capabilities = { ALL_BUT_PLANES, true },
                                               FAKE(gpu),
                                               .depth = 2,
                                               .begin = fake_begin,
                                               .finish = fake_finish };
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

static void keep_warning(void *user, enum sp_log_level level, const char *kind,
                         const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    (void)user;
    size_t used = strlen(fakes_warnings);
    if (level == SP_LOG_WARN)
        snprintf(fakes_warnings + used, sizeof fakes_warnings - used, "%s\n", line);
}

unsigned fakes_count_warnings(void) {
    unsigned n = 0;
    for (const char *c = fakes_warnings; *c; c++)
        n += *c == '\n';
    return n;
}

int fakes_reset(void **state) {
    (void)state;
    static const char *const names[FAKES] = { "gpu", "plain", "last" };
    for (int i = 0; i < FAKES; i++)
        fakes[i] = (struct fake){ .name = names[i], .starts = true, .code = SP_ERR_BACKEND };
    fakes_warnings[0] = 0;
    sp_log_init(keep_warning, NULL, SP_LOG_INFO);
    return 0;
}

int fakes_check_all_ended(void **state) {
    (void)state;
    for (int i = 0; i < FAKES; i++)
        assert_int_equal(fakes[i].running, 0);
    return 0;
}

void fakes_scene_init(struct fakes_scene *s, const struct sp_renderer_options *options) {
    *s = (struct fakes_scene){ .renderer = sp_renderer_create(options, NULL),
                               .pool = sp_frame_pool_create(0, NULL),
                               .volume = sp_volume_load("demo:phantom?size=16", NULL, NULL) };
    assert_true(s->renderer);
    assert_true(s->pool);
    assert_true(s->volume);
    sp_view_init(&s->view, sp_volume_info(s->volume), "phantom");
    s->view.size[0] = s->view.size[1] = 16;
    s->view.transfer_function.order = SP_TF_PRE; /* auto has a second choice, and draws twice */
    for (int i = 0; i < FAKES; i++)              /* the startup check also draws */
        fakes[i].renders = 0;
}

void fakes_scene_finish(struct fakes_scene *s) {
    sp_renderer_destroy(&s->renderer);
    sp_frame_pool_destroy(&s->pool);
    sp_volume_unref(&s->volume);
}

const char *fakes_drawn_by(struct sp_frame *frame) {
    if (!frame)
        return "";
    const char *backend = frame->stats.backend;
    char device[SP_DEVICE_NAME];
    snprintf(device, sizeof device, "device of %s", backend);
    assert_string_equal(frame->stats.device, device);
    sp_frame_unref(&frame);
    return backend;
}

const char *fakes_draw(struct fakes_scene *s) {
    const struct sp_render_options options = { .cancel = &s->cancel };
    return fakes_drawn_by(
        sp_renderer_render(s->renderer, s->volume, &s->view, s->pool, &options, &s->err));
}
