/* SPDX-License-Identifier: Apache-2.0
 *
 * Encoding when memory runs out, and the buffers that an encoder reuses.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "encode/encoder.h"
#include "support/compare.h"
#include "support/fake_memory.h"

enum { SIDE = 512, QUALITY = 100 };

/* Noise: no format compresses it, so files outgrow the initial capacity. */
static struct sp_frame noise(bool opaque) {
    struct sp_frame frame = {
        .width = SIDE, .height = SIDE, .format = SP_RGBA8, .stride_bytes = 4 * SIDE
    };
    uint32_t state = 1, pixel;
    uint8_t *out = frame.pixels = malloc(4 * SIDE * SIDE);
    assert_non_null(out);
    for (int i = 0; i < SIDE * SIDE; i++, out += 4) {
        state = state * 1664525 + 1013904223;
        pixel = state >> 8 | (opaque ? 0xff000000 : state << 24);
        memcpy(out, &pixel, sizeof pixel);
    }
    return frame;
}

static void encoding_is_correct_after_an_allocation_failure(void **state) {
    (void)state;
    static const struct {
        enum sp_image_format format;
        long failures; /* minimum number of allocations: the encoder, its buffers and their users */
    } cases[] = { { SP_IMAGE_JPEG, 2 },
                  { SP_IMAGE_PNG, 9 }, /* with the library's own */
                  { SP_IMAGE_WEBP, 3 },
                  { SP_IMAGE_EXR, 3 } };
    struct sp_frame frame = noise(true);
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++)
        for (int end = MEMORY_FAILS_ONCE; end <= MEMORY_STAYS_OUT; end++) {
            struct sp_encoder *whole = sp_encoder_create(NULL);
            const uint8_t *want, *got;
            size_t want_size, got_size;
            long n = 0;
            bool failed = true;
            assert_true(
                sp_encode(whole, &frame, cases[c].format, QUALITY, &want, &want_size, NULL));
            for (; failed; n++) {
                struct sp_error err = { 0 };
                memory_fail_after(n, (enum memory_end)end);
                struct sp_encoder *encoder = sp_encoder_create(&err);
                bool ok = encoder && sp_encode(encoder, &frame, cases[c].format, QUALITY, &got,
                                               &got_size, &err);
                failed = memory_restore();
                assert_int_equal(ok, !failed);
                if (failed) {
                    assert_int_equal(err.code, SP_ERR_MEMORY);
                    assert_memory_equal(err.text, "out of memory", 13);
                }
                if (encoder) { /* an encoder is usable after a failure */
                    assert_true(sp_encode(encoder, &frame, cases[c].format, QUALITY, &got,
                                          &got_size, NULL));
                    assert_int_equal(got_size, want_size);
                    assert_memory_equal(got, want, want_size);
                }
                sp_encoder_destroy(&encoder);
            }
            assert_in_range(n - 1, cases[c].failures, 60);
            sp_encoder_destroy(&whole);
        }
    free(frame.pixels);
}

/* Only the first image allocates a block of the size of the file; the second one reuses it. */
static void the_second_image_reuses_the_buffers(void **state) {
    (void)state;
    for (int opaque = 0; opaque < 2; opaque++) {
        struct sp_frame frame = noise(opaque);
        for (int f = 0; f < SP_IMAGE_FORMAT_COUNT; f++) {
            struct sp_encoder *encoder = sp_encoder_create(NULL);
            const uint8_t *bytes;
            size_t size;
            for (int i = 0; i < 2; i++) {
                memory_consume_largest();
                assert_true(sp_encode(encoder, &frame, (enum sp_image_format)f, QUALITY, &bytes,
                                      &size, NULL));
                assert_compare((memory_consume_largest() >= size), ==, (i == 0));
            }
            sp_encoder_destroy(&encoder);
        }
        free(frame.pixels);
    }
}

static void a_buffer_grows_and_shrinks_if_it_is_8_times_too_large(void **state) {
    (void)state;
    enum { PIECES = 1000, LARGE = 256 << 20 };
    struct sp_buffer buffer = { 0 };
    for (int i = 0; i < PIECES; i++)
        assert_true(sp_buffer_append(&buffer, (const char[]){ (char)i, (char)(i >> 8) }, 2));
    assert_int_equal(buffer.size, 2 * PIECES);
    for (int i = 0; i < PIECES; i++)
        assert_memory_equal(buffer.bytes + 2 * i, ((const char[]){ (char)i, (char)(i >> 8) }), 2);
    memory_fail_after(0, MEMORY_FAILS_ONCE);
    static const uint8_t more[4 * PIECES];
    assert_false(sp_buffer_append(&buffer, more, sizeof more));
    assert_true(memory_restore());
    assert_int_equal(buffer.size, 2 * PIECES);
    assert_int_equal(buffer.bytes[2], 1);

    assert_true(sp_buffer_reserve(&buffer, LARGE, NULL));
    assert_compare(buffer.size, ==, 0);
    assert_compare(buffer.capacity, ==, LARGE);
    assert_true(sp_buffer_reserve(&buffer, LARGE / 8, NULL));
    assert_compare(buffer.capacity, ==, LARGE);
    assert_true(sp_buffer_reserve(&buffer, LARGE / 8 - 1, NULL));
    assert_compare(buffer.capacity, ==, LARGE / 8 - 1);
    free(buffer.bytes);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(encoding_is_correct_after_an_allocation_failure),
        cmocka_unit_test(the_second_image_reuses_the_buffers),
        cmocka_unit_test(a_buffer_grows_and_shrinks_if_it_is_8_times_too_large),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
