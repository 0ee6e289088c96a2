/* SPDX-License-Identifier: Apache-2.0
 *
 * Points of VTK files: structured grids, unstructured grids, polygons.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

static const struct sp_elements *elements_of(const struct sp_volume *volume, enum sp_kind kind,
                                             uint32_t count) {
    const struct sp_elements *e = sp_volume_elements(volume);
    assert_non_null(e);
    assert_int_equal(e->shape.kind, kind);
    assert_int_equal(e->shape.count, count);
    return e;
}

static const struct sp_elements *points_of(const struct sp_volume *volume, uint32_t count) {
    return elements_of(volume, SP_KIND_POINTS, count);
}

/* The point with value v lies at (v, v/2, -v). */
static void assert_are_placed(const struct sp_volume *volume, uint32_t count) {
    const struct sp_elements *e = points_of(volume, count);
    double sum = 0;
    for (uint32_t i = 0; i < count; i++) {
        assert_float_equal(e->positions[i][0], e->values[i], 0);
        assert_float_equal(e->positions[i][1], e->values[i] / 2, 0);
        assert_float_equal(e->positions[i][2], -e->values[i], 0);
        assert_compare(e->volumes[i], >, 0);
        sum += (double)e->values[i];
    }
    assert_float_equal(sum, count * (count + 1) / 2.0, 0);
}

#define THREE "1 0.5 -1 2 1 -2 3 1.5 -3\n"
#define HEAT "POINT_DATA 3\nSCALARS heat short\nLOOKUP_TABLE default\n1 2 3\n"

static void legacy_points_are_read(void **state) {
    static const char *const files[] = {
        "3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 3 float\n" THREE
        "CELLS 2 5\n1 0\n2 1 2\nCELL_TYPES 2\n1 3\n" HEAT,
        "5.1\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 3 double\n" THREE
        "METADATA\nINFORMATION 0\n\nCELLS 3 3\nOFFSETS vtktypeint64\n0 1 3\n"
        "CONNECTIVITY vtktypeint64\n0 1 2\nCELL_TYPES 2\n1 3\n" HEAT,
        "4.2\n\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n" THREE
        "VERTICES 1 2\n1 0\nLINES 1 3\n2 0 1\nPOLYGONS 1 4\n3 0 1 2\n"
        "CELL_DATA 3\nSCALARS s float\nLOOKUP_TABLE default\n7 8 9\n" HEAT,
        "5.1\n\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n" THREE
        "POLYGONS 2 3\nOFFSETS vtktypeint64\n0 3\nCONNECTIVITY vtktypeint64\n0 1 2\n"
        "POINT_DATA 3\nFIELD f 2\nname 3 3 float\n0 0 0 0 0 0 0 0 0\n"
        "heat 1 3 unsigned_int\n1 2 3\n",
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        write_text("p.vtk", "# vtk DataFile Version %s", files[i]);
        struct sp_volume *volume = load("p.vtk?field=heat"); /* else the polygons are a mesh */
        assert_are_placed(volume, 3);
        assert_string_equal(sp_volume_info(volume)->value_name, "heat");
        sp_volume_unref(&volume);
    }
}

static void binary_legacy_points_are_read(void **state) {
    char file[512];
    const float points[9] = { 1, 0.5f, -1, 2, 1, -2, 3, 1.5f, -3 };
    const int cells[5] = { 1, 0, 2, 1, 2 };
    const double values[3] = { 1, 2, 3 };
    (void)state;
    size_t at = (size_t)sprintf(file, "# vtk DataFile Version 3.0\n\nBINARY\n"
                                      "DATASET UNSTRUCTURED_GRID\nPOINTS 3 float\n");
    float turned[9];
    import_swap(memcpy(turned, points, sizeof points), 4, 9);
    memcpy(file + at, turned, sizeof turned);
    at += sizeof points;
    at += (size_t)sprintf(file + at, "\nCELLS 2 5\n");
    memcpy(file + at, cells, sizeof cells);
    at += sizeof cells;
    at += (size_t)sprintf(file + at, "\nCELL_TYPES 2\n");
    memcpy(file + at, cells, 8);
    at += 8;
    at += (size_t)sprintf(file + at, "\nPOINT_DATA 3\nSCALARS heat double\nLOOKUP_TABLE t\n");
    double swapped[3];
    import_swap(memcpy(swapped, values, sizeof values), 8, 3);
    memcpy(file + at, swapped, sizeof swapped);
    write_file("b.vtk", file, at + sizeof swapped);
    struct sp_volume *volume = load("b.vtk");
    assert_are_placed(volume, 3);
    sp_volume_unref(&volume);
}

#define PIECE                                                                                      \
    "<Piece NumberOfPoints=\"3\"><PointData Scalars=\"heat\">"                                     \
    "<DataArray type=\"Float32\" Name=\"other\">7 8 9</DataArray>"                                 \
    "<DataArray type=\"UInt64\" Name=\"heat\">1 2 3</DataArray></PointData>"                       \
    "<Points><DataArray type=\"Float64\" NumberOfComponents=\"3\">" THREE "</DataArray></Points>"

static void xml_points_are_read(void **state) {
    static const char *const files[] = {
        "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid>" PIECE
        "<Cells><DataArray type=\"Int32\" Name=\"connectivity\">0 1 2</DataArray></Cells>"
        "</Piece></UnstructuredGrid></VTKFile>",
        "<VTKFile type=\"PolyData\"><PolyData>" PIECE
        "<Verts/><Polys><DataArray type=\"Int32\" Name=\"offsets\">3</DataArray></Polys>"
        "</Piece></PolyData></VTKFile>",
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        write_text("p.vtu", "%s", files[i]);
        struct sp_volume *volume = load("p.vtu");
        assert_are_placed(volume, 3);
        assert_string_equal(sp_volume_info(volume)->value_name, "heat");
        sp_volume_unref(&volume);
    }
}

/* Vectors give their lengths; without data the value is 1. No points are a volume. */
static void points_need_no_scalars(void **state) {
    (void)state;
    write_text("v.vtk", "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 2 int\n"
                        "0 0 0 1 1 1\nPOINT_DATA 2\nVECTORS v float\n3 4 0 5 12 0\n");
    struct sp_volume *volume = load("v.vtk");
    const struct sp_elements *e = points_of(volume, 2);
    assert_float_equal(e->values[0] + e->values[1], 18, 0);
    assert_compare(e->factors[0][0], >, 0);
    assert_string_equal(sp_volume_info(volume)->value_name, "magnitude");
    assert_string_equal(sp_volume_info(volume)->vector_name, "v");
    assert_float_equal(e->vectors[1][1], 12, 0);
    assert_ptr_equal(sp_volume_vectors(volume), e->vectors);
    assert_int_equal(sp_volume_info(volume)->vector_bytes, 2 * 3 * sizeof(float));
    assert_float_equal(sp_volume_info(volume)->longest, 13, 1e-6);
    sp_volume_unref(&volume);
    write_text("v.vtk", "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 2 int\n"
                        "0 0 0 1 1 1\n");
    volume = load("v.vtk");
    assert_float_equal(points_of(volume, 2)->values[1], 1, 0);
    sp_volume_unref(&volume);
    write_text("v.vtk", "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 0 int\n"
                        "POINT_DATA 0\nSCALARS s int\nLOOKUP_TABLE default\n");
    volume = load("v.vtk");
    points_of(volume, 0);
    sp_volume_unref(&volume);
}

static void points_without_scalars_keep_their_colors(void **state) {
    static const char *const arrays[] = {
        "COLOR_SCALARS rgb 3\n1 0 0 0 1 0.2\n",
        "SCALARS rgb unsigned_char 3\nLOOKUP_TABLE default\n255 0 0 0 255 51\n",
        "SCALARS rgb unsigned_char 4\nLOOKUP_TABLE default\n255 0 0 255 0 255 51 255\n",
    };
    const double constant = 0.28209479177387814; /* the harmonic of degree 0 */
    (void)state;
    for (size_t n = 0; n < sizeof arrays / sizeof *arrays; n++) {
        write_text("c.vtk",
                   "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 2 float\n"
                   "0 0 0 1 1 1\nPOINT_DATA 2\n%s",
                   arrays[n]);
        struct sp_volume *volume = load("c.vtk");
        const struct sp_elements *e = elements_of(volume, SP_KIND_GAUSSIANS, 2);
        for (uint32_t i = 0; i < 2; i++) {
            const bool is_first = e->positions[i][0] < 0.5F;
            const double wanted[3] = { is_first, !is_first, is_first ? 0 : 0.2 };
            for (int k = 0; k < 3; k++)
                assert_float_equal(0.5 + constant * (double)e->harmonics[3 * i + (uint32_t)k],
                                   wanted[k], 1e-6);
        }
        assert_string_equal(sp_volume_info(volume)->value_name, "colors");
        assert_string_equal(sp_volume_info(volume)->others[0], "rgb red");
        sp_volume_unref(&volume);
        volume = load("c.vtk?field=rgb green");
        assert_float_equal(points_of(volume, 2)->values[0], 0, 0);
        sp_volume_unref(&volume);
    }
    write_text("c.vtk",
               "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 2 float\n"
               "0 0 0 1 1 1\nPOINT_DATA 2\nSCALARS heat float\nLOOKUP_TABLE default\n3 4\n%s",
               arrays[0]);
    struct sp_volume *volume = load("c.vtk"); /* scalars come first */
    assert_float_equal(points_of(volume, 2)->values[0], 3, 0);
    sp_volume_unref(&volume);
    volume = load("c.vtk?field=colors");
    elements_of(volume, SP_KIND_GAUSSIANS, 2);
    assert_string_equal(sp_volume_info(volume)->others[0], "heat");
    sp_volume_unref(&volume);
}

/* A sheared grid of 3×2×2 nodes whose last layer is folded back. */
static void structured_grids_have_kernels_from_their_cells(void **state) {
    char positions[1024] = "", values[256] = "";
    size_t at = 0, written = 0;
    (void)state;
    for (int k = 0; k < 4; k++)
        for (int j = 0; j < 2; j++)
            for (int i = 0; i < 3; i++) {
                at += (size_t)sprintf(positions + at, "%g %d %d ", 2 * i + 0.5 * j, 3 * j,
                                      k < 3 ? k : 1);
                written += (size_t)sprintf(values + written, "%d ", (k * 2 + j) * 3 + i);
            }
    write_text("s.vtk",
               "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_GRID\nDIMENSIONS 3 2 4\n"
               "POINTS 24 float\n%s\nPOINT_DATA 24\nSCALARS q float\nLOOKUP_TABLE default\n%s\n",
               positions, values);
    write_text(
        "s.vts",
        "<VTKFile type=\"StructuredGrid\"><StructuredGrid><Piece Extent=\"5 7 0 1 -1 2\">"
        "<PointData><DataArray type=\"Float32\" Name=\"q\">%s</DataArray></PointData>"
        "<Points><DataArray type=\"Float32\" NumberOfComponents=\"3\">%s</DataArray></Points>"
        "</Piece></StructuredGrid></VTKFile>",
        values, positions);
    for (int xml = 0; xml < 2; xml++) {
        struct sp_volume *volume = load(xml ? "s.vts" : "s.vtk");
        const struct sp_elements *e = points_of(volume, 24);
        assert_int_equal(sp_volume_info(volume)->folded, 12); /* flat at 2, turned at 3 */
        assert_int_equal(sp_volume_info(volume)->nonfinite, 12);
        for (int i = 0; i < 12; i++) {
            assert_float_equal(e->values[i], i, 0); /* their order stays */
            assert_float_equal(e->volumes[i], 6, 1e-5);
            assert_float_equal(e->factors[i][0], 0.7 * hypot(2, 0.5), 1e-5);
            assert_float_equal(e->factors[i][5], 0.7, 1e-5);
            assert_true(isnan(e->values[12 + i]));
        }
        sp_volume_unref(&volume);
    }
}

static void the_sample_grid_agrees_with_another_program(void **state) {
    const char *path = SPLATD_DATA_DIR "/formats/vtk/SampleStructGrid.vtk";
    struct sp_load_options options = importer_options();
    (void)state;
    if (access(path, R_OK) != 0) {
        print_message("skipped: %s does not exist\n", path);
        skip();
    }
    struct sp_volume *volume = sp_volume_load(path, &options, NULL);
    assert_non_null(volume);
    const struct sp_elements *e = points_of(volume, 20 * 30 * 40);
    double sum = 0;
    for (uint32_t i = 0; i < e->shape.count; i++)
        sum += (double)e->volumes[i];
    /* Recorded from a script in Python: all determinants are negative. */
    assert_float_equal(sum, 0.375077, 2e-6);
    assert_int_equal(sp_volume_info(volume)->folded, 0);
    assert_float_equal(sp_volume_info(volume)->range[1], 1.30456, 1e-5);
    sp_volume_unref(&volume);
}

#define LEGACY "# vtk DataFile Version 3.0\n\nASCII\nDATASET "
#define XML(set, piece) "<VTKFile type=\"" set "\"><" set ">" piece "</Piece></" set "></VTKFile>"

static void bad_files_are_refused(void **state) {
    static const struct {
        const char *text;
        enum sp_code code;
        const char *place, *reason;
    } files[] = {
        { LEGACY "POLYDATA\n", SP_ERR_FORMAT, "POINTS", "are missing" },
        { LEGACY "POLYDATA\nDIMENSIONS 1 1 1\n", SP_ERR_FORMAT, "DIMENSIONS", "do not belong" },
        { LEGACY "POLYDATA\nORIGIN 0 0 0\n", SP_ERR_FORMAT, "ORIGIN", "STRUCTURED_POINTS only" },
        { LEGACY "STRUCTURED_POINTS\nPOINTS 1 float\n", SP_ERR_FORMAT, "POINTS", "do not belong" },
        { LEGACY "STRUCTURED_GRID\nPOINTS 1 float\n", SP_ERR_FORMAT, "POINTS",
          "before DIMENSIONS" },
        { LEGACY "STRUCTURED_GRID\nDIMENSIONS 2 2 2\nPOINTS 7 float\n", SP_ERR_FORMAT, "POINTS",
          "7 points, but DIMENSIONS give 8" },
        { LEGACY "POLYDATA\nPOINTS 1 float\n1 2\n", SP_ERR_FORMAT, "POINTS", "1 more values" },
        { LEGACY "POLYDATA\nPOINTS 999999999999 float\n1 2\n", SP_ERR_FORMAT, "POINTS",
          "more values are expected" },
        { LEGACY "POLYDATA\nPOINTS 1 float\n1 2 x\n", SP_ERR_FORMAT, "POINTS", "\"x\"" },
        { LEGACY "POLYDATA\nPOINTS 1 float\n1 2 3\nPOINTS 1 float\n1 2 3\n", SP_ERR_FORMAT,
          "POINTS", "twice" },
        { LEGACY "POLYDATA\nPOINTS 1 float\n1 2 3\nPOINT_DATA 2\n", SP_ERR_FORMAT, "POINT_DATA",
          "2 points, but POINTS give 1" },
        { LEGACY "POLYDATA\nPOINT_DATA 2\n", SP_ERR_FORMAT, "POINT_DATA", "before POINTS" },
        { "# vtk DataFile Version 5.1\n\nASCII\nDATASET POLYDATA\nPOINTS 1 float\n1 2 3\n"
          "LINES 1 1\n0 0\n",
          SP_ERR_FORMAT, "LINES", "instead of OFFSETS" },
        { XML("PolyData", "<Piece>"), SP_ERR_FORMAT, "NumberOfPoints", "is missing" },
        { XML("PolyData", "<Piece NumberOfPoints=\"1\">"), SP_ERR_FORMAT, "Points", "are missing" },
        { XML("PolyData", "<Piece NumberOfPoints=\"-1\">"), SP_ERR_FORMAT, "NumberOfPoints",
          "whole number" },
        { XML("PolyData", "<Piece NumberOfPoints=\"1\"><Points><DataArray type=\"Int8\" "
                          "NumberOfComponents=\"2\">1 2</DataArray></Points>"),
          SP_ERR_FORMAT, "Points", "one array of three components" },
        { XML("PolyData", "<Piece NumberOfPoints=\"2\"><Points><DataArray type=\"Int8\" "
                          "NumberOfComponents=\"3\">1 2 3</DataArray></Points>"),
          SP_ERR_FORMAT, "DataArray", "values" },
        { XML("PolyData", "<Piece NumberOfPoints=\"400000000\"><Points><DataArray type=\"Int8\" "
                          "NumberOfComponents=\"3\">1 2 3</DataArray></Points>"),
          SP_ERR_UNSUPPORTED, "PolyData", "more than the 268435456" },
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        write_text("bad.vtk", "%s", files[i].text);
        load_error("bad.vtk", files[i].code, files[i].place, files[i].reason);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(legacy_points_are_read),
        cmocka_unit_test(binary_legacy_points_are_read),
        cmocka_unit_test(xml_points_are_read),
        cmocka_unit_test(points_need_no_scalars),
        cmocka_unit_test(points_without_scalars_keep_their_colors),
        cmocka_unit_test(structured_grids_have_kernels_from_their_cells),
        cmocka_unit_test(the_sample_grid_agrees_with_another_program),
        cmocka_unit_test(bad_files_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
