/* SPDX-License-Identifier: Apache-2.0
 *
 * Samples in blocks against the same samples in an array: what is read, the ranges of regions, and
 * which intervals are visible.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "data/volume/sample.h"
#include "draw/resample/ranges.h"
#include "draw/resample/visible.h"

enum { NX = 147, NY = 80, NZ = 70, COUNT = NX * NY * NZ, BX = 3, BY = 2, BZ = 2 };
enum { BLOCK = SP_BLOCK_SIDE * SP_BLOCK_SIDE * SP_BLOCK_SIDE, REGIONS = 37 * 20 * 18 };

static const uint32_t dims[3] = { NX, NY, NZ };

struct both {
    enum sp_type type;
    void *array;
    char *memory;
    struct sp_block block[BX * BY * BZ];
    struct sp_blocks blocks;
};

/* Smooth samples with noise; every third block has one value. */
static void fill(struct both *b, enum sp_type type) {
    const size_t size = sp_type_size(type);
    *b = (struct both){ .type = type };
    b->array = malloc(COUNT * size);
    b->memory = malloc(BX * BY * BZ * BLOCK * size);
    assert_non_null(b->array);
    assert_non_null(b->memory);
    b->blocks = (struct sp_blocks){ { NX, NY, NZ }, { BX, BY, BZ }, type, b->block, { 0 } };
    for (int i = 0; i < BX * BY * BZ; i++)
        b->block[i] = (struct sp_block){ b->memory + (size_t)i * BLOCK * size, i % 3 == 1 };
    srand(5);
    for (uint32_t i = 0; i < COUNT; i++) {
        const uint32_t x = i % NX, y = i / NX % NY, z = i / NX / NY;
        const uint32_t n = ((z >> 6) * BY + (y >> 6)) * BX + (x >> 6);
        const uint32_t inside = (((z & 63) << 6 | (y & 63)) << 6) | (x & 63);
        const double value = n % 3 == 1 ? 20 + n : (x % 64) * 0.7 + y * 0.4 + z * 0.3 + rand() % 6;
        sp_sample_set(b->array, type, i, (double)(int)value);
        sp_sample_set(b->memory, type, n * (uint64_t)BLOCK + (n % 3 == 1 ? 0 : inside),
                      (double)(int)value);
    }
}

static void finish(struct both *b) {
    free(b->array);
    free(b->memory);
}

static const enum sp_type types[] = { SP_UINT8, SP_INT8, SP_UINT16, SP_INT32, SP_FLOAT64 };
enum { TYPES = sizeof types / sizeof *types };

static void lines_are_those_of_the_array(void **state) {
    (void)state;
    for (int t = 0; t < TYPES; t++) {
        struct both b;
        fill(&b, types[t]);
        const size_t strides[3] = { 1, NX, NX * NY }, size = sp_type_size(b.type);
        for (int i = 0; i < 3000; i++) {
            const unsigned axis = (unsigned)i % 3;
            char line[NX * sizeof(double)];
            uint32_t at[3];
            for (int a = 0; a < 3; a++)
                at[a] = (uint32_t)rand() % dims[a];
            const size_t n = 1 + (size_t)rand() % (dims[axis] - at[axis]);
            sp_blocks_read(&b.blocks, axis, at, n, line);
            const size_t first = ((size_t)at[2] * NY + at[1]) * NX + at[0];
            for (size_t k = 0; k < n; k++)
                assert_memory_equal(line + k * size,
                                    (char *)b.array + (first + k * strides[axis]) * size, size);
        }
        finish(&b);
    }
}

static void compute_visible(const struct both *b, bool has_blocks, unsigned axis, float (*range)[2],
                            uint8_t *visible) {
    struct sp_samples s = { .voxels = has_blocks ? NULL : b->array,
                            .blocks = has_blocks ? &b->blocks : NULL,
                            .type = b->type,
                            .dims = { NX, NY, NZ },
                            .regions = { 37, 20, 18 },
                            .range = range };
    struct sp_samples_class class = { .axis = axis, .visible = visible };
    class.tf.point_count = 3;
    class.tf.points[0].value = 30;
    class.tf.points[1].value = 36;
    class.tf.points[1].opacity = 0.5f;
    class.tf.points[2].value = 42;
    struct sp_interrupt interrupt = { 0 };
    struct sp_pool *pool = sp_pool_create(1, NULL);
    assert_non_null(pool);
    sp_ranges_compute(&s, pool, &interrupt);
    assert_true(sp_samples_mark_visible(&s, &class, pool, &interrupt));
    sp_pool_destroy(&pool);
}

static void ranges_and_intervals_are_those_of_the_array(void **state) {
    static float want[REGIONS][2], got[REGIONS][2];
    static uint8_t shown[REGIONS], seen[REGIONS];
    int parts = 0;
    (void)state;
    for (int t = 0; t < TYPES; t++) {
        struct both b;
        fill(&b, types[t]);
        for (unsigned axis = 0; axis < 3; axis++) {
            compute_visible(&b, false, axis, want, shown);
            compute_visible(&b, true, axis, got, seen);
            assert_memory_equal(want, got, sizeof want);
            assert_memory_equal(shown, seen, sizeof shown);
        }
        for (int i = 0; i < REGIONS; i++)
            parts += shown[i] > 0 && shown[i] < 15;
        finish(&b);
    }
    assert_in_range(parts, 100, TYPES * REGIONS);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lines_are_those_of_the_array),
        cmocka_unit_test(ranges_and_intervals_are_those_of_the_array),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
