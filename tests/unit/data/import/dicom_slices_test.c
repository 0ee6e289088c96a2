/* SPDX-License-Identifier: Apache-2.0
 *
 * Sorting of slices, and times of which some slices are missing.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/dicom_times.h"
#include "unit/data/import/support.h"

static struct import_warnings warnings;
static struct import_file file = { .title = "scan", .warnings = &warnings };

/* Adds an axial slice of the series. */
static void add(struct dicom_slices *slices, const char *name, long instance, double z,
                double phase) {
    struct dicom_frame frame = { .is_placed = true,
                                 .is_spaced = true,
                                 .position = { 0, 0, z },
                                 .along = { { 1, 0, 0 }, { 0, 1, 0 } },
                                 .spacing = { 1, 1, 1 },
                                 .slope = 1,
                                 .instance = instance };
    for (int key = 0; key < DICOM_KEY_COUNT; key++)
        frame.keys[key] = NAN;
    frame.keys[DICOM_KEY_PHASE] = phase;
    assert_true(dicom_slices_add(slices, name, 0, false, &frame));
}

static void complete(struct dicom_slices *slices) {
    const struct dicom_source source = { .file = &file };
    struct sp_error err;
    assert_true(dicom_times_complete(slices, &source, &err));
}

/* The grid of a label map has far more planes than the files have slices. */
static void planes_without_slices_are_no_times(void **state) {
    (void)state;
    struct dicom_slices slices = { .has_gaps = true };
    add(&slices, "a", 1, 0, NAN);
    add(&slices, "b", 2, 60000, NAN);
    add(&slices, "c", 3, 0, NAN);
    assert_true(dicom_slices_sort(&slices));
    assert_int_equal(slices.planes, 60001);
    complete(&slices); /* the order of the numbers makes the times {a, b} and {c} */
    assert_int_equal(slices.count, 2);
    assert_int_equal(slices.planes, 60001);
    assert_string_equal(slices.items[0].name, "a");
    assert_int_equal(slices.items[0].plane, 0);
    assert_string_equal(slices.items[1].name, "b");
    assert_int_equal(slices.items[1].plane, 60000);
    dicom_slices_finish(&slices);
}

/* Empty planes stay, whichever slices are left out. */
static void a_time_that_lacks_slices_leaves_the_gaps(void **state) {
    static const double places[] = { 0, 1, 4 };
    static const char *const names[] = { "a", "b", "c", "d", "e", "f" };
    struct dicom_slices slices = { .has_gaps = true };
    (void)state;
    for (long i = 0; i < 5; i++) /* the second time lacks the last place */
        add(&slices, names[i], i + 1, places[i % 3], i / 3);
    assert_true(dicom_slices_sort(&slices));
    complete(&slices);
    assert_int_equal(slices.count, 3);
    assert_int_equal(slices.planes, 5);
    assert_int_equal(slices.items[2].plane, 4);
    dicom_slices_finish(&slices);
}

/* The number in the series does not tell whether a file has frames. */
static void only_frames_are_called_frames(void **state) {
    struct dicom_slices slices = { .count = 0 };
    char name[80];
    (void)state;
    add(&slices, "a.dcm", DICOM_FRAMES_MAX + 1, 0, NAN);
    dicom_slice_name(&slices.items[0], name);
    assert_string_equal(name, "a.dcm");
    assert_true(dicom_slices_add(&slices, "b.dcm", 2, true, &slices.items[0].is));
    dicom_slice_name(&slices.items[1], name);
    assert_string_equal(name, "frame 3 of b.dcm");
    dicom_slices_finish(&slices);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(planes_without_slices_are_no_times),
        cmocka_unit_test(only_frames_are_called_frames),
        cmocka_unit_test(a_time_that_lacks_slices_leaves_the_gaps),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
