/* SPDX-License-Identifier: Apache-2.0
 *
 * Compares picking with sums over many small steps of the ray, and with closed forms. The test has
 * its own implementation of the samples, written from the mathematics alone.
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

enum { NX = 7, NY = 6, NZ = 5, STEPS = 200000 };
static const uint32_t size[2] = { 60, 40 };

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

static struct sp_grid skewed_grid(void) {
    static const double gaps[NY] = { 0, 0.4, 1.7, 2.0, 4.5, 5.0 };
    struct sp_grid grid = { .dims = { NX, NY, NZ },
                            .spacing = { 1.3, 1.0, 0.8 },
                            .origin = { 2, -3, 1 },
                            .direction = { { 0.96, 0.1, 0.28 }, { 0, 0.9, 0 }, { -0.28, 0, 0.96 } },
                            .coordinates = { NULL, gaps, NULL } };
    for (int axis = 0; axis < 3; axis++) { /* columns of unit length */
        double length = 0;
        for (int r = 0; r < 3; r++)
            length += grid.direction[r][axis] * grid.direction[r][axis];
        for (int r = 0; r < 3; r++)
            grid.direction[r][axis] /= sqrt(length);
    }
    return grid;
}

static struct sp_volume *noise(const struct sp_grid *grid) {
    float voxels[NX * NY * NZ];
    for (int i = 0; i < NX * NY * NZ; i++)
        voxels[i] = (float)uniform(0, 10);
    voxels[NX * NY * 2 + NX * 2 + 3] = NAN;
    struct sp_volume *volume = sp_volume_create(grid, SP_FLOAT32, voxels, "noise", NULL);
    assert_non_null(volume);
    return volume;
}

/* Finds the sample whose cell contains a position, by trying all; false outside the volume. */
static bool cell_of(const struct sp_grid *grid, const double world[3], uint32_t cell[3]) {
    double m[3][4];
    for (int r = 0; r < 3; r++) {
        memcpy(m[r], grid->direction[r], sizeof grid->direction[r]);
        m[r][3] = world[r] - grid->origin[r];
    }
    for (int c = 0; c < 3; c++) /* Gauss and Jordan; the diagonal is far from zero */
        for (int r = 0; r < 3; r++)
            for (int k = 3; r != c && k >= c; k--)
                m[r][k] -= m[c][k] * m[r][c] / m[c][c];
    for (int axis = 0; axis < 3; axis++) {
        const double *c = grid->coordinates[axis];
        double at = m[axis][3] / m[axis][axis];
        uint32_t n = grid->dims[axis], i;
        for (i = 0; i < n; i++) {
            double d = c ? c[i] : i * grid->spacing[axis];
            double before = i > 0 ? (c ? c[i - 1] : d - grid->spacing[axis])
                                  : d - (c ? c[1] - c[0] : grid->spacing[axis]);
            double after = i + 1 < n ? (c ? c[i + 1] : d + grid->spacing[axis])
                                     : d + (c ? c[n - 1] - c[n - 2] : grid->spacing[axis]);
            if (at >= 0.5 * (before + d) && at < 0.5 * (d + after))
                break;
        }
        if (i == n)
            return false;
        cell[axis] = i;
    }
    return true;
}

static bool is_clipped(const struct sp_view *view, const double world[3]) {
    for (uint32_t i = 0; i < view->clip.plane_count; i++) {
        const struct sp_clip_plane *p = &view->clip.planes[i];
        if (p->normal[0] * world[0] + p->normal[1] * world[1] + p->normal[2] * world[2] < p->offset)
            return true;
    }
    return false;
}

static void brute(const struct sp_volume *volume, const struct sp_view *view, const double at[2],
                  double far, struct sp_pick *pick) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    double w[3][3], from[3], way[3], length = 0, depth = 0;
    test_camera_axes(&view->camera, w);
    double scale = test_camera_scale(view);
    double x = (at[0] - 0.5 * size[0]) / scale, y = (at[1] - 0.5 * size[1]) / scale;
    bool flat = view->camera.projection == SP_ORTHOGRAPHIC;
    for (int r = 0; r < 3; r++) {
        from[r] = view->camera.position[r] + (flat ? x * w[0][r] + y * w[1][r] : 0);
        way[r] = w[2][r] + (flat ? 0 : x * w[0][r] + y * w[1][r]);
        length += way[r] * way[r];
    }
    length = sqrt(length);
    *pick = (struct sp_pick){ .opacity = 0 };
    for (int n = 0; n < STEPS; n++) { /* t is the distance from the plane of the camera */
        double t = view->camera.near + (n + 0.5) * far / STEPS, world[3], gradient[3], color[3];
        uint32_t cell[3];
        for (int r = 0; r < 3; r++)
            world[r] = from[r] + t * way[r];
        if (!cell_of(&info->grid, world, cell) || is_clipped(view, world))
            continue;
        double value =
            test_sample(sp_volume_voxels(volume), info->type, test_sample_index(&info->grid, cell));
        if (!isfinite(value))
            continue;
        test_gradient(info, sp_volume_voxels(volume), cell, gradient);
        double magnitude =
            sqrt(gradient[0] * gradient[0] + gradient[1] * gradient[1] + gradient[2] * gradient[2]);
        double opacity;
        test_classify(&view->transfer_function, value, magnitude, color, &opacity);
        depth += -log1p(-opacity) / view->transfer_function.reference_length * length * far / STEPS;
        if (!pick->is_hit && depth >= log(2)) {
            pick->is_hit = true;
            pick->value = value;
            memcpy(pick->position, world, sizeof world);
        }
    }
    pick->opacity = 1 - exp(-depth);
}

static void pick_ray(const struct sp_volume *volume, const struct sp_view *view, const double at[2],
                     struct sp_pick *pick) {
    const struct sp_pick_input input = {
        .volume = volume, .view = view, .size = { size[0], size[1] }, .at = { at[0], at[1] }
    };
    assert_true(sp_pick_at(&input, pick, NULL));
}

static void compare(const struct sp_volume *volume, const struct sp_view *view, double far,
                    unsigned *hits) {
    for (int n = 0; n < 12; n++) {
        double at[2] = { uniform(10, 50), uniform(5, 35) };
        struct sp_pick exact, summed;
        pick_ray(volume, view, at, &exact);
        brute(volume, view, at, far, &summed);
        assert_compare(fabs(exact.opacity - summed.opacity), <, 2e-3);
        if (fabs(summed.opacity - 0.5) < 2e-3)
            continue; /* both are correct */
        assert_int_equal(exact.is_hit, summed.is_hit);
        if (!exact.is_hit)
            continue;
        ++*hits;
        double off = 0;
        for (int r = 0; r < 3; r++)
            off = fmax(off, fabs(exact.position[r] - summed.position[r]));
        assert_compare(off, <, 5e-3);
        assert_compare(exact.value, ==, summed.value);
    }
}

static void set_up_view(struct sp_view *view, const struct sp_volume *volume, bool gradient) {
    sp_view_init(view, sp_volume_info(volume), "v");
    memcpy(view->size, size, sizeof size);
    view->transfer_function = (struct sp_transfer_function){
        .reference_length = 0.7,
        .point_count = 3,
        .points = { { 1, { 1, 0, 0 }, 0 }, { 6, { 0, 1, 0 }, 0.1f }, { 9, { 0, 0, 1 }, 0.6f } },
        .gradient_count = gradient ? 2 : 0,
        .gradient = { { 0.5, 0.1f }, { 6, 1 } }
    };
}

static void picks_equal_sums_of_small_steps(void **state) {
    (void)state;
    unsigned hits = 0;
    srand(7);
    struct sp_grid even = skewed_grid(), skewed = even;
    even.coordinates[1] = NULL;
    for (int variant = 0; variant < 8; variant++) {
        struct sp_volume *volume = noise(variant & 1 ? &skewed : &even);
        struct sp_view view;
        set_up_view(&view, volume, variant & 2);
        if (variant & 4) {
            view.camera.projection = SP_ORTHOGRAPHIC;
            view.camera.height = 9;
            view.clip.plane_count = 1;
            view.clip.planes[0] = (struct sp_clip_plane){ { 2, 1, 0 }, 8 };
        }
        for (int r = 0; r < 3; r++)
            view.camera.position[r] += uniform(-3, 3);
        compare(volume, &view, 60, &hits);
        sp_volume_unref(&volume);
    }
    assert_compare(hits, >, 20); /* enough rays met the volume */
}

/* A cube of one value: half of the opacity is reached where the closed form says. */
static void a_uniform_cube_has_its_closed_form(void **state) {
    (void)state;
    uint8_t voxels[8 * 8 * 8];
    memset(voxels, 5, sizeof voxels);
    struct sp_grid grid = { .dims = { 8, 8, 8 }, .spacing = { 1, 1, 1 } };
    for (int i = 0; i < 3; i++)
        grid.direction[i][i] = 1;
    struct sp_volume *volume = sp_volume_create(&grid, SP_UINT8, voxels, "cube", NULL);
    struct sp_view view;
    struct sp_pick pick;
    const double middle[2] = { 30, 20 }, outside[2] = { -4000, 20 };
    sp_view_init(&view, sp_volume_info(volume), "v");
    view.camera = (struct sp_camera){ .position = { 3.2, 3.3, -20 },
                                      .target = { 3.2, 3.3, 0 },
                                      .up = { 0, 1, 0 },
                                      .fov_y = 30,
                                      .near = 0.1 };
    view.transfer_function = (struct sp_transfer_function){
        .reference_length = 1, .point_count = 1, .points = { { 5, { 1, 1, 1 }, 0.25f } }
    };
    pick_ray(volume, &view, middle, &pick);
    assert_true(pick.is_hit);
    assert_compare(pick.value, ==, 5);
    assert_compare(fabs(pick.position[2] - (-0.5 + log(2) / -log(0.75))), <, 1e-6);
    assert_compare(fabs(pick.position[0] - 3.2), <, 1e-9);
    assert_compare(fabs(pick.position[1] - 3.3), <, 1e-9);
    assert_compare(fabs(pick.opacity - (1 - pow(0.75, 8))), <, 1e-6);

    view.clip.box[0][2] = 0.25; /* starts two voxels deeper */
    pick_ray(volume, &view, middle, &pick);
    assert_compare(fabs(pick.position[2] - (1.5 + log(2) / -log(0.75))), <, 1e-6);
    assert_compare(fabs(pick.opacity - (1 - pow(0.75, 6))), <, 1e-6);
    view.clip.box[0][2] = 0;
    view.camera.near = 22.5; /* the near plane cuts as well */
    pick_ray(volume, &view, middle, &pick);
    assert_compare(fabs(pick.position[2] - (2.5 + log(2) / -log(0.75))), <, 1e-6);

    pick_ray(volume, &view, outside, &pick);
    assert_true(!pick.is_hit);
    assert_compare(pick.opacity, ==, 0);
    view.transfer_function.points[0].opacity = 0.05f;
    pick_ray(volume, &view, middle, &pick);
    assert_true(!pick.is_hit);
    assert_compare(pick.opacity, >, 0.2);
    assert_compare(pick.opacity, <, 0.5);
    view.camera.position[2] = 3; /* from inside; exactly along a face of cells */
    view.camera.target[2] = 9;
    view.camera.position[0] = view.camera.target[0] = 3.5;
    view.camera.near = 0.1;
    pick_ray(volume, &view, middle, &pick);
    assert_compare(fabs(pick.opacity - (1 - pow(0.95, 7.5 - 3.1))), <, 1e-6);
    sp_volume_unref(&volume);
}

/* One voxel, planes of any length, rays that miss, an empty clip: nothing outside is read. */
static void extreme_input_reads_nothing_outside(void **state) {
    (void)state;
    const int16_t voxel = 3;
    struct sp_grid grid = { .dims = { 1, 1, 1 }, .spacing = { 1e-9, 1e9, 1 } };
    for (int i = 0; i < 3; i++)
        grid.direction[i][i] = 1;
    struct sp_volume *volume = sp_volume_create(&grid, SP_INT16, &voxel, "one", NULL);
    struct sp_view view;
    struct sp_pick pick;
    sp_view_init(&view, sp_volume_info(volume), "v");
    for (int n = 0; n < 2000; n++) {
        double at[2] = { uniform(-1e5, 1e5), uniform(-1e5, 1e5) };
        view.clip.plane_count = n % 3;
        view.clip.planes[0] = (struct sp_clip_plane){ { 1e308, -1e308, 1e308 }, uniform(-1, 1) };
        view.clip.planes[1] = (struct sp_clip_plane){ { 0, 0, 5e-324 }, n % 2 ? 1e308 : -1e308 };
        for (int r = 0; r < 3; r++)
            view.camera.position[r] = uniform(-1, 1) * pow(10, uniform(-9, 15));
        pick_ray(volume, &view, at, &pick);
        assert_compare(pick.opacity, >=, 0);
        assert_compare(pick.opacity, <=, 1);
    }
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(picks_equal_sums_of_small_steps),
                                        cmocka_unit_test(a_uniform_cube_has_its_closed_form),
                                        cmocka_unit_test(extreme_input_reads_nothing_outside) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
