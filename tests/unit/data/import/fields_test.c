/* SPDX-License-Identifier: Apache-2.0
 *
 * Files with several fields of scalars: "FILE?field=NAME" reads one of them.
 */
#include <stdio.h>
#include <string.h>

#include "unit/data/import/support.h"

#define POINTS                                                                                     \
    "# vtk DataFile Version 2.0\n\nASCII\n \nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 1\n"
#define ROOT "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\">"
#define IMAGE ROOT "<ImageData><Piece Extent=\"0 1 0 1 0 0\">"
#define ARRAY "<DataArray type=\"UInt8\" Name=\"s\" format=\"ascii\">"
#define REST "</Piece></ImageData></VTKFile>"

static void check_field(const char *source, const char *name, int16_t first,
                        const char *const others[3]) {
    struct sp_volume *volume = load(source);
    const struct sp_volume_info *info = sp_volume_info(volume);
    assert_string_equal(info->value_name, name);
    assert_int_equal(*(const int16_t *)sp_volume_voxels(volume), first);
    assert_true(info->vector_bytes > 0);
    for (int i = 0; i < 3; i++)
        assert_string_equal(info->others[i], others[i]);
    sp_volume_unref(&volume);
}

static void fields_of_legacy_vtk_files(void **state) {
    (void)state;
    static const char file[] =
        POINTS "POINT_DATA 4\nSCALARS a short\nLOOKUP_TABLE default\n1 2 3 4\n"
               "VECTORS v float\n1 2 3 4 5 6 7 8 9 10 11 12\n"
               "SCALARS b short\nLOOKUP_TABLE default\n5 6 7 8\n"
               "FIELD f 2\nc%%20d 1 4 short\n9 9 9 9\nw 3 4 short\n"
               "1 1 1 1 1 1 1 1 1 1 1 1\n%s";
    write_text("f.vtk", file, "");
    check_field("f.vtk", "a", 1, (const char *[]){ "b", "c d", "magnitude" });
    check_field("f.vtk?field=a", "a", 1, (const char *[]){ "b", "c d", "magnitude" });
    check_field("f.vtk?field=b", "b", 5, (const char *[]){ "a", "c d", "magnitude" });
    check_field("f.vtk?field=c d", "c d", 9, (const char *[]){ "a", "b", "magnitude" });
    load_error("f.vtk?field=w", SP_ERR_NOT_FOUND, "f.vtk",
               "no field \"w\" of scalars; the file has a, b, c d");
    /* What follows may be anything, once scalars and vectors are found. */
    write_text("f.vtk", file, "SOMETHING else\n");
    check_field("f.vtk", "a", 1, (const char *[]){ "b", "c d", "magnitude" });
}

/* The samples, the vectors and their longest one, and lists of others, of which " " ends each. */
static void check_vectors(const char *source, const char *name, double first, const char *vectors,
                          double longest, const char *others) {
    struct sp_volume *volume = load(source);
    const struct sp_volume_info *info = sp_volume_info(volume);
    char list[512] = "";
    assert_string_equal(info->value_name, name);
    if (info->elements.kind == SP_KIND_GRID && info->type == SP_FLOAT32)
        assert_float_equal(*(const float *)sp_volume_voxels(volume), first, 1e-6);
    if (info->elements.kind == SP_KIND_POINTS)
        assert_float_equal(sp_volume_elements(volume)->values[0], first, 1e-6);
    assert_string_equal(info->vector_name, vectors);
    assert_float_equal(info->longest, longest, 1e-5);
    for (int i = 0; i < SP_OTHER_FIELDS_MAX && info->others[i][0]; i++)
        sprintf(list + strlen(list), "%s,", info->others[i]);
    strcat(list, " ");
    for (int i = 0; i < SP_OTHER_VECTORS_MAX && info->other_vectors[i][0]; i++)
        sprintf(list + strlen(list), "%s,", info->other_vectors[i]);
    assert_string_equal(list, others);
    sp_volume_unref(&volume);
}

static void vectors_are_chosen_and_give_scalars(void **state) {
    (void)state;
    static const char data[] = "POINT_DATA 4\nSCALARS p float\nLOOKUP_TABLE default\n8 2 3 4\n"
                               "VECTORS v float\n1 2 2 0 0 0 0 0 0 0 0 0\n"
                               "VECTORS w float\n0 3 4 0 0 0 0 0 0 0 0 0\n";
    write_text("v.vtk", POINTS "%s", data);
    check_vectors("v.vtk", "p", 8, "v", 3, "magnitude,v x,v y,v z, w,");
    check_vectors("v.vtk?field=magnitude", "magnitude", 3, "v", 3, "p,v x,v y,v z, w,");
    check_vectors("v.vtk?field=v y", "v y", 2, "v", 3, "p,magnitude,v x,v z, w,");
    check_vectors("v.vtk?vectors=w", "p", 8, "w", 5, "magnitude,w x,w y,w z, v,");
    check_vectors("v.vtk?field=w z", "w z", 4, "w", 5, "p,magnitude,w x,w y, v,");
    check_vectors("v.vtk?vectors=w&field=magnitude", "magnitude", 5, "w", 5, "p,w x,w y,w z, v,");
    check_vectors("v.vtk?vectors=v&field=p", "p", 8, "v", 3, "magnitude,v x,v y,v z, w,");
    load_error("v.vtk?vectors=u", SP_ERR_NOT_FOUND, "v.vtk", "\"u\"; the file has v, w");
    load_error("v.vtk?vectors=v&field=w x", SP_ERR_NOT_FOUND, "v.vtk", "no field \"w x\"");
    /* Points have the same fields. */
    write_text("c.vtk",
               "# vtk DataFile Version 2.0\n\nASCII\nDATASET STRUCTURED_GRID\nDIMENSIONS 2 2 1\n"
               "POINTS 4 float\n0 0 0 1 0 0 0 1 0 1 1 0\n%s",
               data);
    check_vectors("c.vtk", "p", 8, "v", 3, "magnitude,v x,v y,v z, w,");
    check_vectors("c.vtk?vectors=w", "p", 8, "w", 5, "magnitude,w x,w y,w z, v,");
    check_vectors("c.vtk?field=w z", "w z", 4, "w", 5, "p,magnitude,w x,w y, v,");
    check_vectors("c.vtk?field=magnitude", "magnitude", 3, "v", 3, "p,v x,v y,v z, w,");
    load_error("c.vtk?vectors=u", SP_ERR_NOT_FOUND, "c.vtk", "\"u\"; the file has v, w");
    write_text("v.vti", "%s",
               IMAGE "<PointData Scalars=\"s\" Vectors=\"v\">" ARRAY "1 2 3 4</DataArray>"
                     "<DataArray type=\"Int8\" Name=\"w\" NumberOfComponents=\"3\">"
                     "0 3 4 0 0 0 0 0 0 0 0 0</DataArray>"
                     "<DataArray type=\"Int8\" Name=\"v\" NumberOfComponents=\"3\">"
                     "1 2 2 0 0 0 0 0 0 0 0 0</DataArray></PointData>" REST);
    check_vectors("v.vti", "s", 1, "v", 3, "magnitude,v x,v y,v z, w,");
    check_vectors("v.vti?vectors=w", "s", 1, "w", 5, "magnitude,w x,w y,w z, v,");
    check_vectors("v.vti?field=w y", "w y", 3, "w", 5, "s,magnitude,w x,w z, v,");
}

static void fields_of_xml_vtk_files(void **state) {
    static const struct {
        const char *source, *name, *values, *others[2];
    } cases[] = {
        { "n.vti", "t", "\5\6\7\10", { "s", "u" } },
        { "n.vti?field=s", "s", "\1\2\3\4", { "t", "u" } },
        { "n.vti?field=u", "u", "\10\10\10\10", { "s", "t" } },
    };
    (void)state;
    write_text("n.vti", "%s",
               IMAGE "<PointData Scalars=\"t\">" ARRAY "1 2 3 4</DataArray>"
                     "<DataArray type=\"UInt8\" Name=\"t\">5 6 7 8</DataArray>"
                     "<DataArray type=\"UInt8\" Name=\"u\">8 8 8 8</DataArray></PointData>" REST);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct sp_volume *volume = load(cases[i].source);
        const struct sp_volume_info *info = sp_volume_info(volume);
        assert_string_equal(info->value_name, cases[i].name);
        assert_memory_equal(sp_volume_voxels(volume), cases[i].values, 4);
        for (int k = 0; k < 2; k++)
            assert_string_equal(info->others[k], cases[i].others[k]);
        sp_volume_unref(&volume);
    }
    load_error("n.vti?field=none", SP_ERR_NOT_FOUND, "n.vti", "the file has t, s, u");
}

static void fields_of_tables(void **state) {
    static const struct {
        const char *source, *name;
        float first;
        const char *others[2];
    } cases[] = {
        { "p.csv", "value", 5, { "heat", "" } },
        { "p.csv?field=heat", "heat", 4, { "value", "" } },
    };
    (void)state;
    write_text("p.csv", "%s", "x,y,z,heat,value\n1,2,3,4,5\n2,3,4,5,6\n3,4,5,6,7\n");
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct sp_volume *volume = load(cases[i].source);
        const struct sp_volume_info *info = sp_volume_info(volume);
        assert_string_equal(info->value_name, cases[i].name);
        assert_float_equal(sp_volume_elements(volume)->values[0], cases[i].first, 0);
        for (int k = 0; k < 2; k++)
            assert_string_equal(info->others[k], cases[i].others[k]);
        sp_volume_unref(&volume);
    }
    load_error("p.csv?field=x2", SP_ERR_NOT_FOUND, "p.csv", "the file has value, heat");
}

static void a_source_may_name_a_field(void **state) {
    (void)state;
    static const struct {
        const char *source;
        size_t path_bytes;
        int level;
        const char *field, *vectors, *series, *as, *unit;
    } cases[] = {
        { "a?field=b.vtk?field=c d", 13, -1, "c d", "", "", "", "" },
        { "a.vtk", 5, -1, "", "", "", "", "" },
        { "demo:phantom?field=x", 20, -1, "", "", "", "", "" },
        { "a.zarr?level=2", 6, 2, "", "", "", "", "" },
        { "a.zarr?level=12&field=c&d=e", 6, 12, "c&d=e", "", "", "", "" },
        { "a.zarr?level=", 13, -1, "", "", "", "", "" },
        { "a.zarr?level=2&x", 16, -1, "", "", "", "", "" },
        { "a.zarr?field=c&level=2", 6, -1, "c&level=2", "", "", "", "" },
        { "b:/a.H5:/c:/d", 7, -1, "/c:/d", "", "", "", "" },
        { "a.vtk:/b", 8, -1, "", "", "", "", "" },
        { "a.vtk?vectors=v w", 5, -1, "", "v w", "", "", "" },
        { "a.vtk?vectors=v&field=p&q", 5, -1, "p&q", "v", "", "", "" },
        { "a.vtk?level=3&vectors=v&field=p", 5, 3, "p", "v", "", "", "" },
        { "a.vtk?level=3&vectors=v", 5, 3, "", "v", "", "", "" },
        { "a?vectors=x.vtk?field=p", 15, -1, "p", "", "", "", "" },
        { "a?field=x.vtk?vectors=v", 13, -1, "", "v", "", "", "" },
        { "a.nii?as=rgb", 5, -1, "", "", "", "rgb", "" },
        { "ct?series=1.2.3&as=time&level=2&field=x", 2, 2, "x", "", "1.2.3", "time", "" },
        { "a.tif?unit=um", 5, -1, "", "", "", "", "um" },
        { "a.tif?unit=um&vectors=v", 5, -1, "", "v", "", "", "um" },
        { "ct?series=CT Head & Neck", 2, -1, "", "", "CT Head & Neck", "", "" },
        { "ct?series=a&b&as=time&field=c&d", 2, -1, "c&d", "", "a&b", "time", "" },
        { "a.tif?unit=um&foo=1", 19, -1, "", "", "", "", "" },
        { "a.tif?as=", 9, -1, "", "", "", "", "" },
        { "a.tif?as=time&as=rgb", 20, -1, "", "", "", "", "" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct sp_source_parts parts = sp_source_split(cases[i].source);
        assert_int_equal(parts.path_bytes, cases[i].path_bytes);
        assert_int_equal(parts.level, cases[i].level);
        assert_string_equal(parts.field, cases[i].field);
        assert_string_equal(parts.vectors, cases[i].vectors);
        assert_string_equal(parts.series, cases[i].series);
        assert_string_equal(parts.as, cases[i].as);
        assert_string_equal(parts.unit, cases[i].unit);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fields_of_legacy_vtk_files),
        cmocka_unit_test(vectors_are_chosen_and_give_scalars),
        cmocka_unit_test(fields_of_xml_vtk_files),
        cmocka_unit_test(fields_of_tables),
        cmocka_unit_test(a_source_may_name_a_field),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
