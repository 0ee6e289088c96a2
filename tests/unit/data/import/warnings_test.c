/* SPDX-License-Identifier: Apache-2.0
 *
 * What readers left out or changed, as sentences in the description of a volume.
 */
#include <stdio.h>
#include <string.h>

#include "data/import/warnings.h"
#include "unit/data/import/support.h"

/* Loads a file with these warnings; NULL ends them. */
static void assert_warns(const char *name, const char *const *texts) {
    struct sp_volume *volume = load(name);
    const struct sp_volume_info *info = sp_volume_info(volume);
    int i = 0;
    for (; texts[i]; i++)
        assert_string_equal(info->warnings[i], texts[i]);
    assert_string_equal(info->warnings[i], "");
    sp_volume_unref(&volume);
}

static void sentences_are_bounded_and_not_repeated(void **state) {
    (void)state;
    struct import_warnings w = { .count = 0 };
    char line[2 * SP_WARNING_BYTES];
    import_warn(NULL, "Nobody reads %d.", 1);
    import_warn(&w, "%d of %d.", 1, 2);
    import_warn(&w, "%d of %d.", 1, 2);
    assert_int_equal(w.count, 1);
    assert_string_equal(w.texts[0], "1 of 2.");
    for (int shift = 0; shift < 2; shift++) { /* the cut is inside of a character once */
        for (size_t i = 0; i < sizeof line - 1; i++)
            line[i] = "é"[(i + (size_t)shift) % 2];
        line[0] = shift ? 'x' : line[0];
        line[sizeof line - 1] = 0;
        import_warn(&w, "%s", line);
        const char *text = w.texts[1 + shift];
        assert_in_range(strlen(text), SP_WARNING_BYTES - 6, SP_WARNING_BYTES - 1);
        assert_string_equal(text + strlen(text) - 5, "é…");
    }
    for (int i = 3; i < 20; i++)
        import_warn(&w, "%d.", i);
    assert_string_equal(w.texts[SP_WARNINGS_MAX - 2], "6.");
    assert_string_equal(w.texts[SP_WARNINGS_MAX - 1], "13 more warnings are not listed.");
}

static void elements_that_are_not_drawn_are_counted(void **state) {
    (void)state;
    write_text("p.csv", "x,y,z,heat\n0,0,0,1\n1,0,0,nan\ninf,0,0,1\n");
    assert_warns("p.csv", (const char *const[]){ "2 of the 3 points are not drawn, because their "
                                                 "position, value or size is not a finite number.",
                                                 NULL });
    write_text("none.csv", "x,y,z\n");
    assert_warns("none.csv",
                 (const char *const[]){ "The file has no points, so nothing is drawn.", NULL });
    write_text("m.ply", "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n"
                        "property float y\nproperty float z\nelement face 2\n"
                        "property list uchar int vertex_indices\nend_header\n"
                        "0 0 0\n1 0 0\n0 1 0\nnan 0 0\n3 0 1 2\n3 0 1 3\n");
    assert_warns("m.ply", (const char *const[]){ "1 of the 2 triangles are not drawn, because the "
                                                 "position of a corner is not a finite number.",
                                                 NULL });
    write_text("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    assert_warns(
        "flat.obj",
        (const char *const[]){ "No triangle of the file has an area, so nothing is drawn.", NULL });
    write_text("fine.csv", "x,y,z,heat\n0,0,0,1\n1,0,0,2\n");
    assert_warns("fine.csv", (const char *const[]){ NULL });
}

/* Light without a bound would hide the image. */
static void gaussians_without_a_finite_colour_are_not_drawn(void **state) {
    (void)state;
    write_text("g.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
                        "property float y\nproperty float z\nproperty float f_dc_0\n"
                        "property float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n"
                        "property float scale_0\nproperty float scale_1\nproperty float scale_2\n"
                        "property float rot_0\nproperty float rot_1\nproperty float rot_2\n"
                        "property float rot_3\nend_header\n0 0 0 1 1 1 0 0 0 0 1 0 0 0\n"
                        "0 0 0 1 inf 1 0 0 0 0 1 0 0 0\n0 0 0 nan 1 1 0 0 0 0 1 0 0 0\n");
    assert_warns("g.ply", (const char *const[]){
                              "2 of the 3 Gaussians are not drawn, because their position, size, "
                              "opacity or colour is not a finite number.",
                              NULL });
}

static void vectors_without_a_direction_are_reported(void **state) {
    (void)state;
    const char *head = "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\n"
                       "DIMENSIONS 2 1 1\nORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA 2\n"
                       "VECTORS wind float\n";
    write_text("still.vtk", "%s0 0 0 nan 1 0\n", head);
    assert_warns(
        "still.vtk",
        (const char *const[]){
            "All vectors of the file are 0 or not finite, so there are no streaks.", NULL });
    write_text("points.vtk", "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 2 int\n"
                             "0 0 0 1 1 1\nPOINT_DATA 2\nVECTORS v float\n0 0 0 0 0 0\n");
    assert_warns(
        "points.vtk",
        (const char *const[]){
            "All vectors of the file are 0 or not finite, so there are no streaks.", NULL });
    write_text("wind.vtk", "%s0 0 0 0 1 0\n", head);
    assert_warns("wind.vtk", (const char *const[]){ NULL });
}

static void nodes_of_folded_cells_are_reported(void **state) {
    (void)state;
    write_text("g.vtk", "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_GRID\n"
                        "DIMENSIONS 3 2 2\nPOINTS 12 float\n"
                        "0 0 0 1 0 0 .5 0 0 0 1 0 1 1 0 .5 1 0 "
                        "0 0 1 1 0 1 .5 0 1 0 1 1 1 1 1 .5 1 1\nPOINT_DATA 12\n"
                        "SCALARS s float\nLOOKUP_TABLE default\n1 2 3 4 5 6 7 8 9 10 11 nan\n"
                        "VECTORS wind float\n1 0 0 1 0 0 1 0 0 1 0 0 1 0 0 1 0 0 1 0 0 1 0 0 "
                        "1 0 0 1 0 0 1 0 0 1 0 0\n");
    assert_warns("g.vtk",
                 (const char *const[]){
                     "4 of the 12 nodes are not drawn, because their cells are flat or turned "
                     "inside out.",
                     NULL });
}

/* Blank space at the end is no row. */
static void rows_that_the_header_does_not_declare_are_reported(void **state) {
    (void)state;
    static const char *const more[] = { "The file goes on after row 1 of \"vertex\", the last one "
                                        "that its header declares; the rest is not read.",
                                        NULL },
                             *const none[] = { NULL };
    static const char properties[] = "element vertex 1\nproperty uchar x\nproperty uchar y\n"
                                     "property uchar z\nelement edge 0\nproperty int i\n"
                                     "end_header\n";
    write_text("one.ply", "ply\nformat ascii 1.0\n%s0 1 2\n \n\n", properties);
    assert_warns("one.ply", none);
    write_text("two.ply", "ply\nformat ascii 1.0\n%s0 1 2\n1 1 2\n", properties);
    assert_warns("two.ply", more);
    write_text("one.ply", "ply\nformat binary_little_endian 1.0\n%sabc", properties);
    assert_warns("one.ply", none);
    write_text("two.ply", "ply\nformat binary_little_endian 1.0\n%sabcd", properties);
    assert_warns("two.ply", more);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sentences_are_bounded_and_not_repeated),
        cmocka_unit_test(elements_that_are_not_drawn_are_counted),
        cmocka_unit_test(gaussians_without_a_finite_colour_are_not_drawn),
        cmocka_unit_test(vectors_without_a_direction_are_reported),
        cmocka_unit_test(nodes_of_folded_cells_are_reported),
        cmocka_unit_test(rows_that_the_header_does_not_declare_are_reported),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
