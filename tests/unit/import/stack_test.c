/* SPDX-License-Identifier: Apache-2.0
 *
 * Stacks of images, as PNG files that this test writes with zlib.
 */
#include <byteswap.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "unit/import/support.h"

enum { NX = 6, NY = 5 };

struct bytes {
    uint8_t data[4096];
    size_t size;
};

static void add(struct bytes *b, const void *data, size_t size) {
    assert_true(b->size + size <= sizeof b->data);
    memcpy(b->data + b->size, data, size);
    b->size += size;
}

static void add_number(struct bytes *b, uint32_t number) {
    const uint32_t big = bswap_32(number);
    add(b, &big, sizeof big);
}

static void add_chunk(struct bytes *b, const char *kind, const void *data, size_t size) {
    const size_t at = b->size + 4;
    add_number(b, (uint32_t)size);
    add(b, kind, 4);
    add(b, data, size);
    add_number(b, (uint32_t)crc32(0, b->data + at, (uInt)(size + 4)));
}

/* Rows of width·channels·(bits / 8) bytes, big-endian. */
static void write_png(const char *name, uint32_t width, unsigned channels, unsigned bits,
                      const uint8_t *rows) {
    struct bytes png = { .size = 0 }, header = { .size = 0 }, raw = { .size = 0 };
    const size_t row = width * channels * bits / 8;
    uint8_t packed[4096];
    uLongf size = sizeof packed;
    add(&png, "\x89PNG\r\n\x1a\n", 8);
    add_number(&header, width);
    add_number(&header, NY);
    add(&header, (uint8_t[]){ (uint8_t)bits, channels == 3 ? 2 : 0, 0, 0, 0 }, 5);
    for (int y = 0; y < NY; y++) {
        add(&raw, "", 1); /* no filter */
        add(&raw, rows + (size_t)y * row, row);
    }
    assert_int_equal(compress(packed, &size, raw.data, raw.size), Z_OK);
    add_chunk(&png, "IHDR", header.data, header.size);
    add_chunk(&png, "IDAT", packed, size);
    add_chunk(&png, "IEND", "", 0);
    write_file(name, png.data, png.size);
}

/* Sample i of slice k. */
static uint8_t value(int k, int i) {
    return (uint8_t)(10 * k + i);
}

static void write_slice(const char *name, int k) {
    uint8_t rows[NX * NY];
    for (int i = 0; i < NX * NY; i++)
        rows[i] = value(k, i);
    write_png(name, NX, 1, 8, rows);
}

static void check(const char *name, uint32_t slices, const int *numbers) {
    struct sp_volume *volume = load(name);
    const uint8_t *samples = sp_volume_voxels(volume);
    assert_int_equal(sp_volume_info(volume)->grid.dims[0], NX);
    assert_int_equal(sp_volume_info(volume)->grid.dims[1], NY);
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], slices);
    for (uint32_t k = 0; k < slices; k++)
        for (int i = 0; i < NX * NY; i++)
            assert_int_equal(samples[k * NX * NY + (uint32_t)i], value(numbers[k], i));
    sp_volume_unref(&volume);
}

static void numbered_files_are_slices_in_the_order_of_their_numbers(void **state) {
    (void)state;
    write_slice("s10.png", 10);
    write_slice("s2.png", 2);
    write_slice("S9.PNG", 9);
    write_slice("other1.png", 1);
    write_slice("alone.png", 4);
    write_slice("s0011.png", 11);
    check("s2.png", 4, (const int[]){ 2, 9, 10, 11 });
    check("s10.png", 4, (const int[]){ 2, 9, 10, 11 });
    check("other1.png", 1, (const int[]){ 1 });
    check("alone.png", 1, (const int[]){ 4 });
}

static void deep_and_coloured_images_are_read(void **state) {
    (void)state;
    uint8_t rows[6 * NX * NY];
    for (int i = 0; i < 6 * NX * NY; i++)
        rows[i] = (uint8_t)i;
    write_png("deep.png", NX, 1, 16, rows);
    struct sp_volume *volume = load("deep.png");
    assert_int_equal(sp_volume_info(volume)->type, SP_UINT16);
    assert_int_equal(((const uint16_t *)sp_volume_voxels(volume))[3], 6 * 256 + 7);
    sp_volume_unref(&volume);
    write_png("rgb1.png", NX, 3, 8, rows);
    write_png("rgb2.png", NX, 3, 8, rows + 3);
    volume = load("rgb1.png?field=blue");
    const uint8_t *samples = sp_volume_voxels(volume);
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], 2);
    assert_string_equal(sp_volume_info(volume)->others[0], "red");
    assert_int_equal(samples[4], 14);
    assert_int_equal(samples[NX * NY + 4], 17);
    sp_volume_unref(&volume);
}

static void check_warning(const char *name, uint32_t slices, const char *words) {
    struct sp_volume *volume = load(name);
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], slices);
    assert_non_null(strstr(sp_volume_info(volume)->warnings[0], words));
    sp_volume_unref(&volume);
}

static void files_that_differ_are_left_out(void **state) {
    (void)state;
    uint8_t rows[2 * NX * NY] = { 0 };
    write_slice("w1.png", 1);
    write_png("w2.png", NX + 1, 1, 8, rows);
    check_warning("w1.png", 1, "w2.png (7 x 5 px of uint8");
    write_png("w2.png", NX, 1, 16, rows);
    check_warning("w1.png", 1, "w2.png (6 x 5 px of uint16");
    write_slice("w3.png", 3);
    check_warning("w1.png", 2, "1 of 3 numbered files were left out");
    check("w1.png", 2, (const int[]){ 1, 3 });
    check("w3.png?as=slice", 1, (const int[]){ 3 });
    write_text("w2.png", "no image");
    load_error("w1.png", SP_ERR_FORMAT, "w2.png", "neither PNG nor JPEG");
    load_error("w1.png", SP_ERR_FORMAT, "w2.png", "w1.png?as=slice opens that file alone");
    check("w1.png?as=slice", 1, (const int[]){ 1 });
    load_error("w1.png?as=stack", SP_ERR_INVALID, "w1.png", "channels, labels or slice");
    write_file("cut.png", "\x89PNG\r\n\x1a\n", 8);
    load_error("cut.png", SP_ERR_FORMAT, "cut.png", "");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(numbered_files_are_slices_in_the_order_of_their_numbers),
        cmocka_unit_test(deep_and_coloured_images_are_read),
        cmocka_unit_test(files_that_differ_are_left_out),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
