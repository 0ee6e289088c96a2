/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements in analytic fields, on anisotropic, rotated, sheared and rectilinear grids.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sp/measure.h"
#include "support/compare.h"

enum { N = 12 };

/* cmocka compares floating-point numbers as float, which is too coarse here. */
static void assert_near(double value, double expected, double tolerance) {
    if (!(fabs(value - expected) <= tolerance))
        fail_msg("%.17g differs from %.17g by more than %g", value, expected, tolerance);
}

static const double identity[3][3] = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } };
/* A rotation by an angle with the sine 0.6 around z, then one around x. */
static const double rotated[3][3] = { { 0.8, -0.6, 0 },
                                      { 0.6 * 0.8, 0.8 * 0.8, -0.6 },
                                      { 0.6 * 0.6, 0.8 * 0.6, 0.8 } };
/* Axis 1 leans towards axis 0. */
static const double sheared[3][3] = { { 1, 0.6, 0 }, { 0, 0.8, 0 }, { 0, 0, 1 } };

static double linear(const double p[3]) {
    return 7 + 2 * p[0] - 3 * p[1] + 0.5 * p[2];
}

static struct sp_grid grid_of(double s0, double s1, double s2, const double direction[3][3]) {
    struct sp_grid grid = { .dims = { N, N, N },
                            .spacing = { s0, s1, s2 },
                            .origin = { 10, -20, 30 } };
    memcpy(grid.direction, direction, sizeof grid.direction);
    return grid;
}

static void world_of(const struct sp_grid *grid, const double index[3], double world[3]) {
    double along[3];
    for (int a = 0; a < 3; a++) {
        const double *c = grid->coordinates[a];
        int low = (int)index[a];
        if (low == N - 1)
            low--;
        along[a] =
            c ? c[low] + (c[low + 1] - c[low]) * (index[a] - low) : grid->spacing[a] * index[a];
    }
    for (int row = 0; row < 3; row++) {
        world[row] = grid->origin[row];
        for (int a = 0; a < 3; a++)
            world[row] += grid->direction[row][a] * along[a];
    }
}

static struct sp_volume *field(const struct sp_grid *grid, double (*value)(const double p[3])) {
    double *voxels = malloc(sizeof *voxels * N * N * N);
    struct sp_error err = { 0 };
    assert_non_null(voxels);
    for (int i = 0; i < N * N * N; i++) {
        double index[3] = { i % N, i / N % N, i / N / N }, world[3];
        world_of(grid, index, world);
        voxels[i] = value(world);
    }
    struct sp_volume *volume = sp_volume_create(grid, SP_FLOAT64, voxels, "field", &err);
    free(voxels);
    assert_non_null(volume);
    return volume;
}

/* A measurement whose points are given as indices. */
static struct sp_measure at_indices(const struct sp_grid *grid, enum sp_measure_kind kind,
                                    const double indices[3][3]) {
    struct sp_measure measure = { .kind = kind };
    for (unsigned i = 0; i < sp_measure_point_count(kind); i++)
        world_of(grid, indices[i], measure.points[i]);
    return measure;
}

static struct sp_measure_result compute(const struct sp_volume *volume,
                                        const struct sp_measure *measure) {
    struct sp_measure_result result;
    struct sp_error err = { 0 };
    if (!sp_measure_compute(volume, measure, &result, &err))
        fail_msg("%s: %s", err.place, err.text);
    return result;
}

static void lengths_and_angles_are_those_of_the_world(void **state) {
    (void)state;
    const struct sp_grid grids[] = { grid_of(1, 1, 1, identity), grid_of(0.5, 1, 3, rotated),
                                     grid_of(1, 2, 1, sheared) };
    const struct sp_measure distance = { .kind = SP_MEASURE_DISTANCE,
                                         .points = { { 1, 2, 3 }, { 4, 6, 15 } } };
    const struct sp_measure right = { .kind = SP_MEASURE_ANGLE,
                                      .points = { { 5, 0, 0 }, { 0, 0, 0 }, { 0, 0, 2 } } };
    const struct sp_measure flat = { .kind = SP_MEASURE_ANGLE,
                                     .points = { { -1, 0, 0 }, { 0, 0, 0 }, { 3, 0, 0 } } };
    const struct sp_measure sixty = {
        .kind = SP_MEASURE_ANGLE, .points = { { 1, 0, 0 }, { 0, 0, 0 }, { 0.5, sqrt(0.75), 0 } }
    };
    for (size_t i = 0; i < sizeof grids / sizeof *grids; i++) {
        struct sp_volume *volume = field(&grids[i], linear);
        const struct sp_measure_result result = compute(volume, &distance);
        assert_near(result.value, 13, 1e-12);
        assert_int_equal(result.unit, SP_MEASURE_LENGTH);
        assert_false(result.has_statistics);
        assert_near(compute(volume, &right).value, 90, 1e-12);
        assert_near(compute(volume, &flat).value, 180, 1e-12);
        assert_near(compute(volume, &sixty).value, 60, 1e-12);
        assert_int_equal(compute(volume, &sixty).unit, SP_MEASURE_DEGREES);
        sp_volume_unref(&volume);
    }
}

static void a_linear_field_is_interpolated_exactly(void **state) {
    (void)state;
    static const double uneven[N] = { 0, 1, 1.5, 3, 4, 4.25, 6, 7, 9, 9.5, 10, 12 };
    struct sp_grid grids[] = { grid_of(1, 1, 1, identity), grid_of(0.5, 1, 3, rotated),
                               grid_of(1, 2, 1, sheared), grid_of(2, 12.0 / (N - 1), 1, rotated) };
    grids[3].coordinates[1] = uneven;
    const double inside[][3] = {
        { 0, 0, 0 }, { N - 1, N - 1, N - 1 }, { 3.25, 7.5, 1.125 }, { 10.75, 0.5, 10.5 }
    };
    for (size_t g = 0; g < sizeof grids / sizeof *grids; g++) {
        struct sp_volume *volume = field(&grids[g], linear);
        for (size_t i = 0; i < sizeof inside / sizeof *inside; i++) {
            double world[3], value = NAN;
            world_of(&grids[g], inside[i], world);
            assert_true(sp_measure_value(volume, world, &value));
            assert_near(value, linear(world), 1e-9);
        }
        sp_volume_unref(&volume);
    }
}

static void the_volume_ends_half_a_gap_behind_its_last_sample(void **state) {
    (void)state;
    struct sp_grid grid = grid_of(2, 2, 2, identity);
    struct sp_volume *volume = field(&grid, linear);
    double value = NAN;
    const double border[3] = { 10 + 2 * (N - 1) + 0.99, -20, 30 };
    const double beyond[3] = { 10 + 2 * (N - 1) + 1.01, -20, 30 }, before[3] = { 10, -21.01, 30 };
    const double last[3] = { 10 + 2 * (N - 1), -20, 30 };
    assert_true(sp_measure_value(volume, border, &value));
    assert_near(value, linear(last), 1e-12);
    assert_false(sp_measure_value(volume, beyond, &value));
    assert_false(sp_measure_value(volume, before, &value));
    struct sp_measure marker = { .kind = SP_MEASURE_MARKER };
    memcpy(marker.points[0], beyond, sizeof beyond);
    assert_false(compute(volume, &marker).has_value);
    memcpy(marker.points[0], border, sizeof border);
    assert_true(compute(volume, &marker).has_value);
    sp_volume_unref(&volume);
}

static void a_profile_has_equal_steps(void **state) {
    (void)state;
    struct sp_grid grid = grid_of(0.5, 1, 3, rotated);
    struct sp_volume *volume = field(&grid, linear);
    /* The line begins inside and ends outside of the volume. */
    struct sp_measure profile = at_indices(
        &grid, SP_MEASURE_PROFILE, (const double[3][3]){ { 1, 2, 3 }, { 9, 4, 5 }, { 0, 0, 0 } });
    double values[9];
    sp_measure_profile(volume, &profile, 9, values);
    for (int i = 0; i < 9; i++) {
        double p[3];
        for (int a = 0; a < 3; a++)
            p[a] = profile.points[0][a] + (profile.points[1][a] - profile.points[0][a]) * i / 8;
        assert_near(values[i], linear(p), 1e-9);
    }
    const struct sp_measure_result result = compute(volume, &profile);
    assert_true(result.has_statistics);
    assert_near(result.statistics.mean, (values[0] + values[8]) / 2, 1e-9);
    assert_near(result.statistics.min, fmin(values[0], values[8]), 1e-9);
    assert_near(result.value, sqrt(16 + 4 + 36), 1e-9);
    assert_int_equal(sp_measure_profile_count(volume, &profile),
                     (int)ceil(sqrt(16 + 4 + 36) / 0.25) + 1);
    for (int a = 0; a < 3; a++)
        profile.points[1][a] += 1000;
    sp_measure_profile(volume, &profile, 9, values);
    assert_near(values[0], linear(profile.points[0]), 1e-9);
    assert_true(isnan(values[8]));
    assert_compare(sp_measure_profile_count(volume, &profile), ==, 1024);
    sp_volume_unref(&volume);
}

/* The plane lies between two slices of samples, and the borders go through centres. */
static void a_rectangle_has_the_samples_inside_and_on_its_border(void **state) {
    (void)state;
    const struct sp_grid grids[] = { grid_of(1, 1, 1, identity), grid_of(0.5, 1, 3, rotated) };
    for (size_t g = 0; g < sizeof grids / sizeof *grids; g++) {
        struct sp_volume *volume = field(&grids[g], linear);
        for (int third = 0; third < 3; third++) {
            const int columns = third == 0 ? 1 : 0, rows = third == 2 ? 1 : 2;
            double indices[3][3] = { { 0 }, { 0 }, { 0 } }, sum = 0, squares = 0;
            for (int i = 0; i < 3; i++) {
                indices[i][third] = 4.5;
                indices[i][columns] = i == 1 ? 8 : 2;
                indices[i][rows] = i == 2 ? 5 : 3;
            }
            const struct sp_measure region = at_indices(&grids[g], SP_MEASURE_RECTANGLE, indices);
            const struct sp_measure_result result = compute(volume, &region);
            for (int pass = 0; pass < 2; pass++)
                for (int i = 2; i <= 8; i++)
                    for (int j = 3; j <= 5; j++) {
                        double index[3], world[3];
                        index[third] = 4.5;
                        index[columns] = i;
                        index[rows] = j;
                        world_of(&grids[g], index, world);
                        if (pass == 0)
                            sum += linear(world);
                        else
                            squares += pow(linear(world) - sum / 21, 2);
                    }
            assert_int_equal(result.statistics.count, 21);
            assert_near(result.statistics.mean, sum / 21, 1e-9);
            assert_near(result.statistics.deviation, sqrt(squares / 20), 1e-9);
            assert_near(result.value, 6 * grids[g].spacing[columns] * 2 * grids[g].spacing[rows],
                        1e-9);
            uint64_t counted = 0;
            for (int b = 0; b < SP_MEASURE_BINS; b++)
                counted += result.histogram[b];
            assert_int_equal(counted, 21);
        }
        sp_volume_unref(&volume);
    }
}

static void an_ellipse_has_the_samples_inside(void **state) {
    (void)state;
    const struct sp_grid grid = grid_of(1, 2, 1, rotated);
    struct sp_volume *volume = field(&grid, linear);
    /* Semi-axes of 4 and 3 samples around sample (5, 6). */
    const struct sp_measure region = at_indices(
        &grid, SP_MEASURE_ELLIPSE, (const double[3][3]){ { 5, 6, 2 }, { 9, 6, 2 }, { 5, 9, 2 } });
    const struct sp_measure_result result = compute(volume, &region);
    int inside = 0;
    double centre[3];
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            inside += pow((i - 5) / 4.0, 2) + pow((j - 6) / 3.0, 2) <= 1;
    world_of(&grid, (const double[3]){ 5, 6, 2 }, centre);
    assert_int_equal(result.statistics.count, inside);
    assert_near(result.statistics.mean, linear(centre), 1e-9);
    assert_near(result.value, 3.14159265358979 * 4 * 6, 1e-9);
    sp_volume_unref(&volume);
}

static double distance_of_x(const double p[3]) {
    return p[0] - 10;
}

/* Each sample has the area of its cell as its weight, so that the mean does not depend on where the
 * grid is dense. */
static void samples_of_a_rectilinear_grid_have_weights(void **state) {
    (void)state;
    static const double uneven[N] = { 0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20 };
    struct sp_grid grid = grid_of(20.0 / (N - 1), 1, 1, identity);
    grid.coordinates[0] = uneven;
    struct sp_volume *volume = field(&grid, distance_of_x);
    const struct sp_measure region = { .kind = SP_MEASURE_RECTANGLE,
                                       .points = {
                                           { 9.5, -19, 33 }, { 32, -19, 33 }, { 9.5, -15, 33 } } };
    const struct sp_measure_result result = compute(volume, &region);
    double sum = 0, weights = 0, squares = 0, moment = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < N; i++) {
            const int low = i ? i - 1 : 0, high = i < N - 1 ? i + 1 : i;
            const double w = (uneven[high] - uneven[low]) / (high - low);
            if (pass == 0) {
                sum += 5 * w * uneven[i];
                weights += 5 * w;
                squares += 5 * w * w;
            } else {
                moment += 5 * w * pow(uneven[i] - sum / weights, 2);
            }
        }
    assert_int_equal(result.statistics.count, 5 * N);
    assert_near(result.statistics.mean, sum / weights, 1e-9);
    assert_near(result.statistics.deviation, sqrt(moment / (weights - squares / weights)), 1e-9);
    assert_near(result.value, 22.5 * 4, 1e-9);
    sp_volume_unref(&volume);
}

static void an_oblique_region_is_interpolated(void **state) {
    (void)state;
    const struct sp_grid grid = grid_of(1, 1, 1, identity);
    struct sp_volume *volume = field(&grid, linear);
    /* A square of 4 by 4 around the middle, in the plane of (1, 1, 0) and z. */
    const double h = 4 / sqrt(8), c[3] = { 15, -15, 35 };
    const struct sp_measure region = { .kind = SP_MEASURE_RECTANGLE,
                                       .points = { { c[0] - h, c[1] - h, c[2] - 2 },
                                                   { c[0] + h, c[1] + h, c[2] - 2 },
                                                   { c[0] - h, c[1] - h, c[2] + 2 } } };
    const struct sp_measure_result result = compute(volume, &region);
    assert_int_equal(result.statistics.count, 16);
    assert_near(result.statistics.mean, linear(c), 1e-9);
    assert_near(result.value, 16, 1e-9);
    sp_volume_unref(&volume);
}

/* One NaN, beside a sample and between two slices. */
static void samples_that_are_not_finite_are_counted_apart(void **state) {
    (void)state;
    const struct sp_grid grid = grid_of(1, 1, 1, identity);
    struct sp_error err;
    float voxels[N * N * N];
    for (int i = 0; i < N * N * N; i++)
        voxels[i] = (float)(i % N);
    voxels[5 + N * 5 + N * N * 5] = NAN;
    voxels[6 + N * 5 + N * N * 5] = INFINITY;
    struct sp_volume *volume = sp_volume_create(&grid, SP_FLOAT32, voxels, "nan", &err);
    const double z[] = { 5, 5.5, 6 };
    const int nonfinite[] = { 2, 2, 0 };
    for (int i = 0; i < 3; i++) {
        const struct sp_measure region =
            at_indices(&grid, SP_MEASURE_RECTANGLE,
                       (const double[3][3]){ { 4, 4, z[i] }, { 7, 4, z[i] }, { 4, 6, z[i] } });
        const struct sp_measure_result result = compute(volume, &region);
        assert_int_equal(result.statistics.nonfinite, nonfinite[i]);
        assert_int_equal(result.statistics.count, 12 - nonfinite[i]);
        assert_near(result.statistics.min, 4, 1e-12);
        assert_near(result.statistics.max, 7, 1e-12);
    }
    struct sp_measure marker = { .kind = SP_MEASURE_MARKER, .points = { { 15, -15, 35 } } };
    assert_false(compute(volume, &marker).has_value);
    marker.points[0][2] += 1; /* the value of the NaN has the weight 0 */
    assert_true(compute(volume, &marker).has_value);
    sp_volume_unref(&volume);
}

static void a_region_outside_of_the_volume_is_empty(void **state) {
    (void)state;
    const struct sp_grid grid = grid_of(1, 1, 1, identity);
    struct sp_volume *volume = field(&grid, linear);
    const struct sp_measure beside = { .kind = SP_MEASURE_RECTANGLE,
                                       .points = {
                                           { 15, -15, 29 }, { 18, -15, 29 }, { 15, -12, 29 } } };
    const struct sp_measure_result result = compute(volume, &beside);
    assert_int_equal(result.statistics.count, 0);
    assert_false(result.has_histogram);
    assert_near(result.value, 9, 1e-12);
    /* A part of it is inside. */
    const struct sp_measure wide = {
        .kind = SP_MEASURE_RECTANGLE,
        .points = { { -1e9, -1e9, 31 }, { 1e9, -1e9, 31 }, { -1e9, 1e9, 31 } }
    };
    assert_int_equal(compute(volume, &wide).statistics.count, N * N);
    sp_volume_unref(&volume);
}

static double outside_of(const struct sp_volume *volume, enum sp_measure_kind kind,
                         const double points[3][3]) {
    struct sp_measure measure = { .kind = kind };
    memcpy(measure.points, points, sizeof measure.points);
    return compute(volume, &measure).outside;
}

/* The volume reaches from -0.5 to 11.5 samples along each axis. */
static void the_share_outside_is_that_of_the_geometry(void **state) {
    (void)state;
    const struct sp_grid grids[] = { grid_of(1, 1, 1, identity), grid_of(1.5, 0.5, 2, rotated),
                                     grid_of(1, 2, 1, sheared) };
    const struct {
        enum sp_measure_kind kind;
        double indices[3][3];
        double outside;
    } cases[] = {
        { SP_MEASURE_MARKER, { { 11.5, 0, 0 } }, 0 },
        { SP_MEASURE_MARKER, { { 11.6, 0, 0 } }, 1 },
        { SP_MEASURE_DISTANCE, { { 0, 0, 0 }, { 11, 11, 11 } }, 0 },
        { SP_MEASURE_DISTANCE, { { -1.5, 2, 2 }, { 2.5, 2, 2 } }, 0.25 },
        { SP_MEASURE_DISTANCE, { { 3, 3, 3 }, { 3, 3, 3 } }, 0 },
        { SP_MEASURE_DISTANCE, { { 13, 3, 3 }, { 13, 3, 3 } }, 1 },
        { SP_MEASURE_PROFILE, { { 13, -5, 3 }, { 25, 20, 4 } }, 1 },
        { SP_MEASURE_PROFILE, { { 5, 5, -12.5 }, { 5, 5, 23.5 } }, 2.0 / 3 },
    };
    for (size_t g = 0; g < sizeof grids / sizeof *grids; g++) {
        struct sp_volume *volume = field(&grids[g], linear);
        for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
            const struct sp_measure measure =
                at_indices(&grids[g], cases[i].kind, cases[i].indices);
            assert_near(compute(volume, &measure).outside, cases[i].outside, 1e-8);
        }
        sp_volume_unref(&volume);
    }
}

static void nothing_is_outside_of_a_volume_of_elements(void **state) {
    float positions[2][3] = { { 0, 0, 0 }, { 1, 1, 1 } }, factors[2][6] = { { 0 } };
    float values[2] = { 3, 4 }, volumes[2] = { 1, 1 };
    const struct sp_elements points = { .shape = { .kind = SP_KIND_POINTS, .count = 2 },
                                        .positions = positions,
                                        .factors = factors,
                                        .values = values,
                                        .volumes = volumes };
    struct sp_volume *volume = sp_volume_create_elements(&points, "points", NULL);
    (void)state;
    assert_non_null(volume);
    struct sp_measure measure = { .kind = SP_MEASURE_DISTANCE,
                                  .points = { { -9, 0, 0 }, { 0, 0, 0 } } };
    struct sp_measure_result result = compute(volume, &measure);
    assert_near(result.value, 9, 1e-12);
    assert_near(result.outside, 0, 0);
    measure.kind = SP_MEASURE_MARKER;
    result = compute(volume, &measure);
    assert_false(result.has_value);
    assert_near(result.outside, 0, 0);
    sp_volume_unref(&volume);
}

static void the_share_outside_of_a_region_is_that_of_its_area(void **state) {
    (void)state;
    const struct sp_grid grid = grid_of(1, 1, 1, identity); /* x 9.5 to 21.5, y -20.5 to -8.5 */
    struct sp_volume *volume = field(&grid, linear);
    const double inside[3][3] = { { 9.5, -20.5, 33 }, { 21.5, -20.5, 33 }, { 9.5, -8.5, 33 } };
    const double corner[3][3] = { { 17.5, -12.5, 33 }, { 25.5, -12.5, 33 }, { 17.5, -4.5, 33 } };
    const double around[3][3] = { { 3.5, -26.5, 33 }, { 27.5, -26.5, 33 }, { 3.5, -2.5, 33 } };
    const double apart[3][3] = { { 11, -12, 50 }, { 12, -12, 50 }, { 11, -11, 50 } };
    const double half[3][3] = { { 21.5, -14.5, 33 }, { 23.5, -14.5, 33 }, { 21.5, -10.5, 33 } };
    /* Oblique: z rises from 29.5, where the volume begins, minus 1 to 30.5. */
    const double oblique[3][3] = { { 12, -12, 28.5 }, { 14, -12, 30.5 }, { 12, -14, 28.5 } };
    assert_near(outside_of(volume, SP_MEASURE_RECTANGLE, inside), 0, 0);
    assert_near(outside_of(volume, SP_MEASURE_RECTANGLE, corner), 0.75, 1e-8);
    assert_near(outside_of(volume, SP_MEASURE_RECTANGLE, around), 0.75, 1e-8);
    assert_near(outside_of(volume, SP_MEASURE_RECTANGLE, apart), 1, 0);
    assert_near(outside_of(volume, SP_MEASURE_RECTANGLE, oblique), 0.5, 1e-8);
    assert_near(outside_of(volume, SP_MEASURE_ELLIPSE, half), 0.5, 1e-8);
    assert_near(outside_of(volume, SP_MEASURE_ELLIPSE, apart), 1, 0);
    /* Of the disc around the middle with the radius 6·√2, the square has 2 ÷ π. */
    const double root = 6 * 1.4142135623730951;
    const double disc[3][3] = { { 15.5, -14.5, 33 },
                                { 15.5 + root, -14.5, 33 },
                                { 15.5, -14.5 + root, 33 } };
    assert_near(outside_of(volume, SP_MEASURE_ELLIPSE, disc), 1 - 2 / 3.14159265358979, 2e-4);
    sp_volume_unref(&volume);
}

static void a_flat_volume_has_a_plane(void **state) {
    (void)state;
    const uint8_t voxels[4] = { 1, 2, 3, 6 };
    struct sp_grid grid = grid_of(1, 1, 5, identity);
    struct sp_error err;
    grid.dims[0] = grid.dims[1] = 2;
    grid.dims[2] = 1;
    struct sp_volume *volume = sp_volume_create(&grid, SP_UINT8, voxels, "flat", &err);
    const struct sp_measure region = {
        .kind = SP_MEASURE_RECTANGLE, .points = { { 9, -21, 32 }, { 12, -21, 32 }, { 9, -18, 32 } }
    };
    assert_int_equal(compute(volume, &region).statistics.count, 4);
    assert_near(compute(volume, &region).statistics.mean, 3, 1e-12);
    sp_volume_unref(&volume);
}

static void refused(const struct sp_volume *volume, struct sp_measure measure, const char *place) {
    struct sp_measure_result result;
    struct sp_error err = { 0 };
    assert_false(sp_measure_compute(volume, &measure, &result, &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_string_equal(err.place, place);
}

/* People count from the first point; pointers count from 0. */
static void errors_name_points_by_their_order(void **state) {
    (void)state;
    const struct sp_measure angle = { .kind = SP_MEASURE_ANGLE, .points = { { 1 }, { 1 }, { 2 } } };
    const struct sp_measure slanted = { .kind = SP_MEASURE_RECTANGLE,
                                        .points = { { 0 }, { 1, 0, 0 }, { 1, 1, 0 } } };
    struct sp_error err = { 0 };
    assert_false(sp_measure_check(&angle, &err));
    assert_string_equal(err.text, "the first point is the same as the second one, so that an arm "
                                  "of the angle has no length");
    assert_false(sp_measure_check(&slanted, &err));
    assert_non_null(strstr(err.text, "from the first point to the second and the third"));
}

static void bad_points_are_refused(void **state) {
    (void)state;
    const struct sp_grid grid = grid_of(1e-6, 1e-6, 1, identity);
    struct sp_volume *volume = field(&grid, linear);
    refused(volume, (struct sp_measure){ .kind = SP_MEASURE_MARKER, .points = { { 0, 2e18, 0 } } },
            "/points/0/1");
    refused(volume,
            (struct sp_measure){ .kind = SP_MEASURE_DISTANCE, .points = { { 0 }, { 0, 0, NAN } } },
            "/points/1/2");
    refused(volume,
            (struct sp_measure){ .kind = SP_MEASURE_ANGLE, .points = { { 1 }, { 1 }, { 2 } } },
            "/points/0");
    refused(volume,
            (struct sp_measure){ .kind = SP_MEASURE_ELLIPSE, .points = { { 1 }, { 2 }, { 1 } } },
            "/points/2");
    refused(volume,
            (struct sp_measure){ .kind = SP_MEASURE_RECTANGLE,
                                 .points = { { 0 }, { 1, 0, 0 }, { 0.1, 1, 0 } } },
            "/points");
    /* Oblique, and a million cells wide. */
    refused(volume,
            (struct sp_measure){ .kind = SP_MEASURE_RECTANGLE,
                                 .points = { { 0 }, { 1, 1, 1 }, { 1, -1, 0 } } },
            "/points");
    sp_volume_unref(&volume);
}

/* A ball of radius 4 around the middle of the grid: values fall by 10 per world unit. */
static double ball(const double p[3]) {
    const double x = p[0] - 15.5, y = p[1] + 14.5, z = p[2] - 35.5;
    return 100 - 10 * sqrt(x * x + y * y + z * z);
}

static void a_part_has_volume_area_and_samples(void **state) {
    (void)state;
    const struct sp_grid grid = grid_of(1, 1, 1, identity);
    struct sp_volume *volume = field(&grid, ball);
    struct sp_measure part = { .kind = SP_MEASURE_PART,
                               .points = { { 15, -15, 36 } },
                               .range = { 60, 200 } };
    const struct sp_part same = { .point = { 15, -15, 36 }, .range = { 60, 200 } };
    struct sp_part_size size;
    assert_true(sp_part_measure(volume, &same, &size, NULL));
    struct sp_measure_result result = compute(volume, &part);
    assert_true(result.has_value);
    assert_int_equal(result.unit, SP_MEASURE_VOLUME);
    assert_near(result.value, size.volume, 0);
    assert_near(result.value, 4 / 3. * 3.14159265 * 64, 20);
    assert_near(result.area, 4 * 3.14159265 * 16, 8);
    assert_int_equal(result.samples, size.samples);
    assert_near(result.outside, 0, 0);
    assert_near(sp_measure_cost(volume, &part), N * N * N, 0);
    part.points[0][0] = 300; /* no part is near */
    result = compute(volume, &part);
    assert_false(result.has_value);
    sp_volume_unref(&volume);
}

static void a_path_goes_along_the_surface(void **state) {
    (void)state;
    const struct sp_grid grid = grid_of(1, 1, 1, identity);
    struct sp_volume *volume = field(&grid, ball);
    struct sp_measure path = { .kind = SP_MEASURE_PATH,
                               .points = { { 11.5, -14.5, 35.5 }, { 19.5, -14.5, 35.5 } },
                               .range = { 60, 200 } };
    struct sp_measure_result result = compute(volume, &path), same;
    struct sp_part_path points;
    struct sp_error err = { 0 };
    assert_true(result.has_value);
    assert_int_equal(result.unit, SP_MEASURE_LENGTH);
    assert_near(result.straight, 8, 0.2);
    assert_near(result.value, 4 * 3.14159265, 0.4);
    assert_true(sp_measure_path(volume, &path, &same, &points, &err));
    assert_near(same.value, result.value, 0);
    assert_near(points.length, result.value, 0);
    path.range[0] = 1000; /* nothing has such values */
    path.range[1] = 2000;
    assert_false(compute(volume, &path).has_value);
    sp_volume_unref(&volume);
}

static void bad_ranges_are_refused(void **state) {
    (void)state;
    const struct sp_grid grid = grid_of(1, 1, 1, identity);
    struct sp_volume *volume = field(&grid, linear);
    refused(volume, (struct sp_measure){ .kind = SP_MEASURE_PART, .range = { 2, 1 } }, "/range");
    refused(volume, (struct sp_measure){ .kind = SP_MEASURE_PATH, .range = { NAN, 1 } }, "/range");
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lengths_and_angles_are_those_of_the_world),
        cmocka_unit_test(a_linear_field_is_interpolated_exactly),
        cmocka_unit_test(the_volume_ends_half_a_gap_behind_its_last_sample),
        cmocka_unit_test(a_profile_has_equal_steps),
        cmocka_unit_test(a_rectangle_has_the_samples_inside_and_on_its_border),
        cmocka_unit_test(an_ellipse_has_the_samples_inside),
        cmocka_unit_test(samples_of_a_rectilinear_grid_have_weights),
        cmocka_unit_test(an_oblique_region_is_interpolated),
        cmocka_unit_test(samples_that_are_not_finite_are_counted_apart),
        cmocka_unit_test(a_region_outside_of_the_volume_is_empty),
        cmocka_unit_test(the_share_outside_is_that_of_the_geometry),
        cmocka_unit_test(nothing_is_outside_of_a_volume_of_elements),
        cmocka_unit_test(the_share_outside_of_a_region_is_that_of_its_area),
        cmocka_unit_test(a_flat_volume_has_a_plane),
        cmocka_unit_test(errors_name_points_by_their_order),
        cmocka_unit_test(bad_points_are_refused),
        cmocka_unit_test(a_part_has_volume_area_and_samples),
        cmocka_unit_test(a_path_goes_along_the_surface),
        cmocka_unit_test(bad_ranges_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
