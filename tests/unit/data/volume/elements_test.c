/* SPDX-License-Identifier: Apache-2.0
 *
 * Volumes of points, Gaussians and triangles: memory, box, statistics, bad shapes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "data/volume/elements.h"
#include "data/volume/volume.h"
#include "support/compare.h"

static float positions[4][3] = { { 0, 0, 0 }, { 2, 0, 0 }, { NAN, 1, 1 }, { 0, 4, 1 } };
static float factors[4][6] = { { 1, 0, 1, 0, 0, 1 }, { 2, 0, 2, 0, 0, 2 } };
static float values[4] = { 3, -1, INFINITY, 7 };
static float volumes[4] = { 8, 8, 8, 8 };
static float vectors[4][3] = { { 1, 2, 2 }, { NAN, 9, 9 }, { 0, 0, 0 }, { 0, 0, -4 } };

static void points_may_have_vectors(void **state) {
    struct sp_elements points = { .shape = { .kind = SP_KIND_POINTS, .count = 4 },
                                  .positions = positions,
                                  .factors = factors,
                                  .values = values,
                                  .volumes = volumes,
                                  .vectors = vectors };
    struct sp_volume *plain = sp_volume_create_elements(&points, "plain", NULL);
    points.shape.has_vectors = true;
    struct sp_volume *volume = sp_volume_create_elements(&points, "points", NULL);
    (void)state;
    assert_non_null(volume);
    assert_non_null(plain);
    const struct sp_volume_info *info = sp_volume_info(volume), *other = sp_volume_info(plain);
    assert_memory_equal(sp_volume_vectors(volume), vectors, sizeof vectors);
    assert_float_equal(info->longest, 4, 0);
    assert_int_equal(info->vector_bytes, sizeof vectors);
    assert_int_equal(sp_volume_bytes(info), sp_volume_bytes(other) + 64); /* a cache line */
    assert_null(sp_volume_vectors(plain));
    assert_int_equal(other->vector_bytes, 0);
    sp_volume_unref(&plain);
    sp_volume_unref(&volume);
}

static void points_have_a_box_and_statistics(void **state) {
    const struct sp_elements points = { .shape = { .kind = SP_KIND_POINTS, .count = 4 },
                                        .positions = positions,
                                        .factors = factors,
                                        .values = values,
                                        .volumes = volumes };
    struct sp_volume *volume = sp_volume_create_elements(&points, "points", NULL);
    (void)state;
    assert_non_null(volume);
    const struct sp_volume_info *info = sp_volume_info(volume);
    const struct sp_elements *e = sp_volume_elements(volume);
    assert_int_equal(info->elements.kind, SP_KIND_POINTS);
    assert_int_equal(info->elements.count, 4);
    assert_float_equal(info->range[0], -1, 0);
    assert_float_equal(info->range[1], 7, 0);
    assert_int_equal(info->nonfinite, 1);
    assert_float_equal(info->element_spacing, 2, 1e-9);
    for (int a = 0; a < 3; a++) {
        assert_int_equal(info->grid.dims[a], 1);
        assert_float_equal(info->grid.spacing[a], ((double[]){ 2, 4, 1 })[a], 1e-12);
        assert_float_equal(info->grid.origin[a], ((double[]){ 1, 2, 0.5 })[a], 1e-12);
    }
    assert_true(isnan(*(const float *)sp_volume_voxels(volume)));
    assert_memory_equal(e->values, values, sizeof values);
    assert_ptr_not_equal(e->values, values);
    assert_int_equal((uintptr_t)e->volumes % 64, 0);
    sp_volume_unref(&volume);
}

static void triangles_must_have_their_vertices(void **state) {
    float normals[4][3] = { { 0, 0, 1 } }, colors[4][4] = { { 1, 1, 1, 1 } };
    uint32_t triangles[1][3] = { { 0, 1, 3 } };
    struct sp_elements mesh = { .shape = { .kind = SP_KIND_MESH, .count = 1, .vertex_count = 4 },
                                .positions = positions,
                                .normals = normals,
                                .colors = colors,
                                .triangles = triangles };
    struct sp_error err;
    (void)state;
    struct sp_volume *volume = sp_volume_create_elements(&mesh, "mesh", &err);
    assert_non_null(volume);
    assert_memory_equal(sp_volume_elements(volume)->triangles, triangles, sizeof triangles);
    sp_volume_unref(&volume);
    triangles[0][2] = 4;
    assert_null(sp_volume_create_elements(&mesh, "mesh", &err));
    assert_int_equal(err.code, SP_ERR_INVALID);
}

static void elements_that_coincide_have_a_box(void **state) {
    float same[2][3] = { { 5, 5, 5 }, { 5, 5, 5 } };
    struct sp_elements points = { .shape = { .kind = SP_KIND_POINTS, .count = 2 },
                                  .positions = same,
                                  .factors = factors,
                                  .values = values,
                                  .volumes = volumes };
    (void)state;
    for (uint32_t count = 0; count < 3; count += 2) { /* none and two */
        points.shape.count = count;
        struct sp_volume *volume = sp_volume_create_elements(&points, "same", NULL);
        assert_non_null(volume);
        const struct sp_volume_info *info = sp_volume_info(volume);
        assert_float_equal(info->grid.spacing[0], 1, 0);
        assert_float_equal(info->grid.origin[2], count ? 5 : 0, 0);
        assert_true(info->element_spacing > 0);
        sp_volume_unref(&volume);
    }
}

static void bad_shapes_are_refused(void **state) {
    static const struct sp_elements_shape shapes[] = {
        { .kind = SP_KIND_COUNT, .count = 1 },
        { .kind = SP_KIND_GRID, .count = 1 },
        { .kind = SP_KIND_POINTS, .count = 1, .vertex_count = 1 },
        { .kind = SP_KIND_POINTS, .count = 1, .degree = 1 },
        { .kind = SP_KIND_GAUSSIANS, .count = 1, .degree = 4 },
        { .kind = SP_KIND_GAUSSIANS, .count = SP_ELEMENTS_MAX + 1u },
        { .kind = SP_KIND_MESH, .count = 1 },
        { .kind = SP_KIND_MESH, .count = 1, .vertex_count = SP_ELEMENTS_MAX + 1u },
        { .kind = SP_KIND_GRID, .has_vectors = true },
        { .kind = SP_KIND_GAUSSIANS, .count = 1, .has_vectors = true },
        { .kind = SP_KIND_MESH, .count = 1, .vertex_count = 3, .has_vectors = true },
        { .kind = SP_KIND_POINTS, .count = 1, .lacks_colors = true },
        { .kind = SP_KIND_GRID, .lacks_colors = true },
    };
    (void)state;
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i++)
        if (!sp_elements_shape_problem(&shapes[i]))
            fail_msg("shape %zu is accepted", i);
    assert_null(sp_elements_shape_problem(
        &(struct sp_elements_shape){ .kind = SP_KIND_GAUSSIANS, .count = 7, .degree = 3 }));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_have_a_box_and_statistics),
        cmocka_unit_test(points_may_have_vectors),
        cmocka_unit_test(triangles_must_have_their_vertices),
        cmocka_unit_test(elements_that_coincide_have_a_box),
        cmocka_unit_test(bad_shapes_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
