/* SPDX-License-Identifier: Apache-2.0
 *
 * Directories with false entries for strips and tiles are refused, and valid directories of every
 * layout are accepted. The files are written field by field, in both byte orders, as classic TIFF
 * and as BigTIFF.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <zlib.h>

#include "unit/data/import/support.h"

enum { BYTE = 1, SHORT = 3, LONG = 4, LONG8 = 16, FIELDS_MAX = 12, PIXELS = 64 };

struct field {
    unsigned tag, type, count; /* count 0 = the field is not written */
    uint64_t values[4];
};

struct page { /* unset fields are not written */
    struct field fields[FIELDS_MAX];
};

struct file {
    bool big_endian, big;
    uint8_t bytes[8192];
    size_t used;
};

static void append(struct file *f, uint64_t value, unsigned bytes) {
    assert_compare(f->used + bytes, <=, sizeof f->bytes);
    for (unsigned i = 0; i < bytes; i++)
        f->bytes[f->used + (f->big_endian ? bytes - 1 - i : i)] = (uint8_t)(value >> (8 * i));
    f->used += bytes;
}

static unsigned size_of(unsigned type) {
    return type == BYTE ? 1 : type == SHORT ? 2 : type == LONG ? 4 : 8;
}

/* Returns the offset of the pixels, which follow the file header. */
static uint64_t start(bool big) {
    return big ? 16 : 8;
}

static void append_field(struct file *f, const struct field *field, uint64_t elsewhere) {
    unsigned word = f->big ? 8 : 4, size = size_of(field->type);
    append(f, field->tag, 2);
    append(f, field->type, 2);
    append(f, field->count, word);
    if (field->count * size > word) {
        append(f, elsewhere, word);
        return;
    }
    for (unsigned i = 0; i < field->count; i++)
        append(f, field->values[i], size);
    for (unsigned i = field->count * size; i < word; i++)
        append(f, 0, 1);
}

/* Writes the header, the pixels, the values that do not fit into their directory entries, and the
 * directory; `next` is the offset of the next directory. Returns the offset of the directory. */
static uint64_t make_file(struct file *f, const struct page *page, const void *data, size_t size,
                          uint64_t next) {
    unsigned word = f->big ? 8 : 4, count = 0;
    uint64_t elsewhere[FIELDS_MAX] = { 0 };
    f->used = 0;
    append(f, f->big_endian ? 0x4d4d : 0x4949, 2);
    append(f, f->big ? 43 : 42, 2);
    if (f->big) { /* an offset has 8 bytes */
        append(f, 8, 2);
        append(f, 0, 2);
    }
    size_t link = f->used;
    append(f, 0, word);
    assert_int_equal(f->used, start(f->big));
    for (size_t i = 0; i < size; i++)
        append(f, ((const uint8_t *)data)[i], 1);
    for (int i = 0; i < FIELDS_MAX; i++) {
        const struct field *field = &page->fields[i];
        count += field->count > 0;
        elsewhere[i] = f->used;
        if (field->count * size_of(field->type) > word)
            for (unsigned k = 0; k < field->count; k++)
                append(f, field->values[k], size_of(field->type));
    }
    uint64_t at = f->used;
    append(f, count, f->big ? 8 : 2);
    for (int i = 0; i < FIELDS_MAX; i++)
        if (page->fields[i].count)
            append_field(f, &page->fields[i], elsewhere[i]);
    append(f, next, word);
    size_t end = f->used;
    f->used = link;
    append(f, at, word);
    f->used = end;
    return at;
}

static uint8_t ramp[PIXELS];

/* Indices of the fields in struct page; a case changes one field. */
enum { WIDTH, HEIGHT, BITS, COMPRESSION, OFFSETS, ROWS, COUNTS, TILE_W, TILE_L, MORE };

static struct page striped(bool big) {
    return (struct page){ { [WIDTH] = { 256, SHORT, 1, { 8 } },
                            [HEIGHT] = { 257, LONG, 1, { 8 } },
                            [BITS] = { 258, SHORT, 1, { 8 } },
                            [COMPRESSION] = { 259, SHORT, 1, { 1 } },
                            [OFFSETS] = { 273, LONG, 1, { start(big) } },
                            [ROWS] = { 278, SHORT, 1, { 8 } },
                            [COUNTS] = { 279, LONG, 1, { PIXELS } } } };
}

static void write_page(const char *name, bool big_endian, bool big, const struct page *page,
                       const void *data, size_t size) {
    struct file f = { .big_endian = big_endian, .big = big };
    make_file(&f, page, data, size, 0);
    write_file(name, f.bytes, f.used);
}

static void assert_loads(bool big_endian, bool big, const struct page *page, const void *data,
                         size_t size) {
    write_page("good.tif", big_endian, big, page, data, size);
    struct sp_volume *volume = load("good.tif");
    assert_int_equal(sp_volume_info(volume)->grid.dims[0], 8);
    assert_int_equal(sp_volume_info(volume)->grid.dims[1], 8);
    assert_is_ramp(volume, PIXELS);
    sp_volume_unref(&volume);
}

/* Values of several types, inline and by offset; a last strip with fewer rows. */
static void valid_layouts_are_read(void **state) {
    (void)state;
    make_ramp(SP_UINT8, PIXELS, ramp);
    for (int variant = 0; variant < 4; variant++) {
        bool order = variant & 1, big = variant & 2;
        unsigned large = big ? LONG8 : LONG;
        uint64_t at = start(big);
        struct page page = striped(big);
        assert_loads(order, big, &page, ramp, PIXELS);
        page.fields[ROWS].values[0] = 3;
        page.fields[OFFSETS] = (struct field){ 273, large, 3, { at, at + 24, at + 48 } };
        page.fields[COUNTS] = (struct field){ 279, SHORT, 3, { 24, 24, 16 } };
        assert_loads(order, big, &page, ramp, PIXELS);
        page.fields[ROWS].count = 0; /* all rows in one strip */
        page.fields[OFFSETS] = (struct field){ 273, large, 1, { at } };
        page.fields[COUNTS] = (struct field){ 279, large, 1, { PIXELS } };
        assert_loads(order, big, &page, ramp, PIXELS);
    }
}

static void tiles_and_packed_strips_are_read(void **state) {
    (void)state;
    uint8_t tile[256] = { 0 }, packed[256];
    make_ramp(SP_UINT8, PIXELS, ramp);
    for (int y = 0; y < 8; y++)
        memcpy(tile + 16 * y, ramp + 8 * y, 8);
    struct page page = striped(false);
    page.fields[ROWS].count = 0;
    page.fields[OFFSETS] = (struct field){ 324, LONG, 1, { start(false) } };
    page.fields[COUNTS] = (struct field){ 325, LONG, 1, { 256 } };
    page.fields[TILE_W] = (struct field){ 322, SHORT, 1, { 16 } };
    page.fields[TILE_L] = (struct field){ 323, SHORT, 1, { 16 } };
    assert_loads(false, false, &page, tile, 256);
    /* One byte less than the padded tile, but more than the page needs. */
    page.fields[COUNTS].values[0] = 255;
    write_page("false.tif", false, false, &page, tile, 256);
    load_error("false.tif", SP_ERR_FORMAT, "TileByteCounts", "tile 0 has 255 bytes, its samples");
    uLongf size = sizeof packed;
    assert_int_equal(compress2(packed, &size, ramp, PIXELS, 9), Z_OK);
    page = striped(false);
    page.fields[COMPRESSION].values[0] = 8;
    page.fields[COUNTS].values[0] = size;
    assert_loads(false, false, &page, packed, size);
    /* A complete zlib stream that holds one sample less than the page. */
    size = sizeof packed;
    assert_int_equal(compress2(packed, &size, ramp, PIXELS - 1, 9), Z_OK);
    page.fields[COUNTS].values[0] = size;
    write_page("false.tif", false, false, &page, packed, size);
    load_error("false.tif", SP_ERR_FORMAT, "false.tif: page 0", "");
}

static void false_directories_are_refused(void **state) {
    (void)state;
    static const struct {
        int which;
        struct field field;
        const char *place, *text;
    } cases[] = {
        { WIDTH, { 256, LONG, 1, { 600 } }, "StripByteCounts", "its samples need 4800" },
        { WIDTH, { 256, LONG, 1, { 60000 } }, "StripByteCounts", "its samples need 480000" },
        { WIDTH,
          { 256, LONG, 1, { 0x80000000 } },
          "ImageWidth",
          "is 2147483648, outside [1, 2147483647]" },
        { WIDTH, { 256, LONG, 1, { 0 } }, "ImageWidth", "is 0, outside" },
        { WIDTH, { 0 }, "ImageWidth", "does not have this field" },
        { BITS, { 258, SHORT, 1, { 16 } }, "StripByteCounts", "its samples need 128" },
        { BITS, { 258, SHORT, 1, { 0 } }, "BitsPerSample", "is 0, outside [1, 128]" },
        { HEIGHT, { 257, SHORT, 1, { 9 } }, "StripOffsets", "the page has 2 strips" },
        { ROWS, { 278, SHORT, 1, { 0 } }, "RowsPerStrip", "is 0, outside" },
        { COUNTS, { 279, SHORT, 1, { 63 } }, "StripByteCounts", "strip 0 has 63 bytes" },
        { COUNTS, { 279, BYTE, 1, { 0 } }, "StripByteCounts", "strip 0 has 0 bytes" },
        { COUNTS, { 279, LONG, 1, { 0xfffffff0 } }, "StripOffsets", "has 4294967280 bytes at" },
        { COUNTS, { 279, 11, 1, { 64 } }, "StripByteCounts", "is of type 11" },
        { COUNTS, { 0 }, "StripByteCounts", "does not have this field" },
        { COUNTS, { 325, LONG, 1, { 64 } }, "StripByteCounts", "does not have this field" },
        { OFFSETS, { 273, LONG, 1, { 0xfffffff0 } }, "StripOffsets", "at byte 4294967280" },
        { OFFSETS, { 0 }, "StripOffsets", "does not have this field" },
        { MORE, { 279, LONG, 1, { 64 } }, "StripByteCounts", "occurs twice" },
        { MORE, { 324, LONG, 1, { 64 } }, "TileOffsets", "not belong to a page of strips" },
        { MORE, { 322, LONG, 1, { 16 } }, "TileLength", "does not have this field" },
        { MORE, { 277, SHORT, 1, { 5000 } }, "SamplesPerPixel", "5000 channels" },
    };
    make_ramp(SP_UINT8, PIXELS, ramp);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        for (int variant = 0; variant < 4; variant += 3) {
            bool big = variant & 2;
            struct page page = striped(big);
            page.fields[cases[i].which] = cases[i].field;
            enum sp_code code =
                strstr(cases[i].text, "channels") ? SP_ERR_UNSUPPORTED : SP_ERR_FORMAT;
            write_page("false.tif", variant & 1, big, &page, ramp, PIXELS);
            load_error("false.tif", code, variant ? "false.tif: page 0: byte " : cases[i].place,
                       cases[i].text);
        }
}

/* 64-bit samples in a partial last strip, in one row and in tiles. */
static void doubles_are_read(void **state) {
    (void)state;
    double samples[PIXELS], tile[256] = { 0 };
    make_ramp(SP_FLOAT64, PIXELS, samples);
    for (int y = 0; y < 8; y++)
        memcpy(tile + 16 * y, samples + 8 * y, 64);
    for (int layout = 0; layout < 3; layout++) {
        struct page page = striped(false);
        page.fields[BITS].values[0] = 64;
        page.fields[MORE] = (struct field){ 339, SHORT, 1, { 3 } };
        page.fields[COUNTS].values[0] = 512;
        if (layout == 0) {
            uint64_t at = start(false);
            page.fields[ROWS].values[0] = 3;
            page.fields[OFFSETS] = (struct field){ 273, LONG, 3, { at, at + 192, at + 384 } };
            page.fields[COUNTS] = (struct field){ 279, LONG, 3, { 192, 192, 128 } };
        } else if (layout == 1) {
            page.fields[WIDTH].values[0] = PIXELS;
            page.fields[HEIGHT].values[0] = 1;
        } else {
            page.fields[ROWS].count = 0;
            page.fields[OFFSETS] = (struct field){ 324, LONG, 1, { start(false) } };
            page.fields[COUNTS] = (struct field){ 325, LONG, 1, { 2048 } };
            page.fields[TILE_W] = (struct field){ 322, SHORT, 1, { 16 } };
            page.fields[TILE_L] = (struct field){ 323, SHORT, 1, { 16 } };
        }
        write_page("double.tif", false, false, &page, layout == 2 ? tile : samples,
                   layout == 2 ? sizeof tile : sizeof samples);
        struct sp_volume *volume = load("double.tif");
        assert_is_ramp(volume, PIXELS);
        sp_volume_unref(&volume);
    }
}

/* Each codec has a maximum compression ratio. Tests a strip above it and one exactly at it. */
static void compression_ratios_above_the_codecs_maximum_are_refused(void **state) {
    (void)state;
    static const struct {
        unsigned compression, ratio;
    } codecs[] = { { 5, 4096 }, { 8, 1032 }, { 32946, 1032 }, { 32773, 128 } };
    make_ramp(SP_UINT8, PIXELS, ramp);
    for (size_t i = 0; i < sizeof codecs / sizeof codecs[0]; i++)
        for (int beyond = 0; beyond < 2; beyond++) {
            char text[80];
            unsigned height = 4 * codecs[i].ratio + (beyond ? codecs[i].ratio : 0);
            struct page page = striped(false);
            page.fields[WIDTH].values[0] = 1;
            page.fields[HEIGHT].values[0] = page.fields[ROWS].values[0] = height;
            page.fields[COMPRESSION].values[0] = codecs[i].compression;
            page.fields[COUNTS].values[0] = 4;
            write_page("false.tif", false, false, &page, ramp, 4);
            snprintf(text, sizeof text, "%u bytes cannot come out of the 4 of strip 0", height);
            if (beyond) {
                load_error("false.tif", SP_ERR_FORMAT, "false.tif: page 0: byte", text);
            } else { /* possible by size, so the codec runs and finds invalid data */
                load_error("false.tif", SP_ERR_FORMAT, "false.tif: page 0", "");
            }
        }
}

/* If strips or pages could share bytes, a small file could give a large volume. */
static void shared_bytes_are_refused(void **state) {
    (void)state;
    struct file f = { .big = false };
    make_ramp(SP_UINT8, PIXELS, ramp);
    struct page page = striped(false);
    page.fields[ROWS].values[0] = 1;
    page.fields[HEIGHT].values[0] = page.fields[OFFSETS].count = page.fields[COUNTS].count = 4;
    page.fields[WIDTH].values[0] = PIXELS;
    for (int i = 0; i < 4; i++) {
        page.fields[OFFSETS].values[i] = start(false);
        page.fields[COUNTS].values[i] = PIXELS;
    }
    write_page("false.tif", false, false, &page, ramp, PIXELS);
    load_error("false.tif", SP_ERR_FORMAT, ": StripOffsets", "strips up to number 3");
    page = striped(false);
    uint64_t at = make_file(&f, &page, ramp, PIXELS, 0);
    make_file(&f, &page, ramp, PIXELS, at);
    write_file("false.tif", f.bytes, f.used);
    load_error("false.tif", SP_ERR_FORMAT, "directory", "form a circle");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(valid_layouts_are_read),
        cmocka_unit_test(false_directories_are_refused),
        cmocka_unit_test(compression_ratios_above_the_codecs_maximum_are_refused),
        cmocka_unit_test(shared_bytes_are_refused),
        cmocka_unit_test(tiles_and_packed_strips_are_read),
        cmocka_unit_test(doubles_are_read),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
