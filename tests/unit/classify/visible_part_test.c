/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of a volume that a view shows, for boxes and balls of a known size.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/volume.h"
#include "sp/visible_part.h"
#include "support/compare.h"

enum { OBJECT = 200 };

static void release(void *voxels, size_t bytes) {
    (void)bytes;
    free(voxels);
}

/* A cube of `size` voxels, spacing 1, 1 and 2, origin (10, 20, 30), turned by a quarter about z;
 * voxels in [low, high] of each axis have the value OBJECT, all others `around`. */
static struct sp_volume *make(uint32_t size, enum sp_type type, const uint32_t low[3],
                              const uint32_t high[3], double around) {
    struct sp_volume_info info = { .type = type, .source = "test" };
    size_t count = (size_t)size * size * size, bytes = count * sp_type_size(type);
    void *voxels = aligned_alloc(64, (bytes + 63) & ~(size_t)63);
    assert_non_null(voxels);
    for (int a = 0; a < 3; a++) {
        info.grid.dims[a] = size;
        info.grid.spacing[a] = a == 2 ? 2 : 1;
        info.grid.origin[a] = 10 * (a + 1);
    }
    info.grid.direction[1][0] = 1; /* axis 0 is world y, axis 1 is world −x */
    info.grid.direction[0][1] = -1;
    info.grid.direction[2][2] = 1;
    for (size_t i = 0; i < count; i++) {
        const size_t at[3] = { i % size, i / size % size, i / size / size };
        bool is_in = true;
        for (int a = 0; a < 3; a++)
            is_in = is_in && at[a] >= low[a] && at[a] <= high[a];
        double value = is_in ? OBJECT : around;
        if (type == SP_FLOAT32)
            ((float *)voxels)[i] = (float)value;
        else
            ((uint8_t *)voxels)[i] = (uint8_t)value;
    }
    ((uint8_t *)voxels)[0] = 0; /* the range is never empty */
    struct sp_volume *volume = sp_volume_adopt(&info, voxels, NULL, bytes, release, NULL);
    assert_non_null(volume);
    return volume;
}

/* A view that shows values from OBJECT / 2 on. */
static struct sp_view view_of(const struct sp_volume *volume) {
    struct sp_view view;
    sp_view_init(&view, sp_volume_info(volume), "v");
    view.transfer_function.point_count = 2;
    view.transfer_function.points[0] = (struct sp_tf_point){ .value = OBJECT / 2 };
    view.transfer_function.points[1] = (struct sp_tf_point){ .value = OBJECT, .opacity = 0.5F };
    return view;
}

static struct sp_visible_part compute_part(const struct sp_view *view,
                                           const struct sp_volume *volume) {
    struct sp_visible_part part;
    struct sp_error err;
    if (!sp_view_compute_visible_part(view, volume, &part, &err))
        fail_msg("%s", err.text);
    return part;
}

static void check_box(const struct sp_visible_part *part, const double low[3], const double high[3],
                      double within) {
    assert_true(part->is_visible);
    for (int a = 0; a < 3; a++) {
        assert_compare(fabs(part->box[0][a] - low[a]), <=, within);
        assert_compare(fabs(part->box[1][a] - high[a]), <=, within);
    }
}

static void an_object_has_its_box_in_the_world(void **state) {
    (void)state;
    const enum sp_type types[] = { SP_UINT8, SP_FLOAT32 };
    for (int i = 0; i < 2; i++) {
        struct sp_volume *volume = make(64, types[i], (const uint32_t[3]){ 16, 32, 8 },
                                        (const uint32_t[3]){ 31, 47, 15 }, 0);
        struct sp_view view = view_of(volume);
        struct sp_visible_part part = compute_part(&view, volume);
        check_box(&part, (const double[3]){ 0.25, 0.5, 0.125 },
                  (const double[3]){ 0.5, 0.75, 0.25 }, 1e-9);
        const double center[3] = { 10 - 39.5, 20 + 23.5, 30 + 23 };
        const double half[3][3] = { { 0, 8, 0 }, { -8, 0, 0 }, { 0, 0, 8 } };
        for (int a = 0; a < 3; a++) {
            assert_compare(fabs(part.center[a] - center[a]), <, 1e-9);
            for (int r = 0; r < 3; r++)
                assert_compare(fabs(part.half[a][r] - half[a][r]), <, 1e-9);
        }
        assert_compare(fabs(part.radius - sqrt(3 * 64)), <, 1e-9); /* a corner */
        sp_volume_unref(&volume);
    }
}

static void the_clip_cuts_the_box(void **state) {
    (void)state;
    struct sp_volume *volume =
        make(64, SP_UINT8, (const uint32_t[3]){ 16, 16, 16 }, (const uint32_t[3]){ 47, 47, 47 }, 0);
    struct sp_view view = view_of(volume);
    view.clip.box[1][0] = 0.5;
    view.clip.plane_count = 1; /* axis 1 is world −x: keeps its samples up to 31 */
    view.clip.planes[0] = (struct sp_clip_plane){ .normal = { 1 }, .offset = 10 - 31.5 };
    struct sp_visible_part part = compute_part(&view, volume);
    check_box(&part, (const double[3]){ 0.25, 0.25, 0.25 }, (const double[3]){ 0.5, 0.5, 0.75 },
              1e-9);
    sp_volume_unref(&volume);
}

static void a_hidden_object_leaves_the_whole_volume(void **state) {
    (void)state;
    struct sp_volume *volume =
        make(64, SP_UINT8, (const uint32_t[3]){ 16, 16, 16 }, (const uint32_t[3]){ 47, 47, 47 }, 0);
    struct sp_view view = view_of(volume);
    view.clip.box[1][2] = 0.2;
    struct sp_visible_part part = compute_part(&view, volume);
    assert_false(part.is_visible);
    for (int a = 0; a < 3; a++) {
        assert_true(part.box[0][a] == 0);
        assert_true(part.box[1][a] == 1);
    }
    view.clip.box[0][2] = view.clip.box[1][2] = 0.501; /* between two samples */
    assert_false(compute_part(&view, volume).is_visible);
    sp_volume_unref(&volume);
}

static void an_object_between_the_samples_is_found(void **state) {
    (void)state;
    struct sp_volume *volume = make(256, SP_UINT8, (const uint32_t[3]){ 100, 60, 200 },
                                    (const uint32_t[3]){ 100, 60, 200 }, 0);
    struct sp_view view = view_of(volume);
    struct sp_visible_part part = compute_part(&view, volume);
    check_box(&part, (const double[3]){ 100 / 256.0, 60 / 256.0, 200 / 256.0 },
              (const double[3]){ 101 / 256.0, 61 / 256.0, 201 / 256.0 }, 1e-9);
    sp_volume_unref(&volume);
}

static void the_gradient_axis_counts(void **state) {
    (void)state;
    struct sp_volume *volume =
        make(64, SP_UINT8, (const uint32_t[3]){ 16, 0, 0 }, (const uint32_t[3]){ 63, 63, 63 }, 120);
    struct sp_view view = view_of(volume); /* both values are visible */
    struct sp_visible_part part = compute_part(&view, volume);
    check_box(&part, (const double[3]){ 0 }, (const double[3]){ 1, 1, 1 }, 1e-9);
    view.transfer_function.gradient_count = 2; /* the border alone */
    view.transfer_function.gradient[0] = (struct sp_gradient_point){ .magnitude = 10 };
    view.transfer_function.gradient[1] = (struct sp_gradient_point){ .magnitude = 20, .scale = 1 };
    part = compute_part(&view, volume);
    check_box(&part, (const double[3]){ 15 / 64.0, 0, 0 }, (const double[3]){ 17 / 64.0, 1, 1 },
              1e-9);
    sp_volume_unref(&volume);
}

static void slices_reach_to_the_borders(void **state) {
    (void)state;
    struct sp_volume *volume =
        make(64, SP_UINT8, (const uint32_t[3]){ 16, 16, 16 }, (const uint32_t[3]){ 20, 20, 20 }, 0);
    struct sp_view view = view_of(volume);
    view.slices.mode = SP_SLICES_ORTHOGONAL;
    view.slices.in_3d = true;
    struct sp_visible_part part = compute_part(&view, volume);
    check_box(&part, (const double[3]){ 0 }, (const double[3]){ 1, 1, 1 }, 0);
    sp_volume_unref(&volume);
}

static void a_ball_is_smaller_than_its_box(void **state) {
    (void)state;
    struct sp_volume_info info = { .type = SP_UINT8, .source = "test" };
    uint8_t *voxels = aligned_alloc(64, 64 * 64 * 64);
    assert_non_null(voxels);
    for (int a = 0; a < 3; a++) {
        info.grid.dims[a] = 64;
        info.grid.spacing[a] = info.grid.direction[a][a] = 1;
    }
    for (int i = 0; i < 64 * 64 * 64; i++) {
        double x = i % 64 - 31.5, y = i / 64 % 64 - 31.5, z = i / 4096 - 31.5;
        voxels[i] = sqrt(x * x + y * y + z * z) < 16 ? OBJECT : 0;
    }
    struct sp_volume *volume = sp_volume_adopt(&info, voxels, NULL, 64 * 64 * 64, release, NULL);
    assert_non_null(volume);
    struct sp_view view = view_of(volume);
    struct sp_visible_part part = compute_part(&view, volume);
    assert_compare(part.radius, >, 15.5);
    assert_compare(part.radius, <, 17.5);
    sp_volume_unref(&volume);
}

static void a_few_wild_samples_do_not_count(void **state) {
    (void)state;
    struct sp_volume *volume =
        make(64, SP_UINT8, (const uint32_t[3]){ 16, 16, 16 }, (const uint32_t[3]){ 47, 47, 47 }, 0);
    uint8_t *voxels = (uint8_t *)(uintptr_t)sp_volume_voxels(volume);
    voxels[1] = voxels[64 * 64 * 64 - 1] = OBJECT; /* 2 of 32768 */
    struct sp_view view = view_of(volume);
    struct sp_visible_part part = compute_part(&view, volume);
    check_box(&part, (const double[3]){ 0.25, 0.25, 0.25 }, (const double[3]){ 0.75, 0.75, 0.75 },
              1e-9);
    sp_volume_unref(&volume);
}

/* A view of the surface of a value alone. */
static struct sp_view surface_of(const struct sp_volume *volume, double value) {
    struct sp_view view = view_of(volume);
    view.layers[0] = sp_layer_default(SP_LAYER_SURFACE);
    view.layers[0].value = value;
    return view;
}

static void a_surface_has_the_box_of_what_it_encloses(void **state) {
    (void)state;
    struct sp_volume *volume =
        make(64, SP_UINT8, (const uint32_t[3]){ 16, 32, 8 }, (const uint32_t[3]){ 31, 47, 15 }, 50);
    const double low[3] = { 0.25, 0.5, 0.125 }, high[3] = { 0.5, 0.75, 0.25 };
    struct sp_view view = surface_of(volume, 120);
    view.transfer_function.point_count = 1; /* shows nothing; a surface does not need it */
    struct sp_visible_part part = compute_part(&view, volume);
    check_box(&part, low, high, 1e-9);
    view.clip.box[1][0] = 0.4;
    part = compute_part(&view, volume);
    check_box(&part, low, (const double[3]){ 0.4, 0.75, 0.25 }, 1.0 / 64);
    view.clip.box[1][0] = 1;
    const double none[] = { 0, 201, 1e9 };
    for (int i = 0; i < 3; i++) {
        view.layers[0].value = none[i]; /* all samples lie on one side */
        assert_false(compute_part(&view, volume).is_visible);
    }
    view = surface_of(volume, 120);
    view.layers[0].opacity = 0;
    assert_false(compute_part(&view, volume).is_visible);
    sp_volume_unref(&volume);
}

static void a_surface_around_a_hollow_is_seen(void **state) {
    (void)state;
    struct sp_volume *volume =
        make(64, SP_FLOAT32, (const uint32_t[3]){ 0 }, (const uint32_t[3]){ 62, 63, 63 }, 10);
    float *voxels = (float *)(uintptr_t)sp_volume_voxels(volume);
    for (int i = 0; i < 64 * 64 * 64; i++) {
        const int at[3] = { i % 64, i / 64 % 64, i / 64 / 64 };
        bool is_hollow = true;
        for (int a = 0; a < 3; a++)
            is_hollow = is_hollow && at[a] >= 20 && at[a] < 30;
        voxels[i] = is_hollow ? NAN : OBJECT; /* a hole has no surface */
    }
    struct sp_view view = surface_of(volume, 120);
    assert_false(compute_part(&view, volume).is_visible);
    for (int i = 0; i < 64 * 64 * 64; i++)
        voxels[i] = isfinite(voxels[i]) ? OBJECT : 10;
    struct sp_visible_part part =
        compute_part(&view, volume); /* of the samples around the hollow */
    check_box(&part, (const double[3]){ 19 / 64.0, 19 / 64.0, 19 / 64.0 },
              (const double[3]){ 31 / 64.0, 31 / 64.0, 31 / 64.0 }, 1e-9);
    sp_volume_unref(&volume);
}

static void only_visible_layers_count(void **state) {
    (void)state;
    struct sp_volume *volume =
        make(64, SP_UINT8, (const uint32_t[3]){ 8, 8, 8 }, (const uint32_t[3]){ 47, 47, 47 }, 0);
    uint8_t *voxels = (uint8_t *)(uintptr_t)sp_volume_voxels(volume);
    for (int z = 52; z < 56; z++)
        for (int y = 52; y < 56; y++)
            for (int x = 52; x < 56; x++)
                voxels[x + 64 * (y + 64 * z)] = 90; /* less than the volume shows */
    const double low[3] = { 0.125, 0.125, 0.125 }, inner[3] = { 0.75, 0.75, 0.75 };
    struct sp_view view = view_of(volume);
    view.layers[1] = surface_of(volume, 60).layers[0];
    struct sp_visible_part part = compute_part(&view, volume); /* the volume alone */
    check_box(&part, low, inner, 1e-9);
    view.layer_count = 2;
    part = compute_part(&view, volume); /* a small surface beside a large volume is no tail */
    check_box(&part, low, (const double[3]){ 0.875, 0.875, 0.875 }, 1e-9);
    view.layers[1].visible = false;
    part = compute_part(&view, volume);
    check_box(&part, low, inner, 1e-9);
    view.layers[0].visible = false;
    assert_false(compute_part(&view, volume).is_visible);
    sp_volume_unref(&volume);
}

static void a_shell_has_the_box_of_what_is_opaque_enough(void **state) {
    (void)state;
    struct sp_volume *volume =
        make(64, SP_UINT8, (const uint32_t[3]){ 16, 16, 16 }, (const uint32_t[3]){ 47, 47, 47 }, 0);
    uint8_t *voxels = (uint8_t *)(uintptr_t)sp_volume_voxels(volume);
    voxels[3 + 64 * (3 + 64 * 3)] = 120;   /* opacity 0.1 */
    struct sp_view view = view_of(volume); /* the object's is 0.5 */
    view.layers[0] = sp_layer_default(SP_LAYER_SHELL);
    view.layers[0].low = 0.3;
    struct sp_visible_part part = compute_part(&view, volume);
    check_box(&part, (const double[3]){ 0.25, 0.25, 0.25 }, (const double[3]){ 0.75, 0.75, 0.75 },
              1e-9);
    view.layers[0].low = 0.6;
    assert_false(compute_part(&view, volume).is_visible);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_object_has_its_box_in_the_world),
        cmocka_unit_test(the_clip_cuts_the_box),
        cmocka_unit_test(a_hidden_object_leaves_the_whole_volume),
        cmocka_unit_test(an_object_between_the_samples_is_found),
        cmocka_unit_test(the_gradient_axis_counts),
        cmocka_unit_test(slices_reach_to_the_borders),
        cmocka_unit_test(a_ball_is_smaller_than_its_box),
        cmocka_unit_test(a_few_wild_samples_do_not_count),
        cmocka_unit_test(a_surface_has_the_box_of_what_it_encloses),
        cmocka_unit_test(a_surface_around_a_hollow_is_seen),
        cmocka_unit_test(only_visible_layers_count),
        cmocka_unit_test(a_shell_has_the_box_of_what_is_opaque_enough),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
