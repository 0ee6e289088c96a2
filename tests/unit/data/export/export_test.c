/* SPDX-License-Identifier: Apache-2.0
 *
 * Volumes that are written in the formats of other programs, and read again by the importer.
 * tests/formats/convert_part.py compares with independent readers.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "data/export/job.h"
#include "data/import/launch.h"
#include "data/volume/sample.h"
#include "sp/convert.h"
#include "unit/data/export/fixture.h"

enum { COUNT = NX * NY * NZ };

static int count_entries(const char *path) {
    int count = 0;
    DIR *folder = opendir(path);
    assert_non_null(folder);
    for (const struct dirent *entry; (entry = readdir(folder));)
        count += strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0;
    closedir(folder);
    return count;
}

/* Samples that are 0 at the start, and vary elsewhere. */
static int make_samples(void) {
    static uint16_t samples[COUNT];
    for (uint32_t i = 0; i < COUNT; i++)
        samples[i] = (uint16_t)(i < COUNT / 2 ? 0 : i * 37 % 251);
    return memory_file(samples, sizeof samples);
}

static void demos_come_back(void **state) {
    static const struct {
        const char *source, *out;
    } cases[] = {
        { "demo:engine?size=70", "a.nrrd" },     { "demo:turbulence?size=33", "b.nrrd" },
        { "demo:engine?size=70", "a.nii" },      { "demo:turbulence?size=33", "b.nii.gz" },
        { "demo:engine?size=70", "a.ome.zarr" }, { "demo:turbulence?size=33", "b.zarr" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sp_error err;
        const char *out = path_in(state, cases[i].out);
        if (!sp_convert(cases[i].source, out, &options, &err))
            fail_msg("%s: %s", err.place, err.text);
        struct sp_volume *was = sp_volume_load(cases[i].source, &options, &err);
        struct sp_volume *is = sp_volume_load(out, &options, &err);
        if (!was || !is)
            fail_msg("%s: %s", err.place, err.text);
        const struct sp_volume_info *a = sp_volume_info(was), *b = sp_volume_info(is);
        assert_int_equal(a->type, b->type);
        assert_int_equal(a->voxel_bytes, b->voxel_bytes);
        assert_memory_equal(sp_volume_voxels(was), sp_volume_voxels(is), a->voxel_bytes);
        assert_memory_equal(a->grid.dims, b->grid.dims, sizeof a->grid.dims);
        for (int axis = 0; axis < 3; axis++) {
            assert_float_equal(a->grid.spacing[axis], b->grid.spacing[axis],
                               a->grid.spacing[axis] * 1e-6);
            assert_float_equal(a->grid.origin[axis], b->grid.origin[axis], 1e-6);
        }
        assert_string_equal(a->value_name, b->value_name);
        assert_string_equal(a->unit, b->unit);
        assert_int_equal(count_entries(*state), i + 1); /* nothing is left beside it */
        sp_volume_unref(&was);
        sp_volume_unref(&is);
    }
}

/* A file of the samples of describe(). */
static void write_nrrd(const char *path) {
    struct sp_error err;
    const struct sp_volume_info info = describe();
    FILE *file = fopen(path, "w+");
    assert_non_null(file);
    const struct sp_export_job job = {
        .info = &info, .samples = make_samples(), .out = fileno(file), .title = path
    };
    if (!sp_export_nrrd(&job, &err))
        fail_msg("%s", err.text);
    close(job.samples);
    fclose(file);
}

static void brick_files_are_converted(void **state) {
    struct sp_error err;
    static char bytes[2][2 * COUNT + 4096];
    size_t sizes[2];
    const char *first = path_in(state, "a.nrrd"), *bricks = path_in(state, "a.bricks"),
               *again = path_in(state, "b.nrrd");
    write_nrrd(first);
    if (!sp_convert(first, bricks, &options, &err) || !sp_convert(bricks, again, &options, &err))
        fail_msg("%s: %s", err.place, err.text);
    for (int i = 0; i < 2; i++) {
        FILE *file = fopen(i ? again : first, "r");
        assert_non_null(file);
        sizes[i] = fread(bytes[i], 1, sizeof bytes[i], file);
        fclose(file);
    }
    assert_int_equal(sizes[0], sizes[1]);
    assert_memory_equal(bytes[0], bytes[1], sizes[0]);
    assert_int_equal(truncate(bricks, 5000), 0);
    assert_false(sp_convert(bricks, again, &options, &err));
    assert_int_equal(err.code, SP_ERR_FORMAT);
    assert_int_equal(count_entries(*state), 3);
}

/* Names of other fields are not in it. */
static void a_converted_brick_file_is_the_same(void **state) {
    enum { FIELDS = 3 };
    struct sp_error err;
    static char bytes[2][1 << 16];
    size_t sizes[2];
    const char *grid = path_in(state, "a.vtk"), *first = path_in(state, "a.bricks"),
               *again = path_in(state, "b.bricks");
    FILE *file = fopen(grid, "w");
    assert_non_null(file);
    fputs("# vtk DataFile Version 3.0\ngrid\nASCII\nDATASET STRUCTURED_POINTS\n"
          "DIMENSIONS 2 2 2\nORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA 8\n",
          file);
    for (int i = 0; i < FIELDS; i++)
        fprintf(file, "SCALARS field%d float 1\nLOOKUP_TABLE default\n1 2 3 4 5 6 7 8\n", i);
    fclose(file);
    if (!sp_convert(grid, first, &options, &err) || !sp_convert(first, again, &options, &err))
        fail_msg("%s: %s", err.place, err.text);
    for (int i = 0; i < 2; i++) {
        file = fopen(i ? again : first, "r");
        assert_non_null(file);
        sizes[i] = fread(bytes[i], 1, sizeof bytes[i], file);
        fclose(file);
    }
    assert_int_equal(sizes[0], sizes[1]);
    assert_memory_equal(bytes[0], bytes[1], sizes[0]);
    for (int i = 1; i < FIELDS; i++) {
        char name[16];
        const int length = snprintf(name, sizeof name, "ield%d", i);
        assert_null(memmem(bytes[0], sizes[0], name, (size_t)length));
    }
}

static void a_unit_that_nifti_lacks_is_refused(void **state) {
    (void)state;
    struct sp_error err;
    struct sp_volume_info info = describe();
    const struct sp_export_job job = {
        .info = &info, .samples = make_samples(), .out = memory_file("", 0), .title = "a.nii"
    };
    strcpy(info.unit, "degrees");
    assert_false(sp_export_nifti(&job, &err));
    assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
    assert_non_null(strstr(err.text, "\"degrees\""));
    assert_true(sp_export_nrrd(&job, &err));
    close(job.samples);
    close(job.out);
}

static void names_cannot_break_the_header(void **state) {
    struct sp_error err;
    struct sp_volume_info info = describe();
    const char *path = path_in(state, "a.nrrd");
    strcpy(info.value_name, "a\nencoding: gzip\r\n\n");
    strcpy(info.unit, "\"\\\n");
    FILE *file = fopen(path, "w+");
    assert_non_null(file);
    const struct sp_export_job job = {
        .info = &info, .samples = make_samples(), .out = fileno(file), .title = "a.nrrd"
    };
    if (!sp_export_nrrd(&job, &err))
        fail_msg("%s", err.text);
    fclose(file);
    struct sp_volume *volume = sp_volume_load(path, &options, &err);
    if (!volume)
        fail_msg("%s: %s", err.place, err.text);
    assert_string_equal(sp_volume_info(volume)->value_name, "a encoding: gzip");
    assert_string_equal(sp_volume_info(volume)->unit, "\"\\ ");
    sp_volume_unref(&volume);
    close(job.samples);
}

static void a_wide_volume_is_nifti_2(void **state) {
    (void)state;
    struct sp_error err;
    struct sp_volume_info info = describe();
    const uint32_t dims[3] = { 32768, 1, 1 };
    static const uint16_t samples[32768];
    const struct sp_export_job job = { .info = &info,
                                       .samples = memory_file(samples, sizeof samples),
                                       .out = memory_file("", 0),
                                       .title = "a.nii" };
    int32_t size;
    struct stat st;
    for (uint32_t less = 0; less < 2; less++) {
        memcpy(info.grid.dims, dims, sizeof dims);
        info.grid.dims[0] -= less;
        assert_int_equal(ftruncate(job.out, 0), 0);
        assert_true(sp_export_nifti(&job, &err));
        assert_int_equal(pread(job.out, &size, sizeof size, 0), sizeof size);
        assert_int_equal(size, less ? 348 : 540);
        assert_int_equal(fstat(job.out, &st), 0);
        assert_int_equal(st.st_size, (uint32_t)size + 4 + 2 * info.grid.dims[0]);
    }
    close(job.samples);
    close(job.out);
}

static void a_folder_of_others_is_not_replaced(void **state) {
    struct sp_error err;
    const char *out = path_in(state, "a.zarr"), *file = path_in(state, "a.zarr/.zattrs");
    assert_int_equal(mkdir(out, 0777), 0);
    assert_false(sp_convert("demo:engine?size=16", out, &options, &err)); /* it is empty */
    assert_int_equal(err.code, SP_ERR_INVALID);
    FILE *attributes = fopen(file, "w");
    assert_non_null(attributes);
    fputs("{}\n", attributes);
    fclose(attributes);
    assert_false(sp_convert("demo:engine?size=16", out, &options, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_int_equal(unlink(file), 0);
    assert_int_equal(rmdir(out), 0);
    assert_true(sp_convert("demo:engine?size=16", out, &options, &err));
    assert_true(sp_convert("demo:engine?size=17", out, &options, &err));
    struct sp_volume *volume = sp_volume_load(out, &options, &err);
    assert_non_null(volume);
    assert_int_equal(sp_volume_info(volume)->grid.dims[0], 17);
    sp_volume_unref(&volume);
    assert_int_equal(count_entries(*state), 1);
    assert_int_equal(mkdir(path_in(state, "a.zarr/labels"), 0777), 0);
    assert_false(sp_convert("demo:engine?size=16", out, &options, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
}

static void an_output_that_cannot_be_written_is_refused_at_once(void **state) {
    static const char *const names[] = { "none/a.nrrd", "none/a.zarr" };
    struct sp_error err;
    struct stat st;
    const char *pipe = path_in(state, "pipe.nrrd");
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        assert_false(sp_convert("/no/source", path_in(state, names[i]), &options, &err));
        assert_int_equal(err.code, SP_ERR_IO);
        assert_non_null(strstr(err.text, "cannot write into the folder"));
    }
    assert_int_equal(mkfifo(pipe, 0666), 0);
    assert_false(sp_convert("/no/source", pipe, &options, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_int_equal(stat(pipe, &st), 0);
    assert_true(S_ISFIFO(st.st_mode));
}

static void turned_axes_are_refused(void **state) {
    struct sp_error err;
    struct sp_volume_info info = describe();
    const struct sp_export_job job = {
        .info = &info, .samples = make_samples(), .out = -1, .folder = *state, .title = "a.zarr"
    };
    info.grid.direction[0][0] = info.grid.direction[1][1] = 0.8;
    info.grid.direction[0][1] = -0.6;
    info.grid.direction[1][0] = 0.6;
    assert_false(sp_export_zarr(&job, &err));
    assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
    assert_non_null(strstr(err.text, ".nii.gz"));
    close(job.samples);
}

/* The progress of a conversion that is refused before its samples are read. */
static bool refuse_reading(void *user, double fraction) {
    const double opened = 0.04;
    (void)user;
    assert_in_range(1000 * fraction, 0, 1000 * opened);
    return true;
}

static void rectilinear_axes_are_refused_before_samples_are_read(void **state) {
    const char *grid = path_in(state, "a.vtk"), *bricks = path_in(state, "a.bricks"),
               *out = path_in(state, "a.nrrd");
    const char *const sources[] = { "demo:galaxy?size=70", bricks, grid };
    struct sp_error err;
    FILE *file = fopen(grid, "w");
    assert_non_null(file);
    fputs("# vtk DataFile Version 3.0\ngrid\nASCII\nDATASET RECTILINEAR_GRID\n"
          "DIMENSIONS 3 2 2\nX_COORDINATES 3 float\n0 1 3\nY_COORDINATES 2 float\n0 1\n"
          "Z_COORDINATES 2 float\n0 1\nPOINT_DATA 12\nSCALARS a float 1\n"
          "LOOKUP_TABLE default\n1 2 3 4 5 6 no number 9 10 11 12\n",
          file);
    fclose(file);
    assert_true(sp_convert(sources[0], bricks, &options, &err));
    assert_false(sp_convert(grid, path_in(state, "b.bricks"), &options, &err));
    assert_int_equal(err.code, SP_ERR_FORMAT); /* its samples cannot be read */
    for (size_t i = 0; i < sizeof sources / sizeof *sources; i++) {
        struct sp_load_options own = options;
        own.progress = refuse_reading;
        assert_false(sp_convert(sources[i], out, &own, &err));
        if (err.code != SP_ERR_UNSUPPORTED || !strstr(err.text, "only .bricks files keep"))
            fail_msg("%s: %s", sources[i], err.text);
        assert_string_equal(err.place, sources[i]);
    }
    assert_int_equal(count_entries(*state), 2);
}

static bool cancel(void *user, double fraction) {
    double *last = user;
    assert_true(fraction >= *last);
    *last = fraction;
    return fraction < 0.7;
}

static void nothing_is_left_after_cancelling(void **state) {
    static const char *const names[] = { "a.nrrd",   "a.nii", "a.nii.gz",
                                         "a.bricks", "a.vdb", "a.zarr" };
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        struct sp_error err;
        double last = 0;
        struct sp_load_options own = options;
        own.progress = cancel;
        own.user = &last;
        assert_false(sp_convert("demo:turbulence?size=72", path_in(state, names[i]), &own, &err));
        assert_int_equal(err.code, SP_ERR_CANCELLED);
        assert_int_equal(count_entries(*state), 0);
    }
}

/* A sparse source stays sparse in the file that the writers read: only rows with data take space,
 * also where the kernel could allocate a page with its neighbours. */
static void holes_are_neither_read_nor_written(void **state) {
    enum { SIDE = 256, HEADER = 4096, STEP = 40 /* pages between two with data */ };
    const size_t size = (size_t)SIDE * SIDE * SIDE;
    const char *path = path_in(state, "sparse.nrrd");
    char header[HEADER], page[HEADER];
    struct stat st;
    struct sp_error err;
    struct sp_volume_info info;
    memset(header, ' ', sizeof header);
    const int used = snprintf(header, sizeof header,
                              "NRRD0004\ntype: uint8\ndimension: 3\nsizes: %d %d %d\n"
                              "encoding: raw\n#",
                              SIDE, SIDE, SIDE);
    header[used] = ' ';
    header[HEADER - 2] = header[HEADER - 1] = '\n';
    unsigned char *expected = calloc(1, size), *bytes = malloc(size);
    FILE *file = fopen(path, "w");
    assert_true(file && expected && bytes);
    const int fd = fileno(file);
    assert_int_equal(pwrite(fd, header, HEADER, 0), HEADER);
    assert_int_equal(ftruncate(fd, (off_t)(HEADER + size)), 0);
    for (size_t at = HEADER; at < size; at += (size_t)STEP * HEADER) {
        memset(page, (int)(at / HEADER % 255) + 1, HEADER);
        memcpy(expected + at, page, HEADER);
        assert_int_equal(pwrite(fd, page, HEADER, (off_t)(HEADER + at)), HEADER);
    }
    fclose(file);
    double *numbers;
    const int samples = sp_import_samples(path, &options, *state, true, &info, &numbers, &err);
    if (samples < 0)
        fail_msg("%s: %s", err.place, err.text);
    assert_int_equal(pread(samples, bytes, size, 0), (ssize_t)size);
    assert_memory_equal(bytes, expected, size);
    assert_int_equal(stat(path, &st), 0);
    const bool has_holes =
        st.st_blocks * 512 < (blkcnt_t)(size / 4); /* else a simple file system */
    assert_int_equal(fstat(samples, &st), 0);
    if (has_holes)
        assert_in_range(st.st_blocks * 512, 0, size / 4);
    close(samples);
    free(numbers);
    if (!sp_convert(path, path_in(state, "a.bricks"), &options, &err) ||
        !sp_convert(path_in(state, "a.bricks"), path_in(state, "a.nrrd"), &options, &err))
        fail_msg("%s: %s", err.place, err.text);
    assert_int_equal(stat(path_in(state, "a.nrrd"), &st), 0);
    if (has_holes) /* a page with data takes two in a file whose header has another length */
        assert_in_range(st.st_blocks * 512, 0, size / 4);
    struct sp_volume *volume = sp_volume_load(path_in(state, "a.nrrd"), &options, &err);
    assert_non_null(volume);
    assert_memory_equal(sp_volume_voxels(volume), expected, size);
    sp_volume_unref(&volume);
    free(expected);
    free(bytes);
}

static void the_name_states_the_format(void **state) {
    (void)state;
    static const char *const good[] = { "a.bricks", "x/a.nrrd", "a.b.nii",
                                        "a.nii.gz", "a.vdb",    "a.ome.zarr/" };
    static const char *const bad[] = { ".vdb", "a.gz",      ".nrrd",   "x/.nii.gz",
                                       "nrrd", "a.nrrd.gz", "x/.zarr/" };
    struct sp_error err;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++)
        if (!sp_convert_check(good[i], &err))
            fail_msg("%s: %s", good[i], err.text);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_false(sp_convert_check(bad[i], &err));
        assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
        assert_non_null(strstr(err.text, ".nii.gz"));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(demos_come_back, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(brick_files_are_converted, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(a_converted_brick_file_is_the_same, make_folder,
                                        remove_folder),
        cmocka_unit_test(a_unit_that_nifti_lacks_is_refused),
        cmocka_unit_test_setup_teardown(names_cannot_break_the_header, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(an_output_that_cannot_be_written_is_refused_at_once,
                                        make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(a_folder_of_others_is_not_replaced, make_folder,
                                        remove_folder),
        cmocka_unit_test_setup_teardown(turned_axes_are_refused, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(rectilinear_axes_are_refused_before_samples_are_read,
                                        make_folder, remove_folder),
        cmocka_unit_test(a_wide_volume_is_nifti_2),
        cmocka_unit_test_setup_teardown(nothing_is_left_after_cancelling, make_folder,
                                        remove_folder),
        cmocka_unit_test_setup_teardown(holes_are_neither_read_nor_written, make_folder,
                                        remove_folder),
        cmocka_unit_test(the_name_states_the_format),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
