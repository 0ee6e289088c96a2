/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "backend/backend.h"
#include "backend/check.h"
#include "backend/cpu/draw.h"
#include "sp/log.h"
#include "sp/probe.h"
#include "support/compare.h"
#include "support/gl.h"
#include "support/one_thread.h"
#include "support/sanitized.h"
#include "unit/backend/rig.h"

static void drop_line(void *user, enum sp_log_level level, const char *kind,
                      const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    (void)level;
    (void)line;
    ++*(int *)user;
}

static void ignore_device(void *user, const struct sp_device *device) {
    (void)user;
    (void)device;
}

/* A GPU must pass this check before it is used. The test card of the null backend must fail it. */
static void the_startup_check_compares_images(void **state) {
    (void)state;
    const struct sp_backend_options options = {
        .threads = 1, .memory_bytes = UINT64_C(1) << 30, .isa = "auto", .gpu = -1
    };
    struct sp_error err;
    void *other, *card;
    const struct sp_backend *cpu = sp_registry_start("cpu", &options, &other, &err);
    const struct sp_backend *null = sp_registry_start("null", &options, &card, &err);
    assert_non_null(cpu);
    assert_non_null(null);
    assert_true(sp_backend_check(cpu, other, cpu, &options, &err));
    assert_false(sp_backend_check(null, card, cpu, &options, &err));
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_non_null(strstr(err.text, "it draws wrong images"));
    cpu->destroy(other);
    null->destroy(card);
    const struct sp_backend *gl = sp_registry_start(test_gl(), &options, &other, &err);
    if (!gl) {
        print_message("skipped: %s\n", err.text);
        return;
    }
    if (!sp_backend_check(gl, other, cpu, &options, &err))
        fail_msg("%s", err.text);
    gl->destroy(other);
}

static void registry_finds_names_and_refuses_others(void **state) {
    (void)state;
    int lines = 0;
    sp_log_init(drop_line, &lines, SP_LOG_WARN);
    unsigned n = 0;
    for (; sp_backend_at(n); n++) {
        struct sp_renderer_options options = { .backend = sp_backend_at(n)->name, .threads = 1 };
        struct sp_error why;
        struct sp_renderer *r = sp_renderer_create(&options, &why);
        struct sp_renderer_info info;
        if (!r && strncmp(sp_backend_at(n)->name, "gl", 2) == 0) { /* GL needs a driver */
            print_message("skipped: %s\n", why.text);
            assert_int_equal(why.code, SP_ERR_BACKEND);
            assert_int_equal(lines, 1); /* a refusal is logged */
            lines = 0;
            continue;
        }
        assert_non_null(r);
        sp_renderer_info(r, &info);
        assert_string_equal(info.backend, sp_backend_at(n)->name);
        assert_true(info.device[0]);
        assert_int_equal(info.threads, 1);
        sp_renderer_destroy(&r);
        assert_null(r);
        assert_compare(strlen(sp_backend_at(n)->doc), >, 0);
    }
    assert_compare(n, >=, 2);
    assert_null(sp_backend_at(n));
    struct sp_error err;
    assert_null(sp_renderer_create(&(struct sp_renderer_options){ .backend = "abacus" }, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_non_null(strstr(err.text, "cpu"));
    assert_null(sp_renderer_create(&(struct sp_renderer_options){ .threads = 300 }, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_int_equal(lines, 0);
    assert_null(
        sp_renderer_create(&(struct sp_renderer_options){ .backend = "cpu", .isa = "mmx" }, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_int_equal(lines, 1); /* a refusal is logged */
    struct sp_renderer *automatic = sp_renderer_create(NULL, &err);
    struct sp_renderer_info info;
    sp_renderer_info(automatic, &info);
    assert_string_equal(info.backend, sp_probe(ignore_device, NULL) ? "gl" : "cpu");
    sp_renderer_destroy(&automatic);
    sp_log_init(NULL, NULL, SP_LOG_INFO);
}

static void unsupported_settings_are_refused_with_their_pointer(void **state) {
    (void)state;
    struct rig rig = rig_make("cpu", 1, rig_make_voxel());
    struct sp_view good = rig.view;
    good.compositing.mode = SP_COMPOSITE_SLAB; /* which excludes shadows */
    assert_true(sp_renderer_supports(rig.renderer, &good, NULL));
#define UNSUPPORTED(field, x, pointer)                                                             \
    do {                                                                                           \
        struct sp_error err;                                                                       \
        rig.view = good;                                                                           \
        rig.view.field = x;                                                                        \
        assert_false(sp_renderer_supports(rig.renderer, &rig.view, &err));                         \
        assert_int_equal(err.code, SP_ERR_UNSUPPORTED);                                            \
        assert_string_equal(err.place, pointer);                                                   \
        assert_null(                                                                               \
            sp_renderer_render(rig.renderer, rig.volume, &rig.view, rig.pool, NULL, &err));        \
        assert_int_equal(err.code, SP_ERR_UNSUPPORTED);                                            \
    } while (0)
    UNSUPPORTED(shading.occlusion, 1, "/shading/occlusion");
    UNSUPPORTED(shading.shadow, 1, "/shading/shadow");
    struct sp_error err;
    rig.view = good;
    rig.view.camera.fov_y = 0;
    assert_null(sp_renderer_render(rig.renderer, rig.volume, &rig.view, rig.pool, NULL, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_string_equal(err.place, "/camera/fov_y");
    rig.view = good; /* the next call works */
    struct sp_frame *frame = rig_draw(&rig, SP_RGBA8);
    sp_frame_unref(&frame);
    rig_finish(&rig);
}

static void the_test_card_shows_the_camera(void **state) {
    (void)state;
    struct rig rig = rig_make("null", 1, rig_make_voxel());
    rig.view.compositing.mode = SP_COMPOSITE_SLAB; /* the null backend supports every view */
    struct sp_frame *a = rig_draw(&rig, SP_RGBA8), *b = rig_draw(&rig, SP_RGBA8);
    assert_true(rig_is_same(a, b));
    for (int axis = 0; axis < 3; axis++) {
        sp_frame_unref(&b);
        rig.view.camera.position[axis] += 1;
        b = rig_draw(&rig, SP_RGBA8);
        assert_false(rig_is_same(a, b));
    }
    assert_string_equal(b->stats.backend, "null");
    sp_frame_unref(&a);
    sp_frame_unref(&b);
    rig_finish(&rig);
}

static void threads_do_not_change_a_bit(void **state) {
    (void)state;
    for (int shading = TEST_SANITIZED; shading < 2; shading++) {
        struct sp_frame *first = NULL;
        struct sp_frame_pool *pool = sp_frame_pool_create(1 << 24, NULL);
        for (unsigned threads = 1; threads <= 7; threads += TEST_SANITIZED ? 6 : 2) {
            struct rig rig =
                rig_make("cpu", threads, rig_make_ball(80, (double[3]){ 1, 1.5, 0.8 }));
            rig.view.shading.mode = (enum sp_shading_mode)shading;
            rig.view.transfer_function.points[1].opacity = 0.9f; /* some tiles saturate */
            rig.view.size[0] = 333;
            rig.view.size[1] = 222;
            struct sp_frame *frame = rig_draw(&rig, SP_RGBAF32);
            assert_int_equal(frame->stats.threads, threads);
            assert_compare(frame->stats.visible_voxels, >, 131072); /* more than one batch */
            if (!first) {
                first = frame;
                assert_compare(rig_check_finite(first), >, 100);
                assert_compare(
                    first->stats.splats, <,
                    first->stats.visible_voxels); /* opaque tiles skip the hidden voxels */
            } else {
                assert_true(rig_is_same(first, frame));
                assert_int_equal(first->stats.splats, frame->stats.splats);
                assert_int_equal(first->stats.fragments, frame->stats.fragments);
                sp_frame_unref(&frame);
            }
            rig_finish(&rig);
        }
        sp_frame_unref(&first);
        sp_frame_pool_destroy(&pool);
    }
}

static void the_steady_state_allocates_nothing(void **state) {
    (void)state;
    struct rig rig = rig_make("cpu", 2, rig_make_ball(40, (double[3]){ 1, 1, 1 }));
    struct sp_backend_options options = { .threads = 2, .isa = "auto" };
    void *pointer;
    const struct sp_backend *cpu = sp_registry_start("cpu", &options, &pointer, NULL);
    struct cpu_state *cpu_state = pointer;
    struct sp_camera camera = rig.view.camera;
    uint64_t arena = 0, frames = 0;
    for (int k = 0; k < 24; k++) { /* turn around all three axes, far and near */
        double angle = k * 0.7, distance = k % 5 == 1 ? 12 : 100;
        for (int i = 0; i < 3; i++)
            rig.view.camera.position[i] =
                camera.target[i] + distance * (i == 0   ? cos(angle)
                                               : i == 1 ? sin(angle) * cos(k * 0.3)
                                                        : sin(k * 0.3));
        struct sp_error err;
        struct sp_frame *frame = sp_frame_create(rig.pool, 100, 75, SP_RGBA8, &err);
        struct sp_backend_job job = { .volume = rig.volume, .view = &rig.view, .frame = frame };
        assert_true(cpu->render(pointer, &job, &err));
        sp_frame_unref(&frame);
        if (k == 2) { /* the third frame merges the blocks that the first two allocated */
            arena = cpu_state->arena.system_allocations;
            frames = sp_frame_pool_allocations(rig.pool);
        }
    }
    assert_int_equal(cpu_state->arena.system_allocations, arena);
    assert_int_equal(sp_frame_pool_allocations(rig.pool), frames);
    cpu->destroy(pointer);
    rig_finish(&rig);
}

static void cached_data_is_counted_and_evicted(void **state) {
    (void)state;
    struct rig rig = rig_make("cpu", 1, rig_make_ball(20, (double[3]){ 1, 1, 1 }));
    assert_int_equal(sp_renderer_memory(rig.renderer, rig.volume), 0);
    struct sp_frame *frame = rig_draw(&rig, SP_RGBA8);
    assert_compare(sp_renderer_memory(rig.renderer, rig.volume), >=,
                   2 * frame->stats.visible_voxels);
    sp_frame_unref(&frame);
    sp_renderer_evict(rig.renderer, rig.volume);
    assert_int_equal(sp_renderer_memory(rig.renderer, rig.volume), 0);
    sp_renderer_evict(rig.renderer, rig.volume);
    /* Use more transfer functions than the cache has slots. */
    for (int i = 0; i < 3 * SP_CLASSIFY_SLOTS; i++) {
        rig.view.transfer_function.points[0].value = 1 + i;
        frame = rig_draw(&rig, SP_RGBA8);
        sp_frame_unref(&frame);
    }
    rig_finish(&rig);
}

/* Returns the largest difference of any channel of any pixel. */
static float largest_difference(const struct sp_frame *a, const struct sp_frame *b) {
    float most = 0;
    for (uint32_t y = 0; y < a->height; y++)
        for (uint32_t i = 0; i < 4 * a->width; i++)
            most = fmaxf(most, fabsf(rig_pixel(a, 0, y)[i] - rig_pixel(b, 0, y)[i]));
    return most;
}

/* After each edit, a renderer that has seen all edits and a renderer whose cached data was evicted
 * give the same image and the same number of visible voxels. The scalar kernels give equal bits.
 * Other kernels add several voxels at a time, in an order that depends on hidden voxels in the
 * lists. */
static void check_edits(const char *isa, float tolerance) {
    struct rig rig = rig_make("cpu", 2, rig_make_ball(36, (double[3]){ 1, 1, 1 }));
    struct rig fresh = rig_make("cpu", 2, sp_volume_ref(rig.volume));
    struct sp_renderer_options options = { .backend = "cpu", .isa = isa, .threads = 2 };
    sp_renderer_destroy(&rig.renderer);
    sp_renderer_destroy(&fresh.renderer);
    rig.renderer = sp_renderer_create(&options, NULL);
    fresh.renderer = sp_renderer_create(&options, NULL);
    /* The threshold moves back and forth in small and large steps, and then rests. */
    for (int k = 0; k < (TEST_SANITIZED ? 12 : 40); k++) {
        struct sp_transfer_function *tf = &rig.view.transfer_function;
        tf->points[0].value = k < 30 ? 300 + 200 * sin(k * 0.4) + (k % 7 == 6 ? 250 : 0) : 250;
        tf->points[1].color[1] = (float)(k % 3) / 2;
        rig.view.camera.position[k % 3] += 3; /* the camera also moves */
        rig.view.shading.mode = k % 10 > 5 ? SP_SHADING_PHONG : SP_SHADING_NONE;
        rig.view.compositing.mode = (enum sp_compositing)(k % 3);
        fresh.view = rig.view;
        sp_renderer_evict(fresh.renderer, fresh.volume);
        struct sp_frame *a = rig_draw(&rig, SP_RGBAF32), *b = rig_draw(&fresh, SP_RGBAF32);
        assert_compare(largest_difference(a, b), <=, tolerance);
        assert_int_equal(a->stats.visible_voxels, b->stats.visible_voxels);
        assert_int_equal(a->stats.splats, b->stats.splats);
        sp_frame_unref(&a);
        sp_frame_unref(&b);
    }
    rig_finish(&rig);
    rig_finish(&fresh);
}

static void edited_images_match_fresh_images(void **state) {
    (void)state;
    check_edits("scalar", 0);
    if (!TEST_TSAN) /* TSan builds have only the scalar kernels */
        check_edits("auto", 1e-5f);
}

static uint64_t memory_at(struct rig *rig, double threshold, int frames) {
    rig->view.transfer_function.points[0].value = threshold;
    for (int k = 0; k < frames; k++) {
        struct sp_frame *frame = rig_draw(rig, SP_RGBA8);
        sp_frame_unref(&frame);
    }
    return sp_renderer_memory(rig->renderer, rig->volume);
}

/* While a threshold moves, the lists also hold hidden voxels. At rest they hold only visible ones.
 */
static void lists_are_cut_down_when_edits_stop(void **state) {
    (void)state;
    struct rig rig = rig_make("cpu", 1, rig_make_ball(60, (double[3]){ 1, 1, 1 }));
    uint64_t exact = memory_at(&rig, 300, 1);
    uint64_t hides = memory_at(&rig, 310, 1), shows = memory_at(&rig, 290, 1);
    uint64_t rests = memory_at(&rig, 290, 20);
    sp_renderer_evict(rig.renderer, rig.volume);
    uint64_t fresh = memory_at(&rig, 290, 1), histogram = rests - fresh;
    assert_compare(hides, >=, exact); /* the list keeps hidden voxels */
    assert_compare(hides - exact, <=, histogram);
    assert_compare(shows, >, fresh + histogram + 5000);
    assert_compare(histogram, <=, 1001 * sizeof(uint64_t));
    rig_finish(&rig);
}

struct canceller {
    atomic_bool cancel, started;
    struct rig *rig;
    struct sp_error err;
    struct sp_frame *frame;
};

static void *render_thread(void *user) {
    struct canceller *c = user;
    struct sp_render_options options = { .cancel = &c->cancel };
    atomic_store(&c->started, true);
    c->frame = sp_renderer_render(c->rig->renderer, c->rig->volume, &c->rig->view, c->rig->pool,
                                  &options, &c->err);
    return NULL;
}

/* A million voxels that each cover the whole image would take hours. Another thread cancels them.
 */
static void endless_work_can_be_cancelled(void **state) {
    (void)state;
    struct rig rig = rig_make("cpu", 2, rig_make_ball(130, (double[3]){ 1e-4, 1e-4, 1e-4 }));
    rig.view.transfer_function.points[1].opacity = 1e-7f;
    rig.view.size[0] = rig.view.size[1] = 2048;
    rig.view.camera.projection = SP_ORTHOGRAPHIC;
    rig.view.camera.height = 1e-5;
    rig.view.filter.sigma = 2;
    rig.view.filter.cutoff = 6;
    rig.view.camera.near = 1e-9;
    struct canceller c = { .rig = &rig };
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, render_thread, &c), 0);
    while (!atomic_load(&c.started))
        ;
    atomic_store(&c.cancel, true);
    pthread_join(thread, NULL); /* the time limit of the test ends this if cancelling fails */
    assert_null(c.frame);
    assert_int_equal(c.err.code, SP_ERR_CANCELLED);
    atomic_store(&c.cancel, true); /* set before the call, so classification sees it */
    sp_renderer_evict(rig.renderer, rig.volume);
    render_thread(&c);
    assert_null(c.frame);
    rig.view.size[0] = rig.view.size[1] = 16;
    rig.view.camera.height = 1;
    atomic_store(&c.cancel, false);
    render_thread(&c);
    assert_non_null(c.frame);
    sp_frame_unref(&c.frame);
    rig_finish(&rig);
}

/* Counts the pauses, and reports 3e13 ms for each, so that a pause that counts as render time
 * shows. */
struct pauser {
    struct sp_pause pause;
    atomic_uint times;
};

static void count_pause(void *user) {
    struct pauser *s = user;
    atomic_fetch_add(&s->times, 1);
    atomic_store(&s->pause.paused_ms, atomic_load(&s->pause.paused_ms) + 3e13);
}

static void a_paused_render_loses_nothing(void **state) {
    (void)state;
    static const enum sp_compositing modes[] = { SP_COMPOSITE_SHEET, SP_COMPOSITE_SLAB };
    for (int m = 0; m < 2; m++) {
        struct rig rig = rig_make("cpu", 2, rig_make_ball(60, (double[3]){ 1, 1, 1 }));
        struct pauser s = { .pause = { .wait = count_pause, .user = &s } };
        struct sp_render_options options = { .pause = &s.pause };
        struct sp_renderer_info info;
        rig.view.compositing.mode = modes[m];
        sp_renderer_info(rig.renderer, &info);
        assert_true(info.can_pause);
        struct sp_frame *frames[2];
        for (int paused = 0; paused < 2; paused++) {
            atomic_store(&s.pause.requested, paused);
            sp_renderer_evict(rig.renderer, rig.volume); /* the frame includes classification */
            frames[paused] =
                sp_renderer_render(rig.renderer, rig.volume, &rig.view, rig.pool, &options, NULL);
            assert_non_null(frames[paused]);
            assert_true(paused ? s.times > 20 : s.times == 0);
        }
        for (uint32_t y = 0; y < frames[0]->height; y++)
            assert_memory_equal((uint8_t *)frames[0]->pixels + y * frames[0]->stride_bytes,
                                (uint8_t *)frames[1]->pixels + y * frames[1]->stride_bytes,
                                frames[0]->width * 4);
        assert_compare(frames[0]->stats.render_ms, <, 1e12);
        assert_compare(frames[1]->stats.render_ms, ==, 0);
        for (uint32_t i = 0; i < frames[1]->stats.stage_count; i++)
            assert_compare(frames[1]->stats.stages[i].ms, <, 1e12);
        sp_frame_unref(&frames[0]);
        sp_frame_unref(&frames[1]);
        rig_finish(&rig);
    }
}

int main(void) {
    if (TEST_SANITIZED)
        print_message("reduced under a sanitizer: fewer edits, counts of threads and shadings\n");
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(registry_finds_names_and_refuses_others),
        one_thread_test(the_startup_check_compares_images),
        cmocka_unit_test(unsupported_settings_are_refused_with_their_pointer),
        one_thread_test(the_test_card_shows_the_camera),
        cmocka_unit_test(threads_do_not_change_a_bit),
        one_thread_test(the_steady_state_allocates_nothing),
        one_thread_test(cached_data_is_counted_and_evicted),
        cmocka_unit_test(edited_images_match_fresh_images),
        one_thread_test(lists_are_cut_down_when_edits_stop),
        cmocka_unit_test(endless_work_can_be_cancelled),
        cmocka_unit_test(a_paused_render_loses_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
