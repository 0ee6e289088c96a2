/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <string.h>

#include "encode/encoder.h"

static uint32_t read_u32(const uint8_t *bytes) {
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

/* The file has exactly these chunks, which declare the colours as sRGB. */
static void png_files_have_the_expected_chunks(void **state) {
    (void)state;
    static const uint32_t pixels[16] = { 0xff302010 };
    const struct sp_raster raster = {
        .pixels = pixels, .width = 4, .height = 4, .stride = 16, .is_opaque = true
    };
    struct sp_encoder *encoder = sp_encoder_create(NULL);
    assert_true(sp_encode_png(encoder, &raster, NULL));
    const uint8_t *bytes = encoder->output.bytes;
    size_t at = 8, size = encoder->output.size;
    assert_memory_equal(bytes, "\x89PNG\r\n\x1a\n", 8);
    static const struct {
        const char *type, *data;
        uint32_t size; /* of the compared data */
    } chunks[] = { { "IHDR", "\0\0\0\4\0\0\0\4\10\2\0\0\0", 13 },
                   { "sRGB", "\0", 1 },
                   { "tEXt", "Software\0splatd " SPLATD_VERSION, 16 + sizeof SPLATD_VERSION - 1 },
                   { "IDAT", "", 0 },
                   { "IEND", "", 0 } };
    for (size_t i = 0; i < sizeof chunks / sizeof *chunks; i++) {
        assert_in_range(at, 8, size - 12);
        uint32_t length = read_u32(bytes + at);
        assert_memory_equal(bytes + at + 4, chunks[i].type, 4);
        if (i != 3)
            assert_int_equal(length, chunks[i].size);
        assert_memory_equal(bytes + at + 8, chunks[i].data, chunks[i].size);
        at += 12 + length;
    }
    assert_int_equal(at, size);
    sp_encoder_destroy(&encoder);
}

static void the_encoder_is_usable_after_an_error_of_the_library(void **state) {
    (void)state;
    static const uint32_t pixels[4];
    struct sp_raster raster = { .pixels = pixels, .width = 2000000, .height = 1, .stride = 16 };
    struct sp_encoder *encoder = sp_encoder_create(NULL);
    struct sp_error err = { 0 };
    assert_false(sp_encode_png(encoder, &raster, &err));
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_string_equal(err.text, "cannot encode 2000000 × 1 as png: Invalid IHDR data");
    raster.width = 4;
    assert_true(sp_encode_png(encoder, &raster, &err));
    sp_encoder_destroy(&encoder);
}

static void a_webp_that_is_too_large_is_an_error(void **state) {
    (void)state;
    static const uint32_t pixels[16384];
    struct sp_raster raster = {
        .pixels = pixels, .width = 16384, .height = 1, .stride = sizeof pixels
    };
    struct sp_encoder *encoder = sp_encoder_create(NULL);
    struct sp_error err = { 0 };
    assert_false(sp_encode_webp(encoder, &raster, 80, &err));
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_non_null(strstr(err.text, "cannot encode 16384 × 1 as webp: "));
    raster.width = 16383;
    assert_true(sp_encode_webp(encoder, &raster, 80, &err));
    sp_encoder_destroy(&encoder);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(png_files_have_the_expected_chunks),
        cmocka_unit_test(the_encoder_is_usable_after_an_error_of_the_library),
        cmocka_unit_test(a_webp_that_is_too_large_is_an_error),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
