/* SPDX-License-Identifier: Apache-2.0
 *
 * Combinations of all choices of a view, and views with extreme numbers. The images are finite, do
 * not depend on the number of threads, and are not empty if the volume is in sight.
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

#include "encode/convert.h"
#include "sp/log.h"
#include "sp/renderer.h"
#include "support/compare.h"
#include "support/one_thread.h"
#include "support/render.h"
#include "support/sanitized.h"

/* Returns a ball in 21×17×25 voxels. If rectilinear, the distance of samples grows outwards. */
static struct sp_volume *make_ball(bool rectilinear) {
    enum { X = 21, Y = 17, Z = 25 };
    static double at[3][Z];
    struct sp_grid grid = { .dims = { X, Y, Z },
                            .spacing = { 1, 1, 1.5 },
                            .origin = { -10, -8, -18 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    for (unsigned a = 0; rectilinear && a < 3; a++) {
        for (uint32_t i = 1; i < grid.dims[a]; i++)
            at[a][i] = at[a][i - 1] + 0.4 + 0.08 * fabs(i - 0.5 * grid.dims[a]);
        grid.spacing[a] = at[a][grid.dims[a] - 1] / (grid.dims[a] - 1);
        grid.coordinates[a] = at[a];
        grid.origin[a] = -0.5 * at[a][grid.dims[a] - 1];
    }
    uint16_t values[X * Y * Z];
    for (int i = 0; i < X * Y * Z; i++) {
        double x = i % X - 10, y = i / X % Y - 8, z = i / X / Y - 12;
        values[i] = (uint16_t)fmax(0, 1000 - 110 * sqrt(x * x + y * y + z * z / 2));
    }
    struct sp_error err;
    struct sp_volume *v = sp_volume_create(&grid, SP_UINT16, values, "ball", &err);
    if (!v)
        fail_msg("%s", err.text);
    return v;
}

static void make_view(struct sp_view *view, const struct sp_volume *volume) {
    sp_view_init(view, sp_volume_info(volume), "v");
    view->size[0] = 40;
    view->size[1] = 24;
    view->transfer_function = (struct sp_transfer_function){
        .reference_length = 1,
        .point_count = 2,
        .points = { { 100, { 1, 0.5f, 0.2f }, 0 }, { 900, { 0.2f, 0.6f, 1 }, 0.3f } },
    };
    view->background[3] = 0; /* so that alpha counts only the volume */
    view->camera.target[0] = view->camera.target[1] = view->camera.target[2] = 0;
    view->camera.position[0] = 20;
    view->camera.position[1] = -45;
    view->camera.position[2] = 12;
    view->camera.height = 30;
}

/* Returns the sum of alpha; NAN if a pixel is not finite. */
static double sum_alpha(const struct sp_frame *f) {
    double sum = 0;
    for (uint32_t y = 0; y < f->height; y++)
        for (uint32_t x = 0; x < f->width; x++) {
            const float *p =
                (const float *)(const void *)((char *)f->pixels + y * f->stride_bytes) + 4 * x;
            bool ok =
                isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]) && p[3] >= 0 && p[3] < 1.0001f;
            sum += ok ? (double)p[3] : (double)NAN;
        }
    return sum;
}

struct rig {
    struct sp_renderer *renderers[2]; /* with one and with three threads */
    struct sp_frame_pool *pool;
};

static struct rig make_rig(void) {
    struct rig rig = { .pool = sp_frame_pool_create(1 << 24, NULL) };
    for (int i = 0; i < 2; i++) {
        struct sp_renderer_options o = { .backend = "cpu", .threads = i ? 3 : 1 };
        rig.renderers[i] = sp_renderer_create(&o, NULL);
        assert_non_null(rig.renderers[i]);
    }
    return rig;
}

static void finish_rig(struct rig *rig) {
    for (int i = 0; i < 2; i++)
        sp_renderer_destroy(&rig->renderers[i]);
    sp_frame_pool_destroy(&rig->pool);
}

/* Both renderers draw the view and must agree. Returns the sum of alpha. */
static double draw(struct rig *rig, struct sp_volume *volume, const struct sp_view *view,
                   unsigned mip_level) {
    struct sp_error err;
    struct sp_render_options o = { .format = SP_RGBAF32, .mip_level = mip_level };
    struct sp_frame *frames[2];
    for (int i = 0; i < 2; i++) {
        frames[i] = sp_renderer_render(rig->renderers[i], volume, view, rig->pool, &o, &err);
        if (!frames[i])
            fail_msg("%s: %s", err.place, err.text);
    }
    assert_true(test_frames_equal(frames[0], frames[1]));
    double sum = sum_alpha(frames[0]);
    assert_true(isfinite(sum));
    sp_frame_unref(&frames[0]);
    sp_frame_unref(&frames[1]);
    return sum;
}

/* Sets the n-th combination of all choices; false past the last one. */
static bool choose(unsigned n, struct sp_view *v, unsigned *mip_level, bool *rectilinear) {
    struct {
        unsigned count, value;
    } axes[] = { { 6, 0 }, { 2, 0 }, { 3, 0 }, { 2, 0 }, { 2, 0 }, { 2, 0 },
                 { 2, 0 }, { 2, 0 }, { 2, 0 }, { 2, 0 }, { 2, 0 } };
    for (size_t i = 0; i < sizeof axes / sizeof *axes; i++) {
        axes[i].value = n % axes[i].count;
        n /= axes[i].count;
    }
    v->filter.mode = (enum sp_filter_mode)axes[0].value;
    v->filter.kernel = (enum sp_kernel)axes[1].value;
    v->compositing.mode = (enum sp_compositing)axes[2].value;
    v->compositing.attenuation = (enum sp_attenuation)axes[3].value;
    v->transfer_function.order = (enum sp_tf_order)axes[4].value;
    v->shading.mode = (enum sp_shading_mode)axes[5].value;
    v->camera.projection = (enum sp_projection)axes[6].value;
    v->clip.box[0][0] = axes[7].value ? 0.3 : 0;
    v->clip.plane_count = axes[7].value;
    v->clip.planes[0] = (struct sp_clip_plane){ { 0.5, 1, 0.7 }, -2 };
    v->transfer_function.gradient_count = axes[8].value ? 2 : 0;
    v->transfer_function.gradient[0] = (struct sp_gradient_point){ 10, 0.1f };
    v->transfer_function.gradient[1] = (struct sp_gradient_point){ 90, 1 };
    *mip_level = axes[9].value;
    *rectilinear = axes[10].value;
    return n == 0;
}

static void every_choice_draws(void **state) {
    (void)state;
    struct rig rig = make_rig();
    struct sp_volume *volumes[2] = { make_ball(false), make_ball(true) };
    unsigned drawn = 0, mip_level;
    bool rectilinear;
    struct sp_view view;
    make_view(&view, volumes[0]);
    const unsigned step = TEST_SANITIZED ? 145 : 29;
    /* The step shares no factor with the numbers of choices. So all pairs and triples occur. */
    for (unsigned n = 0; choose(n, &view, &mip_level, &rectilinear); n += step) {
        if (!sp_view_validate(&view, NULL))
            continue; /* single splats are not classified after interpolation */
        double sum = draw(&rig, volumes[rectilinear], &view, mip_level);
        if (!(sum > 10))
            fail_msg("combination %u: alpha adds up to %g", n, sum);
        drawn++;
    }
    print_message("  %u combinations\n", drawn);
    assert_compare(drawn, >, (TEST_SANITIZED ? 40 : 200));
    for (int i = 0; i < 2; i++)
        sp_volume_unref(&volumes[i]);
    finish_rig(&rig);
}

static double uniform(double low, double high) {
    return low + (high - low) * (rand() / (double)RAND_MAX);
}

static double one_of(const double *values, int count) {
    return values[rand() % count];
}

/* Sets numbers at the ends of their ranges and in the middle. */
static void extreme(struct sp_view *v) {
    v->filter.sigma = one_of((double[]){ 0.3, 0.7, 2 }, 3);
    v->filter.cutoff = one_of((double[]){ 1, 3, 6 }, 3);
    v->filter.lowpass = one_of((double[]){ 0, 1, 8 }, 3);
    v->filter.c_min = one_of((double[]){ 1e-6, 0.3, 1 }, 3);
    v->compositing.slab = one_of((double[]){ 0.05, 1, 1, 64 }, 4);
    v->camera.fov_y = one_of((double[]){ 1, 30, 170 }, 3);
    v->camera.height = one_of((double[]){ 1e-3, 30, 1e9 }, 3);
    v->camera.near = one_of((double[]){ 1e-9, 0.1, 60 }, 3);
    v->transfer_function.reference_length = one_of((double[]){ 1e-30, 1, 1e30 }, 3);
    v->shading.exponent = one_of((double[]){ 1, 20, 1024 }, 3);
    double far = one_of((double[]){ 0.01, 1, 1, 1e3, 1e12 }, 5);
    for (int i = 0; i < 3; i++)
        v->camera.position[i] = uniform(-30, 30) * far;
    v->clip.plane_count = (uint32_t)(rand() % 3) * 4;
    for (uint32_t k = 0; k < v->clip.plane_count; k++) {
        double size = one_of((double[]){ 1e-200, 1, 1e200 }, 3);
        for (int i = 0; i < 3; i++)
            v->clip.planes[k].normal[i] = uniform(-1, 1) * size;
        v->clip.planes[k].offset = uniform(-10, 10) * one_of((double[]){ 0, size, 1e300 }, 3);
    }
}

static void extreme_views_stay_finite(void **state) {
    (void)state;
    struct rig rig = make_rig();
    struct sp_volume *volumes[2] = { make_ball(false), make_ball(true) };
    unsigned mip_level, drawn = 0;
    bool rectilinear;
    srand(17);
    for (int n = 0; n < (TEST_SANITIZED ? 40 : 160); n++) {
        struct sp_view view;
        make_view(&view, volumes[0]);
        choose((unsigned)rand() % 9216, &view, &mip_level, &rectilinear);
        extreme(&view);
        if (!sp_view_validate(&view, NULL))
            continue;
        draw(&rig, volumes[rectilinear], &view, mip_level);
        drawn++;
    }
    print_message("  %u views\n", drawn);
    for (int i = 0; i < 2; i++)
        sp_volume_unref(&volumes[i]);
    finish_rig(&rig);
}

/* Draws both pixel formats, with an opaque and a transparent background, and checks is_opaque. */
static void check_opaque(struct test_renderer *r, struct sp_volume *volume, struct sp_view *view,
                         unsigned mip_level) {
    struct sp_error err;
    for (int opaque = 0; opaque < 2; opaque++)
        for (int format = SP_RGBA8; format <= SP_RGBAF32; format++) {
            struct sp_render_options o = { .format = (enum sp_pixel_format)format,
                                           .mip_level = mip_level };
            view->background[3] = opaque ? 1 : 0.9f;
            struct sp_frame *frame =
                sp_renderer_render(r->renderer, volume, view, r->pool, &o, &err);
            if (!frame)
                fail_msg("%s: %s", err.place, err.text);
            assert_int_equal(frame->is_opaque, opaque);
            frame->is_opaque = false; /* so that sp_frame_is_opaque() checks every pixel */
            assert_true(!opaque || sp_frame_is_opaque(frame));
            sp_frame_unref(&frame);
        }
}

static void an_opaque_background_makes_every_pixel_opaque(void **state) {
    (void)state;
    struct sp_volume *volumes[2] = { make_ball(false), make_ball(true) };
    struct test_target target = { "null", "auto" };
    srand(18);
    for (unsigned t = 0; t == 0 || test_target_at(t - 1, &target); t++) {
        struct test_renderer r;
        struct sp_error err;
        unsigned mip_level, drawn = 0;
        /* The driver of a GPU compiles shaders for every combination. */
        const unsigned step = strcmp(target.backend, "cpu") != 0 ? 1021 : TEST_SANITIZED ? 145 : 29;
        bool rectilinear;
        struct sp_view view;
        if (!test_renderer_open(&r, &target, 1, &err)) {
            print_message("  skipped: %s\n", err.text);
            continue;
        }
        make_view(&view, volumes[0]);
        for (unsigned n = 0; choose(n, &view, &mip_level, &rectilinear); n += step) {
            if (drawn % 2)
                extreme(&view);
            if (sp_view_validate(&view, NULL) && sp_renderer_supports(r.renderer, &view, NULL)) {
                check_opaque(&r, volumes[rectilinear], &view, mip_level);
                drawn++;
            }
            make_view(&view, volumes[0]);
        }
        print_message("  %s %s: %u views\n", target.backend, target.isa, drawn);
        assert_compare(drawn, >=, 5);
        test_renderer_close(&r);
    }
    for (int i = 0; i < 2; i++)
        sp_volume_unref(&volumes[i]);
}

/* A transparent point may lie as far below the first visible value as the user wants. */
static void a_transparent_point_far_below_changes_nothing(void **state) {
    (void)state;
    enum { N = 20 };
    struct sp_grid grid = { .dims = { N, N, N },
                            .spacing = { 1, 1, 1 },
                            .origin = { -10, -10, -10 },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    static float values[N * N * N];
    for (int i = 0; i < N * N * N; i++)
        values[i] = (float)(i % N) / (N - 1);
    struct sp_volume *volume = sp_volume_create(&grid, SP_FLOAT32, values, "ramp", NULL);
    struct rig rig = make_rig();
    struct sp_render_options o = { .format = SP_RGBAF32 };
    for (int post = 0; post < 2; post++) {
        struct sp_view view;
        struct test_image images[2];
        make_view(&view, volume);
        view.compositing.mode = SP_COMPOSITE_SLAB;
        view.transfer_function = (struct sp_transfer_function){
            .reference_length = 1,
            .order = post ? SP_TF_POST : SP_TF_PRE,
            .point_count = 3,
            .points = { { 0, { 1, 1, 1 }, 0 },
                        { 0.4, { 1, 0, 0 }, 0 },
                        { 0.6, { 0, 1, 0 }, 0.3f } },
        };
        static const double far[] = { 0, -1e6, -1e9, -1e30, -1e300 };
        for (int i = 0; i < 5; i++) {
            view.transfer_function.points[0].value = far[i];
            struct sp_frame *f =
                sp_renderer_render(rig.renderers[0], volume, &view, rig.pool, &o, NULL);
            assert_true(f);
            assert_true(test_image_from_frame(&images[i > 0], f));
            sp_frame_unref(&f);
            if (i == 0)
                continue;
            assert_compare(test_image_difference(&images[0], &images[1]).largest, <, 2e-3);
            test_image_finish(&images[1]);
        }
        test_image_finish(&images[0]);
    }
    sp_volume_unref(&volume);
    finish_rig(&rig);
}

int main(void) {
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    if (TEST_SANITIZED)
        printf("reduced under a sanitizer: one combination of five, one extreme view of four\n");
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_choice_draws),
        one_thread_test(extreme_views_stay_finite),
        one_thread_test(an_opaque_background_makes_every_pixel_opaque),
        one_thread_test(a_transparent_point_far_below_changes_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
