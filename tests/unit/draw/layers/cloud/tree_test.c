/* SPDX-License-Identifier: Apache-2.0
 *
 * Levels of detail of points: sums over cells, and what a frame chooses of them.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "draw/layers/cloud/cache.h"
#include "draw/layers/cloud/colors.h"
#include "draw/layers/cloud/cut.h"
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

/* Checks that a point is within the bounds of a cell. */
static void check_bounds(const struct sp_cloud_tree *tree, const struct sp_elements *e,
                         const struct sp_cloud_node *node, uint32_t i) {
    double square = 0, deviation = 0;
    for (int a = 0; a < 3; a++)
        square += pow((double)(e->positions[i][a] - node->position[a]), 2);
    for (int k = 0; k < 6; k++)
        deviation = fmax(deviation, (double)fabsf(e->factors[i][k]));
    assert_compare(sqrt(square), <=, (double)sp_cloud_bound(node->reach));
    assert_compare(deviation, <=, (double)sp_cloud_bound(node->deviation));
    assert_in_range(sp_cloud_bin(tree, e->values[i]), node->low, node->high);
}

/* Checks the bounds of a cell against all points inside. */
static void check_inside(const struct sp_cloud_tree *tree, const struct sp_elements *e,
                         const struct sp_cloud_node *node, const struct sp_cloud_cell *from) {
    for (uint32_t k = from->first; k < from->first + from->count; k++)
        if (from->is_leaf)
            check_bounds(tree, e, node, tree->order[k]);
        else
            check_inside(tree, e, node, &tree->nodes[k].cell);
}

/* Sums over the points of a cell. */
static void add_points(const struct sp_cloud_tree *tree, const struct sp_elements *e, uint32_t cell,
                       double sums[6]) {
    const struct sp_cloud_cell *c = &tree->nodes[cell].cell;
    for (uint32_t k = c->first; k < c->first + c->count; k++) {
        if (!c->is_leaf) {
            assert_true(k > cell);
            assert_float_equal(tree->nodes[k].cell.side, 0.5 * c->side, 1e-5);
            add_points(tree, e, k, sums);
            continue;
        }
        const uint32_t i = tree->order[k];
        const double v = (double)e->volumes[i];
        sums[0] += v;
        sums[1] += v * (double)e->values[i];
        sums[5] += v * pow((double)e->values[i], 2);
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
    for (uint32_t cell = 0; cell < tree.count; cell += cell < 100 ? 1 : 97) {
        const struct sp_cloud_node *m = &tree.nodes[cell];
        double sums[6] = { 0 };
        add_points(&tree, e, cell, sums);
        check_inside(&tree, e, m, &m->cell);
        assert_compare(fabs((double)m->volume - sums[0]), <=, 1e-5 * sums[0]);
        assert_float_equal(m->value, sums[1] / sums[0], 1e-4);
        for (int a = 0; a < 3; a++)
            assert_float_equal(m->position[a], sums[2 + a] / sums[0], 1e-3);
        for (int k = 0; k < 6; k++)
            assert_true(isfinite(m->factor[k]));
        const double mean = sums[1] / sums[0], variance = sums[5] / sums[0] - mean * mean;
        const double step = (m->high - m->low + 1) * (double)sp_cloud_spread_step(&tree);
        assert_float_equal(sp_cloud_spread(&tree, m), sqrt(fmax(variance, 0)), 1e-4 + step);
    }
    double all[6] = { 0 };
    add_points(&tree, e, 0, all);
    double expected = 0;
    for (int i = 0; i < COUNT; i++)
        expected += i == 60 || i == 61 ? 0 : 1 + i % 3;
    assert_float_equal(all[0], expected, 1e-6);
    sp_cloud_tree_finish(&tree);
    sp_volume_unref(&volume);
}

static struct sp_cloud_choice cut_in(const struct sp_cloud_tree *tree, const struct sp_elements *e,
                                     const struct sp_voxel_frame *frame,
                                     const struct sp_visible_ranges *visible, float pixels,
                                     unsigned threads, struct sp_arena *arena) {
    const struct sp_cloud cloud = { .parts = 1,
                                    .size = 1,
                                    .elements = e,
                                    .tree = tree,
                                    .place = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    const struct sp_cloud_cut cut = {
        .tree = tree, .cloud = &cloud, .frame = frame, .visible = visible, .pixels = pixels
    };
    struct sp_cloud_choice choice;
    struct sp_pool *pool = sp_pool_create(threads, NULL);
    assert_true(sp_cloud_cut(&cut, pool, arena, &choice));
    sp_pool_destroy(&pool);
    return choice;
}

/* Returns the cut for a view that has all points in its image. */
static struct sp_cloud_choice cut_at(const struct sp_cloud_tree *tree, const struct sp_elements *e,
                                     float pixels, unsigned threads, struct sp_arena *arena) {
    const struct sp_voxel_frame frame = { .ewa = { .projection = SP_ORTHOGRAPHIC,
                                                   .scale = 2,
                                                   .near = -1000,
                                                   .centre = { 500, 500 },
                                                   .size = { 1000, 1000 } } };
    return cut_in(tree, e, &frame, NULL, pixels, threads, arena);
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
        const struct sp_cloud_node *node = &tree->nodes[at - COUNT];
        if (node->cell.count > 1) /* one point is the same as its merged one */
            assert_compare(2 * node->cell.side, <=, pixels);
        volume += (double)node->volume;
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
    const uint32_t count = one.count;
    assert_int_equal(three.count, count);
    assert_memory_equal(three.order, one.order, MANY * sizeof *one.order);
    assert_memory_equal(three.nodes, one.nodes, count * sizeof *one.nodes);
    assert_float_equal(one.nodes[0].volume, MANY, 0);
    for (uint32_t cell = 0; cell < count; cell += 101) {
        double sums[6] = { 0 };
        add_points(&one, sp_volume_elements(volume), cell, sums);
        const struct sp_cloud_node *node = &one.nodes[cell];
        assert_float_equal(node->volume, sums[0], 0);
        if (node->cell.is_leaf) /* or a heap at one place */
            assert_true(node->cell.count <= 8 || node->cell.side < 0.01f);
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

/* True if the ball around the point where its kernel ends reaches into the pyramid of the image
 * beyond the near plane (splat/close.h). */
static bool reaches_pyramid(const struct sp_ewa_frame *f, const float p[3], float reach) {
    for (int side = 0; side < 4; side++) {
        const int axis = side / 2;
        const float sign = side % 2 ? -1 : 1, end = side % 2 ? (float)f->size[axis] : 0;
        const float slope = (end - f->centre[axis]) / f->scale;
        if (sign * (p[axis] - slope * p[2]) < -reach * sqrtf(1 + slope * slope))
            return false;
    }
    return p[2] + reach >= f->near;
}

/* True if a splat of the point may touch the image, by the formulas of splat/ewa.h or, if it is
 * close to the eye, of splat/close.h. */
static bool is_seen(const struct sp_ewa_frame *f, const float p[3], float deviation) {
    for (uint32_t i = 0; i < f->clip.count; i++) {
        const struct sp_clip_half *half = &f->clip.planes[i];
        if (p[0] * half->normal[0] + p[1] * half->normal[1] + p[2] * half->normal[2] < half->offset)
            return false;
    }
    if (p[2] < SP_CLOSE_EXACT * deviation)
        return reaches_pyramid(f, p, f->radius * deviation);
    if (!(p[2] >= f->near))
        return false;
    for (int axis = 0; axis < 2; axis++) {
        const float ratio = p[axis] / p[2], most = f->ratio_max[axis];
        const float bounded = fminf(fmaxf(ratio, -most), most);
        const float scale = f->scale / p[2] * deviation;
        const float reach =
            f->radius * sqrtf(scale * scale * (1 + bounded * bounded) + f->lowpass2);
        const float x = f->centre[axis] + f->scale * ratio;
        if (x + reach < 0.5f || x - reach > (float)f->size[axis] - 0.5f)
            return false;
    }
    return true;
}

/* Fills which points a cut has, in its merged points as well. */
static void mark(const struct sp_cloud_tree *tree, const struct sp_cloud_cell *cell, bool *has) {
    for (uint32_t k = cell->first; k < cell->first + cell->count; k++)
        if (cell->is_leaf)
            has[tree->order[k]] = true;
        else
            mark(tree, &tree->nodes[k].cell, has);
}

/* The eye is among the points: the cut has every point that can be seen and lacks most others. */
static void a_cut_leaves_out_what_cannot_be_seen(void **state) {
    static bool has[COUNT];
    struct sp_volume *volume = make_points();
    const struct sp_elements *e = sp_volume_elements(volume);
    const struct sp_voxel_frame frame = {
        .ewa = { .scale = 200,
                 .near = 0.2f,
                 .centre = { 50, 40 },
                 .size = { 100, 80 },
                 .ratio_max = { 0.625f, 0.56f },
                 .radius = 3,
                 .lowpass2 = 0.3f,
                 .clip = { .count = 1, .planes = { { { 0, 0, -1 }, -60 } } } }
    };
    const struct sp_visible_ranges visible = { .count = 1,
                                               .interval = { { .low = 2.5, .high = 3.5 } } };
    struct sp_cloud_tree tree;
    struct sp_arena arena;
    uint32_t wanted = 0, chosen = 0;
    (void)state;
    sp_arena_init(&arena);
    build_tree(volume, 2, &tree);
    const struct sp_cloud_choice cut = cut_in(&tree, e, &frame, &visible, 2, 2, &arena);
    for (uint32_t i = 0; i < cut.count; i++)
        if (cut.elements[i] < COUNT)
            has[cut.elements[i]] = true;
        else
            mark(&tree, &tree.nodes[cut.elements[i] - COUNT].cell, has);
    for (int i = 0; i < COUNT; i++) {
        const bool is_wanted = is_seen(&frame.ewa, e->positions[i], 0.1f) && i % 7 == 3;
        wanted += is_wanted;
        chosen += has[i];
        if (is_wanted && i != 60 && i != 61 && !has[i]) {
            const float *p = e->positions[i];
            fail_msg("point %d at %g %g %g is missing", i, (double)p[0], (double)p[1],
                     (double)p[2]);
        }
    }
    printf("%u of %d points are seen, %u chosen\n", wanted, COUNT, chosen);
    assert_in_range(wanted, 10, COUNT / 10);
    assert_in_range(chosen, wanted, COUNT / 4);
    sp_arena_finish(&arena);
    sp_cloud_tree_finish(&tree);
    sp_volume_unref(&volume);
}

/* Σ volume·number and Σ volume of the points of a cell whose numbers are finite. */
static void add_numbers(const struct sp_cloud_tree *tree, const struct sp_elements *e,
                        const float *numbers, const struct sp_cloud_cell *cell, double sums[2]) {
    for (uint32_t k = cell->first; k < cell->first + cell->count; k++) {
        const uint32_t i = cell->is_leaf ? tree->order[k] : 0;
        if (!cell->is_leaf) {
            add_numbers(tree, e, numbers, &tree->nodes[k].cell, sums);
        } else if (isfinite(numbers[i])) {
            sums[0] += (double)e->volumes[i] * (double)numbers[i];
            sums[1] += (double)e->volumes[i];
        }
    }
}

/* The points at one place have no number that is finite. */
static void numbers_of_merged_points_are_means(void **state) {
    static float numbers[COUNT];
    struct sp_volume *volume = make_points();
    const struct sp_elements *e = sp_volume_elements(volume);
    struct sp_cloud_tree tree;
    unsigned without = 0;
    (void)state;
    for (int i = 0; i < COUNT; i++)
        numbers[i] = i < 50 ? NAN : i % 5 ? (float)(i % 13) : INFINITY;
    build_tree(volume, 2, &tree);
    const struct sp_cloud cloud = { .parts = 1, .elements = e, .color_values = numbers };
    float *merged[2];
    for (unsigned threads = 1; threads < 3; threads++) {
        struct sp_pool *pool = sp_pool_create(threads, NULL);
        float *to = merged[threads - 1] = calloc(tree.count, sizeof *to);
        assert_true(sp_cloud_merge_colors(&cloud, &tree, pool, &never, to, NULL));
        sp_pool_destroy(&pool);
    }
    assert_memory_equal(merged[0], merged[1], tree.count * sizeof **merged);
    for (uint32_t cell = 0; cell < tree.count; cell++) {
        double sums[2] = { 0 };
        add_numbers(&tree, e, numbers, &tree.nodes[cell].cell, sums);
        without += !(sums[1] > 0);
        if (sums[1] > 0)
            assert_float_equal(merged[0][cell], sums[0] / sums[1], 1e-5);
        else
            assert_true(isnan(merged[0][cell]));
    }
    assert_in_range(without, 1, tree.count / 2);
    free(merged[0]);
    free(merged[1]);
    sp_cloud_tree_finish(&tree);
    sp_volume_unref(&volume);
}

/* Colours of two volumes and of lengths are kept apart, and go with either volume. */
static void colors_are_cached_by_both_volumes(void **state) {
    struct sp_volume *points = make_points(), *other = make_points();
    const struct sp_elements *e = sp_volume_elements(points);
    struct sp_cloud_cache cache = { 0 };
    struct sp_cloud_tree tree;
    struct sp_pool *pool = sp_pool_create(2, NULL);
    (void)state;
    build_tree(points, 2, &tree);
    const struct sp_cloud cloud = { .elements = e, .color_values = e->values };
    const struct sp_cloud_colors *own =
        sp_cloud_cache_get_colors(&cache, &cloud, &tree, points, points, pool, &never, NULL);
    assert_non_null(own);
    const struct sp_cloud_colors *foreign =
        sp_cloud_cache_get_colors(&cache, &cloud, &tree, points, other, pool, &never, NULL);
    assert_non_null(foreign);
    assert_true(foreign != own && foreign->id != own->id);
    assert_ptr_equal(
        sp_cloud_cache_get_colors(&cache, &cloud, &tree, points, points, pool, &never, NULL), own);
    assert_int_equal(sp_cloud_bytes(&cache, points), 2 * tree.count * sizeof(float));
    sp_cloud_evict(&cache, other);
    assert_int_equal(sp_cloud_bytes(&cache, points), tree.count * sizeof(float));
    sp_cloud_evict(&cache, points);
    assert_int_equal(sp_cloud_bytes(&cache, points), 0);
    sp_pool_destroy(&pool);
    sp_cloud_tree_finish(&tree);
    sp_volume_unref(&points);
    sp_volume_unref(&other);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(merged_points_stand_for_all_inside),
        cmocka_unit_test(a_cut_has_each_point_once),
        cmocka_unit_test(a_cut_leaves_out_what_cannot_be_seen),
        cmocka_unit_test(numbers_of_merged_points_are_means),
        cmocka_unit_test(colors_are_cached_by_both_volumes),
        cmocka_unit_test(a_crowded_corner_gives_the_same_tree_on_all_threads),
        cmocka_unit_test(points_without_a_place_have_a_tree),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
