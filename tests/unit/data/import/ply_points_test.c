/* SPDX-License-Identifier: Apache-2.0
 *
 * PLY files of points with scalars.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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

/* Points: their place in memory need not be that in the file, so the values
 * tell which is which. */

static void assert_is_grid_of_points(const struct sp_volume *volume, uint32_t count) {
    const struct sp_elements *e = elements_of(volume, SP_KIND_POINTS, count);
    bool seen[64] = { false };
    for (uint32_t i = 0; i < count; i++) {
        uint32_t at = (uint32_t)e->values[i] - 10;
        assert_compare(at, <, count);
        assert_false(seen[at]);
        seen[at] = true;
        assert_float_equal(e->positions[i][0], at, 0);
        assert_float_equal(e->positions[i][1], (double)at - 3, 0);
        assert_float_equal(e->positions[i][2], (double)(at * at % 7), 0);
    }
}

struct number_type {
    const char *name;
    size_t size;
    bool is_float;
};

static const struct number_type types[] = {
    { "char", 1, false },  { "int8", 1, false },   { "uchar", 1, false },  { "uint8", 1, false },
    { "short", 2, false }, { "int16", 2, false },  { "ushort", 2, false }, { "uint16", 2, false },
    { "int", 4, false },   { "int32", 4, false },  { "uint", 4, false },   { "uint32", 4, false },
    { "int64", 8, false }, { "uint64", 8, false }, { "float", 4, true },   { "float32", 4, true },
    { "double", 8, true }, { "float64", 8, true },
};
enum { TYPES = sizeof types / sizeof *types };

/* Appends a number in the given form: 0 = words, 1 = little endian, 2 = big
 * endian. */
static size_t put(char *out, int form, const struct number_type *type, int value) {
    if (form == 0)
        return (size_t)sprintf(out, "%d ", value);
    int64_t whole = value;
    float f = (float)value;
    double d = value;
    int64_t number = 0;
    memcpy(&number,
           !type->is_float   ? (void *)&whole
           : type->size == 4 ? (void *)&f
                             : (void *)&d,
           type->size);
    if (form == 2)
        import_swap(&number, type->size, 1);
    memcpy(out, &number, type->size);
    return type->size;
}

/* The position is of signed types, each in turn; lists and another element
 * stand between. */
static void every_type_and_order_is_read(void **state) {
    static const char *const forms[] = { "ascii", "binary_little_endian", "binary_big_endian" };
    enum { COUNT = 20 };
    (void)state;
    for (int form = 0; form < 3; form++)
        for (int t = 0; t < TYPES; t++) {
            const struct number_type *value = &types[t], *whole = &types[8], *list = &types[2];
            char file[8192];
            size_t at = (size_t)sprintf(
                file,
                "ply\nformat %s 1.0\ncomment made by hand\nelement other 2\n"
                "property list uchar int numbers\nproperty int x\nelement vertex %d\n"
                "property uchar red\nproperty int z\nproperty list uchar int "
                "numbers\n"
                "property int y\nproperty %s value\nproperty int x\nelement face 0\n"
                "property list uchar int vertex_indices\nend_header\n",
                forms[form], COUNT, value->name);
            for (int i = 0; i < 2; i++) {
                at += put(file + at, form, list, 2 * i);
                for (int k = 0; k < 2 * i; k++)
                    at += put(file + at, form, whole, 99);
                at += put(file + at, form, whole, 55);
            }
            for (int i = 0; i < COUNT; i++) {
                at += put(file + at, form, list, 77);
                at += put(file + at, form, whole, i * i % 7);
                at += put(file + at, form, list, i % 3);
                for (int k = 0; k < i % 3; k++)
                    at += put(file + at, form, whole, -1);
                at += put(file + at, form, whole, i - 3);
                at += put(file + at, form, value, i + 10);
                at += put(file + at, form, whole, i);
            }
            write_file("p.ply", file, at);
            struct sp_volume *volume = load("p.ply");
            assert_is_grid_of_points(volume, COUNT);
            assert_string_equal(sp_volume_info(volume)->value_name, "value");
            sp_volume_unref(&volume);
        }
}

static void the_scalar_is_the_best_property(void **state) {
    static const struct {
        const char *properties, *name;
        float value;
    } files[] = {
        { "property float q\nproperty float p\n", "q", 4 },
        { "property float q\nproperty float value\n", "value", 5 },
        { "property float q\nproperty float intensity\n", "intensity", 5 },
        { "property uchar red\nproperty float nx\n", "", 1 },
        { "property uchar alpha\nproperty double scalar_Depth\n", "scalar_Depth", 5 },
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        write_text("s.ply",
                   "ply\r\nformat ascii 1.0\r\nelement vertex 1\r\nproperty float x\r\n"
                   "property float y\nproperty float z\n%send_header\n1 2 3 4 5\n",
                   files[i].properties);
        struct sp_volume *volume = load("s.ply");
        const struct sp_elements *e = elements_of(volume, SP_KIND_POINTS, 1);
        assert_float_equal(e->values[0], files[i].value, 0);
        assert_string_equal(sp_volume_info(volume)->value_name, files[i].name);
        sp_volume_unref(&volume);
    }
}

static void numbers_need_not_be_finite(void **state) {
    (void)state;
    write_text("n.ply", "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n"
                        "property float y\nproperty float z\nproperty float value\nend_header\n"
                        "nan 0 0 1\n0 0 0 inf\n1e300 0 0 2\n1 1 1 3\n");
    struct sp_volume *volume = load("n.ply");
    elements_of(volume, SP_KIND_POINTS, 4);
    assert_int_equal(sp_volume_info(volume)->nonfinite, 1);
    sp_volume_unref(&volume);
}

static void no_points_are_a_volume(void **state) {
    (void)state;
    write_text("e.ply", "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\n"
                        "property float y\nproperty float z\nend_header\n");
    struct sp_volume *volume = load("e.ply");
    elements_of(volume, SP_KIND_POINTS, 0);
    sp_volume_unref(&volume);
    write_text("cloud.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                            "property float y\nproperty float z\nelement face 0\n"
                            "property list uchar int vertex_indices\nend_header\n1 2 3\n");
    volume = load("cloud.ply");
    elements_of(volume, SP_KIND_POINTS, 1);
    assert_string_equal(
        sp_volume_info(volume)->warnings[0],
        "The file declares a mesh with no faces; its vertices are drawn as points.");
    sp_volume_unref(&volume);
}

/* Colours of each point follow from its position, because the order may change. */
static void check_colors(const char *source, uint32_t count) {
    static const double constant = 0.28209479177387814; /* the harmonic of degree 0 */
    struct sp_volume *volume = load(source);
    const struct sp_elements *e = elements_of(volume, SP_KIND_GAUSSIANS, count);
    assert_int_equal(e->shape.degree, 0);
    assert_string_equal(sp_volume_info(volume)->value_name, "colors");
    for (uint32_t i = 0; i < count; i++) {
        const double expected[3] = { (double)e->positions[i][0] * 51 / 255, 0.2, 1 };
        assert_float_equal(e->opacities[i], 1, 0);
        assert_true(e->factors[i][0] > 0);
        for (int a = 0; a < 3; a++)
            assert_float_equal((double)e->harmonics[3 * i + (uint32_t)a] * constant + 0.5,
                               expected[a], 1e-6);
    }
    sp_volume_unref(&volume);
}

static void points_without_a_scalar_keep_their_colors(void **state) {
    (void)state;
    static const struct {
        const char *type, *names[3], *rest;
        double full;
    } cases[] = {
        { "uchar", { "red", "green", "blue" }, "", 255 },
        { "float", { "r", "g", "b" }, "", 1 },
        { "ushort", { "diffuse_red", "diffuse_green", "diffuse_blue" }, "", 65535 },
        { "float", { "red", "green", "blue" }, "property float value\n", 255 },
    };
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        char text[2048];
        int n = sprintf(text, "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\n"
                              "property float y\nproperty float z\n");
        for (int a = 0; a < 3; a++)
            n += sprintf(text + n, "property %s %s\n", cases[c].type, cases[c].names[a]);
        n += sprintf(text + n, "%send_header\n", cases[c].rest);
        for (int i = 0; i < 6; i++)
            n += sprintf(text + n, "%d %d 0 %g %g %g%s\n", i, i * i, i * 0.2 * cases[c].full,
                         0.2 * cases[c].full, cases[c].full, *cases[c].rest ? " 7" : "");
        write_file("colors.ply", text, (size_t)n);
        if (*cases[c].rest) {
            struct sp_volume *volume = load("colors.ply");
            elements_of(volume, SP_KIND_POINTS, 6);
            assert_string_equal(sp_volume_info(volume)->value_name, "value");
            assert_string_equal(sp_volume_info(volume)->others[0], "colors");
            sp_volume_unref(&volume);
        }
        check_colors(*cases[c].rest ? "colors.ply?field=colors" : "colors.ply", 6);
    }
    static const char csv[] = "x;y;z;R;G;B\n0;0;0;0;51;255\n1;2;0;51;51;255\n5;1;1;255;51;255\n";
    write_file("colors.csv", csv, sizeof csv - 1);
    check_colors("colors.csv", 3);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_without_a_scalar_keep_their_colors),
        cmocka_unit_test(every_type_and_order_is_read),
        cmocka_unit_test(the_scalar_is_the_best_property),
        cmocka_unit_test(numbers_need_not_be_finite),
        cmocka_unit_test(no_points_are_a_volume),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
