/* SPDX-License-Identifier: Apache-2.0
 *
 * Changes of the scene's geometry that must not change the image, or must mirror it: mirroring, the
 * unit of length, the origin, the order of the axes, coordinates at equal distances. Each test runs
 * on every backend.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "conformance/invariant.h"
#include "support/compare.h"
#include "support/data.h"

/* A field that is symmetric in x about the middle of the volume. */
static double symmetric(const void *user, double x, double y, double z) {
    (void)user;
    double a = fabs(x - 15.5) - 8, b = y - 12, c = z - 18;
    return exp(-(a * a + b * b) / 30) + exp(-(a * a + c * c) / 12) * (y > 20);
}

static void a_symmetric_volume_gives_a_symmetric_image(void **state) {
    struct invariant_context *c = *state;
    for (int ortho = 0; ortho < 2; ortho++) {
        struct test_scene s;
        test_view_init(&s.view);
        test_scene_points(&s, (const double[][5]){ { 0.2, 0, 0, 1, 0 }, { 1, 1, 0.6, 0, 0.3 } }, 2);
        assert_true(test_scene_voxels(&s, ortho ? "symmetric-orthographic" : "symmetric",
                                      (uint32_t[]){ 32, 32, 32 }, (double[]){ 1, 1, 1 }, SP_FLOAT32,
                                      symmetric, NULL));
        test_scene_orbit(&s, NULL, 0, 25, 70); /* the camera is in the plane of symmetry */
        s.view.camera.projection = ortho ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
        struct test_image a = invariant_render(c, &s), b = invariant_render(c, &s);
        test_image_mirror(&b);
        invariant_assert_same(s.info.name, &a, &b, 80);
        test_scene_finish(&s);
    }
}

static void a_mirrored_direction_gives_the_mirrored_image(void **state) {
    struct invariant_context *c = *state;
    static test_scene_fn *const builds[] = { test_scene_rotated, test_scene_sheared,
                                             test_scene_clip_corner };
    for (size_t i = 0; i < sizeof builds / sizeof *builds * INVARIANT_MODES; i++) {
        struct test_scene s;
        assert_true(builds[i / INVARIANT_MODES](&s));
        s.view.compositing.mode = invariant_modes[i % INVARIANT_MODES];
        struct test_image a = invariant_render(c, &s);
        for (int axis = 0; axis < 3; axis++)
            s.info.grid.direction[0][axis] *= -1;
        s.info.grid.origin[0] *= -1;
        s.view.camera.position[0] *= -1;
        s.view.camera.target[0] *= -1;
        s.view.camera.up[0] *= -1;
        for (uint32_t k = 0; k < s.view.clip.plane_count; k++)
            s.view.clip.planes[k].normal[0] *= -1;
        struct test_image b = invariant_render(c, &s);
        test_image_mirror(&b);
        char name[160];
        snprintf(name, sizeof name, "%s-mirrored", s.info.name);
        invariant_assert_same(name, &b, &a, 80);
        test_scene_finish(&s);
    }
}

static void the_unit_of_length_does_not_change_the_image(void **state) {
    struct invariant_context *c = *state;
    static const double scales[] = { 2, 0.001, 1000 };
    static test_scene_fn *const builds[] = { test_scene_anisotropic, test_scene_orthographic,
                                             test_scene_oblique, test_scene_lit_shell,
                                             test_scene_clip_box };
    for (size_t i = 0; i < sizeof builds / sizeof *builds * INVARIANT_MODES; i++)
        for (int k = 0; k < 3; k++) {
            struct test_scene s;
            assert_true(builds[i / INVARIANT_MODES](&s));
            s.view.compositing.mode = invariant_modes[i % INVARIANT_MODES];
            struct test_image a = invariant_render(c, &s);
            struct sp_camera *camera = &s.view.camera;
            for (int axis = 0; axis < 3; axis++) {
                s.info.grid.spacing[axis] *= scales[k];
                s.info.grid.origin[axis] *= scales[k];
                camera->position[axis] *= scales[k];
                camera->target[axis] *= scales[k];
            }
            camera->near *= scales[k];
            camera->height *= scales[k];
            s.view.transfer_function.reference_length *= scales[k];
            struct test_image b = invariant_render(c, &s);
            char name[160];
            snprintf(name, sizeof name, "%s-unit-%g", s.info.name, scales[k]);
            invariant_assert_same(name, &b, &a, 80);
            test_scene_finish(&s);
        }
}

/* Scanners choose any origin of the world's coordinates. */
static void the_position_in_the_world_does_not_change_the_image(void **state) {
    struct invariant_context *c = *state;
    static const double far[3] = { 100000, -250000, 70000 };
    static test_scene_fn *const builds[] = { test_scene_rotated, test_scene_orthographic,
                                             test_scene_inside, test_scene_clip_plane,
                                             test_scene_rectilinear_blobs };
    for (size_t i = 0; i < sizeof builds / sizeof *builds * INVARIANT_MODES; i++) {
        struct test_scene s;
        assert_true(builds[i / INVARIANT_MODES](&s));
        s.view.compositing.mode = invariant_modes[i % INVARIANT_MODES];
        struct test_image a = invariant_render(c, &s);
        for (uint32_t k = 0; k < s.view.clip.plane_count; k++)
            for (int axis = 0; axis < 3; axis++)
                s.view.clip.planes[k].offset += s.view.clip.planes[k].normal[axis] * far[axis];
        for (int axis = 0; axis < 3; axis++) {
            s.info.grid.origin[axis] += far[axis];
            s.view.camera.position[axis] += far[axis];
            s.view.camera.target[axis] += far[axis];
        }
        struct test_image b = invariant_render(c, &s);
        char name[160];
        snprintf(name, sizeof name, "%s-far", s.info.name);
        invariant_assert_same(name, &b, &a, 80);
        test_scene_finish(&s);
    }
}

/* The same samples in another order in memory; the columns of the direction are reordered as well.
 */
static void the_order_of_axes_does_not_change_the_image(void **state) {
    struct invariant_context *c = *state;
    static const int orders[][3] = { { 1, 2, 0 }, { 2, 0, 1 }, { 1, 0, 2 } };
    /* Only sheets and slabs: compositing `splat` draws splats at the same distance in their order
     * in memory. */
    for (size_t n = 0; n < sizeof orders / sizeof *orders * 2; n++) {
        struct test_scene s;
        size_t k = n / 2;
        assert_true(test_scene_rotated(&s));
        s.view.compositing.mode = n % 2 ? SP_COMPOSITE_SLAB : SP_COMPOSITE_SHEET;
        struct test_image a = invariant_render(c, &s);
        const struct sp_grid was = s.info.grid;
        struct sp_grid *now = &s.info.grid;
        const float *from = s.voxels;
        float *to = calloc((size_t)was.dims[0] * was.dims[1] * was.dims[2], sizeof(double));
        assert_non_null(to);
        for (int axis = 0; axis < 3; axis++) {
            int old = orders[k][axis];
            now->dims[axis] = was.dims[old];
            now->spacing[axis] = was.spacing[old];
            for (int r = 0; r < 3; r++)
                now->direction[r][axis] = was.direction[r][old];
        }
        uint32_t i[3], j[3];
        for (i[2] = 0; i[2] < now->dims[2]; i[2]++)
            for (i[1] = 0; i[1] < now->dims[1]; i[1]++)
                for (i[0] = 0; i[0] < now->dims[0]; i[0]++) {
                    for (int axis = 0; axis < 3; axis++)
                        j[orders[k][axis]] = i[axis];
                    to[i[0] + now->dims[0] * (i[1] + (size_t)now->dims[1] * i[2])] =
                        from[j[0] + was.dims[0] * (j[1] + (size_t)was.dims[1] * j[2])];
                }
        free(s.voxels);
        s.voxels = to;
        struct test_image b = invariant_render(c, &s);
        char name[64];
        snprintf(name, sizeof name, "axes-%d%d%d", orders[k][0], orders[k][1], orders[k][2]);
        invariant_assert_same(name, &b, &a, 80);
        test_scene_finish(&s);
    }
}

/* Rectilinear coordinates at equal distances give the image of the uniform grid. */
static void evenly_spaced_coordinates_give_the_uniform_grid(void **state) {
    struct invariant_context *c = *state;
    double places[3][40];
    for (int way = 0; way < INVARIANT_WAYS; way++) {
        struct test_scene s;
        assert_true(test_scene_rotated(&s));
        s.view.shading.mode = SP_SHADING_PHONG;
        invariant_choose_way(&s.view, way);
        bool is_postconv = test_uses_postconv(&c->target, &s);
        struct test_image a = invariant_render(c, &s);
        for (int axis = 0; axis < 3; axis++) {
            for (int i = 0; i < 40; i++)
                places[axis][i] = i * s.info.grid.spacing[axis];
            s.info.grid.coordinates[axis] = places[axis];
        }
        struct test_image b = invariant_render(c, &s);
        char name[64];
        snprintf(name, sizeof name, "even-coordinates-%d", way);
        invariant_assert_same(name, &b, &a, is_postconv ? INVARIANT_POSTCONV_FLOOR : 80);
        test_scene_finish(&s);
    }
}

#define ON(test)                                                                                   \
    { #test, test, NULL, NULL, c }

static int run_target(struct invariant_context *c) {
    const struct CMUnitTest tests[] = {
        ON(a_symmetric_volume_gives_a_symmetric_image),
        ON(a_mirrored_direction_gives_the_mirrored_image),
        ON(the_unit_of_length_does_not_change_the_image),
        ON(the_position_in_the_world_does_not_change_the_image),
        ON(the_order_of_axes_does_not_change_the_image),
        ON(evenly_spaced_coordinates_give_the_uniform_grid),
    };
    /* Software GL is slow: it runs only the test that its comparison with the scalar reference
     * (ewa_test.c) does not cover. */
    const struct CMUnitTest few[] = {
        ON(a_symmetric_volume_gives_a_symmetric_image),
    };
    if (strcmp(c->target.backend, "gl-software") == 0)
        return cmocka_run_group_tests(few, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}

int main(void) {
    return invariant_run(run_target);
}
