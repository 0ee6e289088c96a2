/* SPDX-License-Identifier: Apache-2.0
 *
 * The depth of a frame in image files: EXR has it, as Z and Z.spread; other formats do not.
 */
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

enum { WIDTH = 33, HEIGHT = 21, STRIDE = 48 /* floats per row */ };

static struct decoded_image encode_and_read(const struct sp_frame *frame,
                                            enum sp_image_format format) {
    struct sp_error err = { 0 };
    struct sp_encoder *encoder = sp_encoder_create(&err);
    const uint8_t *bytes;
    size_t size;
    struct decoded_image image;
    if (!sp_encode(encoder, frame, format, 80, &bytes, &size, &err))
        fail_msg("%s: %s", err.place, err.text);
    assert_true(read_image(sp_image_format_info(format)->extension, bytes, size, &image));
    sp_encoder_destroy(&encoder);
    return image;
}

static void exr_alone_has_the_depth(void **state) {
    static uint8_t pixels[HEIGHT][STRIDE][4];
    static float planes[2][HEIGHT][STRIDE];
    const struct sp_frame frame = { .width = WIDTH,
                                    .height = HEIGHT,
                                    .format = SP_RGBA8,
                                    .stride_bytes = sizeof pixels[0],
                                    .pixels = pixels,
                                    .depth = planes[0][0],
                                    .spread = planes[1][0],
                                    .depth_stride_bytes = sizeof planes[0][0] };
    (void)state;
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            for (int c = 0; c < 4; c++)
                pixels[y][x][c] = c == 3 ? 255 : (uint8_t)(7 * x + 5 * y + c);
            planes[0][y][x] = x % 5 ? (float)(x * 100 + y) / 7919.0f - 0.1f : INFINITY;
            planes[1][y][x] = (float)(y * 100 + x) / 7919.0f;
        }
    struct decoded_image image = encode_and_read(&frame, SP_IMAGE_EXR);
    assert_int_equal(image.channels, 6);
    assert_string_equal(image.names[3], "A");
    assert_string_equal(image.names[4], "Z");
    assert_string_equal(image.names[5], "Z.spread");
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const float *px = image.pixels + (y * WIDTH + x) * 6;
            assert_compare(px[0], ==, pixels[y][x][0] / 255.0f);
            for (int c = 0; c < 2; c++)
                assert_compare(px[4 + c], ==, planes[c][y][x]);
        }
    free(image.pixels);
    for (int format = 0; format < SP_IMAGE_EXR; format++) {
        image = encode_and_read(&frame, (enum sp_image_format)format);
        assert_int_equal(image.channels, 3);
        free(image.pixels);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(exr_alone_has_the_depth) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
