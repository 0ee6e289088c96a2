/* SPDX-License-Identifier: Apache-2.0
 *
 * Iso-surfaces with merged points against all points, on rectilinear grids, with every filter and
 * with discs that are not flat; and frames that are cancelled while they are prepared.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "draw/layers/surface/cache.h"
#include "draw/layers/surface/merge.h"
#include "draw/layers/surface/surface.h"
#include "support/compare.h"
#include "support/isosurface.h"
#include "support/render.h"
#include "support/sanitized.h"

enum { STEP = TEST_SANITIZED ? 4 : 1 }; /* every so many scenes */

static double hills(const void *user, double x, double y, double z) {
    static const double places[4][4] = {
        { 15, 17, 18, 9 }, { 29, 24, 14, 8 }, { 19, 31, 29, 8 }, { 32, 12, 31, 7 }
    };
    double sum = 0;
    (void)user;
    for (int i = 0; i < 4; i++) {
        const double *p = places[i];
        double d = (x - p[0]) * (x - p[0]) + (y - p[1]) * (y - p[1]) + (z - p[2]) * (z - p[2]);
        sum += exp(-d / (p[3] * p[3]));
    }
    return fmin(255, 200 * sum);
}

static double centred_hills(const void *user, double x, double y, double z) {
    return hills(user, x + 23, y + 23, z + 23);
}

static double wall(const void *user, double x, double y, double z) {
    (void)user;
    return 100 + 60 * (0.7 - fabs(x * 0.8 + y * 0.6 - 32 + 0.02 * (z - 23) * (z - 23)));
}

static void start(struct test_scene *scene) {
    struct sp_view *view = &scene->view;
    test_view_init(view);
    view->size[0] = view->size[1] = 64;
    view->shading.mode = SP_SHADING_PHONG;
    view->filter.mode = SP_FILTER_ADAPTIVE;
    view->layer_count = 1;
    view->layers[0] = (struct sp_layer){ .type = SP_LAYER_SURFACE,
                                         .visible = true,
                                         .value = 90,
                                         .color = { 0.9f, 0.85f, 0.75f },
                                         .opacity = 1,
                                         .flatness = INFINITY };
}

/* Seen so that a voxel has a pixels. */
static void see(struct test_scene *scene, double pixels) {
    scene->view.camera.projection = SP_ORTHOGRAPHIC;
    scene->view.camera.height = scene->view.size[1] / pixels;
    test_scene_orbit(scene, NULL, 25, 30, 200);
}

static void make(struct test_scene *scene, test_value_fn *value, double depth, double pixels) {
    start(scene);
    assert_true(test_scene_voxels(scene, "scene", (uint32_t[]){ 46, 46, (uint32_t)(46 / depth) },
                                  (double[]){ 1, 1, depth }, SP_FLOAT32, value, NULL));
    see(scene, pixels);
}

static void open_renderer(struct test_renderer *renderer) {
    struct sp_error err = { 0 };
    const struct test_target target = { "cpu", "auto" };
    if (!test_renderer_open(renderer, &target, 2, &err))
        fail_msg("%s", err.text);
}

/* PSNR of the image with level_of_detail auto to that with off. */
static double compare_levels(const struct test_renderer *renderer, struct test_scene *scene) {
    struct test_image all, merged;
    scene->view.level_of_detail = SP_LOD_OFF;
    assert_true(test_render_scene(renderer, scene, &all, NULL));
    scene->view.level_of_detail = SP_LOD_AUTO;
    assert_true(test_render_scene(renderer, scene, &merged, NULL));
    double psnr = test_image_psnr(&merged, &all);
    test_image_finish(&all);
    test_image_finish(&merged);
    return psnr;
}

static void merged_points_look_like_all_points(void **state) {
    (void)state;
    static const struct {
        const char *name;
        test_value_fn *value;
        double depth, pixels, opacity;
    } rows[] = {
        { "hills", hills, 1, 0.49, 1 },      { "translucent hills", hills, 1, 0.49, 0.5 },
        { "long cells", hills, 3, 0.49, 1 }, { "wall", wall, 1, 0.49, 1 },
        { "small hills", hills, 1, 0.3, 1 },
    };
    struct test_renderer renderer;
    open_renderer(&renderer);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i += STEP) {
        struct test_scene scene = { 0 };
        make(&scene, rows[i].value, rows[i].depth, rows[i].pixels);
        scene.view.layers[0].opacity = (float)rows[i].opacity;
        double psnr = compare_levels(&renderer, &scene);
        printf("%-18s %6.2f dB\n", rows[i].name, psnr);
        assert_compare(psnr, >=, 45);
        assert_compare(psnr, <, 200); /* they are merged */
        see(&scene, 0.52);
        assert_true(isinf(compare_levels(&renderer, &scene)));
        test_scene_finish(&scene);
    }
    test_renderer_close(&renderer);
}

static void previews_look_like_the_image(void **state) {
    (void)state;
    struct test_renderer renderer;
    struct test_scene scene = { 0 };
    struct sp_error err;
    double last = INFINITY;
    open_renderer(&renderer);
    make(&scene, hills, 1, 1.3);
    struct sp_volume *volume = test_scene_volume(&scene, &err);
    struct test_image images[3];
    for (unsigned level = 0; level < 3; level++) {
        const struct sp_render_options options = { .format = SP_RGBAF32, .mip_level = level };
        struct sp_frame *frame = sp_renderer_render(renderer.renderer, volume, &scene.view,
                                                    renderer.pool, &options, &err);
        assert_non_null(frame);
        assert_true(test_image_from_frame(&images[level], frame));
        sp_frame_unref(&frame);
        double psnr = test_image_psnr(&images[level], &images[0]);
        printf("preview %u %6.2f dB\n", level, psnr);
        assert_compare(psnr, >=, level == 1 ? 38.5 : 24.7);
        assert_true(level == 0 || psnr < last);
        last = psnr;
    }
    for (int i = 0; i < 3; i++)
        test_image_finish(&images[i]);
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
    test_renderer_close(&renderer);
}

static double compare_rays(const struct test_renderer *renderer, const struct test_scene *scene,
                           double blur) {
    struct test_isosurface iso;
    struct test_image got, wanted;
    assert_true(test_render_scene(renderer, scene, &got, NULL));
    if (TEST_SANITIZED) { /* rays take longest, and are not what is tested */
        test_image_finish(&got);
        return INFINITY;
    }
    assert_true(test_isosurface_init(&iso, scene));
    assert_true(test_isosurface_render(&iso, 3, blur, &wanted));
    double psnr = test_image_psnr(&got, &wanted);
    test_isosurface_finish(&iso);
    test_image_finish(&got);
    test_image_finish(&wanted);
    return psnr;
}

static void rectilinear_grids_match_rays(void **state) {
    (void)state;
    enum { N = 40 };
    double places[3][N];
    const double *coordinates[3] = { places[0], places[1], NULL };
    struct test_renderer renderer;
    struct test_scene scene = { 0 };
    for (int i = 0; i < N; i++) { /* gaps from 0.8 to 1.6, and from 1.5 to 0.75 */
        places[0][i] = 0.8 * i + 0.01 * i * i;
        places[1][i] = 1.5 * i - 0.0095 * i * i;
    }
    open_renderer(&renderer);
    start(&scene);
    assert_true(test_scene_rectilinear(&scene, "gaps", (uint32_t[]){ N, N, N }, coordinates,
                                       SP_FLOAT32, centred_hills, NULL));
    see(&scene, 1.5);
    double psnr = compare_rays(&renderer, &scene, 0.5);
    printf("rectilinear %6.2f dB\n", psnr);
    assert_compare(psnr, >=, 39.9);
    test_scene_finish(&scene);
    test_renderer_close(&renderer);
}

/* Each filter against rays that are blurred as it says. */
static void filters_match_rays(void **state) {
    (void)state;
    static const struct {
        enum sp_filter_mode mode;
        double blur, floor;
    } rows[] = { { SP_FILTER_ADAPTIVE, 0.5, 41.7 },
                 { SP_FILTER_EWA, 1, 37.2 },
                 { SP_FILTER_LOWPASS, 1, 37.2 },
                 { SP_FILTER_RECONSTRUCTION, 0, 32 },
                 { SP_FILTER_NONE, 0, 32 } };
    struct test_renderer renderer;
    open_renderer(&renderer);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i += STEP) {
        struct test_scene scene = { 0 };
        make(&scene, hills, 1, 1.3);
        scene.view.filter.mode = rows[i].mode;
        double psnr = compare_rays(&renderer, &scene, rows[i].blur);
        printf("filter %d %6.2f dB\n", (int)rows[i].mode, psnr);
        assert_compare(psnr, >=, rows[i].floor);
        test_scene_finish(&scene);
    }
    test_renderer_close(&renderer);
}

/* While balls become discs, the image tends to the image of flat kernels. */
static void flatness_tends_to_discs(void **state) {
    (void)state;
    static const double flatness[] = { 1, 2, 4, 16, 64 };
    struct test_renderer renderer;
    struct test_scene scene = { 0 };
    struct test_image flat, image;
    double last = 0;
    open_renderer(&renderer);
    make(&scene, hills, 1, 2);
    assert_true(test_render_scene(&renderer, &scene, &flat, NULL));
    for (size_t i = 0; i < sizeof flatness / sizeof flatness[0]; i += STEP) {
        scene.view.layers[0].flatness = flatness[i];
        assert_true(test_render_scene(&renderer, &scene, &image, NULL));
        double psnr = test_image_psnr(&image, &flat);
        printf("flatness %2.0f %6.2f dB\n", flatness[i], psnr);
        assert_compare(psnr, >, last + 3);
        last = psnr;
        test_image_finish(&image);
    }
    assert_compare(last, >, 55);
    test_image_finish(&flat);
    test_scene_finish(&scene);
    test_renderer_close(&renderer);
}

static void a_cancelled_preparation_fails(void **state) {
    (void)state;
    atomic_bool cancel = false;
    struct sp_error err = { 0 };
    struct sp_surface_cache cache = { 0 };
    struct sp_camera_transform camera;
    struct sp_surface surface;
    struct sp_arena arena;
    struct test_scene scene = { 0 };
    make(&scene, hills, 1, 2);
    struct sp_volume *volume = test_scene_volume(&scene, &err);
    struct sp_pool *pool = sp_pool_create(2, &err);
    assert_non_null(volume);
    assert_non_null(pool);
    sp_arena_init(&arena);
    sp_surface_cache_begin(&cache);
    sp_camera_transform_init(&camera, &scene.view.camera, scene.view.size);
    const struct sp_surface_cache_job job = {
        .volume = volume, .value = 90, .bytes_max = UINT64_MAX, .pool = pool
    };
    const struct sp_surface_input input = { .view = &scene.view,
                                            .layer = &scene.view.layers[0],
                                            .grid = &scene.info.grid,
                                            .points = sp_surface_cache_get(&cache, &job, &err),
                                            .camera = &camera,
                                            .interrupt = { .cancel = &cancel },
                                            .pool = pool,
                                            .arena = &arena };
    assert_non_null(input.points);
    assert_true(sp_surface_prepare(&input, &surface, &err));
    atomic_store(&cancel, true);
    assert_false(sp_surface_prepare(&input, &surface, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    sp_arena_finish(&arena);
    sp_surface_cache_evict(&cache, NULL);
    sp_pool_destroy(&pool);
    sp_volume_unref(&volume);
    test_scene_finish(&scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(merged_points_look_like_all_points),
        cmocka_unit_test(previews_look_like_the_image),
        cmocka_unit_test(rectilinear_grids_match_rays),
        cmocka_unit_test(filters_match_rays),
        cmocka_unit_test(flatness_tends_to_discs),
        cmocka_unit_test(a_cancelled_preparation_fails),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
