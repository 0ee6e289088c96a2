/* SPDX-License-Identifier: Apache-2.0
 *
 * Fingerprints: the same in every run, and different for everything that a frame shows.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <string.h>

#include "render/fingerprint.h"

static struct srv_fingerprint of_texts(const char *a, const char *b) {
    struct srv_piece parts[] = { { a, a ? strlen(a) : 0 }, { b, b ? strlen(b) : 0 } };
    return srv_fingerprint_of(parts, 2);
}

static void the_boundaries_of_parts_count(void **state) {
    (void)state;
    static const char *const texts[][2] = { { "ab", "c" },   { "a", "bc" }, { "abc", NULL },
                                            { NULL, "abc" }, { "c", "ab" }, { NULL, NULL } };
    enum { COUNT = sizeof texts / sizeof *texts };
    struct srv_fingerprint prints[COUNT];
    for (int i = 0; i < COUNT; i++) {
        prints[i] = of_texts(texts[i][0], texts[i][1]);
        for (int j = 0; j < i; j++)
            assert_false(srv_fingerprint_equal(&prints[i], &prints[j]));
        struct srv_fingerprint again = of_texts(texts[i][0], texts[i][1]);
        assert_true(srv_fingerprint_equal(&prints[i], &again));
    }
    struct srv_piece one = { "abc", 3 };
    struct srv_fingerprint alone = srv_fingerprint_of(&one, 1);
    assert_false(srv_fingerprint_equal(&alone, &prints[2]));
}

static void a_fingerprint_converts_to_text_and_back(void **state) {
    (void)state;
    char text[SRV_FINGERPRINT_TEXT];
    struct srv_fingerprint print = of_texts("splat", "d"), back;
    srv_fingerprint_encode(&print, text);
    assert_true(srv_fingerprint_decode(text, &back));
    assert_true(srv_fingerprint_equal(&print, &back));
    static const char *const wrong[] = { NULL,
                                         "",
                                         "0123456789abcdef0123456789abcde",
                                         "0123456789abcdef0123456789abcdef0",
                                         "0123456789abcdef0123456789abcdef ",
                                         "0123456789abcdef0123456789abcdeg",
                                         "0123456789ABCDEF0123456789abcdef",
                                         "-123456789abcdef0123456789abcdef",
                                         " 123456789abcdef0123456789abcdef" };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_false(srv_fingerprint_decode(wrong[i], &back));
}

enum { SIDE = 4, VOXELS = SIDE * SIDE * SIDE };
static const double places[2][SIDE] = { { 0, 1, 3, 4 }, { 0, 2, 3, 4 } };

static struct sp_grid grid_of(void) {
    struct sp_grid grid = { .dims = { SIDE, SIDE, SIDE }, .spacing = { 1, 1, 1 } };
    for (int a = 0; a < 3; a++)
        grid.direction[a][a] = 1;
    return grid;
}

static struct srv_fingerprint of_volume(const struct sp_grid *grid, enum sp_type type,
                                        const void *voxels, const char *name) {
    struct sp_error err;
    struct sp_volume *volume = sp_volume_create(grid, type, voxels, name, &err);
    if (!volume)
        fail_msg("%s: %s", err.place, err.text);
    struct srv_fingerprint print = srv_fingerprint_volume(volume);
    sp_volume_unref(&volume);
    return print;
}

/* The expected text is the same on every machine of this byte order. */
static void a_volume_has_the_same_fingerprint_in_every_run(void **state) {
    (void)state;
    char text[SRV_FINGERPRINT_TEXT];
    uint8_t voxels[VOXELS];
    struct sp_grid grid = grid_of();
    for (int i = 0; i < VOXELS; i++)
        voxels[i] = (uint8_t)i;
    struct srv_fingerprint print = of_volume(&grid, SP_UINT8, voxels, "a");
    srv_fingerprint_encode(&print, text);
    assert_string_equal(text, "bee123aa03cb9d6f97b4ffac40359038");
    struct srv_fingerprint other = of_volume(&grid, SP_UINT8, voxels, "another name");
    assert_true(srv_fingerprint_equal(&print, &other));
}

static void everything_that_a_frame_shows_counts(void **state) {
    (void)state;
    uint8_t voxels[VOXELS];
    struct sp_grid grids[9];
    struct srv_fingerprint prints[12];
    unsigned count = 0;
    memset(voxels, 5, sizeof voxels);
    for (int i = 0; i < 9; i++)
        grids[i] = grid_of();
    grids[1].dims[0] = 2 * SIDE; /* the same number of voxels */
    grids[1].dims[1] = SIDE / 2;
    grids[2].spacing[1] = 2;
    grids[3].origin[2] = 1;
    grids[4].direction[0][0] = -1;
    for (int i = 5; i < 9; i++) {
        int axis = i < 8 ? i - 5 : 0;
        grids[i].coordinates[axis] = places[i == 8];
        grids[i].spacing[axis] = places[0][SIDE - 1] / (SIDE - 1);
    }
    for (int i = 0; i < 9; i++)
        prints[count++] = of_volume(&grids[i], SP_UINT8, voxels, "a");
    prints[count++] = of_volume(&grids[0], SP_INT8, voxels, "a");
    voxels[0]++;
    prints[count++] = of_volume(&grids[0], SP_UINT8, voxels, "a");
    voxels[0]--;
    voxels[VOXELS - 1]++;
    prints[count++] = of_volume(&grids[0], SP_UINT8, voxels, "a");
    for (unsigned i = 0; i < count; i++)
        for (unsigned j = 0; j < i; j++)
            if (srv_fingerprint_equal(&prints[i], &prints[j]))
                fail_msg("fingerprints %u and %u are equal", i, j);
}

static void the_program_has_a_fingerprint(void **state) {
    (void)state;
    struct srv_fingerprint first = { 0, 0 }, second = { 1, 1 }, none = { 0, 0 };
    assert_true(srv_fingerprint_program(&first));
    assert_true(srv_fingerprint_program(&second));
    assert_true(srv_fingerprint_equal(&first, &second));
    assert_false(srv_fingerprint_equal(&first, &none));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_boundaries_of_parts_count),
        cmocka_unit_test(a_fingerprint_converts_to_text_and_back),
        cmocka_unit_test(a_volume_has_the_same_fingerprint_in_every_run),
        cmocka_unit_test(everything_that_a_frame_shows_counts),
        cmocka_unit_test(the_program_has_a_fingerprint),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
