/* SPDX-License-Identifier: Apache-2.0
 *
 * The range of each region against the range that a loop over the region's samples finds.
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
#include "draw/resample/ranges.h"

/* The range of the finite samples of a region and `margin` samples around it. */
static void expect_range(const struct sp_samples *s, const uint32_t region[3], int margin,
                         float out[2]) {
    bool has_finite = false, has_other = false;
    out[0] = INFINITY;
    out[1] = -INFINITY;
    for (uint64_t i = 0; i < (uint64_t)s->dims[0] * s->dims[1] * s->dims[2]; i++) {
        int64_t at[3] = { (int64_t)(i % s->dims[0]), (int64_t)(i / s->dims[0] % s->dims[1]),
                          (int64_t)(i / s->dims[0] / s->dims[1]) };
        bool is_inside = true;
        for (int a = 0; a < 3; a++) {
            int64_t first = (int64_t)region[a] * SAMPLES_REGION;
            is_inside =
                is_inside && at[a] >= first - margin && at[a] <= first + SAMPLES_REGION + margin;
        }
        double value = sp_sample(s->voxels, s->type, i);
        if (!is_inside)
            continue;
        has_other = has_other || !(fabs(value) <= 1e37);
        has_finite = has_finite || isfinite(value);
        float low = (float)value, high = low;
        out[0] = fminf(out[0], (double)low > value ? nextafterf(low, -INFINITY) : low);
        out[1] = fmaxf(out[1], (double)high < value ? nextafterf(high, INFINITY) : high);
    }
    if (has_other) {
        out[0] = has_finite ? -INFINITY : INFINITY;
        out[1] = has_finite ? INFINITY : -INFINITY;
    }
}

static void check(enum sp_type type, uint32_t x, uint32_t y, uint32_t z) {
    struct sp_samples s = { .type = type, .dims = { x, y, z } };
    size_t count = (size_t)x * y * z, regions = 1, bytes = count * sp_type_size(type);
    unsigned char *voxels = malloc(bytes);
    assert_non_null(voxels);
    for (size_t i = 0; i < bytes; i++)
        voxels[i] = (unsigned char)(rand() >> 7);
    for (size_t i = 0; i < count; i++) {
        double value = rand() % 40 == 0 ? NAN : rand() % 90 == 0 ? 1e38 : rand() / 3.0;
        if (type == SP_FLOAT32)
            ((float *)(void *)voxels)[i] = (float)value;
        if (type == SP_FLOAT64)
            ((double *)(void *)voxels)[i] = value;
    }
    for (int a = 0; a < 3; a++) {
        s.regions[a] = s.dims[a] < 2 ? 1 : (s.dims[a] - 2) / SAMPLES_REGION + 1;
        regions *= s.regions[a];
    }
    s.voxels = voxels;
    s.range = malloc(regions * sizeof s.range[0]);
    assert_non_null(s.range);
    struct sp_pool *pool = sp_pool_create(1, NULL);
    assert_non_null(pool);
    sp_ranges_compute(&s, pool, &(struct sp_interrupt){ 0 });
    for (uint32_t i = 0; i < regions; i++) {
        const uint32_t region[3] = { i % s.regions[0], i / s.regions[0] % s.regions[1],
                                     i / s.regions[0] / s.regions[1] };
        float own[2], wide[2];
        expect_range(&s, region, 0, own);
        expect_range(&s, region, 1, wide);
        float margin = 0.25f * (wide[1] - wide[0]);
        float low = wide[0], high = wide[1]; /* empty or everything */
        if (fabsf(margin) < INFINITY) {
            low = fminf(own[0], wide[1]) - margin;
            high = fmaxf(own[1], wide[0]) + margin;
        }
        assert_memory_equal(&s.range[i][0], &low, sizeof low);
        assert_memory_equal(&s.range[i][1], &high, sizeof high);
    }
    sp_pool_destroy(&pool);
    free(s.range);
    free(voxels);
}

static void ranges_are_those_of_the_samples(void **state) {
    static const uint32_t dims[][3] = {
        { 1, 1, 1 },  { 2, 1, 5 },    { 1, 6, 2 },   { 5, 5, 5 },
        { 6, 9, 10 }, { 13, 14, 17 }, { 257, 4, 3 }, { 259, 7, 6 }
    };
    (void)state;
    for (size_t i = 0; i < sizeof dims / sizeof dims[0]; i++)
        for (int type = 0; type < SP_TYPE_COUNT; type++)
            check((enum sp_type)type, dims[i][0], dims[i][1], dims[i][2]);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(ranges_are_those_of_the_samples) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
