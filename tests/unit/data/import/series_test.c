/* SPDX-License-Identifier: Apache-2.0
 *
 * Time series: several steps in one file, and files that are steps.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "data/import/numbered.h"
#include "unit/data/import/support.h"

enum { NX = 4, NY = 3, NZ = 2, COUNT = NX * NY * NZ, STEPS = 3 };

/* Sample i of a step. */
static uint8_t sample(uint32_t step, size_t i) {
    return (uint8_t)(50 * step + i);
}

/* Writes the samples of all steps, one step after the other or, if they alternate, one sample after
 * the other. */
static void make_steps(bool alternate, uint8_t out[STEPS * COUNT]) {
    for (uint32_t step = 0; step < STEPS; step++)
        for (size_t i = 0; i < COUNT; i++)
            out[alternate ? i * STEPS + step : step * COUNT + i] = sample(step, i);
}

static void check_samples(const struct sp_volume *volume, uint32_t number) {
    const uint8_t *samples = sp_volume_voxels(volume);
    assert_int_equal(sp_volume_info(volume)->type, SP_UINT8);
    for (size_t i = 0; i < COUNT; i++)
        assert_int_equal(samples[i], sample(number, i));
}

/* Every step has its samples and its time, `first` + `interval`·step; interval 0 = unknown. */
static void check_steps(const char *name, double first, double interval, const char *unit) {
    for (uint32_t step = 0; step < STEPS; step++) {
        struct sp_volume *volume = load_step(name, step);
        const struct sp_steps *steps = &sp_volume_info(volume)->steps;
        assert_int_equal(steps->count, STEPS);
        assert_int_equal(steps->index, step);
        assert_string_equal(steps->unit, unit);
        assert_int_equal(steps->times != NULL, interval > 0);
        for (uint32_t i = 0; steps->times && i < STEPS; i++)
            assert_compare(fabs(steps->times[i] - (first + i * interval)), <, 1e-9);
        check_samples(volume, step);
        sp_volume_unref(&volume);
    }
    struct sp_load_options options = importer_options();
    struct sp_error err = { .text = "" };
    options.step = STEPS;
    options.has_step = true;
    assert_null(sp_volume_load(in_folder(name), &options, &err));
    assert_int_equal(err.code, SP_ERR_NOT_FOUND);
    assert_non_null(strstr(err.text, "there is no time step 3; the last one is 2"));
}

static void write_metaimage(const char *name, const char *lines, const void *samples, size_t size) {
    char header[256];
    snprintf(header, sizeof header,
             "ObjectType = Image\n%sElementType = MET_UCHAR\n"
             "ElementDataFile = LOCAL\n",
             lines);
    write_both(name, header, samples, size);
}

static void a_file_may_have_several_steps(void **state) {
    (void)state;
    uint8_t samples[STEPS * COUNT];
    make_steps(false, samples);
    write_metaimage("a.mha",
                    "NDims = 4\nDimSize = 4 3 2 3\nElementSpacing = 1 1 1 0.5\n"
                    "Offset = 0 0 0 2\n",
                    samples, sizeof samples);
    check_steps("a.mha", 2, 0.5, "");
    /* From the end of the file. */
    write_metaimage("b.mha", "NDims = 4\nDimSize = 4 3 2 3\nHeaderSize = -1\n", samples,
                    sizeof samples);
    check_steps("b.mha", 0, 1, "");
    write_both("c.nrrd",
               "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 4 3 2 3\n"
               "kinds: space space space time\nspacings: 1 1 1 0.25\nunits: \"mm\" \"mm\" \"mm\" "
               "\"ms\"\nencoding: raw\n\n",
               samples, sizeof samples);
    check_steps("c.nrrd", 0, 0.25, "ms");
    write_both("d.nrrd", "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 4 3 2 3\nencoding: raw\n\n",
               samples, sizeof samples);
    check_steps("d.nrrd", 0, 0, "");
    make_steps(true, samples);
    write_both("e.nrrd",
               "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 3 4 3 2\n"
               "space dimension: 3\nspace directions: none (1,0,0) (0,1,0) (0,0,1)\n"
               "kinds: list space space space\nencoding: raw\n\n",
               samples, sizeof samples);
    check_steps("e.nrrd", 0, 0, "");
    /* Bytes beyond the last step are a warning. */
    write_metaimage("f.mha", "NDims = 4\nDimSize = 4 3 2 2\n", samples, sizeof samples);
    load_warns("f.mha", "24 bytes after the samples");
}

static void write_step(const char *name, uint32_t number) {
    uint8_t samples[COUNT];
    for (size_t i = 0; i < COUNT; i++)
        samples[i] = sample(number, i);
    write_metaimage(name, "NDims = 3\nDimSize = 4 3 2\n", samples, sizeof samples);
}

static void numbered_files_are_steps(void **state) {
    (void)state;
    assert_int_equal(mkdir(in_folder("run"), 0700), 0);
    write_step("run/t9.mha", 0);
    write_step("run/t10.mha", 1);
    write_step("run/t0011.mha", 2);
    write_text("run/t.mha", "no number");
    write_text("run/u1.mha", "another name");
    check_steps("run/t*.mha", 0, 0, "");
    load_error("run/x*.mha", SP_ERR_NOT_FOUND, "x*.mha", "no such file with a number");
    load_error("none/x*.mha", SP_ERR_IO, "x*.mha", "cannot list the folder");
    /* A file is one step. A folder gives all files that are numbered like its first file. */
    struct sp_volume *volume = load("run/t10.mha");
    assert_int_equal(sp_volume_info(volume)->steps.count, 1);
    check_samples(volume, 1);
    sp_volume_unref(&volume);
    remove(in_folder("run/t.mha"));
    check_steps("run", 0, 0, "");
    remove(in_folder("run/t0011.mha"));
    write_text("run/t0011.mha", "damaged");
    volume = load_step("run", 1);
    assert_string_equal(sp_volume_info(volume)->name, "run");
    sp_volume_unref(&volume);
    struct sp_load_options options = importer_options();
    struct sp_error err = { .text = "" };
    options.step = 2;
    options.has_step = true;
    assert_null(sp_volume_load(in_folder("run"), &options, &err));
    assert_non_null(strstr(err.place, "t0011.mha"));
}

/* Neither subjects nor channels are steps of a folder; a path with '*' makes them steps. */
static void numbers_of_subjects_are_no_steps(void **state) {
    (void)state;
    assert_int_equal(mkdir(in_folder("bids"), 0700), 0);
    for (uint32_t n = 0; n < STEPS; n++) {
        char name[32];
        snprintf(name, sizeof name, "bids/sub-%u.mha", n);
        write_step(name, n);
    }
    struct sp_volume *volume = load("bids");
    assert_int_equal(sp_volume_info(volume)->steps.count, 1);
    check_samples(volume, 0);
    sp_volume_unref(&volume);
    load_warns("bids", "2 numbered files were left out, such as sub-1.mha");
    check_steps("bids/sub-*.mha", 0, 0, "");
    load_warns("bids/sub-*.mha", "may tell subjects");
    assert_int_equal(mkdir(in_folder("both"), 0700), 0);
    for (uint32_t n = 0; n < 2 * STEPS; n++) {
        char name[32];
        snprintf(name, sizeof name, "both/case%u_t%u.mha", n / STEPS, n % STEPS);
        write_step(name, n);
    }
    check_steps("both", 0, 0, "");
    load_warns("both/case*_t*.mha", "3 numbered files were left out, such as case1_t0.mha");
}

/* A numbered file may have steps of its own. */
static void steps_within_a_numbered_file_are_shown(void **state) {
    (void)state;
    uint8_t samples[STEPS * COUNT];
    make_steps(false, samples);
    assert_int_equal(mkdir(in_folder("func"), 0700), 0);
    write_metaimage("func/run1.mha", "NDims = 4\nDimSize = 4 3 2 3\n", samples, sizeof samples);
    check_steps("func", 0, 1, "");
    write_metaimage("func/run2.mha", "NDims = 4\nDimSize = 4 3 2 3\n", samples, sizeof samples);
    check_steps("func", 0, 1, "");
    load_warns("func", "only run1.mha is shown");
    write_step("tm0.mha", 0);
    write_step("tm1.mha", 1);
    write_step("tm5.mha", 2);
    check_steps("tm*.mha", 0, 0, "");
    load_warns("tm*.mha", "1 gap, such as that from 1 to 5: the time steps");
}

static void lists_of_files_are_steps(void **state) {
    (void)state;
    assert_int_equal(mkdir(in_folder("list"), 0700), 0);
    write_step("list/a.mha", 1);
    write_step("list/b.mha", 0);
    write_step("list/c.mha", 2);
    write_text("one.pvd", "<?xml version=\"1.0\"?><VTKFile type=\"Collection\"><Collection>"
                          "<DataSet timestep=\"0.5\" part=\"0\" file=\"list/a.mha\"/>"
                          "<DataSet timestep=\"0\" file=\"list/b.mha\"/>"
                          "<DataSet timestep=\"1\" file=\"list/c.mha\"/></Collection></VTKFile>");
    check_steps("one.pvd", 0, 0.5, "");
    write_text("list/two.mha.series",
               "{\"file-series-version\": \"1.0\", \"files\": ["
               "{\"name\": \"b.mha\", \"time\": 3}, {\"name\": \"a.mha\", \"time\": 5}, "
               "{\"name\": \"c.mha\", \"time\": 7}]}");
    check_steps("list/two.mha.series", 3, 2, "");
}

static void bad_lists_are_refused(void **state) {
    (void)state;
    static const struct {
        const char *name, *text;
        enum sp_code code;
        const char *error;
    } cases[] = {
        { "x.pvd", "<VTKFile><Collection>", SP_ERR_FORMAT, "line 1: the XML is damaged" },
        { "x.pvd", "<VTKFile/>", SP_ERR_FORMAT, "names no file" },
        { "x.pvd", "<!DOCTYPE a [<!ENTITY b \"c\">]><a/>", SP_ERR_UNSUPPORTED, "document types" },
        { "x.pvd", "<a><DataSet timestep=\"x\" file=\"f\"/></a>", SP_ERR_FORMAT,
          "is not a number" },
        { "x.pvd", "<a><DataSet timestep=\"1\"/></a>", SP_ERR_FORMAT, "has no name" },
        { "x.pvd", "<a><DataSet part=\"1\" file=\"f\"/></a>", SP_ERR_UNSUPPORTED, "several parts" },
        { "x.pvd",
          "<a><DataSet timestep=\"1\" file=\"f\"/><DataSet timestep=\"1\" file=\"g\"/></a>",
          SP_ERR_UNSUPPORTED, "the same time" },
        { "x.pvd", "<a><DataSet file=\"missing.mha\"/></a>", SP_ERR_NOT_FOUND, "" },
        { "x.pvd", "<a><DataSet file=\"../../etc/passwd\"/></a>", SP_ERR_DENIED, "" },
        { "x.pvd", "<a><DataSet file=\"x.pvd\"/></a>", SP_ERR_UNSUPPORTED, "a series of its own" },
        { "x.series", "{", SP_ERR_FORMAT, "line 1" },
        { "x.series", "{\"files\": 3}", SP_ERR_FORMAT, "the list \"files\" is missing" },
        { "x.series", "{\"files\": [{\"name\": 3}]}", SP_ERR_FORMAT, "has no name" },
        { "x.series", "{\"files\": [{\"name\": \"a\", \"time\": \"b\"}]}", SP_ERR_FORMAT,
          "is not a number" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        write_text(cases[i].name, "%s", cases[i].text);
        load_error(cases[i].name, cases[i].code, "", cases[i].error);
    }
}

/* The content of a file counts more than its name. */
static void a_wrong_name_does_not_matter(void **state) {
    (void)state;
    static const char *const names[] = { "a.nii", "a.nrrd", "a.dcm", "a.vti", "a.csv", "a.stl" };
    uint8_t samples[COUNT];
    for (size_t i = 0; i < COUNT; i++)
        samples[i] = sample(0, i);
    for (size_t n = 0; n < sizeof names / sizeof *names; n++) {
        write_metaimage(names[n], "NDims = 3\nDimSize = 4 3 2\n", samples, sizeof samples);
        struct sp_volume *volume = load(names[n]);
        check_samples(volume, 0);
        sp_volume_unref(&volume);
    }
}

static void numbers_in_names_match(void **state) {
    (void)state;
    char pattern[NAME_MAX + 1];
    assert_true(sp_numbered_pattern("Case2_t010.nii", pattern));
    assert_string_equal(pattern, "Case*_t*.nii");
    assert_false(sp_numbered_pattern("head.nii", pattern));
    assert_true(sp_numbered_matches("case*_t*.nii", "Case3_t9.nii"));
    assert_false(sp_numbered_matches("case*_t*.nii", "Case_t9.nii"));
    assert_false(sp_numbered_matches("case*_t*.nii", "Case3_t9.nii.gz"));
    assert_false(sp_numbered_matches("head.nii", "head.nii"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_file_may_have_several_steps),
        cmocka_unit_test(numbered_files_are_steps),
        cmocka_unit_test(numbers_of_subjects_are_no_steps),
        cmocka_unit_test(steps_within_a_numbered_file_are_shown),
        cmocka_unit_test(lists_of_files_are_steps),
        cmocka_unit_test(bad_lists_are_refused),
        cmocka_unit_test(a_wrong_name_does_not_matter),
        cmocka_unit_test(numbers_in_names_match),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
