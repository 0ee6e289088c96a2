/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares lists for post-classification with an exhaustive search. A voxel that is not in the list
 * has no visible value within two kernel radii. Most voxels far from visible values are not in it.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/classification.h"
#include "classify/gradient.h"
#include "classify/reach.h"
#include "classify/visible_ranges.h"
#include "data/volume/grid.h"
#include "support/compare.h"
#include "support/one_thread.h"
#include "support/sanitized.h"

enum { X = 37, Y = 21, Z = 50 };

static double value_at(int shape, int x, int y, int z) {
    if (shape == 0) /* a ball in an empty volume */
        return hypot(hypot(x - 10, y - 10), z - 12) < 4 ? 100 : 0;
    if (shape == 1) /* two half-spaces: no voxel has a value between theirs */
        return x < 18 ? 0 : 100;
    return 50 + 50 * sin(0.3 * x + 0.1 * y) * cos(0.15 * z);
}

static struct sp_volume *make_volume(int shape, enum sp_type type) {
    struct sp_grid grid = { .dims = { X, Y, Z },
                            .spacing = { 1, 1, 1 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    static uint8_t bytes[X * Y * Z];
    static float reals[X * Y * Z];
    for (int i = 0; i < X * Y * Z; i++) {
        reals[i] = (float)value_at(shape, i % X, i / X % Y, i / X / Y);
        bytes[i] = (uint8_t)reals[i];
        if (i % 977 == 0)
            reals[i] = NAN;
    }
    struct sp_volume *v =
        sp_volume_create(&grid, type, type == SP_UINT8 ? (const void *)bytes : reals, "v", NULL);
    assert_non_null(v);
    return v;
}

static double sample(const struct sp_volume *v, int x, int y, int z) {
    size_t i = (size_t)x + X * ((size_t)y + Y * (size_t)z);
    return sp_volume_info(v)->type == SP_UINT8 ? ((const uint8_t *)sp_volume_voxels(v))[i]
                                               : (double)((const float *)sp_volume_voxels(v))[i];
}

static bool matters(const struct sp_volume *v, const struct sp_transfer_function *tf, int reach,
                    int x, int y, int z) {
    double low = INFINITY, high = -INFINITY;
    for (int k = z - reach; k <= z + reach; k++)
        for (int j = y - reach; j <= y + reach; j++)
            for (int i = x - reach; i <= x + reach; i++) {
                if (i < 0 || j < 0 || k < 0 || i >= X || j >= Y || k >= Z)
                    continue;
                double s = sample(v, i, j, k);
                if (!isfinite(s))
                    continue;
                low = fmin(low, s);
                high = fmax(high, s);
            }
    struct sp_visible_ranges ranges;
    sp_visible_ranges_init(&ranges, tf);
    return sp_visible_ranges_overlap(&ranges, low, high);
}

static void check_list(const struct sp_volume *v, const struct sp_transfer_function *tf,
                       double radius, const struct sp_visible *list, uint64_t min_not_listed) {
    static uint8_t listed[X * Y * Z];
    memset(listed, 0, sizeof listed);
    for (uint32_t b = 0; b < sp_visible_bricks(list); b++) {
        uint32_t c[3];
        sp_visible_brick_corner(list->bricks, b, c);
        for (uint64_t e = list->first[b]; e < list->first[b + 1]; e++) {
            uint16_t l;
            sp_visible_locals(list, b, NULL, (uint32_t)(e - list->first[b]), 1, &l);
            uint32_t x = c[0] + (l & 15), y = c[1] + (l >> 4 & 15), z = c[2] + (l >> 8);
            listed[x + X * (y + (size_t)Y * z)] = 1;
        }
    }
    int reach = (int)floor(2 * radius);
    for (int i = 0; i < X * Y * Z; i += TEST_SANITIZED ? 13 : 1) {
        int x = i % X, y = i / X % Y, z = i / X / Y;
        if (!listed[i] && isfinite(sample(v, x, y, z)))
            assert_false(matters(v, tf, reach, x, y, z));
        if (listed[i])
            assert_true(isfinite(sample(v, x, y, z)));
    }
    assert_compare(X * Y * Z - list->count, >=, min_not_listed);
}

static void voxels_that_matter_are_listed(void **state) {
    (void)state;
    static const struct {
        int shape;
        double points[4][2]; /* value, opacity */
        double radius;
        uint64_t min_not_listed;
    } cases[] = {
        { 0, { { 50, 0 }, { 60, 0.5 }, { 70, 0.5 }, { 80, 0 } }, 2.1, 20000 },
        { 0, { { 50, 0 }, { 60, 0.5 }, { 70, 0.5 }, { 80, 0 } }, 12, 0 },
        { 1, { { 49, 0 }, { 50, 0.5 }, { 51, 0 }, { 52, 0 } }, 2.1, 10000 },
        { 1, { { 200, 0 }, { 210, 0.5 }, { 220, 0.5 }, { 230, 0 } }, 2.1, X * Y * Z },
        { 2, { { 97, 0 }, { 98, 0.5 }, { 99, 0.5 }, { 100, 0 } }, 1, 10000 },
    };
    struct sp_pool *pool = sp_pool_create(2, NULL);
    if (TEST_SANITIZED)
        print_message("reduced under a sanitizer: no wide kernel, and a sample of the voxels\n");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (int type = 0; type < 2; type++) {
            if (TEST_SANITIZED && cases[i].radius > 10)
                continue; /* the exhaustive search takes most of the time */
            struct sp_volume *v = make_volume(cases[i].shape, type ? SP_FLOAT32 : SP_UINT8);
            struct sp_transfer_function tf = { .reference_length = 1,
                                               .order = SP_TF_POST,
                                               .point_count = 4 };
            for (int k = 0; k < 4; k++)
                tf.points[k] = (struct sp_tf_point){ .value = cases[i].points[k][0],
                                                     .opacity = (float)cases[i].points[k][1] };
            struct sp_classification c;
            struct sp_classify_job job = {
                .tf = &tf, .levels = 1, .axis = SP_NO_AXIS, .reach = cases[i].radius, .pool = pool
            };
            sp_classification_init(&c, v);
            assert_true(sp_classification_update(&c, &job, NULL));
            check_list(v, &tf, cases[i].radius, &c.levels[0].visible, cases[i].min_not_listed);
            assert_null(c.levels[0].cells);
            sp_classification_finish(&c);
            sp_volume_unref(&v);
        }
    sp_pool_destroy(&pool);
}

/* A wider kernel needs a list with more voxels. A slightly narrower kernel uses the same list, and
 * a much narrower one gets a shorter list. */
static void lists_depend_on_the_kernel_width(void **state) {
    (void)state;
    struct sp_pool *pool = sp_pool_create(1, NULL);
    struct sp_volume *v = make_volume(0, SP_UINT8);
    struct sp_transfer_function tf = { .reference_length = 1,
                                       .order = SP_TF_POST,
                                       .point_count = 2,
                                       .points = { { 50, { 0 }, 0 }, { 60, { 0 }, 0.5f } } };
    struct sp_classification c;
    uint64_t counts[4];
    static const double radii[4] = { 2.5, 6, 5, 1 };
    sp_classification_init(&c, v);
    for (int i = 0; i < 4; i++) {
        struct sp_classify_job job = {
            .tf = &tf, .levels = 1, .axis = SP_NO_AXIS, .reach = radii[i], .pool = pool
        };
        assert_true(sp_classification_update(&c, &job, NULL));
        counts[i] = c.levels[0].visible.count;
    }
    assert_compare(counts[1], >, counts[0]);
    assert_compare(counts[2], ==, counts[1]);
    assert_compare(counts[3], <, counts[0]);
    tf.order = SP_TF_PRE; /* pre-classification needs only the visible voxels */
    struct sp_classify_job job = { .tf = &tf, .levels = 1, .axis = SP_NO_AXIS, .pool = pool };
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_compare(c.levels[0].visible.count, <, counts[3]);
    sp_classification_finish(&c);
    sp_volume_unref(&v);
    sp_pool_destroy(&pool);
}

/* Values and gradients of a mip level are means, which a linear field makes easy to compute. */
static void mip_levels_average_the_scalar(void **state) {
    (void)state;
    enum { N = 8 };
    struct sp_grid grid = { .dims = { N, N, N },
                            .spacing = { 1, 1, 1 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    float values[N * N * N];
    for (int i = 0; i < N * N * N; i++)
        values[i] = (float)(2 * (i % N) + 5 * (i / N / N));
    struct sp_volume *v = sp_volume_create(&grid, SP_FLOAT32, values, "linear", NULL);
    struct sp_transfer_function tf = { .reference_length = 1,
                                       .order = SP_TF_POST,
                                       .point_count = 1,
                                       .points = { { 3, { 0 }, 0.5f } } };
    struct sp_pool *pool = sp_pool_create(1, NULL);
    struct sp_classify_job job = {
        .tf = &tf, .levels = 1 << 1, .axis = SP_NO_AXIS, .normals = true, .reach = 2, .pool = pool
    };
    struct sp_classification c;
    sp_classification_init(&c, v);
    assert_true(sp_classification_update(&c, &job, NULL));
    const struct sp_level *level = &c.levels[1];
    assert_int_equal(level->visible.count, N * N * N / 8);
    for (uint64_t e = 0; e < level->visible.count; e++) {
        uint16_t l;
        sp_visible_locals(&level->visible, 0, NULL, (uint32_t)e, 1, &l);
        double want = 2 * (2 * (l & 15) + 0.5) + 5 * (2 * (l >> 8) + 0.5);
        double got =
            sp_transfer_base(&level->transfer) +
            (double)sp_transfer_value(&level->transfer, sp_visible_key(&level->visible, e));
        assert_compare(fabs(got - want), <, 1e-4);
        float n[3];
        sp_gradient_unpack(sp_visible_normal(&level->visible, e), n);
        assert_compare(fabs((double)(n[0] / n[2]) - 0.4), <, 0.01);
        assert_compare(fabsf(n[1]), <, 0.01f);
    }
    sp_classification_finish(&c);
    sp_volume_unref(&v);
    sp_pool_destroy(&pool);
}

/* The gradient axis scales the opacity, not the optical depth. */
static void the_gradient_axis_scales_opacity(void **state) {
    (void)state;
    struct sp_volume_info info = {
        .grid = { .dims = { 2, 2, 2 },
                  .spacing = { 1, 1, 1 },
                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } },
        .type = SP_UINT8,
        .range = { 0, 200 }
    };
    struct sp_transfer_function tf = {
        .reference_length = 1,
        .point_count = 2,
        .points = { { 0, { 1, 1, 1 }, 0 }, { 200, { 1, 1, 1 }, 0.8f } },
        .gradient_count = 3,
        .gradient = { { 10, 0 }, { 30, 0.5f }, { 40, 1 } },
    };
    struct sp_transfer transfer;
    struct sp_gradient_grid units;
    assert_true(sp_transfer_init(&transfer, &tf, &info, NULL, NULL));
    sp_gradient_units_init(&units, &info);
    for (double m = 0; m < 60; m += 1.3) {
        double scale = m < 10 ? 0 : m < 30 ? (m - 10) / 40 : m < 40 ? 0.5 + (m - 30) / 20 : 1;
        assert_compare(fabs(sp_transfer_function_scale(&tf, m) - scale), <, 1e-6);
        uint32_t packed = sp_gradient_pack(&units, (double[3]){ 0, m * units.scale, 0 });
        struct sp_class c = sp_transfer_class_at(&transfer, 150, packed);
        /* The square root of a magnitude is stored to a thousandth of the largest root. */
        double exact = sp_transfer_function_scale(&tf, sp_gradient_magnitude(&units, packed));
        assert_compare(fabs((double)c.depth + log1p(-0.6 * exact)), <, 1e-5);
        assert_compare(fabs(exact - scale), <, 0.02);
    }
    sp_transfer_finish(&transfer);
}

/* On a rectilinear axis, the width of a kernel follows the distances to the neighbours of its
 * voxel. A kernel of a voxel that is not in the list overlaps no kernel of a visible voxel. */
static void kernels_of_rectilinear_axes_follow_the_local_spacing(void **state) {
    (void)state;
    enum { N = 96 };
    static double at[N];
    static uint8_t bytes[N * N];
    for (int i = 1; i < N; i++)
        at[i] = at[i - 1] + 0.3 + 0.002 * (i - N / 2) * (i - N / 2);
    struct sp_grid grid = { .dims = { N, N, 1 },
                            .spacing = { at[N - 1] / (N - 1), 1, 1 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } },
                            .coordinates = { at } };
    for (int i = 0; i < N * N; i++)
        bytes[i] = i % N == 40 ? 100 : 0; /* one column of samples */
    struct sp_volume *v = sp_volume_create(&grid, SP_UINT8, bytes, "graded", NULL);
    assert_non_null(v);
    const struct sp_grid *g = &sp_volume_info(v)->grid;
    struct sp_transfer_function tf = { .reference_length = 1,
                                       .order = SP_TF_POST,
                                       .point_count = 2,
                                       .points = { { 50, { 0 }, 0 }, { 60, { 0 }, 0.5f } } };
    struct sp_pool *pool = sp_pool_create(1, NULL);
    struct sp_classify_job job = {
        .tf = &tf, .levels = 1, .axis = SP_NO_AXIS, .reach = 2.1, .pool = pool
    };
    struct sp_classification c;
    sp_classification_init(&c, v);
    assert_true(sp_classification_update(&c, &job, NULL));
    const struct sp_visible *list = &c.levels[0].visible;
    bool listed[N] = { false };
    for (uint32_t b = 0; b < sp_visible_bricks(list); b++) {
        uint32_t corner[3];
        sp_visible_brick_corner(list->bricks, b, corner);
        for (uint64_t e = list->first[b]; e < list->first[b + 1]; e++)
            listed[corner[0] + (list->place[e] & 15)] = true; /* axis 2: i0 */
    }
    int not_listed = 0;
    for (uint32_t i = 0; i < N; i++) {
        double near = 2.1 * (sp_grid_local_spacing(g, 0, i) + sp_grid_local_spacing(g, 0, 40));
        if (fabs(at[i] - at[40]) <= near)
            assert_true(listed[i]);
        not_listed += !listed[i];
    }
    assert_compare(not_listed, >, N / 2);
    sp_classification_finish(&c);
    sp_volume_unref(&v);
    sp_pool_destroy(&pool);
}

static struct sp_transfer_function random_function(void) {
    struct sp_transfer_function tf = { .reference_length = 1, .order = SP_TF_POST };
    tf.point_count = 1 + (uint32_t)(rand() % 6);
    for (uint32_t i = 0; i < tf.point_count; i++)
        tf.points[i] = (struct sp_tf_point){ .value = 100 + 2.5 * i, .opacity = rand() % 2 * 0.5f };
    return tf;
}

/* Compares the ranges with the function at closely spaced values, which include its points, and at
 * the intervals between them. */
static void visible_ranges_are_where_the_opacity_is_not_zero(void **state) {
    (void)state;
    enum { STEPS = 41 };
    for (int n = 0; n < 200; n++) {
        const struct sp_transfer_function tf = random_function();
        struct sp_visible_ranges ranges, keys;
        bool is_visible[STEPS];
        sp_visible_ranges_init(&ranges, &tf);
        sp_visible_ranges_init_keys(&keys, &tf, 99);
        assert_in_range(ranges.count, 0, tf.point_count);
        for (int i = 0; i < STEPS; i++) {
            struct sp_class c;
            sp_transfer_function_eval(&tf, 98 + 0.5 * i, &c);
            is_visible[i] = c.depth > 0;
        }
        for (int i = 0; i < STEPS; i++)
            for (int k = i, any = 0; k < STEPS; k++) {
                any = any || is_visible[k];
                assert_int_equal(sp_visible_ranges_overlap(&ranges, 98 + 0.5 * i, 98 + 0.5 * k),
                                 any);
                assert_int_equal(sp_visible_ranges_overlap(&keys, 0.5 * i - 1, 0.5 * k - 1), any);
            }
        assert_false(sp_visible_ranges_overlap(&ranges, INFINITY, -INFINITY));
    }
}

/* A background whose value is the first one of a ramp is not visible. */
static void a_background_at_the_start_of_a_ramp_is_not_listed(void **state) {
    (void)state;
    struct sp_pool *pool = sp_pool_create(1, NULL);
    static float reals[X * Y * Z];
    const struct sp_grid grid = { .dims = { X, Y, Z },
                                  .spacing = { 1, 1, 1 },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    for (int i = 0; i < X * Y * Z; i++)
        reals[i] = 0.1f;
    reals[0] = 1;
    struct sp_volume *v = sp_volume_create(&grid, SP_FLOAT32, reals, "v", NULL);
    struct sp_transfer_function tf = {
        .reference_length = 1,
        .order = SP_TF_POST,
        .point_count = 3,
        .points = { { -1, { 0 }, 0 }, { (double)0.1f, { 0 }, 0 }, { 0.5, { 0 }, 0.5f } }
    };
    struct sp_classify_job job = {
        .tf = &tf, .levels = 1, .axis = SP_NO_AXIS, .reach = 2, .pool = pool
    };
    struct sp_classification c;
    assert_non_null(v);
    sp_classification_init(&c, v);
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_in_range(c.levels[0].visible.count, 1, 8 * 8 * 8);
    sp_classification_finish(&c);
    sp_volume_unref(&v);
    sp_pool_destroy(&pool);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(voxels_that_matter_are_listed),
        one_thread_test(lists_depend_on_the_kernel_width),
        one_thread_test(kernels_of_rectilinear_axes_follow_the_local_spacing),
        one_thread_test(mip_levels_average_the_scalar),
        one_thread_test(the_gradient_axis_scales_opacity),
        one_thread_test(visible_ranges_are_where_the_opacity_is_not_zero),
        one_thread_test(a_background_at_the_start_of_a_ramp_is_not_listed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
