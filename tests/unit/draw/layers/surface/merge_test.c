/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/merge.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "draw/layers/surface/cache.h"
#include "support/compare.h"

enum { N = 40 };

typedef double value_fn(double x, double y, double z);

static double ball(double x, double y, double z) {
    return 15.2 - sqrt(x * x + y * y + z * z);
}

static double wall(double x, double y, double z) {
    (void)y, (void)z;
    return 0.6 - fabs(x - 0.3); /* thinner than a pair of cells */
}

struct fixture {
    struct sp_surface_cache cache;
    struct sp_surface_cache_job job;
};

static void begin(struct fixture *f, value_fn *value, double depth, unsigned threads) {
    static float voxels[N * N * N];
    const struct sp_grid grid = { .dims = { N, N, N },
                                  .spacing = { 1, 1, depth },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    struct sp_error err = { 0 };
    for (int i = 0; i < N * N * N; i++)
        voxels[i] = (float)value(i % N - 19.4, i / N % N - 19.6, (i / N / N - 19.5) * depth);
    *f = (struct fixture){ .job = { .volume = sp_volume_create(&grid, SP_FLOAT32, voxels, "", &err),
                                    .value = 0,
                                    .bytes_max = UINT64_MAX,
                                    .pool = sp_pool_create(threads, &err) } };
    assert_non_null(f->job.volume);
    assert_non_null(f->job.pool);
    sp_surface_cache_begin(&f->cache);
}

static void end(struct fixture *f) {
    sp_surface_cache_evict(&f->cache, NULL);
    assert_int_equal(sp_surface_cache_bytes(&f->cache, NULL), 0);
    sp_pool_destroy(&f->job.pool);
    sp_volume_unref(&f->job.volume);
}

static const struct sp_surface_points *get(struct fixture *f, unsigned level) {
    struct sp_error err = { 0 };
    f->job.level = level;
    const struct sp_surface_points *points = sp_surface_cache_get(&f->cache, &f->job, &err);
    if (!points)
        fail_msg("%s", err.text);
    return points;
}

/* The vector area of the points on one side of axis 0, in faces. */
static double area_of(const struct sp_surface_points *p, int sign) {
    double sum = 0;
    for (uint64_t i = 0; i < p->count; i++)
        if (p->area[0][i] * sign > 0)
            sum += ldexp(p->area[0][i] / (double)SURFACE_AREA_STEPS, 2 * p->level);
    return sum;
}

static void areas_and_places_remain(void **state) {
    (void)state;
    static const double depths[] = { 1, 3 };
    for (int d = 0; d < 2; d++) {
        struct fixture f;
        begin(&f, ball, depths[d], 2);
        const struct sp_surface_points *all = get(&f, 0);
        for (unsigned level = 1; level < SURFACE_LEVELS; level++) {
            const struct sp_surface_points *p = get(&f, level);
            assert_int_equal(p->level, level);
            assert_compare((double)p->count, <, 0.55 * (double)get(&f, level - 1)->count);
            for (int sign = -1; sign <= 1; sign += 2)
                assert_compare(fabs(area_of(p, sign) / area_of(all, sign) - 1), <, 0.003);
            for (uint32_t b = 0; b < p->block_count; b++)
                for (uint64_t i = p->blocks[b].first; i < p->blocks[b].first + p->blocks[b].count;
                     i++) {
                    double square = 0;
                    for (int a = 0; a < 3; a++) {
                        const double middle = a == 0 ? 19.4 : a == 1 ? 19.6 : 19.5;
                        double at = p->blocks[b].corner[a] +
                                    p->at[a][i] / (double)SURFACE_PLACE_STEPS - middle;
                        square += at * at * (a == 2 ? depths[d] * depths[d] : 1);
                        assert_in_range(p->at[a][i], p->blocks[b].low[a], p->blocks[b].high[a]);
                    }
                    /* Inside of the sphere by at most the height of a cap over the group. */
                    assert_compare(sqrt(square), <, 15.3);
                    assert_compare(sqrt(square), >, 15.1 - 0.1 * ldexp(1, 2 * (int)level - 1));
                }
        }
        end(&f);
    }
}

static void both_sides_of_a_thin_wall_remain(void **state) {
    (void)state;
    for (unsigned level = 1; level < SURFACE_LEVELS; level++) {
        struct fixture f;
        begin(&f, wall, 1, 1);
        const struct sp_surface_points *p = get(&f, level);
        for (int sign = -1; sign <= 1; sign += 2)
            assert_compare(fabs(area_of(p, sign) * sign - (N - 1) * (N - 1)), <, 2);
        end(&f);
    }
}

static void threads_do_not_matter(void **state) {
    (void)state;
    struct fixture one, three;
    begin(&one, ball, 1, 1);
    begin(&three, ball, 1, 3);
    const struct sp_surface_points *a = get(&one, 1), *b = get(&three, 1);
    assert_int_equal(a->count, b->count);
    for (int i = 0; i < 3; i++) {
        assert_memory_equal(a->at[i], b->at[i], a->count * sizeof *a->at[i]);
        assert_memory_equal(a->normal[i], b->normal[i], a->count * sizeof *a->normal[i]);
    }
    end(&one);
    end(&three);
}

/* If memory is too small for a level, all points are drawn. */
static void levels_are_kept_within_the_budget(void **state) {
    (void)state;
    const atomic_bool cancel = true;
    struct sp_error err = { 0 };
    struct fixture f;
    begin(&f, ball, 1, 2);
    get(&f, 0);
    const uint64_t used = sp_surface_cache_bytes(&f.cache, NULL);
    f.job.bytes_max = used + 100;
    assert_int_equal(get(&f, 1)->level, 0);
    f.job.bytes_max = UINT64_MAX;
    f.job.interrupt.cancel = &cancel;
    assert_null(sp_surface_cache_get(&f.cache, &f.job, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    f.job.interrupt.cancel = NULL;
    assert_int_equal(get(&f, 1)->level, 1);
    assert_compare((double)sp_surface_cache_bytes(&f.cache, NULL), >, (double)used);
    end(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(areas_and_places_remain),
                                        cmocka_unit_test(both_sides_of_a_thin_wall_remain),
                                        cmocka_unit_test(threads_do_not_matter),
                                        cmocka_unit_test(levels_are_kept_within_the_budget) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
