/* SPDX-License-Identifier: Apache-2.0
 *
 * Points in text tables.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "unit/data/import/support.h"

/* The points that every table below has: their order in memory is free. */
static void assert_are_the_points(const struct sp_volume *volume, const char *name) {
    static const float expected[3][4] = { { 1, 2, 3, 10 },
                                          { -4.5f, 0, 1e3f, -20 },
                                          { 7, 8, 9, 30 } };
    const struct sp_elements *e = sp_volume_elements(volume);
    assert_int_equal(e->shape.kind, SP_KIND_POINTS);
    assert_int_equal(e->shape.count, 3);
    assert_string_equal(sp_volume_info(volume)->value_name, name);
    for (int i = 0; i < 3; i++) {
        const float *want = expected[e->values[i] < 0 ? 1 : e->values[i] < 20 ? 0 : 2];
        for (int a = 0; a < 3; a++)
            assert_float_equal(e->positions[i][a], want[a], 0);
        assert_float_equal(e->values[i], want[3], 0);
        assert_compare(e->volumes[i], >, 0);
    }
}

static void separators_quotes_and_blanks_are_read(void **state) {
    static const struct {
        const char *text, *name;
    } tables[] = {
        { "x,y,z,value\n1,2,3,10\n-4.5,0,1e3,-20\n7,8,9,30\n", "value" },
        { "x,y,z,value\n1,2,3,10\n-4.5,0,1e3,-20\n7,8,9,30", "value" },
        { "X;Y;Z;heat\r\n1;2;3;10\r\n-4.5;0;1e3;-20\r\n7;8;9;30\r\n", "heat" },
        { "heat\tz\ty\tx\n10\t3\t2\t1\n-20\t1e3\t0\t-4.5\n30\t9\t8\t7\n", "heat" },
        { "\xef\xbb\xbf\"x\",\"y\",\"z\",\"a, \"\"b\"\"\"\n\"1\", 2 ,\t3 ,\"10\"\n-4.5,0,1e3,-20\n"
          "7,8,9,30\n",
          "a, \"b\"" },
        { "\n\n  \nx,y,z,value\n\n1,2,3,10\n \t \n-4.5,0,1e3,-20\r\n\r\n7,8,9,30\n\n", "value" },
        { "id,name,x,y,z,intensity\n1,one,1,2,3,10\n2,,-4.5,0,1e3,-20\n3,\"t;o\",7,8,9,30\n",
          "intensity" },
        { "nx,red,x,y,z,q\n0,9,1,2,3,10\n0,9,-4.5,0,1e3,-20\n0,9,7,8,9,30\n", "q" },
    };
    (void)state;
    for (size_t i = 0; i < sizeof tables / sizeof *tables; i++) {
        write_text("t.csv", "%s", tables[i].text);
        struct sp_volume *volume = load("t.csv");
        assert_are_the_points(volume, tables[i].name);
        sp_volume_unref(&volume);
    }
}

static void points_at_one_place_are_told(void **state) {
    (void)state;
    write_text("o.csv", "x,y,z,heat\n1,2,3,4\nnan,2,3,4\n1,2,3,5\n");
    struct sp_volume *volume = load("o.csv");
    assert_non_null(strstr(sp_volume_info(volume)->warnings[0],
                           "All 2 points are at one place, (1, 2, 3), so that their distances "
                           "give no size; they have a size of 1. Give variance_xx"));
    assert_non_null(strstr(sp_volume_info(volume)->warnings[0], "set the size of the layer."));
    sp_volume_unref(&volume);
    write_text("o.csv", "x,y,z,heat\n1,2,3,4\n1,2,3,4\n1,2,3.5,5\n");
    volume = load("o.csv");
    assert_string_equal(sp_volume_info(volume)->warnings[0], "");
    sp_volume_unref(&volume);
}

static void missing_values_are_not_drawn(void **state) {
    (void)state;
    write_text("m.csv", "x,y,z,heat\n1,2,3,\n1,,3,4\nnan,inf,3,5\n1,2,4,6\n");
    struct sp_volume *volume = load("m.csv");
    assert_int_equal(sp_volume_info(volume)->elements.count, 4);
    assert_int_equal(sp_volume_info(volume)->nonfinite, 1);
    sp_volume_unref(&volume);
    write_text("m.csv", "x,y,z\n1,2,3\n4,5,6\n");
    volume = load("m.csv");
    assert_float_equal(sp_volume_elements(volume)->values[1], 1, 0);
    sp_volume_unref(&volume);
    write_text("m.csv", "x,y,z\n\n");
    volume = load("m.csv");
    assert_int_equal(sp_volume_info(volume)->elements.count, 0);
    sp_volume_unref(&volume);
}

/* The table may give the variance, and the volume of the space around each point. */
static void sizes_may_be_given(void **state) {
#define SIZES "variance_xx,variance_xy,variance_yy,variance_xz,variance_yz,variance_zz"
    (void)state;
    write_text("s.csv", "x,y,z,heat," SIZES "\n0,0,0,1,4,2,2,6,4,14\n1,0,0,2,0,0,0,0,0,-1\n");
    struct sp_volume *volume = load("s.csv");
    const struct sp_elements *e = sp_volume_elements(volume);
    static const float expected[6] = { 2, 1, 1, 3, 1, 2 };
    for (int k = 0; k < 6; k++) {
        assert_float_equal(e->factors[0][k], expected[k], 1e-6);
        assert_float_equal(e->factors[1][k], 0, 0);
    }
    assert_float_equal(e->volumes[0], 4 / (0.7 * 0.7 * 0.7), 1e-5);
    assert_compare(e->volumes[1], >, 0);
    assert_true(isnan(e->values[1]));
    assert_int_equal(sp_volume_info(volume)->nonfinite, 1);
    assert_string_equal(sp_volume_info(volume)->value_name, "heat");
    sp_volume_unref(&volume);
    write_text("s.csv", "x,y,z,heat,volume,name," SIZES "\n0,0,0,1,5,one,4,2,2,6,4,14\n");
    volume = load("s.csv");
    assert_float_equal(sp_volume_elements(volume)->volumes[0], 5, 0);
    sp_volume_unref(&volume);
}

/* Rows: good, singular, zero, indefinite, NaN. With a volume, a singular one is flat. */
static void bad_variances_are_not_drawn(void **state) {
    static const char rows[] = "0,0,0,1,1,0,1,0,0,1\n1,0,0,1,1,0,1,0,0,0\n2,0,0,1,0,0,0,0,0,0\n"
                               "3,0,0,1,1,5,1,0,0,1\n4,0,0,1,1,0,,0,0,1\n";
    (void)state;
    write_text("b.csv", "x,y,z,heat," SIZES "\n%s", rows);
    struct sp_volume *volume = load("b.csv");
    const struct sp_elements *e = sp_volume_elements(volume);
    for (int i = 0; i < 5; i++)
        assert_int_equal(isnan(e->values[i]), i > 0);
    assert_int_equal(sp_volume_info(volume)->nonfinite, 4);
    assert_compare(fabs(sp_volume_info(volume)->element_spacing - 1 / 0.7), <, 1e-3);
    sp_volume_unref(&volume);
    write_text("v.csv", "x,y,z,volume," SIZES "\n%s", rows);
    volume = load("v.csv");
    e = sp_volume_elements(volume);
    for (int i = 0; i < 5; i++)
        assert_int_equal(isnan(e->values[i]), i > 2);
    sp_volume_unref(&volume);
}

static void errors_name_line_and_column(void **state) {
    static const struct {
        const char *text, *place, *reason;
    } tables[] = {
        { "\n", "line 2", "no names of columns" },
        { "1,2,3\n", "line 1", "must name columns x, y and z" },
        { "x,y,q\n", "line 1", "must name columns x, y and z" },
        { "x,y,Heat,z,heat\n1,2,3,4,5\n", "line 1", "\"heat\" is the name of the columns 3 and 5" },
        { "x y z\n1 2 3\n", "line 1", "must name columns x, y and z" },
        { "x,y,z,heat\n1,2,3,4\n\n1,2,3,4a\n", "line 4: column heat", "\"4a\" is not a number" },
        { "x,y,z,heat\n1,,3,4\n1,2.,\"3 3\",4\n", "line 3: column z", "\"3 3\" is not a number" },
        { "x,y,z\n1,2,3\n1,2\n", "line 3", "2 fields instead of 3" },
        { "x,y,z\n1,2,3,4\n", "line 2", "more than 3 fields" },
        { "x,y,z\n1,2,\"3\n", "line 2", "a quote is not closed" },
        { "x,y,z\n1,2,\"3\"4\n", "line 2", "text follows a closing quote" },
        { "x,y,z\n1,2,"
          "0000000000000000000000000000000000000000000000000000000000000000000000000\n",
          "line 2", "longer than 63 bytes" },
    };
    (void)state;
    for (size_t i = 0; i < sizeof tables / sizeof *tables; i++) {
        write_text("bad.csv", "%s", tables[i].text);
        load_error("bad.csv", SP_ERR_FORMAT, tables[i].place, tables[i].reason);
    }
    char header[2048] = "x,y,z";
    for (int i = 0; i < 300; i++)
        strcat(header, ",q");
    write_text("bad.csv", "%s\n", header);
    load_error("bad.csv", SP_ERR_FORMAT, "line 1", "more than 256 columns");
}

/* Progress while rows are counted, before any of them is read. */
struct watch {
    int early;
    double last;
};

static bool watch_progress(void *user, double fraction) {
    struct watch *w = user;
    assert_compare(fraction, >=, w->last);
    w->early += fraction > w->last && fraction <= 0.1;
    w->last = fraction;
    return true;
}

static void counting_rows_reports_progress(void **state) {
    enum { ROWS = 1 << 18 };
    static char text[8 * ROWS];
    size_t n = (size_t)sprintf(text, "x,y,z\n");
    (void)state;
    for (int i = 0; i < ROWS; i++)
        n += (size_t)sprintf(text + n, "%d,%d,0\n", i & 63, i >> 6 & 63);
    write_file("long.csv", text, n);
    struct watch watch = { .early = 0 };
    struct sp_load_options options = importer_options();
    struct sp_error err;
    options.progress = watch_progress;
    options.user = &watch;
    struct sp_volume *volume = sp_volume_load(in_folder("long.csv"), &options, &err);
    assert_non_null(volume);
    assert_int_equal(sp_volume_elements(volume)->shape.count, ROWS);
    assert_compare(watch.early, >=, 3);
    sp_volume_unref(&volume);
}

/* ParaView, numpy, tables with units, and countries that write commas in numbers. */
static void names_and_numbers_of_other_programs_are_read(void **state) {
    (void)state;
    static const struct {
        const char *text, *name, *unit;
    } tables[] = {
        { "\"heat\",\"Points:0\",\"Points:1\",\"Points:2\"\n7,1.5,2,3\n8,4,5,6\n", "heat", "" },
        { "Points_0,Points_1,Points_2,heat\n1.5,2,3,7\n4,5,6,8\n", "heat", "" },
        { "# x,y,z,heat\n1.5,2,3,7\n4,5,6,8\n", "heat", "" },
        { "x [mm],y [mm],z [mm],heat\n1.5,2,3,7\n4,5,6,8\n", "heat", "mm" },
        { "X (um)\tY(um)\tZ (um)\theat\n1.5\t2\t3\t7\n4\t5\t6\t8\n", "heat", "um" },
        { "x [mm],y [cm],z [um],heat\n1.5,2,3000,7\n4,5,6000,8\n", "heat", "mm" },
        { "x [mm],y [hPa],z [mm],heat\n1.5,2,3,7\n4,5,6,8\n", "heat", "" },
        { "x;y;z;heat\n1,5;2,0;3;7,0\n4;5;6;8\n", "heat", "" },
    };
    for (size_t i = 0; i < sizeof tables / sizeof *tables; i++) {
        write_text("p.csv", "%s", tables[i].text);
        struct sp_volume *volume = load("p.csv");
        const struct sp_elements *e = sp_volume_elements(volume);
        assert_string_equal(sp_volume_info(volume)->value_name, tables[i].name);
        assert_string_equal(sp_volume_info(volume)->unit, tables[i].unit);
        assert_int_equal(sp_volume_info(volume)->warnings[0][0] != 0,
                         strstr(tables[i].text, "hPa") != NULL);
        const size_t first = e->positions[0][0] < 2 ? 0 : 1; /* points may change their order */
        assert_float_equal(e->positions[first][0], 1.5, 0);
        assert_float_equal(e->positions[first][2], 3, 0);
        assert_float_equal(e->values[first], 7, 0);
        sp_volume_unref(&volume);
    }
    write_text("p.csv", "longitude,latitude,depth\n1,2,3\n");
    load_error("p.csv", SP_ERR_FORMAT, "p.csv: line 1", "it names longitude, latitude, depth");
    write_text("p.xyz", "0 0 0\n1 0 0\n");
    load_error("p.xyz", SP_ERR_UNSUPPORTED, "p.xyz", "this is text; points are read from .csv");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(separators_quotes_and_blanks_are_read),
        cmocka_unit_test(points_at_one_place_are_told),
        cmocka_unit_test(missing_values_are_not_drawn),
        cmocka_unit_test(sizes_may_be_given),
        cmocka_unit_test(bad_variances_are_not_drawn),
        cmocka_unit_test(errors_name_line_and_column),
        cmocka_unit_test(counting_rows_reports_progress),
        cmocka_unit_test(names_and_numbers_of_other_programs_are_read),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
