/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "frame/fragments.h"
#include "support/compare.h"

static struct sp_fragment_tile *make_tile(void) {
    struct sp_fragment_tile *tile = malloc(sizeof *tile);
    assert_non_null(tile);
    sp_fragment_tile_clear(tile, 0, 0);
    return tile;
}

static void add(struct sp_fragment_tile *tile, int pixel, float depth, float red, float alpha) {
    sp_fragment_add(tile, pixel, &(struct sp_fragment){ depth, { red, 0, 0 }, alpha });
}

static void fragments_are_sorted(void **state) {
    (void)state;
    static const float depths[] = { 5, -2, 9, 5, 0.5f, 5 };
    struct sp_fragment_tile *tile = make_tile();
    for (int i = 0; i < 6; i++)
        add(tile, 7, depths[i], (float)i, 0.5f);
    add(tile, 7, 1, 1, 0); /* shows nothing */
    add(tile, 7, 1, 1, NAN);
    static const float order[] = { 1, 4, 0, 3, 5, 2 }; /* equal depths: the first one first */
    assert_int_equal(tile->count[7], 6);
    assert_int_equal(sp_fragment_tile_count(tile), 6);
    for (int i = 0; i < 6; i++)
        assert_float_equal(tile->list[7][i].color[0], order[i], 0);
    free(tile);
}

/* Composites all fragments of a pixel: their colour, and their transmittance in rgbt[3]. */
static void composite(const struct sp_fragment_tile *tile, int pixel, float rgbt[4]) {
    for (int c = 0; c < 4; c++)
        rgbt[c] = c == 3;
    for (int i = 0; i < tile->count[pixel]; i++)
        sp_fragment_over(&tile->list[pixel][i], rgbt);
}

enum { MANY = 3 * SP_FRAGMENTS_MAX };

static void add_fog(struct sp_fragment_tile *tile, int pixel, int at) {
    add(tile, pixel, (float)at, 0.1f * (float)(at % 3), 0.1f);
}

/* A full pixel shows what all of its fragments would show, whatever their order. */
static void a_full_pixel_merges_neighbours(void **state) {
    (void)state;
    struct sp_fragment_tile *tile = make_tile();
    float wanted[4] = { 0, 0, 0, 1 }, got[4];
    for (int i = 0; i < MANY; i++)
        sp_fragment_over(&(struct sp_fragment){ (float)i, { 0.1f * (float)(i % 3) }, 0.1f },
                         wanted);
    for (int i = 0; i < MANY; i++) {
        add_fog(tile, 0, i);
        add_fog(tile, 1, MANY - 1 - i);
    }
    for (int pixel = 0; pixel < 2; pixel++) {
        assert_int_equal(tile->count[pixel], SP_FRAGMENTS_MAX);
        for (int i = 1; i < SP_FRAGMENTS_MAX; i++)
            assert_compare(tile->list[pixel][i - 1].depth, <, tile->list[pixel][i].depth);
        composite(tile, pixel, got);
        assert_float_equal(got[0], wanted[0], 1e-6f);
        assert_float_equal(got[3], wanted[3], 1e-6f);
    }
    free(tile);
}

/* Fog that fills the pixel merges on both sides of a surface that is there already. */
static void merged_neighbours_leave_a_surface_in_its_place(void **state) {
    (void)state;
    struct sp_fragment_tile *tile = make_tile();
    float got[4];
    for (int place = 0; place < MANY; place++) {
        sp_fragment_tile_clear(tile, 0, 0);
        add(tile, 0, (float)place - 0.5f, 0, 1);
        for (int i = 0; i < MANY; i++)
            add(tile, 0, (float)i, 0.1f, 0.1f);
        composite(tile, 0, got);
        assert_float_equal(got[0], 1 - powf(0.9f, (float)place), 2e-3f);
    }
    /* Behind the surface nothing is seen, so that the fog before it keeps all other places. */
    for (int place = 0; place < SP_FRAGMENTS_MAX - 1; place++) {
        sp_fragment_tile_clear(tile, 0, 0);
        add(tile, 0, (float)place - 0.5f, 0, 1);
        for (int i = 0; i < MANY; i++)
            add(tile, 0, (float)i, 0.1f, 0.1f);
        for (int i = 0; i < place; i++)
            assert_float_equal(tile->list[0][i].depth, (float)i, 0);
    }
    free(tile);
}

static void stored_tiles_are_found(void **state) {
    (void)state;
    struct sp_fragment_tile *tile = make_tile();
    const struct sp_fragment *list;
    struct sp_arena arena;
    struct sp_fragments all;
    uint32_t count;
    sp_arena_init(&arena);
    assert_true(sp_fragments_init(&all, (const uint32_t[2]){ 70, 40 }, &arena));
    assert_int_equal(all.columns, 3);
    assert_int_equal(all.rows, 2);
    sp_fragment_tile_clear(tile, 64, 32);
    add(tile, 3 * SP_FRAGMENT_TILE + 5, 2, 0.25f, 0.5f);
    add(tile, 3 * SP_FRAGMENT_TILE + 5, 1, 0.75f, 0.5f);
    uint32_t first[SP_FRAGMENT_PIXELS + 1];
    struct sp_fragment stored[2];
    assert_int_equal(sp_fragment_tile_count(tile), 2);
    sp_fragments_store(&all, tile, first, stored);
    assert_null(sp_fragments_row(&all, 0, 0, &list));
    assert_null(sp_fragments_at(&all, 63, 35, &count));
    assert_int_equal(count, 0);
    const struct sp_fragment *found = sp_fragments_at(&all, 69, 35, &count);
    assert_int_equal(count, 2);
    assert_float_equal(found[0].color[0], 0.75f, 0);
    assert_float_equal(found[1].color[0], 0.25f, 0);
    const uint32_t *row = sp_fragments_row(&all, 64, 35, &list);
    assert_int_equal(row[5], 0);
    assert_int_equal(row[6], 2);
    assert_ptr_equal(list, stored);
    sp_arena_finish(&arena);
    free(tile);
}

struct filling {
    int calls, begin, end;
};

static bool fill(void *user, int begin, int end, struct sp_error *err) {
    struct filling *filling = user;
    (void)err;
    filling->calls++;
    filling->begin = begin;
    filling->end = end;
    return true;
}

static void a_large_image_has_a_band_of_fragments_at_a_time(void **state) {
    (void)state;
    struct filling filling = { 0 };
    struct sp_arena arena;
    struct sp_fragments all;
    sp_arena_init(&arena);
    assert_true(sp_fragments_init(&all, (const uint32_t[2]){ 320, 320 }, &arena));
    all.fill = fill;
    all.user = &filling;
    assert_int_equal(sp_fragments_rows(NULL, 64, 320), 320);
    assert_int_equal(sp_fragments_rows(&all, 64, 320), 320);
    assert_true(sp_fragments_ensure(&all, 0, 320, NULL));
    assert_int_equal(filling.calls, 0); /* all are there already */
    sp_fragments_limit(&all, 1);
    assert_int_equal(all.most, 1);
    assert_int_equal(sp_fragments_rows(&all, 32, 320), 32);
    assert_int_equal(sp_fragments_rows(&all, 96, 320), 96);
    sp_fragments_limit(&all, (size_t)5 * 10 * SP_FRAGMENT_PIXELS * 324);
    assert_int_equal(all.most, 5);
    assert_int_equal(sp_fragments_rows(&all, 32, 320), 160);
    assert_int_equal(sp_fragments_rows(&all, 64, 320), 128);
    assert_true(sp_fragments_ensure(&all, 128, 256, NULL));
    assert_int_equal(filling.begin, 4);
    assert_int_equal(filling.end, 8);
    assert_true(sp_fragments_ensure(&all, 130, 250, NULL));
    assert_int_equal(filling.calls, 1);
    assert_true(
        sp_fragments_ensure(&all, 256, 384, NULL)); /* the last tiles reach below the image */
    assert_int_equal(filling.begin, 8);
    assert_int_equal(filling.end, 10);
    assert_int_equal(filling.calls, 2);
    sp_arena_finish(&arena);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fragments_are_sorted),
        cmocka_unit_test(a_full_pixel_merges_neighbours),
        cmocka_unit_test(merged_neighbours_leave_a_surface_in_its_place),
        cmocka_unit_test(stored_tiles_are_found),
        cmocka_unit_test(a_large_image_has_a_band_of_fragments_at_a_time),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
