/* SPDX-License-Identifier: Apache-2.0
 *
 * Files with several frames from the folder dicom/ (make.py there). tests/formats has many more.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "unit/data/import/support.h"

enum { NX = 16, NY = 12, FRAME = NX * NY };

/* Copies a file of dicom/ into the folder of the test, with `cut` bytes less. */
static void copy(const char *name, size_t cut) {
    char path[1024], bytes[1 << 14];
    snprintf(path, sizeof path, SPLATD_SOURCE_DIR "/tests/unit/data/import/dicom/%s", name);
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    const size_t size = fread(bytes, 1, sizeof bytes, file);
    assert_in_range(size, cut + 1, sizeof bytes - 1);
    fclose(file);
    write_file(name, bytes, size - cut);
}

/* Two times of three places, shuffled, with a slope for each place. */
static void frames_are_sorted_by_place_and_time(void **state) {
    (void)state;
    copy("enhanced.dcm", 0);
    for (uint32_t step = 0; step < 2; step++) {
        struct sp_volume *volume = load_step("enhanced.dcm", step);
        const struct sp_volume_info *info = sp_volume_info(volume);
        const float *samples = sp_volume_voxels(volume);
        assert_int_equal(info->type, SP_FLOAT32);
        assert_int_equal(info->steps.count, 2);
        assert_non_null(info->steps.times);
        assert_float_equal(info->steps.times[1], 0.25, 1e-9);
        assert_string_equal(info->steps.unit, "s");
        assert_int_equal(info->grid.dims[2], 3);
        assert_float_equal(info->grid.spacing[2], 2.5, 1e-9);
        assert_float_equal(info->grid.origin[1], 5, 1e-9);
        for (int k = 0; k < 3; k++)
            for (int i = 0; i < FRAME; i++)
                assert_float_equal(samples[k * FRAME + i],
                                   (k + 1) * ((7 * i + 100 * (k + 3 * (int)step)) % 4096), 0);
        sp_volume_unref(&volume);
    }
}

/* Two segments of 15 pixels per frame: the bits of a frame begin inside a byte. */
static void segments_are_labels_or_fields(void **state) {
    (void)state;
    static const uint8_t labels[] = { 1, 0, 2 }, right[] = { 0, 0, 1 };
    copy("segments.dcm", 0);
    struct sp_volume *volume = load("segments.dcm");
    const struct sp_volume_info *info = sp_volume_info(volume);
    const uint8_t *samples = sp_volume_voxels(volume);
    assert_string_equal(info->value_name, "labels");
    assert_string_equal(info->others[0], "left");
    assert_string_equal(info->others[1], "right");
    assert_int_equal(info->grid.dims[2], 3);
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 15; i++)
            assert_int_equal(samples[15 * k + i], i % (k + 2) == 0 ? labels[k] : 0);
    sp_volume_unref(&volume);
    volume = load("segments.dcm?field=right");
    samples = sp_volume_voxels(volume);
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 15; i++)
            assert_int_equal(samples[15 * k + i], i % (k + 2) == 0 ? right[k] : 0);
    sp_volume_unref(&volume);
}

static void what_is_missing_is_named(void **state) {
    (void)state;
    copy("enhanced.dcm", 100);
    load_error("enhanced.dcm", SP_ERR_FORMAT, "enhanced.dcm", "cut off");
    load_error("segments.dcm?field=middle", SP_ERR_NOT_FOUND, "segments.dcm", "middle");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(frames_are_sorted_by_place_and_time),
        cmocka_unit_test(segments_are_labels_or_fields),
        cmocka_unit_test(what_is_missing_is_named),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
