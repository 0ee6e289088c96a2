/* SPDX-License-Identifier: Apache-2.0
 *
 * Gaussians whose splats are set up first, in the order of memory, against Gaussians that are set
 * up in the order of depth: the same image to the bit, for any number of threads, also where bands
 * and opaque tiles leave splats out.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "backend/cpu/kernels.h"
#include "draw/layers/cloud/cloud.h"
#include "draw/layers/cloud/order.h"
#include "support/compare.h"

enum {
    BATCH = 1 << 17, /* splats that are drawn before opaque tiles are looked for */
    COUNT = BATCH + 20000,
    LARGE = 12,      /* of them cover the image */
    WIDTH = 49 * 32, /* more than 2304 tiles: two bands */
    HEIGHT = 49 * 32
};

struct rig {
    struct sp_volume *volume;
    struct sp_view view;
    struct sp_camera_transform camera;
    struct cpu_kernels kernels;
    struct sp_cloud_cache trees;
    struct sp_arena arena;
    struct sp_frame_pool *frames;
};

static float random_in(unsigned *seed, float low, float high) {
    *seed = *seed * 1664525u + 1013904223u;
    return low + (high - low) * (float)(*seed >> 8) / 16777216.0f;
}

/* Gaussians of different depths, in no order. Some are not in the image. */
static struct sp_volume *make_volume(void) {
    enum { NUMBERS = 12, STEP = 7919 /* a prime that does not divide the count */ };
    unsigned seed = 3;
    struct sp_elements e = { .shape = { .kind = SP_KIND_GAUSSIANS, .count = COUNT, .degree = 1 },
                             .positions = calloc(COUNT, 3 * sizeof(float)),
                             .factors = calloc(COUNT, 6 * sizeof(float)),
                             .opacities = calloc(COUNT, sizeof(float)),
                             .harmonics = calloc(COUNT, NUMBERS * sizeof(float)) };
    assert_true(e.positions && e.factors && e.opacities && e.harmonics);
    for (uint32_t i = 0; i < COUNT; i++) {
        const uint32_t rank = (uint32_t)((uint64_t)i * STEP % COUNT);
        const bool is_large = rank > 40000 && rank <= 40000 + LARGE;
        for (int a = 0; a < 2; a++)
            e.positions[i][a] = random_in(&seed, -0.7f, 0.7f);
        e.positions[i][2] = (float)rank * (4.0f / COUNT);
        for (int k = 0; k < 6; k++)
            e.factors[i][k] =
                is_large ? k == 0 || k == 2 ? 20 : 0 : random_in(&seed, -2e-3f, 2e-3f);
        e.opacities[i] = is_large ? 1 : random_in(&seed, 0, 1);
        for (int k = 0; k < NUMBERS; k++)
            e.harmonics[NUMBERS * i + (uint32_t)k] = random_in(&seed, -1, 1);
    }
    struct sp_volume *volume = sp_volume_create_elements(&e, "gaussians", NULL);
    free(e.positions);
    free(e.factors);
    free(e.opacities);
    free(e.harmonics);
    assert_non_null(volume);
    return volume;
}

static void open_rig(struct rig *rig) {
    *rig = (struct rig){ .volume = make_volume() };
    sp_view_init(&rig->view, sp_volume_info(rig->volume), "");
    rig->view.size[0] = WIDTH;
    rig->view.size[1] = HEIGHT;
    rig->view.camera = (struct sp_camera){ .projection = SP_PERSPECTIVE,
                                           .position = { 0, 0, -1 },
                                           .up = { 0, -1, 0 },
                                           .fov_y = 60,
                                           .near = 0.1 };
    rig->view.camera.target[2] = 2;
    sp_camera_transform_init(&rig->camera, &rig->view.camera, rig->view.size);
    rig->view.clip.plane_count = 1;
    rig->view.clip.planes[0] = (struct sp_clip_plane){ { 1, 0, 0 }, -0.4 };
    rig->frames = sp_frame_pool_create(0, NULL);
    assert_non_null(rig->frames);
    sp_arena_init(&rig->arena);
}

static void close_rig(struct rig *rig) {
    sp_arena_finish(&rig->arena);
    sp_frame_pool_destroy(&rig->frames);
    sp_volume_unref(&rig->volume);
}

static struct sp_frame *draw(struct rig *rig, unsigned threads, bool set_up_first) {
    struct sp_cloud cloud;
    struct sp_voxel_source source;
    struct sp_pool *pool = sp_pool_create(threads, NULL);
    struct sp_frame *frame = sp_frame_create(rig->frames, WIDTH, HEIGHT, SP_RGBAF32, NULL);
    assert_non_null(frame);
    const struct sp_cloud_input input = { .view = &rig->view,
                                          .layer = &rig->view.layers[0],
                                          .volume = rig->volume,
                                          .clipped = &sp_volume_info(rig->volume)->grid,
                                          .camera = &rig->camera,
                                          .set_up = rig->kernels.cloud_set_up,
                                          .trees = &rig->trees,
                                          .pool = pool,
                                          .arena = &rig->arena };
    sp_arena_reset(&rig->arena);
    assert_true(sp_cloud_prepare(&input, &cloud, &source, NULL));
    assert_non_null(cloud.splats);
    if (!set_up_first) {
        assert_true(sp_cloud_sort(&cloud, NULL, &source.frame, NULL, pool, &rig->arena,
                                  &input.interrupt, &source.order));
        assert_null(cloud.splats);
    }
    const struct sp_voxel_input drawing = { .view = &rig->view,
                                            .layer = &rig->view.layers[0],
                                            .source = &source,
                                            .frame = frame,
                                            .camera = &rig->camera,
                                            .kernels = &rig->kernels.voxels,
                                            .pool = pool,
                                            .arena = &rig->arena };
    assert_true(sp_voxel_draw(&drawing, NULL));
    sp_pool_destroy(&pool);
    return frame;
}

static void splats_are_the_same_in_any_order(void **state) {
    struct rig rig;
    (void)state;
    open_rig(&rig);
    for (unsigned i = 0; cpu_isa_at(i); i++) {
        if (!cpu_kernels_init(&rig.kernels, cpu_isa_at(i), NULL))
            continue;
        struct sp_frame *wanted = draw(&rig, 1, false);
        assert_compare(wanted->stats.splats, >, BATCH / 4);
        assert_compare(wanted->stats.splats, <,
                       BATCH + 2000); /* opaque tiles hide the last batch */
        for (unsigned threads = 1; threads <= 3; threads += 2) {
            struct sp_frame *got = draw(&rig, threads, true);
            assert_int_equal(got->stats.splats, wanted->stats.splats);
            assert_memory_equal(got->pixels, wanted->pixels,
                                (size_t)wanted->height * wanted->stride_bytes);
            sp_frame_unref(&got);
        }
        sp_frame_unref(&wanted);
    }
    close_rig(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(splats_are_the_same_in_any_order) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
