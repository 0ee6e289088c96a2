/* SPDX-License-Identifier: Apache-2.0
 *
 * Points that are nodes of structured grids.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "data/volume/curvilinear.h"
#include "support/compare.h"

enum { MAX = 4096 };
static float positions[MAX][3], factors[MAX][6], values[MAX], volumes[MAX];
static const struct sp_elements points = {
    .positions = positions, .factors = factors, .values = values, .volumes = volumes
};

typedef void map(const double index[3], double out[3]);

static void place(const uint32_t dims[3], map *to_world) {
    uint32_t i = 0;
    for (uint32_t k = 0; k < dims[2]; k++)
        for (uint32_t j = 0; j < dims[1]; j++)
            for (uint32_t n = 0; n < dims[0]; n++, i++) {
                double world[3];
                to_world((const double[3]){ n, j, k }, world);
                for (int a = 0; a < 3; a++)
                    positions[i][a] = (float)world[a];
                values[i] = 1;
            }
}

static const double shear[3][3] = { { 2, 0.5, -0.25 }, { 0, 1, 0.5 }, { 0.25, 0, 4 } };

static void affine(const double i[3], double out[3]) {
    for (int row = 0; row < 3; row++)
        out[row] = 7 + shear[row][0] * i[0] + shear[row][1] * i[1] + shear[row][2] * i[2];
}

static void mirrored(const double i[3], double out[3]) {
    affine(i, out);
    out[2] = -out[2];
}

/* Every cell, also at borders, has the same kernel: σ²·A·Aᵀ. A left-handed grid is not folded. */
static void sheared_grids_have_the_kernel_of_the_matrix(void **state) {
    const uint32_t dims[3] = { 4, 3, 5 };
    (void)state;
    for (int mirror = 0; mirror < 2; mirror++) {
        place(dims, mirror ? mirrored : affine);
        assert_int_equal(sp_curvilinear_finish(&points, 0, dims), 0);
        for (int i = 0; i < 60; i++) {
            const float *f = factors[i];
            double sign = mirror ? -1 : 1, v[3][3];
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)
                    v[r][c] = (r == 2 ? sign : 1) * (c == 2 ? sign : 1) * 0.49 *
                              (shear[r][0] * shear[c][0] + shear[r][1] * shear[c][1] +
                               shear[r][2] * shear[c][2]);
            assert_float_equal(f[0] * f[0], v[0][0], 1e-4);
            assert_float_equal(f[0] * f[1], v[1][0], 1e-4);
            assert_float_equal(f[1] * f[1] + f[2] * f[2], v[1][1], 1e-4);
            assert_float_equal(f[0] * f[3], v[2][0], 1e-4);
            assert_float_equal(f[1] * f[3] + f[2] * f[4], v[2][1], 1e-4);
            assert_float_equal(f[3] * f[3] + f[4] * f[4] + f[5] * f[5], v[2][2], 1e-4);
            assert_float_equal(volumes[i], 8 + 0.25 * (0.25 + 0.25), 1e-4);
            assert_float_equal(values[i], 1, 0);
        }
    }
}

static void polar(const double i[3], double out[3]) {
    double r = 1 + 0.1 * i[0], angle = 2 * M_PI * i[1] / 32;
    out[0] = r * cos(angle);
    out[1] = r * sin(angle);
    out[2] = 0.1 * i[2];
}

/* The first angle may be repeated at the end. The volumes fill the ring either way. */
static void volumes_of_a_ring_fill_it(void **state) {
    (void)state;
    for (uint32_t closed = 0; closed < 2; closed++) {
        const uint32_t dims[3] = { 10, 32 + closed, 4 };
        place(dims, polar);
        for (uint32_t i = 0; i < 40 && closed; i++) { /* without the rounding of sin 2π */
            uint32_t row = i / 10 * 330;
            memcpy(positions[row + 320 + i % 10], positions[row + i % 10], sizeof positions[0]);
        }
        assert_int_equal(sp_curvilinear_finish(&points, 0, dims), 0);
        double sum = 0;
        for (uint32_t i = 0; i < dims[0] * dims[1] * dims[2]; i++)
            sum += (double)volumes[i];
        double ring = M_PI * (1.95 * 1.95 - 0.95 * 0.95) * 0.4;
        assert_float_equal(sum / ring, 1, 0.01);
    }
}

static void folded(const double i[3], double out[3]) {
    out[0] = i[0] < 4 ? i[0] : 8 - i[0]; /* turns back at 4, where the derivative is 0 */
    out[1] = i[1];
    out[2] = i[2];
}

static void folded_cells_are_counted_and_not_drawn(void **state) {
    const uint32_t dims[3] = { 7, 3, 3 };
    (void)state;
    place(dims, folded);
    assert_int_equal(sp_curvilinear_finish(&points, 0, dims), 3 * 9);
    for (uint32_t i = 0; i < 63; i++) {
        assert_int_equal(isnan(values[i]) != 0, i % 7 >= 4);
        assert_compare(volumes[i], >, 0);
        assert_true(isfinite(volumes[i]));
    }
}

/* Neighbours of a position that is not finite have no kernel either; they are not folded. */
static void positions_need_not_be_finite(void **state) {
    const uint32_t dims[3] = { 3, 3, 3 };
    (void)state;
    place(dims, affine);
    positions[13][1] = NAN;
    assert_int_equal(sp_curvilinear_finish(&points, 0, dims), 0);
    for (int i = 0; i < 27; i++) {
        assert_compare(volumes[i], >, 0);
        assert_true(isfinite(volumes[i]));
    }
    assert_true(isnan(values[12]));
    assert_float_equal(values[0], 1, 0);
}

/* A surface, a line and a point are as thick as their smallest gap, or 1. */
static void thin_grids_have_a_thickness(void **state) {
    static const struct {
        uint32_t dims[3];
        double volume, edge;
    } grids[] = { { { 4, 3, 1 }, 2 * 1 * 1, 1 }, { { 1, 3, 4 }, 1 * 4 * 1, 1 },
                  { { 4, 1, 3 }, 2 * 4 * 2, 2 }, { { 1, 1, 5 }, 4 * 4 * 4, 4 },
                  { { 5, 1, 1 }, 2 * 2 * 2, 2 }, { { 1, 1, 1 }, 1, 1 } };
    static const double scales[3] = { 2, 1, 4 };
    (void)state;
    for (size_t g = 0; g < sizeof grids / sizeof *grids; g++) {
        const uint32_t *dims = grids[g].dims;
        uint32_t i = 0;
        for (uint32_t k = 0; k < dims[2]; k++)
            for (uint32_t j = 0; j < dims[1]; j++)
                for (uint32_t n = 0; n < dims[0]; n++, i++) {
                    positions[i][0] = (float)(scales[0] * n);
                    positions[i][1] = (float)(scales[1] * j);
                    positions[i][2] = (float)(scales[2] * k);
                    values[i] = 1;
                }
        assert_int_equal(sp_curvilinear_finish(&points, 0, dims), 0);
        for (uint32_t n = 0; n < i; n++) {
            const int diagonal[3] = { 0, 2, 5 };
            assert_float_equal(volumes[n], grids[g].volume, 1e-5);
            for (int a = 0; a < 3; a++)
                assert_float_equal(factors[n][diagonal[a]],
                                   0.7 * (dims[a] > 1 ? scales[a] : grids[g].edge), 1e-5);
        }
    }
}

/* Nodes that all coincide are flat cells. */
static void coincident_nodes_are_flat(void **state) {
    const uint32_t dims[3] = { 2, 2, 2 };
    (void)state;
    memset(positions, 0, sizeof positions);
    assert_int_equal(sp_curvilinear_finish(&points, 0, dims), 8);
    for (int i = 0; i < 8; i++) {
        assert_true(isnan(values[i]));
        assert_compare(volumes[i], >, 0);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sheared_grids_have_the_kernel_of_the_matrix),
        cmocka_unit_test(volumes_of_a_ring_fill_it),
        cmocka_unit_test(folded_cells_are_counted_and_not_drawn),
        cmocka_unit_test(positions_need_not_be_finite),
        cmocka_unit_test(thin_grids_have_a_thickness),
        cmocka_unit_test(coincident_nodes_are_flat),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
