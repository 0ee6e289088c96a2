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

#include "frame/depth.h"
#include "frame/pool.h"
#include "frame/resolve.h"
#include "sp/budget.h"
#include "sp/view.h"
#include "support/compare.h"

static struct sp_frame *make(struct sp_frame_pool *pool, uint32_t w, uint32_t h,
                             enum sp_pixel_format format) {
    struct sp_error err;
    struct sp_frame *frame = sp_frame_create(pool, w, h, format, &err);
    assert_non_null(frame);
    assert_int_equal(frame->width, w);
    assert_int_equal(frame->height, h);
    assert_int_equal(frame->stride_bytes % 64, 0);
    assert_compare(frame->stride_bytes, >=, w * (size_t)(format == SP_RGBAF32 ? 16 : 4));
    assert_int_equal((uintptr_t)frame->pixels % 64, 0);
    memset(frame->pixels, 0xa5, h * frame->stride_bytes); /* the whole block can be written */
    return frame;
}

static void frames_are_recycled(void **state) {
    (void)state;
    struct sp_frame_pool *pool = sp_frame_pool_create(1 << 24, NULL);
    struct sp_frame *a = make(pool, 100, 50, SP_RGBA8), *b = make(pool, 100, 50, SP_RGBA8);
    void *pixels = b->pixels;
    sp_frame_unref(&a);
    sp_frame_unref(&b);
    assert_null(a);
    uint64_t before = sp_frame_pool_allocations(pool);
    assert_int_equal(before, 2);
    for (int i = 0; i < 100; i++) {
        a = make(pool, 100, 50 - (uint32_t)i % 3, SP_RGBA8);
        b = make(pool, 97, 50, SP_RGBA8);
        assert_ptr_not_equal(a->pixels, b->pixels);
        assert_true(a->pixels == pixels || b->pixels == pixels);
        sp_frame_unref(&a);
        sp_frame_unref(&b);
    }
    assert_int_equal(sp_frame_pool_allocations(pool), before);
    sp_frame_pool_destroy(&pool);
    assert_null(pool);
}

static void depth_lies_behind_the_pixels(void **state) {
    (void)state;
    struct sp_error err;
    struct sp_frame_pool *pool = sp_frame_pool_create(1 << 24, NULL);
    struct sp_frame *frame = sp_frame_create_with_depth(pool, 33, 7, SP_RGBA8, &err);
    assert_non_null(frame);
    assert_int_equal(frame->depth_stride_bytes, 192); /* 33 floats, rounded up to 64 bytes */
    assert_int_equal((uintptr_t)frame->depth % 64, 0);
    assert_int_equal((uintptr_t)frame->spread % 64, 0);
    memset(frame->pixels, 1, 7 * frame->stride_bytes);
    memset(frame->depth, 2, 7 * frame->depth_stride_bytes);
    memset(frame->spread, 3, 7 * frame->depth_stride_bytes);
    assert_int_equal(((unsigned char *)frame->pixels)[7 * frame->stride_bytes - 1], 1);
    assert_int_equal(((unsigned char *)frame->depth)[7 * frame->depth_stride_bytes - 1], 2);
    sp_frame_unref(&frame);
    frame = make(pool, 33, 7, SP_RGBA8);
    assert_null(frame->depth);
    assert_null(frame->spread);
    assert_int_equal(frame->depth_stride_bytes, 0);
    sp_frame_unref(&frame);
    sp_frame_pool_destroy(&pool);
}

static void depths_add_up(void **state) {
    (void)state;
    struct sp_depth sum = { INFINITY, 0, 0 };
    sp_depth_add(&sum, &(struct sp_depth){ INFINITY, 0, 0.5f }); /* shows nothing */
    assert_true(isinf(sum.mean));
    sp_depth_add(&sum, &(struct sp_depth){ 4, 1, 0.25f });
    assert_compare(sum.mean, ==, 4);
    assert_compare(sum.spread, ==, 1);
    sp_depth_add(&sum, &(struct sp_depth){ 8, 0, 0.25f });
    assert_compare(fabs((double)sum.mean - 6), <, 1e-6);
    assert_compare(fabs((double)sum.spread - sqrt(4.5)), <, 1e-6); /* (17 + 64)/2 − 36 */
    assert_compare(sum.weight, ==, 0.5);
}

static void pixels_are_taken_from_the_budget(void **state) {
    (void)state;
    struct sp_error err = { .code = SP_OK };
    struct sp_budget *budget = sp_budget_create(100 << 10, NULL);
    struct sp_frame_pool *pool = sp_frame_pool_create(1 << 24, NULL);
    sp_frame_pool_set_budget(pool, budget);
    struct sp_frame *a = make(pool, 128, 128, SP_RGBA8), *b; /* 64 KiB */
    assert_compare(sp_budget_used(budget, SP_BUDGET_IMAGES), >=, (uint64_t)64 << 10);
    assert_null(sp_frame_create(pool, 128, 100, SP_RGBA8, &err));
    assert_int_equal(err.code, SP_ERR_FRAME_BUDGET);
    sp_frame_unref(&a);
    b = make(pool, 32, 640, SP_RGBA8); /* 80 KiB: idle memory makes way */
    sp_frame_unref(&b);
    assert_compare(sp_budget_total(budget), >, (uint64_t)0);
    sp_frame_pool_trim(pool);
    assert_int_equal(sp_budget_total(budget), 0);
    a = make(pool, 128, 128, SP_RGBA8);
    sp_frame_pool_destroy(&pool);
    sp_frame_unref(&a); /* after its pool */
    assert_int_equal(sp_budget_total(budget), 0);
    sp_budget_destroy(&budget);
}

static void idle_memory_is_capped(void **state) {
    (void)state;
    enum { CAP = 64 * 64 * 4 * 3 };
    struct sp_frame_pool *pool = sp_frame_pool_create(CAP, NULL);
    struct sp_frame *frames[8];
    for (int i = 0; i < 8; i++)
        frames[i] = make(pool, 64, 64, SP_RGBA8);
    for (int i = 0; i < 8; i++) {
        sp_frame_unref(&frames[i]);
        assert_compare(sp_frame_pool_idle(pool), <=, CAP);
    }
    assert_int_equal(sp_frame_pool_idle(pool), CAP);
    struct sp_frame *large = make(pool, 512, 512, SP_RGBAF32);
    /* A block above the cap is freed at once, and the idle blocks stay. */
    sp_frame_unref(&large);
    assert_int_equal(sp_frame_pool_idle(pool), CAP);
    /* A frame never reuses a block of more than twice its size. */
    struct sp_frame *tiny = make(pool, 1, 1, SP_RGBA8);
    assert_int_equal(sp_frame_pool_idle(pool), CAP);
    sp_frame_unref(&tiny);
    sp_frame_pool_destroy(&pool);
}

static void frames_outlive_their_pool(void **state) {
    (void)state;
    struct sp_frame_pool *pool = sp_frame_pool_create(1 << 20, NULL);
    struct sp_frame *a = make(pool, 8, 8, SP_RGBA8), *b = sp_frame_ref(a);
    sp_frame_pool_destroy(&pool);
    sp_frame_unref(&a);
    memset(b->pixels, 1, 8 * b->stride_bytes);
    sp_frame_unref(&b);
    sp_frame_unref(&b); /* NULL is accepted */
}

static void *allocate_repeatedly(void *pool) {
    for (int i = 0; i < 2000; i++) {
        struct sp_frame *a = make(pool, 16 + (uint32_t)i % 5, 16, SP_RGBA8), *b = sp_frame_ref(a);
        sp_frame_unref(&a);
        assert_int_equal(((unsigned char *)b->pixels)[0], 0xa5);
        sp_frame_unref(&b);
    }
    return NULL;
}

static void threads_can_share_a_pool(void **state) {
    (void)state;
    struct sp_frame_pool *pool = sp_frame_pool_create(1 << 20, NULL);
    pthread_t threads[4];
    for (int i = 0; i < 4; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, allocate_repeatedly, pool), 0);
    for (int i = 0; i < 4; i++)
        pthread_join(threads[i], NULL);
    assert_compare(sp_frame_pool_allocations(pool), <=, 8);
    sp_frame_pool_destroy(&pool);
}

static void resolve_blends_the_background(void **state) {
    (void)state;
    /* transmittance, premultiplied colour */
    static const float pixels[4][4] = {
        { 1, 0, 0, 0 }, { 0, 0.25f, 0.5f, 2 }, { 0.5f, 0.5f, 0.25f, 0 }, { 0.25f, 0, 0, 0.75f }
    };
    static const float backgrounds[3][4] = { { 0, 0, 0, 1 }, { 1, 0.5f, 0, 0.5f }, { 0, 0, 0, 0 } };
    float plane[4][4];
    for (int i = 0; i < 4; i++)
        for (int p = 0; p < 4; p++)
            plane[p][i] = pixels[i][p];
    const float *const planes[4] = { plane[0], plane[1], plane[2], plane[3] };
    for (int b = 0; b < 3; b++) {
        const float *bg = backgrounds[b];
        float wide[16];
        unsigned char narrow[16];
        sp_resolve_rgbaf32(planes, 4, bg, wide);
        sp_resolve_rgba8(planes, 4, bg, narrow);
        for (int i = 0; i < 4; i++) {
            double through = (double)pixels[i][0], alpha = 1 - through * (1 - (double)bg[3]);
            assert_compare(fabs((double)wide[4 * i + 3] - alpha), <, 1e-6);
            assert_int_equal(narrow[4 * i + 3], lround(alpha * 255));
            for (int c = 0; c < 3; c++) {
                double colour = (double)pixels[i][1 + c] + through * (double)(bg[3] * bg[c]);
                assert_compare(fabs((double)wide[4 * i + c] - colour), <, 1e-6);
                double straight = alpha > 0 ? fmin(1, colour / alpha) : 0;
                assert_int_equal(narrow[4 * i + c], lround(straight * 255));
            }
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pixels_are_taken_from_the_budget),
        cmocka_unit_test(frames_are_recycled),
        cmocka_unit_test(depth_lies_behind_the_pixels),
        cmocka_unit_test(depths_add_up),
        cmocka_unit_test(idle_memory_is_capped),
        cmocka_unit_test(frames_outlive_their_pool),
        cmocka_unit_test(threads_can_share_a_pool),
        cmocka_unit_test(resolve_blends_the_background),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
