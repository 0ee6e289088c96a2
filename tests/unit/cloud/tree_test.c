/* SPDX-License-Identifier: Apache-2.0
 *
 * Levels of detail of points: sums over cells, and what a frame chooses of them.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "cloud/cut.h"
#include "support/compare.h"

enum { COUNT = 20000 };

static const struct sp_interrupt never = { NULL, NULL };

/* A dense ball in a wide cloud, a few coincident points, and two that cannot be drawn. */
static struct sp_volume *make_points(void) {
    static float positions[COUNT][3], factors[COUNT][6], values[COUNT], volumes[COUNT];
    const struct sp_elements e = { .shape = { .kind = SP_KIND_POINTS, .count = COUNT },
                                   .positions = positions,
                                   .factors = factors,
                                   .values = values,
                                   .volumes = volumes };
    uint32_t seed = 3;
    for (int i = 0; i < COUNT; i++) {
        for (int a = 0; a < 3; a++) {
            seed = seed * 1664525u + 1013904223u;
            positions[i][a] = ((float)(seed >> 8) / (1 << 23) - 1) * (i % 2 ? 100 : 0.5f);
        }
        factors[i][0] = factors[i][2] = factors[i][5] = 0.1f;
        values[i] = (float)(i % 7);
        volumes[i] = 1 + (float)(i % 3);
    }
    for (int i = 0; i < 50; i++)
        positions[i][0] = positions[i][1] = positions[i][2] = 7;
    values[60] = NAN;
    positions[61][1] = INFINITY;
    struct sp_volume *volume = sp_volume_create_elements(&e, "points", NULL);
    assert_non_null(volume);
    return volume;
}

static void build_tree(struct sp_volume *volume, unsigned threads, struct sp_cloud_tree *tree) {
    struct sp_pool *pool = sp_pool_create(threads, NULL);
    assert_true(sp_cloud_tree_build(volume, pool, &never, tree, NULL));
    sp_pool_destroy(&pool);
}

/* Sums over the points of a cell. */
static void add_points(const struct sp_cloud_tree *tree, const struct sp_elements *e, uint32_t cell,
                       double sums[5]) {
    const struct sp_cloud_cell *c = &tree->cells[cell];
    for (uint32_t k = c->first; k < c->first + c->count; k++) {
        if (!c->is_leaf) {
            assert_true(k > cell);
            assert_float_equal(tree->cells[k].side, 0.5 * c->side, 1e-5);
            add_points(tree, e, k, sums);
            continue;
        }
        const uint32_t i = tree->order[k];
        const double v = (double)e->volumes[i];
        sums[0] += v;
        sums[1] += v * (double)e->values[i];
        for (int a = 0; a < 3; a++)
            sums[2 + a] += v * (double)e->positions[i][a];
    }
}

static void merged_points_stand_for_all_inside(void **state) {
    struct sp_volume *volume = make_points();
    const struct sp_elements *e = sp_volume_elements(volume);
    struct sp_cloud_tree tree;
    (void)state;
    build_tree(volume, 2, &tree);
    const struct sp_elements *m = &tree.merged;
    for (uint32_t cell = 0; cell < m->shape.count; cell += cell < 100 ? 1 : 97) {
        double sums[5] = { 0 };
        add_points(&tree, e, cell, sums);
        assert_compare(fabs((double)m->volumes[cell] - sums[0]), <=, 1e-5 * sums[0]);
        assert_float_equal(m->values[cell], sums[1] / sums[0], 1e-4);
        for (int a = 0; a < 3; a++)
            assert_float_equal(m->positions[cell][a], sums[2 + a] / sums[0], 1e-3);
        for (int k = 0; k < 6; k++)
            assert_true(isfinite(m->factors[cell][k]));
    }
    double all[5] = { 0 };
    add_points(&tree, e, 0, all);
    double expected = 0;
    for (int i = 0; i < COUNT; i++)
        expected += i == 60 || i == 61 ? 0 : 1 + i % 3;
    assert_float_equal(all[0], expected, 1e-6);
    sp_cloud_tree_finish(&tree);
    sp_volume_unref(&volume);
}

static struct sp_cloud_choice cut_at(const struct sp_cloud_tree *tree, const struct sp_elements *e,
                                     float pixels, unsigned threads, struct sp_arena *arena) {
    const struct sp_voxel_frame frame = { .ewa = { .projection = SP_ORTHOGRAPHIC, .scale = 2 } };
    const struct sp_cloud cloud = { .parts = 1,
                                    .elements = e,
                                    .merged = &tree->merged,
                                    .place = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    struct sp_cloud_choice choice;
    struct sp_pool *pool = sp_pool_create(threads, NULL);
    assert_true(sp_cloud_cut(tree, &cloud, &frame, pixels, pool, arena, &choice));
    sp_pool_destroy(&pool);
    return choice;
}

/* Each point is drawn once: by itself, or by one merged point. */
static void check_cut(const struct sp_cloud_tree *tree, const struct sp_elements *e, float pixels,
                      struct sp_arena *arena) {
    const struct sp_cloud_choice choice = cut_at(tree, e, pixels, 1, arena);
    double volume = 0, expected = 0;
    for (uint32_t i = 0; i < choice.count; i++) {
        uint32_t at = choice.elements[i];
        if (at < COUNT) {
            volume += (double)e->volumes[at];
            continue;
        }
        assert_compare(2 * tree->cells[at - COUNT].side, <=, pixels);
        volume += (double)tree->merged.volumes[at - COUNT];
    }
    for (int i = 0; i < COUNT; i++)
        expected += i == 60 || i == 61 ? 0 : 1 + i % 3;
    assert_float_equal(volume, expected, 1e-3 * expected);
    for (unsigned threads = 2; threads < 5; threads++) {
        struct sp_cloud_choice other = cut_at(tree, e, pixels, threads, arena);
        assert_int_equal(other.count, choice.count);
        assert_memory_equal(other.elements, choice.elements,
                            choice.count * sizeof *choice.elements);
    }
}

static void a_cut_has_each_point_once(void **state) {
    struct sp_volume *volume = make_points();
    const struct sp_elements *e = sp_volume_elements(volume);
    struct sp_cloud_tree tree;
    struct sp_arena arena;
    (void)state;
    sp_arena_init(&arena);
    build_tree(volume, 2, &tree);
    assert_int_equal(cut_at(&tree, e, 0, 1, &arena).count, COUNT - 2);
    assert_int_equal(cut_at(&tree, e, 1e6f, 1, &arena).count, 1);
    uint32_t before = COUNT;
    for (float pixels = 0.25f; pixels < 512; pixels *= 4) {
        check_cut(&tree, e, pixels, &arena);
        uint32_t count = cut_at(&tree, e, pixels, 1, &arena).count;
        assert_true(count < before);
        before = count;
    }
    sp_arena_finish(&arena);
    sp_cloud_tree_finish(&tree);
    sp_volume_unref(&volume);
}

/* A cluster with more points than one thread divides, far from the rest, and a heap at one place.
 */
static void a_crowded_corner_gives_the_same_tree_on_all_threads(void **state) {
    enum { MANY = 300000 };
    struct sp_elements e = { .shape = { .kind = SP_KIND_POINTS, .count = MANY } };
    e.positions = calloc(MANY, sizeof *e.positions);
    e.factors = calloc(MANY, sizeof *e.factors);
    e.values = calloc(MANY, sizeof *e.values);
    e.volumes = malloc(MANY * sizeof *e.volumes);
    uint32_t seed = 7;
    (void)state;
    for (uint32_t i = 0; i < MANY; i++) {
        for (int a = 0; a < 3 && i % 8; a++) {
            seed = seed * 1664525u + 1013904223u;
            e.positions[i][a] = (float)(seed >> 8) / (1 << 24) * (i % 1000 ? 1 : 500);
        }
        e.volumes[i] = 1;
    }
    struct sp_volume *volume = sp_volume_create_elements(&e, "points", NULL);
    struct sp_cloud_tree one, three;
    build_tree(volume, 1, &one);
    build_tree(volume, 3, &three);
    const uint32_t count = one.merged.shape.count;
    assert_int_equal(three.merged.shape.count, count);
    for (uint32_t cell = 0; cell < count; cell++) {
        assert_int_equal(three.cells[cell].first, one.cells[cell].first);
        assert_int_equal(three.cells[cell].count, one.cells[cell].count);
        assert_int_equal(three.cells[cell].is_leaf, one.cells[cell].is_leaf);
    }
    assert_memory_equal(three.order, one.order, MANY * sizeof *one.order);
    assert_memory_equal(three.merged.factors, one.merged.factors,
                        count * sizeof *one.merged.factors);
    assert_float_equal(one.merged.volumes[0], MANY, 0);
    for (uint32_t cell = 0; cell < count; cell += 101) {
        double sums[5] = { 0 };
        add_points(&one, sp_volume_elements(volume), cell, sums);
        assert_float_equal(one.merged.volumes[cell], sums[0], 0);
        if (one.cells[cell].is_leaf) /* or a heap at one place */
            assert_true(one.cells[cell].count <= 8 || one.cells[cell].side < 0.01f);
    }
    sp_cloud_tree_finish(&one);
    sp_cloud_tree_finish(&three);
    sp_volume_unref(&volume);
    free(e.positions);
    free(e.factors);
    free(e.values);
    free(e.volumes);
}

static void points_without_a_place_have_a_tree(void **state) {
    float positions[3][3] = { { NAN, 0, 0 }, { 0, INFINITY, 0 }, { 1, 1, 1 } };
    float factors[3][6] = { { 0 } }, values[3] = { 0, 0, NAN }, volumes[3] = { 1, 1, 1 };
    const struct sp_elements e = { .shape = { .kind = SP_KIND_POINTS, .count = 3 },
                                   .positions = positions,
                                   .factors = factors,
                                   .values = values,
                                   .volumes = volumes };
    struct sp_volume *volume = sp_volume_create_elements(&e, "points", NULL);
    struct sp_cloud_tree tree;
    struct sp_arena arena;
    (void)state;
    sp_arena_init(&arena);
    build_tree(volume, 2, &tree);
    assert_int_equal(cut_at(&tree, sp_volume_elements(volume), 8, 2, &arena).count, 0);
    sp_arena_finish(&arena);
    sp_cloud_tree_finish(&tree);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(merged_points_stand_for_all_inside),
        cmocka_unit_test(a_cut_has_each_point_once),
        cmocka_unit_test(a_crowded_corner_gives_the_same_tree_on_all_threads),
        cmocka_unit_test(points_without_a_place_have_a_tree),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
