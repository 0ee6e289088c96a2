/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "classify/gradient.h"
#include "classify/visible.h"
#include "support/compare.h"
#include "unit/classify/volume.h"

/* A field that is linear in world space has the same gradient everywhere, on every grid. */
static void gradients_of_linear_fields_are_exact(void **state) {
    (void)state;
    static const struct sp_grid grids[] = {
        { { 7, 6, 5 }, { 1, 1, 1 }, { 0 }, { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } }, { 0 } },
        { { 7, 6, 5 },
          { 0.5, 2, 4 },
          { 3, -9, 1 },
          { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } },
          { 0 } },
        { { 4, 5, 6 }, { 1, 3, 0.2 }, { 0 }, { { 0, -1, 0 }, { 1, 0, 0 }, { 0, 0, -1 } }, { 0 } },
        { { 5, 5, 5 },
          { 1, 2, 3 },
          { 0 },
          { { 1, 0.6, 0 }, { 0, 0.8, 0.6 }, { 0, 0, 0.8 } },
          { 0 } },
        { { 5, 4, 3 }, { 2, 1, 1 }, { 0 }, { { 0, 0.8, 0 }, { 1, 0.6, 0 }, { 0, 0, 1 } }, { 0 } },
    };
    static const double slopes[3] = { 0.3, -1.7, 0.9 };
    for (size_t n = 0; n < sizeof grids / sizeof grids[0]; n++) {
        const struct sp_grid *g = &grids[n];
        size_t count = (size_t)g->dims[0] * g->dims[1] * g->dims[2], at = 0;
        double *values = malloc(count * sizeof *values);
        for (uint32_t k = 0; k < g->dims[2]; k++)
            for (uint32_t j = 0; j < g->dims[1]; j++)
                for (uint32_t i = 0; i < g->dims[0]; i++, at++) {
                    double index[3] = { i, j, k };
                    values[at] = 5;
                    for (int r = 0; r < 3; r++)
                        for (int a = 0; a < 3; a++)
                            values[at] += slopes[r] * g->direction[r][a] * g->spacing[a] * index[a];
                }
        struct sp_volume *v = sp_volume_create(g, SP_FLOAT64, values, "linear", NULL);
        assert_non_null(v);
        struct sp_gradient_grid grid;
        sp_gradient_grid_init(&grid, v);
        double length = sqrt(slopes[0] * slopes[0] + slopes[1] * slopes[1] + slopes[2] * slopes[2]);
        for (uint32_t k = 0; k < g->dims[2]; k++)
            for (uint32_t j = 0; j < g->dims[1]; j++)
                for (uint32_t i = 0; i < g->dims[0]; i++) {
                    double gradient[3];
                    float unit[3];
                    sp_gradient_at(&grid, (uint32_t[3]){ i, j, k }, gradient);
                    uint32_t packed = sp_gradient_pack(&grid, gradient);
                    sp_gradient_unpack(packed, unit);
                    for (int r = 0; r < 3; r++) {
                        assert_compare(fabs(gradient[r] / grid.scale - slopes[r]), <, 1e-9);
                        assert_compare(fabs((double)unit[r] - slopes[r] / length), <, 2e-3);
                    }
                    assert_compare(fabs(sp_gradient_magnitude(&grid, packed) / length - 1), <,
                                   0.02);
                }
        sp_volume_unref(&v);
        free(values);
    }
}

/* A field that is linear in world space has one gradient, at any distance of the samples. */
static void gradients_of_rectilinear_grids_are_in_world_space(void **state) {
    (void)state;
    enum { N = 6 };
    static const double coordinates[N] = { 0, 1, 1.25, 5, 7, 7.5 };
    const struct sp_grid grid = { .dims = { N, N, N },
                                  .spacing = { 1.5, 2, 1.5 },
                                  .direction = { { 0, 0.6, 1 }, { 1, 0, 0 }, { 0, 0.8, 0 } },
                                  .coordinates = { coordinates, NULL, coordinates } };
    const double slope[3] = { 2, -1, 0.5 };
    static double values[N * N * N];
    for (uint32_t n = 0; n < N * N * N; n++) {
        uint32_t i[3] = { n % N, n / N % N, n / N / N };
        for (unsigned a = 0; a < 3; a++)
            for (int r = 0; r < 3; r++)
                values[n] += slope[r] * grid.direction[r][a] * sp_grid_distance(&grid, a, i[a]);
    }
    struct sp_volume *v = sp_volume_create(&grid, SP_FLOAT64, values, "", NULL);
    assert_non_null(v);
    struct sp_gradient_grid gradients;
    sp_gradient_grid_init(&gradients, v);
    for (uint32_t n = 0; n < N * N * N; n++) {
        double gradient[3];
        sp_gradient_at(&gradients, (uint32_t[3]){ n % N, n / N % N, n / N / N }, gradient);
        for (int r = 0; r < 3; r++)
            assert_compare(fabs(gradient[r] / gradients.scale - slope[r]), <, 1e-9);
        uint32_t packed = sp_gradient_pack(&gradients, gradient);
        assert_compare(packed >> 22, >, 0);
        assert_compare(packed >> 22, <, SP_GRADIENT_MAGNITUDES);
    }
    sp_volume_unref(&v);
}

/* Returns the largest error [degrees] of directions that are packed in 32 or in 16 bits: random
 * directions and directions between the axes. Asserts that the axes are exact and zero stays
 * zero. */
static double worst_packing_error(bool is_short) {
    struct sp_gradient_grid grid = { .bound = 1, .unit = 1, .scale = 1 };
    double worst = 1;
    srand(1);
    for (int n = 0; n < 200000; n++) {
        double g[3], length = 0, cosine = 0;
        float unit[3];
        for (int r = 0; r < 3; r++) {
            g[r] =
                n < 27 ? (int[3]){ n % 3, n / 3 % 3, n / 9 }[r] - 1 : rand() / (RAND_MAX / 2.0) - 1;
            length += g[r] * g[r];
        }
        uint32_t packed = is_short ? sp_gradient_widen(sp_gradient_pack_direction(g))
                                   : sp_gradient_pack(&grid, g);
        sp_gradient_unpack(packed, unit);
        if (length == 0) {
            assert_int_equal(packed, 0);
            assert_compare(unit[0], ==, 0);
            assert_compare(unit[1], ==, 0);
            assert_compare(unit[2], ==, 0);
            continue;
        }
        for (int r = 0; r < 3; r++)
            cosine += (double)unit[r] * g[r] / sqrt(length);
        if (n < 27 && length == 1) /* the axes are exact */
            assert_compare(cosine, ==, 1);
        worst = fmin(worst, cosine);
    }
    return acos(fmin(1, worst)) * 180 / M_PI;
}

static void packed_directions_are_within_an_eighth_of_a_degree(void **state) {
    (void)state;
    assert_compare(worst_packing_error(false), <=, 0.125);
}

static void directions_in_16_bits_are_within_about_a_degree(void **state) {
    (void)state;
    assert_compare(worst_packing_error(true), <=, 1.1);
    /* The corners of the map meet near this direction. Their code would mean "none". */
    const double down[3] = { -1e-4, -1e-4, -1 };
    assert_int_not_equal(sp_gradient_pack_direction(down), 0);
}

/* Compares the stored directions of bricks with the directions of single voxels: every type, at
 * borders, on uniform and rectilinear grids. */
static void directions_of_bricks_equal_those_of_voxels(void **state) {
    (void)state;
    enum { X = 19, Y = 17, Z = 1 + SP_BRICK, COUNT = X * Y * Z };
    static const enum sp_type types[] = { SP_UINT8, SP_INT8, SP_UINT16, SP_INT16 };
    static uint16_t values[COUNT], local[SP_BRICK_VOXELS], packed[SP_BRICK_VOXELS + 1];
    double coordinates[Y];
    srand(6);
    for (int i = 0; i < COUNT; i++) /* constant in some regions */
        values[i] = (uint16_t)(i % 7 < 3 && i % X > 6 ? rand() : 0x0101);
    for (int i = 0; i < Y; i++)
        coordinates[i] = i + 0.3 * (i % 3);
    for (int n = 0; n < 8; n++) {
        struct sp_grid grid = {
            .dims = { X, Y, n < 4 ? Z : 1 },
            .spacing = { 1, 1.5, 0.5 },
            .direction = { { 0.6, -0.8, 0 }, { 0.8, 0.6, 0 }, { 0, 0, -1 } },
            .coordinates = { NULL, n % 2 ? coordinates : NULL, NULL },
        };
        if (n % 2)
            grid.spacing[1] = coordinates[Y - 1] / (Y - 1);
        struct sp_volume *v = sp_volume_create(&grid, types[n / 2], values, "", NULL);
        assert_non_null(v);
        struct sp_gradient_grid gradients;
        sp_gradient_grid_init(&gradients, v);
        for (int b = 0; b < 8; b++) {
            uint32_t corner[3] = { b & 1 ? 16 : 0, b & 2 ? 16 : 0, b & 4 ? 16 : 0 }, count = 0;
            for (uint16_t k = 0; k < SP_BRICK_VOXELS; k++)
                if (rand() % 3 && corner[0] + (k & 15) < X && corner[1] + (k >> 4 & 15) < Y &&
                    corner[2] + (k >> 8u) < grid.dims[2])
                    local[count++] = k;
            packed[count] = 0x5a5a;
            sp_gradient_pack_directions(&gradients, corner, local, count, packed);
            assert_int_equal(packed[count], 0x5a5a);
            for (uint32_t e = 0; e < count; e++) {
                double g[3];
                sp_gradient_at(&gradients,
                               (uint32_t[3]){ corner[0] + (local[e] & 15u),
                                              corner[1] + (local[e] >> 4 & 15u),
                                              corner[2] + (local[e] >> 8) },
                               g);
                assert_int_equal(packed[e], sp_gradient_pack_direction(g));
            }
        }
        sp_volume_unref(&v);
    }
}

static void gradients_skip_nan_samples(void **state) {
    (void)state;
    float values[27];
    for (int i = 0; i < 27; i++)
        values[i] = (float)(i % 3) * 2;
    values[14] = NAN; /* the right neighbour of the middle voxel */
    struct sp_volume *v = classify_make_volume((uint32_t[3]){ 3, 3, 3 }, SP_FLOAT32, values);
    struct sp_gradient_grid grid;
    double gradient[3];
    sp_gradient_grid_init(&grid, v);
    sp_gradient_at(&grid, (uint32_t[3]){ 1, 1, 1 }, gradient);
    assert_compare(fabs(gradient[0] / grid.scale - 2), <, 1e-12);
    assert_compare(gradient[1], ==, 0);
    assert_compare(gradient[2], ==, 0);
    sp_volume_unref(&v);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradients_of_linear_fields_are_exact),
        cmocka_unit_test(gradients_of_rectilinear_grids_are_in_world_space),
        cmocka_unit_test(packed_directions_are_within_an_eighth_of_a_degree),
        cmocka_unit_test(directions_in_16_bits_are_within_about_a_degree),
        cmocka_unit_test(directions_of_bricks_equal_those_of_voxels),
        cmocka_unit_test(gradients_skip_nan_samples),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
