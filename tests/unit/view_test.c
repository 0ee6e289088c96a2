/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/view.h"
#include "splat/camera.h"
#include "support/compare.h"

static void make_info(struct sp_volume_info *info) {
    *info = (struct sp_volume_info){
        .grid = { .dims = { 40, 30, 20 },
                  .spacing = { 1, 2, 0.5 },
                  .origin = { 10, -5, 3 },
                  .direction = { { 0, -1, 0 }, { 1, 0, 0 }, { 0, 0, 1 } } },
        .type = SP_UINT16,
        .range = { 100, 1100 },
    };
    for (int b = 0; b < 256; b++) /* air, tissue, bone */
        info->histogram[b] = b < 20 ? 10000 : b > 90 && b < 110 ? 500 : b > 180 && b < 190 ? 50 : 1;
}

/* Checks that all eight corners lie inside the image and fill more than half of its width or
 * height. `ends` are the first and last distance of cells along each axis. */
static void check_framing(const struct sp_view *view, const struct sp_grid *grid,
                          const double ends[3][2]) {
    struct sp_camera_transform camera;
    sp_camera_transform_init(&camera, &view->camera, view->size);
    double low[2] = { 1e9, 1e9 }, high[2] = { -1e9, -1e9 };
    for (int corner = 0; corner < 8; corner++) {
        struct sp_vec3 t = sp_vec3_from(grid->origin);
        for (int a = 0; a < 3; a++)
            for (int r = 0; r < 3; r++)
                t.v[r] += grid->direction[r][a] * ends[a][corner >> a & 1];
        struct sp_vec3 u = sp_mat3_apply(&camera.w, sp_vec3_sub(t, camera.eye));
        assert_compare(u.v[2], >, view->camera.near);
        for (int k = 0; k < 2; k++) {
            double x = camera.centre[k] + camera.scale * u.v[k] / u.v[2];
            low[k] = fmin(low[k], x);
            high[k] = fmax(high[k], x);
        }
    }
    for (int k = 0; k < 2; k++) {
        assert_compare(low[k], >, 0);
        assert_compare(high[k], <, 512);
    }
    assert_true(high[0] - low[0] > 256 || high[1] - low[1] > 256);
}

static void the_default_frames_the_volume(void **state) {
    (void)state;
    struct sp_volume_info info;
    struct sp_view view;
    make_info(&info);
    sp_view_init(&view, &info, "some-id");
    struct sp_error err;
    if (!sp_view_validate(&view, &err))
        fail_msg("%s: %s", err.place, err.text);
    assert_string_equal(view.volume, "some-id");
    assert_compare(view.transfer_function.reference_length, ==, 0.5);
    assert_int_equal(view.filter.mode, SP_FILTER_ADAPTIVE);
    assert_int_equal(view.shading.mode, SP_SHADING_PHONG);
    assert_true(isnan(view.filter.c_max));
    assert_true(isnan(view.shading.smoothing));
    check_framing(&view, &info.grid,
                  (const double[3][2]){ { -0.5, 39.5 }, { -1, 59 }, { -0.25, 9.75 } });
}

static void the_default_frames_a_rectilinear_volume(void **state) {
    (void)state;
    struct sp_volume_info info;
    struct sp_view view;
    make_info(&info);
    double x[40] = { 0 }, z[20] = { 0 }; /* the last gaps are as long as the sum of all others */
    for (int i = 1; i < 40; i++)
        x[i] = i < 39 ? i : 76;
    for (int i = 1; i < 20; i++)
        z[i] = i == 1 ? 36 : 36 + 2.0 * (i - 1);
    info.grid.coordinates[0] = x;
    info.grid.coordinates[2] = z;
    info.grid.spacing[0] = 76 / 39.0;
    info.grid.spacing[2] = 72 / 19.0;
    sp_view_init(&view, &info, "x");
    assert_true(sp_view_validate(&view, NULL));
    assert_compare(view.transfer_function.reference_length, ==, 76 / 39.0); /* the smallest mean */
    const double ends[3][2] = { { -0.5, 95 }, { -1, 59 }, { -18, 73 } };
    check_framing(&view, &info.grid, ends);
    for (int r = 0; r < 3; r++) { /* the middle of the bounding box, not of the samples */
        double middle = info.grid.origin[r];
        for (int a = 0; a < 3; a++)
            middle += info.grid.direction[r][a] * 0.5 * (ends[a][0] + ends[a][1]);
        assert_float_equal(view.camera.target[r], middle, 1e-9);
    }
}

static void the_default_hides_the_background(void **state) {
    (void)state;
    struct sp_volume_info info;
    struct sp_view view;
    make_info(&info);
    sp_view_init(&view, &info, "x");
    const struct sp_transfer_function *tf = &view.transfer_function;
    double air = 100 + 1000 * 20 / 256.0, tissue = 100 + 1000 * 110 / 256.0;
    assert_compare(tf->points[0].opacity, ==, 0);
    assert_compare(tf->points[0].value, >=, air);
    assert_compare(tf->points[0].value, <, tissue);
    assert_compare(tf->points[tf->point_count - 1].opacity, >, 0.5f);
    /* A volume of a single value, or with a range that is not finite, still has a valid default
     * view. */
    info.range[1] = info.range[0];
    sp_view_init(&view, &info, "x");
    assert_true(sp_view_validate(&view, NULL));
    assert_int_equal(view.transfer_function.point_count, 1);
    info.range[0] = -1.7e308;
    info.range[1] = 1.7e308;
    sp_view_init(&view, &info, "x");
    assert_true(sp_view_validate(&view, NULL));
    memset(info.histogram, 0, sizeof info.histogram);
    info.range[0] = 0;
    sp_view_init(&view, &info, "x");
    assert_true(sp_view_validate(&view, NULL));
}

static void check_refused(const struct sp_view *view, const char *pointer) {
    struct sp_error err = { 0 };
    if (sp_view_validate(view, &err))
        fail_msg("%s is accepted", pointer);
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_string_equal(err.place, pointer);
    assert_compare(strlen(err.text), >, 0);
    assert_false(sp_view_validate(view, NULL));
}

/* Sets one field of a valid view and expects an error with this JSON pointer. */
#define REFUSED(field, x, pointer)                                                                 \
    do {                                                                                           \
        struct sp_view bad = view;                                                                 \
        bad.field = x;                                                                             \
        check_refused(&bad, pointer);                                                              \
    } while (0)

static struct sp_view make_view(void) {
    struct sp_volume_info info;
    struct sp_view view;
    make_info(&info);
    sp_view_init(&view, &info, "x");
    view.transfer_function.gradient_count = 2;
    view.transfer_function.gradient[0] = (struct sp_gradient_point){ 0, 0 };
    view.transfer_function.gradient[1] = (struct sp_gradient_point){ 5, 1 };
    view.clip.plane_count = 1;
    view.clip.planes[0] = (struct sp_clip_plane){ { 0, 0, 1 }, 0 };
    view.filter.c_max = 3;
    assert_true(sp_view_validate(&view, NULL));
    return view;
}

static void ranges_are_checked(void **state) {
    (void)state;
    const struct sp_view view = make_view();
    REFUSED(size[0], 0, "/size/0");
    REFUSED(size[1], 8193, "/size/1");
    REFUSED(background[3], 1.5f, "/background/3");
    REFUSED(background[0], NAN, "/background/0");
    REFUSED(camera.fov_y, 0.5, "/camera/fov_y");
    REFUSED(camera.fov_y, NAN, "/camera/fov_y");
    REFUSED(camera.height, 0, "/camera/height");
    REFUSED(camera.near, -1, "/camera/near");
    REFUSED(camera.near, INFINITY, "/camera/near");
    REFUSED(camera.position[1], INFINITY, "/camera/position/1");
    REFUSED(camera.target[2], NAN, "/camera/target/2");
    REFUSED(camera.up[0], NAN, "/camera/up/0");
    REFUSED(transfer_function.reference_length, 0, "/transfer_function/reference_length");
    REFUSED(transfer_function.point_count, 0, "/transfer_function/points");
    REFUSED(transfer_function.point_count, 257, "/transfer_function/points");
    REFUSED(transfer_function.points[2].color[1], -0.1f, "/transfer_function/points/2/color/1");
    REFUSED(transfer_function.points[1].opacity, 1, "/transfer_function/points/1/opacity");
    REFUSED(transfer_function.points[1].opacity, NAN, "/transfer_function/points/1/opacity");
    REFUSED(transfer_function.points[0].value, NAN, "/transfer_function/points/0/value");
    REFUSED(transfer_function.points[3].value, view.transfer_function.points[2].value,
            "/transfer_function/points/3/value");
    REFUSED(transfer_function.gradient[1].magnitude, 0, "/transfer_function/gradient/1/magnitude");
    REFUSED(transfer_function.gradient[0].magnitude, -1, "/transfer_function/gradient/0/magnitude");
    REFUSED(transfer_function.gradient[0].scale, 2, "/transfer_function/gradient/0/scale");
    REFUSED(filter.sigma, 0.2, "/filter/sigma");
    REFUSED(filter.cutoff, 6.5, "/filter/cutoff");
    REFUSED(filter.lowpass, -0.1, "/filter/lowpass");
    REFUSED(filter.c_min, 0, "/filter/c_min");
    REFUSED(filter.c_min, 3.5, "/filter/c_min");
    REFUSED(filter.c_max, INFINITY, "/filter/c_max");
    REFUSED(filter.mode, (enum sp_filter_mode)17, "/filter/mode");
    REFUSED(compositing.slab, 0, "/compositing/slab");
    REFUSED(compositing.mode, (enum sp_compositing)7, "/compositing/mode");
    REFUSED(compositing.colors, (enum sp_projection_colors)2, "/compositing/colors");
    REFUSED(compositing.center, INFINITY, "/compositing/window/center");
    REFUSED(compositing.width, 0, "/compositing/window/width");
    REFUSED(compositing.zero, -INFINITY, "/compositing/zero");
    REFUSED(compositing.absorption, 0, "/compositing/absorption");
    REFUSED(shading.exponent, 0.5, "/shading/exponent");
    REFUSED(shading.smoothing, 1.5, "/shading/smoothing");
    REFUSED(shading.occlusion, 1.1, "/shading/occlusion");
    REFUSED(shading.shadow, -0.1, "/shading/shadow");
    REFUSED(shading.reach, 0, "/shading/reach");
    REFUSED(shading.reach, 10.1, "/shading/reach");
    REFUSED(shading.ambient, 5, "/shading/ambient");
    REFUSED(shading.light_count, 9, "/shading/lights");
    REFUSED(shading.lights[0].color[2], 4.5f, "/shading/lights/0/color/2");
    REFUSED(clip.box[0][1], -0.5, "/clip/box/0/1");
    REFUSED(clip.box[0][2], 1.5, "/clip/box/0/2");
    REFUSED(clip.planes[0].offset, NAN, "/clip/planes/0/offset");
    REFUSED(clip.planes[0].normal[2], 0, "/clip/planes/0/normal");
    REFUSED(clip.plane_count, 9, "/clip/planes");
    REFUSED(slices.mode, (enum sp_slice_mode)3, "/slices/mode");
    REFUSED(slices.colors, (enum sp_slice_colors)7, "/slices/colors");
    REFUSED(slices.position[2], NAN, "/slices/position/2");
    REFUSED(slices.normal[2], 0, "/slices/normal");
    REFUSED(slices.center, INFINITY, "/slices/window/center");
    REFUSED(slices.width, 0, "/slices/window/width");
    REFUSED(layer_count, 0, "/layers");
    REFUSED(layer_count, SP_LAYERS_MAX + 1, "/layers");
    REFUSED(layers[0].type, (enum sp_layer_type)9, "/layers/0/type");
    REFUSED(transfer_function.order, (enum sp_tf_order)3, "/transfer_function/order");
    struct sp_view full = view;
    full.clip.plane_count = SP_CLIP_PLANES_MAX;
    for (int i = 0; i < SP_CLIP_PLANES_MAX; i++)
        full.clip.planes[i] = view.clip.planes[0];
    full.slices.mode = SP_SLICES_OBLIQUE;
    assert_true(sp_view_validate(&full, NULL));
    full.slices.in_3d = true;
    check_refused(&full, "/slices/in_3d");
    struct sp_view crossed = view;
    crossed.clip.box[0][0] = 0.8;
    crossed.clip.box[1][0] = 0.2;
    check_refused(&crossed, "/clip/box/0/0");
    struct sp_view dark = view;
    memset(dark.shading.lights[0].direction, 0, sizeof dark.shading.lights[0].direction);
    check_refused(&dark, "/shading/lights/0/direction");
    struct sp_view endless = view;
    memset(endless.volume, 'x', sizeof endless.volume);
    check_refused(&endless, "/volume");
}

static void single_splats_are_not_classified_after_interpolation(void **state) {
    (void)state;
    for (unsigned mode = SP_COMPOSITE_SPLAT; mode <= SP_COMPOSITE_SLAB; mode++) {
        struct sp_view view = make_view();
        view.compositing.mode = (enum sp_compositing)mode;
        assert_true(sp_view_validate(&view, NULL));
        view.transfer_function.order = SP_TF_POST;
        if (mode == SP_COMPOSITE_SPLAT)
            check_refused(&view, "/transfer_function/order");
        else
            assert_true(sp_view_validate(&view, NULL));
    }
}

static void sums_have_no_colours_of_the_transfer_function(void **state) {
    (void)state;
    struct sp_view view = make_view();
    view.compositing.colors = SP_COLORS_TRANSFER_FUNCTION;
    view.compositing.mode = SP_COMPOSITE_MEAN;
    assert_true(sp_view_validate(&view, NULL));
    view.compositing.mode = SP_COMPOSITE_SUM;
    check_refused(&view, "/compositing/colors");
}

static void projections_show_no_slices(void **state) {
    (void)state;
    struct sp_view view = make_view(), other;
    view.slices.mode = SP_SLICES_ORTHOGONAL;
    view.slices.in_3d = true;
    view.compositing.mode = SP_COMPOSITE_MAXIMUM;
    memcpy(&other, &view, sizeof other);
    other.slices.position[0] += 1;
    assert_false(sp_view_draws_slices(&view));
    assert_true(sp_view_is_same_image(&view, &other));
}

static void windows_of_projections_suit_the_volume(void **state) {
    (void)state;
    struct sp_view view = make_view();
    /* Half of the samples are 0, half are 100. */
    struct sp_volume_info info = { .range = { 0, 100 },
                                   .histogram = { [0] = 500, [255] = 500 },
                                   .projected = { { 0.1, 0.9 }, { 0.25, 0.75 }, 12 } };
    double window[2];
    view.compositing.zero = view.compositing.absorption = NAN;
    view.compositing.center = view.compositing.width = NAN;
    view.compositing.mode = SP_COMPOSITE_MEAN;
    sp_projection_window(&view, &info, window);
    assert_float_equal(window[0], 50, 1e-9);
    assert_float_equal(window[1], 50, 1e-9);
    view.compositing.mode = SP_COMPOSITE_SUM;
    sp_projection_window(&view, &info, window);
    assert_float_equal(window[0], 600, 1e-9);
    assert_float_equal(window[1], 1200, 1e-9);
    view.compositing.zero = 50; /* half of the bright samples is left */
    sp_projection_window(&view, &info, window);
    assert_float_equal(window[1], 1200 * (49.8046875 / 99.8046875), 1e-9);
    view.compositing.zero = NAN;
    view.compositing.absorption = 0.1;
    sp_projection_window(&view, &info, window);
    assert_float_equal(window[0], 0.5, 1e-12);
    assert_float_equal(window[1], 1, 1e-12);
    view.compositing.mode = SP_COMPOSITE_MAXIMUM;
    view.compositing.width = 7;
    sp_projection_window(&view, &info, window);
    assert_float_equal(window[0], 50, 1e-9);
    assert_float_equal(window[1], 7, 1e-12);
    info.range[1] = 0; /* a single value */
    view.compositing.width = NAN;
    sp_projection_window(&view, &info, window);
    assert_true(window[1] > 0);
}

static void smoothing_is_automatic_or_between_0_and_1(void **state) {
    (void)state;
    const double good[] = { NAN, 0, 0.5, 1 };
    struct sp_view view = make_view();
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        struct sp_error err = { 0 };
        view.shading.smoothing = good[i];
        if (!sp_view_validate(&view, &err))
            fail_msg("%g: %s: %s", good[i], err.place, err.text);
    }
    REFUSED(shading.smoothing, -0.01, "/shading/smoothing");
    REFUSED(shading.smoothing, INFINITY, "/shading/smoothing");
}

static void degenerate_cameras_are_refused(void **state) {
    (void)state;
    struct sp_view view = make_view();
    memcpy(view.camera.target, view.camera.position, sizeof view.camera.target);
    check_refused(&view, "/camera/position");
    view.camera.target[0] += 1e-300;
    check_refused(&view, "/camera/position");
    view = make_view();
    memset(view.camera.up, 0, sizeof view.camera.up);
    check_refused(&view, "/camera/up");
    for (int i = 0; i < 3; i++)
        view.camera.up[i] = -3 * (view.camera.target[i] - view.camera.position[i]);
    check_refused(&view, "/camera/up");
    /* The largest positions and very small directions are valid. */
    view = make_view();
    for (int i = 0; i < 3; i++) {
        view.camera.position[i] = i == 0 ? -SP_POSITION_MAX : 0;
        view.camera.target[i] = i == 0 ? SP_POSITION_MAX : 0;
        view.camera.up[i] = i == 1 ? 1e-300 : 0;
    }
    assert_true(sp_view_validate(&view, NULL));
    view.camera.position[0] *= 1.0001;
    check_refused(&view, "/camera/position/0");
    view = make_view();
    view.slices.position[2] = 1e300;
    check_refused(&view, "/slices/position/2");
}

static void slices_beside_the_image_do_not_change_it(void **state) {
    (void)state;
    const struct sp_view view = make_view();
    struct sp_view moved = view;
    moved.slices.mode = SP_SLICES_ORTHOGONAL;
    moved.slices.position[0] += 3;
    assert_true(sp_view_is_same_image(&view, &moved));
    moved.slices.in_3d = true;
    assert_false(sp_view_is_same_image(&view, &moved));
    struct sp_view again = moved;
    assert_true(sp_view_is_same_image(&again, &moved));
    again.slices.width *= 2;
    assert_false(sp_view_is_same_image(&again, &moved));
    again = moved;
    again.slices.planes[0] = false;
    assert_false(sp_view_is_same_image(&again, &moved));
    again.slices.planes[1] = again.slices.planes[2] = false;
    assert_true(sp_view_is_same_image(&again, &view));
    moved = view;
    moved.camera.fov_y = 12;
    assert_false(sp_view_is_same_image(&view, &moved));
}

static void what_needs_a_grid_does_not_fit_elements(void **state) {
    (void)state;
    struct sp_volume_info info;
    struct sp_view view;
    struct sp_error err;
    make_info(&info);
    info.elements = (struct sp_elements_shape){ .kind = SP_KIND_POINTS, .count = 3 };
    sp_view_init(&view, &info, "id");
    assert_true(sp_view_fits(&view, &info, &err));
    view.layer_count = 2;
    for (enum sp_layer_type type = SP_LAYER_VOLUME; type <= SP_LAYER_SHELL; type++) {
        view.layers[1] = (struct sp_layer){ .type = type, .visible = true };
        assert_false(sp_view_fits(&view, &info, &err));
        assert_string_equal(err.place, "/layers/1/type");
        view.layers[1].visible = false;
        assert_true(sp_view_fits(&view, &info, &err));
    }
    view.layers[1] = sp_layer_default(SP_LAYER_VECTORS);
    assert_false(sp_view_fits(&view, &info, &err));
    assert_string_equal(err.place, "/layers/1/type");
    view.layers[1] = sp_layer_default(SP_LAYER_POINTS);
    strcpy(view.layers[1].color_by, SP_COLOR_BY_LENGTH);
    assert_false(sp_view_fits(&view, &info, &err));
    assert_string_equal(err.place, "/layers/1/color_by");
    info.vector_bytes = 36;
    assert_true(sp_view_fits(&view, &info, &err));
    view.layers[1].type = SP_LAYER_VECTORS;
    assert_true(sp_view_fits(&view, &info, &err));
    view.layers[1].visible = false;
    view.edit_count = 1;
    assert_false(sp_view_fits(&view, &info, &err));
    assert_string_equal(err.place, "/edits");
    view.edit_count = 0;
    view.slices.in_3d = true;
    assert_false(sp_view_fits(&view, &info, &err));
    assert_string_equal(err.place, "/slices/in_3d");
    info.elements = (struct sp_elements_shape){ .kind = SP_KIND_GRID };
    view.edit_count = view.layer_count = 1;
    view.layers[0] = (struct sp_layer){ .type = SP_LAYER_SURFACE, .visible = true };
    assert_true(sp_view_fits(&view, &info, &err));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_default_frames_the_volume),
        cmocka_unit_test(the_default_frames_a_rectilinear_volume),
        cmocka_unit_test(the_default_hides_the_background),
        cmocka_unit_test(ranges_are_checked),
        cmocka_unit_test(slices_beside_the_image_do_not_change_it),
        cmocka_unit_test(what_needs_a_grid_does_not_fit_elements),
        cmocka_unit_test(single_splats_are_not_classified_after_interpolation),
        cmocka_unit_test(sums_have_no_colours_of_the_transfer_function),
        cmocka_unit_test(projections_show_no_slices),
        cmocka_unit_test(windows_of_projections_suit_the_volume),
        cmocka_unit_test(smoothing_is_automatic_or_between_0_and_1),
        cmocka_unit_test(degenerate_cameras_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
