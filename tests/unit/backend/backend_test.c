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
#include "frame/pool.h"
#include "sp/inflight.h"
#include "sp/log.h"
#include "sp/probe.h"
#include "sp/renderer.h"

static void drop_line(void *user, enum sp_log_level level, const char *kind,
                      const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    (void)level;
    (void)line;
    ++*(int *)user;
}

/* A ball of rising values on any grid: sheets of every size, edges, gradients. */
static struct sp_volume *make_ball(uint32_t n, const double spacing[3]) {
    struct sp_grid grid = { .dims = { n, n, n },
                            .spacing = { spacing[0], spacing[1], spacing[2] },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    uint16_t *values = malloc((size_t)n * n * n * sizeof *values);
    double half = (n - 1) / 2.0;
    for (uint32_t i = 0; i < n * n * n; i++) {
        double x = i % n - half, y = i / n % n - half, z = i / n / n - half;
        double r = sqrt(x * x + y * y + z * z) / fmax(half, 0.5);
        values[i] = (uint16_t)(r < 1 ? 1000 * (1 - r) : 0);
    }
    struct sp_volume *v = sp_volume_create(&grid, SP_UINT16, values, "ball", NULL);
    assert_non_null(v);
    free(values);
    return v;
}

static struct sp_volume *make_voxel(void) {
    const struct sp_grid grid = { .dims = { 1, 1, 1 },
                                  .spacing = { 1, 1, 1 },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    struct sp_volume *v = sp_volume_create(&grid, SP_FLOAT32, &(float){ 1 }, "voxel", NULL);
    assert_non_null(v);
    return v;
}

struct rig {
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
    struct sp_volume *volume;
    struct sp_view view;
};

static struct rig make_rig(const char *backend, unsigned threads, struct sp_volume *volume) {
    struct sp_error err;
    struct rig rig = { .volume = volume, .pool = sp_frame_pool_create(1 << 26, NULL) };
    rig.renderer = sp_renderer_create(
        &(struct sp_renderer_options){ .backend = backend, .threads = threads }, &err);
    if (!rig.renderer)
        fail_msg("%s", err.text);
    sp_view_init(&rig.view, sp_volume_info(volume), "v");
    rig.view.size[0] = 100;
    rig.view.size[1] = 75;
    rig.view.transfer_function = (struct sp_transfer_function){
        .reference_length = 1,
        .point_count = 2,
        .points = { { 1, { 1, 0.5f, 0.2f }, 0 }, { 900, { 0.2f, 0.6f, 1 }, 0.3f } },
    };
    return rig;
}

static void finish_rig(struct rig *rig) {
    sp_renderer_destroy(&rig->renderer);
    sp_frame_pool_destroy(&rig->pool);
    sp_volume_unref(&rig->volume);
}

static struct sp_frame *draw(struct rig *rig, enum sp_pixel_format format) {
    struct sp_error err;
    struct sp_render_options options = { .format = format };
    struct sp_frame *frame =
        sp_renderer_render(rig->renderer, rig->volume, &rig->view, rig->pool, &options, &err);
    if (!frame)
        fail_msg("%s: %s", err.place, err.text);
    return frame;
}

static bool same_pixels(const struct sp_frame *a, const struct sp_frame *b) {
    size_t row = a->width * (size_t)(a->format == SP_RGBAF32 ? 16 : 4);
    for (uint32_t y = 0; y < a->height; y++)
        if (memcmp((char *)a->pixels + y * a->stride_bytes, (char *)b->pixels + y * b->stride_bytes,
                   row) != 0)
            return false;
    return true;
}

static const float *pixel(const struct sp_frame *f, uint32_t x, uint32_t y) {
    return (const float *)(const void *)((char *)f->pixels + y * f->stride_bytes) + 4 * (size_t)x;
}

/* All pixels finite, alpha in [0,1]; returns the sum of red. */
static double check_finite(const struct sp_frame *f) {
    double sum = 0;
    unsigned bad = 0;
    for (uint32_t y = 0; y < f->height; y++)
        for (uint32_t x = 0; x < f->width; x++) {
            const float *p = pixel(f, x, y);
            bad += !(isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]) && p[3] >= 0 &&
                     p[3] <= 1.000001f);
            sum += (double)p[0];
        }
    assert_int_equal(bad, 0);
    return sum;
}

static void pass_over(void *user, const struct sp_device *device) {
    (void)user;
    (void)device;
}

/* A GPU must pass this check before it is used. An image that was not drawn fails it. */
static void the_check_finds_pictures_alike(void **state) {
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
    const struct sp_backend *gl = sp_registry_start("gl-software", &options, &other, &err);
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
        if (!r && strncmp(sp_backend_at(n)->name, "gl", 2) == 0) { /* needs a driver */
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
        assert_true(strlen(sp_backend_at(n)->doc) > 0);
    }
    assert_true(n >= 2);
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
    assert_string_equal(info.backend, sp_probe(pass_over, NULL) ? "gl" : "cpu");
    sp_renderer_destroy(&automatic);
    sp_log_init(NULL, NULL, SP_LOG_INFO);
}

static void what_is_not_supported_is_refused_with_its_pointer(void **state) {
    (void)state;
    struct rig rig = make_rig("cpu", 1, make_voxel());
    const struct sp_view good = rig.view;
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
    UNSUPPORTED(primitive, SP_PRIMITIVE_SURFACE, "/primitive/type");
    UNSUPPORTED(primitive, SP_PRIMITIVE_SHELL, "/primitive/type");
    struct sp_error err;
    rig.view = good;
    rig.view.primitive = SP_PRIMITIVE_VECTOR;
    sp_renderer_supports(rig.renderer, &rig.view, &err);
    assert_non_null(strstr(err.text, "\"vector\"; it supports volume"));
    rig.view = good;
    rig.view.camera.fov_y = 0;
    assert_null(sp_renderer_render(rig.renderer, rig.volume, &rig.view, rig.pool, NULL, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_string_equal(err.place, "/camera/fov_y");
    rig.view = good; /* and the next call works */
    struct sp_frame *frame = draw(&rig, SP_RGBA8);
    sp_frame_unref(&frame);
    finish_rig(&rig);
}

static void the_test_card_shows_the_camera(void **state) {
    (void)state;
    struct rig rig = make_rig("null", 1, make_voxel());
    rig.view.compositing.mode = SP_COMPOSITE_SLAB; /* it draws anything */
    struct sp_frame *a = draw(&rig, SP_RGBA8), *b = draw(&rig, SP_RGBA8);
    assert_true(same_pixels(a, b));
    for (int axis = 0; axis < 3; axis++) {
        sp_frame_unref(&b);
        rig.view.camera.position[axis] += 1;
        b = draw(&rig, SP_RGBA8);
        assert_false(same_pixels(a, b));
    }
    assert_string_equal(b->stats.backend, "null");
    sp_frame_unref(&a);
    sp_frame_unref(&b);
    finish_rig(&rig);
}

static void threads_do_not_change_a_bit(void **state) {
    (void)state;
    for (int shading = 0; shading < 2; shading++) {
        struct sp_frame *first = NULL;
        struct sp_frame_pool *pool = sp_frame_pool_create(1 << 24, NULL);
        for (unsigned threads = 1; threads <= 7; threads += 2) {
            struct rig rig = make_rig("cpu", threads, make_ball(80, (double[3]){ 1, 1.5, 0.8 }));
            rig.view.shading.mode = (enum sp_shading_mode)shading;
            rig.view.transfer_function.points[1].opacity = 0.9f; /* some tiles saturate */
            rig.view.size[0] = 333;
            rig.view.size[1] = 222;
            struct sp_frame *frame = draw(&rig, SP_RGBAF32);
            assert_int_equal(frame->stats.threads, threads);
            assert_true(frame->stats.visible_voxels > 131072); /* more than one batch */
            if (!first) {
                first = frame;
                assert_true(check_finite(first) > 100);
                assert_true(first->stats.splats <
                            first->stats.visible_voxels); /* some are hidden */
            } else {
                assert_true(same_pixels(first, frame));
                assert_int_equal(first->stats.splats, frame->stats.splats);
                assert_int_equal(first->stats.fragments, frame->stats.fragments);
                sp_frame_unref(&frame);
            }
            finish_rig(&rig);
        }
        sp_frame_unref(&first);
        sp_frame_pool_destroy(&pool);
    }
}

static void the_steady_state_allocates_nothing(void **state) {
    (void)state;
    struct rig rig = make_rig("cpu", 2, make_ball(40, (double[3]){ 1, 1, 1 }));
    struct sp_backend_options options = { .threads = 2, .isa = "auto" };
    void *pointer;
    const struct sp_backend *cpu = sp_registry_start("cpu", &options, &pointer, NULL);
    struct cpu_state *cpu_state = pointer;
    struct sp_camera camera = rig.view.camera;
    uint64_t arena = 0, frames = 0;
    for (int k = 0; k < 24; k++) { /* around all three major axes, far and near */
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
        if (k == 2) { /* the third frame joins what the first two, far and near, allocated */
            arena = cpu_state->arena.system_allocations;
            frames = sp_frame_pool_allocations(rig.pool);
        }
    }
    assert_int_equal(cpu_state->arena.system_allocations, arena);
    assert_int_equal(sp_frame_pool_allocations(rig.pool), frames);
    cpu->destroy(pointer);
    finish_rig(&rig);
}

static void cached_data_is_counted_and_evicted(void **state) {
    (void)state;
    struct rig rig = make_rig("cpu", 1, make_ball(20, (double[3]){ 1, 1, 1 }));
    assert_int_equal(sp_renderer_memory(rig.renderer, rig.volume), 0);
    struct sp_frame *frame = draw(&rig, SP_RGBA8);
    assert_true(sp_renderer_memory(rig.renderer, rig.volume) >= 2 * frame->stats.visible_voxels);
    sp_frame_unref(&frame);
    sp_renderer_evict(rig.renderer, rig.volume);
    assert_int_equal(sp_renderer_memory(rig.renderer, rig.volume), 0);
    sp_renderer_evict(rig.renderer, rig.volume);
    /* More transfer functions than there are slots. */
    for (int i = 0; i < 3 * SP_CLASSIFY_SLOTS; i++) {
        rig.view.transfer_function.points[0].value = 1 + i;
        frame = draw(&rig, SP_RGBA8);
        sp_frame_unref(&frame);
    }
    finish_rig(&rig);
}

/* Largest difference of any channel. */
static float largest_difference(const struct sp_frame *a, const struct sp_frame *b) {
    float most = 0;
    for (uint32_t y = 0; y < a->height; y++)
        for (uint32_t i = 0; i < 4 * a->width; i++)
            most = fmaxf(most, fabsf(pixel(a, 0, y)[i] - pixel(b, 0, y)[i]));
    return most;
}

/* The image and the count of visible voxels are those of a renderer that never saw another
 * transfer function, whatever the lists hold after a row of edits: to the bit where voxels are
 * drawn one by one; several at a time are added in another order when hidden ones lie between. */
static void check_edits(const char *isa, float tolerance) {
    struct rig rig = make_rig("cpu", 2, make_ball(36, (double[3]){ 1, 1, 1 }));
    struct rig fresh = make_rig("cpu", 2, sp_volume_ref(rig.volume));
    struct sp_renderer_options options = { .backend = "cpu", .isa = isa, .threads = 2 };
    sp_renderer_destroy(&rig.renderer);
    sp_renderer_destroy(&fresh.renderer);
    rig.renderer = sp_renderer_create(&options, NULL);
    fresh.renderer = sp_renderer_create(&options, NULL);
    /* Thresholds that a hand moves to and fro, in small steps and large ones; then it rests. */
    for (int k = 0; k < 40; k++) {
        struct sp_transfer_function *tf = &rig.view.transfer_function;
        tf->points[0].value = k < 30 ? 300 + 200 * sin(k * 0.4) + (k % 7 == 6 ? 250 : 0) : 250;
        tf->points[1].color[1] = (float)(k % 3) / 2;
        rig.view.camera.position[k % 3] += 3; /* around axes, too */
        rig.view.shading.mode = k % 10 > 5 ? SP_SHADING_PHONG : SP_SHADING_NONE;
        rig.view.compositing.mode = (enum sp_compositing)(k % 3);
        fresh.view = rig.view;
        sp_renderer_evict(fresh.renderer, fresh.volume);
        struct sp_frame *a = draw(&rig, SP_RGBAF32), *b = draw(&fresh, SP_RGBAF32);
        assert_true(largest_difference(a, b) <= tolerance);
        assert_int_equal(a->stats.visible_voxels, b->stats.visible_voxels);
        assert_int_equal(a->stats.splats, b->stats.splats);
        sp_frame_unref(&a);
        sp_frame_unref(&b);
    }
    finish_rig(&rig);
    finish_rig(&fresh);
}

static void edited_pictures_are_fresh_pictures(void **state) {
    (void)state;
    check_edits("scalar", 0);
    check_edits("auto", 1e-5f);
}

static uint64_t memory_at(struct rig *rig, double threshold, int frames) {
    rig->view.transfer_function.points[0].value = threshold;
    for (int k = 0; k < frames; k++) {
        struct sp_frame *frame = draw(rig, SP_RGBA8);
        sp_frame_unref(&frame);
    }
    return sp_renderer_memory(rig->renderer, rig->volume);
}

/* While thresholds move, lists hold more than what is visible; at rest they do not. */
static void lists_are_cut_down_when_edits_stop(void **state) {
    (void)state;
    struct rig rig = make_rig("cpu", 1, make_ball(60, (double[3]){ 1, 1, 1 }));
    uint64_t exact = memory_at(&rig, 300, 1);
    uint64_t hides = memory_at(&rig, 310, 1), shows = memory_at(&rig, 290, 1);
    uint64_t rests = memory_at(&rig, 290, 20);
    sp_renderer_evict(rig.renderer, rig.volume);
    uint64_t fresh = memory_at(&rig, 290, 1), histogram = rests - fresh;
    assert_true(hides >= exact); /* the same list */
    assert_true(hides - exact <= histogram);
    assert_true(shows > fresh + histogram + 5000);
    assert_true(histogram <= 1001 * sizeof(uint64_t));
    finish_rig(&rig);
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

/* A million voxels that each cover the whole image: hours of work, cancelled by another thread. */
static void endless_work_can_be_cancelled(void **state) {
    (void)state;
    struct rig rig = make_rig("cpu", 2, make_ball(130, (double[3]){ 1e-4, 1e-4, 1e-4 }));
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
    pthread_join(thread, NULL); /* the test's timeout is the limit */
    assert_null(c.frame);
    assert_int_equal(c.err.code, SP_ERR_CANCELLED);
    atomic_store(&c.cancel, true); /* set before the call: also while classifying */
    sp_renderer_evict(rig.renderer, rig.volume);
    render_thread(&c);
    assert_null(c.frame);
    rig.view.size[0] = rig.view.size[1] = 16;
    rig.view.camera.height = 1;
    atomic_store(&c.cancel, false);
    render_thread(&c);
    assert_non_null(c.frame);
    sp_frame_unref(&c.frame);
    finish_rig(&rig);
}

/* Stands still once for every so many looks, for a thousand years each time. */
struct standing {
    struct sp_pause pause;
    atomic_uint times;
};

static void stand(void *user) {
    struct standing *s = user;
    atomic_fetch_add(&s->times, 1);
    atomic_store(&s->pause.paused_ms, atomic_load(&s->pause.paused_ms) + 3e13);
}

static void what_stands_still_loses_nothing(void **state) {
    (void)state;
    static const enum sp_compositing modes[] = { SP_COMPOSITE_SHEET, SP_COMPOSITE_SLAB };
    for (int m = 0; m < 2; m++) {
        struct rig rig = make_rig("cpu", 2, make_ball(60, (double[3]){ 1, 1, 1 }));
        struct standing s = { .pause = { .wait = stand, .user = &s } };
        struct sp_render_options options = { .pause = &s.pause };
        struct sp_renderer_info info;
        rig.view.compositing.mode = modes[m];
        sp_renderer_info(rig.renderer, &info);
        assert_true(info.can_pause);
        struct sp_frame *frames[2];
        for (int held = 0; held < 2; held++) {
            atomic_store(&s.pause.requested, held);
            sp_renderer_evict(rig.renderer, rig.volume); /* it classifies, too */
            frames[held] =
                sp_renderer_render(rig.renderer, rig.volume, &rig.view, rig.pool, &options, NULL);
            assert_non_null(frames[held]);
            assert_true(held ? s.times > 20 : s.times == 0);
        }
        for (uint32_t y = 0; y < frames[0]->height; y++)
            assert_memory_equal((uint8_t *)frames[0]->pixels + y * frames[0]->stride_bytes,
                                (uint8_t *)frames[1]->pixels + y * frames[1]->stride_bytes,
                                frames[0]->width * 4);
        assert_true(frames[0]->stats.render_ms < 1e12);
        assert_true(frames[1]->stats.render_ms == 0);
        for (uint32_t i = 0; i < frames[1]->stats.stage_count; i++)
            assert_true(frames[1]->stats.stages[i].ms < 1e12);
        sp_frame_unref(&frames[0]);
        sp_frame_unref(&frames[1]);
        finish_rig(&rig);
    }
}

/* Adaptive may join thin sheets, which must not be seen whatever attenuates them. */
static void thin_sheets_attenuate_alike(void **state) {
    (void)state;
    for (int linear = 0; linear < 2; linear++) {
        struct rig rig = make_rig("cpu", 2, make_ball(48, (double[3]){ 1, 1, 1 }));
        rig.view.shading.mode = SP_SHADING_NONE;
        rig.view.compositing.attenuation =
            linear ? SP_ATTENUATION_LINEAR : SP_ATTENUATION_EXPONENTIAL;
        for (uint32_t i = 0; i < rig.view.transfer_function.point_count; i++)
            rig.view.transfer_function.points[i].opacity =
                rig.view.transfer_function.points[i].opacity > 0 ? 0.02f : 0;
        rig.view.camera.projection = SP_ORTHOGRAPHIC; /* all footprints alike: sheets are joined */
        rig.view.camera.height = 60;
        rig.view.filter.mode = SP_FILTER_EWA;
        struct sp_frame *ewa = draw(&rig, SP_RGBAF32);
        rig.view.filter.mode = SP_FILTER_ADAPTIVE;
        struct sp_frame *adaptive = draw(&rig, SP_RGBAF32);
        float most = 0;
        for (uint32_t y = 0; y < ewa->height; y++)
            for (uint32_t x = 0; x < ewa->width; x++)
                for (int c = 0; c < 3; c++) {
                    float a = pixel(ewa, x, y)[c], b = pixel(adaptive, x, y)[c];
                    most = fmaxf(most, a);
                    assert_true(fabsf(a - b) < 0.006f);
                }
        assert_true(most > 0.1f); /* there is something to attenuate */
        sp_frame_unref(&ewa);
        sp_frame_unref(&adaptive);
        finish_rig(&rig);
    }
}

static void one_voxel_has_its_analytic_depth(void **state) {
    (void)state;
    struct rig rig = make_rig("cpu", 1, make_voxel());
    rig.view.transfer_function = (struct sp_transfer_function){
        .reference_length = 1, .point_count = 1, .points = { { 0, { 1, 1, 1 }, 0.5f } }
    };
    rig.view.shading.mode = SP_SHADING_NONE;
    rig.view.background[3] = 0;
    rig.view.filter.mode = SP_FILTER_EWA;
    rig.view.filter.lowpass = 0;
    rig.view.size[0] = rig.view.size[1] = 101;
    rig.view.camera = (struct sp_camera){ .projection = SP_ORTHOGRAPHIC,
                                          .position = { 0, 0, -5 },
                                          .up = { 0, -1, 0 },
                                          .fov_y = 30,
                                          .height = 10.1,
                                          .near = 0.1 };
    double top = log(2) / (2 * M_PI * 0.49),
           back = 1 - exp(-4.5); /* g/(2πσ²), what the cut takes */
    for (int footprint = 0; footprint < 2; footprint++) {
        rig.view.compositing.mode = footprint ? SP_COMPOSITE_SPLAT : SP_COMPOSITE_SHEET;
        struct sp_frame *frame = draw(&rig, SP_RGBAF32);
        bool is_cut = footprint || strcmp(frame->stats.isa, "scalar") == 0;
        for (int x = 0; x < 101; x++) {
            double r = abs(x - 50) * 0.1 / 0.7, tau = top * exp(-0.5 * r * r);
            if (is_cut)
                tau = r < 3 ? tau / back : 0;
            double error = fabs((double)pixel(frame, (uint32_t)x, 50)[3] - (1 - exp(-tau)));
            /* A filtered sheet is a Gaussian but for its B-splines and its last samples. */
            assert_true(error < (is_cut ? 1e-5 : 1e-3) || (is_cut && fabs(r - 3) < 1e-3));
        }
        assert_int_equal(frame->stats.splats, 1);
        sp_frame_unref(&frame);
    }
    finish_rig(&rig);
}

static void odd_sizes_and_places_are_drawn(void **state) {
    (void)state;
    static const uint32_t sizes[][2] = { { 1, 1 }, { 8192, 1 }, { 1, 8192 }, { 33, 31 } };
    struct rig rig = make_rig("cpu", 2, make_ball(24, (double[3]){ 1, 1, 1 }));
    rig.view.background[3] = 0;
    for (int i = 0; i < 4; i++) {
        memcpy(rig.view.size, sizes[i], sizeof rig.view.size);
        struct sp_frame *frame = draw(&rig, SP_RGBAF32);
        assert_true(check_finite(frame) > 0);
        assert_true(frame->stats.splats > 0);
        sp_frame_unref(&frame);
    }
    double middle = 11.5;
    static const double eyes[][3] = {
        { 0, 0, 0 }, { 0.5, 0.5, 0.5 } /* on a voxel */, { 3, 0, 0 }, { 0, 0, 1e-6 }, { -11, 2, 4 }
    };
    for (int i = 0; i < 5; i++)
        for (int projection = 0; projection < 2; projection++)
            for (int wide = 0; wide < 2; wide++) {
                struct sp_camera *c = &rig.view.camera;
                *c = (struct sp_camera){ .projection = (enum sp_projection)projection,
                                         .up = { 0, 0, 1 },
                                         .fov_y = wide ? 170 : 30,
                                         .height = 5,
                                         .near = 1e-9 };
                for (int k = 0; k < 3; k++) {
                    c->position[k] = middle + eyes[i][k];
                    c->target[k] = c->position[k] + (k == 1 ? 5 : 1);
                }
                struct sp_frame *frame = draw(&rig, SP_RGBAF32);
                assert_true(check_finite(frame) > 0);
                sp_frame_unref(&frame);
            }
    /* All of it behind the eye: the background, exactly. */
    rig.view.camera.projection = SP_PERSPECTIVE;
    for (int k = 0; k < 3; k++) {
        rig.view.camera.position[k] = 200;
        rig.view.camera.target[k] = 300 + 10 * k;
    }
    rig.view.background[0] = 0.25f;
    rig.view.background[3] = 1;
    struct sp_frame *frame = draw(&rig, SP_RGBAF32);
    assert_int_equal(frame->stats.splats, 0);
    for (uint32_t y = 0; y < frame->height; y++)
        for (uint32_t x = 0; x < frame->width; x++)
            assert_true(pixel(frame, x, y)[0] == 0.25f && pixel(frame, x, y)[3] == 1);
    sp_frame_unref(&frame);
    finish_rig(&rig);
}

/* An image of several bands and batches must equal the image that is drawn in one piece. */
static void bands_leave_no_seam(void **state) {
    (void)state;
    struct rig rig = make_rig("cpu", 2, make_ball(24, (double[3]){ 1, 1, 1 }));
    rig.view.camera.projection = SP_ORTHOGRAPHIC;
    rig.view.camera.height = 24;
    rig.view.size[0] = 2048; /* 64 tiles wide: bands of 36 rows of tiles, 1152 px */
    rig.view.size[1] = 1600;
    struct sp_frame *large = draw(&rig, SP_RGBAF32);
    rig.view.size[0] = 1024; /* one band, the middle of the same image */
    struct sp_frame *part = draw(&rig, SP_RGBAF32);
    double worst = 0;
    for (uint32_t y = 0; y < 1600; y++)
        for (uint32_t x = 0; x < 1024; x++)
            for (int c = 0; c < 4; c++)
                worst = fmax(worst, fabs((double)pixel(large, x + 512, y)[c] -
                                         (double)pixel(part, x, y)[c]));
    assert_true(worst < 1e-3);
    assert_true(check_finite(part) > 1000);
    sp_frame_unref(&large);
    sp_frame_unref(&part);
    finish_rig(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(registry_finds_names_and_refuses_others),
        cmocka_unit_test(the_check_finds_pictures_alike),
        cmocka_unit_test(what_is_not_supported_is_refused_with_its_pointer),
        cmocka_unit_test(the_test_card_shows_the_camera),
        cmocka_unit_test(threads_do_not_change_a_bit),
        cmocka_unit_test(the_steady_state_allocates_nothing),
        cmocka_unit_test(cached_data_is_counted_and_evicted),
        cmocka_unit_test(edited_pictures_are_fresh_pictures),
        cmocka_unit_test(lists_are_cut_down_when_edits_stop),
        cmocka_unit_test(endless_work_can_be_cancelled),
        cmocka_unit_test(what_stands_still_loses_nothing),
        cmocka_unit_test(thin_sheets_attenuate_alike),
        cmocka_unit_test(one_voxel_has_its_analytic_depth),
        cmocka_unit_test(odd_sizes_and_places_are_drawn),
        cmocka_unit_test(bands_leave_no_seam),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
