/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "draw/resample/kernels.h"

enum { SIDE = 64, SAMPLES = 30 };

static double uniform(double low, double high) {
    return low + (high - low) * rand() / RAND_MAX;
}

/* Block 0 sees samples from `low` to `high`, per axis. */
static void set_corners(struct sp_resample_bounds *bounds, const double low[2],
                        const double high[2]) {
    for (int i = 0; i < 4; i++) {
        bounds->corner[0][i][0] = (float)(i & 1 ? high[0] : low[0]);
        bounds->corner[1][i][0] = (float)(i & 2 ? high[1] : low[1]);
    }
}

/* Any refined sample that a pixel of a block may read is in the block's range. */
static void a_range_holds_all_samples_of_a_block(void **state) {
    static int16_t refined[SIDE * SIDE];
    struct sp_resample_scratch *scratch = calloc(1, sizeof *scratch);
    struct sp_resample_sheet sheet = { .refined = refined,
                                       .width = SIDE,
                                       .last = { SIDE - 1.002f, SIDE - 1.002f } };
    const struct sp_resample_open_tile tile = { .scratch = scratch, .dims = { SAMPLES, SAMPLES } };
    int near = 0;
    (void)state;
    assert_non_null(scratch);
    srand(5);
    for (int n = 0; n < 300; n++) {
        double low[2], high[2];
        int first[2], last[2];
        for (int a = 0; a < 2; a++) {
            low[a] = uniform(0, SAMPLES - 6);
            high[a] = low[a] + uniform(0, 5);
            first[a] = (int)floor(2 * (double)(float)low[a]);
            last[a] = (int)floor(2 * (double)(float)high[a]) + 1;
        }
        set_corners(&scratch->bounds, low, high);
        for (int y = first[1]; y <= last[1]; y++)
            for (int x = first[0]; x <= last[0]; x++) {
                refined[y * SIDE + x] = 900;
                sp_resample_near_ranges(&tile, &sheet, 1);
                refined[y * SIDE + x] = 0;
                assert_true(sheet.range[1][0] >= 900);
            }
        near += isfinite(sheet.range[1][0]) != 0;
    }
    assert_true(near > 50);
    free(scratch);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(a_range_holds_all_samples_of_a_block) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
