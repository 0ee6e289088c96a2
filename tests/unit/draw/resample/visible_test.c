/* SPDX-License-Identifier: Apache-2.0
 *
 * Which intervals may be visible: samples of one byte, which have a path of their own, against the
 * same samples as 16 bits.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "draw/resample/ranges.h"
#include "draw/resample/visible.h"

enum { VOXELS = 31 * 14 * 18, REGIONS = 8 * 4 * 5 };

static void compute_visible(enum sp_type type, const void *voxels, unsigned axis, double value,
                            uint8_t *visible) {
    static float range[REGIONS][2];
    struct sp_samples s = { .voxels = voxels,
                            .type = type,
                            .dims = { 31, 14, 18 },
                            .regions = { 8, 4, 5 },
                            .range = range };
    struct sp_samples_class class = { .axis = axis, .visible = visible };
    class.tf.point_count = 3;
    class.tf.points[0].value = value;
    class.tf.points[1].value = value + 20;
    class.tf.points[1].opacity = 0.5f;
    class.tf.points[2].value = value + 40;
    struct sp_interrupt interrupt = { 0 };
    struct sp_pool *pool = sp_pool_create(1, NULL);
    assert_non_null(pool);
    sp_ranges_compute(&s, pool, &interrupt);
    assert_true(sp_samples_mark_visible(&s, &class, pool, &interrupt));
    sp_pool_destroy(&pool);
}

static void bytes_are_like_16_bits(void **state) {
    static int8_t bytes[VOXELS];
    static uint8_t unsigned_bytes[VOXELS];
    static int16_t wide[VOXELS];
    static uint16_t unsigned_wide[VOXELS];
    int parts = 0;
    (void)state;
    srand(3);
    for (int i = 0; i < VOXELS; i++) { /* smooth, so that some intervals show nothing */
        int value = 3 * (i % 31) + 4 * (i / 31 % 14) + 3 * (i / 31 / 14) + rand() % 12;
        unsigned_bytes[i] = (uint8_t)value;
        unsigned_wide[i] = (uint16_t)value;
        bytes[i] = (int8_t)(value - 128);
        wide[i] = (int16_t)(value - 128);
    }
    for (unsigned axis = 0; axis < 3; axis++)
        for (int value = 0; value < 220; value += 7) {
            uint8_t of_bytes[REGIONS], of_wide[REGIONS];
            compute_visible(SP_UINT8, unsigned_bytes, axis, value, of_bytes);
            compute_visible(SP_UINT16, unsigned_wide, axis, value, of_wide);
            assert_memory_equal(of_bytes, of_wide, sizeof of_wide);
            compute_visible(SP_INT8, bytes, axis, value - 128, of_bytes);
            compute_visible(SP_INT16, wide, axis, value - 128, of_wide);
            assert_memory_equal(of_bytes, of_wide, sizeof of_wide);
            for (int i = 0; i < REGIONS; i++)
                parts += of_wide[i] > 0 && of_wide[i] < 15;
        }
    assert_in_range(parts, 1000, 100000);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(bytes_are_like_16_bits) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
