/* SPDX-License-Identifier: Apache-2.0
 *
 * Fields of VTK files: data of cells, components, types that volumes do not have, and compressors.
 * The values were compared with the values of VTK 9.1.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <lz4.h>
#include <lzma.h>

#include "unit/data/import/support.h"

/* The fields of a volume as "NAME: other, other". */
static void assert_fields(const struct sp_volume *volume, const char *expected) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    char list[1024];
    size_t at = (size_t)snprintf(list, sizeof list, "%s:", info->value_name);
    for (int i = 0; i < SP_OTHER_FIELDS_MAX && info->others[i][0]; i++)
        at += (size_t)snprintf(list + at, sizeof list - at, "%s %s", i ? "," : "", info->others[i]);
    assert_string_equal(list, expected);
}

static void assert_place(const struct sp_volume *volume, const uint32_t dims[3],
                         const double origin[3], const double spacing[3]) {
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    for (int axis = 0; axis < 3; axis++) {
        assert_int_equal(grid->dims[axis], dims[axis]);
        assert_float_equal(grid->origin[axis], origin[axis], 1e-12);
        assert_float_equal(grid->spacing[axis], spacing[axis], 1e-12);
    }
}

#define VTI(extent, data)                                                                          \
    "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"" extent "\" Origin=\"1 2 3\" "          \
    "Spacing=\"0.5 2 4\"><Piece Extent=\"" extent "\">" data "</Piece></ImageData></VTKFile>"
#define ARRAY(name, rest, values)                                                                  \
    "<DataArray type=\"UInt8\" Name=\"" name "\"" rest ">" values "</DataArray>"

/* Values of cells lie at the centres of the cells; an axis with one point has one cell. */
static void data_of_cells_lie_at_their_centres(void **state) {
    (void)state;
    write_text("c.vti", VTI("2 4 0 2 5 5", "<CellData>" ARRAY("c", "", "1 2 3 4") "</CellData>"));
    struct sp_volume *volume = load("c.vti");
    assert_place(volume, (uint32_t[]){ 2, 2, 1 }, (double[]){ 2.25, 3, 23 },
                 (double[]){ 0.5, 2, 4 });
    assert_memory_equal(sp_volume_voxels(volume), "\1\2\3\4", 4);
    assert_fields(volume, "c:");
    sp_volume_unref(&volume);
    write_text("c.vtk", "# vtk DataFile Version 3.0\n\nASCII\nDATASET RECTILINEAR_GRID\n"
                        "DIMENSIONS 4 2 1\nX_COORDINATES 4 float\n0 1 3 7\nY_COORDINATES 2 float\n"
                        "10 4\nZ_COORDINATES 1 float\n5\nCELL_DATA 3\nSCALARS c int\n"
                        "LOOKUP_TABLE default\n7 8 9\n");
    volume = load("c.vtk");
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    assert_int_equal(grid->dims[0], 3);
    assert_int_equal(grid->dims[1], 1);
    assert_float_equal(grid->coordinates[0][1], 1.5, 0); /* 0.5, 2, 5 */
    assert_float_equal(grid->coordinates[0][2], 4.5, 0);
    assert_float_equal(grid->origin[0], 0.5, 0);
    assert_float_equal(grid->origin[1], 7, 0);
    assert_float_equal(grid->spacing[1], 6, 0); /* as thick as the cell */
    assert_memory_equal(sp_volume_voxels(volume), ((int[]){ 7, 8, 9 }), 12);
    sp_volume_unref(&volume);
}

/* Blanked points and cells are samples nevertheless, which a warning counts; copies are not hidden.
 */
static void hidden_samples_are_counted(void **state) {
    (void)state;
    write_text("h.vti", VTI("0 2 0 1 0 0", "<PointData>" ARRAY("s", "", "1 2 3 4 5 6") ARRAY(
                                               "vtkGhostType", "", "0 2 3 1 0 0") "</PointData>"));
    load_warns("h.vti", "2 points of the grid are hidden");
    write_text("h.vti", VTI("0 2 0 1 0 0", "<CellData>" ARRAY("s", "", "1 2")
                                               ARRAY("vtkGhostType", "", "32 2") "</CellData>"));
    load_warns("h.vti", "1 cells of the grid are hidden");
}

/* Beside data of points, names of cell data end in " (cells)". A name without this ending also
 * finds cell data. */
static void fields_of_points_and_cells_have_names_of_their_own(void **state) {
    (void)state;
    write_text("b.vti",
               VTI("0 2 0 1 0 0",
                   "<PointData>" ARRAY("s", "", "1 2 3 4 5 6")
                       ARRAY("vtkGhostType", "", "0 0 0 0 0 0") "</PointData><CellData>" ARRAY(
                           "s", "", "7 8") ARRAY("t", "", "9 10")
                           ARRAY("v", " NumberOfComponents=\"2\"", "1 2 3 4") "</CellData>"));
    static const struct {
        const char *source, *fields;
        uint32_t width;
        uint8_t last;
    } cases[] = {
        { "b.vti", "s: s (cells), t (cells), v (cells) component 1, v (cells) component 2", 3, 6 },
        { "b.vti?field=s (cells)",
          "s (cells): s, t (cells), v (cells) component 1, v (cells) component 2", 2, 8 },
        { "b.vti?field=t (cells)",
          "t (cells): s, s (cells), v (cells) component 1, v (cells) component 2", 2, 10 },
        { "b.vti?field=t", "t: s, v component 1, v component 2", 2, 10 },
        { "b.vti?field=v (cells) component 2",
          "v (cells) component 2: s, s (cells), t (cells), v (cells) component 1", 2, 4 },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sp_volume *volume = load(cases[i].source);
        const uint8_t *voxels = sp_volume_voxels(volume);
        const uint32_t *dims = sp_volume_info(volume)->grid.dims;
        assert_fields(volume, cases[i].fields);
        assert_int_equal(dims[0], cases[i].width);
        assert_int_equal(voxels[dims[0] * dims[1] * dims[2] - 1], cases[i].last);
        sp_volume_unref(&volume);
    }
    load_error("b.vti?field=u", SP_ERR_NOT_FOUND, "b.vti", "no field \"u\" of scalars");
}

/* Arrays with 2, 3 (colours), 4, 6 and 9 components. */
static void components_are_fields(void **state) {
    (void)state;
    static const unsigned counts[] = { 2, 3, 4, 6, 9 };
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        const unsigned n = counts[i];
        char values[256] = "", source[64], name[32];
        for (unsigned k = 0; k < 4 * n; k++)
            sprintf(values + strlen(values), "%u ", k);
        write_text("m.vti",
                   VTI("0 1 0 1 0 0", "<PointData><DataArray type=\"UInt8\" Name=\"m\" "
                                      "NumberOfComponents=\"%u\">%s</DataArray></PointData>"),
                   n, values);
        static const char *const colors[] = { "red", "green", "blue", "alpha" };
        for (unsigned k = 0; k < n; k++) {
            if (n == 3 || n == 4)
                sprintf(name, "m %s", colors[k]);
            else
                sprintf(name, "m component %u", k + 1);
            sprintf(source, "m.vti?field=%s", name);
            struct sp_volume *volume = load(source);
            const uint8_t *voxels = sp_volume_voxels(volume);
            assert_string_equal(sp_volume_info(volume)->value_name, name);
            for (unsigned v = 0; v < 4; v++)
                assert_int_equal(voxels[v], v * n + k);
            sp_volume_unref(&volume);
        }
    }
    /* Legacy colours in text are shares of 255. */
    write_text("m.vtk", "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\n"
                        "DIMENSIONS 2 1 1\nPOINT_DATA 2\nCOLOR_SCALARS c 3\n"
                        "0 0.0823529 1 0.5 0.25 0.00392157\n");
    struct sp_volume *volume = load("m.vtk?field=c green");
    assert_memory_equal(sp_volume_voxels(volume), "\x15\x40", 2);
    assert_fields(volume, "c green: c red, c blue");
    assert_string_equal(sp_volume_info(volume)->warnings[0], "");
    sp_volume_unref(&volume);
    write_text("m.vtk", "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\n"
                        "DIMENSIONS 2 1 1\nPOINT_DATA 2\nCOLOR_SCALARS c 3\n"
                        "0 127 1 0.5 0 0\n");
    volume = load("m.vtk?field=c green");
    assert_memory_equal(sp_volume_voxels(volume), "\xff\0", 2);
    assert_string_equal(sp_volume_info(volume)->warnings[0],
                        "Some colours are numbers outside of the range of the format, 0 to 1; they "
                        "were cut.");
    sp_volume_unref(&volume);
}

/* Integers that no volume has become float64. */
static void every_integer_type_is_read(void **state) {
    (void)state;
    static const struct {
        const char *type, *values;
        enum sp_type expected;
        double first;
    } cases[] = {
        { "UInt32", "4294967295 0", SP_FLOAT64, 4294967295.0 },
        { "Int64", "-70000 2", SP_FLOAT64, -70000 },
        { "UInt64", "65535 2", SP_FLOAT64, 65535 },
        { "Bit", "1 0", SP_UINT8, 1 },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        write_text("t.vti",
                   VTI("0 1 0 0 0 0", "<PointData><DataArray type=\"%s\" Name=\"s\">%s"
                                      "</DataArray></PointData>"),
                   cases[i].type, cases[i].values);
        struct sp_volume *volume = load("t.vti");
        const void *voxels = sp_volume_voxels(volume);
        assert_int_equal(sp_volume_info(volume)->type, cases[i].expected);
        const double first =
            cases[i].expected == SP_UINT8 ? *(const uint8_t *)voxels : *(const double *)voxels;
        assert_float_equal(first, cases[i].first, 0);
        sp_volume_unref(&volume);
    }
}

/* Packed bits, texts and METADATA between arrays, as VTK 9 writes them (version 5.1). */
static void legacy_bits_and_texts_are_read(void **state) {
    (void)state;
    static const char bytes[] = "# vtk DataFile Version 5.1\nt\nBINARY\n"
                                "DATASET STRUCTURED_POINTS\nFIELD FieldData 1\n"
                                "TimeValue 1 1 double\n@\4\0\0\0\0\0\0\n"
                                "DIMENSIONS 5 2 1\nSPACING 1 1 1\nORIGIN 0 0 0\nPOINT_DATA 10\n"
                                "FIELD FieldData 3\nnames 1 3 string\n\xc3"
                                "a b\xc0\xc2x%\nMETADATA\nINFORMATION 0\n\n"
                                "bits 1 10 bit\nU\x80\nids 1 10 vtkIdType\n"
                                "\0\0\0\1\0\0\0\2\0\0\0\3\0\0\0\4\0\0\0\5"
                                "\0\0\0\6\0\0\0\7\0\0\0\10\0\0\0\11\0\0\0\12\n";
    write_file("l.vtk", bytes, sizeof bytes - 1);
    struct sp_volume *volume = load("l.vtk");
    assert_fields(volume, "bits: ids");
    assert_memory_equal(sp_volume_voxels(volume), "\0\1\0\1\0\1\0\1\1\0", 10);
    sp_volume_unref(&volume);
    volume = load("l.vtk?field=ids");
    assert_int_equal(sp_volume_info(volume)->type, SP_INT32);
    assert_int_equal(((const int32_t *)sp_volume_voxels(volume))[9], 10);
    sp_volume_unref(&volume);
    write_file("l.vtk", bytes, sizeof bytes - 43); /* within the bits' two bytes and ids */
    load_error("l.vtk", SP_ERR_FORMAT, "ids", "do not fit into the rest of the file");
    write_text("l.vtk", "# vtk DataFile Version 5.1\nt\nASCII\nDATASET STRUCTURED_POINTS\n"
                        "DIMENSIONS 4 1 1\nPOINT_DATA 4\nFIELD FieldData 2\nnames 1 4 string\n"
                        "a%%20b\n\nx%%25\n1\nbits 1 4 bit\n0 1 1 0\n");
    volume = load("l.vtk");
    assert_memory_equal(sp_volume_voxels(volume), "\0\1\1\0", 4);
    sp_volume_unref(&volume);
}

static void names_may_look_like_numbers(void **state) {
    (void)state;
    static const char head[] = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\n"
                               "DIMENSIONS 2 1 1\nPOINT_DATA 2\n";
    write_text("n.vtk",
               "%sFIELD FieldData 3\na 1 2 short\n7 8\n1 1 2 float\n3 4\nnan 1 2 int\n5 6\n", head);
    struct sp_volume *volume = load("n.vtk");
    assert_fields(volume, "a: 1, nan");
    assert_int_equal(((const int16_t *)sp_volume_voxels(volume))[1], 8);
    sp_volume_unref(&volume);
    volume = load("n.vtk?field=1");
    assert_float_equal(((const float *)sp_volume_voxels(volume))[0], 3, 0);
    sp_volume_unref(&volume);
    static const char *const wrong[] = { "9\n", "9 9 9 9\n", "9 1 2 word\n", "9 1\n" };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        write_text("n.vtk", "%sSCALARS a short\nLOOKUP_TABLE default\n7 8 %s", head, wrong[i]);
        load_error("n.vtk", SP_ERR_FORMAT, "n.vtk", "");
    }
}

static void arrays_with_too_many_components_are_named(void **state) {
    (void)state;
    enum { MANY = 20000 };
    FILE *file = fopen(in_folder("wide.vtk"), "w");
    assert_non_null(file);
    fprintf(file,
            "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 1 1 1\n"
            "POINT_DATA 1\nFIELD FieldData 2\nwide %d 1 int\n",
            MANY);
    for (int i = 0; i < MANY; i++)
        fputs("1 ", file);
    fputs("\nb 1 1 int\n5\n", file);
    fclose(file);
    load_warns("wide.vtk",
               "The array \"wide\" has 20000 components, more than 16384; it is not read.");
}

enum { COUNT = 100, BLOCK = 64 };

/* Writes an image of bytes that are compressed in two blocks, the last of 36 bytes. */
static void write_packed(const char *compressor, const uint8_t *values, int change) {
    char file[4096];
    uint32_t sizes[5] = { 2, BLOCK, COUNT - BLOCK, 0, 0 };
    uint8_t packed[2][512];
    size_t used[2] = { 0, 0 };
    for (int i = 0; i < 2; i++) {
        const size_t n = i == 0 ? BLOCK : COUNT - BLOCK;
        if (strstr(compressor, "LZ4"))
            used[i] = (size_t)LZ4_compress_default((const char *)values + i * BLOCK,
                                                   (char *)packed[i], (int)n, sizeof packed[i]);
        else
            assert_int_equal(lzma_easy_buffer_encode(9, LZMA_CHECK_CRC32, NULL, values + i * BLOCK,
                                                     n, packed[i], &used[i], sizeof packed[i]),
                             LZMA_OK);
        sizes[3 + i] = (uint32_t)used[i];
    }
    if (change == 1)
        packed[1][used[1] / 2] ^= 0x55;
    if (change == 2)
        sizes[4]--;
    if (change == 3)
        sizes[1] = BLOCK + 1, sizes[2] = COUNT - BLOCK - 1;
    size_t at = (size_t)sprintf(
        file,
        "<VTKFile type=\"ImageData\" compressor=\"%s\"><ImageData><Piece Extent=\"0 9 0 9 0 0\">"
        "<PointData><DataArray type=\"UInt8\" Name=\"s\" format=\"appended\" offset=\"0\"/>"
        "</PointData></Piece></ImageData><AppendedData encoding=\"raw\">_",
        compressor);
    memcpy(file + at, sizes, sizeof sizes);
    at += sizeof sizes;
    for (int i = 0; i < 2; i++) {
        memcpy(file + at, packed[i], used[i]);
        at += used[i];
    }
    write_file("z.vti", file, at);
}

static void lz4_and_lzma_are_unpacked(void **state) {
    (void)state;
    static const char *const compressors[] = { "vtkLZ4DataCompressor", "vtkLZMADataCompressor" };
    uint8_t values[COUNT];
    for (int i = 0; i < COUNT; i++)
        values[i] = (uint8_t)(i / 7);
    for (int c = 0; c < 2; c++) {
        write_packed(compressors[c], values, 0);
        struct sp_volume *volume = load("z.vti");
        assert_memory_equal(sp_volume_voxels(volume), values, COUNT);
        sp_volume_unref(&volume);
        for (int change = 1; change <= 3; change++) {
            struct sp_error err;
            struct sp_load_options options = importer_options();
            write_packed(compressors[c], values, change);
            volume = sp_volume_load(in_folder("z.vti"), &options, &err);
            if (volume && change == 1) { /* LZ4 has no sum of its own */
                sp_volume_unref(&volume);
                continue;
            }
            assert_null(volume);
            assert_int_equal(err.code, SP_ERR_FORMAT);
            assert_non_null(strstr(err.text, c == 0 ? "LZ4" : "LZMA"));
        }
    }
}

/* Cells of data sets with points of their own are told, with the remedy. */
static void data_of_cells_that_are_not_read_are_named(void **state) {
    (void)state;
    static const char *const types[] = { "StructuredGrid", "UnstructuredGrid", "PolyData" };
    for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
        write_text(
            "c.vtk.xml",
            "<VTKFile type=\"%s\"><%s WholeExtent=\"0 1 0 1 0 0\"><Piece Extent=\"0 1 0 1 0 0\" "
            "NumberOfPoints=\"4\"><CellData><DataArray type=\"Float32\" Name=\"stress\" "
            "format=\"ascii\">5</DataArray><DataArray type=\"UInt8\" "
            "Name=\"vtkGhostType\" format=\"ascii\">0</DataArray></CellData><Points><DataArray "
            "type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 1 0 0 0 1 0 1 1 "
            "0</DataArray></Points></Piece></%s></VTKFile>",
            types[i], types[i], types[i]);
        load_warns("c.vtk.xml", "The data of cells (stress) are not read; turn them into data of "
                                "points");
        load_error("c.vtk.xml?field=stress", SP_ERR_UNSUPPORTED, "c.vtk.xml",
                   "\"stress\" are data of cells");
    }
    /* A name may be a part of another name, and may have a comma. */
    write_text("c.vtk.xml",
               "<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"1\"><PointData>"
               "<DataArray type=\"Float32\" Name=\"y\" format=\"ascii\">5</DataArray></PointData>"
               "<CellData><DataArray type=\"Float32\" Name=\"x, y\"/><DataArray type=\"Float32\" "
               "Name=\"stress 2\"/><DataArray type=\"Float32\" Name=\"stress\"/></CellData><Points>"
               "<DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0"
               "</DataArray></Points></Piece></PolyData></VTKFile>");
    load_warns("c.vtk.xml?field=y", "The data of cells (x, y, stress 2, stress) are not read;");
}

static void the_source_says_what_components_are(void **state) {
    (void)state;
    write_text("as.vti",
               "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 1 0 0 0 0\"><Piece "
               "Extent=\"0 1 0 0 0 0\"><PointData><DataArray type=\"UInt8\" Name=\"v\" "
               "NumberOfComponents=\"3\" format=\"ascii\">0 3 4 1 2 2</DataArray>"
               "</PointData></Piece></ImageData></VTKFile>");
    static const struct {
        const char *as, *name;
        bool has_vectors;
    } cases[] = { { "", "v red", false },
                  { "?as=rgb", "v red", false },
                  { "?as=channels", "v component 1", false },
                  { "?as=vectors", "magnitude", true } };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char source[64];
        snprintf(source, sizeof source, "as.vti%s", cases[i].as);
        struct sp_volume *volume = load(source);
        assert_string_equal(sp_volume_info(volume)->value_name, cases[i].name);
        assert_int_equal(sp_volume_info(volume)->vector_bytes > 0, cases[i].has_vectors);
        if (cases[i].has_vectors)
            assert_float_equal(((const float *)sp_volume_voxels(volume))[0], 5, 1e-6);
        sp_volume_unref(&volume);
    }
    load_error("as.vti?as=time", SP_ERR_UNSUPPORTED, "as.vti", "open several files");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(data_of_cells_lie_at_their_centres),
        cmocka_unit_test(fields_of_points_and_cells_have_names_of_their_own),
        cmocka_unit_test(hidden_samples_are_counted),
        cmocka_unit_test(components_are_fields),
        cmocka_unit_test(every_integer_type_is_read),
        cmocka_unit_test(legacy_bits_and_texts_are_read),
        cmocka_unit_test(names_may_look_like_numbers),
        cmocka_unit_test(arrays_with_too_many_components_are_named),
        cmocka_unit_test(lz4_and_lzma_are_unpacked),
        cmocka_unit_test(data_of_cells_that_are_not_read_are_named),
        cmocka_unit_test(the_source_says_what_components_are),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
