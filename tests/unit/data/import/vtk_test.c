/* SPDX-License-Identifier: Apache-2.0
 *
 * Legacy VTK files.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

enum { COUNT = 60 };

static const char *const legacy_names[SP_TYPE_COUNT] = { "unsigned_char", "char", "unsigned_short",
                                                         "short",         "int",  "float",
                                                         "double" };

/* Returns the values of the ramp as decimal numbers; the caller frees the text. */
static char *make_words(enum sp_type type, size_t count) {
    char *text = malloc(count * 32 + 1);
    assert_non_null(text);
    size_t at = 0;
    for (size_t i = 0; i < count; i++)
        at += (size_t)sprintf(text + at, "%.17g%s", ramp_value(type, i), i % 7 == 6 ? "\n" : " ");
    return text;
}

/* Writes the values of the ramp in big endian byte order. */
static void make_bytes(enum sp_type type, size_t count, void *out) {
    make_ramp(type, count, out);
    import_swap(out, sp_type_size(type), count);
}

static void every_type_is_read_from_ascii_and_binary(void **state) {
    (void)state;
    for (int t = 0; t < SP_TYPE_COUNT; t++) {
        enum sp_type type = (enum sp_type)t;
        static const char header[] = "# vtk DataFile Version 3.0\na title\n%s\n"
                                     "DATASET STRUCTURED_POINTS\nDIMENSIONS 5 4 3\n"
                                     "SPACING 0.5 1 4\nORIGIN -1 2e2 0.25\nPOINT_DATA 60\n"
                                     "SCALARS density %s\nLOOKUP_TABLE default\n%s";
        char *words = make_words(type, COUNT), text[512];
        double samples[COUNT + 1] = { 0 };
        make_bytes(type, COUNT, samples);
        write_text("words.vtk", header, "ASCII", legacy_names[t], words);
        snprintf(text, sizeof text, header, "BINARY", legacy_names[t], "");
        write_both("bytes.vtk", text, samples, COUNT * sp_type_size(type));
        free(words);
        for (int binary = 0; binary < 2; binary++) {
            struct sp_volume *volume = load(binary ? "bytes.vtk" : "words.vtk");
            const struct sp_volume_info *info = sp_volume_info(volume);
            assert_int_equal(info->type, type);
            assert_int_equal(info->grid.dims[0], 5);
            assert_int_equal(info->grid.dims[2], 3);
            assert_compare(info->grid.spacing[0], ==, 0.5);
            assert_compare(info->grid.spacing[2], ==, 4);
            assert_compare(info->grid.origin[0], ==, -1);
            assert_compare(info->grid.origin[1], ==, 200);
            assert_compare(info->grid.direction[1][1], ==, 1);
            assert_null(info->grid.coordinates[0]);
            assert_is_ramp(volume, COUNT);
            sp_volume_unref(&volume);
        }
    }
}

#define RECTILINEAR                                                                                \
    "# vtk DataFile Version 4.2\n\nASCII\nDATASET RECTILINEAR_GRID\nDIMENSIONS 5 4 3\n"

/* Rising and falling coordinates, and coordinates after METADATA as VTK writes it. */
static void rectilinear_grids_keep_their_coordinates(void **state) {
    (void)state;
    char *words = make_words(SP_UINT8, COUNT);
    write_text("r.vtk",
               RECTILINEAR "X_COORDINATES 5 float\n-1 0 2 4.5 7\nMETADATA\nINFORMATION 0\n\n"
                           "Y_COORDINATES 4 int\n9 7 6 0\nZ_COORDINATES 3 double\n0.25 0.5 1\n"
                           "POINT_DATA 60\nSCALARS a unsigned_char 1\nLOOKUP_TABLE default\n%s\n"
                           "CELL_DATA 24\n",
               words);
    static const double x[] = { 0, 1, 3, 5.5, 8 }, y[] = { 0, 2, 3, 9 }, z[] = { 0, 0.25, 0.75 };
    struct sp_volume *volume = load("r.vtk");
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    assert_memory_equal(grid->coordinates[0], x, sizeof x);
    assert_memory_equal(grid->coordinates[1], y, sizeof y);
    assert_memory_equal(grid->coordinates[2], z, sizeof z);
    assert_compare(grid->spacing[0], ==, 2);
    assert_compare(grid->spacing[1], ==, 3);
    assert_compare(grid->spacing[2], ==, 0.375);
    assert_compare(grid->origin[0], ==, -1);
    assert_compare(grid->origin[1], ==, 9);
    assert_compare(grid->origin[2], ==, 0.25);
    assert_compare(grid->direction[0][0], ==, 1);
    assert_compare(grid->direction[1][1], ==, -1);
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
    free(words);
}

/* Binary coordinates of every type, 60 along one axis. */
static void coordinates_of_every_type_are_read(void **state) {
    (void)state;
    static const struct {
        const char *name;
        size_t size;
        bool is_signed, floating;
    } types[] = {
        { "char", 1, true, false },         { "unsigned_char", 1, false, false },
        { "short", 2, true, false },        { "unsigned_short", 2, false, false },
        { "int", 4, true, false },          { "unsigned_int", 4, false, false },
        { "long", 8, true, false },         { "unsigned_long", 8, false, false },
        { "vtktypeint64", 8, true, false }, { "vtkIdType", 4, true, false },
        { "float", 4, true, true },         { "double", 8, true, true },
    };
    for (size_t t = 0; t < sizeof types / sizeof types[0]; t++) {
        uint8_t bytes[4096];
        size_t at =
            (size_t)sprintf((char *)bytes,
                            "# vtk DataFile Version 3.0\n\nBINARY\nDATASET RECTILINEAR_GRID\n"
                            "DIMENSIONS 60 1 1\nX_COORDINATES 60 %s\n",
                            types[t].name);
        for (int i = 0; i < COUNT; i++) {
            int64_t value = (types[t].is_signed ? -50 : 3) + i + (i == 59);
            float f = (float)value;
            double d = (double)value;
            if (types[t].floating)
                memcpy(&value, types[t].size == 4 ? (void *)&f : (void *)&d, types[t].size);
            /* The low bytes come first on this little endian machine. */
            import_swap(&value, types[t].size, 1);
            memcpy(bytes + at, &value, types[t].size);
            at += types[t].size;
        }
        at += (size_t)sprintf((char *)bytes + at, "\nY_COORDINATES 1 float\n");
        memcpy(bytes + at, "\x40\x40\0\0", 4);
        at += 4;
        at += (size_t)sprintf((char *)bytes + at, "\nZ_COORDINATES 1 float\n");
        memcpy(bytes + at, "\0\0\0\0", 4);
        at += 4;
        at += (size_t)sprintf((char *)bytes + at, "\nPOINT_DATA 60\nSCALARS s unsigned_char\n"
                                                  "LOOKUP_TABLE default\n");
        make_ramp(SP_UINT8, COUNT, bytes + at);
        write_file("t.vtk", bytes, at + COUNT);
        struct sp_volume *volume = load("t.vtk");
        const struct sp_grid *grid = &sp_volume_info(volume)->grid;
        assert_compare(grid->origin[0], ==, types[t].is_signed ? -50 : 3);
        assert_compare(grid->coordinates[0][58], ==, 58);
        assert_compare(grid->coordinates[0][59], ==, 60);
        /* An axis with one sample has an origin, and the spacing of the finest axis. */
        assert_null(grid->coordinates[1]);
        assert_compare(grid->origin[1], ==, 3);
        assert_compare(grid->spacing[1], ==, 60 / 59.0);
        assert_compare(grid->spacing[2], ==, 60 / 59.0);
        assert_is_ramp(volume, COUNT);
        sp_volume_unref(&volume);
    }
}

#define POINTS                                                                                     \
    "# vtk DataFile Version 2.0\n\nASCII\n \nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 1\n"
#define FIELDS                                                                                     \
    "FIELD FieldData 2\nTIME 1 1 double\n0.5\nMETADATA\nCOMPONENT_NAMES\nt\n\nNULL_ARRAY\n"

/* Arrays before the scalars are skipped, in ASCII and in binary files. */
static void other_arrays_are_skipped(void **state) {
    (void)state;
    static const char *const before[] = {
        "POINT_DATA 4\n",
        FIELDS "POINT_DATA 4\n",
        "CELL_DATA 1\nSCALARS c float\nLOOKUP_TABLE default\n5\nPOINT_DATA 4\n",
        "CELL_DATA 1\nVECTORS v float 1 2 3 TENSORS6 t int 1 2 3 4 5 6 POINT_DATA 4\n",
        "point_data 4\nvectors v float\n1 2 3 4 5 6 7 8 9 10 11 12\n",
        "POINT_DATA 4\nTENSORS t short 1 2 3 4 5 6 7 8 9 1 2 3 4 5 6 7 8 9 1 2 3 4 5 6 7 8 9 1 2 3 "
        "4 5 6 7 8 9\n",
        "POINT_DATA 4\nCOLOR_SCALARS rgb 3\n0 1 0 1 0 1 0 1 0 1 0 1\n",
        "POINT_DATA 4\nTEXTURE_COORDINATES uv 2 float\n0 1 0 1 0 1 0 1\n",
        "POINT_DATA 4\nSCALARS rgb unsigned_char 3\nLOOKUP_TABLE default\n0 1 0 1 0 1 0 1 0 1 0 "
        "1\n",
        "POINT_DATA 4\nLOOKUP_TABLE t 2\n0 1 0 1 0 1 0 1\nGLOBAL_IDS i vtkIdType 0 1 2 3\n",
        "POINT_DATA 4\nFIELD FieldData 1\nfirst 1 4 float\n9 9 9 9\nMETADATA\nINFORMATION 0\n \n",
    };
    for (size_t i = 0; i < sizeof before / sizeof before[0]; i++) {
        write_text("o.vtk",
                   POINTS "%sSCALARS s short\nLOOKUP_TABLE default\n-1 2 3 4\nNORMALS w char\n"
                          "9 8 7 6 5 4 3 2 1 0 -1 -2\n",
                   before[i]);
        struct sp_volume *volume = load("o.vtk");
        assert_int_equal(sp_volume_info(volume)->type, SP_INT16);
        assert_memory_equal(sp_volume_voxels(volume), ((int16_t[]){ -1, 2, 3, 4 }), 8);
        assert_string_equal(sp_volume_info(volume)->value_name, "s");
        assert_string_equal(sp_volume_info(volume)->vector_name, i == 4 ? "v" : "w");
        sp_volume_unref(&volume);
    }
    /* A binary file, whose title and other lines end in CR LF. */
    static const char binary[] = "# vtk DataFile Version 3.0\r\nt\r\nBINARY\r\n"
                                 "DATASET STRUCTURED_POINTS\r\nDIMENSIONS 2 2 1\r\nPOINT_DATA 4\n"
                                 "VECTORS v short\n123456781234567812345678\n"
                                 "COLOR_SCALARS c 2\n\n\n\n\n\n\n\n\n\n"
                                 "FIELD f 1\nn 1 4 unsigned_int\n0123456789abcdef\n"
                                 "SCALARS s short 1\nLOOKUP_TABLE default\n\0\1\0\2\0\3\0\4";
    write_file("o.vtk", binary, sizeof binary - 1);
    struct sp_volume *volume = load("o.vtk");
    assert_memory_equal(sp_volume_voxels(volume), ((int16_t[]){ 1, 2, 3, 4 }), 8);
    sp_volume_unref(&volume);
}

/* The vectors of each number type, in words and in bytes; their lengths are the samples. */
static void vectors_of_every_type_are_read(void **state) {
    (void)state;
    static const char *const others[] = { "unsigned_int", "long", "unsigned_long" };
    for (int t = 0; t < SP_TYPE_COUNT + 3; t++)
        for (int binary = 0; binary < 2; binary++) {
            enum sp_type type = t < SP_TYPE_COUNT ? (enum sp_type)t : SP_UINT8;
            double values[12];
            char text[512], *words = binary ? NULL : make_words(type, 12);
            make_bytes(type, 12, values);
            size_t size = sp_type_size(type);
            if (t >= SP_TYPE_COUNT) { /* the ramp of uint8 in wider integers */
                size = t == SP_TYPE_COUNT ? 4 : 8;
                uint8_t wide[96] = { 0 };
                for (size_t i = 0; i < 12; i++)
                    wide[i * size + size - 1] = (uint8_t)ramp_value(type, i);
                memcpy(values, wide, sizeof wide);
            }
            snprintf(text, sizeof text,
                     "# vtk DataFile Version 3.0\nt\n%s\nDATASET STRUCTURED_POINTS\n"
                     "DIMENSIONS 2 2 1\nPOINT_DATA 4\nVECTORS wind%%20speed %s\n%s",
                     binary ? "BINARY" : "ASCII",
                     t < SP_TYPE_COUNT ? legacy_names[t] : others[t - SP_TYPE_COUNT],
                     words ? words : "");
            write_both("vectors.vtk", text, values, binary ? 12 * size : 0);
            free(words);
            struct sp_volume *volume = load("vectors.vtk");
            const struct sp_volume_info *info = sp_volume_info(volume);
            assert_int_equal(info->type, SP_FLOAT32);
            assert_string_equal(info->value_name, "magnitude");
            assert_string_equal(info->vector_name, "wind speed");
            assert_are_vectors(volume, type, false);
            sp_volume_unref(&volume);
        }
}

/* VECTORS come before other arrays, and otherwise the first array in the file is taken. */
static void scalars_and_vectors_are_read_together(void **state) {
    (void)state;
#define TWELVE " 1 2 3 4 5 6 7 8 9 1 2 3\n"
    static const struct {
        const char *arrays, *value_name, *vector_name;
    } cases[] = {
        { "SCALARS s char\nLOOKUP_TABLE d\n1 2 3 4 VECTORS v int" TWELVE, "s", "v" },
        { "VECTORS v int" TWELVE "VECTORS w int" TWELVE "SCALARS s char\nLOOKUP_TABLE d\n1 2 3 4",
          "s", "v" },
        { "FIELD f 3\nrgb 3 4 unsigned_char" TWELVE "a 3 4 char" TWELVE "p 1 4 int 1 2 3 4\n"
          "NORMALS n float" TWELVE,
          "p", "a" },
        { "NORMALS n float" TWELVE "VECTORS v float" TWELVE "FIELD f 1\na 3 4 char" TWELVE,
          "magnitude", "v" },
        { "NORMALS 100%25 char" TWELVE, "magnitude", "100%" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_text("both.vtk", POINTS "POINT_DATA 4\n%s", cases[i].arrays);
        struct sp_volume *volume = load("both.vtk");
        const struct sp_volume_info *info = sp_volume_info(volume);
        assert_string_equal(info->value_name, cases[i].value_name);
        assert_string_equal(info->vector_name, cases[i].vector_name);
        assert_compare(sp_volume_vectors(volume)[2][1], ==, 8);
        sp_volume_unref(&volume);
    }
}

static void a_field_array_is_read_if_there_are_no_scalars(void **state) {
    (void)state;
    write_text("f.vtk", POINTS "POINT_DATA 4\nVECTORS v float\n1 2 3 4 5 6 7 8 9 1 2 3\n"
                               "FIELD FieldData 4\nv2 2 4 float\n1 2 3 4 5 6 7 8\n"
                               "ids 1 4 unsigned_int\n1 2 3 4\nrho 1 4 float\n.5 nan inf -1e9\n"
                               "p 1 4 double\n9 9 9 9\nCELL_DATA 1\n");
    struct sp_volume *volume = load("f.vtk");
    assert_string_equal(sp_volume_info(volume)->value_name, "ids"); /* the first array */
    sp_volume_unref(&volume);
    volume = load("f.vtk?field=rho");
    const float *voxels = sp_volume_voxels(volume);
    assert_int_equal(sp_volume_info(volume)->type, SP_FLOAT32);
    assert_int_equal(sp_volume_info(volume)->nonfinite, 2);
    assert_compare(voxels[0], ==, 0.5f);
    assert_true(isnan(voxels[1]));
    assert_true(isinf(voxels[2]));
    assert_compare(voxels[3], ==, -1e9f);
    sp_volume_unref(&volume);
}

#define TEN "0 1 2 3 4 5 6 7 8 9 "
#define VECTORS POINTS "POINT_DATA 4\nVECTORS v double\n"
#define SCALARS POINTS "POINT_DATA 4\nSCALARS s unsigned_char\nLOOKUP_TABLE default\n"

static void errors_explain_hostile_files(void **state) {
    (void)state;
    static const struct {
        const char *text;
        enum sp_code code;
        const char *place, *message;
    } cases[] = {
        { "hello", SP_ERR_FORMAT, "h.vtk: byte", "starts with the line # vtk DataFile" },
        { "# vtk DataFile Version 9.0\n", SP_ERR_UNSUPPORTED, "byte", "version 9" },
        { "# vtk DataFile Version 3.0\n\nUTF8\n", SP_ERR_FORMAT, "byte 28", "ASCII or BINARY" },
        { "# vtk DataFile Version 3.0\n\nASCII\n", SP_ERR_FORMAT, "DATASET",
          "is missing at the end" },
        { "# vtk DataFile Version 3.0\n\nASCII\nDIMENSIONS 2 2 2", SP_ERR_FORMAT, "DIMENSIONS",
          "before DATASET" },
        { "# vtk DataFile Version 3.0\n\nASCII\nDATASET FIELD\n", SP_ERR_UNSUPPORTED,
          "byte 42: DATASET", "data set FIELD is not supported" },
        { "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\n", SP_ERR_FORMAT,
          "DIMENSIONS", "are missing at the end" },
        { "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\nPOINT_DATA 4",
          SP_ERR_FORMAT, "POINT_DATA", "before DIMENSIONS" },
        { "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 0 2",
          SP_ERR_FORMAT, "DIMENSIONS", "empty" },
        { "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 -2 2",
          SP_ERR_FORMAT, "DIMENSIONS", "\"-2\" is not a whole number" },
        { "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 65537 2",
          SP_ERR_FORMAT, "DIMENSIONS", "up to 65536" },
        { "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\n"
          "DIMENSIONS 65536 65536 65536\nPOINT_DATA 281474976710656\n",
          SP_ERR_FORMAT, "POINT_DATA", "up to 1099511627776" },
        { "# vtk DataFile Version 3.0\n\nBINARY\nDATASET STRUCTURED_POINTS\n"
          "DIMENSIONS 65536 65536 64\nPOINT_DATA 274877906944\n"
          "SCALARS s float\nLOOKUP_TABLE default\n",
          SP_ERR_FORMAT, "byte 61: DIMENSIONS", "more than 68719476736 voxels" },
        { "# vtk DataFile Version 3.0\n\nBINARY\nDATASET STRUCTURED_POINTS\n"
          "DIMENSIONS 65536 65536 16\nPOINT_DATA 68719476736\n"
          "SCALARS s float\nLOOKUP_TABLE default\n0123",
          SP_ERR_FORMAT, "SCALARS", "68719476736 values of 4 bytes do not fit" },
        { "# vtk DataFile Version 3.0\n\nBINARY\nDATASET STRUCTURED_POINTS\n"
          "DIMENSIONS 65536 65536 16\nPOINT_DATA 68719476736\nVECTORS v double\n0123",
          SP_ERR_FORMAT, "VECTORS", "206158430208 values of 8 bytes do not fit" },
        { POINTS "DIMENSIONS 9 9 9\n", SP_ERR_FORMAT, "DIMENSIONS", "has them twice" },
        { POINTS "DATASET RECTILINEAR_GRID\n", SP_ERR_FORMAT, "DATASET", "occurs twice" },
        { POINTS "SPACING 1 1\n", SP_ERR_FORMAT, "SPACING", "\"\" is not a number" },
        { POINTS "ORIGIN 1 x 1\n", SP_ERR_FORMAT, "ORIGIN", "\"x\" is not a number" },
        { POINTS "X_COORDINATES 2 float 0 1\n", SP_ERR_FORMAT, "X_COORDINATES",
          "RECTILINEAR_GRID" },
        { POINTS "POINT_DATA 5\n", SP_ERR_FORMAT, "POINT_DATA", "5 points, but DIMENSIONS give 4" },
        { POINTS "SCALARS s float\n", SP_ERR_FORMAT, "SCALARS", "comes before POINT_DATA" },
        { POINTS "POINT_DATA 4\nSCALARS s float\n1 2 3 4\n", SP_ERR_FORMAT, "SCALARS",
          "is followed by \"1\"; its LOOKUP_TABLE must follow" },
        { POINTS "POINT_DATA 4\nSCALARS s float 65537\n", SP_ERR_FORMAT, "SCALARS",
          "65537 components" },
        { POINTS "POINT_DATA 4\nSCALARS s complex\n", SP_ERR_UNSUPPORTED, "SCALARS",
          "\"complex\"" },
        { POINTS "POINT_DATA 4\nSCALARS s complex\n", SP_ERR_UNSUPPORTED, "SCALARS",
          "\"complex\"" },
        { POINTS "POINT_DATA 4\nSCALARS s unsigned_int\nLOOKUP_TABLE d\n1 2 3 -4", SP_ERR_FORMAT,
          "SCALARS s", "\"-4\", is not of type unsigned_int" },
        { POINTS "POINT_DATA 4\nFIELD f 1\nnames 1 4 string\na\nb\nc\n\n", SP_ERR_UNSUPPORTED,
          "DIMENSIONS", "neither points nor cells have an array of numbers" },
        { POINTS "POINT_DATA 4\nFIELD f 1\nnames 1 4 string\na\n", SP_ERR_FORMAT, "names",
          "the file ends after 1 of 4 texts" },
        { POINTS "CELL_DATA 2\nSCALARS c float\nLOOKUP_TABLE default\n5 6\n", SP_ERR_UNSUPPORTED,
          "DIMENSIONS", "neither points nor cells have an array of numbers" },
        { POINTS, SP_ERR_UNSUPPORTED, "DIMENSIONS", "neither points nor cells" },
        { POINTS "POINT_DATA 4\nVECTORS v float\n1 2 3", SP_ERR_FORMAT, "VECTORS",
          "9 more values" },
        { POINTS "POINT_DATA 4\nFIELD f 99999999999\na 1 1 int 3", SP_ERR_FORMAT, "FIELD",
          "ends 99999999998 arrays" },
        { POINTS "POINT_DATA 4\nFIELD f 1\na 1 1 variant x", SP_ERR_UNSUPPORTED, "a",
          "\"variant\"" },
        { POINTS "POINT_DATA 4\nFIELD f 1\na 99999 1 int x", SP_ERR_FORMAT, "a", "65536" },
        { POINTS "POINT_DATA 4\nRHUBARB", SP_ERR_FORMAT, "byte", "\"RHUBARB\" is not a keyword" },
        { SCALARS "1 2 3", SP_ERR_FORMAT, "SCALARS", "1 more values are expected" },
        { SCALARS "1 2 333 4", SP_ERR_FORMAT, "SCALARS s", "value 2, \"333\", is not of type" },
        { SCALARS "1 2 3 4 5", SP_ERR_FORMAT, "byte", "\"5\" is not a keyword" },
        { VECTORS "1 2 3 4 5 6 7 8 9 1 2", SP_ERR_FORMAT, "VECTORS", "1 more values" },
        { VECTORS "1 2 3 4 5 6 7 8 9 1 2 3 4", SP_ERR_FORMAT, "byte", "\"4\" is not a keyword" },
        { VECTORS "1 2 x 4 5 6 7 8 9 1 2 3", SP_ERR_FORMAT, "VECTORS v", "\"x\", is not of type" },
        { SCALARS "1 2 3 4 VECTORS v float 1 2 3 4 5 6", SP_ERR_FORMAT, "VECTORS",
          "6 more values" },
        { SCALARS "1 2 256 4", SP_ERR_FORMAT, "SCALARS s", "\"256\", is not of type" },
        { SCALARS "1 2 -1 4", SP_ERR_FORMAT, "SCALARS s", "value 2, \"-1\"" },
        { SCALARS "1 2 nan 4", SP_ERR_FORMAT, "SCALARS s", "\"nan\", is not of type" },
        { SCALARS "1 2 1.5 4", SP_ERR_FORMAT, "SCALARS s", "\"1.5\", is not of type" },
        { SCALARS "1 2 3x 4", SP_ERR_FORMAT, "SCALARS s", "\"3x\", is not of type" },
        { RECTILINEAR "X_COORDINATES 4 float\n", SP_ERR_FORMAT, "X_COORDINATES",
          "4 coordinates for the 5 samples" },
        { RECTILINEAR "X_COORDINATES 5 string\n", SP_ERR_UNSUPPORTED, "X_COORDINATES",
          "\"string\"" },
        { RECTILINEAR "X_COORDINATES 5 float\n0 1 2 3", SP_ERR_FORMAT, "X_COORDINATES",
          "1 more values are expected" },
        { RECTILINEAR "X_COORDINATES 5 float\n0 1 2 3 4 X_COORDINATES 5 float\n", SP_ERR_FORMAT,
          "X_COORDINATES", "occurs twice" },
        { RECTILINEAR "POINT_DATA 60\n", SP_ERR_FORMAT, "X_COORDINATES", "missing" },
        { RECTILINEAR "SPACING 1 1 1\n", SP_ERR_FORMAT, "SPACING", "STRUCTURED_POINTS only" },
        { RECTILINEAR "X_COORDINATES 5 float\n0 1 1 3 4\nY_COORDINATES 4 int\n1 2 3 4\n"
                      "Z_COORDINATES 3 int\n1 2 3\nPOINT_DATA 60\nSCALARS s int\n"
                      "LOOKUP_TABLE default\n" TEN TEN TEN TEN TEN TEN,
          SP_ERR_FORMAT, "byte 59: DIMENSIONS", "coordinates[0]: the step from" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_text("h.vtk", "%s", cases[i].text);
        load_error("h.vtk", cases[i].code, cases[i].place, cases[i].message);
    }
    /* A word that never ends, and a word with a NUL byte. */
    size_t n = 1 << 16;
    char *word = malloc(n);
    memset(word, 'x', n);
    write_both("h.vtk", POINTS, word, n);
    load_error("h.vtk", SP_ERR_FORMAT, "byte 79", "longer than 255 bytes");
    free(word);
    write_both("h.vtk", POINTS, "POINT\0DATA", 10);
    load_error("h.vtk", SP_ERR_FORMAT, "byte", "\"POINT?DATA\" is not a keyword");
}

/* A file that is truncated at any length is an error, never a volume or a crash. */
static void truncated_files_are_refused(void **state) {
    (void)state;
    static const char header[] = "# vtk DataFile Version 3.0\nt\nBINARY\nDATASET RECTILINEAR_GRID\n"
                                 "DIMENSIONS 2 2 1\nX_COORDINATES 2 char\n\1\3\n"
                                 "Y_COORDINATES 2 char\n\2\4\nZ_COORDINATES 1 char\n\5\n"
                                 "POINT_DATA 4\nSCALARS s char\nLOOKUP_TABLE default\nabcd";
    struct sp_load_options options = importer_options();
    for (size_t n = sizeof header - 1; n > 0; n -= n > 60 ? 1 : 5) {
        struct sp_error err;
        write_file("c.vtk", header, n);
        struct sp_volume *volume = sp_volume_load(in_folder("c.vtk"), &options, &err);
        assert_int_equal(volume != NULL, n == sizeof header - 1);
        if (!volume && err.code != SP_ERR_FORMAT && err.code != SP_ERR_UNSUPPORTED)
            fail_msg("truncated to %zu bytes: %s: %s", n, sp_code_name(err.code), err.text);
        sp_volume_unref(&volume);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_is_read_from_ascii_and_binary),
        cmocka_unit_test(rectilinear_grids_keep_their_coordinates),
        cmocka_unit_test(coordinates_of_every_type_are_read),
        cmocka_unit_test(other_arrays_are_skipped),
        cmocka_unit_test(vectors_of_every_type_are_read),
        cmocka_unit_test(scalars_and_vectors_are_read_together),
        cmocka_unit_test(a_field_array_is_read_if_there_are_no_scalars),
        cmocka_unit_test(errors_explain_hostile_files),
        cmocka_unit_test(truncated_files_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
