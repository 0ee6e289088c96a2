/* SPDX-License-Identifier: Apache-2.0
 *
 * TIFF stacks. The test writes them byte by byte, independent of any library.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "unit/data/import/support.h"

struct tiff {
    bool big_endian;
    unsigned width, height, pages;
    unsigned bits, format, samples; /* format: 1 unsigned, 2 signed, 3 floating */
    unsigned depth;                 /* ImageDepth; 0 = no such tag */
    unsigned resolution[2];         /* 1/1000 px per unit; 0 = no such tags */
    unsigned unit;                  /* 1 none, 2 inch, 3 cm */
    const char *description;
    unsigned last_width; /* width of the last page; 0 = same as the others */
    bool one_directory;  /* one directory for all samples, as ImageJ writes above 4 GB */
    const void *data;    /* samples in native byte order */
    uint8_t *out;
    size_t used, capacity;
};

static void put(struct tiff *t, size_t at, uint64_t value, unsigned bytes) {
    if (at + bytes > t->capacity) {
        t->capacity = (at + bytes) * 2;
        t->out = realloc(t->out, t->capacity);
        assert_non_null(t->out);
    }
    for (unsigned i = 0; i < bytes; i++)
        t->out[at + (t->big_endian ? bytes - 1 - i : i)] = (uint8_t)(value >> (8 * i));
    if (at + bytes > t->used)
        t->used = at + bytes;
}

static size_t append(struct tiff *t, uint64_t value, unsigned bytes) {
    size_t at = t->used;
    put(t, at, value, bytes);
    return at;
}

static void entry(struct tiff *t, unsigned tag, unsigned type, unsigned count, uint32_t value) {
    append(t, tag, 2);
    append(t, type, 2);
    append(t, count, 4);
    append(t, value, type == 3 ? 2 : 4); /* a SHORT is in the first 2 of the 4 bytes */
    if (type == 3)
        append(t, 0, 2);
}

static void write_tiff(const char *name, struct tiff t) {
    size_t sample = t.bits / 8;
    t.out = NULL;
    t.used = t.capacity = 0;
    append(&t, t.big_endian ? 0x4d4d : 0x4949, 2);
    append(&t, 42, 2);
    size_t link = append(&t, 0, 4);
    const uint8_t *data = t.data;
    size_t description = t.used, length = t.description ? strlen(t.description) + 1 : 0;
    for (size_t i = 0; i < length; i++)
        append(&t, (uint8_t)t.description[i], 1);
    size_t resolution = t.used;
    for (int i = 0; i < 2; i++) {
        append(&t, t.resolution[i], 4);
        append(&t, 1000, 4);
    }
    for (unsigned page = 0; page < t.pages; page++) {
        unsigned width = t.last_width && page + 1 == t.pages ? t.last_width : t.width;
        size_t strip = t.used, count = (size_t)width * t.height * t.samples;
        for (size_t i = 0; i < count; i++, data += sample) {
            uint64_t value = 0;
            memcpy(&value, data, sample);
            append(&t, value, (unsigned)sample);
        }
        if (t.one_directory && page > 0)
            continue;
        t.used += t.used & 1;
        put(&t, link, t.used, 4);
        append(&t, (uint64_t)(11 + (length > 0) + (t.depth > 0) + 3 * (t.resolution[0] > 0)), 2);
        entry(&t, 256, 4, 1, width);
        entry(&t, 257, 4, 1, t.height);
        entry(&t, 258, 3, 1, t.bits);
        entry(&t, 259, 3, 1, 1);
        entry(&t, 262, 3, 1, t.samples == 3 ? 2 : 1);
        if (length)
            entry(&t, 270, 2, (unsigned)length, (uint32_t)description);
        entry(&t, 273, 4, 1, (uint32_t)strip);
        entry(&t, 277, 3, 1, t.samples);
        entry(&t, 278, 4, 1, t.height);
        entry(&t, 279, 4, 1, (uint32_t)(count * sample));
        if (t.resolution[0]) {
            entry(&t, 282, 5, 1, (uint32_t)resolution);
            entry(&t, 283, 5, 1, (uint32_t)resolution + 8);
        }
        entry(&t, 284, 3, 1, 1);
        if (t.resolution[0])
            entry(&t, 296, 3, 1, t.unit);
        entry(&t, 339, 3, 1, t.format);
        if (t.depth)
            entry(&t, 32997, 4, 1, t.depth);
        link = append(&t, 0, 4);
    }
    write_file(name, t.out, t.used);
    free(t.out);
}

static const struct {
    enum sp_type type;
    unsigned bits, format;
} types[SP_TYPE_COUNT] = {
    { SP_UINT8, 8, 1 },  { SP_INT8, 8, 2 },     { SP_UINT16, 16, 1 },  { SP_INT16, 16, 2 },
    { SP_INT32, 32, 2 }, { SP_FLOAT32, 32, 3 }, { SP_FLOAT64, 64, 3 },
};

static void every_type_and_byte_order_is_read(void **state) {
    (void)state;
    double samples[60];
    for (int t = 0; t < SP_TYPE_COUNT; t++)
        for (int big = 0; big < 2; big++) {
            make_ramp(types[t].type, 60, samples);
            write_tiff("stack.tif", (struct tiff){ .big_endian = big,
                                                   .width = 5,
                                                   .height = 4,
                                                   .pages = 3,
                                                   .bits = types[t].bits,
                                                   .format = types[t].format,
                                                   .samples = 1,
                                                   .data = samples });
            struct sp_volume *volume = load("stack.tif");
            const struct sp_volume_info *info = sp_volume_info(volume);
            assert_int_equal(info->type, types[t].type);
            assert_int_equal(info->grid.dims[0], 5);
            assert_int_equal(info->grid.dims[1], 4);
            assert_int_equal(info->grid.dims[2], 3);
            assert_compare(info->grid.spacing[0], ==, 1);
            assert_compare(info->grid.spacing[2], ==, 1);
            assert_is_ramp(volume, 60);
            sp_volume_unref(&volume);
        }
}

static uint8_t ramp8[600];
static const struct tiff plain = {
    .width = 5, .height = 4, .pages = 3, .bits = 8, .format = 1, .samples = 1, .data = ramp8
};

static void assert_spacing(struct tiff t, double x, double y, double z, const char *unit) {
    write_tiff("stack.tif", t);
    struct sp_volume *volume = load("stack.tif");
    const struct sp_volume_info *info = sp_volume_info(volume);
    const double expected[3] = { x, y, z };
    for (int i = 0; i < 3; i++)
        if (info->grid.spacing[i] < expected[i] * 0.99999 ||
            info->grid.spacing[i] > expected[i] * 1.00001)
            fail_msg("spacing[%d] is %g, expected %g", i, info->grid.spacing[i], expected[i]);
    assert_string_equal(info->unit, unit);
    assert_is_ramp(volume, 60);
    sp_volume_unref(&volume);
}

static void spacing_comes_from_resolution_and_imagej(void **state) {
    (void)state;
    make_ramp(SP_UINT8, 600, ramp8);
    struct tiff t = plain;
    t.resolution[0] = 4000;
    t.resolution[1] = 2000;
    t.unit = 3;
    assert_spacing(t, 2.5, 5, 2.5, "mm");
    t.unit = 2;
    assert_spacing(t, 6.35, 12.7, 6.35, "mm");
    t.unit = 1; /* no unit: the resolution is ignored */
    assert_spacing(t, 1, 1, 1, "");
    t.description = "ImageJ=1.53t\nimages=3\nslices=3\nunit=micron\nspacing=1.5\nloop=false\n";
    assert_spacing(t, 0.25, 0.5, 1.5, "um");
    t.description = "ImageJ=1.53t\nimages=3\nslices=3\nunit=\\u00B5m\n";
    assert_spacing(t, 0.25, 0.5, 0.25, "um");
    t.description = "ImageJ=1.53t\nimages=3\nframes=3\n";
    t.resolution[0] = 0;
    assert_spacing(t, 1, 1, 1, "");
    t = plain;
    t.pages = 1;
    t.width = 15;
    assert_spacing(t, 1, 1, 1, "");
}

static void unsupported_layouts_are_refused(void **state) {
    (void)state;
    make_ramp(SP_UINT8, 600, ramp8);
    struct tiff t = plain;
    t.depth = 3;
    write_tiff("wrong.tif", t);
    load_error("wrong.tif", SP_ERR_UNSUPPORTED, ": ImageDepth", "page 0 has depth");
    t = plain;
    t.format = 3;
    write_tiff("wrong.tif", t);
    load_error("wrong.tif", SP_ERR_UNSUPPORTED, "wrong.tif: page 0",
               "floating-point samples of 8 bits");
    /* Large stacks of ImageJ have one directory; here it lies between the slices. */
    t = plain;
    t.one_directory = true;
    t.description = "ImageJ=1.53t\nimages=3\nslices=3\n";
    write_tiff("wrong.tif", t);
    load_error("wrong.tif", SP_ERR_UNSUPPORTED, "wrong.tif: page 0",
               "ImageJ declares 3 images, but the file has 1 pages");
    t = plain;
    t.description = "ImageJ=1.53t\nimages=3\nchannels=2\nhyperstack=true\n";
    write_tiff("wrong.tif", t);
    load_error("wrong.tif", SP_ERR_FORMAT, "wrong.tif: page 0", "2 channels, 1 slices");
}

static void a_page_of_another_size_is_left_out(void **state) {
    (void)state;
    make_ramp(SP_UINT8, 600, ramp8);
    struct tiff t = plain;
    t.last_width = 6;
    write_tiff("other.tif", t);
    struct sp_volume *volume = load("other.tif");
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], 2);
    assert_string_equal(sp_volume_info(volume)->warnings[0],
                        "1 of 3 pages, of 6 x 4 px with 1 samples of 8 bits, were left out: they "
                        "differ from the others, of 5 x 4 px.");
    sp_volume_unref(&volume);
}

/* Checks that the slices of a volume are these pages of the ramp, of which each pixel has `step`
 * samples; the volume has sample `first` of each. */
static void check_pages(const char *source, const char *name, uint32_t slices,
                        const unsigned *pages, unsigned step, unsigned first) {
    struct sp_volume *volume = load(source);
    const struct sp_volume_info *info = sp_volume_info(volume);
    const uint8_t *samples = sp_volume_voxels(volume);
    const unsigned count = info->grid.dims[0] * info->grid.dims[1];
    assert_string_equal(info->value_name, name);
    assert_int_equal(info->grid.dims[2], slices);
    for (unsigned k = 0; k < slices; k++)
        for (unsigned i = 0; i < count; i++)
            assert_int_equal(samples[k * count + i],
                             pages[k] == ~0U ? 0 : ramp8[(pages[k] * count + i) * step + first]);
    sp_volume_unref(&volume);
}

static void channels_are_fields(void **state) {
    (void)state;
    make_ramp(SP_UINT8, 600, ramp8);
    struct tiff t = plain;
    t.samples = 3;
    write_tiff("rgb.tif", t);
    check_pages("rgb.tif", "red", 3, (unsigned[]){ 0, 1, 2 }, 3, 0);
    check_pages("rgb.tif?field=blue", "blue", 3, (unsigned[]){ 0, 1, 2 }, 3, 2);
    t = plain;
    t.pages = 12;
    t.description = "ImageJ=1.53t\nimages=12\nchannels=2\nslices=3\nframes=2\n";
    write_tiff("hyper.tif", t);
    check_pages("hyper.tif", "channel 1", 3, (unsigned[]){ 0, 2, 4 }, 1, 0);
    check_pages("hyper.tif?field=channel 2", "channel 2", 3, (unsigned[]){ 1, 3, 5 }, 1, 0);
}

#define OME(attributes, content)                                                                   \
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?><!-- x --><OME "                                    \
    "xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" UUID=\"urn:uuid:a\"><Image "      \
    "ID=\"Image:0\"><Pixels SizeX=\"5\" SizeY=\"4\" Type=\"uint8\" " attributes ">" content        \
    "</Pixels></Image></OME>"

static void ome_xml_assigns_pages(void **state) {
    (void)state;
    make_ramp(SP_UINT8, 600, ramp8);
    struct tiff t = plain;
    t.pages = 6;
    t.description = OME("DimensionOrder=\"XYZCT\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\" "
                        "PhysicalSizeX=\"500\" PhysicalSizeXUnit=\"nm\" PhysicalSizeY=\"0.5\" "
                        "PhysicalSizeZ=\"2\"",
                        "<Channel Name=\"DAPI\"/><Channel Name=\"GFP\"/><TiffData/>");
    write_tiff("a.ome.tif", t);
    check_pages("a.ome.tif", "DAPI", 3, (unsigned[]){ 0, 1, 2 }, 1, 0);
    check_pages("a.ome.tif?field=GFP", "GFP", 3, (unsigned[]){ 3, 4, 5 }, 1, 0);
    struct sp_volume *volume = load("a.ome.tif");
    assert_string_equal(sp_volume_info(volume)->unit, "nm");
    assert_float_equal(sp_volume_info(volume)->grid.spacing[2], 2000, 1e-9);
    sp_volume_unref(&volume);
    t.description = OME("DimensionOrder=\"XYCZT\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\"",
                        "<TiffData IFD=\"4\" FirstZ=\"0\" FirstC=\"1\"/>"
                        "<TiffData IFD=\"2\" FirstZ=\"2\" FirstC=\"1\"/>"
                        "<TiffData IFD=\"0\" PlaneCount=\"1\"/>");
    write_tiff("b.ome.tif", t);
    check_pages("b.ome.tif?field=channel 2", "channel 2", 3, (unsigned[]){ 4, ~0U, 2 }, 1, 0);
    volume = load("b.ome.tif");
    assert_string_equal(sp_volume_info(volume)->warnings[0],
                        "2 of 3 slices are not in the file; they are 0.");
    sp_volume_unref(&volume);
    t.description = OME("DimensionOrder=\"XYCZT\" SizeZ=\"6\" SizeC=\"1\" SizeT=\"1\"",
                        "<TiffData IFD=\"0\"><UUID FileName=\"c2.ome.tif\">urn:uuid:b</UUID>"
                        "</TiffData>");
    write_tiff("c.ome.tif", t);
    load_error("c.ome.tif", SP_ERR_UNSUPPORTED, "OME-XML, line 1", "such as c2.ome.tif");
    /* Nothing says which of the files this one is. */
    t.description =
        "<OME><Image><Pixels DimensionOrder=\"XYCZT\" SizeZ=\"6\" SizeC=\"1\" "
        "SizeT=\"1\"><TiffData IFD=\"0\"><UUID>urn:uuid:a</UUID></TiffData>"
        "<TiffData IFD=\"1\" FirstZ=\"1\"><UUID FileName=\"e2.ome.tif\">urn:uuid:b</UUID>"
        "</TiffData></Pixels></Image></OME>";
    write_tiff("e.ome.tif", t);
    load_error("e.ome.tif", SP_ERR_UNSUPPORTED, "OME-XML, line 1", "such as e2.ome.tif");
    t.description = OME("DimensionOrder=\"XYCZT\" SizeZ=\"6\" SizeC=\"1\" SizeT=\"1\"",
                        "<TiffData/><TiffData/><TiffData/>");
    write_tiff("f.ome.tif", t);
    load_error("f.ome.tif", SP_ERR_FORMAT, "OME-XML, line 1", "every plane more than twice");
    t.description = OME("DimensionOrder=\"XYCZT\" SizeZ=\"9999\" SizeC=\"9\"", "");
    write_tiff("d.ome.tif", t);
    load_error("d.ome.tif", SP_ERR_FORMAT, "d.ome.tif", "cannot be in the 6 pages");
}

static void errors_explain_damaged_files(void **state) {
    (void)state;
    static const struct {
        const char *bytes;
        size_t size;
        const char *place, *text;
    } cases[] = {
        { "II*\0", 4, "first directory", "cut off" },
        { "II*\0\0\0\0\0", 8, "first directory", "has no page" },
        { "II*\0\xff\xff\xff\x7f", 8, "byte 2147483647: directory", "beyond the end" },
        { "MM\0*\0\0\0\x08\xff\xff", 10, "byte 8: directory", "beyond the end" },
        { "II*\0\x08\0\0\0\0\0\x08\0\0\0", 14, "page 0: byte 8: ImageWidth",
          "not have this field" },
        { "II+\0\x08\0\0\0\xff\xff\xff\xff\xff\xff\xff\xff", 16, "directory", "beyond the end" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_file("damaged.tif", cases[i].bytes, cases[i].size);
        load_error("damaged.tif", SP_ERR_FORMAT, cases[i].place, cases[i].text);
    }
    /* A truncated file is an error at every length, never a volume with fewer slices. */
    make_ramp(SP_UINT8, 600, ramp8);
    write_tiff("whole.tif", plain);
    uint8_t whole[2048];
    FILE *file = fopen(in_folder("whole.tif"), "rb");
    size_t size = fread(whole, 1, sizeof whole, file);
    fclose(file);
    assert_compare(size, >, 200);
    assert_compare(size, <, sizeof whole);
    struct sp_load_options options = importer_options();
    for (size_t cut = 1; cut < size; cut += 41) {
        struct sp_error err = { .code = SP_OK };
        write_file("cut.tif", whole, cut);
        assert_null(sp_volume_load(in_folder("cut.tif"), &options, &err));
        if (cut >= 4 && err.code != SP_ERR_FORMAT)
            fail_msg("cut at %zu: %s: %s", cut, sp_code_name(err.code), err.text);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_and_byte_order_is_read),
        cmocka_unit_test(spacing_comes_from_resolution_and_imagej),
        cmocka_unit_test(unsupported_layouts_are_refused),
        cmocka_unit_test(a_page_of_another_size_is_left_out),
        cmocka_unit_test(channels_are_fields),
        cmocka_unit_test(ome_xml_assigns_pages),
        cmocka_unit_test(errors_explain_damaged_files),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
