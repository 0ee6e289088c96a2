/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/cache.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"

enum { N = 44 };
static const double radius = 16.3;

typedef double value_fn(double x, double y, double z);

static double ball(double x, double y, double z) {
    return 100 + 10 * (radius - sqrt(x * x + y * y + z * z));
}

static double nothing(double x, double y, double z) {
    (void)x, (void)y, (void)z;
    return 42;
}

static double holes(double x, double y, double z) {
    return x > 5 ? (double)NAN : y > 8 ? (double)INFINITY : ball(x, y, z);
}

static double plateaus(double x, double y, double z) {
    return ball(x, y, z) > 100 ? 100 : 0; /* the iso-value itself; most gradients are 0 */
}

static struct sp_volume *make(value_fn *value, const double spacing[3]) {
    static float voxels[N * N * N];
    struct sp_grid grid = { .dims = { N, N, N },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    struct sp_error err;
    memcpy(grid.spacing, spacing, sizeof grid.spacing);
    for (int z = 0; z < N; z++)
        for (int y = 0; y < N; y++)
            for (int x = 0; x < N; x++)
                voxels[(z * N + y) * N + x] = (float)value(
                    (x - 21.4) * spacing[0], (y - 21.6) * spacing[1], (z - 21.5) * spacing[2]);
    struct sp_volume *volume = sp_volume_create(&grid, SP_FLOAT32, voxels, "test", &err);
    assert_non_null(volume);
    return volume;
}

struct fixture {
    struct sp_surface_cache cache;
    struct sp_surface_cache_job job;
};

static void begin(struct fixture *f, struct sp_volume *volume, double value, unsigned threads) {
    struct sp_error err;
    memset(f, 0, sizeof *f);
    f->job = (struct sp_surface_cache_job){ .volume = volume,
                                            .value = value,
                                            .bytes_max = UINT64_MAX,
                                            .pool = sp_pool_create(threads, &err) };
    assert_non_null(f->job.pool);
    sp_surface_cache_begin(&f->cache);
}

static void end(struct fixture *f) {
    sp_surface_cache_evict(&f->cache, NULL);
    assert_int_equal(sp_surface_cache_bytes(&f->cache, NULL), 0);
    sp_pool_destroy(&f->job.pool);
    sp_volume_unref(&f->job.volume);
}

static double area_of(const struct sp_surface_points *points, const double faces[3]) {
    double sum = 0;
    for (uint64_t i = 0; i < points->count; i++) {
        double square = 0;
        for (int a = 0; a < 3; a++) {
            double part = points->area[a][i] / (double)SURFACE_AREA_STEPS * faces[a];
            square += part * part;
        }
        sum += sqrt(square);
    }
    return sum;
}

static void spheres_have_their_area(void **state) {
    (void)state;
    static const double spacings[2][3] = { { 1, 1, 1 }, { 1, 1, 0.8 } };
    for (int i = 0; i < 2; i++) {
        const double *s = spacings[i];
        struct fixture f;
        begin(&f, make(ball, s), 100, 1);
        const struct sp_surface_points *points = sp_surface_cache_get(&f.cache, &f.job, NULL);
        const double faces[3] = { s[1] * s[2], s[0] * s[2], s[0] * s[1] };
        const double exact = 4 * M_PI * radius * radius;
        assert_non_null(points);
        assert_compare(area_of(points, faces), >, 0.99 * exact);
        assert_compare(area_of(points, faces), <, 1.01 * exact);
        end(&f);
    }
}

/* Points lie on the ball, and normals point to its middle. */
static void points_lie_on_the_surface(void **state) {
    (void)state;
    struct fixture f;
    begin(&f, make(ball, (double[]){ 1, 1, 1 }), 100, 2);
    const struct sp_surface_points *points = sp_surface_cache_get(&f.cache, &f.job, NULL);
    assert_non_null(points);
    for (uint32_t b = 0; b < points->block_count; b++)
        for (uint64_t i = points->blocks[b].first;
             i < points->blocks[b].first + points->blocks[b].count; i++) {
            static const double middle[3] = { 21.4, 21.6, 21.5 };
            double away[3], distance = 0, dot = 0;
            for (int a = 0; a < 3; a++) {
                away[a] = points->blocks[b].corner[a] +
                          points->at[a][i] / (double)SURFACE_PLACE_STEPS - middle[a];
                distance += away[a] * away[a];
                dot -= away[a] * points->normal[a][i] / (double)SURFACE_NORMAL_STEPS;
            }
            distance = sqrt(distance);
            assert_compare(fabs(distance - radius), <, 0.03);
            assert_compare(dot / distance, >, 0.9999);
            /* ½·(2/R) for a kernel of one voxel. */
            assert_compare(fabs(points->bend[i] / (double)SURFACE_BEND_STEPS - 1 / radius), <,
                           0.01);
        }
    end(&f);
}

static void threads_do_not_matter(void **state) {
    (void)state;
    struct fixture f, g;
    begin(&f, make(ball, (double[]){ 1, 1, 1 }), 103, 1);
    begin(&g, make(ball, (double[]){ 1, 1, 1 }), 103, 3);
    const struct sp_surface_points *a = sp_surface_cache_get(&f.cache, &f.job, NULL);
    const struct sp_surface_points *b = sp_surface_cache_get(&g.cache, &g.job, NULL);
    assert_non_null(a);
    assert_non_null(b);
    assert_int_equal(a->count, b->count);
    assert_memory_equal(a->blocks, b->blocks, a->block_count * sizeof *a->blocks);
    for (int k = 0; k < 3; k++) {
        assert_memory_equal(a->at[k], b->at[k], a->count * sizeof *a->at[k]);
        assert_memory_equal(a->area[k], b->area[k], a->count * sizeof *a->area[k]);
        assert_memory_equal(a->normal[k], b->normal[k], a->count * sizeof *a->normal[k]);
    }
    end(&f);
    end(&g);
}

static uint64_t count_of(value_fn *value, double iso) {
    struct fixture f;
    struct sp_error err = { 0 };
    begin(&f, make(value, (double[]){ 1, 1, 1 }), iso, 1);
    const struct sp_surface_points *points = sp_surface_cache_get(&f.cache, &f.job, &err);
    assert_non_null(points);
    uint64_t count = points->count;
    end(&f);
    return count;
}

static void degenerate_input_gives_empty_or_partial_lists(void **state) {
    (void)state;
    assert_int_equal(count_of(nothing, 42), 0);
    assert_int_equal(count_of(nothing, 10), 0);
    assert_int_equal(count_of(ball, 1e9), 0);
    assert_int_equal(count_of(ball, -1e300), 0);
    uint64_t all = count_of(ball, 100), part = count_of(holes, 100);
    assert_compare(part, >, 0.3 * (double)all);
    assert_compare(part, <, 0.8 * (double)all);
    assert_compare(count_of(plateaus, 100), >, 0.8 * (double)all);
}

static void lists_are_kept_within_the_budget(void **state) {
    (void)state;
    struct fixture f;
    struct sp_error err = { 0 };
    begin(&f, make(ball, (double[]){ 1, 1, 1 }), 100, 1);
    const struct sp_surface_points *points = sp_surface_cache_get(&f.cache, &f.job, &err);
    const uint64_t one = sp_surface_cache_bytes(&f.cache, NULL);
    assert_non_null(points);
    assert_ptr_equal(sp_surface_cache_get(&f.cache, &f.job, &err), points);
    assert_int_equal(sp_surface_cache_bytes(&f.cache, f.job.volume), one);
    /* A second list does not fit beside the first one of the same frame … */
    f.job.value = 101;
    f.job.bytes_max = one + 1000;
    assert_null(sp_surface_cache_get(&f.cache, &f.job, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    /* … but replaces it in the next one. */
    sp_surface_cache_begin(&f.cache);
    assert_non_null(sp_surface_cache_get(&f.cache, &f.job, &err));
    assert_compare(sp_surface_cache_bytes(&f.cache, NULL), <=, one + 1000);
    end(&f);
}

static void cancellation_leaves_nothing(void **state) {
    (void)state;
    const atomic_bool cancel = true;
    struct fixture f;
    struct sp_error err = { 0 };
    begin(&f, make(ball, (double[]){ 1, 1, 1 }), 100, 2);
    f.job.interrupt.cancel = &cancel;
    assert_null(sp_surface_cache_get(&f.cache, &f.job, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    assert_int_equal(sp_surface_cache_bytes(&f.cache, NULL), 0);
    end(&f);
}

#define STORE(name, type)                                                                          \
    case name:                                                                                     \
        ((type *)voxels)[index] = (type)value;                                                     \
        break

static void store(void *voxels, enum sp_type type, size_t index, double value) {
    switch (type) {
        STORE(SP_UINT8, uint8_t);
        STORE(SP_INT8, int8_t);
        STORE(SP_UINT16, uint16_t);
        STORE(SP_INT16, int16_t);
        STORE(SP_INT32, int32_t);
        STORE(SP_FLOAT32, float);
        STORE(SP_FLOAT64, double);
    case SP_TYPE_COUNT:
        break;
    }
}
#undef STORE

/* Every type of sample, and rows that are longer than what is searched at a time. */
static void types_and_long_rows_have_the_same_points(void **state) {
    (void)state;
    enum { LONG = 1100, WIDE = 12 };
    static const enum sp_type types[] = { SP_UINT8, SP_INT8,    SP_UINT16, SP_INT16,
                                          SP_INT32, SP_FLOAT32, SP_FLOAT64 };
    const struct sp_grid grid = { .dims = { LONG, WIDE, WIDE },
                                  .spacing = { 1, 1, 1 },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    static double samples[LONG * WIDE * WIDE];
    static double voxels[LONG * WIDE * WIDE];
    uint64_t crossings = 0;
    for (int i = 0; i < LONG * WIDE * WIDE; i++)
        samples[i] = i % LONG % 37 < 19 ? 20 : 90; /* sheets across axis 0 */
    for (int x = 1; x < LONG; x++)
        crossings += samples[x] != samples[x - 1];
    for (size_t t = 0; t < sizeof types / sizeof types[0]; t++) {
        struct sp_error err;
        struct fixture f;
        for (int i = 0; i < LONG * WIDE * WIDE; i++)
            store(voxels, types[t], (size_t)i, samples[i]);
        begin(&f, sp_volume_create(&grid, types[t], voxels, "test", &err), 50, 2);
        const struct sp_surface_points *points = sp_surface_cache_get(&f.cache, &f.job, &err);
        assert_non_null(points);
        assert_int_equal(points->count, crossings * (WIDE - 1) * (WIDE - 1));
        end(&f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spheres_have_their_area),
        cmocka_unit_test(points_lie_on_the_surface),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(degenerate_input_gives_empty_or_partial_lists),
        cmocka_unit_test(lists_are_kept_within_the_budget),
        cmocka_unit_test(types_and_long_rows_have_the_same_points),
        cmocka_unit_test(cancellation_leaves_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
