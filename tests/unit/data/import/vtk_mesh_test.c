/* SPDX-License-Identifier: Apache-2.0
 *
 * Surfaces and lines of VTK data sets of polygons, legacy and XML.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

#define LEGACY "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\n"
#define LEGACY_5 "# vtk DataFile Version 5.1\n\nASCII\nDATASET POLYDATA\n"
/* A square of side 2 in the plane z = 3, and a point above it. */
#define SQUARE "0 0 3 2 0 3 2 2 3 0 2 3 1 1 4\n"
#define XML(piece, cells)                                                                          \
    "<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"5\" " piece                      \
    "><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\">" SQUARE                        \
    "</DataArray></Points>" cells "</Piece></PolyData></VTKFile>"

static const struct sp_elements *mesh_of(const struct sp_volume *volume) {
    const struct sp_elements *e = sp_volume_elements(volume);
    assert_non_null(e);
    assert_int_equal(e->shape.kind, SP_KIND_MESH);
    return e;
}

/* The square as triangles that look along +z, with an area of 4. */
static void assert_is_square(const struct sp_volume *volume) {
    const struct sp_elements *e = mesh_of(volume);
    double area = 0;
    assert_int_equal(e->shape.count, 2);
    assert_int_equal(e->shape.vertex_count, 4);
    assert_true(e->shape.lacks_colors);
    for (uint32_t t = 0; t < 2; t++) {
        const float(*p)[3] = (const float(*)[3])e->positions;
        const uint32_t *at = e->triangles[t];
        area += 0.5 * (double)((p[at[1]][0] - p[at[0]][0]) * (p[at[2]][1] - p[at[0]][1]) -
                               (p[at[1]][1] - p[at[0]][1]) * (p[at[2]][0] - p[at[0]][0]));
    }
    assert_float_equal(area, 4, 1e-6);
    for (uint32_t v = 0; v < 4; v++) {
        assert_float_equal(e->positions[v][2], 3, 0);
        assert_float_equal(e->normals[v][2], 1, 1e-6);
        assert_float_equal(e->colors[v][3], 1, 0);
    }
}

static void polygons_and_strips_are_triangles(void **state) {
    static const char *const files[][2] = {
        { "q.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 1 5\n4 0 1 2 3\n" },
        { "q.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 2 8\n3 0 1 2 3 0 2 3\n" },
        { "q.vtk", LEGACY "POINTS 5 float\n" SQUARE "TRIANGLE_STRIPS 1 5\n4 0 1 3 2\n" },
        { "q.vtk", LEGACY_5 "POINTS 5 double\n" SQUARE "POLYGONS 2 4\nOFFSETS vtktypeint64\n0 4\n"
                            "CONNECTIVITY vtktypeint64\n0 1 2 3\n" },
        { "q.vtp", XML("NumberOfPolys=\"1\"",
                       "<Polys><DataArray type=\"Int64\" Name=\"connectivity\">0 1 2 3</DataArray>"
                       "<DataArray type=\"Int64\" Name=\"offsets\">4</DataArray></Polys>") },
        { "q.vtp",
          XML("NumberOfStrips=\"1\" NumberOfLines=\"0\"",
              "<Lines/><Strips><DataArray type=\"Int32\" Name=\"offsets\">4</DataArray>"
              "<DataArray type=\"Int32\" Name=\"connectivity\">0 1 3 2</DataArray></Strips>") },
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        write_text(files[i][0], "%s", files[i][1]);
        struct sp_volume *volume = load(files[i][0]);
        assert_is_square(volume);
        assert_string_equal(sp_volume_info(volume)->warnings[0], "");
        sp_volume_unref(&volume);
    }
}

/* Seven strips of odd and even triangles: each looks to the same side. */
static void long_strips_keep_their_side(void **state) {
    char points[512] = "", strip[128] = "";
    size_t at = 0, written = 0;
    (void)state;
    for (int i = 0; i < 9; i++) {
        at += (size_t)sprintf(points + at, "%d %d 0 ", i / 2, i % 2);
        written += (size_t)sprintf(strip + written, " %d", i);
    }
    write_text("s.vtk", LEGACY "POINTS 9 float\n%s\nTRIANGLE_STRIPS 1 10\n9%s\n", points, strip);
    struct sp_volume *volume = load("s.vtk");
    const struct sp_elements *e = mesh_of(volume);
    assert_int_equal(e->shape.count, 7);
    for (uint32_t v = 0; v < e->shape.vertex_count; v++)
        assert_float_equal(e->normals[v][2], -1, 1e-6);
    sp_volume_unref(&volume);
}

static void binary_polygons_are_read(void **state) {
    char file[512];
    const float points[9] = { 0, 0, 0, 1, 0, 0, 0, 1, 0 };
    const int32_t cells[4] = { 3, 0, 1, 2 };
    const uint8_t colors[9] = { 255, 0, 0, 0, 255, 0, 0, 0, 51 };
    float turned[9];
    int32_t corners[4];
    (void)state;
    size_t at = (size_t)sprintf(file, "# vtk DataFile Version 3.0\n\nBINARY\nDATASET POLYDATA\n"
                                      "POINTS 3 float\n");
    import_swap(memcpy(turned, points, sizeof points), 4, 9);
    memcpy(file + at, turned, sizeof turned);
    at += sizeof turned;
    at += (size_t)sprintf(file + at, "\nPOLYGONS 1 4\n");
    import_swap(memcpy(corners, cells, sizeof cells), 4, 4);
    memcpy(file + at, corners, sizeof corners);
    at += sizeof corners;
    at += (size_t)sprintf(file + at, "\nPOINT_DATA 3\nCOLOR_SCALARS c 3\n");
    memcpy(file + at, colors, sizeof colors);
    write_file("b.vtk", file, at + sizeof colors);
    struct sp_volume *volume = load("b.vtk");
    const struct sp_elements *e = mesh_of(volume);
    assert_int_equal(e->shape.count, 1);
    assert_float_equal(e->colors[e->triangles[0][0]][0], 1, 1e-6);
    assert_float_equal(e->colors[e->triangles[0][1]][1], 1, 1e-6);
    assert_float_equal(e->colors[e->triangles[0][2]][2], 0.2, 1e-6);
    sp_volume_unref(&volume);
}

static void normals_and_colors_are_those_of_the_points(void **state) {
    static const char *const files[][2] = {
        { "n.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 1 5\n4 0 1 2 3\nPOINT_DATA 5\n"
                          "COLOR_SCALARS c 4\n1 0 0 .5 1 0 0 .5 1 0 0 .5 1 0 0 .5 0 0 0 1\n"
                          "NORMALS n float\n1 0 0 1 0 0 1 0 0 1 0 0 0 0 1\n" },
        { "n.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 1 5\n4 0 1 2 3\nPOINT_DATA 5\n"
                          "COLOR_SCALARS c 4\n255 0 0 127 255 0 0 127 255 0 0 127 255 0 0 127 0 0 "
                          "0 255\nNORMALS n float\n1 0 0 1 0 0 1 0 0 1 0 0 0 0 1\n" },
        { "n.vtp",
          XML("NumberOfPolys=\"1\"",
              "<PointData Normals=\"Normals\"><DataArray type=\"Float32\" Name=\"Normals\" "
              "NumberOfComponents=\"3\">1 0 0 1 0 0 1 0 0 1 0 0 0 0 1</DataArray>"
              "<DataArray type=\"UInt8\" Name=\"rgba\" NumberOfComponents=\"4\">"
              "255 0 0 127 255 0 0 127 255 0 0 127 255 0 0 127 0 0 0 1</DataArray></PointData>"
              "<Polys><DataArray type=\"Int64\" Name=\"connectivity\">0 1 2 3</DataArray>"
              "<DataArray type=\"Int64\" Name=\"offsets\">4</DataArray></Polys>") },
        { "wide.vtp?as=rgb",
          XML("NumberOfPolys=\"1\"",
              "<PointData Normals=\"Normals\"><DataArray type=\"Float32\" Name=\"Normals\" "
              "NumberOfComponents=\"3\">1 0 0 1 0 0 1 0 0 1 0 0 0 0 1</DataArray>"
              "<DataArray type=\"UInt16\" Name=\"rgba\" NumberOfComponents=\"4\">65535 0 0 32767 "
              "65535 0 0 32767 65535 0 0 32767 65535 0 0 32767 0 0 0 1</DataArray></PointData>"
              "<Polys><DataArray type=\"Int64\" Name=\"connectivity\">0 1 2 3</DataArray>"
              "<DataArray type=\"Int64\" Name=\"offsets\">4</DataArray></Polys>") },
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        char name[32];
        snprintf(name, sizeof name, "%.*s", (int)strcspn(files[i][0], "?"), files[i][0]);
        write_text(name, "%s", files[i][1]);
        struct sp_volume *volume = load(files[i][0]);
        const struct sp_elements *e = mesh_of(volume);
        assert_int_equal(e->shape.vertex_count, 4);
        assert_false(e->shape.lacks_colors);
        for (uint32_t v = 0; v < 4; v++) {
            assert_float_equal(e->normals[v][0], 1, 0);
            assert_float_equal(e->colors[v][0], 1, 1e-6);
            assert_float_equal(e->colors[v][3], 0.5, 0.003);
        }
        sp_volume_unref(&volume);
    }
}

static void lines_are_tubes(void **state) {
    static const char *const files[][2] = {
        { "l.vtk", LEGACY "POINTS 5 float\n" SQUARE "LINES 2 7\n3 0 1 2\n2 3 4\n" },
        { "l.vtp",
          XML("NumberOfLines=\"2\"",
              "<Lines><DataArray type=\"Int64\" Name=\"connectivity\">0 1 2 3 4</DataArray>"
              "<DataArray type=\"Int64\" Name=\"offsets\">3 5</DataArray></Lines>") },
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        write_text(files[i][0], "%s", files[i][1]);
        struct sp_volume *volume = load(files[i][0]);
        const struct sp_elements *e = mesh_of(volume);
        assert_int_equal(e->shape.vertex_count, 5 * 8);
        assert_int_equal(e->shape.count, 3 * 16 + 4 * 6);
        for (uint32_t v = 0; v < e->shape.vertex_count; v++)
            assert_compare(e->positions[v][2], >, 2.9f);
        sp_volume_unref(&volume);
    }
}

static bool warns(const struct sp_volume *volume, const char *text) {
    for (int i = 0; i < SP_WARNINGS_MAX; i++)
        if (strstr(sp_volume_info(volume)->warnings[i], text))
            return true;
    return false;
}

/* Warnings name the cells and the data that a mesh does not show. With ?field=NAME the file becomes
 * points, which show the data. */
static void what_is_left_out_is_a_warning(void **state) {
    (void)state;
    write_text("w.vtk", LEGACY "POINTS 5 float\n" SQUARE "VERTICES 1 2\n1 4\n"
                               "POLYGONS 1 5\n4 0 1 2 3\nCELL_DATA 2\nSCALARS c float\n"
                               "LOOKUP_TABLE default\n1 2\nPOINT_DATA 5\nSCALARS heat float\n"
                               "LOOKUP_TABLE default\n1 2 3 4 5\n");
    struct sp_volume *volume = load("w.vtk");
    assert_is_square(volume);
    assert_true(warns(volume, "1 cells that are vertices are not drawn"));
    assert_true(warns(volume, "The data of cells ("));
    assert_true(warns(volume, "\"heat\" are not shown"));
    assert_string_equal(sp_volume_info(volume)->others[0], "heat");
    sp_volume_unref(&volume);
    volume = load("w.vtk?field=heat");
    assert_int_equal(sp_volume_elements(volume)->shape.kind, SP_KIND_POINTS);
    assert_int_equal(sp_volume_elements(volume)->shape.count, 5);
    assert_float_equal(sp_volume_info(volume)->range[1], 5, 0);
    sp_volume_unref(&volume);
    write_text("w.vtk", LEGACY "POINTS 5 float\n" SQUARE "VERTICES 5 10\n1 0 1 1 1 2 1 3 1 4\n");
    volume = load("w.vtk");
    assert_int_equal(sp_volume_elements(volume)->shape.kind, SP_KIND_POINTS);
    assert_string_equal(sp_volume_info(volume)->warnings[0], "");
    sp_volume_unref(&volume);
}

/* Colours that are neither shares of 1 nor of 255. */
static void colors_that_are_cut_are_a_warning(void **state) {
    (void)state;
    write_text("c.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 1 5\n4 0 1 2 3\nPOINT_DATA 5\n"
                               "COLOR_SCALARS c 3\n1000 0 0 1 0 0 1 0 0 1 0 0 0 0 1\n");
    struct sp_volume *volume = load("c.vtk");
    assert_true(warns(volume, "The colours have numbers up to 1000"));
    sp_volume_unref(&volume);
}

static void cells_that_lie_are_refused(void **state) {
    static const struct {
        const char *name, *text, *place, *reason;
    } files[] = {
        { "e.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 1 5\n4 0 1 2 5\n", "polygons",
          "cell 0 has the point 5; the file has 5 points" },
        { "e.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 1 5\n4 0 1 -2 3\n", "polygons",
          "has the point -2" },
        { "e.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 1 5\n5 0 1 2 3\n", "polygons",
          "cell 0 ends at 6, outside [1, 5]" },
        { "e.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 3 5\n4 0 1 2 3\n", "polygons",
          "cell 1 ends" },
        { "e.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 1 0\n", "polygons",
          "1 cells have no points" },
        { "e.vtk", LEGACY "POINTS 5 float\n" SQUARE "LINES 1 3\n2 0 9\n", "lines", "the point 9" },
        { "e.vtk",
          LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 1 4\n3 0 1 2\nPOLYGONS 1 4\n3 0 1 2\n",
          "POLYGONS", "twice" },
        { "e.vtk",
          LEGACY_5 "POINTS 5 float\n" SQUARE "POLYGONS 3 4\nOFFSETS vtktypeint64\n0 4 3\n"
                   "CONNECTIVITY vtktypeint64\n0 1 2 3\n",
          "polygons", "cell 1 ends at 3, outside [4, 4]" },
        { "e.vtp",
          XML("NumberOfPolys=\"1\"",
              "<Polys><DataArray type=\"Int64\" Name=\"connectivity\">0 1 2</DataArray>"
              "<DataArray type=\"Int64\" Name=\"offsets\">4</DataArray></Polys>"),
          "connectivity", "" },
        { "e.vtp",
          XML("NumberOfPolys=\"1\"",
              "<Polys><DataArray type=\"Int64\" Name=\"connectivity\">0 1 2</DataArray>"
              "<DataArray type=\"Int64\" Name=\"offsets\">99999999999999</DataArray></Polys>"),
          "polygons", "the last cell ends at 1e+14" },
        { "e.vtp", XML("NumberOfPolys=\"1\"", "<Polys/>"), "Polys",
          "without the arrays connectivity and offsets" },
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        write_text(files[i].name, "%s", files[i].text);
        load_error(files[i].name, SP_ERR_FORMAT, files[i].place, files[i].reason);
    }
}

/* No area, a corner that is not finite, edges with three triangles: read as other meshes are. */
static void odd_meshes_are_read(void **state) {
    (void)state;
    write_text("o.vtk", LEGACY "POINTS 5 float\n0 0 0 1 0 0 nan 1 0 0 0 1 0 0 2\n"
                               "POLYGONS 4 16\n3 0 1 2 3 0 1 3 3 0 1 4 3 0 0 0\n");
    struct sp_volume *volume = load("o.vtk");
    assert_int_equal(mesh_of(volume)->shape.count, 4);
    assert_true(warns(volume, "1 of the 4 triangles are not drawn"));
    sp_volume_unref(&volume);
    write_text("o.vtk", LEGACY "POINTS 5 float\n" SQUARE "POLYGONS 2 5\n0 3 1 1 1\n");
    volume = load("o.vtk");
    assert_true(warns(volume, "No triangle of the file has an area"));
    sp_volume_unref(&volume);
}

/* VTK writes such files for a data set without points. */
static void files_without_polygons_are_empty(void **state) {
    static const char *const files[][2] = {
        { "n.vtk", LEGACY_5 "POINTS 0 float\n" },
        { "n.vtk", LEGACY "POINTS 0 float\nPOLYGONS 0 0\n" },
        { "n.vtp", "<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"0\" "
                   "NumberOfPolys=\"0\"><Points></Points><Polys><DataArray type=\"Int64\" "
                   "Name=\"connectivity\"></DataArray></Polys></Piece></PolyData></VTKFile>" },
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        write_text(files[i][0], "%s", files[i][1]);
        struct sp_volume *volume = load(files[i][0]);
        assert_int_equal(sp_volume_elements(volume)->shape.count, 0);
        assert_string_equal(sp_volume_info(volume)->warnings[0],
                            "The file has no points, so nothing is drawn.");
        sp_volume_unref(&volume);
    }
    write_text("n.vtp", "<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"1\">"
                        "<Points></Points></Piece></PolyData></VTKFile>");
    load_error("n.vtp", SP_ERR_FORMAT, "Points", "are missing");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(polygons_and_strips_are_triangles),
        cmocka_unit_test(long_strips_keep_their_side),
        cmocka_unit_test(binary_polygons_are_read),
        cmocka_unit_test(normals_and_colors_are_those_of_the_points),
        cmocka_unit_test(lines_are_tubes),
        cmocka_unit_test(what_is_left_out_is_a_warning),
        cmocka_unit_test(colors_that_are_cut_are_a_warning),
        cmocka_unit_test(cells_that_lie_are_refused),
        cmocka_unit_test(odd_meshes_are_read),
        cmocka_unit_test(files_without_polygons_are_empty),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
