/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/classification.h"
#include "classify/transfer.h"
#include "support/compare.h"
#include "unit/classify/volume.h"

static const struct sp_transfer_function ramp = {
    .reference_length = 1,
    .point_count = 3,
    .points = { { 10, { 0, 0, 1 }, 0 }, { 20, { 1, 0, 0 }, 0.5f }, { 40, { 1, 1, 0 }, 0.25f } },
};

static void check_class(struct sp_class c, double value) {
    double opacity, red, blue;
    if (!isfinite(value) || value <= 10) {
        opacity = 0;
        red = 0;
        blue = isfinite(value) ? 1 : 0;
    } else if (value <= 20) {
        opacity = (value - 10) / 10 * 0.5;
        red = (value - 10) / 10;
        blue = 1 - red;
    } else {
        opacity = value >= 40 ? 0.25 : 0.5 - (value - 20) / 20 * 0.25;
        red = 1;
        blue = 0;
    }
    assert_compare(fabs((double)c.depth + log(1 - opacity)), <, 1e-6);
    assert_compare(fabs((double)c.color[0] - red), <, 1e-6);
    assert_compare(fabs((double)c.color[2] - blue), <, 1e-6);
}

static void every_sample_type_gets_the_same_classes(void **state) {
    (void)state;
    static const uint8_t u8[] = { 0, 10, 11, 15, 20, 33, 40, 255 };
    static const int8_t i8[] = { -128, 10, 11, 15, 20, 33, 40, 127 };
    static const uint16_t u16[] = { 5, 10, 11, 15, 20, 33, 40, 65535 };
    static const int16_t i16[] = { -32768, 10, 11, 15, 20, 33, 40, 32767 };
    static const int32_t i32[] = { INT32_MIN, 10, 11, 15, 20, 33, 40, INT32_MAX };
    static const float f32[] = { -1e30f, 10, 10.001f, 15.5f, NAN, 33.25f, INFINITY, 1e30f };
    static const double f64[] = { -1e300, 10, 10.001, 15.5, NAN, 33.25, -INFINITY, 1e300 };
    const void *const arrays[SP_TYPE_COUNT] = { u8, i8, u16, i16, i32, f32, f64 };
    for (int type = 0; type < SP_TYPE_COUNT; type++) {
        struct sp_volume *v =
            classify_make_volume((uint32_t[3]){ 8, 1, 1 }, (enum sp_type)type, arrays[type]);
        struct sp_transfer t;
        uint32_t keys[8];
        uint8_t visible[8];
        assert_true(sp_transfer_init(&t, &ramp, sp_volume_info(v), NULL, NULL));
        sp_transfer_keys(&t, sp_volume_voxels(v), 0, 8, keys, visible);
        for (int i = 0; i < 8; i++) {
            double value = type == SP_UINT8     ? u8[i]
                           : type == SP_INT8    ? i8[i]
                           : type == SP_UINT16  ? u16[i]
                           : type == SP_INT16   ? i16[i]
                           : type == SP_INT32   ? i32[i]
                           : type == SP_FLOAT32 ? (double)f32[i]
                                                : f64[i];
            assert_int_equal(visible[i], isfinite(value) && value > 10 && fabs(value) < 1e299);
            if (visible[i])
                check_class(sp_transfer_class(&t, keys[i]), value);
        }
        sp_transfer_finish(&t);
        sp_volume_unref(&v);
    }
}

static void narrow_transfer_functions_of_doubles_are_resolved(void **state) {
    (void)state;
    /* The transfer function is far from zero and narrower than the distance of floats there. */
    const struct sp_transfer_function narrow = {
        .reference_length = 1,
        .point_count = 2,
        .points = { { 1e9, { 0 }, 0 }, { 1e9 + 1, { 0 }, 0.5f } },
    };
    static const double values[] = { 1e9 - 1, 1e9, 1e9 + 0.25, 1e9 + 0.5, 1e9 + 3 };
    struct sp_volume *v = classify_make_volume((uint32_t[3]){ 5, 1, 1 }, SP_FLOAT64, values);
    struct sp_transfer t;
    uint32_t keys[5];
    uint8_t visible[5];
    assert_true(sp_transfer_init(&t, &narrow, sp_volume_info(v), NULL, NULL));
    sp_transfer_keys(&t, sp_volume_voxels(v), 0, 5, keys, visible);
    static const double opacities[] = { 0, 0, 0.125, 0.25, 0.5 };
    for (int i = 0; i < 5; i++) {
        assert_int_equal(visible[i], i >= 2);
        if (visible[i]) {
            double opacity = 1 - exp(-(double)sp_transfer_class(&t, keys[i]).depth);
            assert_compare(fabs(opacity - opacities[i]), <, 1e-6);
        }
    }
    sp_transfer_finish(&t);
    sp_volume_unref(&v);
}

static int by_value(const void *a, const void *b) {
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

/* Computes the index of the voxel of entry e in brick b. */
static void compute_voxel(const struct sp_visible *list, uint32_t b, uint64_t e, uint32_t i[3]) {
    uint16_t local;
    sp_visible_locals(list, b, NULL, (uint32_t)(e - list->first[b]), 1, &local);
    sp_visible_brick_corner(list->bricks, b, i);
    for (int a = 0; a < 3; a++)
        i[a] += local >> (4 * a) & 15;
}

/* Returns index and key of each entry in one number, sorted; the caller frees them. */
static uint64_t *flatten(const struct sp_visible *list, const uint32_t dims[3]) {
    uint64_t *flat = malloc((list->count + 1) * sizeof *flat), n = 0;
    for (uint32_t b = 0; b < sp_visible_bricks(list); b++)
        for (uint64_t e = list->first[b]; e < list->first[b + 1]; e++) {
            uint32_t i[3];
            compute_voxel(list, b, e, i);
            flat[n++] = ((uint64_t)i[0] + dims[0] * (i[1] + (uint64_t)dims[1] * i[2])) << 8 |
                        sp_visible_key(list, e);
        }
    assert_int_equal(n, list->count);
    qsort(flat, n, sizeof *flat, by_value);
    return flat;
}

/* Asserts that the slices of each brick hold its entries once, at the right index, by place. */
static void check_slices(const struct sp_visible *list, unsigned axis) {
    for (uint32_t b = 0; b < sp_visible_bricks(list); b++) {
        uint64_t first = list->first[b];
        assert_int_equal(list->axis[b], axis);
        assert_int_equal(list->start[b][0], 0);
        assert_int_equal(list->start[b][SP_BRICK], list->first[b + 1] - first);
        for (uint32_t s = 0; s < SP_BRICK; s++)
            for (uint32_t e = list->start[b][s]; e < list->start[b][s + 1]; e++) {
                uint16_t local = sp_visible_local(axis, s, list->place[first + e]);
                assert_int_equal(local >> (4 * axis) & 15, s);
                if (e != list->start[b][s])
                    assert_compare(list->place[first + e], >, list->place[first + e - 1]);
            }
    }
}

static void lists_hold_the_visible_voxels_along_every_axis(void **state) {
    (void)state;
    enum { X = 37, Y = 16, Z = 19 };
    const uint32_t dims[3] = { X, Y, Z };
    static uint8_t values[X * Y * Z];
    srand(2);
    uint64_t visible = 0;
    values[0] = 0;
    for (int i = 1; i < X * Y * Z; i++)
        visible += (values[i] = (uint8_t)(rand() % 30)) > 10;
    struct sp_volume *v = classify_make_volume(dims, SP_UINT8, values);
    struct sp_pool *pool = sp_pool_create(3, NULL);
    struct sp_classification c;
    sp_classification_init(&c, v);
    const struct sp_visible *list = &c.levels[0].visible;
    for (unsigned axis = 0; axis <= SP_NO_AXIS; axis++) {
        struct sp_classify_job job = {
            .tf = &ramp, .levels = 1, .axis = axis, .pool = pool, .normals = axis == 1
        };
        assert_true(sp_classification_update(&c, &job, NULL));
        assert_int_equal(list->count, visible);
        assert_int_equal(sp_visible_bricks(list), 3 * 1 * 2);
        check_slices(list, axis < 3 ? axis : 2);
        uint64_t *flat = flatten(list, dims), n = 0;
        for (uint64_t i = 0; i < X * Y * Z; i++)
            if (values[i] > 10)
                assert_int_equal(flat[n++], i << 8 | values[i]);
        free(flat);
    }
    struct sp_gradient_grid grid;
    sp_gradient_grid_init(&grid, v);
    for (uint32_t b = 0; b < sp_visible_bricks(list); b++)
        for (uint64_t e = list->first[b]; e < list->first[b + 1]; e++) {
            uint32_t i[3];
            double gradient[3];
            compute_voxel(list, b, e, i);
            sp_gradient_at(&grid, i, gradient);
            assert_int_equal(((const uint16_t *)list->normal)[e],
                             sp_gradient_pack_direction(gradient));
        }
    assert_compare(sp_classification_bytes(&c), >, visible * 4);
    sp_classification_finish(&c);
    sp_pool_destroy(&pool);
    sp_volume_unref(&v);
}

/* Computes a cell of mip level l by its definition: the average over 2^l × 2^l × 2^l voxels. */
static struct sp_class average(const uint8_t *values, const uint32_t dims[3], unsigned l,
                               const uint32_t cell[3]) {
    struct sp_class sum = { { 0, 0, 0 }, 0 };
    uint32_t n = 1u << l;
    for (uint32_t i = 0; i < n * n * n; i++) {
        uint32_t x = cell[0] * n + i % n, y = cell[1] * n + i / n % n, z = cell[2] * n + i / n / n;
        if (x >= dims[0] || y >= dims[1] || z >= dims[2])
            continue;
        struct sp_class c;
        sp_transfer_function_eval(&ramp, values[x + dims[0] * (y + dims[1] * z)], &c);
        sum.depth += c.depth;
        for (int k = 0; k < 3; k++)
            sum.color[k] += c.color[k] * c.depth;
    }
    for (int k = 0; k < 3 && sum.depth > 0; k++)
        sum.color[k] /= sum.depth;
    sum.depth /= (float)(n * n * n);
    return sum;
}

static void mip_levels_average_the_classified_voxels(void **state) {
    (void)state;
    enum { X = 69, Y = 6, Z = 41 };
    const uint32_t dims[3] = { X, Y, Z };
    static uint8_t values[X * Y * Z];
    srand(3);
    for (int i = 0; i < X * Y * Z; i++)
        values[i] = (uint8_t)(rand() % 6 ? 0 : rand() % 60);
    struct sp_volume *v = classify_make_volume(dims, SP_UINT8, values);
    struct sp_pool *pool = sp_pool_create(3, NULL);
    struct sp_classification c;
    sp_classification_init(&c, v);
    for (unsigned l = 1; l < SP_LEVELS; l++) {
        struct sp_classify_job job = {
            .tf = &ramp, .levels = 1u << l, .axis = l % 3, .pool = pool
        };
        assert_true(sp_classification_update(&c, &job, NULL));
        const struct sp_level *level = &c.levels[l];
        const struct sp_visible *list = &level->visible;
        const uint32_t *d = level->grid.dims;
        check_slices(list, l % 3);
        uint64_t cells = 0;
        for (uint32_t i = 0; i < d[0] * d[1] * d[2]; i++)
            cells += average(values, dims, l,
                             (uint32_t[3]){ i % d[0], i / d[0] % d[1], i / d[0] / d[1] })
                         .depth > 0;
        assert_int_equal(cells, list->count);
        for (uint32_t b = 0; b < sp_visible_bricks(list); b++)
            for (uint64_t e = list->first[b]; e < list->first[b + 1]; e++) {
                uint32_t cell[3];
                compute_voxel(list, b, e, cell);
                struct sp_class want = average(values, dims, l, cell);
                struct sp_class got = sp_transfer_class(&level->transfer, sp_visible_key(list, e));
                assert_compare(fabsf(got.depth - want.depth), <, 1e-6f);
                for (int k = 0; k < 3; k++)
                    assert_compare(fabsf(got.color[k] - want.color[k]), <, 1e-5f);
            }
    }
    /* The centre of the first cell is at 0.5 voxels for cells of two voxels, at 1.5 for four. */
    assert_compare(c.levels[1].grid.origin[0], ==, 0.5);
    assert_compare(c.levels[2].grid.origin[1], ==, 1.5);
    assert_compare(c.levels[2].grid.spacing[2], ==, 4);
    assert_compare(c.levels[2].grid.dims[0], ==, 18);
    sp_classification_finish(&c);
    sp_pool_destroy(&pool);
    sp_volume_unref(&v);
}

/* On every mip level and for every axis of bricks, the microflakes of a cell include all its
 * voxels. */
static void microflakes_match_those_of_all_voxels(void **state) {
    (void)state;
    enum { X = 69, Y = 18, Z = 21 };
    const uint32_t dims[3] = { X, Y, Z };
    static uint8_t values[X * Y * Z];
    static struct sp_microflakes_sum sums[X * Y * Z];
    static float depths[X * Y * Z];
    srand(4);
    for (int i = 0; i < X * Y * Z; i++)
        values[i] = (uint8_t)(i % X < 20 ? 30 : rand() % 60); /* for x < 20 the gradient is zero */
    struct sp_volume *v = classify_make_volume(dims, SP_UINT8, values);
    struct sp_pool *pool = sp_pool_create(3, NULL);
    struct sp_classification c;
    sp_classification_init(&c, v);
    for (unsigned l = 1; l < 5; l++) {
        struct sp_classify_job job = {
            .tf = &ramp, .levels = 1u | 1u << l, .axis = l % 3, .normals = true, .pool = pool
        };
        assert_true(sp_classification_update(&c, &job, NULL));
        const struct sp_visible *fine = &c.levels[0].visible, *list = &c.levels[l].visible;
        const uint32_t *d = c.levels[l].grid.dims;
        uint32_t at[3];
        memset(sums, 0, sizeof sums);
        memset(depths, 0, sizeof depths);
        for (uint32_t b = 0; b < sp_visible_bricks(fine); b++)
            for (uint64_t e = fine->first[b]; e < fine->first[b + 1]; e++) {
                compute_voxel(fine, b, e, at);
                uint32_t cell = (at[0] >> l) + d[0] * ((at[1] >> l) + d[1] * (at[2] >> l));
                float depth =
                    sp_transfer_class(&c.levels[0].transfer, sp_visible_key(fine, e)).depth;
                sp_microflakes_add_normal(&sums[cell], sp_visible_normal(fine, e), depth);
                depths[cell] += depth;
            }
        for (uint32_t b = 0; b < sp_visible_bricks(list); b++)
            for (uint64_t e = list->first[b]; e < list->first[b + 1]; e++) {
                compute_voxel(list, b, e, at);
                uint32_t cell = at[0] + d[0] * (at[1] + d[1] * at[2]);
                struct sp_microflakes want = sp_microflakes_pack(&sums[cell], depths[cell]);
                struct sp_microflakes got = *sp_visible_microflakes(list, e);
                for (int i = 0; i < 7; i++) {
                    int got_byte = (int)(got.word[i / 4] >> 8 * (i % 4) & 255);
                    int want_byte = (int)(want.word[i / 4] >> 8 * (i % 4) & 255);
                    assert_compare(abs(got_byte - want_byte), <=, 2);
                }
            }
    }
    sp_classification_finish(&c);
    sp_pool_destroy(&pool);
    sp_volume_unref(&v);
}

/* A mip level of a rectilinear grid preserves the extinction and the position of each cell. */
static void rectilinear_mip_levels_preserve_extinction_and_position(void **state) {
    (void)state;
    static const double coordinates[7] = { 0, 1, 4, 5, 8, 9, 15 };
    struct sp_grid grid = { .dims = { 7, 2, 1 },
                            .spacing = { 2.5, 1, 3 },
                            .origin = { 10, 0, 0 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } },
                            .coordinates = { coordinates, NULL, NULL } };
    uint8_t values[14];
    for (int i = 0; i < 14; i++)
        values[i] = (uint8_t)(15 + i);
    struct sp_volume *v = sp_volume_create(&grid, SP_UINT8, values, "", NULL);
    assert_non_null(v);
    struct sp_pool *pool = sp_pool_create(2, NULL);
    struct sp_classification c;
    sp_classification_init(&c, v);
    struct sp_classify_job job = { .tf = &ramp, .levels = 1 << 2, .pool = pool };
    assert_true(sp_classification_update(&c, &job, NULL));
    /* Relative to the first sample, the cells are [-0.5, 2.5], [2.5, 6.5], [6.5, 12], [12, 18]. */
    static const double middles[4] = { 1, 4.5, 9.25, 15 };
    const struct sp_grid *mip = &c.levels[1].grid;
    assert_int_equal(mip->dims[0], 4);
    assert_compare(mip->origin[0], ==, 11);
    assert_compare(mip->origin[1], ==, 0.5);
    for (int i = 0; i < 4; i++)
        assert_compare(mip->coordinates[0][i], ==, middles[i] - 1);
    assert_null(mip->coordinates[1]);
    double mass[3] = { 0 }, moment[2] = { 0 };
    for (int l = 0; l < 3; l++) {
        const struct sp_level *level = &c.levels[l];
        for (uint64_t e = 0; e < level->visible.count; e++) {
            double m =
                (double)sp_transfer_class(&level->transfer, sp_visible_key(&level->visible, e))
                    .depth;
            uint16_t p;
            sp_visible_locals(&level->visible, 0, NULL, (uint32_t)e, 1, &p);
            for (unsigned a = 0; a < 3; a++)
                m *= sp_grid_local_spacing(&level->grid, a, p >> (4 * a) & 15);
            mass[l] += m;
            if (l < 2)
                moment[l] +=
                    m * (level->grid.origin[0] + sp_grid_distance(&level->grid, 0, p & 15));
        }
    }
    assert_compare(fabs(mass[1] - mass[0]), <, 1e-5 * mass[0]);
    assert_compare(fabs(mass[2] - mass[0]), <, 1e-5 * mass[0]);
    assert_compare(fabs(moment[1] - moment[0]), <, 0.5 * mass[0]); /* less than half a unit */
    sp_classification_finish(&c);
    sp_pool_destroy(&pool);
    sp_volume_unref(&v);
}

/* All voxels on the surface have the same normal, so the cells of the mip level have it as well.
 * Cells behind the surface have no microflakes. */
static void microflakes_of_a_surface_have_its_normal(void **state) {
    (void)state;
    enum { N = 16 };
    static uint8_t values[N * N * N];
    for (int i = 0; i < N * N * N; i++)
        values[i] = i % N < N / 2 ? 0 : 30; /* x < 8 is empty */
    struct sp_volume *v = classify_make_volume((uint32_t[3]){ N, N, N }, SP_UINT8, values);
    struct sp_pool *pool = sp_pool_create(2, NULL);
    struct sp_classification c;
    sp_classification_init(&c, v);
    struct sp_classify_job job = { .tf = &ramp, .levels = 1 << 1, .axis = 2, .pool = pool };
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_null(c.levels[1].visible.normal);
    job.normals = true;
    assert_true(sp_classification_update(&c, &job, NULL));
    const struct sp_visible *list = &c.levels[1].visible;
    static const uint8_t shown[6] = { 0, 0, 134, 134, 217, 217 }; /* 255 of the axes' first part */
    assert_true(sp_visible_has_microflakes(list));
    for (uint64_t e = 0; e < list->count; e++) {
        const uint32_t *word = sp_visible_microflakes(list, e)->word;
        /* Half of the depth of a surface cell belongs to voxels with a normal. */
        bool surface = (list->place[e] & 15) == N / 4;
        assert_int_equal(word[1] >> 16, surface ? 128 : 0);
        for (int i = 0; i < 6; i++)
            assert_int_equal(word[i / 4] >> 8 * (i % 4) & 255, surface ? shown[i] : 0);
    }
    /* After a change of colour the mip level is rebuilt. */
    struct sp_transfer_function other = ramp;
    other.points[1].color[1] = 1;
    job.tf = &other;
    assert_true(sp_classification_update(&c, &job, NULL));
    struct sp_class want;
    sp_transfer_function_eval(&other, 30, &want);
    struct sp_class got = sp_transfer_class(&c.levels[1].transfer,
                                            sp_visible_key(&c.levels[1].visible, list->count - 1));
    assert_compare(fabsf(got.color[1] - want.color[1]), <, 1e-5f);
    sp_classification_finish(&c);
    sp_pool_destroy(&pool);
    sp_volume_unref(&v);
}

static void the_budget_is_checked_before_memory_is_allocated(void **state) {
    (void)state;
    enum { N = 32 };
    static uint8_t values[N * N * N];
    for (int i = 0; i < N * N * N; i++)
        values[i] = 30;
    struct sp_volume *v = classify_make_volume((uint32_t[3]){ N, N, N }, SP_UINT8, values);
    struct sp_pool *pool = sp_pool_create(1, NULL);
    struct sp_error err;
    /* An entry has 2 bytes, with a normal 4, for every axis. The rest is bricks and classes. */
    const struct {
        unsigned axis;
        bool normals;
        uint64_t entry_bytes;
    } cases[] = { { 2, false, 2 }, { 2, true, 4 }, { 0, false, 2 }, { 1, true, 4 } };
    for (int i = 0; i < 4; i++) {
        struct sp_classification c;
        sp_classification_init(&c, v);
        struct sp_classify_job job = { .tf = &ramp,
                                       .levels = 1,
                                       .axis = cases[i].axis,
                                       .normals = cases[i].normals,
                                       .bytes_max = N * N * N * cases[i].entry_bytes,
                                       .pool = pool };
        assert_false(sp_classification_update(&c, &job, &err));
        assert_int_equal(err.code, SP_ERR_BUDGET);
        assert_non_null(strstr(err.text, "32768 voxels"));
        assert_compare(sp_classification_bytes(&c), <, 1000); /* only the table remains */
        job.bytes_max += 2000;
        assert_true(sp_classification_update(&c, &job, &err));
        assert_compare(sp_classification_bytes(&c), <=, job.bytes_max);
        job.levels = 1 << 1;
        assert_false(sp_classification_update(&c, &job, &err));
        assert_int_equal(err.code, SP_ERR_BUDGET);
        job.bytes_max *= 8;
        assert_true(sp_classification_update(&c, &job, &err));
        assert_compare(sp_classification_bytes(&c), <=, job.bytes_max);
        sp_classification_finish(&c);
    }
    sp_pool_destroy(&pool);
    sp_volume_unref(&v);
}

/* Returns bit 0 if the list and bit 1 if the table was rebuilt since the numbers in `seen`. Updates
 * `seen`. */
static unsigned rebuilt_since(const struct sp_level *level, uint64_t seen[2]) {
    unsigned bits =
        (level->list_made != seen[0] ? 1u : 0u) | (level->table_made != seen[1] ? 2u : 0u);
    seen[0] = level->list_made;
    seen[1] = level->table_made;
    return bits;
}

static void rebuilt_data_gets_a_new_number(void **state) {
    (void)state;
    uint8_t values[64];
    for (int i = 0; i < 64; i++)
        values[i] = (uint8_t)i;
    struct sp_volume *v = classify_make_volume((uint32_t[3]){ 4, 4, 4 }, SP_UINT8, values);
    struct sp_pool *pool = sp_pool_create(1, NULL);
    struct sp_transfer_function tf = ramp;
    uint64_t made = 0, fine[2] = { 0 }, mip[2] = { 0 };
    struct sp_classify_job job = { .tf = &tf, .levels = 3, .axis = 2, .pool = pool, .made = &made };
    struct sp_classification c;
    sp_classification_init(&c, v);
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_int_equal(rebuilt_since(&c.levels[0], fine), 3);
    assert_int_equal(rebuilt_since(&c.levels[1], mip), 3);
    assert_true(sp_classification_update(&c, &job, NULL)); /* nothing changed */
    assert_int_equal(rebuilt_since(&c.levels[0], fine) | rebuilt_since(&c.levels[1], mip), 0);
    tf.points[1].color[0] = 0.25f; /* a colour: rebuilds the table, and all of a mip level */
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_int_equal(rebuilt_since(&c.levels[0], fine), 2);
    assert_int_equal(rebuilt_since(&c.levels[1], mip), 3);
    job.normals = true; /* gradients are part of the list */
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_int_equal(rebuilt_since(&c.levels[0], fine), 1);
    tf.points[0].value = 5; /* changes which voxels are visible */
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_int_equal(rebuilt_since(&c.levels[0], fine), 3);
    sp_classification_finish(&c);
    sp_pool_destroy(&pool);
    sp_volume_unref(&v);
}

static void only_changed_data_is_rebuilt(void **state) {
    (void)state;
    uint8_t values[64];
    for (int i = 0; i < 64; i++)
        values[i] = (uint8_t)i;
    struct sp_volume *v = classify_make_volume((uint32_t[3]){ 4, 4, 4 }, SP_UINT8, values);
    struct sp_pool *pool = sp_pool_create(1, NULL);
    struct sp_transfer_function tf = ramp;
    struct sp_classify_job job = { .tf = &tf, .levels = 1, .axis = 0, .pool = pool };
    struct sp_classification c;
    sp_classification_init(&c, v);
    assert_true(sp_classification_update(&c, &job, NULL));
    const uint8_t *old_places = c.levels[0].visible.place;
    tf.points[1].color[0] = 0.25f; /* a colour */
    tf.points[2].opacity = 0.75f;  /* an opacity that stays above 0 */
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_ptr_equal(c.levels[0].visible.place, old_places);
    assert_compare(sp_transfer_class(&c.levels[0].transfer, 20).color[0], ==, 0.25f);
    job.normals = true; /* shading on: adds gradients without a pass over the volume */
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_ptr_equal(c.levels[0].visible.place, old_places);
    assert_non_null(c.levels[0].visible.normal);
    assert_int_equal(c.levels[0].visible.normal_bytes, 2);
    tf.gradient_count = 1; /* magnitudes matter: stores complete gradients */
    tf.gradient[0].scale = 0.5f;
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_ptr_equal(c.levels[0].visible.place, old_places);
    assert_int_equal(c.levels[0].visible.normal_bytes, 4);
    tf.gradient_count = 0;
    tf.points[0].value = 12; /* changes which voxels are visible */
    assert_true(sp_classification_update(&c, &job, NULL));
    /* The old list contains all visible voxels. */
    assert_ptr_equal(c.levels[0].visible.place, old_places);
    assert_int_equal(c.levels[0].visible.count, 64 - 11);
    assert_int_equal(c.visible, 64 - 13);
    tf.points[0].value = 38; /* few voxels remain visible */
    tf.points[1].value = 39;
    assert_true(sp_classification_update(&c, &job, NULL));
    assert_int_equal(c.levels[0].visible.count, 64 - 39);
    tf.points[1].value = 20;
    /* After cancellation no incomplete list remains. */
    atomic_bool cancel = true;
    job.cancel = &cancel;
    tf.points[0].value = 11;
    struct sp_error err;
    assert_false(sp_classification_update(&c, &job, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    cancel = false;
    assert_true(sp_classification_update(&c, &job, &err));
    assert_int_equal(c.levels[0].visible.count, 64 - 12);
    sp_classification_finish(&c);
    sp_pool_destroy(&pool);
    sp_volume_unref(&v);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_sample_type_gets_the_same_classes),
        cmocka_unit_test(narrow_transfer_functions_of_doubles_are_resolved),
        cmocka_unit_test(lists_hold_the_visible_voxels_along_every_axis),
        cmocka_unit_test(mip_levels_average_the_classified_voxels),
        cmocka_unit_test(rectilinear_mip_levels_preserve_extinction_and_position),
        cmocka_unit_test(microflakes_match_those_of_all_voxels),
        cmocka_unit_test(microflakes_of_a_surface_have_its_normal),
        cmocka_unit_test(the_budget_is_checked_before_memory_is_allocated),
        cmocka_unit_test(rebuilt_data_gets_a_new_number),
        cmocka_unit_test(only_changed_data_is_rebuilt),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
