/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

enum { NX = 5, NY = 4, NZ = 3, COUNT = NX * NY * NZ };

static const struct {
    enum sp_type type;
    const char *names[3];
} types[SP_TYPE_COUNT] = {
    { SP_UINT8, { "uint8", "unsigned char", "uchar" } },
    { SP_INT8, { "int8", "signed char", "int8_t" } },
    { SP_UINT16, { "uint16", "unsigned short", "ushort" } },
    { SP_INT16, { "int16", "short", "signed short int" } },
    { SP_INT32, { "int32", "int", "signed int" } },
    { SP_FLOAT32, { "float", "float", "float" } },
    { SP_FLOAT64, { "double", "double", "double" } },
};

/* Returns the ramp as file contents: byte order applied, then gzip. The caller frees it. */
static void *make_payload(enum sp_type type, bool big, bool packed, size_t *size) {
    double samples[COUNT];
    make_ramp(type, COUNT, samples);
    if (big)
        import_swap(samples, sp_type_size(type), COUNT);
    *size = COUNT * sp_type_size(type);
    if (packed)
        return gzip(samples, *size, size);
    void *copy = malloc(*size);
    memcpy(copy, samples, *size);
    return copy;
}

static void every_type_byte_order_and_encoding_is_read(void **state) {
    (void)state;
    for (int t = 0; t < SP_TYPE_COUNT; t++)
        for (int variant = 0; variant < 8; variant++) {
            bool big = variant & 1, packed = variant & 2, detached = variant & 4;
            size_t size;
            void *payload = make_payload(types[t].type, big, packed, &size);
            char header[512];
            snprintf(header, sizeof header,
                     "NRRD000%d\n# a comment: with a colon\ntype: %s\ndimension: 3\n"
                     "sizes: %d %d %d\nendian: %s\nencoding: %s\nkey:=value: of a user\n%s%s",
                     variant % 5 + 1, types[t].names[variant % 3], NX, NY, NZ,
                     big ? "big" : "little", packed ? (big ? "gz" : "gzip") : "raw",
                     detached ? "data file: payload.bin\n" : "", big ? "\n" : "\n");
            if (detached) {
                write_text("case.nhdr", "%s", header);
                write_file("payload.bin", payload, size);
            } else {
                write_both("case.nrrd", header, payload, size);
            }
            free(payload);
            struct sp_volume *volume = load(detached ? "case.nhdr" : "case.nrrd");
            const struct sp_volume_info *info = sp_volume_info(volume);
            assert_int_equal(info->type, types[t].type);
            assert_string_equal(info->name, "case");
            assert_string_equal(info->source, in_folder(detached ? "case.nhdr" : "case.nrrd"));
            assert_int_equal(info->grid.dims[0], NX);
            assert_int_equal(info->grid.dims[1], NY);
            assert_int_equal(info->grid.dims[2], NZ);
            assert_is_ramp(volume, COUNT);
            sp_volume_unref(&volume);
        }
}

/* Writes a uint8 volume of COUNT samples whose header has these additional fields. */
static void write_bytes(const char *name, const char *fields) {
    uint8_t samples[COUNT];
    char header[1024];
    make_ramp(SP_UINT8, COUNT, samples);
    snprintf(header, sizeof header,
             "NRRD0005\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n%s\n", fields);
    write_both(name, header, samples, sizeof samples);
}

static void assert_grid(const char *fields, const double spacing[3], const double origin[3],
                        const double direction[3][3], const char *unit) {
    write_bytes("grid.nrrd", fields);
    struct sp_volume *volume = load("grid.nrrd");
    const struct sp_volume_info *info = sp_volume_info(volume);
    for (int i = 0; i < 3; i++) {
        if (fabs(info->grid.spacing[i] - spacing[i]) > 1e-12 ||
            fabs(info->grid.origin[i] - origin[i]) > 1e-12)
            fail_msg("%s: axis %d has spacing %g, origin %g", fields, i, info->grid.spacing[i],
                     info->grid.origin[i]);
        for (int j = 0; j < 3; j++)
            if (fabs(info->grid.direction[i][j] - direction[i][j]) > 1e-12)
                fail_msg("%s: direction[%d][%d] is %g", fields, i, j, info->grid.direction[i][j]);
    }
    assert_string_equal(info->unit, unit);
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
}

static void geometry_equals_that_of_the_header(void **state) {
    (void)state;
    static const double one[3] = { 1, 1, 1 }, zero[3] = { 0, 0, 0 };
    static const double identity[3][3] = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } };
    assert_grid("", one, zero, identity, "");
    assert_grid("spacings: 0.5 2 3.25\nunits: \"mm\" \"mm\" \"mm\"\n",
                (const double[]){ 0.5, 2, 3.25 }, zero, identity, "mm");
    assert_grid("spacings: 2 2 2\naxis mins: 10 -20 30\ncenters: cell node cell\n",
                (const double[]){ 2, 2, 2 }, (const double[]){ 11, -20, 31 }, identity, "");
    assert_grid("axis mins: 0 0 0\naxis maxs: 10 6 6\ncenters: cell node cell\n",
                (const double[]){ 2, 2, 2 }, (const double[]){ 1, 0, 1 }, identity, "");
    /* Rotated, mirrored and sheared axes. In every space the orientation stays as in the
     * file. */
    assert_grid("space: left-posterior-superior\nspace directions: (0,2,0) (-3,0,0) (0,0,0.5)\n"
                "space origin: (1.5,-2.5,1e3)\nspace units: \"mm\" \"mm\" \"mm\"\n",
                (const double[]){ 2, 3, 0.5 }, (const double[]){ 1.5, -2.5, 1000 },
                (const double[3][3]){ { 0, -1, 0 }, { 1, 0, 0 }, { 0, 0, 1 } }, "mm");
    assert_grid("space dimension: 3\nspace directions: (1,0,0) (0.6,0.8,0) (0,0,-4)\n"
                "kinds: space space domain\n",
                (const double[]){ 1, 1, 4 }, zero,
                (const double[3][3]){ { 1, 0.6, 0 }, { 0, 0.8, 0 }, { 0, 0, -1 } }, "");
    /* Without "space" and "space dimension", as some programs write it. */
    assert_grid("space directions: (2,0,0) (0,2,0) (0,0,2)\nspace origin: (1,2,3)\n",
                (const double[]){ 2, 2, 2 }, (const double[]){ 1, 2, 3 }, identity, "");
}

/* Only a space that names directions of the body states them, and only for its vectors. */
static void sample_units_are_the_unit_of_the_values(void **state) {
    (void)state;
    static const struct {
        const char *line, *unit;
    } cases[] = {
        { "", "" },
        { "sample units: HU\n", "HU" },
        { "sampleunits: \"g/cm^3\"\n", "g/cm^3" },
        { "sample units: \"\"\n", "" },
        { "sample units: 31 bytes are the longest unit__\n", "31 bytes are the longest unit__" },
        { "sample units: 32 bytes are no unit of a volume\n", "" },
    };
    uint8_t samples[COUNT];
    make_ramp(SP_UINT8, COUNT, samples);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char header[256];
        snprintf(header, sizeof header,
                 "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\n%sencoding: raw\n\n",
                 cases[i].line);
        write_both("v.nrrd", header, samples, sizeof samples);
        struct sp_volume *volume = load("v.nrrd");
        assert_string_equal(sp_volume_info(volume)->value_unit, cases[i].unit);
        sp_volume_unref(&volume);
    }
}

static void anatomical_spaces_name_the_world_axes(void **state) {
    (void)state;
    static const struct {
        const char *fields, *anatomy;
    } cases[] = {
        { "space: right-anterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n", "RAS" },
        { "space: RAS\nspace directions: (0,1,0) (1,0,0) (0,0,-1)\n", "RAS" },
        { "space: left-posterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n", "LPS" },
        { "space: las\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n", "LPS" },
        { "space: scanner-xyz\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n", "" },
        { "space dimension: 3\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n", "" },
        { "space: LPS\n", "" }, /* the axes of the grid have no place in that space */
        { "", "" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_bytes("anatomy.nrrd", cases[i].fields);
        struct sp_volume *volume = load("anatomy.nrrd");
        assert_string_equal(sp_volume_info(volume)->anatomy, cases[i].anatomy);
        sp_volume_unref(&volume);
    }
}

static void two_axes_are_one_slice(void **state) {
    (void)state;
    uint8_t samples[20];
    make_ramp(SP_UINT8, 20, samples);
    write_both("flat.nrrd",
               "NRRD0004\ntype: uint8\ndimension: 2\nsizes: 5 4\nencoding: raw\n"
               "spacings: 2 3\n\n",
               samples, 20);
    struct sp_volume *volume = load("flat.nrrd");
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], 1);
    assert_compare(sp_volume_info(volume)->grid.spacing[1], ==, 3);
    assert_is_ramp(volume, 20);
    sp_volume_unref(&volume);
    write_both(
        "flat.nrrd",
        "NRRD0004\ntype: uint8\ndimension: 2\nsizes: 5 4\nencoding: raw\nspace dimension: 3\n"
        "space directions: (0,0,2) (3,0,0)\n\n",
        samples, 20);
    volume = load("flat.nrrd");
    assert_compare(sp_volume_info(volume)->grid.direction[1][2], ==, 1);
    sp_volume_unref(&volume);
}

static void samples_may_be_in_several_files(void **state) {
    (void)state;
    uint8_t samples[COUNT];
    make_ramp(SP_UINT8, COUNT, samples);
    char name[32];
    assert_int_equal(mkdir(in_folder("parts"), 0700), 0);
    for (int k = 0; k < NZ; k++) {
        snprintf(name, sizeof name, "parts/s%03d.raw", k + 8);
        write_file(name, samples + k * NX * NY, NX * NY);
        size_t size;
        void *packed = gzip(samples + k * NX * NY, NX * NY, &size);
        snprintf(name, sizeof name, "parts/p%d.gz", k);
        write_file(name, packed, size);
        free(packed);
    }
    static const char *const ends[] = {
        "encoding: raw\ndata file: LIST\nparts/s008.raw\nparts/s009.raw\r\nparts/s010.raw\n",
        "encoding: raw\ndata file: LIST 2\nparts/s008.raw\nparts/s009.raw\nparts/s010.raw",
        "encoding: raw\ndata file: LIST 3\nparts/s008.raw\nparts/s009.raw\nparts/s010.raw\n",
        "encoding: raw\ndata file: parts/s%03d.raw 8 10 1\n\n",
        "encoding: raw\ndata file: parts/s%03d.raw 8 10 1 2\n",
        "encoding: gzip\ndatafile: ./parts/p%d.gz 0 2 1\n",
        "encoding: gzip\ndata file: LIST\nparts/p0.gz\n./parts/../parts/p1.gz\nparts/p2.gz\n",
    };
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        write_text("many.nhdr", "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\n%s", ends[i]);
        struct sp_volume *volume = load("many.nhdr");
        assert_is_ramp(volume, COUNT);
        sp_volume_unref(&volume);
    }
    static const struct {
        const char *end, *text;
    } wrong[] = {
        { "LIST\nparts/s008.raw\nparts/s009.raw\n", "names 2 files, but sizes need 3" },
        { "LIST 1\nparts/s008.raw\nparts/s009.raw\nparts/s010.raw\n", "sizes need 12" },
        { "LIST 3\nparts/s008.raw\nparts/s009.raw\n", "names 2 files" },
        { "LIST 4\nparts/s008.raw\n", "LIST must be followed by" },
        { "LIST x\nparts/s008.raw\n", "LIST must be followed by" },
        { "LIST\n", "the LIST is empty" },
        { "parts/s%03d.raw 8 10 0\n", "counts from 8 to 10 by 0" },
        { "parts/s%03d.raw 10 8 1\n", "counts from 10 to 8 by 1" },
        { "parts/s%03d.raw 2 1 5\n", "counts from 2 to 1 by 5" },
        { "parts/s%03d.raw 0 1000000 1\n", "more than 65536 files" },
        { "parts/s%03d.raw 1 2 1\n", "names 2 files" },
    };
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        write_text(
            "many.nhdr",
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\ndata file: %s",
            wrong[i].end);
        load_error("many.nhdr", SP_ERR_FORMAT, "many.nhdr: byte 61: data file", wrong[i].text);
    }
    /* These are not patterns: each is taken as a plain file name, and that file does not exist. */
    static const char *const names[] = { "parts/s%n.raw 8 10 1", "parts/s%s.raw 8 10 1",
                                         "parts/s%d%d.raw 8 10 1", "100%.raw" };
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        write_text(
            "many.nhdr",
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\ndata file: %s",
            names[i]);
        load_error("many.nhdr", SP_ERR_NOT_FOUND, names[i], "there is no such file");
    }
}

static void line_and_byte_skips_are_applied(void **state) {
    (void)state;
    uint8_t bytes[100] = "two\nlines\nJUNK";
    make_ramp(SP_UINT8, COUNT, bytes + 14);
    write_file("skip.raw", bytes, 100);
    size_t size;
    void *packed = gzip(bytes + 10, 90, &size);
    write_both("skip.gz", "two\nlines\n", packed, size);
    free(packed);
    write_file("tail.raw", bytes, 14 + COUNT);
    static const char *const ends[] = {
        "encoding: raw\nline skip: 2\nbyte skip: 4\ndata file: skip.raw\n",
        "encoding: raw\nbyte skip: 14\ndata file: skip.raw\n",
        "encoding: raw\nbyteskip: -1\ndata file: tail.raw\n",
        "encoding: gzip\nline skip: 2\nbyte skip: 4\ndata file: skip.gz\n",
    };
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        write_text("skip.nhdr", "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\n%s", ends[i]);
        struct sp_volume *volume = load("skip.nhdr");
        assert_is_ramp(volume, COUNT);
        sp_volume_unref(&volume);
    }
    static const struct {
        const char *end, *place, *text;
    } wrong[] = {
        { "encoding: raw\nline skip: 3\n", "skip.raw: byte 100: line skip", "1 lines are missing" },
        { "encoding: raw\nbyte skip: 41\n", "skip.raw: byte 0: sizes",
          "need 60 bytes, the file has 59" },
        { "encoding: raw\nbyte skip: -2\n", "byte skip", "[-1, 2^48]" },
        { "encoding: gzip\nbyte skip: -1\n", "byte skip", "needs encoding raw" },
        { "encoding: raw\nline skip: many\n", "line skip", "[0, 1000000]" },
    };
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        write_text("skip.nhdr",
                   "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\n%sdata file: skip.raw\n",
                   wrong[i].end);
        load_error("skip.nhdr", SP_ERR_FORMAT, wrong[i].place, wrong[i].text);
    }
}

static void the_faulty_field_is_named(void **state) {
    (void)state;
    static const struct {
        const char *fields, *place, *text;
    } cases[] = {
        { "spacings: 1 1e300 1\n", "byte 61: spacings", "spacing[1]" },
        { "spacings: 1 1 1e-300\n", "byte 61: spacings", "spacing[2]" },
        { "axis mins: 0 0 0\naxis maxs: 0 1 1\n", "byte 78: axis maxs", "spacing[0]" },
        { "axis mins: 1e15 0 0\nspacings: 1 1 1\n", "byte 61: axis mins", "origin[0] is 1e+15" },
        { "space directions: (1,0,0) (1,0,0) (0,0,1)\n", "byte 61: space directions", "singular" },
        { "space directions: (1e20,0,0) (0,1,0) (0,0,1)\n", "byte 61: space directions",
          "spacing[0] is 1e+20" },
        { "space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,1e15,0)\n",
          "byte 103: space origin", "origin[1] is 1e+15, more than 2^40" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_bytes("fault.nrrd", cases[i].fields);
        load_error("fault.nrrd", SP_ERR_FORMAT, cases[i].place, cases[i].text);
    }
    write_text("fault.nrrd", "NRRD0004\ntype: block\ndimension: 3\nsizes: 5 4 3\n"
                             "encoding: raw\n\n");
    load_error("fault.nrrd", SP_ERR_UNSUPPORTED, "byte 9: type", "blocks of bytes");
}

static void errors_explain_hostile_headers(void **state) {
    (void)state;
    static const struct {
        const char *text; /* a header, which 60 bytes of samples follow */
        enum sp_code code;
        const char *place, *message;
    } cases[] = {
        { "NRRD0009\n", SP_ERR_UNSUPPORTED, "byte 7", "NRRD version 9" },
        { "NRRD\n", SP_ERR_FORMAT, "byte 0", "starts with the line NRRD0001" },
        { "NRRD00051\n", SP_ERR_FORMAT, "byte 0", "starts with the line" },
        { "NRRD0004\ntype: uint8\n\n", SP_ERR_FORMAT, "dimension", "without this field" },
        { "NRRD0004\nhello\n\n", SP_ERR_FORMAT, "byte 9", "\"hello\" is neither a field" },
        { "NRRD0004\ncolour: red\n\n", SP_ERR_FORMAT, "byte 9", "\"colour\" is not a field" },
        { "NRRD0004\ntype: uint8\ntype: int8\n\n", SP_ERR_FORMAT, "byte 21: type",
          "this field twice" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\ndata file:\n\n",
          SP_ERR_FORMAT, "byte 61: data file", "names no file" },
        { "NRRD0004\ntype: uint8\ndimension: 0\nsizes: 5\nencoding: raw\n\n", SP_ERR_FORMAT,
          "byte 21: dimension", "\"0\" is not a number in [1, 16]" },
        { "NRRD0004\ntype: uint8\ndimension: 99999999999999999999\nsizes: 5\nencoding: raw\n\n",
          SP_ERR_FORMAT, "dimension", "not a number in [1, 16]" },
        { "NRRD0004\ntype: uint8\ndimension: 1\nsizes: 60\nencoding: raw\n\n", SP_ERR_UNSUPPORTED,
          "dimension", "1 axes; a volume has three" },
        { "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 5 4 3 1\nkinds: time space time space\n"
          "encoding: raw\n\n",
          SP_ERR_UNSUPPORTED, "kinds", "axis 2 lies between" },
        { "NRRD0004\ntype: uint8\ndimension: 5\nsizes: 5 4 3 1 1\nencoding: raw\n\n",
          SP_ERR_UNSUPPORTED, "dimension", "5 axes, 5 of them in space" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4\nencoding: raw\n\n", SP_ERR_FORMAT,
          "byte 34: sizes", "has 2 numbers instead of 3" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3 2\nencoding: raw\n\n", SP_ERR_FORMAT,
          "sizes", "more than the 3 numbers" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 0 3\nencoding: raw\n\n", SP_ERR_FORMAT,
          "sizes", "number 2 of \"5 0 3\"" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 -4 3\nencoding: raw\n\n", SP_ERR_FORMAT,
          "sizes", "number 2 of \"5 -4 3\"" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4.5 3\nencoding: raw\n\n", SP_ERR_FORMAT,
          "sizes", "number 2" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 18446744073709551619\nencoding: raw\n\n",
          SP_ERR_FORMAT, "sizes", "number 3" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4294967295 4294967295 4294967295\n"
          "encoding: raw\n\n",
          SP_ERR_FORMAT, "sizes", "" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 65537 1 1\nencoding: raw\n\n", SP_ERR_FORMAT,
          "sizes", "in [1, 65536]" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 65536 65536 65536\nencoding: raw\n\n",
          SP_ERR_FORMAT, "sizes", "voxels" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4096 4096 4096\nencoding: raw\n\n",
          SP_ERR_FORMAT, "byte 71: sizes", "need 68719476736 bytes, the file has 60" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 6 4 3\nencoding: raw\n\n", SP_ERR_FORMAT,
          "byte 62: sizes", "need 72 bytes, the file has 60" },
        { "NRRD0004\ntype: int4\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n\n", SP_ERR_FORMAT,
          "byte 9: type", "int4" },
        { "NRRD0004\ntype: block\nblock size: 3\ndimension: 3\nsizes: 5 4 1\nendian: "
          "big\nencoding: raw\n\n",
          SP_ERR_UNSUPPORTED, "type", "blocks of bytes" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: bzip2\n\n", SP_ERR_FORMAT,
          "data", "bzip2 data is damaged" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: zrl\n\n",
          SP_ERR_UNSUPPORTED, "encoding", "raw or gzip" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: rot13\n\n", SP_ERR_FORMAT,
          "encoding", "rot13" },
        { "NRRD0004\ntype: int16\ndimension: 3\nsizes: 5 3 2\nencoding: raw\n\n", SP_ERR_FORMAT,
          "endian", "need this field" },
        { "NRRD0004\ntype: int16\ndimension: 3\nsizes: 5 3 2\nencoding: raw\nendian: middle\n\n",
          SP_ERR_FORMAT, "endian", "middle" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nspacings: 1 0 1\nencoding: raw\n\n",
          SP_ERR_FORMAT, "", "spacing" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nspacings: 1 inf 1\nencoding: raw\n\n",
          SP_ERR_FORMAT, "spacings", "" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nspacings: 1 2\nencoding: raw\n\n",
          SP_ERR_FORMAT, "spacings", "" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nkinds: RGB-color domain domain\n"
          "encoding: raw\n\n",
          SP_ERR_FORMAT, "kinds", "axis 0 is of kind RGB-color and has 5 samples" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nspace: left-posterior-superior\n"
          "space directions: none (1,0,0) (0,1,0)\nencoding: raw\n\n",
          SP_ERR_FORMAT, "space directions", "axis 0 has no direction" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nspace: left-posterior-superior\n"
          "space directions: (1,0,0) (2,0,0) (0,1,0)\nencoding: raw\n\n",
          SP_ERR_FORMAT, "", "singular" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nspace: left-posterior-superior\n"
          "space directions: (1,0,0) (0,1,0)\nencoding: raw\n\n",
          SP_ERR_FORMAT, "space directions", "" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nspace dimension: 4\n"
          "space directions: (1,0,0,0) (0,1,0,0) (0,0,1,0)\nencoding: raw\n\n",
          SP_ERR_UNSUPPORTED, "space dimension", "4 dimensions" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nunits: \"mm\" \"mm\" \"s\"\n"
          "encoding: raw\n\n",
          SP_ERR_UNSUPPORTED, "units", "\"mm\" and \"s\" differ" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: gzip\n\n", SP_ERR_FORMAT,
          "data", "damaged" },
        { "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5000 4000 3\nencoding: gzip\n\n",
          SP_ERR_FORMAT, "sizes", "60000000 bytes cannot come out of 60 bytes of gzip" },
    };
    uint8_t samples[COUNT];
    make_ramp(SP_UINT8, COUNT, samples);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_both("hostile.nrrd", cases[i].text, samples, COUNT);
        load_error("hostile.nrrd", cases[i].code, cases[i].place, cases[i].message);
    }
}

static void errors_explain_truncated_headers(void **state) {
    (void)state;
    write_text("cut.nrrd", "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n");
    load_error("cut.nrrd", SP_ERR_FORMAT, "cut.nrrd: byte 61", "before the blank line");
    write_file("cut.nrrd", "NRRD0004\ntype: ui\0t8\n\n", 22);
    load_error("cut.nrrd", SP_ERR_FORMAT, "cut.nrrd: byte 17", "a byte of value 0");
    write_file("cut.nrrd", "", 0);
    load_error("cut.nrrd", SP_ERR_FORMAT, "cut.nrrd: byte 0", "the file is empty");
    size_t n = 3 << 20;
    char *longer = malloc(n);
    memset(longer, '#', n);
    memcpy(longer, "NRRD0004\n", 9);
    for (size_t i = 100; i < n; i += 100)
        longer[i] = '\n';
    write_file("cut.nrrd", longer, n);
    load_error("cut.nrrd", SP_ERR_FORMAT, "cut.nrrd: byte 1048576", "longer than 1 MiB");
    memset(longer + 9, '5', n - 9);
    memcpy(longer + 9, "sizes: ", 7);
    longer[500000] = '\n';
    write_file("cut.nrrd", longer, n);
    load_error("cut.nrrd", SP_ERR_FORMAT, "cut.nrrd: byte 9: sizes", "the limit is 4096");
    free(longer);
}

static void gzip_data_must_have_the_declared_size(void **state) {
    (void)state;
    static const char header[] =
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 100 100 100\nencoding: gzip\n\n";
    size_t bytes = 1000000, size, more;
    uint8_t *samples = calloc(1, 3000000);
    uint32_t seed = 1;
    for (size_t i = 0; i < bytes; i++)
        samples[i] = (uint8_t)((seed = seed * 1664525 + 1013904223) >> 27);
    uint8_t *packed = gzip(samples, bytes, &size);
    write_both("g.nrrd", header, packed, size);
    struct sp_volume *volume = load("g.nrrd");
    assert_memory_equal(sp_volume_voxels(volume), samples, bytes);
    sp_volume_unref(&volume);

    write_both("g.nrrd", header, packed, size / 2);
    load_error("g.nrrd", SP_ERR_FORMAT, "g.nrrd: byte", "cut off after");
    write_both("g.nrrd", header, packed, size - 3);
    load_error("g.nrrd", SP_ERR_FORMAT, "g.nrrd: byte", "cut off after");
    packed[size - 6] ^= 1; /* a byte of the checksum */
    write_both("g.nrrd", header, packed, size);
    load_error("g.nrrd", SP_ERR_FORMAT, ": data", "damaged: incorrect data check");
    packed[size - 6] ^= 1;
    packed[size / 2] ^= 0x55;
    write_both("g.nrrd", header, packed, size);
    load_error("g.nrrd", SP_ERR_FORMAT, ": data", "damaged");
    packed[size / 2] ^= 0x55;
    free(packed);

    packed = gzip(samples, bytes - 1, &size);
    write_both("g.nrrd", header, packed, size);
    load_error("g.nrrd", SP_ERR_FORMAT, ": sizes", "need 1000000 bytes, the file has 999999");
    free(packed);
    packed = gzip(samples, bytes + 1, &size);
    write_both("g.nrrd", header, packed, size);
    load_warns("g.nrrd", "g.nrrd has more data after the samples");
    free(packed);

    /* A decompression bomb: 3 MB of zeros where the header declares 1 MB. */
    memset(samples, 0, 3000000);
    packed = gzip(samples, 3000000, &size);
    write_both("g.nrrd", header, packed, size);
    load_warns("g.nrrd", "They were not read: sizes or the type may be wrong");
    free(packed);

    /* Concatenated gzip members are one stream; bytes after the last member are ignored. */
    packed = gzip(samples, 400000, &size);
    uint8_t *second = gzip(samples, 600000, &more), *both = malloc(size + more + 5);
    memcpy(both, packed, size);
    memcpy(both + size, second, more);
    memcpy(both + size + more, "\0\0\0\0", 5);
    write_both("g.nrrd", header, both, size + more + 5);
    volume = load("g.nrrd");
    assert_int_equal(sp_volume_info(volume)->histogram[0], 1000000);
    sp_volume_unref(&volume);
    free(packed);
    free(second);
    free(both);
    free(samples);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_byte_order_and_encoding_is_read),
        cmocka_unit_test(geometry_equals_that_of_the_header),
        cmocka_unit_test(sample_units_are_the_unit_of_the_values),
        cmocka_unit_test(anatomical_spaces_name_the_world_axes),
        cmocka_unit_test(two_axes_are_one_slice),
        cmocka_unit_test(samples_may_be_in_several_files),
        cmocka_unit_test(line_and_byte_skips_are_applied),
        cmocka_unit_test(the_faulty_field_is_named),
        cmocka_unit_test(errors_explain_hostile_headers),
        cmocka_unit_test(errors_explain_truncated_headers),
        cmocka_unit_test(gzip_data_must_have_the_declared_size),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
