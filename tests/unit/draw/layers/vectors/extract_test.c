/* SPDX-License-Identifier: Apache-2.0
 *
 * The list of a layer of vectors against its definition, sample by sample: what is visible,
 * clipping, directions, density, samples without a direction, and the cache.
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

#include "classify/gradient.h"
#include "support/shell.h"

enum { WIDTH = 40, HEIGHT = 14, DEPTH = 11, COUNT = WIDTH * HEIGHT * DEPTH };

static double stripes(const void *user, double x, double y, double z) {
    (void)user;
    return fmod(7 * x + 13 * y + 29 * z, 200);
}

/* All directions and lengths; 0, NaN and infinite vectors among them. */
static void swirl(const void *user, const double at[3], float v[3]) {
    (void)user;
    int n = (int)(at[0] + 3 * at[1] + 5 * at[2]);
    v[0] = (float)cos(0.7 * n) * (float)(n % 9);
    v[1] = (float)sin(0.7 * n) * (float)(n % 9);
    v[2] = (float)(n % 9) - 4;
    if (n % 23 == 0)
        v[0] = v[1] = v[2] = 0;
    if (n % 29 == 0)
        v[1] = NAN;
    if (n % 31 == 0)
        v[2] = INFINITY;
}

static void open_swirl(struct test_shell *rig, enum sp_type type) {
    const double points[][5] = { { 60, 1, 0.5, 0.2, 0 }, { 150, 0.3, 1, 0.5, 0.6 } };
    struct test_scene scene = { 0 };
    test_view_init(&scene.view);
    test_scene_points(&scene, points, 2);
    assert_true(test_scene_voxels(&scene, "swirl", (const uint32_t[3]){ WIDTH, HEIGHT, DEPTH },
                                  (const double[3]){ 1, 1, 2 }, type, stripes, NULL));
    if (type == SP_FLOAT32)
        ((float *)scene.voxels)[17] = NAN;
    test_shell_open(rig, &scene, 2);
    test_shell_add_vectors(rig, swirl, NULL);
    rig->layer = sp_layer_default(SP_LAYER_VECTORS);
    rig->layer.density = 1;
}

static bool is_clipped(const struct test_shell *rig, const uint32_t i[3]) {
    const struct sp_clip *clip = &rig->scene.view.clip;
    const uint32_t dims[3] = { WIDTH, HEIGHT, DEPTH };
    for (int a = 0; a < 3; a++) {
        double at = (i[a] + 0.5) / dims[a];
        if (at < clip->box[0][a] || at > clip->box[1][a])
            return true;
    }
    return false;
}

static double value_at(const struct test_shell *rig, size_t n) {
    return rig->scene.info.type == SP_FLOAT32 ? (double)((const float *)rig->scene.voxels)[n]
                                              : (double)((const uint8_t *)rig->scene.voxels)[n];
}

/* The direction that is packed, to the steps of the packing. */
static void check_direction(const struct sp_voxel *voxel, const float v[3]) {
    double length = sqrt((double)v[0] * v[0] + (double)v[1] * v[1] + (double)v[2] * v[2]);
    float direction[3];
    sp_gradient_unpack(voxel->normal, direction);
    for (int c = 0; c < 3; c++) {
        double wanted = isfinite(length) && length > 0 ? (double)v[c] / length : 0;
        assert_true(fabs((double)direction[c] - wanted) < 2e-3);
    }
}

/* Compares the whole list with the definition at density 1; returns its size. */
static uint32_t check_all(struct test_shell *rig) {
    const struct sp_voxel_list *list = test_shell_start(rig, NULL)->list;
    uint32_t at = 0;
    size_t n = 0;
    for (uint32_t z = 0; z < DEPTH; z++)
        for (uint32_t y = 0; y < HEIGHT; y++) {
            assert_int_equal(list->first[z * HEIGHT + y], at);
            for (uint32_t x = 0; x < WIDTH; x++, n++) {
                struct sp_class class;
                sp_transfer_function_eval(&rig->scene.view.transfer_function, value_at(rig, n),
                                          &class);
                const uint32_t i[3] = { x, y, z };
                if (!(class.depth > 0) || is_clipped(rig, i))
                    continue;
                const struct sp_voxel *v = &list->voxels[at++];
                float vector[3];
                for (int a = 0; a < 3; a++)
                    assert_int_equal(v->at[a], i[a]);
                assert_int_equal(v->code, 0);
                assert_true(v->depth == class.depth);
                swirl(NULL, (const double[3]){ x, y, z }, vector);
                check_direction(v, vector);
            }
        }
    assert_int_equal(list->count, at);
    return at;
}

static void lists_follow_their_definition(void **state) {
    (void)state;
    for (int is_float = 0; is_float < 2; is_float++) {
        struct test_shell rig;
        open_swirl(&rig, is_float ? SP_FLOAT32 : SP_UINT8);
        uint32_t all = check_all(&rig);
        assert_in_range(all, COUNT / 3, COUNT - COUNT / 5);
        rig.scene.view.clip.box[0][0] = 0.3;
        rig.scene.view.clip.box[1][2] = 0.6;
        assert_in_range(check_all(&rig), all / 4, all / 2);
        test_shell_close(&rig);
    }
}

/* A share of the samples is drawn, and a smaller share is a part of it: an animated density adds
 * samples, and no sample changes its phase. */
static void density_keeps_samples_and_phases(void **state) {
    (void)state;
    struct test_shell rig;
    uint16_t phases[COUNT];
    bool was_there[COUNT] = { false };
    uint32_t all = 0, sums[4] = { 0 };
    open_swirl(&rig, SP_UINT8);
    for (int step = 0; step <= 4; step++) {
        rig.layer.density = 0.25 * step;
        const struct sp_voxel_list *list = test_shell_start(&rig, NULL)->list;
        for (uint32_t i = 0; i < list->count; i++) {
            const struct sp_voxel *v = &list->voxels[i];
            size_t n = ((size_t)v->at[2] * HEIGHT + v->at[1]) * WIDTH + v->at[0];
            if (was_there[n])
                assert_int_equal(phases[n], v->phase);
            phases[n] = v->phase;
            was_there[n] = true;
        }
        uint32_t there = 0;
        for (int n = 0; n < COUNT; n++)
            there += was_there[n];
        assert_int_equal(there, list->count); /* none is gone */
        if (step == 4)
            all = list->count;
        else
            sums[step] = list->count;
    }
    assert_int_equal(sums[0], 0);
    for (int step = 1; step < 4; step++) /* within 5 standard deviations */
        assert_true(fabs(sums[step] - 0.25 * step * all) < 5 * sqrt(0.25 * all));
    uint32_t quarters[4] = { 0 };
    for (int n = 0; n < COUNT; n++)
        if (was_there[n])
            quarters[phases[n] >> 14]++;
    for (int q = 0; q < 4; q++)
        assert_true(fabs(quarters[q] - 0.25 * all) < 5 * sqrt(0.25 * all));
    test_shell_close(&rig);
}

static struct sp_vectors_job job_of(const struct test_shell *rig) {
    return (struct sp_vectors_job){ .volume = rig->volume,
                                    .tf = &rig->scene.view.transfer_function,
                                    .clip = &rig->scene.view.clip,
                                    .density = 1,
                                    .bytes_max = 1 << 24,
                                    .pool = rig->pool };
}

static void failures_leave_no_list(void **state) {
    (void)state;
    struct test_shell rig;
    struct sp_voxel_list list;
    struct sp_error err = { 0 };
    atomic_bool cancel = true;
    open_swirl(&rig, SP_UINT8);
    struct sp_vectors_job job = job_of(&rig);
    job.bytes_max = 1000;
    assert_false(sp_vectors_extract(&job, &list, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, "density"));
    assert_null(list.first);
    assert_null(sp_vectors_cache_get(&rig.vectors, rig.volume, &job, &err));
    assert_int_equal(sp_vectors_bytes(&rig.vectors, NULL), 0);
    job = job_of(&rig);
    job.interrupt.cancel = &cancel;
    assert_false(sp_vectors_extract(&job, &list, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    test_shell_close(&rig);
}

/* Two lists are cached; the oldest goes, and all go that exceed the memory. */
static void the_cache_keeps_what_fits(void **state) {
    (void)state;
    struct test_shell rig;
    open_swirl(&rig, SP_UINT8);
    struct sp_vectors_job job = job_of(&rig);
    const struct sp_voxel_list *first = sp_vectors_cache_get(&rig.vectors, rig.volume, &job, NULL);
    const struct sp_voxel *voxels = first->voxels;
    uint64_t one = sp_vectors_bytes(&rig.vectors, rig.volume);
    assert_int_equal(one, sp_voxel_list_bytes(first));
    job.density = 0.5;
    sp_vectors_cache_get(&rig.vectors, rig.volume, &job, NULL);
    job.density = 1;
    assert_ptr_equal(sp_vectors_cache_get(&rig.vectors, rig.volume, &job, NULL)->voxels, voxels);
    job.density = 0.25; /* replaces 0.5 */
    sp_vectors_cache_get(&rig.vectors, rig.volume, &job, NULL);
    job.density = 1;
    assert_ptr_equal(sp_vectors_cache_get(&rig.vectors, rig.volume, &job, NULL)->voxels, voxels);
    job.density = 0.75;
    job.bytes_max = one;
    assert_non_null(sp_vectors_cache_get(&rig.vectors, rig.volume, &job, NULL));
    assert_true(sp_vectors_bytes(&rig.vectors, NULL) <= one);
    /* Other numbers for the colours need another list, which goes with their volume. */
    struct test_shell other;
    open_swirl(&other, SP_UINT8);
    job.bytes_max = 1 << 24;
    job.coloring = (struct sp_coloring){ .volume = other.volume, .scale = 1 };
    voxels = sp_vectors_cache_get(&rig.vectors, rig.volume, &job, NULL)->voxels;
    assert_ptr_equal(sp_vectors_cache_get(&rig.vectors, rig.volume, &job, NULL)->voxels, voxels);
    job.coloring.low = 1;
    assert_ptr_not_equal(sp_vectors_cache_get(&rig.vectors, rig.volume, &job, NULL)->voxels,
                         voxels);
    sp_vectors_evict(&rig.vectors, other.volume);
    assert_int_equal(sp_vectors_bytes(&rig.vectors, NULL), 0);
    test_shell_close(&other);
    job.coloring.volume = NULL;
    assert_non_null(sp_vectors_cache_get(&rig.vectors, rig.volume, &job, NULL));
    sp_vectors_evict(&rig.vectors, rig.volume);
    assert_int_equal(sp_vectors_bytes(&rig.vectors, NULL), 0);
    test_shell_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_follow_their_definition),
        cmocka_unit_test(density_keeps_samples_and_phases),
        cmocka_unit_test(failures_leave_no_list),
        cmocka_unit_test(the_cache_keeps_what_fits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
