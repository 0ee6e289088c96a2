/* SPDX-License-Identifier: Apache-2.0
 *
 * Stacks of images, as PNG files that this test writes with zlib.
 */
#include <byteswap.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <zlib.h>

#include "unit/data/import/support.h"

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
    check_warning("w1.png", 1, "w2.png (7 × 5 px of uint8");
    write_png("w2.png", NX, 1, 16, rows);
    check_warning("w1.png", 1, "w2.png (6 × 5 px of uint16");
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

/* A slice as TIFF, which loads faster than PNG. `format` has the numbers a and b. */
static void write_tiff(const char *format, int a, int b, int k) {
    const uint16_t tags[][2] = { { 256, NX }, { 257, NY }, { 258, 8 },  { 259, 1 },      { 262, 1 },
                                 { 273, 8 },  { 277, 1 },  { 278, NY }, { 279, NX * NY } };
    enum { TAGS = sizeof tags / sizeof *tags };
    struct bytes tiff = { .size = 0 };
    char name[64];
    add(&tiff, "II*\0", 4);
    add(&tiff, (uint32_t[]){ 8 + NX * NY }, 4);
    for (int i = 0; i < NX * NY; i++)
        add(&tiff, (uint8_t[]){ value(k, i) }, 1);
    add(&tiff, (uint16_t[]){ TAGS }, 2);
    for (size_t i = 0; i < TAGS; i++) {
        add(&tiff, (uint16_t[]){ tags[i][0], 4 }, 4);
        add(&tiff, (uint32_t[]){ 1, tags[i][1] }, 8);
    }
    add(&tiff, (uint32_t[]){ 0 }, 4);
    snprintf(name, sizeof name, format, a, b);
    write_file(name, tiff.data, tiff.size);
}

/* The step has the slices `first`, `first` + 1 … A warning has `words`; "" = there is none. */
static struct sp_volume *check_step(const char *name, uint32_t step, uint32_t steps,
                                    uint32_t slices, uint32_t first, const char *words) {
    struct sp_volume *volume = load_step(name, step);
    const struct sp_volume_info *info = sp_volume_info(volume);
    const uint8_t *samples = sp_volume_voxels(volume);
    assert_int_equal(info->steps.count, steps);
    assert_int_equal(info->grid.dims[2], slices);
    for (uint32_t k = 0; k < slices; k++)
        assert_int_equal(samples[k * NX * NY], value((int)(first + k), 0));
    if (!words[0] || !strstr(info->warnings[0], words))
        assert_string_equal(info->warnings[0], words);
    return volume;
}

static void check_slices(const char *name, uint32_t slices, uint32_t first, const char *words) {
    struct sp_volume *volume = check_step(name, 0, 1, slices, first, words);
    sp_volume_unref(&volume);
}

/* "t" makes steps and "c" channels, of the folder and of each file. */
static void words_before_numbers_tell_times_and_channels(void **state) {
    (void)state;
    assert_int_equal(mkdir(in_folder("tz"), 0700), 0);
    assert_int_equal(mkdir(in_folder("cz"), 0700), 0);
    for (int t = 0; t < 3; t++)
        for (int z = 0; z < 4; z++)
            write_tiff("tz/img_t%03d_z%03d.tif", t, z, 5 * t + z);
    for (int c = 1; c < 3; c++)
        for (int z = 0; z < 4; z++)
            write_tiff("cz/Img%d-C%d.tif", z, c, 6 * c + z);
    struct sp_volume *volume = check_step("tz", 2, 3, 4, 10, "");
    assert_compare(fabs(sp_volume_info(volume)->steps.times[2] - 2), <, 1e-9);
    sp_volume_unref(&volume);
    volume = check_step("tz/img_t002_z001.tif", 1, 3, 4, 5, "");
    sp_volume_unref(&volume);
    volume = check_step("tz/img_t*_z*.tif", 2, 3, 4, 10, "");
    sp_volume_unref(&volume);
    volume = load("tz/img_t002_z001.tif"); /* the step of the file */
    assert_int_equal(sp_volume_info(volume)->steps.index, 2);
    assert_int_equal(*(const uint8_t *)sp_volume_voxels(volume), value(10, 0));
    sp_volume_unref(&volume);
    check_slices("cz?field=channel 2", 4, 12, "");
    check_slices("cz", 4, 6, "");
    check_slices("cz/Img2-C2.tif?field=channel 1", 4, 6, "");
    volume = check_step("cz/Img2-C2.tif", 0, 1, 4, 12, "");
    assert_string_equal(sp_volume_info(volume)->value_name, "channel 2");
    assert_string_equal(sp_volume_info(volume)->others[0], "channel 1");
    sp_volume_unref(&volume);
}

/* Files that are volumes of their own are left out with a warning. */
static void other_numbers_are_not_mixed(void **state) {
    (void)state;
    assert_int_equal(mkdir(in_folder("wells"), 0700), 0);
    assert_int_equal(mkdir(in_folder("two"), 0700), 0);
    for (int well = 1; well < 3; well++)
        for (int w = 1; w < 3; w++)
            write_tiff("wells/A%02d_w%d.tif", well, w, 5 * well + w);
    check_slices("wells", 1, 6, "2 numbered files were left out, such as A02_w1.tif");
    check_slices("wells/A02_w1.tif?field=channel 2", 1, 12, "such as A01_w1.tif");
    for (int a = 0; a < 2; a++)
        for (int b = 0; b < 3; b++)
            write_tiff("two/%d-%d.tif", a, b, 3 * a + b);
    check_slices("two", 6, 0, "nothing tells what they mean");
}

static void a_source_may_say_what_the_numbers_are(void **state) {
    (void)state;
    assert_int_equal(mkdir(in_folder("as"), 0700), 0);
    assert_int_equal(mkdir(in_folder("gap"), 0700), 0);
    for (int t = 0; t < 3; t++)
        write_tiff("as/v%d_t%d.tif", 7, t, t);
    check_slices("as", 3, 0, "?as=time and ?as=channels");
    struct sp_volume *volume = check_step("as?as=time", 2, 3, 1, 2, "");
    sp_volume_unref(&volume);
    check_slices("as/v7_t1.tif?as=channels&field=channel 2", 1, 2, "");
    for (int k = 0; k < 4; k++)
        write_tiff("gap/im%d_%d.tif", 7, k < 2 ? k : k + 5, k);
    check_slices("gap", 4, 0, "1 gap, such as that from 1 to 7");
}

static void a_folder_names_what_it_does_not_show(void **state) {
    (void)state;
    assert_int_equal(mkdir(in_folder("mix"), 0700), 0);
    for (int k = 0; k < 3; k++) {
        write_tiff("mix/a%d_%d.tif", 7, k, k);
        write_tiff("mix/b%d_%d.tif", 7, k, 5 + k);
    }
    write_text("mix/notes.txt", "no volume");
    check_slices("mix", 3, 0, "3 other files that can be opened, such as b7_0.tif; a7_0.tif and");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(numbered_files_are_slices_in_the_order_of_their_numbers),
        cmocka_unit_test(deep_and_coloured_images_are_read),
        cmocka_unit_test(files_that_differ_are_left_out),
        cmocka_unit_test(words_before_numbers_tell_times_and_channels),
        cmocka_unit_test(other_numbers_are_not_mixed),
        cmocka_unit_test(a_source_may_say_what_the_numbers_are),
        cmocka_unit_test(a_folder_names_what_it_does_not_show),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
