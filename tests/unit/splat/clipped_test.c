/* SPDX-License-Identifier: Apache-2.0
 *
 * Bricks that clipping removes. The reference asks sp_extent_cut() for each voxel.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "splat/ewa.h"

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

/* A scene of 48 × 40 × 20 voxels: 3 × 3 × 2 bricks, some of them not whole. */
struct scene {
    double coordinates[3][48];
    struct sp_grid grid;
    struct sp_view view;
    struct sp_camera_transform camera;
    struct sp_ewa_frame frame;
};

static void init_scene(struct scene *s, bool is_rectilinear) {
    *s = (struct scene){ .grid = { .dims = { 48, 40, 20 } } };
    for (unsigned a = 0; a < 3; a++) {
        uint32_t last = s->grid.dims[a] - 1;
        s->grid.spacing[a] = uniform(0.3, 3);
        s->grid.origin[a] = uniform(-1e3, 1e3);
        for (int r = 0; r < 3; r++)
            s->grid.direction[r][a] = uniform(-0.4, 0.4) + (r == (int)a);
        for (uint32_t i = 1; is_rectilinear && i <= last; i++)
            s->coordinates[a][i] = s->coordinates[a][i - 1] + uniform(0.2, 4);
        if (is_rectilinear) {
            s->grid.spacing[a] = s->coordinates[a][last] / last;
            s->grid.coordinates[a] = s->coordinates[a];
        }
    }
    const struct sp_volume_info info = { .grid = s->grid, .range = { 0, 1 } };
    sp_view_init(&s->view, &info, "scene");
    s->view.filter.sigma = uniform(0.3, 2);
    s->view.filter.cutoff = uniform(1, 6);
    s->view.camera.projection = rand() % 2 ? SP_PERSPECTIVE : SP_ORTHOGRAPHIC;
    for (int r = 0; r < 3; r++)
        s->view.camera.position[r] += uniform(-20, 20);
}

static void prepare(struct scene *s) {
    sp_camera_transform_init(&s->camera, &s->view.camera, s->view.size);
    sp_ewa_frame_init(&s->frame, &s->camera, &s->grid, &s->view, &s->view.filter);
    sp_clip_frame_init(&s->frame.clip, &s->camera, &s->grid, &s->view.clip, s->frame.unit);
}

/* A plane of any direction through the box. */
static void add_plane(struct scene *s) {
    struct sp_clip_plane *plane = &s->view.clip.planes[s->view.clip.plane_count++];
    *plane = (struct sp_clip_plane){ .offset = 0 };
    for (int r = 0; r < 3; r++) {
        plane->normal[r] = uniform(-1, 1);
        double at = s->grid.origin[r];
        for (unsigned a = 0; a < 3; a++)
            at += s->grid.direction[r][a] * uniform(0, 1) *
                  sp_grid_distance(&s->grid, a, s->grid.dims[a] - 1);
        plane->offset += plane->normal[r] * at;
    }
}

/* True if each voxel of the brick is removed. */
static bool is_removed(const struct scene *s, const uint32_t first[3]) {
    struct sp_ewa_brick brick;
    sp_ewa_brick_init(&brick, &s->frame, first);
    for (uint32_t n = 0; n < SP_BRICK_VOXELS; n++) {
        const uint32_t at[3] = { n & 15, n >> 4 & 15, n >> 8 };
        struct sp_kernel_place p = { .h2 = 1,
                                     .det = 1,
                                     .inverse = { 1, 0, 1 },
                                     .m = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } },
                                     .radius = s->frame.radius };
        struct sp_cut cut;
        if (first[0] + at[0] >= s->grid.dims[0] || first[1] + at[1] >= s->grid.dims[1] ||
            first[2] + at[2] >= s->grid.dims[2])
            continue;
        sp_ewa_brick_place(&brick, &s->frame, (uint16_t)n, p.u);
        for (int r = 0; r < 3; r++)
            for (int a = 0; a < 3; a++)
                p.kernel[r][a] = s->frame.kernel[r][a] * brick.size[a][at[a]];
        if (sp_extent_cut(&p, &s->frame.clip, &cut) >= 0)
            return false;
    }
    return true;
}

struct counts {
    int found, missed;
};

/* Adds the bricks of the scene. No brick may be found that has a voxel left. */
static void check(const struct scene *s, struct counts *counts) {
    uint32_t first[3];
    for (first[2] = 0; first[2] < s->grid.dims[2]; first[2] += SP_BRICK)
        for (first[1] = 0; first[1] < s->grid.dims[1]; first[1] += SP_BRICK)
            for (first[0] = 0; first[0] < s->grid.dims[0]; first[0] += SP_BRICK) {
                bool is_clipped = sp_ewa_brick_is_clipped(&s->frame, first);
                bool want = is_removed(s, first);
                if (is_clipped)
                    assert_true(want);
                counts->found += is_clipped;
                counts->missed += want && !is_clipped;
            }
}

/* One plane removes a brick if it removes each of its voxels. */
static void a_plane_removes_the_bricks_beyond_it(void **state) {
    (void)state;
    struct counts counts = { 0 };
    srand(11);
    for (int n = 0; n < 40; n++) {
        struct scene s;
        init_scene(&s, false);
        add_plane(&s);
        prepare(&s);
        check(&s, &counts);
    }
    assert_int_equal(counts.missed, 0);
    assert_in_range(counts.found, 40, 40 * 17);
}

static void bricks_of_any_grid_are_kept_if_a_voxel_is_left(void **state) {
    (void)state;
    struct counts counts = { 0 };
    srand(12);
    for (int n = 0; n < 40; n++) {
        struct scene s;
        init_scene(&s, n % 2);
        for (int planes = rand() % 3; planes > 0; planes--)
            add_plane(&s);
        for (int a = 0; a < 3; a++) {
            s.view.clip.box[0][a] = uniform(-0.3, 0.5);
            s.view.clip.box[1][a] = uniform(0.5, 1.3);
        }
        prepare(&s);
        check(&s, &counts);
    }
    assert_in_range(counts.found, 80, 40 * 18);
}

static void without_planes_nothing_is_clipped(void **state) {
    (void)state;
    struct scene s;
    srand(13);
    init_scene(&s, false);
    prepare(&s);
    assert_int_equal(s.frame.clip.count, 0);
    assert_false(sp_ewa_brick_is_clipped(&s.frame, (uint32_t[3]){ 0, 0, 0 }));
    s.frame.clip = (struct sp_clip_frame){ .count = 1, .planes = { { { NAN, 0, 0 }, 0 } } };
    assert_false(sp_ewa_brick_is_clipped(&s.frame, (uint32_t[3]){ 0, 0, 0 }));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plane_removes_the_bricks_beyond_it),
        cmocka_unit_test(bricks_of_any_grid_are_kept_if_a_voxel_is_left),
        cmocka_unit_test(without_planes_nothing_is_clipped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
