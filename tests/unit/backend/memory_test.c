/* SPDX-License-Identifier: Apache-2.0
 *
 * Every allocation between a volume and an encoded image fails once. The call then fails with
 * SP_ERR_MEMORY and leaks nothing (the ASan build checks this), and the next call works. The linker
 * (--wrap) replaces the allocation functions of the C library by the functions below.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/encode.h"
#include "sp/renderer.h"
#include "support/compare.h"
#include "support/fake_memory.h"

/* Calls `attempt` with 0, 1, 2 … allocations left until it succeeds. Returns the number of
 * failures.
 */
static int fail_each(bool (*attempt)(void *user, struct sp_error *err), void *user) {
    for (int n = 0; n < 1000; n++) {
        struct sp_error err = { .code = SP_OK };
        memory_fail_after(n, MEMORY_STAYS_OUT);
        bool ok = attempt(user, &err);
        memory_restore();
        if (ok)
            return n;
        assert_int_equal(err.code, SP_ERR_MEMORY);
        assert_true(err.text[0]);
    }
    fail_msg("never succeeds");
    return 0;
}

static bool load_demo(void *user, struct sp_error *err) {
    struct sp_volume *volume = sp_volume_load(user, NULL, err);
    bool ok = volume != NULL;
    sp_volume_unref(&volume);
    return ok;
}

static void a_volume_survives_failed_allocations(void **state) {
    (void)state;
    char source[64];
    const struct sp_demo *demo;
    for (size_t i = 0; (demo = sp_demo_at(i)); i++) {
        snprintf(source, sizeof source, "demo:%s?size=16", demo->name);
        assert_compare(fail_each(load_demo, source), >=,
                       2); /* at least the volume and its voxels */
    }
}

struct scene {
    struct sp_volume *volume;
    struct sp_view view;
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
    struct sp_encoder *encoder;
    struct sp_render_options options;
};

static void init_scene(struct scene *scene, const char *source) {
    *scene = (struct scene){ .volume = sp_volume_load(source, NULL, NULL) };
    assert_non_null(scene->volume);
    sp_view_init(&scene->view, sp_volume_info(scene->volume), "test");
    scene->view.size[0] = scene->view.size[1] = 48;
}

static void finish_scene(struct scene *scene) {
    sp_encoder_destroy(&scene->encoder);
    sp_renderer_destroy(&scene->renderer);
    sp_frame_pool_destroy(&scene->pool);
    sp_volume_unref(&scene->volume);
}

/* From creating the renderer to a JPEG; each attempt starts from the beginning. */
static bool draw_cold(void *user, struct sp_error *err) {
    struct scene *s = user;
    const struct sp_renderer_options options = { .backend = "cpu", .threads = 1 };
    struct sp_frame *frame = NULL;
    const uint8_t *bytes;
    size_t size;
    s->renderer = sp_renderer_create(&options, err);
    s->pool = s->renderer ? sp_frame_pool_create(1 << 20, err) : NULL;
    s->encoder = s->pool ? sp_encoder_create(err) : NULL;
    if (s->encoder)
        frame = sp_renderer_render(s->renderer, s->volume, &s->view, s->pool, &s->options, err);
    bool ok = frame && sp_encode(s->encoder, frame, SP_IMAGE_JPEG, 80, &bytes, &size, err);
    sp_frame_unref(&frame);
    sp_encoder_destroy(&s->encoder);
    sp_renderer_destroy(&s->renderer);
    sp_frame_pool_destroy(&s->pool);
    return ok;
}

static void a_first_frame_survives_failed_allocations(void **state) {
    (void)state;
    for (unsigned mip_level = 0; mip_level <= SP_MIP_LEVEL_MAX; mip_level++) {
        struct scene scene;
        init_scene(&scene, "demo:phantom?size=24");
        scene.options.mip_level = mip_level;
        scene.view.camera.up[0] = 0.1;
        assert_compare(fail_each(draw_cold, &scene), >=, 10);
        finish_scene(&scene);
    }
}

/* The same renderer for all attempts: after a failure it must be ready for the next call. */
static bool draw_warm(void *user, struct sp_error *err) {
    struct scene *s = user;
    struct sp_frame *frame =
        sp_renderer_render(s->renderer, s->volume, &s->view, s->pool, &s->options, err);
    bool ok = frame != NULL;
    sp_frame_unref(&frame);
    return ok;
}

static void a_renderer_survives_failed_allocations(void **state) {
    (void)state;
    const struct sp_renderer_options options = { .backend = "cpu", .threads = 2 };
    struct scene scene;
    init_scene(&scene, "demo:vessels?size=32");
    scene.renderer = sp_renderer_create(&options, NULL);
    scene.pool = sp_frame_pool_create(1 << 20, NULL);
    assert_compare(fail_each(draw_warm, &scene), >=, 3);
    /* Each frame has another axis, transfer function, mip level and size. */
    double *p = scene.view.camera.position, *t = scene.view.camera.target;
    for (int axis = 0; axis < 3; axis++) {
        for (int i = 0; i < 3; i++)
            p[i] = t[i] + (i == axis ? 100 : 5);
        scene.view.camera.up[axis] = 0;
        scene.view.camera.up[(axis + 1) % 3] = 1;
        scene.view.camera.up[(axis + 2) % 3] = 0;
        scene.view.transfer_function.points[0].value += 1;
        scene.view.size[0] += 300;
        scene.options.mip_level = (unsigned)axis;
        assert_compare(fail_each(draw_warm, &scene), >=, 1);
    }
    assert_true(draw_warm(&scene, NULL));              /* merges the blocks of the last frame */
    assert_int_equal(fail_each(draw_warm, &scene), 0); /* the steady state allocates nothing */
    finish_scene(&scene);
}

/* Each type of layer alone, then all of them in one image. */
static void layers_survive_failed_allocations(void **state) {
    (void)state;
    const struct sp_renderer_options options = { .backend = "cpu", .threads = 2 };
    struct scene scene;
    init_scene(&scene, "demo:tornado?size=16");
    scene.renderer = sp_renderer_create(&options, NULL);
    scene.pool = sp_frame_pool_create(1 << 20, NULL);
    const double *range = sp_volume_info(scene.volume)->range;
    for (int type = SP_LAYER_SURFACE; type <= SP_LAYER_VECTORS + 1; type++) {
        bool is_all = type > SP_LAYER_VECTORS;
        scene.view.layer_count = is_all ? SP_LAYER_VECTORS + 1 : 1;
        for (uint32_t i = 0; i < scene.view.layer_count; i++) {
            scene.view.layers[i] = sp_layer_default((enum sp_layer_type)(is_all ? (int)i : type));
            scene.view.layers[i].value = 0.5 * (range[0] + range[1]);
        }
        scene.view.size[0] += 40;
        assert_compare(fail_each(draw_warm, &scene), >=, 1);
    }
    finish_scene(&scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_volume_survives_failed_allocations),
        cmocka_unit_test(a_first_frame_survives_failed_allocations),
        cmocka_unit_test(a_renderer_survives_failed_allocations),
        cmocka_unit_test(layers_survive_failed_allocations),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
