/* SPDX-License-Identifier: Apache-2.0
 *
 * The smooth and the fine gradient against their formulas in double, for each type of samples, in
 * arrays and in blocks; and how the smooth one is mixed into a fine gradient.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "data/volume/sample.h"
#include "draw/resample/gradient.h"
#include "draw/resample/smooth.h"

enum { SIDE = 70, COUNT = SIDE * SIDE * SIDE };

/* A value in [0, 100] that looks random. */
static double value_at(size_t i) {
    uint32_t h = (uint32_t)i * 2654435761u;
    h = (h ^ h >> 15) * 0x5bd1e995u;
    return (double)((h ^ h >> 13) % 101);
}

/* Weight k of the polynomial of degree 3 through samples at −1, 0, 1 and 2, at f. */
static double lagrange(int k, double f) {
    double weight = 1;
    for (int other = 0; other < 4; other++)
        weight *= other == k ? 1 : (f - (other - 1)) / (k - other);
    return weight;
}

/* The weight of sample i for a place at x: of the mean, or of the difference. */
static double weight(int i, double x, bool is_fine, bool is_change) {
    double f = x - floor(x), first = floor(x) - 1;
    const double mean[4] = { 1 - f, 2 - f, 1 + f, f }, change[4] = { f - 1, -f, 1 - f, f };
    int k = i - (int)first;
    if (k < 0 || k > 3)
        return 0;
    if (is_fine)
        return is_change ? lagrange(k, f + 0.5) - lagrange(k, f - 0.5) : lagrange(k, f);
    return is_change ? change[k] / 2 : mean[k] / 4;
}

/* The formula; values are limited to [low, high]. */
static double expected(const void *voxels, enum sp_type type, const double x[3], bool is_fine,
                       int axis, double low, double high) {
    double sum = 0;
    for (int k = (int)x[2] - 1; k < (int)x[2] + 3; k++)
        for (int j = (int)x[1] - 1; j < (int)x[1] + 3; j++)
            for (int i = (int)x[0] - 1; i < (int)x[0] + 3; i++) {
                double value = sp_sample(voxels, type,
                                         ((uint64_t)k * SIDE + (uint64_t)j) * SIDE + (uint64_t)i);
                sum += weight(i, x[0], is_fine, axis == 0) * weight(j, x[1], is_fine, axis == 1) *
                       weight(k, x[2], is_fine, axis == 2) * fmin(fmax(value, low), high);
            }
    return sum;
}

/* The coordinate of a lane's place along an axis: everywhere in the volume. */
static double place(int lane, int axis, int round) {
    return 1 + fmod(17.31 * lane + 23.77 * axis + 11.13 * round, SIDE - 3.1);
}

/* Compares the gradients at many places with the formula. low, high: the values that codes show. */
static void check_samples(const struct sp_samples *samples, const void *voxels, double low,
                          double high) {
    struct sp_resample r = { .samples = samples };
    struct sp_rows reader;
    r.curve.base = low;
    r.curve.codes_per_unit = (CURVE_CODE_MAX - CURVE_CODE_MIN) / (high - low);
    r.curve.data[0] = -1000;
    r.curve.data[1] = 1000;
    sp_rows_init(&reader, &r.curve, samples->voxels, samples->type, SIDE, 1);
    for (int round = 0; round < 40; round++) {
        struct sp_smooth_places places = { .lanes = 0 };
        sp_wide at[3], slope[2][3], alone[3];
        for (int i = 0; i < SP_WIDE; i++) {
            places.lanes |= UINT32_C(1) << i;
            for (int a = 0; a < 3; a++)
                at[a][i] = (float)place(i, a, round);
        }
        sp_smooth_place(samples, at, &places);
        sp_smooth_slopes(&r, &reader, &places, alone);
        sp_fine_slopes(&r, &reader, &places, slope[1], slope[0]);
        for (int i = 0; i < SP_WIDE; i++)
            for (int a = 0; a < 3; a++) {
                const double x[3] = { (double)at[0][i], (double)at[1][i], (double)at[2][i] };
                for (int fine = 0; fine < 2; fine++)
                    assert_float_equal((double)slope[fine][a][i] / r.curve.codes_per_unit,
                                       expected(voxels, samples->type, x, fine, a, low, high),
                                       0.02);
                assert_true(alone[a][i] == slope[0][a][i]);
            }
    }
}

static void they_follow_their_formulas_for_all_types(void **state) {
    (void)state;
    for (int type = 0; type < SP_TYPE_COUNT; type++) {
        char *voxels = malloc(COUNT * sizeof(double));
        struct sp_samples samples = { .voxels = voxels,
                                      .type = (enum sp_type)type,
                                      .dims = { SIDE, SIDE, SIDE } };
        const bool has_sign = type != SP_UINT8 && type != SP_UINT16;
        assert_non_null(voxels);
        for (size_t i = 0; i < COUNT; i++)
            sp_sample_set(voxels, samples.type, i, value_at(i) - (has_sign ? 50 : 0));
        check_samples(&samples, voxels, has_sign ? -50 : 0, has_sign ? 50 : 100);
        check_samples(&samples, voxels, has_sign ? -20 : 30, has_sign ? 10 : 60);
        free(voxels);
    }
}

/* Places near the borders of blocks read from several blocks, of which one is constant. */
static void blocks_give_the_same_as_an_array(void **state) {
    enum { BLOCK = SP_BLOCK_SIDE * SP_BLOCK_SIDE * SP_BLOCK_SIDE };
    struct sp_block parts[8];
    struct sp_blocks blocks = {
        .dims = { SIDE, SIDE, SIDE }, .count = { 2, 2, 2 }, .type = SP_INT16, .block = parts
    };
    int16_t *voxels = malloc(COUNT * sizeof *voxels), *memory = calloc(8 * BLOCK, sizeof *memory);
    (void)state;
    assert_non_null(voxels);
    assert_non_null(memory);
    for (size_t n = 0; n < 8; n++)
        parts[n] = (struct sp_block){ memory + n * BLOCK, n == 3 };
    for (size_t i = 0; i < COUNT; i++) {
        const size_t x = i % SIDE, y = i / SIDE % SIDE, z = i / SIDE / SIDE, bits = SP_BLOCK_BITS;
        const size_t n = (z >> bits) * 4 + (y >> bits) * 2 + (x >> bits), in = SP_BLOCK_SIDE - 1;
        voxels[i] = n == 3 ? 7 : (int16_t)value_at(i);
        memory[n * BLOCK + (((z & in) << bits) + (y & in)) * SP_BLOCK_SIDE + (x & in)] = voxels[i];
    }
    memory[3 * BLOCK] = 7;
    struct sp_samples samples = { .blocks = &blocks,
                                  .type = SP_INT16,
                                  .dims = { SIDE, SIDE, SIDE } };
    check_samples(&samples, voxels, 0, 100);
    free(memory);
    free(voxels);
}

/* NaN, infinities, and values that stand for missing data. */
static void samples_without_data_count_as_the_lowest_code(void **state) {
    static const double none[] = { NAN, INFINITY, -INFINITY, -9999 };
    (void)state;
    for (int type = SP_FLOAT32; type <= SP_FLOAT64; type++) {
        char *voxels = malloc(COUNT * sizeof(double)), *lowest = malloc(COUNT * sizeof(double));
        struct sp_samples samples = { .voxels = voxels,
                                      .type = (enum sp_type)type,
                                      .dims = { SIDE, SIDE, SIDE } };
        assert_non_null(voxels);
        assert_non_null(lowest);
        for (size_t i = 0; i < COUNT; i++) {
            bool is_none = i % 7 == 0;
            sp_sample_set(voxels, samples.type, i, is_none ? none[i / 7 % 4] : value_at(i));
            sp_sample_set(lowest, samples.type, i, is_none ? 10 : value_at(i));
        }
        check_samples(&samples, lowest, 10, 90);
        free(voxels);
        free(lowest);
    }
}

static void mix_one(const double smooth[3], double noise, double sharp, double fine[3]) {
    sp_wide from[3], to[3];
    for (int c = 0; c < 3; c++) {
        from[c] = sp_wide_all((float)smooth[c]);
        to[c] = sp_wide_all((float)fine[c]);
    }
    const sp_wide zero = sp_wide_all(0);
    sp_gradient_mix(from, sp_wide_all((float)noise), sp_wide_all((float)sharp),
                    sp_wide_le(zero, zero), to);
    for (int c = 0; c < 3; c++)
        fine[c] = (double)to[c][0];
}

static double angle(const double a[3], const double b[3]) {
    double dot = 0, aa = 0, bb = 0;
    for (int c = 0; c < 3; c++) {
        dot += a[c] * b[c];
        aa += a[c] * a[c];
        bb += b[c] * b[c];
    }
    return acos(fmin(dot / sqrt(aa * bb), 1));
}

/* At the faces of the longest volume, and of the shortest one, where all samples serve every place.
 */
static void places_at_the_faces_read_no_sample_beyond(void **state) {
    static const uint32_t dims[] = { 4, 5, 32771, 40000, 65536 };
    (void)state;
    for (int i = 0; i < 5; i++) {
        struct sp_samples samples = { .dims = { dims[i], dims[i], dims[i] } };
        for (int k = 0; k < 3; k++) {
            struct sp_smooth_places places;
            sp_wide at[3];
            for (int a = 0; a < 3; a++)
                at[a] = sp_wide_all((float)dims[i] - 0.5f * (float)k - 1);
            sp_smooth_place(&samples, at, &places);
            assert_int_equal(places.first[0][0], dims[i] - 4);
            assert_float_equal((double)places.part[0][0], 1, 1e-6);
        }
    }
}

/* The fine gradient turns towards the smooth one where their difference is noise, and nowhere else.
 */
static void small_differences_are_noise_and_large_ones_are_details(void **state) {
    const double smooth[3] = { 0, 0, 100 };
    (void)state;
    for (double aside = 1; aside < 200; aside *= 1.5) {
        const double start[3] = { aside, 0, 80 };
        double clean[3] = { aside, 0, 80 }, noisy[3] = { aside, 0, 80 };
        mix_one(smooth, 0, 1, clean);
        for (int c = 0; c < 3; c++)
            assert_float_equal(clean[c], start[c], 1e-3 * aside);
        mix_one(smooth, 20 * 20, 1, noisy);
        double left = angle(noisy, smooth) / angle(start, smooth);
        assert_true(aside > 60 ? left > 0.95 : aside < 8 ? left < 0.05 : left < 1);
    }
}

/* Without a share of their own, fine gradients have the direction of smooth ones, also where they
 * vanish or point to the other side. */
static void the_largest_share_limits_what_is_kept(void **state) {
    static const double fines[][3] = { { 50, 20, 60 }, { 0, 0, 0 }, { 10, 5, -80 } };
    const double smooth[3] = { 3, -40, 90 };
    (void)state;
    for (int i = 0; i < 3; i++) {
        double fine[3] = { fines[i][0], fines[i][1], fines[i][2] };
        mix_one(smooth, 0, 0, fine);
        assert_float_equal(angle(fine, smooth), 0, 1e-3);
    }
    double none[3] = { 5, 6, 7 };
    mix_one((const double[3]){ 0, 0, 0 }, 1, 1, none);
    assert_float_equal(angle(none, (const double[3]){ 5, 6, 7 }), 0, 1e-3);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(they_follow_their_formulas_for_all_types),
        cmocka_unit_test(blocks_give_the_same_as_an_array),
        cmocka_unit_test(samples_without_data_count_as_the_lowest_code),
        cmocka_unit_test(places_at_the_faces_read_no_sample_beyond),
        cmocka_unit_test(small_differences_are_noise_and_large_ones_are_details),
        cmocka_unit_test(the_largest_share_limits_what_is_kept),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
