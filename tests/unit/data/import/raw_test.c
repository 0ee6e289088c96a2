/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

enum { COUNT = 60 };

static void every_type_byte_order_and_encoding_is_read(void **state) {
    (void)state;
    for (int t = 0; t < SP_TYPE_COUNT; t++)
        for (int variant = 0; variant < 4; variant++) {
            bool big = variant & 1, packed = variant & 2;
            enum sp_type type = (enum sp_type)t;
            double samples[COUNT];
            size_t size = COUNT * sp_type_size(type);
            make_ramp(type, COUNT, samples);
            if (big)
                import_swap(samples, sp_type_size(type), COUNT);
            if (packed) {
                void *bytes = gzip(samples, size, &size);
                write_file("v.bin", bytes, size);
                free(bytes);
            } else {
                write_file("v.bin", samples, size);
            }
            write_text("v.json",
                       "{\"dims\": [5, 4, 3], \"type\": \"%s\", \"endian\": \"%s\", \"file\": "
                       "\"v.bin\"%s}",
                       sp_type_name(type), big ? "big" : "little",
                       packed ? ", \"encoding\": \"gzip\"" : "");
            struct sp_volume *volume = load("v.json");
            assert_int_equal(sp_volume_info(volume)->type, type);
            assert_int_equal(sp_volume_info(volume)->grid.dims[1], 4);
            assert_compare(sp_volume_info(volume)->grid.spacing[1], ==, 1);
            assert_is_ramp(volume, COUNT);
            sp_volume_unref(&volume);
        }
}

static void geometry_equals_that_of_the_sidecar(void **state) {
    (void)state;
    uint8_t samples[7 + COUNT + 5] = { 0 };
    make_ramp(SP_UINT8, COUNT, samples + 7);
    write_file("v.bin", samples, sizeof samples);
    write_text(
        "v.json",
        "{\"dims\": [5, 4, 3], \"type\": \"uint8\", \"file\": \"v.bin\", \"offset\": 7,\n"
        " \"spacing\": [0.5, 1, 4], \"origin\": [-1, 2e2, 0.25], \"unit\": \"mm\",\n"
        " \"value_unit\": \"HU\", \"direction\": [[0, 1, 0], [-0.7071, 0, 0.7071], [0, 0, 1]]}\n");
    struct sp_volume *volume = load("v.json");
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    assert_compare(grid->spacing[0], ==, 0.5);
    assert_compare(grid->spacing[1], ==, 1);
    assert_compare(grid->spacing[2], ==, 4);
    assert_compare(grid->origin[0], ==, -1);
    assert_compare(grid->origin[1], ==, 200);
    assert_compare(grid->origin[2], ==, 0.25);
    /* The columns of the matrix are the axes. Rounded directions are normalized. */
    assert_compare(grid->direction[1][0], ==, 1);
    assert_compare(grid->direction[0][0], ==, 0);
    assert_compare(fabs(grid->direction[0][1] + sqrt(0.5)), <, 1e-15);
    assert_compare(fabs(grid->direction[2][1] - sqrt(0.5)), <, 1e-15);
    assert_compare(grid->direction[2][2], ==, 1);
    assert_string_equal(sp_volume_info(volume)->unit, "mm");
    assert_string_equal(sp_volume_info(volume)->value_unit, "HU");
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
}

static void axes_may_be_rectilinear(void **state) {
    (void)state;
    uint8_t samples[COUNT];
    make_ramp(SP_UINT8, COUNT, samples);
    write_file("v.bin", samples, COUNT);
    write_text("v.json", "{\"dims\": [5, 4, 3], \"type\": \"uint8\", \"file\": \"v.bin\",\n"
                         " \"spacing\": [9, 2, 9], \"origin\": [10, 20, 30],\n"
                         " \"coordinates\": [[-1, 0, 2, 4.5, 7], null, [8, 7.5, 5]],\n"
                         " \"direction\": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]}\n");
    struct sp_volume *volume = load("v.json");
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    static const double x[] = { 0, 1, 3, 5.5, 8 }, z[] = { 0, 0.5, 3 };
    assert_memory_equal(grid->coordinates[0], x, sizeof x);
    assert_null(grid->coordinates[1]);
    assert_memory_equal(grid->coordinates[2], z, sizeof z); /* falling coordinates are reversed */
    assert_compare(grid->spacing[0], ==, 2);
    assert_compare(grid->spacing[1], ==, 2);
    assert_compare(grid->spacing[2], ==, 1.5);
    assert_compare(grid->direction[1][0], ==, 1);
    assert_compare(grid->direction[2][2], ==, -1);
    assert_false(signbit(grid->direction[0][2]));
    assert_false(signbit(grid->direction[1][2]));
    assert_compare(grid->origin[0], ==, 10);
    assert_compare(grid->origin[1], ==, 19);
    assert_compare(grid->origin[2], ==, 38);
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
    /* A single sample has a position, but no distance to a neighbour. */
    write_text("v.json", "{\"dims\": [60, 1, 1], \"type\": \"uint8\", \"file\": \"v.bin\","
                         " \"coordinates\": [null, [-3], null]}");
    volume = load("v.json");
    grid = &sp_volume_info(volume)->grid;
    assert_null(grid->coordinates[1]);
    assert_compare(grid->origin[1], ==, -3);
    assert_compare(grid->spacing[1], ==, 1);
    sp_volume_unref(&volume);
}

#define SPACED "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"space\": "

static void the_space_of_a_patient_is_read(void **state) {
    (void)state;
    static const char *const spaces[][2] = {
        { "LPS", "LPS" }, { "RAS", "RAS" }, { "PSL", "PSL" }, { "SPL", "SAL" }, { "LAS", "LPS" }
    };
    uint8_t samples[COUNT];
    make_ramp(SP_UINT8, COUNT, samples);
    write_file("s.bin", samples, COUNT);
    for (size_t i = 0; i < sizeof spaces / sizeof spaces[0]; i++) {
        write_text("v.json", SPACED "\"%s\", \"origin\": [1, 2, 0]}", spaces[i][0]);
        struct sp_volume *volume = load("v.json");
        assert_string_equal(sp_volume_info(volume)->anatomy, spaces[i][1]);
        const struct sp_grid *grid = &sp_volume_info(volume)->grid;
        bool is_mirrored = strcmp(spaces[i][0], spaces[i][1]) != 0;
        assert_compare(grid->direction[1][1], ==, is_mirrored ? -1 : 1);
        assert_compare(grid->origin[1], ==, is_mirrored ? -2 : 2);
        assert_compare(grid->origin[0], ==, 1);
        assert_false(signbit(grid->direction[1][0]));
        sp_volume_unref(&volume);
    }
    write_text("v.json", "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\"}");
    struct sp_volume *volume = load("v.json");
    assert_string_equal(sp_volume_info(volume)->anatomy, "");
    sp_volume_unref(&volume);
}

#define GRADED "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"coordinates\": "

static void three_components_are_vectors(void **state) {
    (void)state;
    float values[3 * 6];
    make_ramp(SP_FLOAT32, 18, values);
    write_file("v.bin", values, sizeof values);
    static const char text[] =
        "{\"dims\": [3, 2, 1], \"type\": \"float32\", \"endian\": \"little\", "
        "\"file\": \"v.bin\", \"components\": %d%s}";
    write_text("v.json", text, 3, "");
    struct sp_volume *volume = load("v.json");
    assert_are_vectors(volume, SP_FLOAT32, false);
    assert_string_equal(sp_volume_info(volume)->value_name, "magnitude");
    sp_volume_unref(&volume);
    /* In a left-handed space of a patient the vectors are mirrored with the grid. */
    write_text("v.json", text, 3, ", \"space\": \"LAS\"");
    volume = load("v.json");
    for (int i = 0; i < 18; i++)
        assert_compare(sp_volume_vectors(volume)[i / 3][i % 3], ==,
                       i % 3 == 1 ? -values[i] : values[i]);
    sp_volume_unref(&volume);

    write_text("v.json", text, 2, "");
    load_error("v.json", SP_ERR_FORMAT, "/components", "must be 1, or 3 for vectors");
    write_text("v.json", text, 1, "");
    load_error("v.json", SP_ERR_FORMAT, "v.bin: byte 24: dims", "has 48 more");
    write_file("v.bin", values, sizeof values - 1);
    write_text("v.json", text, 3, "");
    load_error("v.json", SP_ERR_FORMAT, "dims", "need 72 bytes, the file has 71");
}

static void errors_explain_hostile_sidecars(void **state) {
    (void)state;
    static const struct {
        const char *text;
        enum sp_code code;
        const char *place, *message;
    } cases[] = {
        { "{", SP_ERR_FORMAT, "h.json: byte 1", "line 1" },
        { "{} {}", SP_ERR_FORMAT, "h.json: byte 4", "more text follows the end" },
        { "[1]", SP_ERR_FORMAT, "h.json: byte 0", "must be a JSON object" },
        { "{\"dims\": [1,1,1], \"dims\": [1,1,1]}", SP_ERR_FORMAT, "byte", "duplicate" },
        { "{}", SP_ERR_FORMAT, "h.json: /dims", "is missing" },
        { "{\"dims\": 5}", SP_ERR_FORMAT, "/dims", "three whole numbers" },
        { "{\"dims\": [5, 4]}", SP_ERR_FORMAT, "/dims", "three whole numbers" },
        { "{\"dims\": [5, 4, 0]}", SP_ERR_FORMAT, "/dims", "element 2" },
        { "{\"dims\": [5, -4, 3]}", SP_ERR_FORMAT, "/dims", "element 1" },
        { "{\"dims\": [5.0, 4, 3]}", SP_ERR_FORMAT, "/dims", "element 0" },
        { "{\"dims\": [65537, 4, 3]}", SP_ERR_FORMAT, "/dims", "[1, 65536]" },
        { "{\"dims\": [99999999999999999999, 4, 3]}", SP_ERR_FORMAT, "byte",
          "the number is too large" },
        { "{\"dims\": [5,4,3], \"type\": \"uint24\"}", SP_ERR_FORMAT, "/type", "float64" },
        { "{\"dims\": [5,4,3], \"type\": 8}", SP_ERR_FORMAT, "/type", "must be one of" },
        { "{\"dims\": [5,4,3]}", SP_ERR_FORMAT, "/type", "is missing" },
        { "{\"dims\": [5,4,3], \"type\": \"int16\"}", SP_ERR_FORMAT, "/endian", "little, big" },
        { "{\"dims\": [5,4,3], \"type\": \"int16\", \"endian\": \"BIG\"}", SP_ERR_FORMAT, "/endian",
          "little, big" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\"}", SP_ERR_FORMAT, "/file", "is missing" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"\"}", SP_ERR_FORMAT, "/file",
          "name of the file" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"no.bin\"}", SP_ERR_NOT_FOUND,
          "no.bin", "no such file" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"/etc/passwd\"}", SP_ERR_DENIED,
          "/etc/passwd", "lies outside of /" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \".\"}", SP_ERR_DENIED, ".",
          "is a folder, not a regular file" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"offset\": -1}",
          SP_ERR_FORMAT, "/offset", "0 or more" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"offset\": 1}",
          SP_ERR_FORMAT, "s.bin: byte 0: dims", "need 60 bytes, the file has 59" },
        { "{\"dims\": [5,4,4], \"type\": \"uint8\", \"file\": \"s.bin\"}", SP_ERR_FORMAT,
          "s.bin: byte 0: dims", "need 80 bytes, the file has 60" },
        { "{\"dims\": [5,4,2], \"type\": \"uint8\", \"file\": \"s.bin\"}", SP_ERR_FORMAT,
          "s.bin: byte 40: dims", "need 40 bytes, the file has 20 more" },
        { "{\"dims\": [65536,65536,65536], \"type\": \"uint8\", \"file\": \"s.bin\"}",
          SP_ERR_FORMAT, "h.json: /dims", "voxels" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"spacing\": [1,1,-1]}",
          SP_ERR_FORMAT, "h.json: /spacing", "spacing[2]" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"origin\": [0,0,1e15]}",
          SP_ERR_FORMAT, "h.json: /origin", "origin[2] is 1e+15, more than 2^40" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"spacing\": [1,null,1]}",
          SP_ERR_FORMAT, "/spacing", "element 1 must be a number" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"spacing\": [1,NaN,1]}",
          SP_ERR_FORMAT, "byte", "not valid JSON; a quote" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"origin\": [1e999,0,0]}",
          SP_ERR_FORMAT, "byte", "the number is too large" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\",\"direction\": [1,0,0]}",
          SP_ERR_FORMAT, "/direction/0", "three numbers" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\","
          "\"direction\": [[2,0,0],[0,1,0],[0,0,1]]}",
          SP_ERR_FORMAT, "/direction/0", "length 2" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\","
          "\"direction\": [[1,0,0],[1,0,0],[0,0,1]]}",
          SP_ERR_FORMAT, "h.json: /direction", "singular" },
        { SPACED "3}", SP_ERR_FORMAT, "h.json: /space", "three letters" },
        { SPACED "\"\"}", SP_ERR_FORMAT, "/space", "three letters" },
        { SPACED "\"LP\"}", SP_ERR_FORMAT, "/space", "three letters" },
        { SPACED "\"LPSX\"}", SP_ERR_FORMAT, "/space", "three letters" },
        { SPACED "\"LRS\"}", SP_ERR_FORMAT, "/space", "three letters" },
        { SPACED "\"lps\"}", SP_ERR_FORMAT, "/space", "such as LPS" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"unit\": 3}",
          SP_ERR_FORMAT, "/unit", "string" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"unit\": "
          "\"a unit that is much too long to be one\"}",
          SP_ERR_FORMAT, "/unit", "31 bytes" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"colour\": 1}",
          SP_ERR_FORMAT, "/colour", "is not a member" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\", \"encoding\": \"lzma\"}",
          SP_ERR_FORMAT, "/encoding", "raw, gzip" },
        { "{\"dims\": [5,4,3], \"type\": \"uint8\", \"file\": \"s.bin\\u0000x\"}", SP_ERR_FORMAT,
          "byte", "\\u0000" },
        { GRADED "5}", SP_ERR_FORMAT, "h.json: /coordinates", "three arrays" },
        { GRADED "[null, null]}", SP_ERR_FORMAT, "/coordinates", "three arrays" },
        { GRADED "[null, [1, 2, 3], null]}", SP_ERR_FORMAT, "h.json: /coordinates/1", "4 numbers" },
        { GRADED "[null, null, 2]}", SP_ERR_FORMAT, "/coordinates/2", "null or 3 numbers" },
        { GRADED "[null, null, [0, null, 2]]}", SP_ERR_FORMAT, "/coordinates/2",
          "element 1 must be a number" },
        { GRADED "[null, null, [0, 0, 2]]}", SP_ERR_FORMAT, "h.json: /coordinates",
          "coordinates[2]: the step from" },
        { GRADED "[null, null, [0, 3, 2]]}", SP_ERR_FORMAT, "/coordinates", "from element 1 (3)" },
        { GRADED "[null, null, [1, 1, 1]]}", SP_ERR_FORMAT, "/coordinates", "from element 0 (0)" },
        { GRADED "[null, null, [0, 1, 1e7]]}", SP_ERR_FORMAT, "/coordinates", "a factor of 1e+06" },
        { GRADED "[null, null, [1e300, 1e301, 1e302]]}", SP_ERR_FORMAT, "/coordinates", "1e12" },
        { GRADED "[null, null, [1e17, 1.1e17, 1.2e17]]}", SP_ERR_FORMAT, "/coordinates", "1e12" },
        { GRADED "[null, null, [1e14, 1.0000000001e14, 1.0000000002e14]]}", SP_ERR_FORMAT,
          "h.json: /origin", "more than 2^40" },
    };
    uint8_t samples[COUNT];
    make_ramp(SP_UINT8, COUNT, samples);
    write_file("s.bin", samples, COUNT);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_text("h.json", "%s", cases[i].text);
        load_error("h.json", cases[i].code, cases[i].place, cases[i].message);
    }
    size_t n = (1 << 20) + 1;
    char *longer = malloc(n);
    memset(longer, ' ', n);
    longer[0] = '{';
    write_file("h.json", longer, n);
    load_error("h.json", SP_ERR_FORMAT, "h.json: byte 1048576", "has at most 1048576 bytes");
    /* Nested deeper than the parser permits. */
    memset(longer, '[', n - 1);
    memcpy(longer, "{\"dims\":", 8);
    write_file("h.json", longer, n - 1);
    load_error("h.json", SP_ERR_FORMAT, "h.json: byte", "nested too deeply");
    free(longer);
}

static void ignore_report(void *user, uint64_t bytes_done) {
    (void)user, (void)bytes_done;
}

/* The end of a file that another program cuts after its size was checked is no hole. */
static void a_file_that_is_cut_meanwhile_is_an_error(void **state) {
    (void)state;
    uint8_t samples[COUNT], out[COUNT] = { 0 };
    struct import_file file = { .fd = memfd_create("samples", MFD_CLOEXEC),
                                .size = COUNT,
                                .title = "cut" };
    const struct import_samples all = {
        .file = &file, .number = { IMPORT_UNSIGNED, 1 }, .bytes = COUNT, .field = "dims"
    };
    const struct import_progress progress = { .report = ignore_report };
    struct sp_error err;
    make_ramp(SP_UINT8, COUNT, samples);
    assert_int_equal(write(file.fd, samples, COUNT), COUNT);
    assert_true(import_samples_check(&all, &err));
    assert_true(import_samples_read(&all, out, NULL, &progress, &err));
    assert_memory_equal(out, samples, COUNT);
    assert_int_equal(ftruncate(file.fd, COUNT / 2), 0);
    assert_false(import_samples_read(&all, out, NULL, &progress, &err));
    assert_int_equal(err.code, SP_ERR_FORMAT);
    assert_non_null(strstr(err.text, "the samples need 60 bytes"));
    close(file.fd);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_byte_order_and_encoding_is_read),
        cmocka_unit_test(geometry_equals_that_of_the_sidecar),
        cmocka_unit_test(axes_may_be_rectilinear),
        cmocka_unit_test(the_space_of_a_patient_is_read),
        cmocka_unit_test(three_components_are_vectors),
        cmocka_unit_test(errors_explain_hostile_sidecars),
        cmocka_unit_test(a_file_that_is_cut_meanwhile_is_an_error),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
