/* SPDX-License-Identifier: Apache-2.0
 *
 * The cached data of one volume is never drawn for another one, even if a new volume has the
 * address of an old one.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>

#include "sp/renderer.h"
#include "support/compare.h"
#include "support/gl.h"
#include "support/image.h"

enum { SIDE = 24, SIZE = 64, SKIPPED = 77 };

struct rig {
    struct sp_renderer *gl, *scalar;
    struct sp_frame_pool *pool;
};

static struct sp_volume *make_volume(enum sp_type type, const void *voxels) {
    const struct sp_grid grid = { .dims = { SIDE, SIDE, SIDE },
                                  .spacing = { 1, 1, 1 },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    struct sp_error err;
    struct sp_volume *volume = sp_volume_create(&grid, type, voxels, "v", &err);
    if (!volume)
        fail_msg("%s", err.text);
    return volume;
}

/* 1 in the middle of a ball, 0 at its surface and outside. */
static double ball_at(const double centre[3], double radius, int i) {
    double d[3] = { i % SIDE - centre[0], i / SIDE % SIDE - centre[1],
                    i / SIDE / SIDE - centre[2] };
    return fmax(0, 1 - sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / radius);
}

static struct test_image draw(const struct rig *rig, struct sp_renderer *renderer,
                              struct sp_volume *volume, const struct sp_view *view) {
    struct test_image image;
    struct sp_error err;
    const struct sp_render_options options = { .format = SP_RGBAF32 };
    struct sp_frame *frame = sp_renderer_render(renderer, volume, view, rig->pool, &options, &err);
    if (!frame)
        fail_msg("%s", err.text);
    assert_true(test_image_from_frame(&image, frame));
    sp_frame_unref(&frame);
    return image;
}

static void check(const struct rig *rig, struct sp_volume *volume, const struct sp_view *view) {
    struct test_image got = draw(rig, rig->gl, volume, view);
    struct test_image wanted = draw(rig, rig->scalar, volume, view);
    double psnr = test_image_psnr(&got, &wanted);
    print_message("  %.1f dB\n", psnr);
    assert_compare(psnr, >=, 70);
    test_image_finish(&got);
    test_image_finish(&wanted);
    sp_renderer_evict(rig->scalar, volume);
}

/* No volume is evicted, so the renderer may keep the data of volumes that were freed. */
static void volumes_without_eviction_are_not_confused(void **state) {
    static uint8_t voxels[SIDE * SIDE * SIDE];
    for (int v = 0; v < 48; v++) {
        const double centre[3] = { 6 + v % 4 * 4, 6 + v / 4 % 4 * 4, 6 + v / 16 * 6 };
        for (int i = 0; i < SIDE * SIDE * SIDE; i++)
            voxels[i] = ball_at(centre, 5, i) > 0 ? 200 : 0;
        struct sp_volume *volume = make_volume(SP_UINT8, voxels);
        struct sp_view view;
        sp_view_init(&view, sp_volume_info(volume), "v");
        view.transfer_function.order = SP_TF_PRE;
        view.size[0] = view.size[1] = SIZE;
        check(*state, volume, &view);
        sp_volume_unref(&volume);
    }
}

/* The same transfer function for volumes with different ranges of values. */
static void a_curve_is_not_reused_for_another_range(void **state) {
    const struct rig *rig = *state;
    static int16_t voxels[SIDE * SIDE * SIDE];
    static const double middle[3] = { 12, 12, 12 };
    struct sp_transfer_function first;
    for (int v = 0; v < 3; v++) {
        for (int i = 0; i < SIDE * SIDE * SIDE; i++)
            voxels[i] = (int16_t)((v == 1 ? -100 : 0) + 200 * ball_at(middle, 11, i));
        struct sp_volume *volume = make_volume(SP_INT16, voxels);
        struct sp_view view;
        sp_view_init(&view, sp_volume_info(volume), "v");
        view.transfer_function.order = SP_TF_PRE;
        first = v == 0 ? view.transfer_function : first;
        view.transfer_function = first;
        view.transfer_function.order = SP_TF_POST;
        view.compositing.mode = SP_COMPOSITE_SLAB;
        view.filter.mode = SP_FILTER_EWA; /* with the default, slabs are not splatted */
        view.size[0] = view.size[1] = SIZE;
        check(rig, volume, &view);
        sp_renderer_evict(rig->gl, volume);
        sp_volume_unref(&volume);
    }
}

int main(void) {
    static struct rig rig;
    struct sp_error err;
    rig.gl = sp_renderer_create(&(struct sp_renderer_options){ .backend = test_gl(), .threads = 1 },
                                &err);
    if (!rig.gl) {
        printf("skipped: %s\n", err.text);
        return SKIPPED;
    }
    rig.scalar = sp_renderer_create(
        &(struct sp_renderer_options){ .backend = "cpu", .isa = "scalar", .threads = 1 }, &err);
    rig.pool = sp_frame_pool_create(0, &err);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_prestate(volumes_without_eviction_are_not_confused, &rig),
        cmocka_unit_test_prestate(a_curve_is_not_reused_for_another_range, &rig),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    sp_renderer_destroy(&rig.gl);
    sp_renderer_destroy(&rig.scalar);
    sp_frame_pool_destroy(&rig.pool);
    return failed;
}
