/* SPDX-License-Identifier: Apache-2.0
 *
 * Picking of surfaces and shells: a ball whose samples are its distance from the surface, so that
 * every place has a closed form, on cubic and on stretched, turned and uneven grids.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sp/pick.h"
#include "support/compare.h"
#include "support/sample.h"

enum { SIDE = 48 };
static const uint32_t size[2] = { 400, 300 };
static const double radius = 15; /* of the surface of value 0 */

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

static double length(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

struct ball {
    struct sp_grid grid;
    double uneven[SIDE];
    float *voxels; /* radius − distance from the centre */
    double center[3];
    struct sp_volume *volume;
};

static void make_ball(struct ball *ball, bool is_odd) {
    *ball = (struct ball){ .grid = { .dims = { SIDE, SIDE, SIDE },
                                     .spacing = { 1, 1, 1 },
                                     .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } } };
    if (is_odd) { /* axis 1 uneven, axis 2 stretched, turned about z */
        double turned[3][3] = { { 0.8, -0.6, 0 }, { 0.6, 0.8, 0 }, { 0, 0, 1 } };
        memcpy(ball->grid.direction, turned, sizeof turned);
        for (int i = 0; i < SIDE; i++)
            ball->uneven[i] = i * (0.9 + 0.2 * i / (SIDE - 1.0));
        ball->grid.coordinates[1] = ball->uneven;
        ball->grid.spacing[1] = ball->uneven[SIDE - 1] / (SIDE - 1);
        ball->grid.spacing[2] = 1.5;
        ball->grid.origin[0] = -7;
    }
    const uint32_t middle[3] = { SIDE / 2, SIDE / 2, SIDE / 2 };
    test_sample_place(&ball->grid, middle, ball->center);
    ball->voxels = malloc(SIDE * SIDE * SIDE * sizeof *ball->voxels);
    assert_non_null(ball->voxels);
    for (uint32_t n = 0; n < SIDE * SIDE * SIDE; n++) {
        const uint32_t i[3] = { n % SIDE, n / SIDE % SIDE, n / SIDE / SIDE };
        double at[3];
        test_sample_place(&ball->grid, i, at);
        for (int r = 0; r < 3; r++)
            at[r] -= ball->center[r];
        ball->voxels[n] = (float)(radius - length(at));
    }
    ball->volume = sp_volume_create(&ball->grid, SP_FLOAT32, ball->voxels, "ball", NULL);
    assert_non_null(ball->volume);
}

static void drop_ball(struct ball *ball) {
    sp_volume_unref(&ball->volume);
    free(ball->voxels);
}

/* The trilinear interpolation at a world position, written from the mathematics. */
static double value_at(const struct ball *ball, const double world[3]) {
    uint32_t low[3];
    double share[3], sum = 0;
    for (int a = 0; a < 3; a++) { /* the direction is orthogonal */
        double at = 0;
        for (int r = 0; r < 3; r++)
            at += ball->grid.direction[r][a] * (world[r] - ball->grid.origin[r]);
        const double *c = ball->grid.coordinates[a];
        for (low[a] = 0; low[a] + 2 < SIDE; low[a]++)
            if ((c ? c[low[a] + 1] : (low[a] + 1) * ball->grid.spacing[a]) > at)
                break;
        double from = c ? c[low[a]] : low[a] * ball->grid.spacing[a];
        double to = c ? c[low[a] + 1] : (low[a] + 1) * ball->grid.spacing[a];
        share[a] = (at - from) / (to - from);
    }
    for (int corner = 0; corner < 8; corner++) {
        uint32_t i[3];
        double weight = 1;
        for (int a = 0; a < 3; a++) {
            i[a] = low[a] + (corner >> a & 1);
            weight *= corner >> a & 1 ? share[a] : 1 - share[a];
        }
        sum += weight * test_sample(ball->voxels, SP_FLOAT32, test_sample_index(&ball->grid, i));
    }
    return sum;
}

/* Looks at the ball from a random side; the layers are the surface of value 0 alone. */
static struct sp_view view_of(const struct ball *ball) {
    struct sp_view view;
    double way[3] = { uniform(-1, 1), uniform(-1, 1), uniform(0.2, 1) };
    sp_view_init(&view, sp_volume_info(ball->volume), "v");
    for (int r = 0; r < 3; r++) {
        view.camera.target[r] = ball->center[r];
        view.camera.position[r] = ball->center[r] + 120 * way[r] / length(way);
    }
    view.camera.up[0] = 0.3;
    view.layer_count = 1;
    view.layers[0] = sp_layer_default(SP_LAYER_SURFACE);
    view.layers[0].value = 0;
    return view;
}

static double from_center(const struct ball *ball, const struct sp_pick *pick) {
    double v[3];
    for (int r = 0; r < 3; r++)
        v[r] = pick->position[r] - ball->center[r];
    return length(v);
}

static double from_eye(const struct sp_view *view, const struct sp_pick *pick) {
    double v[3];
    for (int r = 0; r < 3; r++)
        v[r] = pick->position[r] - view->camera.position[r];
    return length(v);
}

static struct sp_pick pick_at(const struct ball *ball, const struct sp_view *view, double x,
                              double y) {
    struct sp_pick pick;
    const struct sp_pick_input input = {
        .volume = ball->volume, .view = view, .size = { size[0], size[1] }, .at = { x, y }
    };
    assert_true(sp_pick_at(&input, &pick, NULL));
    return pick;
}

static void a_surface_is_hit_where_its_value_is(void **state) {
    (void)state;
    srand(11);
    for (int odd = 0; odd < 2; odd++) {
        struct ball ball;
        make_ball(&ball, odd);
        for (int n = 0; n < 60; n++) {
            struct sp_view view = view_of(&ball);
            if (n & 1) {
                view.camera.projection = SP_ORTHOGRAPHIC;
                view.camera.height = 64;
            }
            struct sp_pick pick = pick_at(&ball, &view, uniform(180, 220), uniform(130, 170));
            assert_true(pick.is_hit);
            assert_compare(pick.value, ==, 0);
            assert_compare(pick.opacity, ==, 1);
            assert_compare(fabs(value_at(&ball, pick.position)), <, 1e-9);
            assert_compare(fabs(from_center(&ball, &pick) - radius), <, odd ? 0.04 : 0.02);
            assert_compare(from_eye(&view, &pick), <, 120); /* the front, not the back */
        }
        drop_ball(&ball);
    }
}

static void rays_beside_a_surface_miss_it(void **state) {
    (void)state;
    srand(12);
    struct ball ball;
    make_ball(&ball, false);
    struct sp_view view = view_of(&ball);
    view.camera.projection = SP_ORTHOGRAPHIC;
    view.camera.height = 60; /* 5 px per world unit */
    assert_true(pick_at(&ball, &view, 200 + 5 * (radius - 0.05), 150).is_hit);
    struct sp_pick beside = pick_at(&ball, &view, 200 + 5 * (radius + 0.05), 150);
    assert_false(beside.is_hit);
    assert_compare(beside.opacity, ==, 0);
    view.layers[0].value = 1e6; /* outside of the range: no surface */
    assert_false(pick_at(&ball, &view, 200, 150).is_hit);
    view.layers[0].value = 0;
    view.layers[0].visible = false;
    assert_false(pick_at(&ball, &view, 200, 150).is_hit);
    drop_ball(&ball);
}

static void opacity_of_surfaces_adds_up(void **state) {
    (void)state;
    srand(13);
    struct ball ball;
    make_ball(&ball, false);
    struct sp_view view = view_of(&ball);
    view.layers[0].opacity = 0.3f;
    struct sp_pick pick = pick_at(&ball, &view, 200, 150);
    assert_compare(fabs(pick.opacity - (1 - 0.7 * 0.7)), <, 1e-7); /* front and back */
    assert_true(pick.is_hit);
    assert_compare(from_eye(&view, &pick), >, 120); /* half is reached at the back */
    view.layers[1] = view.layers[0];
    view.layers[1].value = 5; /* inside, opaque */
    view.layers[1].opacity = 1;
    view.layer_count = 2;
    pick = pick_at(&ball, &view, 200, 150);
    assert_compare(pick.value, ==, 5);
    assert_compare(fabs(from_center(&ball, &pick) - 10), <, 0.02);
    view.layers[1].opacity = 0; /* as if it did not exist */
    assert_compare(pick_at(&ball, &view, 200, 150).value, ==, 0);
    drop_ball(&ball);
}

/* A transfer function that gives every value below `from` no opacity, every other one `opacity`. */
static void show_from(struct sp_view *view, double from, float opacity) {
    view->transfer_function =
        (struct sp_transfer_function){ .reference_length = 1,
                                       .point_count = 2,
                                       .points = { { from - 1e-6, { 1, 1, 1 }, 0 },
                                                   { from, { 1, 1, 1 }, opacity } } };
}

static void a_surface_lies_in_the_volume_around_it(void **state) {
    (void)state;
    srand(14);
    struct ball ball;
    make_ball(&ball, false);
    struct sp_view view = view_of(&ball);
    view.layers[1] = sp_layer_default(SP_LAYER_VOLUME);
    view.layer_count = 2;
    view.layers[0].value = 8; /* 8 deep in the ball */
    show_from(&view, 0, 0.02f);
    struct sp_pick pick = pick_at(&ball, &view, 200, 150);
    assert_compare(pick.value, ==, 8);
    assert_compare(fabs(from_center(&ball, &pick) - 7), <, 0.04);
    show_from(&view, 0, 0.5f); /* the matter in front of it is opaque enough */
    pick = pick_at(&ball, &view, 200, 150);
    assert_compare(fabs(from_center(&ball, &pick) - (radius - 1)), <, 1);
    view.layers[1].visible = false;
    assert_compare(pick_at(&ball, &view, 200, 150).value, ==, 8);
    view.layers[0].visible = false;
    pick = pick_at(&ball, &view, 200, 150);
    assert_false(pick.is_hit);
    assert_compare(pick.opacity, ==, 0);
    drop_ball(&ball);
}

static void the_clip_opens_a_surface(void **state) {
    (void)state;
    srand(15);
    struct ball ball;
    make_ball(&ball, false);
    struct sp_view view = view_of(&ball);
    struct sp_clip_plane *plane = &view.clip.planes[0];
    double at = 0;
    view.clip.plane_count = 1; /* keeps the far half */
    for (int r = 0; r < 3; r++) {
        plane->normal[r] = view.camera.target[r] - view.camera.position[r];
        at += plane->normal[r] * ball.center[r];
    }
    plane->offset = at;
    struct sp_pick pick = pick_at(&ball, &view, 205, 152);
    assert_true(pick.is_hit); /* the inside of the back: a cut has no face */
    assert_compare(fabs(value_at(&ball, pick.position)), <, 1e-9);
    assert_compare(from_eye(&view, &pick), >, 120 + radius - 1);
    drop_ball(&ball);
}

static void a_cell_with_a_hole_has_no_surface(void **state) {
    (void)state;
    srand(16);
    struct ball ball;
    make_ball(&ball, false);
    const uint32_t middle = SIDE / 2;
    for (uint32_t z = 0; z < middle; z++) /* all samples around the axis to the front */
        for (int n = 0; n < 9; n++)
            ball.voxels[middle - 1 + n % 3 + SIDE * (middle - 1 + n / 3 + SIDE * z)] = NAN;
    sp_volume_unref(&ball.volume);
    ball.volume = sp_volume_create(&ball.grid, SP_FLOAT32, ball.voxels, "ball", NULL);
    struct sp_view view = view_of(&ball);
    view.camera.position[0] = ball.center[0];
    view.camera.position[1] = ball.center[1];
    view.camera.position[2] = ball.center[2] - 120;
    struct sp_pick pick = pick_at(&ball, &view, 200, 150);
    assert_true(pick.is_hit);
    assert_compare(from_eye(&view, &pick), >, 120 + radius - 1); /* through the hole to the back */
    drop_ball(&ball);
}

static void a_shell_is_hit_in_its_first_voxel(void **state) {
    (void)state;
    srand(17);
    struct ball ball;
    make_ball(&ball, false);
    struct sp_view view = view_of(&ball);
    view.layers[0] = sp_layer_default(SP_LAYER_SHELL);
    show_from(&view, 0, 0.97f);
    for (int n = 0; n < 40; n++) {
        struct sp_pick pick = pick_at(&ball, &view, uniform(185, 215), uniform(135, 165));
        assert_true(pick.is_hit);
        assert_compare(from_center(&ball, &pick), <, radius + 0.9);
        assert_compare(from_center(&ball, &pick), >, radius - 1.5);
        assert_compare(pick.value, >=, 0);
        assert_compare(pick.opacity, >, 0.9);
    }
    show_from(&view, 0, 0.5f); /* every voxel is between low and high: all are in the shell */
    struct sp_pick all = pick_at(&ball, &view, 200, 150);
    view.layers[0] = sp_layer_default(SP_LAYER_VOLUME);
    struct sp_pick whole = pick_at(&ball, &view, 200, 150);
    assert_compare(fabs(all.opacity - whole.opacity), <, 1e-12);
    assert_compare(from_eye(&view, &all), ==, from_eye(&view, &whole));
    view.layers[0] = sp_layer_default(SP_LAYER_SHELL);
    view.layers[0].low = 0.6; /* no voxel is opaque enough */
    assert_false(pick_at(&ball, &view, 200, 150).is_hit);
    drop_ball(&ball);
}

/* The inside of a shell is empty: with opaque voxels at the border only, the eye in the ball sees
 * their inner side. */
static void the_inside_of_a_shell_is_empty(void **state) {
    (void)state;
    srand(18);
    struct ball ball;
    make_ball(&ball, false);
    struct sp_view view = view_of(&ball);
    view.layers[0] = sp_layer_default(SP_LAYER_SHELL);
    show_from(&view, 0, 0.97f);
    for (int r = 0; r < 3; r++)
        view.camera.position[r] += 0.95 * (ball.center[r] - view.camera.position[r]);
    struct sp_pick pick = pick_at(&ball, &view, 200, 150); /* 6 from the centre */
    assert_true(pick.is_hit);
    assert_compare(from_eye(&view, &pick), >, 6 + radius - 2.5);
    drop_ball(&ball);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_surface_is_hit_where_its_value_is),
        cmocka_unit_test(rays_beside_a_surface_miss_it),
        cmocka_unit_test(opacity_of_surfaces_adds_up),
        cmocka_unit_test(a_surface_lies_in_the_volume_around_it),
        cmocka_unit_test(the_clip_opens_a_surface),
        cmocka_unit_test(a_cell_with_a_hole_has_no_surface),
        cmocka_unit_test(a_shell_is_hit_in_its_first_voxel),
        cmocka_unit_test(the_inside_of_a_shell_is_empty),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
