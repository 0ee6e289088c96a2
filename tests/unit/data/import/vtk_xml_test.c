/* SPDX-License-Identifier: Apache-2.0
 *
 * XML files of VTK, in every encoding of their numbers.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

enum { COUNT = 60, BLOCK = 64 /* bytes per compressed block */ };

static const char *const xml_names[SP_TYPE_COUNT] = { "UInt8", "Int8",    "UInt16", "Int16",
                                                      "Int32", "Float32", "Float64" };

/* The contents of a file while it is composed. */
struct draft {
    char bytes[1 << 16];
    size_t size;
};

static void add_bytes(struct draft *d, const void *bytes, size_t size) {
    assert_compare(d->size + size, <=, sizeof d->bytes);
    memcpy(d->bytes + d->size, bytes, size);
    d->size += size;
}

__attribute__((format(printf, 2, 3))) static void add(struct draft *d, const char *format, ...) {
    va_list args;
    va_start(args, format);
    d->size += (size_t)vsnprintf(d->bytes + d->size, sizeof d->bytes - d->size, format, args);
    va_end(args);
    assert_compare(d->size, <, sizeof d->bytes);
}

static void add_base64(struct draft *d, const uint8_t *bytes, size_t size) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < size; i += 3) {
        uint32_t group = (uint32_t)bytes[i] << 16;
        group |= i + 1 < size ? (uint32_t)bytes[i + 1] << 8 : 0;
        group |= i + 2 < size ? bytes[i + 2] : 0;
        for (unsigned k = 0; k < 4; k++)
            add(d, "%c", i + k > size ? '=' : digits[group >> (18 - 6 * k) & 63]);
    }
}

struct encoding {
    bool base64, zlib, big_endian, long_lengths;
};

static void add_length(struct draft *d, struct encoding e, uint64_t length) {
    size_t n = e.long_lengths ? 8 : 4;
    for (size_t i = 0; i < n; i++)
        add_bytes(d, &(uint8_t){ (uint8_t)(length >> 8 * (e.big_endian ? n - 1 - i : i)) }, 1);
}

static void add_zlib(struct draft *lengths, struct draft *data, struct encoding e,
                     const uint8_t *values, size_t size) {
    size_t blocks = (size + BLOCK - 1) / BLOCK;
    add_length(lengths, e, blocks);
    add_length(lengths, e, BLOCK);
    add_length(lengths, e, size % BLOCK);
    for (size_t i = 0; i < blocks; i++) {
        uint8_t packed[2 * BLOCK + 64];
        size_t n = i + 1 < blocks || size % BLOCK == 0 ? BLOCK : size % BLOCK;
        uLongf length = sizeof packed;
        assert_int_equal(compress(packed, &length, values + i * BLOCK, n), Z_OK);
        add_length(lengths, e, length);
        add_bytes(data, packed, length);
    }
}

/* Adds an array as VTK writes it: lengths and values are one base64 text, with zlib two texts. */
static void add_values(struct draft *d, struct encoding e, const void *values, size_t size) {
    static struct draft lengths, data;
    lengths.size = data.size = 0;
    if (e.zlib) {
        add_zlib(&lengths, &data, e, values, size);
    } else {
        add_length(&data, e, size);
        add_bytes(&data, values, size);
    }
    if (e.base64) {
        add_base64(d, (uint8_t *)lengths.bytes, lengths.size);
        add_base64(d, (uint8_t *)data.bytes, data.size);
    } else {
        add_bytes(d, lengths.bytes, lengths.size);
        add_bytes(d, data.bytes, data.size);
    }
}

static void add_root(struct draft *d, const char *type, struct encoding e) {
    d->size = 0;
    add(d,
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"%s\" version=\"1.0\" byte_order=\"%s\" "
        "header_type=\"%s\"%s>\n",
        type, e.big_endian ? "BigEndian" : "LittleEndian", e.long_lengths ? "UInt64" : "UInt32",
        e.zlib ? " compressor=\"vtkZLibDataCompressor\"" : "");
}

static void make_values(enum sp_type type, struct encoding e, void *out) {
    make_ramp(type, COUNT, out);
    if (e.big_endian)
        import_swap(out, sp_type_size(type), COUNT);
}

/* The bits of `variant`: base64, zlib, big endian, lengths of 8 bytes, appended data. Each type
 * takes a third of them, and each of them two types or three. */
static void every_type_and_every_encoding_is_read(void **state) {
    (void)state;
    static struct draft d;
    for (int t = 0; t < SP_TYPE_COUNT; t++)
        for (int variant = t % 3; variant < 32; variant += 3) {
            struct encoding e = { variant & 1, variant & 2, variant & 4, variant & 8 };
            bool appended = variant & 16;
            if (!appended && !e.base64) /* the format has no raw inline bytes */
                continue;
            enum sp_type type = (enum sp_type)t;
            double values[COUNT];
            size_t size = COUNT * sp_type_size(type);
            make_values(type, e, values);
            add_root(&d, "ImageData", e);
            add(&d, "<ImageData WholeExtent=\"0 4 0 3 0 2\" Origin=\"1 2 3\" Spacing=\"1 2 .5\">"
                    "<FieldData><DataArray type=\"String\" Name=\"n\" format=\"ascii\">48 0"
                    "</DataArray></FieldData><Piece Extent=\"0 4 0 3 0 2\">\n"
                    "<PointData Scalars=\"s\">\n");
            add(&d, "<DataArray type=\"%s\" Name=\"s\" format=\"%s\" offset=\"%d\">\n  ",
                xml_names[t], appended ? "appended" : "binary", 7);
            if (!appended)
                add_values(&d, e, values, size);
            add(&d, "\n  <InformationKey name=\"RANGE\" length=\"1\"><Value>3</Value>"
                    "</InformationKey>\n</DataArray></PointData><CellData/></Piece></ImageData>\n");
            if (appended) {
                add(&d, "<AppendedData encoding=\"%s\">\n   _", e.base64 ? "base64" : "raw");
                add(&d, "another");
                add_values(&d, e, values, size);
                add(&d, "\n</AppendedData>");
            }
            add(&d, "</VTKFile>\n");
            write_file("v.vti", d.bytes, d.size);
            struct sp_volume *volume = load("v.vti");
            const struct sp_volume_info *info = sp_volume_info(volume);
            assert_int_equal(info->type, type);
            assert_int_equal(info->grid.dims[0], 5);
            assert_int_equal(info->grid.dims[1], 4);
            assert_compare(info->grid.origin[2], ==, 3);
            assert_compare(info->grid.spacing[2], ==, 0.5);
            assert_is_ramp(volume, COUNT);
            sp_volume_unref(&volume);
        }
}

#define ROOT "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\">"
#define IMAGE ROOT "<ImageData><Piece Extent=\"0 1 0 1 0 0\">"
#define REST "</Piece></ImageData></VTKFile>"
#define ARRAY "<DataArray type=\"UInt8\" Name=\"s\" format=\"ascii\">"

static void geometry_equals_that_of_the_file(void **state) {
    (void)state;
    write_text("g.vti",
               "\xef\xbb\xbf \n" ROOT
               "<ImageData WholeExtent=\"-1 9 3 9 4 9\" Origin=\"10 20 30\" Spacing=\"2 3 4\" "
               "Direction=\"0 -1 0  0.7071 0 -0.7071  0.7071 0 0.7071\">"
               "<Piece Extent=\"-1 0 3 4 5 5\"><PointData>" ARRAY "1 2 3 4</DataArray>"
               "</PointData>" REST);
    struct sp_volume *volume = load("g.vti");
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    assert_int_equal(grid->dims[0], 2);
    assert_int_equal(grid->dims[1], 2);
    assert_int_equal(grid->dims[2], 1);
    assert_compare(grid->spacing[0], ==, 2);
    assert_compare(grid->spacing[1], ==, 3);
    assert_compare(grid->spacing[2], ==, 4);
    const double h = sqrt(0.5); /* rounded directions are normalized */
    const double expected[3][3] = { { 0, -1, 0 }, { h, 0, -h }, { h, 0, h } };
    /* The piece begins at index (-1, 3, 5): the offset is direction · (-2, 9, 20). */
    const double origin[3] = { 10 - 9, 20 - 2 * h - 20 * h, 30 - 2 * h + 20 * h };
    for (int r = 0; r < 3; r++) {
        assert_float_equal(grid->origin[r], origin[r], 1e-12);
        for (int a = 0; a < 3; a++)
            assert_float_equal(grid->direction[r][a], expected[r][a], 1e-15);
    }
    assert_memory_equal(sp_volume_voxels(volume), "\1\2\3\4", 4);
    sp_volume_unref(&volume);
}

/* Coordinates of three types in three encodings, with extents that do not begin at 0. */
static void rectilinear_grids_keep_their_coordinates(void **state) {
    (void)state;
    static struct draft d;
    for (int variant = 0; variant < 4; variant++) {
        struct encoding e = { .zlib = variant & 1, .big_endian = variant & 2, .base64 = true };
        struct encoding raw = e;
        raw.base64 = false;
        float x[5] = { -1, 0, 2, 4.5f, 7 };
        int64_t z[3] = { 9, 8, 3 };
        uint8_t values[COUNT];
        make_ramp(SP_UINT8, COUNT, values);
        if (e.big_endian) {
            import_swap(x, 4, 5);
            import_swap(z, 8, 3);
        }
        add_root(&d, "RectilinearGrid", e);
        add(&d, "<RectilinearGrid WholeExtent=\"2 6 0 3 -1 1\"><Piece Extent=\"2 6 0 3 -1 1\">\n"
                "<PointData><DataArray type=\"UInt8\" Name=\"a\" format=\"appended\" offset=\"0\"/>"
                "</PointData><Coordinates><DataArray type=\"Float32\" format=\"binary\">\n");
        add_values(&d, e, x, sizeof x);
        add(&d,
            "\n</DataArray><DataArray type=\"Float64\" format=\"ascii\">\n 0.5 1\n 2 7 "
            "</DataArray><DataArray type=\"Int64\" format=\"appended\" offset=\"%d\"/>"
            "</Coordinates></Piece></RectilinearGrid><AppendedData encoding=\"raw\">_",
            200);
        size_t begin = d.size;
        add_values(&d, raw, values, COUNT);
        while (d.size < begin + 200)
            add(&d, " ");
        add_values(&d, raw, z, sizeof z);
        write_file("v.vtr", d.bytes, d.size); /* the end tags may be missing */
        struct sp_volume *volume = load("v.vtr");
        const struct sp_grid *grid = &sp_volume_info(volume)->grid;
        static const double ex[] = { 0, 1, 3, 5.5, 8 }, ey[] = { 0, .5, 1.5, 6.5 },
                            ez[] = { 0, 1, 6 };
        assert_memory_equal(grid->coordinates[0], ex, sizeof ex);
        assert_memory_equal(grid->coordinates[1], ey, sizeof ey);
        assert_memory_equal(grid->coordinates[2], ez, sizeof ez);
        assert_compare(grid->origin[0], ==, -1);
        assert_compare(grid->origin[1], ==, 0.5);
        assert_compare(grid->origin[2], ==, 9);
        assert_compare(grid->direction[0][0], ==, 1);
        assert_compare(grid->direction[2][2], ==, -1);
        assert_is_ramp(volume, COUNT);
        sp_volume_unref(&volume);
    }
}

static void the_array_named_by_scalars_is_read(void **state) {
    (void)state;
    static const struct {
        const char *scalars, *arrays;
        const char *expected;
    } cases[] = {
        { "", ARRAY "1 2 3 4</DataArray>", "\1\2\3\4" },
        { " Scalars=\"t\"", ARRAY "1 2 3 4</DataArray>", "\1\2\3\4" },
        { " Scalars=\"t\"",
          ARRAY "1 2 3 4</DataArray><DataArray type=\"UInt8\" Name=\"t\">5 6 7 8</DataArray>",
          "\5\6\7\10" },
        { "",
          "<DataArray type=\"UInt8\" Name=\"v\" NumberOfComponents=\"3\">1 2 3 4 5 6 7 8 9 1 2 3"
          "</DataArray>" ARRAY "1 2 3 4</DataArray>"
          "<DataArray type=\"Bit\" Name=\"b\">1 0 1 1</DataArray>"
          "<DataArray type=\"UInt8\" Name=\"t\">5 6 7 8</DataArray>",
          "\1\2\3\4" },
        { " Scalars=\"v\"",
          "<DataArray type=\"UInt8\" Name=\"v\" NumberOfComponents=\"3\">1 2 3 4 5 6 7 8 9 1 2 3"
          "</DataArray>" ARRAY "1 2 3 4</DataArray>",
          "\1\2\3\4" },
        { "", "<Array type=\"UInt8\"/>" ARRAY "1 2 <!-- not of it -->3 4</DataArray>", NULL },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_text("n.vti",
                   IMAGE "<CellData><DataArray type=\"UInt8\">9</DataArray></CellData>"
                         "<PointData%s>%s</PointData>" REST,
                   cases[i].scalars, cases[i].arrays);
        if (!cases[i].expected) {
            load_error("n.vti", SP_ERR_FORMAT, "DataArray \"s\"", "value 2, \"<!--\"");
            continue;
        }
        struct sp_volume *volume = load("n.vti");
        assert_memory_equal(sp_volume_voxels(volume), cases[i].expected, 4);
        sp_volume_unref(&volume);
    }
}

/* Vectors in each encoding with numbers of 8 bytes, beside samples. */
static void vectors_are_read_from_every_encoding(void **state) {
    (void)state;
    static struct draft d;
    for (int variant = 0; variant < 8; variant++) {
        struct encoding e = { variant & 1, variant & 2, variant & 4, true };
        double values[COUNT];
        uint8_t samples[COUNT / 3];
        make_values(SP_FLOAT64, e, values);
        make_ramp(SP_UINT8, COUNT / 3, samples);
        add_root(&d, "ImageData", e);
        add(&d, "<ImageData><Piece Extent=\"0 4 0 1 0 1\"><PointData><DataArray type=\"UInt8\" "
                "Name=\"s\" format=\"appended\" offset=\"0\"/><DataArray type=\"Float64\" "
                "Name=\"v\" NumberOfComponents=\"3\" format=\"appended\" offset=\"200\"/>"
                "</PointData></Piece></ImageData>");
        add(&d, "<AppendedData encoding=\"%s\">_", e.base64 ? "base64" : "raw");
        size_t begin = d.size;
        add_values(&d, e, samples, sizeof samples);
        while (d.size < begin + 200)
            add(&d, " ");
        add_values(&d, e, values, sizeof values);
        write_file("v.vti", d.bytes, d.size);
        struct sp_volume *volume = load("v.vti");
        const struct sp_volume_info *info = sp_volume_info(volume);
        assert_is_ramp(volume, COUNT / 3);
        assert_string_equal(info->value_name, "s");
        assert_string_equal(info->vector_name, "v");
        for (size_t i = 0; i < COUNT; i++)
            assert_float_equal(sp_volume_vectors(volume)[i / 3][i % 3], ramp_value(SP_FLOAT64, i),
                               1e-8);
        sp_volume_unref(&volume);
        write_file("v.vti", d.bytes, d.size - 9);
        load_error("v.vti", SP_ERR_FORMAT, "DataArray \"v\"", "");
    }
}

#define TRIPLES(name, type)                                                                        \
    "<DataArray type=\"" type "\" Name=\"" name "\" NumberOfComponents=\"3\">"                     \
    "1 2 3 4 5 6 7 8 9 1 2 3</DataArray>"

static void the_array_named_by_vectors_is_read(void **state) {
    (void)state;
    static const struct {
        const char *selection, *arrays, *value_name, *vector_name;
    } cases[] = {
        { "", TRIPLES("v", "Int16"), "magnitude", "v" },
        { "",
          TRIPLES("rgb", "UInt8") TRIPLES("v", "Int64") TRIPLES("w", "Int16") ARRAY
          "1 2 3 4</DataArray>",
          "s", "v" },
        { " Vectors=\"w\"", TRIPLES("v", "Int16") TRIPLES("w", "UInt8"), "magnitude", "w" },
        { " Scalars=\"v\"", TRIPLES("v", "Float32"), "magnitude", "v" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_text("n.vti", IMAGE "<PointData%s>%s</PointData>" REST, cases[i].selection,
                   cases[i].arrays);
        struct sp_volume *volume = load("n.vti");
        const struct sp_volume_info *info = sp_volume_info(volume);
        assert_string_equal(info->value_name, cases[i].value_name);
        assert_string_equal(info->vector_name, cases[i].vector_name);
        assert_compare(sp_volume_vectors(volume)[3][0], ==, 1);
        assert_float_equal(info->longest, sqrt(7 * 7 + 8 * 8 + 9 * 9), 1e-6);
        sp_volume_unref(&volume);
    }
}

#define POINTS(array) IMAGE "<PointData>" array "</PointData>" REST
#define APPENDED(type, data)                                                                       \
    IMAGE "<PointData><DataArray type=\"" type "\" Name=\"s\" format=\"appended\" offset=\"0\"/>"  \
          "</PointData></Piece></ImageData><AppendedData encoding=\"base64\">" data
#define BINARY(data)                                                                               \
    POINTS("<DataArray type=\"UInt8\" Name=\"s\" format=\"binary\">" data "</DataArray>")
#define ZLIB(data)                                                                                 \
    "<VTKFile type=\"ImageData\" compressor=\"vtkZLibDataCompressor\"><ImageData>"                 \
    "<Piece Extent=\"0 1 0 1 0 0\"><PointData>"                                                    \
    "<DataArray type=\"UInt8\" Name=\"s\" format=\"binary\">" data "</DataArray></PointData>" REST

static void errors_explain_hostile_files(void **state) {
    (void)state;
    static const struct {
        const char *text;
        enum sp_code code;
        const char *place, *message;
    } cases[] = {
        { "<", SP_ERR_FORMAT, "h.vti: byte", "line 1: " },
        { "<a>", SP_ERR_UNSUPPORTED, "h.vti: byte 0", "XML of the kind <a>" },
        { "<VTKFile>", SP_ERR_UNSUPPORTED, "type", "is missing; it must be" },
        { "<VTKFile type=\"MultiBlock\"/>", SP_ERR_UNSUPPORTED, "byte 0: type",
          "MultiBlock is not supported; supported are" },
        { "<VTKFile type=\"PImageData\"/>", SP_ERR_FORMAT, "ImageData", "without a Piece" },
        { "<VTKFile type=\"vtkOverlappingAMR\"/>", SP_ERR_UNSUPPORTED, "type",
          "vtkOverlappingAMR is not supported" },
        { "<VTKFile type=\"vtkMultiBlockDataSet\"/>", SP_ERR_FORMAT, "h.vti",
          "names no file of a block" },
        { "<VTKFile type=\"ImageData\" byte_order=\"Middle\"/>", SP_ERR_FORMAT, "byte_order",
          "\"Middle\"" },
        { "<VTKFile type=\"ImageData\" header_type=\"UInt16\"/>", SP_ERR_FORMAT, "header_type",
          "\"UInt16\"" },
        { "<VTKFile type=\"ImageData\" compressor=\"vtkBrotliDataCompressor\"/>",
          SP_ERR_UNSUPPORTED, "compressor", "vtkBrotliDataCompressor is not supported" },
        { ROOT "</VTKFile>", SP_ERR_FORMAT, "ImageData", "without a Piece" },
        { ROOT "<RectilinearGrid><Piece Extent=\"0 1 0 1 0 0\"/></RectilinearGrid></VTKFile>",
          SP_ERR_FORMAT, "ImageData", "without a Piece" },
        { ROOT "<ImageData/><ImageData/></VTKFile>", SP_ERR_FORMAT, "byte", "occurs twice" },
        { ROOT "<ImageData Origin=\"1 2\">", SP_ERR_FORMAT, "Origin", "\"1 2\" is not 3 numbers" },
        { ROOT "<ImageData Origin=\"1 2 3 4\">", SP_ERR_FORMAT, "Origin", "more than 3 numbers" },
        { ROOT "<ImageData Spacing=\"1 nan 3\">", SP_ERR_FORMAT, "Spacing", "is not 3 numbers" },
        { ROOT "<ImageData><Piece>", SP_ERR_FORMAT, "Extent", "missing" },
        { ROOT "<ImageData><Piece Extent=\"0 1 0 1 0\">", SP_ERR_FORMAT, "Extent", "6 numbers" },
        { ROOT "<ImageData><Piece Extent=\"0 -1 0 -1 0 -1\">" REST, SP_ERR_FORMAT, "ImageData",
          "the grid is empty" },
        { ROOT "<ImageData><Piece Extent=\"0 65536 0 1 0 1\">", SP_ERR_FORMAT, "Extent",
          "0 to 65536 does not hold" },
        { ROOT "<ImageData><Piece Extent=\"0 .5 0 1 0 1\">", SP_ERR_FORMAT, "Extent", "whole" },
        { ROOT "<ImageData><Piece Extent=\"-1e300 1e300 0 1 0 1\">", SP_ERR_FORMAT, "Extent",
          "whole" },
        { IMAGE "</Piece><Piece Extent=\"0 65536 0 0 0 0\">", SP_ERR_FORMAT, "Extent",
          "0 to 65536" },
        { IMAGE "</Piece><Piece Extent=\"70000 70001 0 0 0 0\"/>" REST, SP_ERR_FORMAT, "byte",
          "mismatched tag" },
        { IMAGE "</Piece><Piece Extent=\"70000 70001 0 0 0 0\">" REST, SP_ERR_UNSUPPORTED,
          "ImageData", "more than 65536 samples" },
        { IMAGE REST, SP_ERR_UNSUPPORTED, "ImageData", "neither points nor cells" },
        { IMAGE "<CellData>" ARRAY "1 2</DataArray></CellData>" REST, SP_ERR_FORMAT,
          "DataArray \"s\"", "more than 1 values" },
        { POINTS("<DataArray type=\"UInt8\" NumberOfComponents=\"x\"/>"), SP_ERR_FORMAT,
          "NumberOfComponents", "\"x\"" },
        { POINTS("<DataArray type=\"UInt32\" Name=\"s\">1 2 3 -4</DataArray>"), SP_ERR_FORMAT,
          "DataArray \"s\"", "\"-4\", is not of type unsigned_int" },
        { POINTS("<DataArray type=\"Float16\" Name=\"s\">1 2 3 4</DataArray>"), SP_ERR_UNSUPPORTED,
          "ImageData", "neither points nor cells" },
        { POINTS("<DataArray type=\"UInt8\" Name=\"s\" format=\"hex\"/>"), SP_ERR_FORMAT,
          "DataArray \"s\"", "\"hex\"" },
        { POINTS(ARRAY "1 2 3</DataArray>"), SP_ERR_FORMAT, "DataArray \"s\"", "at least 7 bytes" },
        { POINTS(ARRAY "1 2 3    </DataArray>"), SP_ERR_FORMAT, "DataArray \"s\"",
          "3 of 4 values" },
        { POINTS(ARRAY "1 2 3 4 5</DataArray>"), SP_ERR_FORMAT, "DataArray \"s\"", "more than 4" },
        { POINTS(ARRAY "1 2 3 256</DataArray>"), SP_ERR_FORMAT, "DataArray \"s\"", "\"256\"" },
        { POINTS(ARRAY "1 2 &#51; 4</DataArray>"), SP_ERR_FORMAT, "DataArray \"s\"", "\"&#51;\"" },
        { POINTS("<DataArray type=\"UInt8\" Name=\"s\" format=\"appended\" offset=\"0\"/>"),
          SP_ERR_FORMAT, "DataArray \"s\"", "before its AppendedData" },
        { POINTS("<DataArray type=\"UInt8\" Name=\"s\" format=\"appended\" offset=\"-1\"/>"),
          SP_ERR_FORMAT, "offset", "\"-1\"" },
        { POINTS("<DataArray type=\"UInt8\" Name=\"s\" format=\"appended\" offset=\"9999\"/>"),
          SP_ERR_FORMAT, "offset", "\"9999\"" },
        { IMAGE "<PointData>" ARRAY "1 2 3", SP_ERR_FORMAT, "byte", "no element found" },
        { IMAGE "<PointData>" ARRAY "1 2 3 4</PointData>", SP_ERR_FORMAT, "byte",
          "mismatched tag" },
        /* AAAABA== is 4 in the high byte of a length; BAAAAAECAwQ= is 4 and four bytes. */
        { BINARY("AAAABAECAwQ="), SP_ERR_FORMAT, "DataArray \"s\"", "declares 67108864 bytes" },
        { BINARY("BAAAAAECAw=="), SP_ERR_FORMAT, "DataArray \"s\"", "ends before the 4 values" },
        { BINARY("BAAAAAEC"), SP_ERR_FORMAT, "DataArray \"s\"", "at least 10 bytes" },
        { BINARY("BAAAAAEC*AwQ="), SP_ERR_FORMAT, "DataArray \"s\"", "not base64" },
        { BINARY("BAA="), SP_ERR_FORMAT, "DataArray \"s\"", "ends before the 4 values" },
        { BINARY("=AAA"), SP_ERR_FORMAT, "DataArray \"s\"", "not base64" },
        { BINARY(""), SP_ERR_FORMAT, "DataArray \"s\"", "ends before the 4 values" },
        { APPENDED("UInt8", "BAAAAAECAwQ="), SP_ERR_FORMAT, "AppendedData", "underscore" },
        { APPENDED("UInt8", ""), SP_ERR_FORMAT, "AppendedData", "underscore" },
        { APPENDED("UInt8", "_"), SP_ERR_FORMAT, "DataArray \"s\"", "ends before the 4 values" },
        { APPENDED("UInt8", "_</AppendedData>"), SP_ERR_FORMAT, "DataArray \"s\"", "not base64" },
        { APPENDED("UInt32", "_BAAAAAECAwQ="), SP_ERR_FORMAT, "DataArray \"s\"",
          "declares 4 bytes" },
        { IMAGE REST "<AppendedData/>", SP_ERR_FORMAT, "byte", "junk after document element" },
        { ROOT "<AppendedData encoding=\"hex\">", SP_ERR_UNSUPPORTED, "encoding", "\"hex\"" },
        /* Number of blocks, block size, size of the last block, compressed sizes. */
        { ZLIB("AQAAAAQAAAAAAAAA"), SP_ERR_FORMAT, "DataArray \"s\"", "need at least 21 bytes" },
        { ZLIB("AgAAAAQAAAAAAAAA"), SP_ERR_FORMAT, "DataArray \"s\"", "2 blocks of 4 bytes" },
        { ZLIB("/////////////////////w=="), SP_ERR_FORMAT, "DataArray \"s\"",
          "4294967295 blocks of 4294967295 bytes, the last of 4294967295" },
        { ZLIB("AAAAAAAAAAAAAAAA"), SP_ERR_FORMAT, "DataArray \"s\"", "0 blocks" },
        { ZLIB("AQAAAAQAAAAAAAAABAAAAA==AQIDBA=="), SP_ERR_FORMAT, "DataArray \"s\"",
          "zlib data is damaged" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_text("h.vti", "%s", cases[i].text);
        load_error("h.vti", cases[i].code, cases[i].place, cases[i].message);
    }
}

#define GRID                                                                                       \
    "<VTKFile type=\"RectilinearGrid\"><RectilinearGrid><Piece Extent=\"0 1 0 1 0 "                \
    "0\"><PointData>" ARRAY "1 2 3 4</DataArray></PointData><Coordinates>"
#define AXIS(values) "<DataArray type=\"Float32\">" values "</DataArray>"
#define GRID_REST "</Coordinates></Piece></RectilinearGrid></VTKFile>"

static void errors_explain_bad_coordinates(void **state) {
    (void)state;
    static const struct {
        const char *text;
        enum sp_code code;
        const char *place, *message;
    } cases[] = {
        { GRID GRID_REST, SP_ERR_FORMAT, "Coordinates", "0 arrays instead of three" },
        { GRID AXIS("0 1") AXIS("0 1") AXIS("0") AXIS("0") GRID_REST, SP_ERR_FORMAT, "Coordinates",
          "more than three" },
        { GRID AXIS("0 1 2") AXIS("0 1") AXIS("0") GRID_REST, SP_ERR_FORMAT, "DataArray",
          "more than 2 values" },
        { GRID AXIS("0 1") AXIS("0") AXIS("0") GRID_REST, SP_ERR_FORMAT, "DataArray",
          "at least 3" },
        { GRID AXIS("0 1") AXIS("3 3") AXIS("0") GRID_REST, SP_ERR_FORMAT, "RectilinearGrid",
          "coordinates[1]: the step from" },
        { GRID AXIS("0 nan") AXIS("0 1") AXIS("0") GRID_REST, SP_ERR_FORMAT, "RectilinearGrid",
          "coordinates[0]: the step from" },
        { GRID AXIS("0 1") AXIS("0 1") AXIS("inf") GRID_REST, SP_ERR_FORMAT, "RectilinearGrid",
          "origin[2] is inf" },
        { GRID "<DataArray type=\"String\"/>" GRID_REST, SP_ERR_UNSUPPORTED, "DataArray",
          "\"String\"" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_text("h.vtr", "%s", cases[i].text);
        load_error("h.vtr", cases[i].code, cases[i].place, cases[i].message);
    }
}

/* Entity expansion, external entities, endless tags and endless nesting. */
static void xml_entity_and_nesting_attacks_are_refused(void **state) {
    (void)state;
    write_text("x.vti", "<!DOCTYPE a [<!ENTITY b \"cccccccc\"><!ENTITY d \"&b;&b;&b;&b;\">]>" ROOT);
    load_error("x.vti", SP_ERR_FORMAT, "x.vti: byte", "document type (<!DOCTYPE)");
    write_text("x.vti", "<!DOCTYPE a SYSTEM \"file:///etc/passwd\">" ROOT);
    load_error("x.vti", SP_ERR_FORMAT, "x.vti: byte", "document type (<!DOCTYPE)");
    size_t n = 4 << 20;
    char *text = malloc(n);
    assert_non_null(text);
    memset(text, 'x', n);
    write_both("x.vti", ROOT "<ImageData Origin=\"", text, n);
    load_error("x.vti", SP_ERR_FORMAT, "x.vti: byte 52", "a tag is longer than 1048576 bytes");
    for (size_t i = 0; i + 3 <= n; i += 3)
        memcpy(text + i, "<a>", 3);
    write_both("x.vti", ROOT, text, n);
    load_error("x.vti", SP_ERR_FORMAT, "x.vti: byte", "nest deeper than 32");
    free(text);
}

/* Compressed data must have exactly the size that the file declares. */
static void compressed_data_of_the_wrong_size_is_refused(void **state) {
    (void)state;
    static struct draft d;
    static const struct {
        size_t unpacked;
        int cut; /* bytes added to the declared compressed size */
        const char *message;
    } cases[] = {
        { 1 << 20, 0, "larger than declared" },
        { COUNT + 1, 0, "larger than declared" },
        { COUNT - 1, 0, "shorter than declared" },
        { COUNT, -1, "is cut off" },
        { COUNT, 1, "shorter than declared" },
        { COUNT, 99, "ends before the 60 values" },
        { COUNT, 0, NULL },
    };
    char *zeros = calloc(1, 1 << 20);
    assert_non_null(zeros);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct encoding e = { .zlib = true };
        uint8_t packed[2048] = { 0 };
        uLongf size = sizeof packed;
        assert_int_equal(compress(packed, &size, (Bytef *)zeros, cases[i].unpacked), Z_OK);
        add_root(&d, "ImageData", e);
        add(&d, "<ImageData><Piece Extent=\"0 4 0 3 0 2\"><PointData><DataArray type=\"UInt8\" "
                "Name=\"s\" format=\"appended\" offset=\"0\"/></PointData></Piece></ImageData>"
                "<AppendedData encoding=\"raw\">_");
        add_length(&d, e, 1);
        add_length(&d, e, COUNT);
        add_length(&d, e, 0);
        add_length(&d, e, size + (uint64_t)cases[i].cut);
        add_bytes(&d, packed, size + (cases[i].cut == 1));
        write_file("b.vti", d.bytes, d.size);
        if (cases[i].message) {
            load_error("b.vti", SP_ERR_FORMAT, "DataArray \"s\"", cases[i].message);
            continue;
        }
        struct sp_volume *volume = load("b.vti");
        sp_volume_unref(&volume);
    }
    free(zeros);
}

static void truncated_files_are_refused(void **state) {
    (void)state;
    static struct draft d;
    struct sp_load_options options = importer_options();
    double values[COUNT];
    make_ramp(SP_FLOAT64, COUNT, values);
    for (int variant = 0; variant < 4; variant++) {
        struct encoding e = { .zlib = variant & 1, .base64 = variant & 2 };
        add_root(&d, "ImageData", e);
        add(&d,
            "<ImageData><Piece Extent=\"0 4 0 3 0 2\"><PointData><DataArray type=\"Float64\" "
            "Name=\"s\" format=\"appended\" offset=\"0\"/></PointData></Piece></ImageData>"
            "<AppendedData encoding=\"%s\">_",
            e.base64 ? "base64" : "raw");
        add_values(&d, e, values, sizeof values);
        for (size_t n = d.size; n > 0; n -= n < 16 ? n : n == d.size ? 1 : 15) {
            struct sp_error err;
            write_file("c.vti", d.bytes, n);
            struct sp_volume *volume = sp_volume_load(in_folder("c.vti"), &options, &err);
            assert_int_equal(volume != NULL, n == d.size);
            if (!volume && err.code != SP_ERR_FORMAT)
                fail_msg("truncated to %zu bytes: %s: %s", n, sp_code_name(err.code), err.text);
            sp_volume_unref(&volume);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_and_every_encoding_is_read),
        cmocka_unit_test(geometry_equals_that_of_the_file),
        cmocka_unit_test(rectilinear_grids_keep_their_coordinates),
        cmocka_unit_test(the_array_named_by_scalars_is_read),
        cmocka_unit_test(vectors_are_read_from_every_encoding),
        cmocka_unit_test(the_array_named_by_vectors_is_read),
        cmocka_unit_test(errors_explain_hostile_files),
        cmocka_unit_test(errors_explain_bad_coordinates),
        cmocka_unit_test(xml_entity_and_nesting_attacks_are_refused),
        cmocka_unit_test(compressed_data_of_the_wrong_size_is_refused),
        cmocka_unit_test(truncated_files_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
