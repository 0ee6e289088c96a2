/* SPDX-License-Identifier: Apache-2.0
 *
 * The order of a shell against brute force: along rays, the cells of voxels come in the order of
 * their distance, and a voxel that is left out lies behind opaque ones.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "data/volume/grid.h"
#include "support/compare.h"
#include "support/sanitized.h"
#include "support/shell.h"

enum { RAYS = TEST_TSAN ? 5 : 150 }; /* one thread follows them */

static double blobs(const void *user, double x, double y, double z) {
    (void)user;
    return 1.2 * exp(-0.03 * ((x - 6) * (x - 6) + (y - 5) * (y - 5) + (z - 6) * (z - 6))) +
           0.3 * sin(3 * x + 5 * y) * sin(4 * z);
}

/* The four kinds of grids: even, turned and left-handed, sheared, rectilinear. */
static void open_grid(struct test_shell *rig, int kind) {
    static const double graded[3][14] = {
        { 0, 1, 2, 3.5, 5, 6, 6.5, 7, 8, 9, 10.5, 12, 13, 14 },
        { 0, 0.5, 1, 2, 3, 4, 6, 7, 7.5, 8, 9, 10 },
        { 0, 2, 3, 4, 5, 6, 6.5, 7, 8, 9, 10, 11, 12 },
    };
    const uint32_t dims[3] = { 14, 12, 13 };
    const double spacing[3] = { 1, 1.25, 0.8 };
    const double points[][5] = { { 0.1, 1, 1, 1, 0 }, { 0.9, 1, 0.5, 0.2, 0.95 } };
    struct test_scene scene = { 0 };
    test_view_init(&scene.view);
    test_scene_points(&scene, points, 2);
    if (kind == 3) {
        const double *coordinates[3] = { graded[0], graded[1], graded[2] };
        assert_true(
            test_scene_rectilinear(&scene, "graded", dims, coordinates, SP_FLOAT32, blobs, NULL));
    } else {
        assert_true(test_scene_voxels(&scene, "even", dims, spacing, SP_FLOAT32, blobs, NULL));
    }
    if (kind == 1)
        test_scene_direction(&scene, (const double[3]){ 20, 40, 70 }, -1, 0);
    if (kind == 2)
        test_scene_direction(&scene, (const double[3]){ 10, -30, 25 }, 1, 0.6);
    test_shell_open(rig, &scene, 2);
    rig->layer.low = 0.05;
    rig->layer.high = 0.5;
}

static void sort(struct test_shell *rig, const struct sp_voxel_list *list, bool keeps_hidden,
                 bool by_depth, struct sp_voxel_order *order) {
    test_shell_start(rig, NULL);
    const struct sp_voxel_order_job job = { .list = list,
                                            .camera = &rig->camera,
                                            .grid = &rig->scene.info.grid,
                                            .keeps_hidden = keeps_hidden,
                                            .by_depth = by_depth,
                                            .pool = rig->pool,
                                            .arena = &rig->arena,
                                            .interrupt = &rig->input.interrupt };
    assert_true(sp_voxel_sort(&job, order));
}

/* Ranks of the list's voxels in the order, from 1 on; 0 = left out. malloc'ed. */
static uint32_t *compute_ranks(struct test_shell *rig, const struct sp_voxel_list *list,
                               bool keeps_hidden) {
    struct sp_voxel_order order;
    sort(rig, list, keeps_hidden, false, &order);
    uint32_t *ranks = calloc(list->count + 1, sizeof *ranks);
    assert_non_null(ranks);
    for (uint32_t i = 0; i < order.count; i++) {
        assert_in_range(order.voxels[i], 0, (uint64_t)list->count - 1);
        assert_int_equal(ranks[order.voxels[i]], 0); /* once */
        ranks[order.voxels[i]] = i + 1;
    }
    if (keeps_hidden)
        assert_int_equal(order.count, list->count);
    return ranks;
}

/* A voxel whose cell a ray meets. */
struct met {
    double begin;
    uint32_t voxel;
};

static int compare_met(const void *a, const void *b) {
    const struct met *p = a, *q = b;
    return p->begin < q->begin ? -1 : p->begin > q->begin;
}

static uint32_t collect_met(const struct test_shell *rig, const struct sp_voxel_list *list,
                            const struct test_ray *ray, struct met *met) {
    uint32_t n = 0;
    double t[2];
    for (uint32_t v = 0; v < list->count; v++) {
        const uint16_t *at = list->voxels[v].at;
        if (test_shell_hit(rig, ray, (const uint32_t[3]){ at[0], at[1], at[2] }, t) &&
            t[1] - t[0] > 1e-6)
            met[n++] = (struct met){ t[0], v };
    }
    qsort(met, n, sizeof *met, compare_met);
    return n;
}

static double depth_of(const struct test_shell *rig, const uint16_t at[3]) {
    const struct sp_grid *grid = &rig->scene.info.grid;
    double u2 = 0;
    for (int r = 0; r < 3; r++) {
        double place = grid->origin[r] - rig->camera.eye.v[r];
        for (unsigned a = 0; a < 3; a++)
            place += grid->direction[r][a] * sp_grid_distance(grid, a, at[a]);
        u2 += rig->camera.w.m[2][r] * place;
    }
    return u2;
}

/* The order by depth has the same voxels. */
static void check_depths(struct test_shell *rig, const struct sp_voxel_list *list, uint32_t *seen) {
    struct sp_voxel_order order;
    double last = -INFINITY;
    sort(rig, list, false, true, &order);
    for (uint32_t i = 0; i < order.count; i++) {
        uint32_t v = order.voxels[i];
        double depth = depth_of(rig, list->voxels[v].at);
        assert_compare(depth, >, last - 1e-4);
        assert_int_not_equal(seen[v], 0);
        seen[v] = 0;
        last = depth;
    }
    for (uint32_t v = 0; v < list->count; v++)
        assert_int_equal(seen[v], 0);
}

/* Checks both orders along random rays, which may start inside opaque material. Returns how many
 * voxels are left out. */
static uint32_t check_view(struct test_shell *rig, bool starts_inside) {
    struct sp_shell_job job = test_shell_job(rig);
    const struct sp_voxel_list *list = sp_shell_cache_get(&rig->cache, &job, NULL);
    assert_non_null(list);
    assert_in_range(list->count, 100, 2184);
    uint32_t *all = compute_ranks(rig, list, true), *seen = compute_ranks(rig, list, false),
             hidden = 0;
    struct met *met = malloc(list->count * sizeof *met);
    assert_non_null(met);
    for (int i = 0; i < RAYS; i++) {
        struct test_ray ray =
            test_shell_ray(rig, 64.0 * rand() / RAND_MAX, 64.0 * rand() / RAND_MAX);
        uint32_t n = collect_met(rig, list, &ray, met), last[2] = { 0, 0 };
        bool is_hit = starts_inside; /* an opaque voxel is drawn nearer to the eye */
        for (uint32_t k = 0; k < n; k++) {
            uint32_t v = met[k].voxel;
            assert_true(all[v] > last[0]);
            last[0] = all[v];
            if (seen[v]) {
                assert_true(seen[v] > last[1]);
                last[1] = seen[v];
            } else {
                assert_true(is_hit);
            }
            is_hit |= seen[v] && list->voxels[v].code & SP_VOXEL_OPAQUE;
        }
    }
    for (uint32_t v = 0; v < list->count; v++)
        hidden += !seen[v];
    check_depths(rig, list, seen);
    free(all);
    free(seen);
    free(met);
    return hidden;
}

static void test_order(void **state) {
    (void)state;
    if (TEST_TSAN)
        print_message("reduced with ThreadSanitizer: fewer rays\n");
    static const double eyes[][3] = { { -60, -40, 30 }, { 3, -2, 40 },  { 2, 40, -3 },
                                      { -30, 1, 2 },    { 0, 0, 25 },   { 30, 30, 30 },
                                      { 1, 0.5, 0.2 },  { 9, 0.4, 1.1 } };
    uint32_t hidden = 0;
    srand(3);
    for (int kind = 0; kind < 4; kind++) {
        struct test_shell rig;
        open_grid(&rig, kind);
        for (size_t e = 0; e < sizeof eyes / sizeof eyes[0]; e++) {
            struct sp_camera *camera = &rig.scene.view.camera;
            for (int a = 0; a < 3; a++) {
                camera->position[a] = eyes[e][a];
                camera->target[a] = a == 0 ? 0.3 : -0.2;
            }
            camera->up[0] = 0.1;
            camera->near = 1e-3;
            camera->projection = SP_PERSPECTIVE;
            camera->fov_y = e < 6 ? 25 : 100;
            hidden += check_view(&rig, e >= 6);
            if (e >= 6) /* parallel rays begin outside */
                continue;
            camera->projection = SP_ORTHOGRAPHIC;
            camera->height = 14;
            hidden += check_view(&rig, false);
        }
        test_shell_close(&rig);
    }
    assert_in_range(hidden, 1000, 100000);
}

/* Along an axis the rays are parallel to two faces of each cell. */
static void test_along_axis(void **state) {
    (void)state;
    struct test_shell rig;
    open_grid(&rig, 0);
    struct sp_camera *camera = &rig.scene.view.camera;
    for (int a = 0; a < 3; a++)
        for (int side = -1; side <= 1; side += 2) {
            for (int i = 0; i < 3; i++) {
                camera->position[i] = i == a ? side * 50 : 0;
                camera->target[i] = 0;
                camera->up[i] = i == (a + 1) % 3 ? 1 : 0;
            }
            camera->projection = SP_ORTHOGRAPHIC;
            camera->height = 14;
            assert_in_range(check_view(&rig, false), 50, 2000);
        }
    test_shell_close(&rig);
}

/* Where the near plane cuts the volume, the list keeps all voxels that the cut may expose. */
static void test_near_plane(void **state) {
    (void)state;
    struct test_shell rig;
    open_grid(&rig, 0);
    struct sp_camera *camera = &rig.scene.view.camera;
    rig.layer.low = rig.layer.high = 0.3;
    struct sp_shell_job job = test_shell_job(&rig);
    const struct sp_voxel_list *list = sp_shell_cache_get(&rig.cache, &job, NULL);
    assert_non_null(list);
    camera->near = 100; /* through the middle: the eye is at z = -100 */
    uint32_t *seen = compute_ranks(&rig, list, false);
    for (uint32_t v = 0; v < list->count; v++) {
        double z = (list->voxels[v].at[2] - 6.0) * 0.8;
        if (z > 0 && z < 3) /* beyond the plane, and not far */
            assert_int_not_equal(seen[v], 0);
    }
    free(seen);
    test_shell_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_order),
        cmocka_unit_test(test_along_axis),
        cmocka_unit_test(test_near_plane),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
