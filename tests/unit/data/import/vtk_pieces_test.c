/* SPDX-License-Identifier: Apache-2.0
 *
 * VTK data sets in several pieces: in one file, in several files, with copies of each other's
 * points; and composite data sets. The values were compared with the values of VTK 9.1.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "unit/data/import/support.h"

/* Value of the point (x, y, z). */
static int value(int x, int y, int z) {
    return x + 10 * y + 3 * z + 20;
}

/* Appends a piece of an image with the values of its points and of its cells. A cell has the value
 * of its first corner. */
static void add_piece(char *text, const int e[6]) {
    char *at = text + strlen(text);
    at += sprintf(at, "<Piece Extent=\"%d %d %d %d %d %d\">", e[0], e[1], e[2], e[3], e[4], e[5]);
    for (int cells = 0; cells < 2; cells++) {
        at += sprintf(at, "<%sData><DataArray type=\"Int16\" Name=\"%s\">",
                      cells ? "Cell" : "Point", cells ? "c" : "p");
        for (int z = e[4]; z <= e[5] - cells * (e[5] > e[4]); z++)
            for (int y = e[2]; y <= e[3] - cells; y++)
                for (int x = e[0]; x <= e[1] - cells; x++)
                    at += sprintf(at, "%d ", value(x, y, z));
        at += sprintf(at, "</DataArray></%sData>", cells ? "Cell" : "Point");
    }
    sprintf(at, "</Piece>");
}

#define IMAGE "<ImageData WholeExtent=\"3 9 -1 3 0 1\" Origin=\"10 0 0\" Spacing=\"2 1 1\">"

/* Checks the whole grid of points, 3 to 9, −1 to 3, 0 to 1, or the grid of its cells. */
static void assert_is_whole(const char *source, int cells) {
    struct sp_volume *volume = load(source);
    const struct sp_volume_info *info = sp_volume_info(volume);
    const int16_t *voxels = sp_volume_voxels(volume);
    assert_int_equal(info->grid.dims[0], 7 - cells);
    assert_int_equal(info->grid.dims[1], 5 - cells);
    assert_int_equal(info->grid.dims[2], 2 - cells);
    assert_float_equal(info->grid.origin[0], 10 + 2 * 3 + cells, 0);
    assert_float_equal(info->grid.origin[1], -1 + cells / 2.0, 0);
    for (int z = 0; z < 2 - cells; z++)
        for (int y = -1; y < 4 - cells; y++)
            for (int x = 3; x < 10 - cells; x++)
                assert_int_equal(*voxels++, value(x, y, z));
    assert_string_equal(info->warnings[0], "");
    sp_volume_unref(&volume);
}

static const int parts[3][6] = { { 3, 5, -1, 3, 0, 1 },
                                 { 5, 9, -1, 1, 0, 1 },
                                 { 5, 9, 1, 3, 0, 1 } };
static const int overlapping[3][6] = { { 3, 7, -1, 3, 0, 1 },
                                       { 5, 9, -1, 2, 0, 1 },
                                       { 5, 9, 0, 3, 0, 1 } };

static void pieces_of_one_file_are_joined(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) {
        char text[1 << 14] = "<VTKFile type=\"ImageData\">" IMAGE;
        for (int k = 0; k < 3; k++)
            add_piece(text, i ? overlapping[k] : parts[k]);
        strcat(text, "<Piece Extent=\"0 -1 0 -1 0 -1\"/></ImageData></VTKFile>"); /* empty */
        write_text("one.vti", "%s", text);
        assert_is_whole("one.vti", 0);
        assert_is_whole("one.vti?field=c", 1);
    }
}

static void pieces_of_several_files_are_joined(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) {
        char list[2048], text[1 << 14];
        size_t at = (size_t)sprintf(list,
                                    "<VTKFile type=\"PImageData\"><PImageData WholeExtent="
                                    "\"3 9 -1 3 0 1\" GhostLevel=\"%d\" Origin=\"10 0 0\" "
                                    "Spacing=\"2 1 1\"><PPointData Scalars=\"p\">"
                                    "<PDataArray type=\"Int16\" Name=\"p\"/></PPointData>",
                                    i);
        for (int k = 0; k < 3; k++) {
            char name[32];
            snprintf(name, sizeof name, "part %d ä.vti", k);
            /* The place of a piece does not count: writers leave it out. */
            strcpy(text, "<VTKFile type=\"ImageData\"><ImageData>");
            add_piece(text, i ? overlapping[k] : parts[k]);
            strcat(text, "</ImageData></VTKFile>");
            write_text(name, "%s", text);
            at += (size_t)sprintf(list + at, "<Piece Source=\"%s\"/>", name);
        }
        sprintf(list + at, "</PImageData></VTKFile>");
        write_text("all.pvti", "%s", list);
        assert_is_whole("all.pvti", 0);
        assert_is_whole("all.pvti?field=c", 1);
    }
}

/* Samples that no piece has become NaN, or 0 in integer types, with a warning. */
static void gaps_between_pieces_are_told(void **state) {
    (void)state;
    write_text("gap.vti",
               "<VTKFile type=\"ImageData\"><ImageData>"
               "<Piece Extent=\"0 1 0 0 0 0\"><PointData><DataArray type=\"Float32\" Name=\"s\">"
               "1 2</DataArray></PointData></Piece>"
               "<Piece Extent=\"3 4 0 0 0 0\"><PointData><DataArray type=\"Float32\" Name=\"s\">"
               "3 4</DataArray></PointData></Piece></ImageData></VTKFile>");
    struct sp_volume *volume = load("gap.vti");
    const float *voxels = sp_volume_voxels(volume);
    assert_float_equal(voxels[1], 2, 0);
    assert_true(isnan(voxels[2]));
    assert_float_equal(voxels[4], 4, 0);
    assert_non_null(strstr(sp_volume_info(volume)->warnings[0], "do not fill the grid"));
    sp_volume_unref(&volume);
}

#define UNSTRUCTURED                                                                               \
    "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece NumberOfPoints=\"3\" "            \
    "NumberOfCells=\"1\"><PointData><DataArray type=\"Float32\" Name=\"s\">%s</DataArray>"         \
    "<DataArray type=\"%s\" Name=\"vtkGhostType\">%s</DataArray></PointData><Points>"              \
    "<DataArray type=\"Float32\" NumberOfComponents=\"3\">%s</DataArray></Points></Piece>"         \
    "</UnstructuredGrid></VTKFile>"

/* Copies of points of other pieces are left out. Numbers that are no flags mark none. */
static void ghosts_are_left_out(void **state) {
    (void)state;
    write_text("u0.vtu", UNSTRUCTURED, "1 2 3", "Float64", "1e300 nan -1e10", "1 0 0 2 0 0 3 0 0");
    write_text("u1.vtu", UNSTRUCTURED, "3 4 5", "UInt8", "1 0 0", "3 0 0 4 0 0 5 0 0");
    write_text("u.pvtu", "<VTKFile type=\"PUnstructuredGrid\"><PUnstructuredGrid GhostLevel=\"1\">"
                         "<Piece Source=\"u0.vtu\"/><Piece Source=\"u1.vtu\"/>"
                         "</PUnstructuredGrid></VTKFile>");
    struct sp_volume *volume = load("u.pvtu");
    const struct sp_elements *e = sp_volume_elements(volume);
    assert_int_equal(e->shape.count, 5);
    float sum = 0;
    for (int i = 0; i < 5; i++) {
        assert_float_equal(e->positions[i][0], e->values[i], 0);
        sum += e->values[i];
    }
    assert_float_equal(sum, 15, 0);
    assert_string_equal(sp_volume_info(volume)->warnings[0],
                        "The 2 cells of the unstructured grid are not read; its points are drawn.");
    sp_volume_unref(&volume);
}

#define POLY                                                                                       \
    "<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"3\" NumberOfPolys=\"1\" "        \
    "NumberOfLines=\"1\"><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\">%d 0 0 "     \
    "%d 1 0 %d 0 1</DataArray></Points><Lines><DataArray type=\"Int32\" Name=\"connectivity\">"    \
    "0 1</DataArray><DataArray type=\"Int32\" Name=\"offsets\">2</DataArray></Lines><Polys>"       \
    "<DataArray type=\"Int32\" Name=\"connectivity\">0 1 2</DataArray>"                            \
    "<DataArray type=\"Int32\" "                                                                   \
    "Name=\"offsets\">3</DataArray></Polys></Piece></PolyData></VTKFile>"

static void meshes_of_pieces_are_joined(void **state) {
    (void)state;
    uint32_t count[2];
    write_text("m0.vtp", POLY, 0, 0, 0);
    write_text("m1.vtp", POLY, 5, 5, 5);
    write_text("m.pvtp", "<VTKFile type=\"PPolyData\"><PPolyData><Piece Source=\"m0.vtp\"/>"
                         "<Piece Source=\"m1.vtp\"/></PPolyData></VTKFile>");
    for (int i = 0; i < 2; i++) {
        struct sp_volume *volume = load(i ? "m.pvtp" : "m0.vtp");
        assert_int_equal(sp_volume_info(volume)->elements.kind, SP_KIND_MESH);
        count[i] = sp_volume_info(volume)->elements.count;
        sp_volume_unref(&volume);
    }
    assert_int_equal(count[1], 2 * count[0]);
}

#define BLOCK(value)                                                                               \
    "<VTKFile type=\"ImageData\"><ImageData><Piece Extent=\"0 1 0 0 0 0\"><PointData>"             \
    "<DataArray type=\"UInt8\" Name=\"s\">" value " 2</DataArray></PointData></Piece></ImageData>" \
    "</VTKFile>"

/* The first block is read, and a warning names the others. */
static void composite_data_sets_give_their_first_block(void **state) {
    (void)state;
    write_text("b0.vti", BLOCK("7"));
    write_text("b1.vti", BLOCK("8"));
    write_text("b.vtm", "<VTKFile type=\"vtkMultiBlockDataSet\"><vtkMultiBlockDataSet>"
                        "<Block index=\"0\" name=\"in\"><DataSet index=\"0\" file=\"b0.vti\"/>"
                        "<DataSet index=\"1\" file=\"b1.vti\"/></Block>"
                        "</vtkMultiBlockDataSet></VTKFile>");
    struct sp_volume *volume = load("b.vtm");
    assert_int_equal(*(const uint8_t *)sp_volume_voxels(volume), 7);
    assert_string_equal(sp_volume_info(volume)->warnings[0],
                        "Only the first of 2 blocks, b0.vti, is read. Open the others by their "
                        "files: b1.vti.");
    sp_volume_unref(&volume);
}

/* The time in a file becomes the time of the volume, or of the step in a series of files. */
static void times_of_files_are_kept(void **state) {
    (void)state;
    static const double times[3] = { 0.5, 2, 4.25 };
    for (int i = 0; i < 3; i++) {
        char name[32];
        snprintf(name, sizeof name, "time%d.vti", i);
        write_text(name,
                   "<VTKFile type=\"ImageData\"><ImageData><FieldData><DataArray type=\"Float64\" "
                   "Name=\"TimeValue\" NumberOfTuples=\"1\">%g</DataArray></FieldData>"
                   "<Piece Extent=\"0 1 0 0 0 0\"><PointData><DataArray type=\"UInt8\" Name=\"s\">"
                   "%d 2</DataArray></PointData></Piece></ImageData></VTKFile>",
                   times[i], i);
    }
    struct sp_volume *volume = load("time1.vti");
    assert_int_equal(sp_volume_info(volume)->steps.count, 1);
    assert_float_equal(sp_volume_info(volume)->steps.times[0], 2, 0);
    sp_volume_unref(&volume);
    volume = load_step("time*.vti", 1);
    const struct sp_steps *steps = &sp_volume_info(volume)->steps;
    assert_int_equal(steps->count, 3);
    assert_int_equal(*(const uint8_t *)sp_volume_voxels(volume), 1);
    for (int i = 0; i < 3; i++)
        assert_float_equal(steps->times[i], times[i], 0);
    sp_volume_unref(&volume);
    write_text("time2.vti", BLOCK("7")); /* one file without a time: all times are unknown */
    volume = load_step("time*.vti", 1);
    assert_null(sp_volume_info(volume)->steps.times);
    sp_volume_unref(&volume);
    write_text("time.vtk", "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\n"
                           "FIELD FieldData 1\nTIME 1 1 double\n7.5\nDIMENSIONS 2 1 1\n"
                           "POINT_DATA 2\nSCALARS s int\nLOOKUP_TABLE d\n1 2\n");
    volume = load("time.vtk");
    assert_float_equal(sp_volume_info(volume)->steps.times[0], 7.5, 0);
    sp_volume_unref(&volume);
}

static void bad_lists_are_refused(void **state) {
    (void)state;
    static const struct {
        const char *text;
        enum sp_code code;
        const char *place, *message;
    } cases[] = {
        { "<VTKFile type=\"PImageData\"><PImageData><Piece Source=\"none.vti\"/></PImageData>"
          "</VTKFile>",
          SP_ERR_NOT_FOUND, "none.vti", "" },
        { "<VTKFile type=\"PImageData\"><PImageData><Piece/></PImageData></VTKFile>", SP_ERR_FORMAT,
          "Source", "names no file" },
        { "<VTKFile type=\"PImageData\"><PImageData><Piece Source=\"/etc/passwd\"/></PImageData>"
          "</VTKFile>",
          SP_ERR_DENIED, "/etc/passwd", "" },
        { "<VTKFile type=\"PImageData\"><PImageData><Piece Source=\"l.pvti\"/></PImageData>"
          "</VTKFile>",
          SP_ERR_UNSUPPORTED, "l.pvti: byte 0: type", "but a piece must be ImageData" },
        { "<VTKFile type=\"PPolyData\"><PPolyData><Piece Source=\"b0.vti\"/></PPolyData></VTKFile>",
          SP_ERR_UNSUPPORTED, "b0.vti: byte 0: type", "but a piece must be PolyData" },
        { "<VTKFile type=\"vtkMultiBlockDataSet\"><a><DataSet file=\"l.pvti\"/></a></VTKFile>",
          SP_ERR_UNSUPPORTED, "l.pvti", "names files of its own" },
        { "<VTKFile type=\"PImageData\"><PImageData><Piece Source=\"b0.vti\"/>"
          "<Piece Source=\"f.vti\"/></PImageData></VTKFile>",
          SP_ERR_UNSUPPORTED, "l.pvti", "all must have the same" },
    };
    write_text("b0.vti", BLOCK("7"));
    write_text("f.vti", "<VTKFile type=\"ImageData\"><ImageData><Piece Extent=\"2 3 0 0 0 0\">"
                        "<PointData><DataArray type=\"Float32\" Name=\"s\">1 2</DataArray>"
                        "</PointData></Piece></ImageData></VTKFile>");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        write_text("l.pvti", "%s", cases[i].text);
        load_error("l.pvti", cases[i].code, cases[i].place, cases[i].message);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pieces_of_one_file_are_joined),
        cmocka_unit_test(pieces_of_several_files_are_joined),
        cmocka_unit_test(gaps_between_pieces_are_told),
        cmocka_unit_test(ghosts_are_left_out),
        cmocka_unit_test(meshes_of_pieces_are_joined),
        cmocka_unit_test(composite_data_sets_give_their_first_block),
        cmocka_unit_test(times_of_files_are_kept),
        cmocka_unit_test(bad_lists_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
