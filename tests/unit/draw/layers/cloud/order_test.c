/* SPDX-License-Identifier: Apache-2.0
 *
 * The order of a cloud's elements against a sort by depth, for any number of threads.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "draw/layers/cloud/order.h"
#include "support/compare.h"

enum { COUNT = 100000 };

static float positions[COUNT][3], factors[COUNT][6], opacities[COUNT];

static void fill(void) {
    uint32_t seed = 5;
    for (int i = 0; i < COUNT; i++) {
        for (int a = 0; a < 3; a++) {
            seed = seed * 1664525u + 1013904223u;
            positions[i][a] = (float)(seed >> 8) / (1 << 20) - 4;
        }
        opacities[i] = i % 5 ? 0.5f : 0.001f; /* every fifth one cannot be seen */
    }
    positions[17][2] = NAN;
    positions[18][0] = INFINITY;
    for (int i = 100; i < 200; i++) /* equal depths stay in the order of their numbers */
        positions[i][2] = 2;
}

static struct sp_voxel_order sort_with(unsigned threads, struct sp_voxel_frame *frame,
                                       struct sp_arena *arena) {
    static struct sp_elements elements;
    static struct sp_cloud cloud;
    const struct sp_interrupt none = { NULL, NULL };
    struct sp_voxel_order order;
    struct sp_pool *pool = sp_pool_create(threads, NULL);
    elements = (struct sp_elements){ .shape = { .kind = SP_KIND_GAUSSIANS, .count = COUNT },
                                     .positions = positions,
                                     .factors = factors,
                                     .opacities = opacities };
    cloud = (struct sp_cloud){ .parts = 1,
                               .elements = &elements,
                               .opacity = 1,
                               .place = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    assert_true(sp_cloud_sort(&cloud, NULL, frame, NULL, pool, arena, &none, &order));
    sp_pool_destroy(&pool);
    return order;
}

static bool is_seen(const struct sp_voxel_frame *frame, int i) {
    return isfinite(positions[i][0]) && positions[i][2] >= frame->ewa.near && opacities[i] > 0.1f &&
           (!frame->ewa.clip.count || positions[i][0] >= 1);
}

static void check(struct sp_voxel_frame *frame) {
    struct sp_arena arena;
    sp_arena_init(&arena);
    struct sp_voxel_order order = sort_with(1, frame, &arena);
    uint32_t expected = 0;
    for (int i = 0; i < COUNT; i++)
        expected += is_seen(frame, i);
    assert_int_equal(order.count, expected);
    assert_in_range(expected, 1000, COUNT);
    for (uint32_t k = 0; k < order.count; k++) {
        assert_true(is_seen(frame, (int)order.voxels[k]));
        if (k == 0)
            continue;
        float before = positions[order.voxels[k - 1]][2], after = positions[order.voxels[k]][2];
        assert_compare(after, >=, before - 16.0f / (1 << 22));
        if (after == before)
            assert_true(order.voxels[k] > order.voxels[k - 1]);
    }
    for (unsigned threads = 2; threads < 6; threads++) {
        struct sp_voxel_order other = sort_with(threads, frame, &arena);
        assert_int_equal(other.count, order.count);
        assert_memory_equal(other.voxels, order.voxels, order.count * sizeof *order.voxels);
    }
    sp_arena_finish(&arena);
}

static void elements_are_sorted_by_depth(void **state) {
    struct sp_voxel_frame frame = { .ewa = { .near = 0.5f } };
    (void)state;
    fill();
    check(&frame);
}

static void depths_may_be_negative_and_clipped(void **state) {
    struct sp_voxel_frame frame = {
        .ewa = { .near = -3,
                 .clip = { .count = 1, .planes = { { .normal = { 1, 0, 0 }, .offset = 1 } } } }
    };
    (void)state;
    fill();
    check(&frame);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(elements_are_sorted_by_depth),
        cmocka_unit_test(depths_may_be_negative_and_clipped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
