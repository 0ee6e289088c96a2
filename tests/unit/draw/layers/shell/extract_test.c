/* SPDX-License-Identifier: Apache-2.0
 *
 * The lists of a shell against the definition, voxel by voxel: every type of samples, thresholds of
 * all kinds, clipping, and lists that were updated against lists from scratch.
 */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/one_thread.h"
#include "support/shell.h"

/* A blob, and noise around it. */
static double speckled(const void *user, double x, double y, double z) {
    (void)user;
    double blob = 120 * exp(-0.01 * ((x - 30) * (x - 30) + 4 * (y - 5) * (y - 5) + z * z));
    uint32_t hash = (uint32_t)x * 73856093u ^ (uint32_t)y * 19349663u ^ (uint32_t)z * 83492791u;
    return blob + (hash * 2654435761u >> 16) % 32;
}

/* Floats get some samples that are not finite. */
static void spoil(struct test_scene *scene) {
    const uint32_t *dims = scene->info.grid.dims;
    for (uint32_t i = 0; i < dims[0] * dims[1] * dims[2]; i += 37) {
        if (scene->info.type == SP_FLOAT32)
            ((float *)scene->voxels)[i] = i % 2 ? NAN : INFINITY;
        if (scene->info.type == SP_FLOAT64)
            ((double *)scene->voxels)[i] = i % 2 ? NAN : -INFINITY;
    }
}

static void open_speckled(struct test_shell *rig, enum sp_type type, const uint32_t dims[3],
                          unsigned threads) {
    const double spacing[3] = { 1, 1.5, 1 };
    const double points[][5] = { { 10, 1, 0.5, 0.2, 0 },
                                 { 30, 0.2, 0.6, 1, 0.1 },
                                 { 60, 0.3, 1, 0.5, 0.6 },
                                 { 100, 1, 1, 0.9, 0.98 } };
    struct test_scene scene = { 0 };
    test_view_init(&scene.view);
    test_scene_points(&scene, points, 4);
    assert_true(test_scene_voxels(&scene, "speckled", dims, spacing, type, speckled, NULL));
    spoil(&scene);
    test_shell_open(rig, &scene, threads);
    rig->layer.low = 0.1;
    rig->layer.high = 0.5;
}

static const struct sp_voxel_list *get(struct test_shell *rig) {
    struct sp_shell_job job = test_shell_job(rig);
    struct sp_error err = { 0 };
    const struct sp_voxel_list *list = sp_shell_cache_get(&rig->cache, &job, &err);
    if (!list)
        fail_msg("%s", err.text);
    return list;
}

/* Compares the list with the definition. Returns how many voxels it has. */
static uint32_t check_list(struct test_shell *rig) {
    const struct sp_voxel_list *list = get(rig);
    const uint32_t *dims = rig->scene.info.grid.dims;
    int *codes = test_shell_codes(rig);
    uint32_t at = 0, n = 0;
    for (uint32_t z = 0; z < dims[2]; z++)
        for (uint32_t y = 0; y < dims[1]; y++) {
            assert_int_equal(list->first[z * dims[1] + y], at);
            for (uint32_t x = 0; x < dims[0]; x++, n++) {
                if (codes[n] < 0)
                    continue;
                assert_in_range(at, 0, (uint64_t)list->count - 1);
                const struct sp_voxel *v = &list->voxels[at++];
                assert_int_equal(v->at[0], x);
                assert_int_equal(v->at[1], y);
                assert_int_equal(v->at[2], z);
                assert_int_equal(v->code, codes[n]);
                assert_true(v->depth > 0);
            }
        }
    assert_int_equal(list->count, at);
    assert_int_equal(list->first[dims[1] * dims[2]], at);
    free(codes);
    return at;
}

static void test_types(void **state) {
    (void)state;
    static const enum sp_type types[] = { SP_UINT8, SP_INT8,    SP_UINT16, SP_INT16,
                                          SP_INT32, SP_FLOAT32, SP_FLOAT64 };
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++) {
        struct test_shell rig;
        open_speckled(&rig, types[i], (const uint32_t[3]){ 67, 11, 13 }, 2);
        assert_in_range(check_list(&rig), 100, 5000);
        rig.scene.view.transfer_function.gradient_count = 2;
        rig.scene.view.transfer_function.gradient[0] = (struct sp_gradient_point){ 0, 0.2f };
        rig.scene.view.transfer_function.gradient[1] = (struct sp_gradient_point){ 12, 1 };
        assert_in_range(check_list(&rig), 50, 5000);
        test_shell_close(&rig);
    }
}

/* Samples as large as a double can be, of both signs: differences and gradients overflow. */
static void test_largest_values(void **state) {
    (void)state;
    struct test_shell rig;
    open_speckled(&rig, SP_FLOAT64, (const uint32_t[3]){ 67, 11, 13 }, 2);
    struct sp_transfer_function *tf = &rig.scene.view.transfer_function;
    double *samples = rig.scene.voxels;
    for (int i = 0; i < 67 * 11 * 13; i++)
        samples[i] = (samples[i] / 80 - 1) * DBL_MAX;
    for (uint32_t i = 0; i < tf->point_count; i++)
        tf->points[i].value = (tf->points[i].value / 80 - 1) * DBL_MAX;
    sp_volume_unref(&rig.volume);
    rig.volume = test_scene_volume(&rig.scene, NULL);
    assert_non_null(rig.volume);
    assert_in_range(check_list(&rig), 100, 5000);
    tf->gradient_count = 2;
    tf->gradient[0] = (struct sp_gradient_point){ 0, 0.2f };
    tf->gradient[1] = (struct sp_gradient_point){ DBL_MAX, 1 };
    assert_in_range(check_list(&rig), 50, 5000);
    test_shell_close(&rig);
}

static void test_thresholds(void **state) {
    (void)state;
    static const double pairs[][2] = { { 0, 1 },     { 0, 0 },       { 1, 1 },      { 0.3, 0.3 },
                                       { 0.1, 0.1 }, { 0.98, 0.98 }, { 0.02, 0.9 }, { 0.6, 1 } };
    struct test_shell rig;
    open_speckled(&rig, SP_UINT8, (const uint32_t[3]){ 130, 9, 8 }, 2);
    for (size_t i = 0; i < sizeof pairs / sizeof pairs[0]; i++) {
        rig.layer.low = pairs[i][0];
        rig.layer.high = pairs[i][1];
        uint32_t count = check_list(&rig);
        if (i == 1 || i == 2) /* everything hides its neighbours; nothing is opaque enough */
            assert_int_equal(count, 0);
        else
            assert_in_range(count, 1, 130 * 9 * 8);
    }
    test_shell_close(&rig);
}

/* Changes thresholds, opacities or colours. */
static void edit(struct test_shell *rig) {
    struct sp_transfer_function *tf = &rig->scene.view.transfer_function;
    int point = rand() % 4;
    switch (rand() % 5) {
    case 0:
        rig->layer.low = 0.01 * (rand() % 40);
        rig->layer.high = rig->layer.low + 0.01 * (rand() % 60);
        break;
    case 1:
        tf->points[point].opacity = 0.0095f * (float)(rand() % 100);
        break;
    case 2:
        tf->points[point].color[rand() % 3] = 0.01f * (float)(rand() % 100);
        break;
    case 3:
        tf->points[point].value += rand() % 7 - 3;
        break;
    default:
        tf->gradient_count = rand() % 4 ? 0 : 1;
        tf->gradient[0] = (struct sp_gradient_point){ 0, 0.5f };
    }
}

static void check_edits(enum sp_type type) {
    struct test_shell rig;
    open_speckled(&rig, type, (const uint32_t[3]){ 67, 35, 33 }, 2);
    srand(7);
    for (int i = 0; i < 40; i++) {
        struct sp_shell_cache fresh = { 0 };
        struct sp_shell_job job = test_shell_job(&rig);
        const struct sp_voxel_list *list = get(&rig);
        const struct sp_voxel_list *wanted = sp_shell_cache_get(&fresh, &job, NULL);
        assert_non_null(wanted);
        assert_int_equal(list->count, wanted->count);
        assert_memory_equal(list->first, wanted->first, (35 * 33 + 1) * sizeof *list->first);
        if (list->count)
            assert_memory_equal(list->voxels, wanted->voxels, list->count * sizeof *list->voxels);
        for (int a = 0; a < 2; a++)
            assert_memory_equal(list->slice_counts[a], wanted->slice_counts[a],
                                list->dims[a + 1] * sizeof *list->slice_counts[a]);
        sp_shell_evict(&fresh, NULL);
        edit(&rig);
    }
    test_shell_close(&rig);
}

static void test_edits(void **state) {
    (void)state;
    check_edits(SP_UINT8);
    check_edits(SP_FLOAT32);
}

static void test_clipping(void **state) {
    (void)state;
    struct test_shell rig;
    for (int turned = 0; turned < 2; turned++) {
        struct test_scene scene;
        open_speckled(&rig, SP_UINT8, (const uint32_t[3]){ 67, 17, 19 }, 2);
        scene = rig.scene;
        rig.scene = (struct test_scene){ 0 };
        test_shell_close(&rig);
        if (turned) {
            const double degrees[3] = { 20, 30, 40 };
            test_scene_direction(&scene, degrees, -1, 0.3);
        }
        test_shell_open(&rig, &scene, 2);
        struct sp_clip *clip = &rig.scene.view.clip;
        rig.layer.low = rig.layer.high = 0.02;
        uint32_t whole = check_list(&rig);
        clip->box[0][0] = 0.21;
        clip->box[1][1] = 0.8;
        clip->box[0][2] = 0.3;
        uint32_t boxed = check_list(&rig);
        assert_int_not_equal(whole, boxed);
        test_scene_cut(&rig.scene, (const double[3]){ 1, -0.5, 0.3 }, (const double[3]){ 2, 1, 0 });
        test_scene_cut(&rig.scene, (const double[3]){ 0, 0.5, 1 }, (const double[3]){ 0, -3, 0 });
        assert_int_not_equal(check_list(&rig), boxed);
        clip->planes[0].offset = 1e6; /* nothing is left */
        assert_int_equal(check_list(&rig), 0);
        clip->plane_count = 0;
        sp_shell_evict(&rig.cache, NULL);
        assert_int_equal(check_list(&rig), boxed);
        test_shell_close(&rig);
    }
}

static double constant(const void *user, double x, double y, double z) {
    (void)x, (void)y, (void)z;
    return *(const double *)user;
}

static void test_degenerate(void **state) {
    (void)state;
    static const double values[] = { 0, 100 };
    static const uint32_t dims[][3] = { { 1, 1, 1 }, { 64, 1, 3 }, { 65, 8, 8 } };
    static const uint32_t borders[] = { 1, 192, 65 * 64 - 63 * 36 };
    const double points[][5] = { { 0, 1, 1, 1, 0 }, { 100, 1, 1, 1, 0.9 } };
    for (int v = 0; v < 2; v++)
        for (int d = 0; d < 3; d++) {
            struct test_scene scene = { 0 };
            struct test_shell rig;
            test_view_init(&scene.view);
            test_scene_points(&scene, points, 2);
            assert_true(test_scene_voxels(&scene, "constant", dims[d], (const double[3]){ 1, 1, 1 },
                                          SP_UINT8, constant, &values[v]));
            test_shell_open(&rig, &scene, 1);
            rig.layer.low = rig.layer.high = 0.5;
            assert_int_equal(check_list(&rig), v ? borders[d] : 0); /* all of the border is seen */
            test_shell_close(&rig);
        }
}

static void test_memory(void **state) {
    (void)state;
    struct test_shell rig;
    struct sp_error err = { 0 };
    open_speckled(&rig, SP_UINT8, (const uint32_t[3]){ 67, 35, 33 }, 2);
    const struct sp_voxel_list *list = get(&rig);
    uint64_t bytes = sp_shell_bytes(&rig.cache, NULL);
    assert_in_range(bytes, list->count * sizeof *list->voxels, 1 << 22);
    assert_int_equal(sp_shell_bytes(&rig.cache, rig.volume), bytes);
    sp_shell_evict(&rig.cache, rig.volume);
    assert_int_equal(sp_shell_bytes(&rig.cache, NULL), 0);
    struct sp_shell_job job = test_shell_job(&rig);
    job.bytes_max = 1000; /* not even the masks */
    assert_null(sp_shell_cache_get(&rig.cache, &job, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    job.bytes_max = bytes / 2; /* the masks, but not the list */
    assert_null(sp_shell_cache_get(&rig.cache, &job, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_int_equal(sp_shell_bytes(&rig.cache, NULL), 0);
    job.bytes_max = bytes + 1000; /* one shell, not two */
    for (int i = 0; i < 40; i++) {
        job.low = 0.1 + 0.2 * (i / 20);
        assert_non_null(sp_shell_cache_get(&rig.cache, &job, &err));
        assert_in_range(sp_shell_bytes(&rig.cache, NULL), 1, job.bytes_max);
    }
    test_shell_close(&rig);
}

static void test_cancel(void **state) {
    (void)state;
    struct test_shell rig;
    struct sp_error err = { 0 };
    atomic_bool cancel = true;
    open_speckled(&rig, SP_UINT8, (const uint32_t[3]){ 67, 35, 33 }, 2);
    struct sp_shell_job job = test_shell_job(&rig);
    job.interrupt.cancel = &cancel;
    for (int i = 0; i < 2; i++) { /* at the start, and while an edit updates the list */
        assert_null(sp_shell_cache_get(&rig.cache, &job, &err));
        assert_int_equal(err.code, SP_ERR_CANCELLED);
        check_list(&rig);
        job.low = 0.2;
    }
    test_shell_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_types),     one_thread_test(test_largest_values),
        one_thread_test(test_thresholds), one_thread_test(test_edits),
        one_thread_test(test_clipping),   one_thread_test(test_degenerate),
        one_thread_test(test_memory),     cmocka_unit_test(test_cancel),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
