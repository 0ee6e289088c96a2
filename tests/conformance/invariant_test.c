/* SPDX-License-Identifier: Apache-2.0
 *
 * What must not change the image, or must change it in a known way, whatever the integral says:
 * threads, units, mirrors, the order of axes, the format of the frame. Each runs on every backend
 * and instruction set.
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

#include "sp/log.h"
#include "support/compare.h"
#include "support/data.h"
#include "support/render.h"

struct context {
    struct test_target target;
    struct test_renderer renderer; /* two threads */
};

/* Ends the test, visibly, at the first view that the backend refuses. */
static void skip_unsupported(struct context *c, const struct test_scene *scene) {
    struct sp_error err;
    if (sp_renderer_supports(c->renderer.renderer, &scene->view, &err) ||
        err.code != SP_ERR_UNSUPPORTED)
        return;
    print_message("  skipped from here on: %s: %s\n", err.place, err.text);
    skip();
}

static struct test_image render(struct context *c, const struct test_scene *scene) {
    struct test_image image;
    struct sp_error err;
    skip_unsupported(c, scene);
    if (!test_render_scene(&c->renderer, scene, &image, &err))
        fail_msg("%s: %s: %s", scene->info.name, err.place, err.text);
    return image;
}

/* Fails, and shows the two, when they are farther apart than `floor` dB; frees both. */
static void same(const char *name, struct test_image *got, struct test_image *wanted,
                 double floor) {
    double psnr = test_image_psnr(got, wanted), mean, variance;
    test_image_statistics(wanted, 3, &mean, &variance);
    print_message("  %s: %.1f dB\n", name, psnr);
    if (!(psnr >= floor)) {
        struct test_difference d = test_image_difference(got, wanted);
        test_image_dump(name, got, wanted, 20);
        fail_msg("%s: %.1f dB, wanted %.1f; worst at (%u,%u) channel %u: %g for %g", name, psnr,
                 floor, d.x, d.y, d.channel, d.a, d.b);
    }
    assert_true(mean > 0.01); /* two empty images agree, too */
    test_image_finish(got);
    test_image_finish(wanted);
}

/* Sheets without footprints against images with them. Measured: 65.0 dB, and depths that add up
 * within 0.31 % of the largest. */
#define OTHER_FLOOR 64.5
#define OTHER_DEPTH 4e-3

enum { MODES = 3 };
static const enum sp_compositing modes[MODES] = { SP_COMPOSITE_SHEET, SP_COMPOSITE_SLAB,
                                                  SP_COMPOSITE_SPLAT };

/* Views that take different ways through the renderer. */
enum { WAYS = 9, POST_WAY = 8 };

static void choose_way(struct sp_view *view, int way) {
    static const enum sp_filter_mode filters[WAYS] = { SP_FILTER_EWA,     SP_FILTER_ADAPTIVE,
                                                       SP_FILTER_EWA,     SP_FILTER_ADAPTIVE,
                                                       SP_FILTER_SWAN,    SP_FILTER_NONE,
                                                       SP_FILTER_LOWPASS, SP_FILTER_EWA };
    static const enum sp_compositing compositors[WAYS] = { SP_COMPOSITE_SHEET, SP_COMPOSITE_SHEET,
                                                           SP_COMPOSITE_SLAB,  SP_COMPOSITE_SLAB,
                                                           SP_COMPOSITE_SPLAT, SP_COMPOSITE_SLAB,
                                                           SP_COMPOSITE_SPLAT, SP_COMPOSITE_SLAB,
                                                           SP_COMPOSITE_SLAB };
    view->filter.mode = filters[way];
    view->transfer_function.order = way == POST_WAY ? SP_TF_POST : SP_TF_PRE;
    view->filter.kernel = way == 6 || way == 7 ? SP_KERNEL_CUBIC : SP_KERNEL_GAUSSIAN;
    view->compositing.mode = compositors[way];
    view->compositing.slab = way == 3 ? 0.3 : 1.2;
    view->compositing.attenuation = way & 1 ? SP_ATTENUATION_LINEAR : SP_ATTENUATION_EXPONENTIAL;
}

/* The CPU's threads make the same bytes. A GPU adds in any order, so that the last bits differ;
 * rounding then says from which splat on a tile is saturated, which is one part in 512. */
static bool is_same_frame(const struct test_target *target, const struct sp_frame *a,
                          const struct sp_frame *b) {
    struct test_image x, y;
    if (strcmp(target->backend, "cpu") == 0)
        return test_frames_equal(a, b);
    assert_true(test_image_from_frame(&x, a));
    assert_true(test_image_from_frame(&y, b));
    double psnr = test_image_psnr(&x, &y), step = test_image_difference(&x, &y).largest;
    test_image_finish(&x);
    test_image_finish(&y);
    return psnr >= 70 && step < 1.01 / 255;
}

static void same_with_threads(struct context *c, const struct test_scene *scene,
                              enum sp_pixel_format format) {
    static const unsigned threads[] = { 2, 7, 16 };
    struct sp_render_options o = { .format = format };
    struct sp_error err = { 0 };
    struct test_renderer alone, many;
    struct sp_volume *volume = test_scene_volume(scene, &err);
    assert_non_null(volume);
    skip_unsupported(c, scene);
    assert_true(test_renderer_open(&alone, &c->target, 1, &err));
    struct sp_frame *one =
        sp_renderer_render(alone.renderer, volume, &scene->view, alone.pool, &o, &err);
    if (!one)
        fail_msg("%s: %s: %s", scene->info.name, err.place, err.text);
    /* Other backends do not draw with threads, and take long to start. */
    size_t tries = strcmp(c->target.backend, "cpu") == 0 ? sizeof threads / sizeof *threads : 1;
    for (size_t t = 0; t < tries; t++) {
        assert_true(test_renderer_open(&many, &c->target, threads[t], &err));
        for (int again = 0; again < (t ? 1 : 2); again++) {
            struct sp_frame *frame =
                sp_renderer_render(many.renderer, volume, &scene->view, many.pool, &o, &err);
            assert_non_null(frame);
            if (!is_same_frame(&c->target, one, frame))
                fail_msg("%s: %u threads differ from one, frame %d", scene->info.name, threads[t],
                         again);
            sp_frame_unref(&frame);
        }
        test_renderer_close(&many);
    }
    sp_frame_unref(&one);
    test_renderer_close(&alone);
    sp_volume_unref(&volume);
}

static void threads_do_not_matter(void **state) {
    struct context *c = *state;
    static test_scene_fn *const builds[] = {
        test_scene_thin_shells,  test_scene_anisotropic,
        test_scene_checkerboard, test_scene_oblique,
        test_scene_inside,       test_scene_lit_shell,
        test_scene_clip_corner,  test_scene_rectilinear_blobs,
    };
    for (size_t b = 0; b < sizeof builds / sizeof *builds; b++)
        for (int way = (int)b % 2; way < WAYS; way += 2) {
            if (strcmp(c->target.backend, "cpu") != 0 && (size_t)way / 2 % 4 != b / 2)
                continue; /* each way once */
            struct test_scene scene;
            assert_true(builds[b](&scene));
            /* Sides that no tile divides, and enough of it that workers meet. */
            scene.view.size[0] = 149;
            scene.view.size[1] = 101;
            choose_way(&scene.view, way);
            same_with_threads(c, &scene, way & 2 ? SP_RGBA8 : SP_RGBAF32);
            test_scene_finish(&scene);
        }
}

/* Even in x about the middle. */
static double even(const void *user, double x, double y, double z) {
    (void)user;
    double a = fabs(x - 15.5) - 8, b = y - 12, c = z - 18;
    return exp(-(a * a + b * b) / 30) + exp(-(a * a + c * c) / 12) * (y > 20);
}

static void a_symmetric_volume_gives_a_symmetric_picture(void **state) {
    struct context *c = *state;
    for (int ortho = 0; ortho < 2; ortho++) {
        struct test_scene s;
        test_view_init(&s.view);
        test_scene_points(&s, (const double[][5]){ { 0.2, 0, 0, 1, 0 }, { 1, 1, 0.6, 0, 0.3 } }, 2);
        assert_true(test_scene_voxels(&s, ortho ? "symmetric-orthographic" : "symmetric",
                                      (uint32_t[]){ 32, 32, 32 }, (double[]){ 1, 1, 1 }, SP_FLOAT32,
                                      even, NULL));
        test_scene_orbit(&s, NULL, 0, 25, 70); /* the eye in the plane of symmetry */
        s.view.camera.projection = ortho ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
        struct test_image a = render(c, &s), b = render(c, &s);
        test_image_mirror(&b);
        same(s.info.name, &a, &b, 80);
        test_scene_finish(&s);
    }
}

static void a_mirrored_direction_gives_the_mirrored_picture(void **state) {
    struct context *c = *state;
    static test_scene_fn *const builds[] = { test_scene_rotated, test_scene_sheared,
                                             test_scene_clip_corner };
    for (size_t i = 0; i < sizeof builds / sizeof *builds * MODES; i++) {
        struct test_scene s;
        assert_true(builds[i / MODES](&s));
        s.view.compositing.mode = modes[i % MODES];
        struct test_image a = render(c, &s);
        for (int axis = 0; axis < 3; axis++)
            s.info.grid.direction[0][axis] *= -1;
        s.info.grid.origin[0] *= -1;
        s.view.camera.position[0] *= -1;
        s.view.camera.target[0] *= -1;
        s.view.camera.up[0] *= -1;
        for (uint32_t k = 0; k < s.view.clip.plane_count; k++)
            s.view.clip.planes[k].normal[0] *= -1;
        struct test_image b = render(c, &s);
        test_image_mirror(&b);
        char name[160];
        snprintf(name, sizeof name, "%s-mirrored", s.info.name);
        same(name, &b, &a, 80);
        test_scene_finish(&s);
    }
}

static void the_unit_of_length_does_not_matter(void **state) {
    struct context *c = *state;
    static const double scales[] = { 2, 0.001, 1000 };
    static test_scene_fn *const builds[] = { test_scene_anisotropic, test_scene_orthographic,
                                             test_scene_oblique, test_scene_lit_shell,
                                             test_scene_clip_box };
    for (size_t i = 0; i < sizeof builds / sizeof *builds * MODES; i++)
        for (int k = 0; k < 3; k++) {
            struct test_scene s;
            assert_true(builds[i / MODES](&s));
            s.view.compositing.mode = modes[i % MODES];
            struct test_image a = render(c, &s);
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
            struct test_image b = render(c, &s);
            char name[160];
            snprintf(name, sizeof name, "%s-unit-%g", s.info.name, scales[k]);
            same(name, &b, &a, 80);
            test_scene_finish(&s);
        }
}

/* Scanners put the origin where they like. */
static void the_place_in_the_world_does_not_matter(void **state) {
    struct context *c = *state;
    static const double far[3] = { 100000, -250000, 70000 };
    static test_scene_fn *const builds[] = { test_scene_rotated, test_scene_orthographic,
                                             test_scene_inside, test_scene_clip_plane,
                                             test_scene_rectilinear_blobs };
    for (size_t i = 0; i < sizeof builds / sizeof *builds * MODES; i++) {
        struct test_scene s;
        assert_true(builds[i / MODES](&s));
        s.view.compositing.mode = modes[i % MODES];
        struct test_image a = render(c, &s);
        for (uint32_t k = 0; k < s.view.clip.plane_count; k++)
            for (int axis = 0; axis < 3; axis++)
                s.view.clip.planes[k].offset += s.view.clip.planes[k].normal[axis] * far[axis];
        for (int axis = 0; axis < 3; axis++) {
            s.info.grid.origin[axis] += far[axis];
            s.view.camera.position[axis] += far[axis];
            s.view.camera.target[axis] += far[axis];
        }
        struct test_image b = render(c, &s);
        char name[160];
        snprintf(name, sizeof name, "%s-far", s.info.name);
        same(name, &b, &a, 80);
        test_scene_finish(&s);
    }
}

/* The same samples in another order in memory, the direction's columns moved along. */
static void the_order_of_axes_does_not_matter(void **state) {
    struct context *c = *state;
    static const int orders[][3] = { { 1, 2, 0 }, { 2, 0, 1 }, { 1, 0, 2 } };
    /* Single splats at the same distance come in the order of the list, hence sheets and slabs. */
    for (size_t n = 0; n < sizeof orders / sizeof *orders * 2; n++) {
        struct test_scene s;
        size_t k = n / 2;
        assert_true(test_scene_rotated(&s));
        s.view.compositing.mode = n % 2 ? SP_COMPOSITE_SLAB : SP_COMPOSITE_SHEET;
        struct test_image a = render(c, &s);
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
        struct test_image b = render(c, &s);
        char name[64];
        snprintf(name, sizeof name, "axes-%d%d%d", orders[k][0], orders[k][1], orders[k][2]);
        same(name, &b, &a, 80);
        test_scene_finish(&s);
    }
}

/* Without low-pass the two filters are one formula. */
static void reconstruction_is_ewa_without_low_pass(void **state) {
    struct context *c = *state;
    struct test_scene s;
    assert_true(test_scene_thin_shells(&s));
    s.view.filter.mode = SP_FILTER_RECONSTRUCTION;
    struct test_image a = render(c, &s);
    s.view.filter.mode = SP_FILTER_EWA;
    s.view.filter.lowpass = 0;
    struct test_image b = render(c, &s);
    same("reconstruction", &a, &b, 100);
    test_scene_finish(&s);
}

/* Energy is conserved: the summed optical depth of a thin medium does not depend on the filter. */
static void filters_keep_the_energy(void **state) {
    struct context *c = *state;
    struct test_scene s;
    double reference = 0;
    assert_true(test_scene_blobs(&s));
    for (uint32_t i = 0; i < s.view.transfer_function.point_count; i++)
        s.view.transfer_function.points[i].opacity *= 0.01F;
    test_scene_orbit(&s, NULL, -30, 20, 90); /* nothing reaches the border */
    static const enum sp_filter_mode filters[] = { SP_FILTER_EWA,     SP_FILTER_RECONSTRUCTION,
                                                   SP_FILTER_LOWPASS, SP_FILTER_ADAPTIVE,
                                                   SP_FILTER_SWAN,    SP_FILTER_NONE };
    for (int k = 0; k < 12; k++) {
        s.view.filter.mode = filters[k % 6];
        s.view.filter.kernel = k < 6 ? SP_KERNEL_GAUSSIAN : SP_KERNEL_CUBIC;
        struct test_image a = render(c, &s);
        double sum = 0;
        for (size_t p = 0; p < (size_t)a.width * a.height; p++)
            sum -= log1p(-a.rgba[p * 4 + 3]);
        if (!k)
            reference = sum;
        print_message("  filter %d, kernel %d: summed depth %.4f\n", k % 6, k / 6, sum);
        assert_true(reference > 1);
        assert_true(fabs(sum / reference - 1) < 0.005);
        test_image_finish(&a);
    }
    test_scene_finish(&s);
}

/* Attenuation that is exponential multiplies up to the same whatever is added first: compositors
 * differ in colour alone. */
static void compositors_agree_on_the_opacity(void **state) {
    struct context *c = *state;
    static test_scene_fn *const builds[] = { test_scene_blobs, test_scene_layers, test_scene_cubic,
                                             test_scene_rectilinear_blobs, test_scene_clip_corner };
    for (size_t b = 0; b < sizeof builds / sizeof *builds * MODES; b++) {
        struct test_scene s;
        assert_true(builds[b / MODES](&s));
        for (uint32_t i = 0; i < s.view.transfer_function.point_count; i++)
            memset(s.view.transfer_function.points[i].color, 0, 3 * sizeof(float));
        struct test_image a = render(c, &s);
        bool is_other = test_uses_postconv(&c->target, &s);
        s.view.compositing.mode = modes[b % MODES];
        s.view.compositing.slab = 0.7;
        struct test_image d = render(c, &s);
        char name[160];
        snprintf(name, sizeof name, "%s-opacity-%zu", s.info.name, b % MODES);
        same(name, &d, &a, is_other && b % MODES ? OTHER_FLOOR : 80);
        test_scene_finish(&s);
    }
}

/* What a plane keeps and what it takes away are the whole: their optical depths add up. */
static void a_plane_and_its_opposite_make_the_whole(void **state) {
    struct context *c = *state;
    for (int way = 0; way < POST_WAY; way++) { /* classified after the cut, they need not */
        struct test_scene s;
        struct test_image parts[3];
        assert_true(test_scene_blobs(&s));
        choose_way(&s.view, way);
        s.view.compositing.attenuation = SP_ATTENUATION_EXPONENTIAL;
        parts[2] = render(c, &s);
        double slack = test_uses_postconv(&c->target, &s) ? OTHER_DEPTH : 2e-4;
        test_scene_cut(&s, (double[]){ 0.3, -0.2, 0.7 }, (double[]){ 1, 0, 2 });
        struct sp_clip_plane *plane = s.view.clip.planes;
        for (int k = 0; k < 2; k++) {
            parts[k] = render(c, &s);
            for (int a = 0; a < 3; a++)
                plane->normal[a] *= -1;
            plane->offset *= -1;
        }
        double worst = 0, most = 0;
        for (size_t p = 0; p < (size_t)parts[0].width * parts[0].height; p++) {
            double depth[3];
            for (int k = 0; k < 3; k++)
                depth[k] = -log1p(-parts[k].rgba[p * 4 + 3]);
            worst = fmax(worst, fabs(depth[0] + depth[1] - depth[2]));
            most = fmax(most, depth[2]);
        }
        print_message("  way %d: depths up to %.2f add up within %.1g\n", way, most, worst);
        assert_compare(most, >, 0.5);
        assert_compare(worst, <, slack * most);
        for (int k = 0; k < 3; k++)
            test_image_finish(&parts[k]);
        test_scene_finish(&s);
    }
}

/* Coordinates that are even after all. */
static void even_coordinates_are_an_even_grid(void **state) {
    struct context *c = *state;
    double places[3][40];
    for (int way = 0; way < WAYS; way++) {
        struct test_scene s;
        assert_true(test_scene_rotated(&s));
        s.view.shading.mode = SP_SHADING_PHONG;
        choose_way(&s.view, way);
        bool is_other = test_uses_postconv(&c->target, &s);
        struct test_image a = render(c, &s);
        for (int axis = 0; axis < 3; axis++) {
            for (int i = 0; i < 40; i++)
                places[axis][i] = i * s.info.grid.spacing[axis];
            s.info.grid.coordinates[axis] = places[axis];
        }
        struct test_image b = render(c, &s);
        char name[64];
        snprintf(name, sizeof name, "even-coordinates-%d", way);
        same(name, &b, &a, is_other ? OTHER_FLOOR : 80);
        test_scene_finish(&s);
    }
}

/* Where the value is the same everywhere it does not matter when it is classified. */
static void the_order_does_not_matter_to_a_constant(void **state) {
    struct context *c = *state;
    struct test_scene s;
    assert_true(test_scene_constant_cube(&s));
    s.view.compositing.mode = SP_COMPOSITE_SLAB;
    struct test_image a = render(c, &s);
    s.view.transfer_function.order = SP_TF_POST;
    struct test_image b = render(c, &s);
    same("order", &b, &a, 80);
    test_scene_finish(&s);
}

/* A gradient axis of ones, and one that is reached nowhere. */
static void a_flat_gradient_axis_is_none(void **state) {
    struct context *c = *state;
    for (int k = 0; k < 4; k++) {
        struct test_scene s;
        assert_true(k & 1 ? test_scene_post_peak(&s) : test_scene_lit_shell(&s));
        struct test_image a = render(c, &s);
        struct sp_transfer_function *tf = &s.view.transfer_function;
        tf->gradient_count = 2;
        tf->gradient[0] = (struct sp_gradient_point){ k & 2 ? 1e6 : 0, 1 };
        tf->gradient[1] = (struct sp_gradient_point){ k & 2 ? 2e6 : 7, k & 2 ? 0 : 1 };
        struct test_image b = render(c, &s);
        same(k & 1 ? "gradient-axis-post" : "gradient-axis", &b, &a, 100);
        test_scene_finish(&s);
    }
}

static void eight_bits_are_the_rounded_floats(void **state) {
    struct context *c = *state;
    static const float backgrounds[][4] = {
        { 0, 0, 0, 1 }, { 0.3F, 0.6F, 0.9F, 1 }, { 0, 0, 0, 0 }, { 1, 0.5F, 0, 0.5F }
    };
    for (int k = 0; k < 4; k++) {
        struct test_scene s;
        struct test_image floats, bytes;
        struct sp_error err;
        assert_true(test_scene_thin_shells(&s));
        memcpy(s.view.background, backgrounds[k], sizeof s.view.background);
        floats = render(c, &s);
        struct sp_volume *volume = test_scene_volume(&s, &err);
        assert_non_null(volume);
        struct sp_frame *frame =
            sp_renderer_render(c->renderer.renderer, volume, &s.view, c->renderer.pool, NULL, &err);
        assert_non_null(frame);
        assert_int_equal(frame->format, SP_RGBA8);
        assert_true(test_image_from_frame(&bytes, frame));
        /* Half a step for the alpha; a colour is rounded after and before it is associated. */
        struct test_difference d = test_image_difference(&floats, &bytes);
        print_message("  background %d: largest difference %.3f steps\n", k, d.largest * 255);
        assert_true(d.largest < 1.05 / 255);
        if (backgrounds[k][3] >= 1)
            for (size_t p = 0; p < (size_t)bytes.width * bytes.height; p++)
                assert_true(bytes.rgba[p * 4 + 3] == 1);
        sp_frame_unref(&frame);
        sp_volume_unref(&volume);
        test_image_finish(&floats);
        test_image_finish(&bytes);
        test_scene_finish(&s);
    }
}

/* Nothing in front of the eye, all of it nearer than near, or nothing visible: the background. */
static void nothing_to_see_is_the_background(void **state) {
    struct context *c = *state;
    for (int k = 0; k < 4; k++) {
        struct test_scene s;
        assert_true(test_scene_blobs(&s));
        static const float background[4] = { 0.25F, 0.5F, 0.75F, 0.5F };
        memcpy(s.view.background, background, sizeof background);
        struct sp_camera *camera = &s.view.camera;
        for (int a = 0; a < 3; a++)
            if (k == 0)
                camera->target[a] = 2 * camera->position[a];
        if (k == 1)
            camera->near = 1000;
        if (k == 2)
            s.view.transfer_function.points[0].value = 1e6,
            s.view.transfer_function.point_count = 1;
        if (k == 3)
            camera->target[0] = camera->position[0] + 30, camera->target[2] = camera->position[2];
        struct test_image a = render(c, &s);
        for (size_t p = 0; p < (size_t)a.width * a.height; p++) {
            for (int ch = 0; ch < 3; ch++)
                assert_true(fabs(a.rgba[p * 4 + (size_t)ch] - 0.5 * (double)background[ch]) < 1e-6);
            assert_true(fabs(a.rgba[p * 4 + 3] - 0.5) < 1e-6);
        }
        test_image_finish(&a);
        test_scene_finish(&s);
    }
}

/* Samples that are not numbers are transparent: a hole, never a NaN in the image. */
static void not_a_number_is_transparent(void **state) {
    struct context *c = *state;
    struct test_scene s;
    assert_true(test_scene_blobs(&s));
    float *v = s.voxels;
    for (size_t i = 0; i < (size_t)40 * 40 * 40; i++)
        if (i % 3 == 0)
            v[i] = i % 2 ? NAN : i % 5 ? INFINITY : -INFINITY;
    struct test_image a = render(c, &s);
    for (size_t i = 0; i < (size_t)40 * 40 * 40; i++)
        if (i % 3 == 0)
            v[i] = 0; /* outside the transfer function: transparent */
    struct test_image b = render(c, &s);
    same("not-a-number", &a, &b, 80);
    test_scene_finish(&s);
}

#define ON(test)                                                                                   \
    { #test, test, NULL, NULL, c }

static int run_target(struct context *c) {
    const struct CMUnitTest tests[] = {
        ON(threads_do_not_matter),
        ON(a_symmetric_volume_gives_a_symmetric_picture),
        ON(a_mirrored_direction_gives_the_mirrored_picture),
        ON(the_unit_of_length_does_not_matter),
        ON(the_place_in_the_world_does_not_matter),
        ON(the_order_of_axes_does_not_matter),
        ON(reconstruction_is_ewa_without_low_pass),
        ON(filters_keep_the_energy),
        ON(compositors_agree_on_the_opacity),
        ON(a_plane_and_its_opposite_make_the_whole),
        ON(even_coordinates_are_an_even_grid),
        ON(the_order_does_not_matter_to_a_constant),
        ON(a_flat_gradient_axis_is_none),
        ON(eight_bits_are_the_rounded_floats),
        ON(nothing_to_see_is_the_background),
        ON(not_a_number_is_transparent),
    };
    /* Software GL is slow: what comparing it to the reference (ewa_test.c) does not show. */
    const struct CMUnitTest few[] = {
        ON(threads_do_not_matter),
        ON(a_symmetric_volume_gives_a_symmetric_picture),
        ON(a_flat_gradient_axis_is_none),
        ON(eight_bits_are_the_rounded_floats),
        ON(nothing_to_see_is_the_background),
        ON(not_a_number_is_transparent),
    };
    print_message("%s/%s\n", c->target.backend, c->target.isa);
    if (strcmp(c->target.backend, "gl-software") == 0)
        return cmocka_run_group_tests(few, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}

int main(void) {
    struct context c = { 0 };
    int failed = 0;
    unsigned ran = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR); /* refusals are printed here as skips */
    for (unsigned i = 0; test_target_at(i, &c.target); i++) {
        struct sp_error err;
        if (!test_renderer_open(&c.renderer, &c.target, 2, &err)) {
            printf("skipped: %s/%s: %s\n", c.target.backend, c.target.isa, err.text);
            continue;
        }
        ran++;
        failed += run_target(&c);
        test_renderer_close(&c.renderer);
    }
    return failed ? 1 : ran ? 0 : TEST_SKIPPED;
}
