/* SPDX-License-Identifier: Apache-2.0
 *
 * What projections of volumes of known rays show.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "sp/volume.h"
#include "support/compare.h"

typedef double value_at(uint32_t i, uint32_t j, uint32_t k);

enum { SIDE = 60 };
static const uint32_t cube[3] = { SIDE, SIDE, SIDE };
static const double unit[3] = { 1, 1, 1 };

static struct sp_projected project(const uint32_t dims[3], const double spacing[3],
                                   value_at *value) {
    struct sp_grid grid = { .dims = { dims[0], dims[1], dims[2] },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    double *voxels = malloc((size_t)dims[0] * dims[1] * dims[2] * sizeof *voxels), *at = voxels;
    struct sp_error err;
    assert_non_null(voxels);
    for (int a = 0; a < 3; a++)
        grid.spacing[a] = spacing[a];
    for (uint32_t k = 0; k < dims[2]; k++)
        for (uint32_t j = 0; j < dims[1]; j++)
            for (uint32_t i = 0; i < dims[0]; i++)
                *at++ = value(i, j, k);
    struct sp_volume *volume = sp_volume_create(&grid, SP_FLOAT64, voxels, "v", &err);
    free(voxels);
    assert_non_null(volume);
    const struct sp_projected projected = sp_volume_info(volume)->projected;
    sp_volume_unref(&volume);
    return projected;
}

/* Rays along x are bright at one end; the others have one value each, from 0 to 1. */
static double ramp(uint32_t i, uint32_t j, uint32_t k) {
    (void)j, (void)k;
    return -5 + 10.0 * i / (SIDE - 1);
}

static void ends_are_those_of_nearly_all_rays(void **state) {
    (void)state;
    const struct sp_projected p = project(cube, unit, ramp);
    const double low = 0.05, high = 0.995, step = 1.0 / (SIDE - 1);
    assert_float_equal(p.maximum[0], (1 + 2 * low) / 3, step);
    assert_float_equal(p.maximum[1], (1 + 2 * high) / 3, step);
    assert_float_equal(p.mean[0], (0.5 + 2 * 0.01) / 3, step);
    assert_float_equal(p.sum, SIDE * (0.5 + 2 * high) / 3, 2);
}

/* A block on the floor of the volume, an eighth of its side high. */
static double pot(uint32_t i, uint32_t j, uint32_t k) {
    return k < SIDE / 8 && i >= SIDE / 4 && i < SIDE && j >= SIDE / 4 && j < SIDE;
}

static void rays_that_touch_an_edge_count_for_means(void **state) {
    (void)state;
    const struct sp_projected p = project(cube, unit, pot);
    /* Along axes: three quarters of the side, and an eighth from above. */
    assert_compare(p.mean[1], >, (0.75 + 0.75 + 0.125) / 3 + 0.1);
    assert_compare(p.mean[1], <=, 1);
}

/* A plate that fills a volume of 60 × 60 × 10 mm. */
static double plate(uint32_t i, uint32_t j, uint32_t k) {
    (void)k;
    return i > 2 && j > 2;
}

static void sums_are_those_of_the_broad_side(void **state) {
    (void)state;
    const struct sp_projected p =
        project((const uint32_t[3]){ SIDE, SIDE, 5 }, (const double[3]){ 1, 1, 2 }, plate);
    const double areas[3] = { 60 * 10, 60 * 10, 60 * 60 }, sums[3] = { 57, 57, 10 };
    double sum = 0, area = 0;
    for (int a = 0; a < 3; a++) {
        sum += areas[a] * sums[a];
        area += areas[a];
    }
    assert_float_equal(p.sum, sum / area, 1e-9);
}

static double nothing(uint32_t i, uint32_t j, uint32_t k) {
    (void)i, (void)j, (void)k;
    return NAN;
}

static double same(uint32_t i, uint32_t j, uint32_t k) {
    (void)i, (void)j, (void)k;
    return 7;
}

static double extreme(uint32_t i, uint32_t j, uint32_t k) {
    return i == 3 && k == 1 ? NAN : j & 1 ? DBL_MAX : -DBL_MAX;
}

static void degenerate_volumes_are_finite(void **state) {
    (void)state;
    static value_at *const values[] = { nothing, same, extreme };
    static const uint32_t shapes[][3] = { { 1, 1, 1 }, { 1, 7, 1 }, { 5, 4, 3 }, { 200, 2, 3 } };
    for (size_t v = 0; v < sizeof values / sizeof values[0]; v++)
        for (size_t s = 0; s < sizeof shapes / sizeof shapes[0]; s++) {
            const struct sp_projected p = project(shapes[s], unit, values[v]);
            assert_true(isfinite(p.maximum[0]) && isfinite(p.maximum[1]));
            assert_true(isfinite(p.mean[0]) && isfinite(p.mean[1]) && isfinite(p.sum));
            assert_compare(p.maximum[1], >=, p.maximum[0]);
            assert_compare(p.mean[1], >=, p.mean[0]);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ends_are_those_of_nearly_all_rays),
        cmocka_unit_test(rays_that_touch_an_edge_count_for_means),
        cmocka_unit_test(sums_are_those_of_the_broad_side),
        cmocka_unit_test(degenerate_volumes_are_finite),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
