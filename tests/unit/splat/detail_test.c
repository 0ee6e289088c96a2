/* SPDX-License-Identifier: Apache-2.0
 *
 * The cut through the octree of bricks. It holds each voxel once, no cell is larger in the image
 * than allowed, and it is used where it saves work.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/visible.h"
#include "splat/detail.h"
#include "support/compare.h"

enum { LEVELS = 6 };

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

static struct sp_view make_view(enum sp_projection projection, double distance) {
    struct sp_view view = {
        .size = { 200, 150 },
        .camera = { .projection = projection,
                    .position = { uniform(-1, 1), uniform(-1, 1), -1 },
                    .up = { 0, 1, 0 },
                    .fov_y = uniform(20, 90),
                    .height = distance,
                    .near = 0.01 },
        .filter = { SP_FILTER_EWA, SP_KERNEL_GAUSSIAN, 0.7, 3, 1, NAN, NAN },
        .level_of_detail = SP_LOD_AUTO,
    };
    double *p = view.camera.position, length = sqrt(p[0] * p[0] + p[1] * p[1] + 1);
    for (int i = 0; i < 3; i++) {
        p[i] *= distance / length;
        view.camera.target[i] = uniform(-5, 5);
    }
    return view;
}

/* Sets the largest optical depth of visible matter along the longest edge of a voxel of
 * make_grid(). */
static void set_depth(struct sp_view *view, double depth) {
    view->transfer_function.point_count = 2;
    view->transfer_function.points[1] =
        (struct sp_tf_point){ .value = 1, .opacity = (float)-expm1(-depth) };
    view->transfer_function.reference_length = 1.5;
}

/* Returns a box around the origin, rotated by 30 degrees about the third axis. */
static struct sp_grid make_grid(const uint32_t dims[3]) {
    struct sp_grid g = { .dims = { dims[0], dims[1], dims[2] },
                         .spacing = { 1, 1.5, 0.75 },
                         .direction = { { 0.8, -0.6, 0 }, { 0.6, 0.8, 0 }, { 0, 0, 1 } } };
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            g.origin[r] -= 0.5 * g.direction[r][a] * g.spacing[a] * (dims[a] - 1.0);
    return g;
}

static bool project(const struct sp_camera_transform *camera, const struct sp_grid *grid,
                    const double at[3], double x[2]) {
    struct sp_vec3 t;
    for (int r = 0; r < 3; r++) {
        t.v[r] = grid->origin[r] - camera->eye.v[r];
        for (int a = 0; a < 3; a++)
            t.v[r] += grid->direction[r][a] * grid->spacing[a] * at[a];
    }
    struct sp_vec3 u = sp_mat3_apply(&camera->w, t);
    double depth = camera->projection == SP_PERSPECTIVE ? u.v[2] : 1;
    for (int i = 0; i < 2; i++)
        x[i] = camera->centre[i] + camera->scale * u.v[i] / depth;
    return depth > 0 && fabs(x[0] - camera->centre[0]) <= camera->centre[0] &&
           fabs(x[1] - camera->centre[1]) <= camera->centre[1];
}

/* Returns the voxels [first, last] of a brick along each axis. */
static void compute_box(const struct sp_grid *grid, const struct sp_detail_brick *brick,
                        uint32_t first[3], uint32_t last[3]) {
    uint32_t rest = brick->brick;
    for (int a = 0; a < 3; a++) {
        uint32_t cells = sp_detail_cells(grid->dims[a], brick->level);
        uint32_t bricks = (cells + SP_BRICK - 1) / SP_BRICK, side = 16u << brick->level;
        uint32_t place = a < 2 ? rest % bricks : rest;
        rest /= bricks;
        assert_compare(place, <, bricks);
        first[a] = place * side;
        last[a] = first[a] + side < grid->dims[a] ? first[a] + side - 1 : grid->dims[a] - 1;
    }
}

/* Checks the edges of a cell at the corners of the brick that are in the image. */
static void check_size(const struct sp_camera_transform *camera, const struct sp_grid *grid,
                       const struct sp_detail_brick *brick, const uint32_t first[3],
                       const uint32_t last[3], double most, double *longest) {
    const double h = 1e-4;
    for (int corner = 0; corner < 8; corner++)
        for (int a = 0; a < 3; a++) {
            double p[3], q[3], x[2], y[2];
            for (int i = 0; i < 3; i++)
                p[i] = q[i] = corner >> i & 1 ? last[i] : first[i];
            q[a] += h;
            if (!project(camera, grid, p, x))
                continue;
            project(camera, grid, q, y);
            double length = ldexp(hypot(x[0] - y[0], x[1] - y[1]) / h, brick->level);
            assert_compare(length, <=, most * 1.001);
            *longest = fmax(*longest, length / most);
        }
}

static void the_cut_holds_each_voxel_once_and_none_too_large(void **state) {
    (void)state;
    static uint8_t seen[90 * 70 * 130];
    struct sp_arena arena;
    sp_arena_init(&arena);
    srand(8);
    double longest[2] = { 0, 0 };
    unsigned levels_seen = 0;
    for (int n = 0; n < 400; n++) {
        const uint32_t dims[3] = { 1 + (uint32_t)rand() % 90, 1 + (uint32_t)rand() % 70,
                                   1 + (uint32_t)rand() % 130 };
        struct sp_grid grid = make_grid(dims);
        struct sp_view view = make_view((enum sp_projection)(n % 2), pow(10, uniform(0.5, 4)));
        struct sp_camera_transform camera;
        const double depth = (const double[3]){ 0.01, 0.4, 20 }[n % 3];
        set_depth(&view, depth);
        sp_camera_transform_init(&camera, &view.camera, view.size);
        struct sp_detail detail;
        struct sp_detail_job job = { .camera = &camera, .grid = &grid, .view = &view };
        job.levels = sp_detail_levels(dims, LEVELS);
        job.floor = n % 5 == 0 && job.levels > 1 ? 1 : 0;
        sp_arena_reset(&arena);
        assert_true(sp_detail_choose(&job, &arena, &detail));
        memset(seen, 0, (size_t)dims[0] * dims[1] * dims[2]);
        uint32_t levels = 0;
        for (uint32_t i = 0; i < detail.count; i++) {
            const struct sp_detail_brick *b = &detail.bricks[i];
            uint32_t first[3], last[3];
            levels |= 1u << b->level;
            assert_compare(b->level, >=, job.floor);
            assert_compare(b->level, <, job.levels);
            compute_box(&grid, b, first, last);
            for (uint32_t z = first[2]; z <= last[2]; z++)
                for (uint32_t y = first[1]; y <= last[1]; y++)
                    for (uint32_t x = first[0]; x <= last[0]; x++)
                        seen[x + dims[0] * (y + dims[1] * z)]++;
            bool is_thin = ldexp(depth, b->level) <= SP_DETAIL_THIN;
            if (b->level > 0 && !b->is_enlarged)
                check_size(&camera, &grid, b, first, last,
                           is_thin ? SP_DETAIL_THIN_PIXELS : SP_DETAIL_PIXELS, &longest[is_thin]);
        }
        assert_int_equal(levels, detail.levels);
        levels_seen |= levels;
        for (uint32_t i = 0; i < dims[0] * dims[1] * dims[2]; i++)
            assert_int_equal(seen[i], 1);
    }
    assert_int_equal(levels_seen, 31);   /* 130 voxels are 9 bricks, 5, 3, 2, 1 */
    for (int thin = 0; thin < 2; thin++) /* the cells are as large as allowed */
        assert_compare(longest[thin], >, 0.9);
    sp_arena_finish(&arena);
}

static void far_away_a_volume_is_one_brick(void **state) {
    (void)state;
    const enum sp_shading_mode shadings[2] = { SP_SHADING_NONE, SP_SHADING_PHONG };
    struct sp_arena arena;
    sp_arena_init(&arena);
    const uint32_t dims[3] = { 500, 33, 17 };
    struct sp_grid grid = make_grid(dims);
    assert_int_equal(sp_detail_levels(dims, 8), 6); /* 500 cells, 250, 125, 63, 32, 16 */
    assert_int_equal(sp_detail_levels(dims, 3), 3);
    assert_int_equal(sp_detail_levels((const uint32_t[3]){ 16, 1, 16 }, 8), 1);
    for (int lit = 0; lit < 2; lit++) {
        struct sp_view view = make_view(SP_PERSPECTIVE, 1e6);
        view.shading.mode = shadings[lit];
        struct sp_camera_transform camera;
        sp_camera_transform_init(&camera, &view.camera, view.size);
        struct sp_detail detail;
        struct sp_detail_job job = { .camera = &camera, .grid = &grid, .view = &view, .levels = 6 };
        assert_true(sp_detail_choose(&job, &arena, &detail));
        assert_int_equal(detail.count, 1);
        assert_int_equal(detail.bricks[0].level, 5);
        assert_false(detail.bricks[0].is_enlarged);
    }
    sp_arena_finish(&arena);
}

static void only_thin_cells_may_be_large(void **state) {
    (void)state;
    struct sp_grid grid = make_grid((const uint32_t[3]){ 50, 50, 50 });
    struct sp_view view = make_view(SP_PERSPECTIVE, 100);
    set_depth(&view, 0.3);
    assert_compare(sp_detail_pixels(&view, &grid, 2), ==, SP_DETAIL_THIN_PIXELS);
    assert_compare(sp_detail_pixels(&view, &grid, 3), ==, SP_DETAIL_PIXELS);
    view.transfer_function.points[1].opacity = 1;
    assert_compare(sp_detail_pixels(&view, &grid, 0), ==, SP_DETAIL_PIXELS);
}

/* A volume without mip levels is drawn at the floor; above floor 0 it is reported as enlarged. */
static void a_volume_without_mip_levels_is_drawn_whole(void **state) {
    (void)state;
    struct sp_arena arena;
    sp_arena_init(&arena);
    const uint32_t dims[3] = { 100, 100, 100 };
    struct sp_grid grid = make_grid(dims);
    for (int n = 0; n < 7; n++)
        for (unsigned floor = 0; floor < 3; floor++) {
            struct sp_view view = make_view(SP_PERSPECTIVE, 1e5);
            struct sp_camera_transform camera;
            sp_camera_transform_init(&camera, &view.camera, view.size);
            if (n == 0)
                view.level_of_detail = SP_LOD_OFF;
            if (n == 1)
                view.transfer_function.order = SP_TF_POST;
            if (n == 2)
                view.filter.kernel = SP_KERNEL_CUBIC;
            if (n == 3)
                view.filter.lowpass = 0;
            if (n > 3)
                view.filter.mode =
                    (const enum sp_filter_mode[]){ SP_FILTER_RECONSTRUCTION, SP_FILTER_SWAN,
                                                   SP_FILTER_NONE }[n - 4];
            struct sp_detail detail;
            struct sp_detail_job job = {
                .camera = &camera, .grid = &grid, .view = &view, .floor = floor, .levels = 4
            };
            assert_true(sp_detail_choose(&job, &arena, &detail));
            assert_int_equal(detail.levels, 1u << floor);
            for (uint32_t i = 0; i < detail.count; i++)
                assert_true(detail.bricks[i].is_enlarged);
        }
    sp_arena_finish(&arena);
}

/* The variances of the box and of the cells' kernel add up to the variance of the voxels' kernel.
 */
static void kernels_of_cells_leave_out_the_variance_of_the_box(void **state) {
    (void)state;
    for (int k = 0; k < 20; k++) {
        struct sp_filter filter = { .kernel = SP_KERNEL_GAUSSIAN, .sigma = 0.6 + 0.1 * k };
        for (unsigned l = 0; l < 4; l++) {
            double cell = 1 << l, box = (cell * cell - 1) / 12;
            struct sp_filter own = sp_detail_filter(&filter, l, false);
            double want = filter.sigma * filter.sigma - box;
            double got = own.sigma * own.sigma * cell * cell;
            if (want > pow(SP_DETAIL_SIGMA * cell, 2) || l == 0)
                assert_compare(fabs(got - want), <, 1e-12);
            else
                assert_compare(own.sigma, ==, SP_DETAIL_SIGMA);
            assert_compare(sp_detail_filter(&filter, l, true).sigma, ==, filter.sigma);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_cut_holds_each_voxel_once_and_none_too_large),
        cmocka_unit_test(far_away_a_volume_is_one_brick),
        cmocka_unit_test(only_thin_cells_may_be_large),
        cmocka_unit_test(a_volume_without_mip_levels_is_drawn_whole),
        cmocka_unit_test(kernels_of_cells_leave_out_the_variance_of_the_box),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
