/* SPDX-License-Identifier: Apache-2.0
 *
 * A list of visible voxels can be made from the list of another transfer function. It must equal
 * the list that a pass over the volume makes, entry by entry. Bricks without changed voxels are
 * skipped.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/change.h"
#include "classify/classification.h"
#include "support/sanitized.h"

enum { X = 40, Y = 21, Z = 35, VOXELS = X * Y * Z };

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

/* A smooth field, so that bricks have different ranges; floating-point volumes contain NaN or
 * infinity. */
static struct sp_volume *make_volume(enum sp_type type) {
    static double doubles[VOXELS];
    struct sp_grid grid = { .dims = { X, Y, Z },
                            .spacing = { 1, 2, 0.5 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    double phase = uniform(0, 6);
    for (int i = 0; i < VOXELS; i++) {
        double v = 50 + 50 * sin(0.05 * (i % X) + phase) * cos(0.06 * (i / X / Y)) + uniform(0, 5);
        switch (type) {
        case SP_UINT8:
            ((uint8_t *)doubles)[i] = (uint8_t)v;
            break;
        case SP_INT8:
            ((int8_t *)doubles)[i] = (int8_t)(v - 50);
            break;
        case SP_UINT16:
            ((uint16_t *)doubles)[i] = (uint16_t)(300 * v);
            break;
        case SP_INT16:
            ((int16_t *)doubles)[i] = (int16_t)(300 * (v - 50));
            break;
        case SP_INT32:
            ((int32_t *)doubles)[i] = (int32_t)(1e5 * (v - 50));
            break;
        case SP_FLOAT32:
            ((float *)doubles)[i] = i % 501 ? (float)v : NAN;
            break;
        case SP_FLOAT64:
        case SP_TYPE_COUNT:
            doubles[i] = i % 501 ? v * 1e100 : INFINITY;
            break;
        }
    }
    struct sp_volume *v = sp_volume_create(&grid, type, doubles, "v", NULL);
    assert_non_null(v);
    return v;
}

static void start(struct sp_transfer_function *tf, const double range[2]) {
    *tf = (struct sp_transfer_function){ .reference_length = 1, .point_count = 5 };
    for (uint32_t i = 0; i < 5; i++) {
        tf->points[i].value = range[0] + (range[1] - range[0]) * (0.1 + 0.18 * i);
        tf->points[i].opacity = i == 0 || i == 3 ? 0 : 0.5f;
    }
}

/* Applies a random edit as users make it. */
static void edit(struct sp_transfer_function *tf, const double range[2]) {
    uint32_t i = (uint32_t)rand() % tf->point_count;
    double span = range[1] - range[0];
    switch (rand() % 5) {
    case 0:
        tf->points[i].opacity = tf->points[i].opacity > 0 ? 0 : 0.5f;
        break;
    case 1: { /* move a point between its neighbours */
        double low = i ? tf->points[i - 1].value : range[0];
        double high = i + 1 < tf->point_count ? tf->points[i + 1].value : range[1];
        tf->points[i].value = low + uniform(0.2, 0.8) * (high - low);
        break;
    }
    case 2:
        tf->points[i].color[0] = (float)uniform(0, 1);
        break;
    case 3: /* remove a point */
        if (tf->point_count > 2) {
            memmove(tf->points + i, tf->points + i + 1,
                    (tf->point_count - i - 1) * sizeof *tf->points);
            tf->point_count--;
        }
        break;
    default: /* add a point at the end */
        if (tf->point_count < 12) {
            struct sp_tf_point *p = &tf->points[tf->point_count++];
            p[0] = p[-1];
            p->value += uniform(0.01, 0.1) * span;
            p->opacity = rand() % 2 ? 0.3f : 0;
        }
        break;
    }
}

static void assert_same(const struct sp_visible *a, const struct sp_visible *b) {
    uint32_t bricks = sp_visible_bricks(a);
    assert_int_equal(a->count, b->count);
    assert_memory_equal(a->first, b->first, (bricks + (size_t)1) * sizeof *a->first);
    if (!a->count)
        return;
    assert_memory_equal(a->start, b->start, bricks * sizeof *a->start);
    assert_memory_equal(a->axis, b->axis, bricks);
    assert_memory_equal(a->place, b->place, a->count);
    assert_int_equal(a->key_bytes, b->key_bytes);
    assert_memory_equal(a->key, b->key, a->count * a->key_bytes);
    assert_int_equal(a->normal != NULL, b->normal != NULL);
    if (a->normal)
        assert_memory_equal(a->normal, b->normal, a->count * a->normal_bytes);
}

static void updated_lists_equal_those_of_a_full_pass(void **state) {
    (void)state;
    srand(9);
    struct sp_pool *pool = sp_pool_create(2, NULL);
    for (int n = 0; n < (TEST_SANITIZED ? 2 : 10) * SP_TYPE_COUNT; n++) {
        struct sp_volume *volume = make_volume((enum sp_type)(n % SP_TYPE_COUNT));
        const double *range = sp_volume_info(volume)->range;
        struct sp_transfer_function tf;
        struct sp_classification chain[2], fresh;
        struct sp_classify_job job = {
            .tf = &tf, .levels = 1, .axis = SP_NO_AXIS, .normals = n % 3 != 0, .pool = pool
        };
        start(&tf, range);
        sp_classification_init(&chain[0], volume);
        assert_true(sp_classification_update(&chain[0], &job, NULL));
        for (int k = 1; k < 12; k++) {
            edit(&tf, range);
            struct sp_classification *to = &chain[k % 2];
            if (k > 1)
                sp_classification_finish(to);
            sp_classification_init(to, volume);
            if (k % 5 == 0) /* switch normals on or off */
                job.normals = !job.normals;
            job.from = &chain[1 - k % 2];
            assert_true(sp_classification_update(to, &job, NULL));
            sp_classification_init(&fresh, volume);
            job.from = NULL;
            assert_true(sp_classification_update(&fresh, &job, NULL));
            assert_same(&to->levels[0].visible, &fresh.levels[0].visible);
            sp_classification_finish(&fresh);
        }
        sp_classification_finish(&chain[0]);
        sp_classification_finish(&chain[1]);
        sp_volume_unref(&volume);
    }
    sp_pool_destroy(&pool);
}

static void only_ranges_with_changed_values_meet_the_change(void **state) {
    (void)state;
    struct sp_volume_info info = { .type = SP_UINT8, .range = { 10, 200 } };
    struct sp_transfer_function a = { .reference_length = 1,
                                      .point_count = 3,
                                      .points = { { .value = 50 },
                                                  { .value = 100, .opacity = 0.5f },
                                                  { .value = 150, .opacity = 0.5f } } };
    struct sp_transfer_function b = a;
    b.points[0].value = 60; /* values from 51 to 60 become invisible */
    for (int type = 0; type < 2; type++) {
        struct sp_transfer from, to;
        struct sp_change change;
        info.type = type ? SP_FLOAT32 : SP_UINT8;
        if (type) {
            /* Keys of floating-point values count from the first point, which must not change. */
            a.points[0].value = b.points[0].value = 40;
            b.points[1].opacity = 0;
        }
        assert_true(sp_transfer_init(&from, &a, &info, NULL, NULL));
        assert_true(sp_transfer_init(&to, &b, &info, NULL, NULL));
        assert_true(sp_change_is_possible(&from, &to));
        assert_true(sp_change_init(&change, &from, from.is_visible, &to, to.is_visible, NULL));
        double base = sp_transfer_base(&from);
        float first = (float)((type ? 40 : 51) - base), last = (float)((type ? 150 : 60) - base);
        assert_true(sp_change_affects(&change, &(struct sp_range){ first, first }));
        assert_true(sp_change_affects(&change, &(struct sp_range){ last, last }));
        assert_true(sp_change_affects(&change, &(struct sp_range){ first - 10, last + 10 }));
        assert_false(sp_change_affects(&change, &(struct sp_range){ first - 5, first - 1 }));
        assert_false(sp_change_affects(&change, &(struct sp_range){ last + 1, last + 9 }));
        assert_false(sp_change_affects(&change, &(struct sp_range){ INFINITY, -INFINITY }));
        sp_change_finish(&change);
        sp_transfer_finish(&from);
        sp_transfer_finish(&to);
    }
}

int main(void) {
    if (TEST_SANITIZED)
        print_message("reduced under a sanitizer: two volumes of ten of each type\n");
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(updated_lists_equal_those_of_a_full_pass),
        cmocka_unit_test(only_ranges_with_changed_values_meet_the_change),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
