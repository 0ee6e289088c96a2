/* SPDX-License-Identifier: Apache-2.0
 *
 * Amira meshes and the kinds of .vol, which this test writes.
 */
#include <byteswap.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "unit/data/import/support.h"

enum { NX = 4, NY = 3, NZ = 2, COUNT = NX * NY * NZ };

#define HEADER(kind)                                                                               \
    "# AmiraMesh " kind " 2.1\n\n# a comment { }\ndefine Lattice 4 3 2\n\nParameters {\n"          \
    "    Content \"4x3x2, uniform coordinates\",\n    Colors { Inside { Color 1 0 0, Id 1 } }\n"   \
    "    BoundingBox 10 16 -1 1 0 5,\n    CoordType \"uniform\"\n"                                 \
    "    Units { Coordinates \"mm\" }\n}\n\n"

struct out {
    char bytes[8192];
    size_t size;
};

static void put(struct out *o, const void *bytes, size_t size) {
    assert_true(o->size + size <= sizeof o->bytes);
    memcpy(o->bytes + o->size, bytes, size);
    o->size += size;
}

static void put_text(struct out *o, const char *text) {
    put(o, text, strlen(text));
}

static void check_grid(const struct sp_volume_info *info) {
    static const double spacing[3] = { 2, 1, 5 }, origin[3] = { 10, -1, 0 };
    static const uint32_t dims[3] = { NX, NY, NZ };
    for (int a = 0; a < 3; a++) {
        assert_int_equal(info->grid.dims[a], dims[a]);
        assert_float_equal(info->grid.spacing[a], spacing[a], 1e-12);
        assert_float_equal(info->grid.origin[a], origin[a], 0);
    }
    assert_string_equal(info->unit, "mm");
}

static void check(const char *source, const char *name, enum sp_type type) {
    struct sp_volume *volume = load(source);
    check_grid(sp_volume_info(volume));
    assert_int_equal(sp_volume_info(volume)->type, type);
    assert_string_equal(sp_volume_info(volume)->value_name, name);
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
}

static void binary_fields_are_read_in_both_byte_orders(void **state) {
    (void)state;
    struct out o = { .size = 0 }, big = { .size = 0 };
    uint8_t bytes[COUNT];
    uint16_t words[COUNT];
    make_ramp(SP_UINT8, COUNT, bytes);
    make_ramp(SP_UINT16, COUNT, words);
    static const char fields[] =
        "Lattice { byte Data } @1\nLattice { ushort Other } = @2\n\n# Data section follows\n@1\n";
    put_text(&o, HEADER("BINARY-LITTLE-ENDIAN"));
    put_text(&o, fields);
    put(&o, bytes, sizeof bytes);
    put_text(&o, "\n@2\n");
    big = o;
    memmove(big.bytes + 18, big.bytes + 32, big.size - 32); /* without -LITTLE-ENDIAN */
    memcpy(big.bytes, "# AmiraMesh BINARY", 18);
    big.size -= 14;
    put(&o, words, sizeof words);
    for (int i = 0; i < COUNT; i++)
        words[i] = bswap_16(words[i]);
    put(&big, words, sizeof words);
    write_file("a.am", o.bytes, o.size);
    write_file("b.data", big.bytes, big.size);
    check("a.am", "Data", SP_UINT8);
    check("a.am?field=Other", "Other", SP_UINT16);
    check("b.data?field=Other", "Other", SP_UINT16);
    write_file("cut.am", o.bytes, o.size - 1);
    load_error("cut.am", SP_ERR_FORMAT, "Other", "cut off");
}

static void packed_and_text_fields_are_read(void **state) {
    (void)state;
    struct out o = { .size = 0 };
    uint8_t bytes[COUNT], packed[256];
    uLongf size = sizeof packed;
    char line[64];
    make_ramp(SP_UINT8, COUNT, bytes);
    assert_int_equal(compress(packed, &size, bytes, COUNT), Z_OK);
    put_text(&o, HEADER("BINARY-LITTLE-ENDIAN"));
    snprintf(line, sizeof line, "Lattice { byte Zip } @1(HxZip,%lu)\n", size);
    put_text(&o, line);
    put_text(&o, "Lattice { byte Runs } @2(HxByteRLE,27)\n\n@1\n");
    put(&o, packed, size);
    put_text(&o, "\n@2\n\x94");
    put(&o, bytes, 20);
    put_text(&o, "\1");
    put(&o, bytes + 20, 1);
    put_text(&o, "\x83");
    put(&o, bytes + 21, 3);
    write_file("packed.am", o.bytes, o.size);
    check("packed.am", "Zip", SP_UINT8);
    check("packed.am?field=Runs", "Runs", SP_UINT8);
    o.size = 0;
    put_text(&o, HEADER("3D ASCII"));
    put_text(&o, "Lattice { float Text } @1\nLattice { float[3] Wind } @2\n\n@1\n");
    for (size_t i = 0; i < COUNT; i++) {
        snprintf(line, sizeof line, "%.9g\n", ramp_value(SP_FLOAT32, i));
        put_text(&o, line);
    }
    put_text(&o, "\n@2\n");
    for (size_t i = 0; i < COUNT; i++)
        put_text(&o, "1 2 3.5\n");
    write_file("text.am", o.bytes, o.size);
    check("text.am", "Text", SP_FLOAT32);
    struct sp_volume *volume = load("text.am");
    assert_string_equal(sp_volume_info(volume)->vector_name, "Wind");
    assert_float_equal(sp_volume_vectors(volume)[COUNT - 1][2], 3.5, 0);
    sp_volume_unref(&volume);
}

static void rectilinear_meshes_have_coordinates(void **state) {
    (void)state;
    write_text("r.am", "# AmiraMesh 3D ASCII 2.0\ndefine Lattice 3 2 1\ndefine Coordinates 6\n"
                       "Parameters { CoordType \"rectilinear\" }\nLattice { byte Data } @1\n"
                       "Coordinates { float xyz } @2\n@1\n1 2 3 4 5 6\n@2\n1 2 4\n0 7\n5\n");
    struct sp_volume *volume = load("r.am");
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    assert_float_equal(grid->origin[0], 1, 0);
    assert_float_equal(grid->origin[2], 5, 0);
    assert_float_equal(grid->coordinates[0][2], 3, 0);
    assert_int_equal(((const uint8_t *)sp_volume_voxels(volume))[5], 6);
    sp_volume_unref(&volume);
}

static void other_meshes_are_refused(void **state) {
    (void)state;
    static const struct {
        const char *text, *error;
    } cases[] = {
        { "# AmiraMesh 3D ASCII 2.0\ndefine Points 4\n", "no lattice" },
        { "# AmiraMesh 3D ASCII 2.0\ndefine Lattice 4 3\n", "cut off" },
        { "# AmiraMesh 3D ASCII 2.0\ndefine Lattice 4 3 0\n", "whole number" },
        { "# AmiraMesh 3D ASCII 2.0\ndefine Lattice 1 1 1\nLattice { complex A } @1\n@1\n",
          "type" },
        { "# AmiraMesh 3D ASCII 2.0\ndefine Lattice 1 1 1\nLattice { byte A } @1\n", "section" },
        { "# AmiraMesh 3D ASCII 2.0\ndefine Lattice 1 1 1\nParameters { CoordType \"curvilinear\" "
          "}\n"
          "Lattice { byte A } @1\n@1\n1\n",
          "curvilinear" },
        { "# AmiraMesh BINARY-LITTLE-ENDIAN 2.1\ndefine Lattice 1 1 1\nLattice { byte A } "
          "@1(HxJpeg,9)\n@1\n1\n",
          "compression" },
        { "# AmiraMesh nothing\n", "ASCII" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sp_load_options options = importer_options();
        struct sp_error err = { .text = "" };
        write_text("x.am", "%s", cases[i].text);
        if (sp_volume_load(in_folder("x.am"), &options, &err) || !strstr(err.text, cases[i].error))
            fail_msg("case %zu: %s", i, err.text);
    }
}

static void three_kinds_of_vol_are_read(void **state) {
    (void)state;
    struct out o = { .size = 0 };
    uint8_t bytes[COUNT];
    float numbers[2 * COUNT];
    static const int32_t head[5] = { 1, NX, NY, NZ, 2 };
    static const float box[6] = { 10, -1, 0, 16, 1, 5 };
    make_ramp(SP_UINT8, COUNT, bytes);
    make_ramp(SP_FLOAT32, 2 * COUNT, numbers);
    put(&o, "VOL\3", 4);
    put(&o, head, sizeof head);
    put(&o, box, sizeof box);
    put(&o, numbers, sizeof numbers);
    write_file("mitsuba.vol", o.bytes, o.size);
    struct sp_volume *volume = load("mitsuba.vol?field=component 2");
    assert_float_equal(sp_volume_info(volume)->grid.spacing[0], 2, 0);
    assert_float_equal(((const float *)sp_volume_voxels(volume))[5], numbers[11], 0);
    sp_volume_unref(&volume);
    write_both("dgtal.vol", "X: 4\nY: 3\nZ: 2\nVoxel-Size: 1\nVersion: 2\n.\n", bytes, COUNT);
    volume = load("dgtal.vol");
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
    write_file("scan.vol", bytes, COUNT);
    write_text("scan.vgi", "[representation]\nsize = 4 3 2\n[file1]\nSize = 4 3 2\nName = "
                           "C:\\data\\scan.vol\nDatatype = unsigned integer\nBitsPerElement = 8\n"
                           "{volumeprimitive12}\n[geometry]\nresolution = 0.5 0.5 0.25\n"
                           "unit = mm\n");
    volume = load("scan.vgi");
    assert_is_ramp(volume, COUNT);
    assert_float_equal(sp_volume_info(volume)->grid.spacing[2], 0.25, 0);
    sp_volume_unref(&volume);
    load_error("scan.vol", SP_ERR_UNSUPPORTED, "scan.vol", "VGStudio");
    write_both("short.vol", "X: 4\nY: 3\nZ: 3\nVersion: 2\n.\n", bytes, COUNT);
    load_error("short.vol", SP_ERR_FORMAT, "X, Y, Z", "need 36 bytes, the file has 24");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(binary_fields_are_read_in_both_byte_orders),
        cmocka_unit_test(packed_and_text_fields_are_read),
        cmocka_unit_test(rectilinear_meshes_have_coordinates),
        cmocka_unit_test(other_meshes_are_refused),
        cmocka_unit_test(three_kinds_of_vol_are_read),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
