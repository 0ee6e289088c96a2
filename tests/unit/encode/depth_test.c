/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "sp/encode.h"
#include "support/compare.h"
#include "unit/encode/read_image.h"

enum { WIDTH = 15, HEIGHT = 10, STRIDE = 64, COLUMNS = 4, ROWS = 3 };

struct fixture {
    struct sp_frame frame;
    struct sp_depth_image image;
    struct decoded_image pixels;
};

/* A frame that shows nothing. */
static int set_up(void **state) {
    struct fixture *f = calloc(1, sizeof *f);
    assert_non_null(f);
    f->frame = (struct sp_frame){ .width = WIDTH, .height = HEIGHT, .depth_stride_bytes = STRIDE };
    f->frame.depth = aligned_alloc(64, STRIDE * HEIGHT);
    f->frame.spread = aligned_alloc(64, STRIDE * HEIGHT);
    assert_true(f->frame.depth && f->frame.spread);
    for (int i = 0; i < STRIDE / 4 * HEIGHT; i++) {
        f->frame.depth[i] = INFINITY;
        f->frame.spread[i] = 0;
    }
    *state = f;
    return 0;
}

static int tear_down(void **state) {
    struct fixture *f = *state;
    free(f->pixels.pixels);
    free(f->frame.depth);
    free(f->frame.spread);
    free(f);
    return 0;
}

static void put(struct fixture *f, uint32_t x, uint32_t y, float depth, float spread) {
    f->frame.depth[y * STRIDE / 4 + x] = depth;
    f->frame.spread[y * STRIDE / 4 + x] = spread;
}

static void encode(struct fixture *f, enum sp_projection projection) {
    struct sp_error err = { .code = SP_OK };
    struct sp_encoder *encoder = sp_encoder_create(&err);
    if (!sp_encode_depth(encoder, &f->frame, projection, &f->image, &err))
        fail_msg("%s", err.text);
    assert_true(read_image(".png", f->image.bytes, f->image.byte_count, &f->pixels));
    sp_encoder_destroy(&encoder);
    assert_int_equal(f->image.cells[0], COLUMNS);
    assert_int_equal(f->image.cells[1], ROWS);
    assert_int_equal(f->pixels.width, COLUMNS);
    assert_int_equal(f->pixels.height, 2 * ROWS);
    assert_int_equal(f->pixels.channels, 1);
}

static int value_at(const struct fixture *f, int column, int row) {
    return (int)lrintf(255 * f->pixels.pixels[row * COLUMNS + column]);
}

static int spread_at(const struct fixture *f, int column, int row) {
    return value_at(f, column, ROWS + row);
}

static void a_frame_that_shows_nothing_has_no_depths(void **state) {
    struct fixture *f = *state;
    struct sp_error err = { .code = SP_OK };
    struct sp_encoder *encoder = sp_encoder_create(&err);
    f->image.byte_count = 1;
    assert_true(sp_encode_depth(encoder, &f->frame, SP_PERSPECTIVE, &f->image, &err));
    assert_int_equal(f->image.byte_count, 0);
    assert_true(f->image.near == 0 && f->image.far == 0);
    sp_encoder_destroy(&encoder);
}

/* Steps are equal in 1 / depth, and in depth. */
static void depths_are_spread_over_all_values(void **state) {
    struct fixture *f = *state;
    static const float depths[COLUMNS] = { 2, 3, 7, 10 };
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x++)
            put(f, x, y, depths[x / 4], x / 4 == 1 ? 1.5f : 0);
    encode(f, SP_PERSPECTIVE);
    assert_true(fabsf(f->image.near - 2) < 1e-5f && fabsf(f->image.far - 10) < 1e-5f);
    for (int i = 0; i < COLUMNS; i++) {
        const float part = (1 / depths[i] - 0.1f) / (0.5f - 0.1f);
        assert_int_equal(value_at(f, i, 1), lrintf(1 + 254 * part));
        assert_int_equal(spread_at(f, i, 1), i == 1 ? 32 : 0);
    }
    free(f->pixels.pixels);
    encode(f, SP_ORTHOGRAPHIC);
    for (int i = 0; i < COLUMNS; i++)
        assert_int_equal(value_at(f, i, 1), lrintf(1 + 254 * (10 - depths[i]) / 8));
}

/* Depths in front of the eye's plane and behind it are both possible without perspective. */
static void orthographic_depths_may_be_negative(void **state) {
    struct fixture *f = *state;
    put(f, 0, 0, -3, 0);
    put(f, 14, 9, 5, 0);
    encode(f, SP_ORTHOGRAPHIC);
    assert_true(f->image.near == -3 && f->image.far == 5);
    assert_int_equal(value_at(f, 0, 0), 255);
    assert_int_equal(value_at(f, 3, 2), 1);
    assert_int_equal(value_at(f, 1, 1), 0);
}

static void the_nearer_of_two_surfaces_counts(void **state) {
    struct fixture *f = *state;
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x++)
            put(f, x, y, x < 5 ? 2 : 10, x < 5 ? 0 : 4);
    encode(f, SP_PERSPECTIVE); /* one column of the second cell shows the nearer surface */
    assert_int_equal(value_at(f, 1, 0), 255);
    assert_int_equal(spread_at(f, 1, 0), 0);
    assert_int_equal(value_at(f, 2, 0), 1);
    assert_int_equal(spread_at(f, 2, 0), 96);
}

static void depths_of_one_surface_are_averaged(void **state) {
    struct fixture *f = *state;
    for (uint32_t x = 0; x < WIDTH; x++)
        put(f, x, 0, x < 2 ? 4 : x < 4 ? 4.1f : x < 8 ? 2 : 10, 0);
    encode(f, SP_PERSPECTIVE);
    const float part = ((1 / 4.0f + 1 / 4.1f) / 2 - 0.1f) / 0.4f;
    assert_int_equal(value_at(f, 0, 0), lrintf(1 + 254 * part));
}

static void a_single_depth_is_near_and_far(void **state) {
    struct fixture *f = *state;
    put(f, 7, 5, 6, 1);
    encode(f, SP_PERSPECTIVE);
    assert_true(fabsf(f->image.near - 6) < 1e-5f && f->image.far == f->image.near);
    assert_int_equal(value_at(f, 1, 1), 255);
    assert_int_equal(value_at(f, 0, 0), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_frame_that_shows_nothing_has_no_depths, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(depths_are_spread_over_all_values, set_up, tear_down),
        cmocka_unit_test_setup_teardown(orthographic_depths_may_be_negative, set_up, tear_down),
        cmocka_unit_test_setup_teardown(the_nearer_of_two_surfaces_counts, set_up, tear_down),
        cmocka_unit_test_setup_teardown(depths_of_one_surface_are_averaged, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_single_depth_is_near_and_far, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
