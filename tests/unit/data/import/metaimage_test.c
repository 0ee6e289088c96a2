/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

enum { NX = 5, NY = 4, NZ = 3, COUNT = NX * NY * NZ };

static const char size_lines[] = "ObjectType = Image\nNDims = 3\nDimSize = 5 4 3\n";

static void check_ramp(const char *name) {
    struct sp_volume *volume = load(name);
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], NZ);
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
}

/* Writes samples of the type after the lines. */
static void write_local(const char *name, const char *lines, enum sp_type type, bool is_big) {
    double samples[COUNT];
    char header[1024];
    make_ramp(type, COUNT, samples);
    if (is_big)
        import_swap(samples, sp_type_size(type), COUNT);
    snprintf(header, sizeof header, "%s%sElementDataFile = LOCAL\n", size_lines, lines);
    write_both(name, header, samples, COUNT * sp_type_size(type));
}

static void every_type_and_byte_order_is_read(void **state) {
    (void)state;
    static const char *const names[] = {
        [SP_UINT8] = "MET_UCHAR",   [SP_INT8] = "MET_CHAR", [SP_UINT16] = "MET_USHORT",
        [SP_INT16] = "MET_SHORT",   [SP_INT32] = "MET_INT", [SP_FLOAT32] = "MET_FLOAT",
        [SP_FLOAT64] = "MET_DOUBLE"
    };
    for (int type = 0; type < SP_TYPE_COUNT; type++)
        for (int is_big = 0; is_big < 2; is_big++) {
            char lines[128];
            snprintf(lines, sizeof lines, "BinaryDataByteOrderMSB = %s\nElementType = %s\n",
                     is_big ? "True" : "False", names[type]);
            write_local("a.mha", lines, (enum sp_type)type, is_big);
            check_ramp("a.mha");
        }
}

static void the_grid_is_read(void **state) {
    (void)state;
    write_local("grid.mha",
                "ElementType = MET_UCHAR\nElementSpacing = 1 2 3\nOffset = -4 5 6\n"
                "TransformMatrix = 0 1 0 -1 0 0 0 0 1\nAnatomicalOrientation = RAI\n"
                "DistanceUnits = mm\nComment = a = b\n",
                SP_UINT8, false);
    struct sp_volume *volume = load("grid.mha");
    const struct sp_volume_info *info = sp_volume_info(volume);
    static const double direction[3][3] = { { 0, -1, 0 }, { 1, 0, 0 }, { 0, 0, 1 } };
    for (int axis = 0; axis < 3; axis++) {
        assert_compare(fabs(info->grid.spacing[axis] - (axis + 1)), <=, 1e-12);
        assert_compare(fabs(info->grid.origin[axis] - (double[]){ -4, 5, 6 }[axis]), <=, 1e-12);
        for (int row = 0; row < 3; row++)
            assert_compare(fabs(info->grid.direction[row][axis] - direction[row][axis]), <=, 1e-12);
    }
    assert_string_equal(info->anatomy, "LPS");
    assert_string_equal(info->unit, "mm");
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
}

static void samples_may_be_packed_or_apart(void **state) {
    (void)state;
    uint8_t samples[COUNT], packed[200];
    uLongf size = sizeof packed;
    make_ramp(SP_UINT8, COUNT, samples);
    assert_int_equal(compress(packed, &size, samples, COUNT), Z_OK);
    char header[512];
    snprintf(header, sizeof header,
             "%sCompressedData = True\nCompressedDataSize = %lu\nElementType = MET_UCHAR\n"
             "ElementDataFile = LOCAL\n",
             size_lines, size);
    write_both("packed.mha", header, packed, size);
    check_ramp("packed.mha");
    write_file("packed.zraw", packed, size);
    write_text("packed.mhd",
               "%sCompressedData = True\nElementType = MET_UCHAR\nElementDataFile = packed.zraw\n",
               size_lines);
    check_ramp("packed.mhd");
    char name[16];
    for (int i = 0; i < NZ; i++) {
        snprintf(name, sizeof name, "s%02d.raw", i + 1);
        write_file(name, samples + i * NX * NY, NX * NY);
    }
    write_text("list.mhd",
               "%sElementType = MET_UCHAR\nElementDataFile = LIST\ns01.raw\r\ns02.raw\n\ns03.raw",
               size_lines);
    check_ramp("list.mhd");
    write_text("pattern.mhd", "%sElementType = MET_UCHAR\nElementDataFile = s%%02d.raw 1 3 1\n",
               size_lines);
    check_ramp("pattern.mhd");
    write_both("last.raw", "some bytes before", samples, COUNT);
    write_text("last.mhd",
               "%sElementType = MET_UCHAR\nHeaderSize = -1\nElementDataFile = last.raw\n",
               size_lines);
    check_ramp("last.mhd");
}

static void channels_are_vectors_or_fields(void **state) {
    (void)state;
    float vectors[3 * COUNT];
    char header[512];
    make_ramp(SP_FLOAT32, 3 * COUNT, vectors);
    snprintf(header, sizeof header,
             "%sElementType = MET_FLOAT_ARRAY\nElementNumberOfChannels = 3\n"
             "ElementDataFile = LOCAL\n",
             size_lines);
    write_both("v.mha", header, vectors, sizeof vectors);
    struct sp_volume *volume = load("v.mha");
    assert_are_vectors(volume, SP_FLOAT32, false);
    sp_volume_unref(&volume);
    snprintf(header, sizeof header,
             "%sElementType = MET_USHORT\nElementNumberOfChannels = 6\nElementDataFile = LOCAL\n",
             size_lines);
    write_both("c.mha", header, vectors, sizeof vectors);
    volume = load("c.mha?field=component 5");
    assert_string_equal(sp_volume_info(volume)->others[0], "component 1");
    const uint16_t *samples = sp_volume_voxels(volume);
    for (int i = 0; i < COUNT; i++)
        assert_int_equal(samples[i], ((const uint16_t *)vectors)[6 * i + 4]);
    sp_volume_unref(&volume);
}

static void bad_files_are_refused(void **state) {
    (void)state;
    static const struct {
        const char *lines, *place, *text;
    } cases[] = {
        { "NDims = 3\nDimSize = 5 4\n", "DimSize", "not 3 numbers" },
        { "NDims = 3\nDimSize = 5 4 0\n", "DimSize", "axis 3 has 0 samples" },
        { "NDims = 3\nDimSize = 5 4 3.5\n", "DimSize", "whole number" },
        { "NDims = 4\nDimSize = 5 4 3 2\nElementType = MET_UCHAR\n", "DimSize", "it is cut off" },
        { "NDims = 7\n", "NDims", "2, 3 or 4" },
        { "ObjectType = Tube\n", "ObjectType", "only images" },
        { "NDims = 3\nDimSize = 5 4 3\n", "ElementType", "is missing" },
        { "NDims = 3\nDimSize = 5 4 3\nElementType = MET_STRING\n", "ElementType", "MET_STRING" },
        { "NDims = 3\nDimSize = 5 4 3\nElementType = MET_UCHAR\nBinaryData = False\n", "DimSize",
          "60 bytes cannot come out of 60 bytes of text" },
        { "NDims = 3\nDimSize = 5 4 4\nElementType = MET_UCHAR\n", "DimSize", "it is cut off" },
        { "NDims = 3\nDimSize = 5 4 3\nTransformMatrix = 0 0 0 0 1 0 0 0 1\n", "TransformMatrix",
          "length 0" },
        { "NDims = 3\nDimSize = 5 4 3\nElementSpacing = 1 x 1\n", "ElementSpacing", "not 3" },
    };
    uint8_t samples[COUNT] = { 0 };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char header[512];
        snprintf(header, sizeof header, "%sElementDataFile = LOCAL\n", cases[i].lines);
        write_both("bad.mha", header, samples, sizeof samples);
        load_error("bad.mha", i == 5 || i == 7 ? SP_ERR_UNSUPPORTED : SP_ERR_FORMAT, cases[i].place,
                   cases[i].text);
    }
    write_text("none.mhd", "%s", size_lines);
    load_error("none.mhd", SP_ERR_FORMAT, "ElementDataFile", "is missing");
    write_text("out.mhd", "%sElementType = MET_UCHAR\nElementDataFile = ../../../etc/passwd\n",
               size_lines);
    load_error("out.mhd", SP_ERR_DENIED, "", "outside");
    write_text("few.mhd", "%sElementType = MET_UCHAR\nElementDataFile = LIST\na\nb\n", size_lines);
    load_error("few.mhd", SP_ERR_FORMAT, "ElementDataFile", "2 files for 3 slices");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_and_byte_order_is_read),
        cmocka_unit_test(the_grid_is_read),
        cmocka_unit_test(samples_may_be_packed_or_apart),
        cmocka_unit_test(channels_are_vectors_or_fields),
        cmocka_unit_test(bad_files_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
