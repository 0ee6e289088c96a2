/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "frame/antialias.h"
#include "support/compare.h"
#include "support/image.h"

struct rig {
    struct sp_frame_pool *frames;
    struct sp_arena arena;
};

static float *floats_at(struct sp_frame *frame, uint32_t x, uint32_t y) {
    return (float *)(void *)((char *)frame->pixels + y * frame->stride_bytes) + 4 * x;
}

static unsigned char *bytes_at(struct sp_frame *frame, uint32_t x, uint32_t y) {
    return (unsigned char *)frame->pixels + y * frame->stride_bytes + 4 * x;
}

static struct sp_frame *make(struct rig *rig, uint32_t w, uint32_t h, enum sp_pixel_format format) {
    struct sp_error err;
    struct sp_frame *frame = sp_frame_create(rig->frames, w, h, format, &err);
    assert_non_null(frame);
    memset(frame->pixels, 0, h * frame->stride_bytes);
    return frame;
}

static void filter(struct rig *rig, struct sp_frame *frame, float strength, unsigned threads) {
    struct sp_error err;
    struct sp_pool *pool = sp_pool_create(threads, &err);
    assert_non_null(pool);
    sp_arena_reset(&rig->arena);
    assert_true(sp_antialias(frame, strength, &rig->arena, pool, &err));
    sp_pool_destroy(&pool);
}

static void a_point_becomes_the_kernel(void **state) {
    struct sp_frame *frame = make(*state, 7, 6, SP_RGBAF32);
    const double a = 0.5 * (double)ANTIALIAS_WEIGHT;
    floats_at(frame, 3, 2)[1] = 1;
    filter(*state, frame, 0.5f, 3);
    for (uint32_t y = 0; y < 6; y++)
        for (uint32_t x = 0; x < 7; x++)
            for (int c = 0; c < 4; c++) {
                const int dx = abs((int)x - 3), dy = abs((int)y - 2);
                const double across = dx > 1 ? 0 : dx ? a : 1 - 2 * a;
                const double down = dy > 1 ? 0 : dy ? a : 1 - 2 * a;
                assert_float_equal(floats_at(frame, x, y)[c], c == 1 ? across * down : 0, 1e-6);
            }
    sp_frame_unref(&frame);
}

/* A mean over the area of a pixel leaves straight slopes as they are, and constants at borders. */
static void slopes_and_borders_stay(void **state) {
    struct sp_frame *slope = make(*state, 9, 8, SP_RGBAF32), *flat = make(*state, 9, 8, SP_RGBA8);
    flat->is_opaque = true;
    for (uint32_t y = 0; y < 8; y++)
        for (uint32_t x = 0; x < 9; x++) {
            floats_at(slope, x, y)[2] = 0.1f * (float)x - 0.03f * (float)y;
            memcpy(bytes_at(flat, x, y), (unsigned char[]){ 1, 254, 255, 255 }, 4);
        }
    filter(*state, slope, 1, 2);
    filter(*state, flat, 1, 2);
    for (uint32_t y = 0; y < 8; y++)
        for (uint32_t x = 0; x < 9; x++) {
            assert_memory_equal(bytes_at(flat, x, y), ((unsigned char[]){ 1, 254, 255, 255 }), 4);
            if (x % 8 && y % 7)
                assert_float_equal(floats_at(slope, x, y)[2], 0.1 * x - 0.03 * y, 1e-6);
        }
    sp_frame_unref(&slope);
    sp_frame_unref(&flat);
}

/* White beside nothing stays white: colours count by their alpha. */
static void transparent_pixels_have_no_colour(void **state) {
    struct sp_frame *frame = make(*state, 4, 4, SP_RGBA8);
    for (uint32_t y = 0; y < 4; y++)
        for (uint32_t x = 0; x < 2; x++)
            memset(bytes_at(frame, x, y), 255, 4);
    filter(*state, frame, 1, 1);
    for (uint32_t y = 0; y < 4; y++) {
        const int alpha = (int)lroundf(255 * ANTIALIAS_WEIGHT);
        assert_memory_equal(bytes_at(frame, 0, y), ((unsigned char[]){ 255, 255, 255, 255 }), 4);
        assert_int_equal(bytes_at(frame, 1, y)[3], 255 - alpha);
        assert_int_equal(bytes_at(frame, 2, y)[3], alpha);
        for (int c = 0; c < 3; c++) {
            assert_int_equal(bytes_at(frame, 1, y)[c], 255);
            assert_int_equal(bytes_at(frame, 2, y)[c], 255);
            assert_int_equal(bytes_at(frame, 3, y)[c], 0);
        }
    }
    sp_frame_unref(&frame);
}

static void fill(struct sp_frame *frame) {
    srand(7);
    for (uint32_t y = 0; y < frame->height; y++)
        for (uint32_t x = 0; x < 4 * frame->width; x++) {
            const int r = rand() % 256;
            if (frame->format == SP_RGBA8)
                bytes_at(frame, 0, y)[x] = (unsigned char)r;
            else
                floats_at(frame, 0, y)[x] = (float)r / 255;
        }
}

/* Images of one pixel, of one row and of one column as well, and more threads than rows. */
static void threads_do_not_matter(void **state) {
    static const uint32_t sizes[][2] = { { 1, 1 }, { 17, 1 }, { 1, 17 }, { 33, 3 }, { 5, 64 } };
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        for (int format = 0; format < 2; format++) {
            struct sp_frame *first = make(*state, sizes[i][0], sizes[i][1], format), *other;
            fill(first);
            filter(*state, first, 1, 1);
            for (unsigned threads = 2; threads < 9; threads += 3) {
                other = make(*state, sizes[i][0], sizes[i][1], format);
                fill(other);
                filter(*state, other, 1, threads);
                for (uint32_t y = 0; y < first->height; y++)
                    assert_memory_equal(bytes_at(first, 0, y), bytes_at(other, 0, y),
                                        first->width * (format == SP_RGBA8 ? 4 : 16));
                sp_frame_unref(&other);
            }
            sp_frame_unref(&first);
        }
}

/* Opaque bytes are the rounded floats. */
static void bytes_equal_floats(void **state) {
    struct sp_frame *bytes = make(*state, 31, 9, SP_RGBA8), *floats = make(*state, 31, 9, 1);
    bytes->is_opaque = true;
    fill(bytes);
    fill(floats);
    filter(*state, bytes, 1, 2);
    filter(*state, floats, 1, 2);
    for (uint32_t y = 0; y < 9; y++)
        for (uint32_t x = 0; x < 4 * 31; x++)
            assert_compare(
                fabs(bytes_at(bytes, 0, y)[x] - 255 * (double)floats_at(floats, 0, y)[x]), <,
                0.5001);
    sp_frame_unref(&bytes);
    sp_frame_unref(&floats);
}

static void without_memory_pixels_stay(void **state) {
    struct sp_error err = { .code = SP_OK };
    struct rig *rig = *state;
    struct sp_budget *budget = sp_budget_create(1 << 10, NULL);
    struct sp_pool *pool = sp_pool_create(2, &err);
    struct sp_frame *frame = make(rig, 64, 64, SP_RGBA8), *before = make(rig, 64, 64, SP_RGBA8);
    struct sp_arena arena;
    fill(frame);
    fill(before);
    sp_arena_init(&arena);
    arena.budget = budget;
    assert_false(sp_antialias(frame, 1, &arena, pool, &err));
    assert_int_equal(err.code, SP_ERR_FRAME_BUDGET);
    assert_memory_equal(frame->pixels, before->pixels, 64 * frame->stride_bytes);
    sp_arena_finish(&arena);
    sp_pool_destroy(&pool);
    sp_frame_unref(&frame);
    sp_frame_unref(&before);
    sp_budget_destroy(&budget);
}

static int set_up(void **state) {
    static struct rig rig;
    rig.frames = sp_frame_pool_create(1 << 20, NULL);
    sp_arena_init(&rig.arena);
    *state = &rig;
    return rig.frames ? 0 : -1;
}

static int tear_down(void **state) {
    struct rig *rig = *state;
    sp_arena_finish(&rig->arena);
    sp_frame_pool_destroy(&rig->frames);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_point_becomes_the_kernel),
        cmocka_unit_test(slopes_and_borders_stay),
        cmocka_unit_test(transparent_pixels_have_no_colour),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(bytes_equal_floats),
        cmocka_unit_test(without_memory_pixels_stay),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
