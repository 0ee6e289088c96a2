/* SPDX-License-Identifier: Apache-2.0
 *
 * Subvolumes whose box does not fit into memory, although their bricks do: two balls in opposite
 * corners. Their images equal the images of the volume in memory, for each size of samples and each
 * axis of the slices.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "data/bricks/store.h"
#include "data/volume/volume.h"
#include "support/compare.h"
#include "support/sanitized.h"
#include "unit/draw/working_set/balls.h"

/* Memory for the bricks of both balls and for the ranges of the box, but not for the box. */
static uint64_t budget_of(enum sp_type type) {
    return (uint64_t)(10 << 20) * sp_type_size(type);
}

/* Looks along an axis, slightly turned. */
static void turn(struct sp_view *view, int axis) {
    for (int a = 0; a < 3; a++) {
        view->camera.position[a] = view->camera.target[a] + (a == axis ? 520 : 60 + 10 * a);
        view->camera.up[a] = a == (axis + 1) % 3;
    }
}

static void expect_equal(const struct rig *rig, struct sp_volume *volume,
                         const struct sp_view *view, const char *what) {
    const uint64_t array = SAMPLES * sp_type_size(rig->info.type);
    struct sp_frame *got = rig_render(rig, volume, view, 0),
                    *truth = rig_render(rig, rig->whole, view, 0);
    assert_int_equal(got->stats.bricks.level, 0);
    assert_true(sp_frame_bricks_is_complete(&got->stats.bricks));
    assert_compare(got->stats.bricks.memory_bytes, <, array);
    assert_compare(rig_mean_of(truth), >, 1e-3);
    const double db = rig_compare(truth, got);
    print_message("%s of %s: %.1f dB, %u bricks\n", what, sp_type_name(rig->info.type), db,
                  (unsigned)got->stats.bricks.wanted);
    assert_compare(db, ==, 200);
    sp_frame_unref(&got);
    sp_frame_unref(&truth);
}

static void images_equal_those_of_the_volume_in_memory(void **state) {
    static const enum sp_type types[] = { SP_UINT8, SP_INT16, SP_FLOAT32, SP_FLOAT64 };
    struct rig *rig = *state;
    for (size_t i = 0; i < sizeof types / sizeof *types; i += TEST_SANITIZED ? 2 : 1) {
        balls_make(rig, types[i]);
        struct sp_volume *volume = rig_open_file(rig, budget_of(types[i]));
        struct sp_view view = balls_view(rig);
        for (int axis = 0; axis < 3; axis++) {
            turn(&view, axis);
            expect_equal(rig, volume, &view, "sheets");
        }
        view.compositing.mode = SP_COMPOSITE_SLAB;
        expect_equal(rig, volume, &view, "slabs");
        view.compositing.mode = SP_COMPOSITE_SHEET;
        view.camera.projection = SP_ORTHOGRAPHIC;
        view.camera.height = 300;
        view.clip.box[0][0] = 0.11;
        expect_equal(rig, volume, &view, "clipped");
        view = balls_view(rig);
        view.level_of_detail = SP_LOD_AUTO;
        view.transfer_function.order = SP_TF_AUTO;
        view.size[0] = view.size[1] = 400;
        expect_equal(rig, volume, &view, "the default order");
        sp_volume_unref(&volume);
        balls_finish(rig);
    }
}

/* A subvolume of the finest level may be drawn at a coarser mip level. */
static void mip_levels_are_made_of_blocks(void **state) {
    struct rig *rig = *state;
    balls_make(rig, SP_UINT8);
    struct sp_error err;
    struct sp_volume *volume = rig_open_file(rig, budget_of(SP_UINT8));
    struct sp_view view = balls_view(rig);
    struct sp_frame *frame = rig_render(rig, volume, &view, 0); /* which reads the subvolume */
    struct sp_brick_store *store = sp_brick_store_of(volume);
    struct sp_brick_need need = { .count = { 6, 4, 3 }, .is_sparse = true };
    struct sp_brick_subvolume subvolume;
    assert_true(sp_brick_need_allocate(&need, 0));
    need.wanted[0] = BRICK_WANTED;
    assert_true(sp_brick_store_get(store, &need, INFINITY, false, NULL, NULL, &subvolume, &err));
    assert_non_null(sp_volume_blocks(subvolume.volume));
    struct sp_frame *got = rig_render_level(rig, subvolume.volume, &view, 0, 1),
                    *truth = rig_render_level(rig, rig->whole, &view, 0, 1);
    assert_compare(rig_mean_of(truth), >, 1e-3);
    assert_compare(rig_compare(truth, got), ==, 200);
    sp_frame_unref(&got);
    sp_frame_unref(&truth);
    sp_frame_unref(&frame);
    sp_volume_unref(&subvolume.volume);
    free(need.wanted);
    sp_volume_unref(&volume);
    balls_finish(rig);
}

/* A view whose drawing needs an array of samples gets an array, at a level that fits. */
static void other_views_get_a_box(void **state) {
    struct rig *rig = *state;
    balls_make(rig, SP_UINT8);
    struct sp_volume *volume = rig_open_file(rig, budget_of(SP_UINT8));
    struct sp_view views[3];
    for (int i = 0; i < 3; i++)
        views[i] = balls_view(rig);
    views[0].transfer_function.order = SP_TF_PRE;
    views[1].layers[0] = sp_layer_default(SP_LAYER_SURFACE);
    views[1].layers[0].value = 100;
    views[2].shading.shadow = 0.5;
    for (int i = 0; i < 3; i++) {
        struct sp_view plain = balls_view(rig);
        struct sp_frame *fine = rig_render(rig, volume, &plain, 0),
                        *frame = rig_render(rig, volume, &views[i], 0),
                        *truth = rig_render_level(rig, rig->whole, &views[i], 0, 1);
        assert_int_equal(fine->stats.bricks.level, 0);
        assert_int_equal(frame->stats.bricks.level, 1);
        assert_false(frame->stats.bricks.is_incomplete);
        assert_compare(rig_mean_of(frame), >, 1e-3);
        assert_compare(rig_compare(truth, frame), >, 35);
        sp_frame_unref(&fine);
        sp_frame_unref(&frame);
        sp_frame_unref(&truth);
    }
    sp_volume_unref(&volume);
    balls_finish(rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(images_equal_those_of_the_volume_in_memory),
        cmocka_unit_test(mip_levels_are_made_of_blocks),
        cmocka_unit_test(other_views_get_a_box),
    };
    return cmocka_run_group_tests(tests, balls_setup, balls_teardown);
}
