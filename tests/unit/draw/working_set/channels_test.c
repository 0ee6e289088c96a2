/* SPDX-License-Identifier: Apache-2.0
 *
 * Channels of brick files against channels of volumes in memory.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "support/compare.h"
#include "support/one_thread.h"
#include "support/sanitized.h"
#include "unit/draw/working_set/rig.h"

static struct sp_volume *find_channel(void *user, const char *id) {
    assert_string_equal(id, "channel");
    return sp_volume_ref(user);
}

static struct sp_frame *render_with_channel(const struct rig *rig, struct sp_volume *volume,
                                            struct sp_volume *channel, const struct sp_view *view,
                                            double wait_ms, unsigned level) {
    struct sp_error err;
    const struct sp_render_options options = { .format = SP_RGBAF32,
                                               .wait_ms = wait_ms,
                                               .mip_level = level,
                                               .find = find_channel,
                                               .user = channel };
    struct sp_frame *frame = sp_renderer_render(rig->renderer.renderer, volume, view,
                                                rig->renderer.pool, &options, &err);
    if (!frame)
        fail_msg("%s: %s", err.place, err.text);
    return frame;
}

/* A channel whose opacity rises from `low` on. */
static struct sp_view make_view(const struct rig *rig, double low, float opacity) {
    struct sp_view view = rig_make_view(rig);
    view.layer_count = 2;
    view.layers[1] = sp_layer_default(SP_LAYER_CHANNEL);
    snprintf(view.layers[1].id, sizeof view.layers[1].id, "channel");
    view.layers[1].point_count = 2;
    view.layers[1].points[0] = (struct sp_tf_point){ .value = low, .color = { 0, 0, 1 } };
    view.layers[1].points[1] =
        (struct sp_tf_point){ .value = 3 * low, .color = { 0, 0, 1 }, .opacity = opacity };
    return view;
}

/* Channels have one grid, whatever memory each of them has. */
static void channels_equal_those_of_volumes_in_memory(void **state) {
    const struct rig *rig = *state;
    static const uint64_t bytes[][2] = { { 0, 0 }, { 3 << 19, 1 << 22 }, { 1 << 22, 3 << 19 } };
    struct sp_view view = make_view(rig, 20, 0.2f);
    rig_zoom(&view, 2.5);
    for (size_t i = TEST_SANITIZED; i < sizeof bytes / sizeof *bytes; i += TEST_SANITIZED + 1) {
        struct sp_volume *volume = rig_open_file(rig, bytes[i][0]);
        struct sp_volume *channel = rig_open_file(rig, bytes[i][1]);
        struct sp_frame *first = render_with_channel(rig, volume, channel, &view, -1, 0);
        struct sp_frame *last = render_with_channel(rig, volume, channel, &view, 0, 0);
        const unsigned level = last->stats.bricks.level;
        struct sp_frame *truth = render_with_channel(rig, rig->whole, rig->whole, &view, 0, level);
        print_message("level %u, then %u\n", first->stats.bricks.level, level);
        assert_compare(level, <=, first->stats.bricks.level);
        assert_compare(rig_compare(truth, last), >=, 110);
        sp_frame_unref(&first);
        sp_frame_unref(&last);
        sp_frame_unref(&truth);
        sp_volume_unref(&volume);
        sp_volume_unref(&channel);
    }
}

/* One channel is in memory, and the other is shown from a coarse level of its bricks. */
static void bricks_mix_with_a_volume_in_memory(void **state) {
    const struct rig *rig = *state;
    const struct sp_view view = make_view(rig, 20, 0.2f);
    struct sp_volume *file = rig_open_file(rig, 3 << 19);
    for (int i = TEST_SANITIZED; i < 2; i++) {
        struct sp_frame *frame =
            render_with_channel(rig, i ? rig->whole : file, i ? file : rig->whole, &view, 0, 0);
        struct sp_frame *truth = render_with_channel(rig, rig->whole, rig->whole, &view, 0, 1);
        const double db = rig_compare(truth, frame);
        print_message("%s in memory: %.1f dB\n", i ? "the volume" : "the channel", db);
        assert_compare(db, >=, 40);
        sp_frame_unref(&frame);
        sp_frame_unref(&truth);
    }
    sp_volume_unref(&file);
}

/* The noise between the balls, in bricks that have nothing else, as large as the clip box. */
static void a_channel_shows_bricks_that_the_volume_does_not(void **state) {
    const struct rig *rig = *state;
    struct sp_view view = make_view(rig, 5, 0.02f);
    static const double box[2][3] = { { 0.1, 0.05, 0.2 }, { 0.95, 1, 0.99 } };
    struct sp_volume *file = rig_open_file(rig, 12 << 20);
    struct sp_frame *frames[2];
    memcpy(view.clip.box, box, sizeof box);
    view.level_of_detail = SP_LOD_OFF;
    view.transfer_function.points[0].value = 199; /* a few bricks */
    view.transfer_function.points[1].value = 199.5;
    frames[0] = render_with_channel(rig, file, file, &view, 0, 0);
    frames[1] =
        render_with_channel(rig, rig->whole, rig->whole, &view, 0, frames[0]->stats.bricks.level);
    assert_compare(rig_compare(frames[0], frames[1]), >=, 110);
    for (int i = 0; i < 2; i++)
        sp_frame_unref(&frames[i]);
    sp_volume_unref(&file);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(channels_equal_those_of_volumes_in_memory),
        one_thread_test(bricks_mix_with_a_volume_in_memory),
        one_thread_test(a_channel_shows_bricks_that_the_volume_does_not),
    };
    return cmocka_run_group_tests(tests, rig_setup, rig_teardown);
}
