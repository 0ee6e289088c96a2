/* SPDX-License-Identifier: Apache-2.0
 *
 * PLY files of Gaussians, trained and compressed, and bad files.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "unit/data/import/support.h"

static const struct sp_elements *elements_of(const struct sp_volume *volume, enum sp_kind kind,
                                             uint32_t count) {
    const struct sp_elements *e = sp_volume_elements(volume);
    assert_non_null(e);
    assert_int_equal(e->shape.kind, kind);
    assert_int_equal(e->shape.count, count);
    return e;
}

#define TRAINED                                                                                    \
    "property float x\nproperty float y\nproperty float z\nproperty float f_dc_0\n"                \
    "property float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n"                       \
    "property float scale_0\nproperty float scale_1\nproperty float scale_2\n"                     \
    "property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\n"

/* A turn by 90° around z takes the first scale to y. Harmonics of all degrees. */
static void trained_gaussians_are_converted(void **state) {
    static const unsigned rest[] = { 0, 9, 24, 45 };
    (void)state;
    for (unsigned degree = 0; degree <= 3; degree++) {
        char properties[2048] = "", numbers[1024] = "";
        size_t at = 0, written = 0;
        for (unsigned k = 0; k < rest[degree]; k++) {
            at += (size_t)sprintf(properties + at, "property float f_rest_%u\n", k);
            written += (size_t)sprintf(numbers + written, " %u", 100 + k);
        }
        write_text("g.ply",
                   "ply\nformat ascii 1.0\nelement vertex 2\n" TRAINED "%send_header\n"
                   "1 2 3 4 5 6 0 0.6931471805599453 0 -0.6931471805599453 2 0 0 2 %s\n"
                   "0 0 0 0 0 0 1.0986122886681098 0 0 0 0 0 0 0 %s\n",
                   properties, numbers, numbers);
        struct sp_volume *volume = load("g.ply");
        const struct sp_elements *e = elements_of(volume, SP_KIND_GAUSSIANS, 2);
        assert_int_equal(e->shape.degree, degree);
        static const float expected[2][6] = { { 1, 0, 2, 0, 0, 0.5f }, { 1, 0, 1, 0, 0, 1 } };
        for (int i = 0; i < 12; i++)
            assert_float_equal(e->factors[i / 6][i % 6], expected[i / 6][i % 6], 1e-6);
        assert_float_equal(e->positions[0][1], 2, 0);
        assert_float_equal(e->opacities[0], 0.5, 1e-7);
        assert_float_equal(e->opacities[1], 0.75, 1e-7);
        const unsigned count = (degree + 1) * (degree + 1);
        for (unsigned c = 0; c < 3; c++) {
            assert_float_equal(e->harmonics[c], 4 + c, 0);
            for (unsigned k = 1; k < count; k++) /* in the file, all of red come first */
                assert_float_equal(e->harmonics[3 * (count + k) + c], 100 + c * (count - 1) + k - 1,
                                   0);
        }
        sp_volume_unref(&volume);
    }
}

#define CHUNK                                                                                      \
    "element chunk 1\nproperty float min_x\nproperty float min_y\nproperty float min_z\n"          \
    "property float max_x\nproperty float max_y\nproperty float max_z\n"                           \
    "property float min_scale_x\nproperty float min_scale_y\nproperty float min_scale_z\n"         \
    "property float max_scale_x\nproperty float max_scale_y\nproperty float max_scale_z\n"
#define PACKED                                                                                     \
    "property uint packed_position\nproperty uint packed_rotation\nproperty uint packed_scale\n"   \
    "property uint packed_color\n"
#define RANGES "0 0 0 2047 1023 4094 -1 -1 -1 1 1 1\n"

/* Each quaternion has its largest number in another place, so each turn is about another axis:
 * 512/1023 is almost 0.5, so the other numbers are almost 0. */
static void compressed_gaussians_are_unpacked(void **state) {
    (void)state;
    const uint32_t middle = 512u << 20 | 512u << 10 | 512u;
    const uint32_t position = 1000u << 21 | 300u << 11 | 7u, scale = 2047u << 21 | 0u << 11 | 2047u;
    write_text("c.ply",
               "ply\nformat ascii 1.0\n" CHUNK "element vertex 4\n" PACKED
               "element sh 4\nproperty uchar f_rest_0\nproperty uchar f_rest_1\n"
               "property uchar f_rest_2\nproperty uchar f_rest_3\nproperty uchar f_rest_4\n"
               "property uchar f_rest_5\nproperty uchar f_rest_6\nproperty uchar f_rest_7\n"
               "property uchar f_rest_8\nend_header\n" RANGES "%u %u %u %u\n%u %u %u %u\n"
               "%u %u %u %u\n%u %u %u %u\n0 1 2 3 4 5 6 7 255\n0 0 0 0 0 0 0 0 0\n"
               "0 0 0 0 0 0 0 0 0\n0 0 0 0 0 0 0 0 0\n",
               position, middle, scale, 0xff008033u, position, 1u << 30 | middle, scale, 0u,
               position, 2u << 30 | middle, scale, 0u, position, 3u << 30 | middle, scale, 0u);
    struct sp_volume *volume = load("c.ply");
    const struct sp_elements *e = elements_of(volume, SP_KIND_GAUSSIANS, 4);
    assert_int_equal(e->shape.degree, 1);
    for (int i = 0; i < 4; i++) { /* half turns change nothing but the signs of axes */
        static const double scales[] = { M_E, 1 / M_E, M_E };
        for (int row = 0, k = 0; row < 3; row++)
            for (int column = 0; column <= row; column++, k++)
                assert_float_equal(e->factors[i][k], row == column ? scales[row] : 0, 0.04);
        assert_float_equal(e->positions[i][0], 1000, 1e-3);
        assert_float_equal(e->positions[i][1], 300, 1e-3);
        assert_float_equal(e->positions[i][2], 14, 1e-3);
    }
    assert_float_equal(e->opacities[0], 51 / 255., 1e-7);
    assert_float_equal(e->opacities[1], 0, 0);
    static const double color[] = { 1, 0, 128 / 255. };
    for (int c = 0; c < 3; c++) {
        assert_float_equal(0.5 + 0.28209479177387814 * (double)e->harmonics[c], color[c], 1e-6);
        for (int k = 1; k < 4; k++) {
            int byte = 3 * c + k - 1 == 8 ? 255 : 3 * c + k - 1;
            assert_float_equal(e->harmonics[3 * k + c], byte * 8 / 255. - 4, 1e-6);
        }
    }
    sp_volume_unref(&volume);
}

#define POINT "property float x\nproperty float y\nproperty float z\n"

static void bad_files_are_refused(void **state) {
    static const struct {
        const char *text;
        enum sp_code code;
        const char *place, *reason;
    } files[] = {
        { "ply\n", SP_ERR_FORMAT, "end_header", "is missing" },
        { "ply\nelement vertex 1\n", SP_ERR_FORMAT, "format", "second line" },
        { "ply\nformat binary 1.0\n", SP_ERR_UNSUPPORTED, "format", "it must be ascii" },
        { "ply\nformat\n", SP_ERR_UNSUPPORTED, "format", "it must be ascii" },
        { "ply\nformat ascii 1.0\nproperty float x\n", SP_ERR_FORMAT, "property", "before" },
        { "ply\nformat ascii 1.0\nelement vertex\n", SP_ERR_FORMAT, "vertex", "number of rows" },
        { "ply\nformat ascii 1.0\nelement\n", SP_ERR_FORMAT, "element", "is not a name" },
        { "ply\nformat ascii 1.0\nelement vertex -1\n", SP_ERR_FORMAT, "vertex", "\"-1\"" },
        { "ply\nformat ascii 1.0\nelement vertex 99999999999999\n", SP_ERR_FORMAT, "vertex",
          "rows" },
        { "ply\nformat ascii 1.0\nelement v 1\nelement v 1\n", SP_ERR_FORMAT, "v", "twice" },
        { "ply\nformat ascii 1.0\nelement v 1\nproperty half x\n", SP_ERR_FORMAT, "property",
          "\"half\"" },
        { "ply\nformat ascii 1.0\nelement v 1\nproperty list float int x\n", SP_ERR_FORMAT,
          "property", "length" },
        { "ply\nformat ascii 1.0\nelement v 1\nproperty int x\nproperty int x\n", SP_ERR_FORMAT,
          "x", "twice" },
        { "ply\nformat ascii 1.0\nelements v 1\n", SP_ERR_FORMAT, "byte 21", "keyword" },
        { "ply\nformat ascii 1.0\nelement v 1\nproperty int x\nend_header\n0\n", SP_ERR_UNSUPPORTED,
          "element", "neither Gaussians, points nor a mesh" },
        { "ply\nformat ascii 1.0\nelement vertex 1\nproperty int x\nend_header\n0\n", SP_ERR_FORMAT,
          "vertex", "x, y and z" },
        { "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n0\n",
          SP_ERR_FORMAT, "vertex", "the property x is a list" },
        { "ply\nformat ascii 1.0\nelement vertex 1\nproperty int y\nend_header\n0\n", SP_ERR_FORMAT,
          "vertex", "the property x is missing" },
        { "ply\nformat ascii 1.0\nelement vertex 3\n" POINT "end_header\n1 2 3 4 5 6 7 8\n",
          SP_ERR_FORMAT, "vertex", "cut off or a count is wrong" },
        { "ply\nformat ascii 1.0\nelement vertex 3\n" POINT "end_header\n1 2 3 4 5 6 77777\n",
          SP_ERR_FORMAT, "y", "row 2 of the 3 rows of vertex" },
        { "ply\nformat ascii 1.0\nelement vertex 1\n" POINT "end_header\n1 zwei 3\n", SP_ERR_FORMAT,
          "y", "\"zwei\" is not a number" },
        { "ply\nformat ascii 1.0\nelement vertex 1099511627776\n" POINT "end_header\n1 2 3\n",
          SP_ERR_FORMAT, "vertex", "need at least" },
        { "ply\nformat ascii 1.0\nelement vertex 1\n" POINT
          "property list uchar int l\nend_header\n1 2 3 -1\n",
          SP_ERR_FORMAT, "l", "list of -1 items" },
        { "ply\nformat ascii 1.0\nelement vertex 1\n" POINT
          "property list uchar int l\nend_header\n1 2 3 1e9\n",
          SP_ERR_FORMAT, "l", "list of 1e+09 items" },
        { "ply\nformat binary_big_endian 1.0\nelement vertex 1000000\n" POINT "end_header\n123",
          SP_ERR_FORMAT, "vertex", "need at least 12000000 bytes" },
        { "ply\nformat ascii 1.0\nelement vertex 1\n" TRAINED
          "property float f_rest_0\nend_header\n0 0 0 0 0 0 0 0 0 0 0 0 0 0 0\n",
          SP_ERR_FORMAT, "vertex", "1 properties f_rest_*" },
        { "ply\nformat ascii 1.0\nelement vertex 0\n" POINT "property float f_dc_0\n"
          "property float opacity\nproperty float scale_0\nproperty float rot_0\nend_header\n",
          SP_ERR_FORMAT, "vertex", "property f_dc_1 is missing" },
        { "ply\nformat ascii 1.0\nelement chunk 0\nelement vertex 1\n" PACKED
          "end_header\n0 0 0 0\n",
          SP_ERR_FORMAT, "chunk", "property min_x is missing" },
        { "ply\nformat ascii 1.0\n" CHUNK "element vertex 257\n" PACKED "end_header\n" RANGES,
          SP_ERR_FORMAT, "vertex", "need at least" },
        { "ply\nformat ascii 1.0\n" CHUNK "element vertex 1\n" PACKED "end_header\n" RANGES
          "0 0 -1 0\n",
          SP_ERR_FORMAT, "packed_scale", "-1 in row 0" },
        { "ply\nformat ascii 1.0\n" CHUNK "element vertex 1\n" PACKED
          "element sh 0\nend_header\n" RANGES "0 0 0 0\n",
          SP_ERR_FORMAT, "sh", "0 rows for 1 Gaussians" },
    };
    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        write_text("bad.ply", "%s", files[i].text);
        load_error("bad.ply", files[i].code, files[i].place, files[i].reason);
    }
}

/* 257 Gaussians need two chunks. */
static void chunks_must_suffice(void **state) {
    char header[2048];
    static char rows[12 * 4 + 257 * 16];
    (void)state;
    snprintf(header, sizeof header, "ply\nformat binary_little_endian 1.0\n%selement vertex %d\n%s",
             CHUNK, 257, PACKED "end_header\n");
    write_both("k.ply", header, rows, sizeof rows);
    load_error("k.ply", SP_ERR_FORMAT, "chunk", "1 rows; 257 Gaussians need 2");
    snprintf(header, sizeof header, "ply\nformat binary_little_endian 1.0\n%selement vertex %d\n%s",
             CHUNK, 256, PACKED "end_header\n");
    write_both("k.ply", header, rows, sizeof rows);
    struct sp_volume *volume = load("k.ply");
    elements_of(volume, SP_KIND_GAUSSIANS, 256);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(trained_gaussians_are_converted),
        cmocka_unit_test(compressed_gaussians_are_unpacked),
        cmocka_unit_test(bad_files_are_refused),
        cmocka_unit_test(chunks_must_suffice),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
