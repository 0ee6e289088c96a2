/* SPDX-License-Identifier: Apache-2.0
 *
 * Codes that are read from rows, against the formula of each sample.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "data/volume/sample.h"
#include "draw/resample/rows.h"

enum { LENGTH = 400 };

static double expect_code(const struct sp_curve *curve, double x) {
    double code = CURVE_CODE_MIN + (x - curve->base) * curve->codes_per_unit;
    if (!isfinite(x))
        return CURVE_CODE_NONE;
    return fmin(fmax(code, CURVE_CODE_MIN), CURVE_CODE_MAX);
}

/* Fills a row with random values; floats lie around 7 and are sometimes not finite. */
static void fill(unsigned char *voxels, enum sp_type type) {
    for (size_t i = 0; i < LENGTH * sp_type_size(type); i++)
        voxels[i] = (unsigned char)(rand() >> 7);
    for (size_t i = 0; i < LENGTH; i++) {
        double value = rand() % 20 == 0   ? NAN
                       : rand() % 20 == 0 ? INFINITY
                                          : 6 + rand() % 999 / 500.0;
        if (type == SP_FLOAT32)
            ((float *)(void *)voxels)[i] = (float)value;
        if (type == SP_FLOAT64)
            ((double *)(void *)voxels)[i] = value;
    }
}

/* Reads parts of a row of `count` samples, and compares what lies inside and beyond its ends. */
static void check(const struct sp_curve *curve, enum sp_type type, int count, int stride) {
    _Alignas(64) unsigned char voxels[LENGTH * 8];
    struct sp_rows rows;
    fill(voxels, type);
    sp_rows_init(&rows, curve, voxels, type, count, (size_t)stride);
    for (int first = -6; first < count; first += 1 + rand() % 9) {
        uint16_t memory[ROWS_MEMORY];
        int most = count - first + 20 < ROWS_LENGTH ? count - first + 20 : ROWS_LENGTH;
        int length = 1 + rand() % most;
        if (first + length <= 0)
            continue;
        sp_rows_read(&rows, 3, first, length, memory + ROWS_MARGIN);
        for (int i = 0; i < length; i++) {
            int at = first + i < 0 ? 0 : first + i < count ? first + i : count - 1;
            double value = sp_sample(voxels, type, (uint64_t)(3 + at * stride));
            double code = (double)memory[ROWS_MARGIN + i] - ROWS_RAISED;
            /* Narrow integers are scaled by factors of 16 bits. */
            assert_true(fabs(code - expect_code(curve, value)) <= 1.5);
        }
    }
}

static void codes_are_those_of_the_samples(void **state) {
    static const struct {
        enum sp_type type;
        double low, high;
    } rows[] = { { SP_UINT8, 0, 255 },      { SP_UINT8, 40, 70 },        { SP_INT8, -128, 127 },
                 { SP_INT8, -20, 60 },      { SP_UINT16, 0, 65535 },     { SP_UINT16, 9000, 12000 },
                 { SP_INT16, -1000, 3000 }, { SP_INT32, -2e9, 2e9 },     { SP_INT32, 1e9, 1.2e9 },
                 { SP_FLOAT32, 6.5, 8 },    { SP_FLOAT32, -1e38, 1e38 }, { SP_FLOAT64, 6.1, 7.9 } };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const double low = rows[i].low, high = rows[i].high;
        struct sp_curve curve = { .base = low,
                                  .data = { -INFINITY, INFINITY },
                                  .codes_per_unit =
                                      (CURVE_CODE_MAX - CURVE_CODE_MIN) / (high - low) };
        static const int counts[] = { 1, 2, 7, 8, 16, 31, 32, 33, 64, 100, 350 };
        for (size_t k = 0; k < sizeof counts / sizeof counts[0]; k++)
            check(&curve, rows[i].type, counts[k], 1);
        check(&curve, rows[i].type, 1, 3);
        check(&curve, rows[i].type, 90, 3);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(codes_are_those_of_the_samples) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
