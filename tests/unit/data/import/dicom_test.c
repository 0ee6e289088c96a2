/* SPDX-License-Identifier: Apache-2.0
 *
 * The files of the folder dicom/, which pydicom and GDCM's tools wrote (make.py there).
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/number.h"
#include "unit/data/import/support.h"

enum { NX = 16, NY = 12, SLICE = NX * NY };

/* Copies a file of dicom/ into the folder of the test. */
static void copy(const char *from, const char *to) {
    char path[1024], bytes[1 << 14];
    snprintf(path, sizeof path, SPLATD_SOURCE_DIR "/tests/unit/data/import/dicom/%s", from);
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    const size_t size = fread(bytes, 1, sizeof bytes, file);
    assert_true(size > 0 && size < sizeof bytes);
    fclose(file);
    write_file(to, bytes, size);
}

/* Samples of a slice as make.py writes them, rescaled by 1 and `offset`. */
static void check_slice(const struct sp_volume *volume, uint32_t slice, int k, int offset) {
    const enum sp_type type = sp_volume_info(volume)->type;
    const size_t size = sp_type_size(type);
    const char *voxels = (const char *)sp_volume_voxels(volume) + slice * SLICE * size;
    for (int i = 0; i < SLICE; i++)
        assert_int_equal((int)import_widen(voxels + (size_t)i * size, import_number_of(type)),
                         (7 * i + 100 * k) % 4096 + offset);
}

static void a_series_is_sorted_by_place(void **state) {
    (void)state;
    static const char *const names[] = { "z.dcm", "b.dcm", "a.dcm", "IM4" };
    char from[16];
    for (int k = 0; k < 4; k++) {
        snprintf(from, sizeof from, "series%d.dcm", k);
        copy(from, names[k]);
    }
    copy("overview.dcm", "overview.dcm"); /* of the same series, in another direction */
    write_text("notes.txt", "not an image");
    write_text("broken.dcm", "not an image");
    struct sp_volume *volume = load("b.dcm");
    const struct sp_volume_info *info = sp_volume_info(volume);
    assert_int_equal(info->type, SP_INT16); /* 12 bits, minus 24 */
    assert_int_equal(info->grid.dims[0], NX);
    assert_int_equal(info->grid.dims[1], NY);
    assert_int_equal(info->grid.dims[2], 4);
    static const double spacing[3] = { 0.5, 0.75, 2.5 };
    static const double direction[3][3] = { { 1, 0, 0 }, { 0, 0, 1 }, { 0, -1, 0 } };
    for (int axis = 0; axis < 3; axis++) {
        assert_compare(fabs(info->grid.spacing[axis] - spacing[axis]), <=, 1e-9);
        assert_compare(fabs(info->grid.origin[axis] - (double[]){ -10, 5, 30 }[axis]), <=, 1e-9);
        for (int row = 0; row < 3; row++)
            assert_compare(fabs(info->grid.direction[row][axis] - direction[row][axis]), <=, 1e-9);
    }
    assert_null(info->grid.coordinates[2]);
    assert_string_equal(info->anatomy, "LPS");
    assert_string_equal(info->unit, "mm");
    assert_string_equal(info->value_unit, "HU");
    for (uint32_t k = 0; k < 4; k++)
        check_slice(volume, k, (int)k, -24);
    sp_volume_unref(&volume);
}

static void a_missing_slice_leaves_the_others_in_their_places(void **state) {
    (void)state;
    assert_int_equal(remove(in_folder("a.dcm")), 0); /* number 2 of 4 */
    struct sp_volume *volume = load("IM4");
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    assert_int_equal(grid->dims[2], 3);
    assert_non_null(grid->coordinates[2]);
    assert_compare(fabs(grid->coordinates[2][1] - 2.5), <=, 1e-9);
    assert_compare(fabs(grid->coordinates[2][2] - 7.5), <=, 1e-9);
    check_slice(volume, 1, 1, -24);
    check_slice(volume, 2, 3, -24);
    assert_string_equal(sp_volume_info(volume)->warnings[0],
                        "Left out 1 other image of the series, whose size, kind, spacing, "
                        "direction or patient differs: "
                        "overview.dcm.");
    assert_string_equal(sp_volume_info(volume)->warnings[1],
                        "Left out 1 file that cannot be read: broken.dcm: this is "
                        "no DICOM file, or it is "
                        "damaged.");
    assert_string_equal(
        sp_volume_info(volume)->warnings[2],
        "1 slice is missing at 10 mm, between b.dcm and IM4: the gap there is 5 mm, and "
        "others are 2.5 mm.");
    sp_volume_unref(&volume);
    copy("series3.dcm", "again.dcm");
    volume = load("IM4");
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], 3);
    assert_string_equal(
        sp_volume_info(volume)->warnings[1],
        "Left out 1 copy with the same SOPInstanceUID or pixels: again.dcm (of IM4).");
    sp_volume_unref(&volume);
    for (int n = 0; n < 3; n++)
        remove(in_folder((const char *const[]){ "again.dcm", "z.dcm", "IM4" }[n]));
    remove(in_folder("b.dcm"));
}

/* Copies a file and gives it the position of another slice, of the same length as text. */
static void copy_to(const char *from, const char *to, const char *place, const char *other) {
    copy(from, to);
    FILE *file = fopen(in_folder(to), "r+b");
    char bytes[1 << 14];
    const size_t size = fread(bytes, 1, sizeof bytes, file);
    char *at = memmem(bytes, size, place, strlen(place));
    assert_non_null(at);
    memcpy(at, other, strlen(other));
    rewind(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

/* The numbers of instances, which give the order of the steps, fall from file to file. */
static void slices_of_one_place_are_time_steps(void **state) {
    (void)state;
    copy("series0.dcm", "t0.dcm");
    copy_to("series1.dcm", "t1.dcm", "\\7.5\\", "\\5.0\\");
    copy("series2.dcm", "t2.dcm");
    copy_to("series3.dcm", "t3.dcm", "\\12.5\\", "\\10.0\\");
    for (uint32_t step = 0; step < 2; step++) {
        struct sp_volume *volume = load_step("t0.dcm", step);
        assert_int_equal(sp_volume_info(volume)->steps.count, 2);
        assert_int_equal(sp_volume_info(volume)->steps.index, step);
        assert_null(sp_volume_info(volume)->steps.times);
        assert_int_equal(sp_volume_info(volume)->grid.dims[2], 2);
        check_slice(volume, 0, 1 - (int)step, -24);
        check_slice(volume, 1, 3 - (int)step, -24);
        sp_volume_unref(&volume);
    }
    remove(in_folder("t3.dcm"));               /* one place has two slices, the other has one */
    struct sp_volume *volume = load("t0.dcm"); /* the image that is opened stays: its place does */
    assert_int_equal(sp_volume_info(volume)->steps.count, 2);
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], 1);
    sp_volume_unref(&volume);
    volume = load("t1.dcm");
    assert_int_equal(sp_volume_info(volume)->steps.count, 1);
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], 2);
    assert_string_equal(sp_volume_info(volume)->warnings[2],
                        "Left out 1 image of incomplete times that lack places: t0.dcm.");
    sp_volume_unref(&volume);
    for (int n = 0; n < 3; n++)
        remove(in_folder((const char *const[]){ "t0.dcm", "t1.dcm", "t2.dcm" }[n]));
}

static void every_transfer_syntax_is_read(void **state) {
    (void)state;
    static const struct {
        const char *name;
        bool is_signed;
    } files[] = { { "jpeg.dcm", false }, { "jpegls.dcm", false },  { "j2k.dcm", false },
                  { "rle.dcm", false },  { "implicit.dcm", true }, { "big.dcm", true },
                  { "bare.dcm", true } };
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        copy(files[i].name, files[i].name);
        struct sp_volume *volume = load(files[i].name);
        assert_int_equal(sp_volume_info(volume)->grid.dims[2], 1);
        assert_compare(sp_volume_info(volume)->grid.spacing[2], ==, 2);
        check_slice(volume, 0, 0, files[i].is_signed ? -1048 : -24);
        sp_volume_unref(&volume);
    }
}

static void frames_and_colours_are_read(void **state) {
    (void)state;
    copy("frames.dcm", "frames.dcm");
    struct sp_volume *volume = load("frames.dcm");
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], 3);
    for (uint32_t k = 0; k < 3; k++)
        check_slice(volume, k, (int)k, -1048);
    sp_volume_unref(&volume);
    copy("colors.dcm", "colors.dcm");
    volume = load("colors.dcm?field=green"); /* planes after one another in the file */
    const uint8_t *samples = sp_volume_voxels(volume);
    assert_int_equal(sp_volume_info(volume)->type, SP_UINT8);
    for (int i = 0; i < SLICE; i++)
        assert_int_equal(samples[i], (SLICE + i) % 251);
    assert_string_equal(sp_volume_info(volume)->others[0], "red");
    sp_volume_unref(&volume);
}

static void the_unit_is_that_of_the_file(void **state) {
    (void)state;
    copy("unspecified.dcm", "unspecified.dcm");
    struct sp_volume *volume = load("unspecified.dcm");
    assert_string_equal(sp_volume_info(volume)->value_unit, "");
    sp_volume_unref(&volume);
}

/* The preamble may be the header of a TIFF. */
static void a_file_is_known_by_its_content(void **state) {
    (void)state;
    char bytes[1 << 12];
    FILE *file = fopen(SPLATD_SOURCE_DIR "/tests/unit/data/import/dicom/big.dcm", "rb");
    assert_non_null(file);
    const size_t size = fread(bytes, 1, sizeof bytes, file);
    fclose(file);
    memcpy(bytes, "II*\0\10\0\0\0", 8);
    assert_int_equal(remove(in_folder("big.dcm")), 0);
    write_file("both.tif", bytes, size);
    struct sp_volume *volume = load("both.tif");
    check_slice(volume, 0, 0, -1048);
    sp_volume_unref(&volume);
    assert_int_equal(remove(in_folder("both.tif")), 0);
    write_file("cut.dcm", bytes, size - 100);
    load_error("cut.dcm", SP_ERR_FORMAT, "cut.dcm", "the file is cut off");
    write_text("text.dcm", "not an image");
    load_error("text.dcm", SP_ERR_FORMAT, "text.dcm", "no DICOM file");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_series_is_sorted_by_place),
        cmocka_unit_test(a_missing_slice_leaves_the_others_in_their_places),
        cmocka_unit_test(slices_of_one_place_are_time_steps),
        cmocka_unit_test(every_transfer_syntax_is_read),
        cmocka_unit_test(frames_and_colours_are_read),
        cmocka_unit_test(the_unit_is_that_of_the_file),
        cmocka_unit_test(a_file_is_known_by_its_content),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
