/* SPDX-License-Identifier: Apache-2.0
 *
 * Numbers of files: every kind becomes the sample that memory holds, and the loss is told.
 */
#include <math.h>
#include <string.h>

#include "data/import/conversion.h"
#include "unit/data/import/support.h"

static void halves_are_widened_and_narrowed(void **state) {
    (void)state;
    static const struct {
        uint16_t half;
        double value;
    } cases[] = {
        { 0x0000, 0 },         { 0x3c00, 1 },         { 0xc000, -2 },         { 0x7bff, 65504 },
        { 0x0400, 0x1p-14 },   { 0x0001, 0x1p-24 },   { 0x03ff, 0x3ffp-24 },  { 0x7c00, INFINITY },
        { 0xfc00, -INFINITY }, { 0x3555, 0x555p-12 }, { 0xb555, -0x555p-12 },
    };
    const struct import_number half = { IMPORT_FLOAT, 2 };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        uint16_t back;
        assert_compare(import_widen(&cases[i].half, half), ==, cases[i].value);
        import_narrow(cases[i].value, half, &back);
        assert_int_equal(back, cases[i].half);
    }
    const uint16_t nan = 0x7e01;
    assert_true(isnan(import_widen(&nan, half)));
    uint16_t out;
    import_narrow(65520, half, &out); /* rounds to infinity */
    assert_int_equal(out, 0x7c00);
    import_narrow(65519, half, &out);
    assert_int_equal(out, 0x7bff);
    import_narrow(1 + 0x1p-11, half, &out); /* to even */
    assert_int_equal(out, 0x3c00);
}

static void bits_are_unpacked_in_both_orders(void **state) {
    (void)state;
    static const uint8_t packed[] = { 0xa5, 0x0f, 0x80 };
    uint8_t out[16];
    import_bits_unpack(packed, 1, true, 0, 9, out);
    assert_memory_equal(out, ((uint8_t[]){ 1, 0, 1, 0, 0, 1, 0, 1, 0 }), 9);
    import_bits_unpack(packed, 1, false, 8, 8, out);
    assert_memory_equal(out, ((uint8_t[]){ 1, 1, 1, 1, 0, 0, 0, 0 }), 8);
    uint16_t wide[2];
    import_bits_unpack(packed, 12, true, 0, 2, wide);
    assert_int_equal(wide[0], 0xa50);
    assert_int_equal(wide[1], 0xf80);
    assert_int_equal(import_bits_number(12).size, 2);
}

static void complex_numbers_become_their_magnitude(void **state) {
    (void)state;
    struct import_warnings warnings = { .count = 0 };
    const float numbers[4] = { 3, -4, 0, 2 };
    const struct import_conversion c =
        import_conversion_of((struct import_number){ IMPORT_COMPLEX, 8 }, &warnings);
    float out[2];
    assert_int_equal(c.type, SP_FLOAT32);
    assert_int_equal(warnings.count, 1);
    import_conversion_put(&c, numbers, 2, out);
    assert_compare(out[0], ==, 5);
    assert_compare(out[1], ==, 2);
}

static void wide_integers_warn_only_if_they_are_rounded(void **state) {
    (void)state;
    struct import_warnings warnings = { .count = 0 };
    const int64_t exact[3] = { INT64_C(1) << 60, -(INT64_C(1) << 53), 7 };
    const int64_t rounded[1] = { (INT64_C(1) << 53) + 1 };
    const uint64_t largest[1] = { UINT64_MAX };
    const struct import_conversion c =
        import_conversion_of((struct import_number){ IMPORT_SIGNED, 8 }, &warnings);
    double out[3];
    assert_int_equal(c.type, SP_FLOAT64);
    import_conversion_put(&c, exact, 3, out);
    assert_int_equal(warnings.count, 0);
    assert_compare(out[0], ==, 0x1p60);
    import_conversion_put(&c, rounded, 1, out);
    assert_int_equal(warnings.count, 1);
    warnings.count = 0;
    const struct import_conversion u =
        import_conversion_of((struct import_number){ IMPORT_UNSIGNED, 8 }, &warnings);
    import_conversion_put(&u, largest, 1, out);
    assert_int_equal(warnings.count, 1);
}

/* float32 would lose the difference between neighbours. */
static void a_large_offset_needs_float64(void **state) {
    static const struct {
        double slope, offset;
        enum sp_type type;
    } cases[] = { { 0.01, 5, SP_FLOAT32 },
                  { 0.01, -20000, SP_FLOAT64 },
                  { 1e-4, 1e-3, SP_FLOAT32 },
                  { 1e-4, 1000, SP_FLOAT64 } };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct import_conversion c =
            import_conversion_of((struct import_number){ IMPORT_UNSIGNED, 2 }, NULL);
        c.slope = cases[i].slope;
        c.offset = cases[i].offset;
        import_conversion_choose(&c, 0, UINT16_MAX);
        assert_int_equal(c.type, cases[i].type);
    }
    struct import_conversion c =
        import_conversion_of((struct import_number){ IMPORT_UNSIGNED, 2 }, NULL);
    c.offset = 1e9;
    import_conversion_choose(&c, 0, UINT16_MAX);
    assert_int_equal(c.type, SP_INT32);
    import_conversion_add_missing(&c, 0);
    assert_int_equal(c.type, SP_FLOAT64);
}

static void missing_numbers_become_nan(void **state) {
    (void)state;
    const int16_t numbers[5] = { 1, -9999, 7, 100, -5 };
    struct import_conversion c =
        import_conversion_of((struct import_number){ IMPORT_SIGNED, 2 }, NULL);
    float out[5];
    assert_int_equal(c.type, SP_INT16);
    assert_true(import_conversion_is_copy(&c));
    import_conversion_add_missing(&c, -9999);
    import_conversion_add_missing(&c, 7);
    import_conversion_set_range(&c, -9999, 50);
    c.slope = 2;
    assert_int_equal(c.type, SP_FLOAT32);
    assert_false(import_conversion_is_copy(&c));
    import_conversion_put(&c, numbers, 5, out);
    assert_compare(out[0], ==, 2);
    assert_true(isnan(out[1]) && isnan(out[2]) && isnan(out[3]));
    assert_compare(out[4], ==, -10);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(halves_are_widened_and_narrowed),
        cmocka_unit_test(bits_are_unpacked_in_both_orders),
        cmocka_unit_test(complex_numbers_become_their_magnitude),
        cmocka_unit_test(a_large_offset_needs_float64),
        cmocka_unit_test(missing_numbers_become_nan),
        cmocka_unit_test(wide_integers_warn_only_if_they_are_rounded),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
