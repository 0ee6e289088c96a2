/* SPDX-License-Identifier: Apache-2.0
 *
 * Values that stand for missing data: what the range, the histogram and the first window make of
 * them.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/volume.h"
#include "sp/slice.h"
#include "support/compare.h"

enum { SIDE = 16, COUNT = SIDE * SIDE * SIDE };

/* A ramp from `low` to `high`, of which every tenth sample is `mark`. */
static struct sp_volume *make(enum sp_type type, double low, double high, double mark, int every) {
    struct sp_grid grid = { .dims = { SIDE, SIDE, SIDE }, .spacing = { 1, 1, 1 } };
    static double reals[COUNT];
    static float floats[COUNT];
    static int16_t shorts[COUNT];
    for (int a = 0; a < 3; a++)
        grid.direction[a][a] = 1;
    for (int i = 0; i < COUNT; i++) {
        reals[i] = i % every == 5 ? mark : low + (high - low) * i / (COUNT - 1);
        floats[i] = (float)reals[i];
        shorts[i] = (int16_t)fmin(fmax(reals[i], INT16_MIN), INT16_MAX);
    }
    const void *voxels = type == SP_FLOAT64 ? (void *)reals
                         : type == SP_INT16 ? (void *)shorts
                                            : (void *)floats;
    struct sp_volume *volume = sp_volume_create(&grid, type, voxels, "test", NULL);
    assert_non_null(volume);
    return volume;
}

static uint64_t total_of(const struct sp_volume_info *info) {
    uint64_t total = 0;
    for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
        total += info->histogram[b];
    return total;
}

static void marks_of_missing_data_are_left_out(void **state) {
    (void)state;
    static const struct {
        enum sp_type type;
        double low, high, mark;
    } cases[] = {
        { SP_FLOAT32, -100, 4000, -9999 },    { SP_FLOAT32, 0, 30, -999 },
        { SP_FLOAT32, 250, 320, 1e20 },       { SP_FLOAT32, -1, 1, 9.96921e36 },
        { SP_FLOAT64, -1, 1, -1.7e308 },      { SP_FLOAT64, 200, 300, 1e30 },
        { SP_INT16, -1024, 3071, INT16_MIN }, { SP_INT16, -1024, 3071, -2000 },
        { SP_INT16, -1000, 2000, -3024 },     { SP_INT16, 0, 300, -5000 },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sp_volume *volume =
            make(cases[i].type, cases[i].low, cases[i].high, cases[i].mark, 10);
        const struct sp_volume_info *info = sp_volume_info(volume);
        const double span = cases[i].high - cases[i].low;
        /* They are samples: the range has them. */
        const double end = cases[i].mark < 0 ? info->range[0] : info->range[1];
        assert_float_equal(end / cases[i].mark, 1, 1e-6);
        assert_float_equal(info->data[0], cases[i].low, 0.01 * span);
        assert_float_equal(info->data[1], cases[i].high, 0.01 * span);
        assert_int_equal(total_of(info), COUNT - (COUNT + 4) / 10);
        double window[2];
        sp_slice_default_window(info, window);
        assert_float_equal(window[1], span, 0.05 * span);
        assert_non_null(strstr(info->warnings[0], "missing data"));
        assert_string_equal(info->warnings[1], "");
        sp_volume_unref(&volume);
    }
}

static void other_values_are_data(void **state) {
    (void)state;
    static const struct {
        enum sp_type type;
        double low, high, mark;
        int every;
    } cases[] = {
        { SP_FLOAT32, 100, 200, 0, 10 },       /* a mask, or air */
        { SP_INT16, 1, 5, 200, 10 },           /* an object of one value */
        { SP_FLOAT32, 0, 1, 5000, 10 },        /* the same */
        { SP_FLOAT32, 0, 100, -9999, 2000 },   /* two samples are no habit */
        { SP_INT16, -1000, 1000, -1024, 10 },  /* next to the data */
        { SP_FLOAT32, -9000, 9000, -9999, 9 }, /* data reach nearly as far */
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sp_volume *volume =
            make(cases[i].type, cases[i].low, cases[i].high, cases[i].mark, cases[i].every);
        const struct sp_volume_info *info = sp_volume_info(volume);
        assert_float_equal(info->data[0], info->range[0], 0);
        assert_float_equal(info->data[1], info->range[1], 0);
        assert_int_equal(total_of(info), COUNT);
        assert_string_equal(info->warnings[0], "");
        sp_volume_unref(&volume);
    }
}

static void make_info(struct sp_volume_info *info, uint32_t x, uint32_t y, uint32_t z,
                      double thickness) {
    *info =
        (struct sp_volume_info){ .grid = { .dims = { x, y, z }, .spacing = { 1, 1, thickness } },
                                 .type = SP_INT16,
                                 .source = "a.nii" };
}

static void few_or_thick_slices_are_a_thick_stack(void **state) {
    (void)state;
    struct sp_volume_info info;
    make_info(&info, 256, 256, 22, 1);
    assert_true(sp_volume_is_thick_stack(&info));
    make_info(&info, 256, 256, 60, 5);
    assert_true(sp_volume_is_thick_stack(&info));
    make_info(&info, 64, 64, 1, 1);
    assert_true(sp_volume_is_thick_stack(&info));
    make_info(&info, 256, 256, 60, 3);
    assert_false(sp_volume_is_thick_stack(&info));
    make_info(&info, 24, 24, 24, 1);
    assert_false(sp_volume_is_thick_stack(&info));
    make_info(&info, 125, 125, 25, 1); /* a simulation with a short axis */
    info.type = SP_FLOAT32;
    assert_false(sp_volume_is_thick_stack(&info));
    info.grid.dims[2] = 7;
    assert_true(sp_volume_is_thick_stack(&info));
    info.grid.dims[2] = 25;
    memcpy(info.anatomy, "LPS", 4);
    assert_true(sp_volume_is_thick_stack(&info));
    strcpy(info.source, "demo:phantom");
    assert_false(sp_volume_is_thick_stack(&info));
}

static void meanings_have_names(void **state) {
    (void)state;
    assert_string_equal(sp_meaning_name(SP_MEANING_UNKNOWN), "");
    assert_string_equal(sp_meaning_name(SP_MEANING_LABELS), "labels");
    assert_string_equal(sp_meaning_name(SP_MEANING_STATISTIC), "statistic");
    assert_string_equal(sp_meaning_name(SP_MEANING_DISTANCE), "distance");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(marks_of_missing_data_are_left_out),
        cmocka_unit_test(other_values_are_data),
        cmocka_unit_test(few_or_thick_slices_are_a_thick_stack),
        cmocka_unit_test(meanings_have_names),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
