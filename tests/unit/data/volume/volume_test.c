/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/volume.h"
#include "sp/histogram.h"
#include "support/compare.h"

static struct sp_grid grid_of(uint32_t nx, uint32_t ny, uint32_t nz) {
    struct sp_grid grid = { .dims = { nx, ny, nz }, .spacing = { 1, 1, 1 } };
    for (int i = 0; i < 3; i++)
        grid.direction[i][i] = 1;
    return grid;
}

static void types_have_sizes_and_names(void **state) {
    (void)state;
    static const struct {
        enum sp_type type;
        size_t size;
        const char *name;
    } expected[SP_TYPE_COUNT] = {
        { SP_UINT8, 1, "uint8" },     { SP_INT8, 1, "int8" },   { SP_UINT16, 2, "uint16" },
        { SP_INT16, 2, "int16" },     { SP_INT32, 4, "int32" }, { SP_FLOAT32, 4, "float32" },
        { SP_FLOAT64, 8, "float64" },
    };
    for (int i = 0; i < SP_TYPE_COUNT; i++) {
        assert_int_equal(sp_type_size(expected[i].type), expected[i].size);
        assert_string_equal(sp_type_name(expected[i].type), expected[i].name);
    }
}

static void samples_are_copied_and_described(void **state) {
    (void)state;
    struct sp_grid grid = grid_of(3, 2, 2);
    grid.spacing[2] = 4;
    grid.origin[0] = -7;
    int16_t samples[12] = { -5, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 11 };
    struct sp_error err;
    struct sp_volume *volume = sp_volume_create(&grid, SP_INT16, samples, "twelve", &err);
    assert_non_null(volume);
    memset(samples, 0, sizeof samples);
    const struct sp_volume_info *info = sp_volume_info(volume);
    const int16_t *copy = sp_volume_voxels(volume);
    assert_int_equal((uintptr_t)copy % 64, 0);
    assert_int_equal(copy[0], -5);
    assert_int_equal(copy[11], 11);
    assert_memory_equal(&info->grid, &grid, sizeof grid);
    assert_int_equal(info->components, 1);
    assert_int_equal(info->voxel_bytes, 24);
    assert_string_equal(info->name, "twelve");
    assert_string_equal(info->unit, "");
    assert_compare(info->range[0], ==, -5);
    assert_compare(info->range[1], ==, 11);
    /* (3 + 5)/16·256 = 128 */
    assert_int_equal(info->histogram[0], 1);
    assert_int_equal(info->histogram[128], 10);
    assert_int_equal(info->histogram[255], 1);
    sp_volume_unref(&volume);
    assert_null(volume);
    sp_volume_unref(&volume);
}

/* Computes the bins by the definition in sp/volume.h, for each sample in long double. */
static void check_histogram(const struct sp_volume_info *info, const double *values, size_t count) {
    uint64_t bins[SP_HISTOGRAM_BINS] = { 0 }, sum = 0;
    long double low = info->range[0], high = info->range[1];
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(values[i]))
            continue;
        int b = high > low ? (int)floorl(((long double)values[i] - low) * 256 / (high - low)) : 0;
        bins[b > 255 ? 255 : b]++;
        sum++;
    }
    uint64_t total = 0;
    for (int b = 0; b < SP_HISTOGRAM_BINS; b++) {
        assert_int_equal(info->histogram[b], bins[b]);
        total += info->histogram[b];
    }
    assert_int_equal(total, sum);
    assert_int_equal(total + info->nonfinite, count);
}

static void histograms_follow_their_definition(void **state) {
    (void)state;
    enum { N = 70, COUNT = N * N * N };
    struct sp_grid grid = grid_of(N, N, N);
    double *values = malloc(COUNT * sizeof *values);
    void *samples = malloc(COUNT * sizeof *values);
    assert_non_null(values);
    assert_non_null(samples);
    for (int type = 0; type < SP_TYPE_COUNT; type++) {
        uint32_t seed = 7;
        for (int i = 0; i < COUNT; i++) {
            seed = seed * 1664525 + 1013904223;
            int32_t bits = (int32_t)seed;
            switch (type) {
            case SP_UINT8:
                values[i] = ((uint8_t *)samples)[i] = (uint8_t)(bits >> 24);
                break;
            case SP_INT8:
                values[i] = ((int8_t *)samples)[i] = (int8_t)(bits >> 24);
                break;
            case SP_UINT16:
                values[i] = ((uint16_t *)samples)[i] = (uint16_t)(bits >> 16);
                break;
            case SP_INT16:
                values[i] = ((int16_t *)samples)[i] = (int16_t)(bits >> 16);
                break;
            case SP_INT32:
                values[i] = ((int32_t *)samples)[i] = bits;
                break;
            case SP_FLOAT32:
                values[i] = ((float *)samples)[i] = i % 1000 == 3 ? NAN : (float)bits * 1e-7f;
                break;
            default:
                values[i] = ((double *)samples)[i] =
                    i % 1000 == 3 ? (i % 3 ? INFINITY : -INFINITY) : bits * 1e290;
                break;
            }
        }
        struct sp_error err;
        struct sp_volume *volume =
            sp_volume_create(&grid, (enum sp_type)type, samples, "random", &err);
        assert_non_null(volume);
        const struct sp_volume_info *info = sp_volume_info(volume);
        double low = INFINITY, high = -INFINITY;
        for (int i = 0; i < COUNT; i++)
            if (isfinite(values[i])) {
                low = fmin(low, values[i]);
                high = fmax(high, values[i]);
            }
        assert_compare(info->range[0], ==, low);
        assert_compare(info->range[1], ==, high);
        check_histogram(info, values, COUNT);
        sp_volume_unref(&volume);
    }
    free(values);
    free(samples);
}

static void unusual_contents_have_a_valid_range(void **state) {
    (void)state;
    struct sp_grid grid = grid_of(2, 2, 1);
    struct sp_error err;
    const float none[4] = { NAN, INFINITY, -INFINITY, NAN };
    struct sp_volume *volume = sp_volume_create(&grid, SP_FLOAT32, none, "none", &err);
    const struct sp_volume_info *info = sp_volume_info(volume);
    assert_compare(info->range[0], ==, 0);
    assert_compare(info->range[1], ==, 0);
    assert_int_equal(info->nonfinite, 4);
    assert_int_equal(info->histogram[0], 0);
    sp_volume_unref(&volume);

    const float same[4] = { 2.5f, 2.5f, NAN, 2.5f };
    volume = sp_volume_create(&grid, SP_FLOAT32, same, "same", &err);
    info = sp_volume_info(volume);
    assert_compare(info->range[0], ==, 2.5);
    assert_compare(info->range[1], ==, 2.5);
    assert_int_equal(info->nonfinite, 1);
    assert_int_equal(info->histogram[0], 3);
    sp_volume_unref(&volume);

    /* The difference between the extremes overflows a double. */
    const double far[4] = { -1.7e308, 1.7e308, 0, 1.6e308 };
    volume = sp_volume_create(&grid, SP_FLOAT64, far, "far", &err);
    info = sp_volume_info(volume);
    assert_int_equal(info->histogram[0], 1);
    assert_int_equal(info->histogram[128], 1);
    assert_int_equal(info->histogram[248], 1);
    assert_int_equal(info->histogram[255], 1);
    sp_volume_unref(&volume);
}

/* Ranges that are too small for a quotient: half of the first one is denormal, and workers flush
 * denormals to zero. */
static void tiny_ranges_have_a_histogram(void **state) {
    (void)state;
    enum { N = 80, COUNT = N * N * N }; /* for several workers, each with one of the values first */
    const struct sp_grid grid = grid_of(N, N, N);
    const double ends[] = { 3e-308, 1e-306, 1e-310, 5e-324 };
    double *samples = malloc(COUNT * sizeof *samples);
    assert_non_null(samples);
    for (size_t e = 0; e < sizeof ends / sizeof ends[0]; e++)
        for (int is_low = 0; is_low < 2; is_low++) {
            for (int i = 0; i < COUNT; i++)
                samples[i] = (i < COUNT / 2) == is_low ? 0 : ends[e];
            struct sp_error err;
            struct sp_volume *volume = sp_volume_create(&grid, SP_FLOAT64, samples, "tiny", &err);
            assert_non_null(volume);
            const struct sp_volume_info *info = sp_volume_info(volume);
            uint64_t total = 0;
            for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
                total += info->histogram[b];
            assert_int_equal(total, COUNT);
            if (ends[e] > DBL_MIN) {
                assert_int_equal(info->histogram[0], COUNT / 2);
                assert_int_equal(info->histogram[255], COUNT / 2);
            }
            struct sp_joint_histogram joint;
            assert_true(sp_joint_histogram_count(volume, &joint, &err));
            sp_volume_unref(&volume);
        }
    free(samples);
}

static void bad_grids_are_refused(void **state) {
    (void)state;
    const uint8_t sample = 0;
    struct sp_error err;
    struct sp_grid grid = grid_of(1, 0, 1);
    assert_null(sp_volume_create(&grid, SP_UINT8, &sample, "x", &err));
    assert_int_equal(err.code, SP_ERR_FORMAT);
    assert_non_null(strstr(err.text, "dims[1] is 0"));
    grid = grid_of(SP_DIM_MAX, SP_DIM_MAX, SP_DIM_MAX);
    assert_null(sp_volume_create(&grid, SP_UINT8, &sample, "x", &err));
    assert_non_null(strstr(err.text, "voxels"));
    const double bad_spacing[] = { 0, -1, NAN, INFINITY, 1e-300 };
    for (size_t i = 0; i < sizeof bad_spacing / sizeof bad_spacing[0]; i++) {
        grid = grid_of(1, 1, 1);
        grid.spacing[2] = bad_spacing[i];
        assert_null(sp_volume_create(&grid, SP_UINT8, &sample, "x", &err));
        assert_non_null(strstr(err.text, "spacing[2]"));
    }
    grid = grid_of(1, 1, 1);
    grid.origin[1] = NAN;
    assert_null(sp_volume_create(&grid, SP_UINT8, &sample, "x", &err));
    assert_non_null(strstr(err.text, "origin[1]"));
    grid = grid_of(1, 1, 1);
    grid.direction[0][0] = 2;
    assert_null(sp_volume_create(&grid, SP_UINT8, &sample, "x", &err));
    assert_non_null(strstr(err.text, "length 2"));
    grid = grid_of(1, 1, 1);
    for (int row = 0; row < 3; row++)
        grid.direction[row][1] = grid.direction[row][0];
    assert_null(sp_volume_create(&grid, SP_UINT8, &sample, "x", &err));
    assert_non_null(strstr(err.text, "singular"));
    assert_null(sp_volume_create(&grid, SP_UINT8, &sample, "x", NULL));
}

static void the_volume_copies_its_coordinates(void **state) {
    (void)state;
    double x[4] = { 0, 1, 3, 6 }, z[2] = { 0, 0.5 };
    struct sp_grid grid = grid_of(4, 3, 2);
    grid.coordinates[0] = x;
    grid.coordinates[2] = z;
    grid.spacing[0] = 2;
    grid.spacing[2] = 0.5;
    const uint8_t samples[24] = { 0 };
    struct sp_error err;
    struct sp_volume *volume = sp_volume_create(&grid, SP_UINT8, samples, "graded", &err);
    assert_non_null(volume);
    const struct sp_grid *copy = &sp_volume_info(volume)->grid;
    memset(x, 0, sizeof x);
    memset(z, 0, sizeof z);
    assert_memory_equal(copy->coordinates[0], ((double[]){ 0, 1, 3, 6 }), sizeof x);
    assert_null(copy->coordinates[1]);
    assert_memory_equal(copy->coordinates[2], ((double[]){ 0, 0.5 }), sizeof z);
    sp_volume_unref(&volume);
}

static void coordinates_give_the_positions_of_samples(void **state) {
    (void)state;
    const double x[4] = { 0, 1, 3, 6 };
    struct sp_grid grid = grid_of(4, 3, 1);
    assert_false(sp_grid_is_rectilinear(&grid));
    grid.coordinates[0] = x;
    grid.spacing[0] = 2;
    grid.spacing[2] = 5;
    assert_true(sp_grid_is_rectilinear(&grid));
    double extent[2];
    sp_grid_extent(&grid, 0, extent);
    assert_compare(extent[0], ==, -0.5);
    assert_compare(extent[1], ==, 7.5);
    sp_grid_extent(&grid, 1, extent);
    assert_compare(extent[0], ==, -0.5);
    assert_compare(extent[1], ==, 2.5);
    sp_grid_extent(&grid, 2, extent);
    assert_compare(extent[0], ==, -2.5);
    assert_compare(extent[1], ==, 2.5);
    static const double local[4] = { 1, 1.5, 2.5, 3 };
    for (uint32_t i = 0; i < 4; i++) {
        assert_compare(sp_grid_distance(&grid, 0, i), ==, x[i]);
        assert_compare(sp_grid_local_spacing(&grid, 0, i), ==, local[i]);
    }
    assert_compare(sp_grid_distance(&grid, 1, 2), ==, 2);
    assert_compare(sp_grid_local_spacing(&grid, 1, 2), ==, 1);
    assert_compare(sp_grid_local_spacing(&grid, 2, 0), ==, 5);
}

static void bad_coordinates_are_refused(void **state) {
    (void)state;
    static const struct {
        double x[4], spacing;
        const char *text;
    } cases[] = {
        { { 1, 2, 3, 4 }, 1, "coordinates[1] begin at 1; they must begin at 0" },
        { { NAN, 1, 2, 3 }, 1, "begin at nan" },
        { { 0, 1, 1, 3 },
          1,
          "the step from element 1 (1) to the next (1) is outside [1e-12, 1e12]" },
        { { 0, 2, 1, 3 }, 1, "from element 1 (2) to the next (1)" },
        { { 0, 1, 2, NAN }, 1, "from element 2" },
        { { 0, 1, INFINITY, INFINITY }, 1, "from element 1" },
        { { 0, 1e-13, 1, 3 }, 1, "from element 0" },
        { { 0, 1, 2, 2e12 }, 1, "from element 2" },
        { { 0, 1e-7, 1, 3 }, 1, "gaps from 1e-07 to 2, more than a factor of 1e+06" },
        { { 0, 1, 2, 3 }, 1.01, "spacing[1] is 1.01 instead of the coordinates' mean, 1" },
        { { 0, 1, 2, 3 }, NAN, "spacing[1] is nan instead" },
        { { 0, 1, 2, 3 }, 1, NULL },
    };
    const uint8_t samples[8] = { 0 };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct sp_grid grid = grid_of(2, 4, 1);
        struct sp_error err = { .text = "" };
        grid.coordinates[1] = cases[i].x;
        grid.spacing[1] = cases[i].spacing;
        struct sp_volume *volume = sp_volume_create(&grid, SP_UINT8, samples, "x", &err);
        if (!volume != !!cases[i].text || (cases[i].text && !strstr(err.text, cases[i].text)))
            fail_msg("case %zu: %s", i, err.text);
        if (cases[i].text) {
            assert_int_equal(err.code, SP_ERR_FORMAT);
            assert_int_equal(sp_grid_invalid_field(&grid), SP_GRID_COORDINATES);
        }
        sp_volume_unref(&volume);
    }
    /* The limit of the origin is relative to the smallest gap, not to the mean gap. */
    const double x[4] = { 0, 1e-3, 1, 3 };
    struct sp_grid grid = grid_of(2, 4, 1);
    grid.coordinates[1] = x;
    grid.origin[0] = 0x1p31;
    assert_int_equal(sp_grid_invalid_field(&grid), SP_GRID_ORIGIN);
    grid.origin[0] = 0x1p30;
    assert_int_equal(sp_grid_invalid_field(&grid), SP_GRID_GOOD);
}

static void *ref_and_unref_often(void *arg) {
    struct sp_volume *volume = arg;
    for (int i = 0; i < 10000; i++) {
        struct sp_volume *mine = sp_volume_ref(volume);
        assert_ptr_equal(mine, volume);
        sp_volume_unref(&mine);
    }
    sp_volume_unref(&volume);
    return NULL;
}

static atomic_int released;

static void count_release(void *voxels, size_t bytes) {
    assert_int_equal(bytes, 64);
    free(voxels);
    released++;
}

static void the_last_unref_frees_the_samples_once(void **state) {
    (void)state;
    enum { THREADS = 4 };
    pthread_t threads[THREADS];
    struct sp_volume_info info = { .grid = grid_of(4, 4, 4), .type = SP_UINT8, .name = "shared" };
    void *voxels = aligned_alloc(64, 64);
    assert_non_null(voxels);
    memset(voxels, 1, 64);
    struct sp_error err;
    struct sp_volume *volume = sp_volume_adopt(&info, voxels, NULL, 64, count_release, &err);
    assert_non_null(volume);
    for (int t = 0; t < THREADS; t++)
        assert_int_equal(
            pthread_create(&threads[t], NULL, ref_and_unref_often, sp_volume_ref(volume)), 0);
    sp_volume_unref(&volume);
    for (int t = 0; t < THREADS; t++)
        pthread_join(threads[t], NULL);
    assert_int_equal(released, 1);
}

static void vectors_are_copied_and_shared_with_derived_volumes(void **state) {
    (void)state;
    enum { COUNT = 3 * 5 * 2 };
    struct sp_grid grid = grid_of(3, 5, 2);
    uint8_t values[COUNT];
    float vectors[COUNT][3];
    for (int i = 0; i < COUNT; i++) {
        values[i] = (uint8_t)i;
        for (int c = 0; c < 3; c++)
            vectors[i][c] = (float)(i * (c + 1));
    }
    vectors[7][1] = NAN;
    vectors[COUNT - 1][2] = INFINITY;
    struct sp_error err;
    struct sp_volume *volume =
        sp_volume_create_vectors(&grid, SP_UINT8, values, (const float(*)[3])vectors, "flow", &err);
    assert_non_null(volume);
    const struct sp_volume_info *info = sp_volume_info(volume);
    assert_int_equal(info->voxel_bytes, COUNT);
    assert_int_equal(info->vector_bytes, sizeof vectors);
    assert_memory_equal(sp_volume_voxels(volume), values, sizeof values);
    assert_memory_equal(sp_volume_vectors(volume), vectors, sizeof vectors);
    assert_true(fabs(info->longest - (COUNT - 2) * sqrt(14)) < 1e-12 * info->longest);

    uint8_t *others = aligned_alloc(64, 64);
    assert_non_null(others);
    memset(others, 3, 64);
    struct sp_volume *derived =
        sp_volume_derive(volume, SP_UINT8, 2, others, 64, count_release, &err);
    assert_non_null(derived);
    assert_int_equal(sp_volume_info(derived)->nonfinite, 2);
    sp_volume_unref(&volume);
    assert_memory_equal(sp_volume_vectors(derived), vectors, sizeof vectors);
    sp_volume_unref(&derived);

    volume = sp_volume_create(&grid, SP_UINT8, values, "plain", &err);
    assert_non_null(volume);
    assert_null(sp_volume_vectors(volume));
    assert_int_equal(sp_volume_info(volume)->vector_bytes, 0);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(types_have_sizes_and_names),
        cmocka_unit_test(samples_are_copied_and_described),
        cmocka_unit_test(histograms_follow_their_definition),
        cmocka_unit_test(unusual_contents_have_a_valid_range),
        cmocka_unit_test(tiny_ranges_have_a_histogram),
        cmocka_unit_test(bad_grids_are_refused),
        cmocka_unit_test(the_volume_copies_its_coordinates),
        cmocka_unit_test(coordinates_give_the_positions_of_samples),
        cmocka_unit_test(bad_coordinates_are_refused),
        cmocka_unit_test(the_last_unref_frees_the_samples_once),
        cmocka_unit_test(vectors_are_copied_and_shared_with_derived_volumes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
