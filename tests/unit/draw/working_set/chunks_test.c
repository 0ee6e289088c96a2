/* SPDX-License-Identifier: Apache-2.0
 *
 * A volume that is read from chunks when frames need them, against the same volume in memory. The
 * chunks have odd sizes, and the levels do not halve all axes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "data/bricks/store_private.h"
#include "draw/working_set/working_set.h"
#include "sp/bricks.h"
#include "support/compare.h"
#include "support/one_thread.h"
#include "support/render.h"

enum { LEVELS = 3, SIDE = 64 };

static const struct sp_chunk_level levels[LEVELS] = {
    { { 150, 140, 90 }, { 40, 140, 17 }, { 1, 1, 1 }, { 0, 0, 0 } },
    { { 75, 70, 90 }, { 32, 32, 32 }, { 2, 2, 1 }, { 0.5, 0.5, 0 } },
    { { 37, 35, 45 }, { 64, 64, 64 }, { 4, 4, 2 }, { 1.5, 1.5, 0.5 } },
};

struct rig {
    struct test_renderer renderer;
    uint8_t *samples[LEVELS];
    struct sp_volume *whole; /* level 0 */
    atomic_int reads, closed;
    bool fails_all, hangs;
    int bad_chunk; /* of level 0, along x, at y = z = 0; −1 = none */
};

static size_t count_of(const struct sp_chunk_level *l) {
    return (size_t)l->dims[0] * l->dims[1] * l->dims[2];
}

/* A ball in one corner, in noise that the transfer function leaves out. */
static uint8_t field_at(double x, double y, double z) {
    const double dx = x - 35, dy = y - 40, dz = z - 30;
    const double inside = 0.5 + (24 - sqrt(dx * dx + dy * dy + dz * dz)) / 4;
    return (uint8_t)lrint(8 + fmod(x + 3 * y, 4) + 190 * fmin(fmax(inside, 0), 1));
}

static int setup(void **state) {
    static struct rig rig;
    struct sp_error err;
    const struct test_target target = { "cpu", "auto" };
    for (int l = 0; l < LEVELS; l++) {
        const struct sp_chunk_level *level = &levels[l];
        rig.samples[l] = malloc(count_of(level));
        assert_non_null(rig.samples[l]);
        for (size_t i = 0; i < count_of(level); i++) {
            const size_t at[3] = { i % level->dims[0], i / level->dims[0] % level->dims[1],
                                   i / level->dims[0] / level->dims[1] };
            double x[3];
            for (int a = 0; a < 3; a++)
                x[a] = level->offset[a] + level->step[a] * (double)at[a];
            rig.samples[l][i] = field_at(x[0], x[1], x[2]);
        }
    }
    const struct sp_grid grid = { .dims = { levels[0].dims[0], levels[0].dims[1],
                                            levels[0].dims[2] },
                                  .spacing = { 1, 1, 1.5 },
                                  .direction = { { 1 }, { 0, 1 }, { 0, 0, 1 } } };
    rig.whole = sp_volume_create(&grid, SP_UINT8, rig.samples[0], "whole", &err);
    assert_non_null(rig.whole);
    if (!test_renderer_open(&rig.renderer, &target, 2, &err))
        fail_msg("%s", err.text);
    *state = &rig;
    return 0;
}

static int teardown(void **state) {
    struct rig *rig = *state;
    sp_volume_unref(&rig->whole);
    test_renderer_close(&rig->renderer);
    for (int l = 0; l < LEVELS; l++)
        free(rig->samples[l]);
    return 0;
}

static bool read_chunk(void *user, unsigned reader, unsigned level, const uint32_t place[3],
                       void *out, bool (*is_cancelled)(void *cancel), void *cancel,
                       struct sp_error *err) {
    struct rig *rig = user;
    const struct sp_chunk_level *l = &levels[level];
    uint32_t first[3], size[3];
    uint8_t *to = out;
    assert_compare(reader, <, 2);
    while (rig->hangs) {
        if (is_cancelled(cancel))
            return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        sched_yield();
    }
    const bool is_bad = level == 0 && (int)place[0] == rig->bad_chunk && !place[1] && !place[2];
    if (rig->fails_all || is_bad)
        return sp_fail(err, SP_ERR_IO, "chunk", "it is away");
    sp_chunk_box(l, place, first, size);
    for (uint32_t z = 0; z < size[2]; z++)
        for (uint32_t y = 0; y < size[1]; y++, to += size[0])
            memcpy(to,
                   rig->samples[level] +
                       ((size_t)(first[2] + z) * l->dims[1] + first[1] + y) * l->dims[0] + first[0],
                   size[0]);
    atomic_fetch_add(&rig->reads, 1);
    return true;
}

static void close_source(void *user) {
    struct rig *rig = user;
    atomic_fetch_add(&rig->closed, 1);
}

static struct sp_volume *open_chunks(struct rig *rig, struct sp_load_options *options,
                                     struct sp_error *err) {
    struct sp_chunk_source source = { .info = *sp_volume_info(rig->whole),
                                      .levels = LEVELS,
                                      .readers = 2,
                                      .user = rig,
                                      .read = read_chunk,
                                      .close = close_source };
    memcpy(source.level, levels, sizeof levels);
    rig->reads = rig->closed = 0;
    return sp_brick_store_open_chunks(&source, "chunks", "chunks", options, err);
}

static struct sp_volume *open_with(struct rig *rig, uint64_t bytes) {
    struct sp_load_options options = { .subvolume_bytes = bytes };
    struct sp_error err;
    struct sp_volume *volume = open_chunks(rig, &options, &err);
    if (!volume)
        fail_msg("%s", err.text);
    return volume;
}

static struct sp_view make_view(const struct rig *rig) {
    struct sp_view view;
    sp_view_init(&view, sp_volume_info(rig->whole), "v");
    view.size[0] = view.size[1] = SIDE;
    view.level_of_detail = SP_LOD_OFF;
    view.transfer_function.point_count = 2;
    memset(view.transfer_function.points, 0, sizeof view.transfer_function.points);
    view.transfer_function.points[0].value = 60;
    view.transfer_function.points[1] =
        (struct sp_tf_point){ .value = 200, .color = { 0.9f, 0.5f, 0.2f }, .opacity = 0.3f };
    view.transfer_function.order = SP_TF_POST;
    /* Gradients are rounded to a share of the range. Here it is the range of the coarse volume. */
    view.shading.mode = SP_SHADING_NONE;
    return view;
}

static struct sp_frame *render(const struct rig *rig, struct sp_volume *volume,
                               const struct sp_view *view) {
    struct sp_error err;
    const struct sp_render_options options = { .format = SP_RGBAF32 };
    struct sp_frame *frame = sp_renderer_render(rig->renderer.renderer, volume, view,
                                                rig->renderer.pool, &options, &err);
    if (!frame)
        fail_msg("%s: %s", err.place, err.text);
    return frame;
}

/* The root of the mean square of the differences. */
static double compare(const struct sp_frame *a, const struct sp_frame *b) {
    double sum = 0;
    for (uint32_t y = 0; y < a->height; y++) {
        const float *p = (const void *)((const char *)a->pixels + y * a->stride_bytes);
        const float *q = (const void *)((const char *)b->pixels + y * b->stride_bytes);
        for (uint32_t i = 0; i < 4 * a->width; i++)
            sum += ((double)p[i] - (double)q[i]) * ((double)p[i] - (double)q[i]);
    }
    return sqrt(sum / (4.0 * a->width * a->height));
}

static void an_image_equals_that_of_the_volume_and_reads_less_the_next_time(void **state) {
    struct rig *rig = *state;
    rig->bad_chunk = -1;
    struct sp_volume *volume = open_with(rig, 4 << 20);
    struct sp_view view = make_view(rig);
    struct sp_frame *truth = render(rig, rig->whole, &view), *got = render(rig, volume, &view);
    assert_int_equal(got->stats.bricks.level, 0);
    assert_false(got->stats.bricks.is_incomplete);
    assert_compare(compare(truth, got), <, 1e-4); /* rounding of levels */
    const uint64_t wanted = got->stats.bricks.wanted;
    const int reads = rig->reads;
    struct sp_frame *again = render(rig, volume, &view); /* all ranges are known now */
    assert_compare(compare(again, got), ==, 0);
    sp_frame_unref(&got);
    got = again;
    assert_compare(got->stats.bricks.wanted, <, wanted);
    assert_int_equal(rig->reads, reads);
    sp_frame_unref(&got);
    sp_frame_unref(&truth);
    sp_volume_unref(&volume);
    assert_int_equal(rig->closed, 1);
}

static void coarser_levels_lie_at_the_same_place(void **state) {
    struct rig *rig = *state;
    struct sp_view view = make_view(rig);
    struct sp_frame *truth = render(rig, rig->whole, &view);
    double last = 0;
    for (uint64_t bytes = 4 << 20; bytes >= 1 << 18; bytes /= 4) {
        struct sp_volume *volume = open_with(rig, bytes);
        struct sp_frame *frame = render(rig, volume, &view);
        const double differs = compare(truth, frame);
        print_message("%u bytes: level %u differs by %.3f\n", (unsigned)bytes,
                      frame->stats.bricks.level, differs);
        assert_false(frame->stats.bricks.is_incomplete);
        assert_compare(differs, >=, last);
        assert_compare(differs, <, 0.03);
        last = differs;
        sp_frame_unref(&frame);
        sp_volume_unref(&volume);
    }
    assert_compare(last, >, 0);
    sp_frame_unref(&truth);
}

static void ranges_hold_for_a_brick_and_its_margin(void **state) {
    struct rig *rig = *state;
    struct sp_volume *volume = open_with(rig, 4 << 20);
    struct sp_view view = make_view(rig);
    struct sp_frame *frame = render(rig, volume, &view);
    const struct sp_brick_file *file = sp_brick_store_file(sp_brick_store_of(volume));
    const struct sp_brick_level *level = &sp_brick_file_header(file)->level[0];
    const struct sp_brick_entry *entries = sp_brick_file_entries(file, 0);
    for (uint64_t b = 0; b < sp_brick_count(level); b++) {
        uint32_t first[3], size[3];
        double low = INFINITY, high = -INFINITY;
        sp_brick_box(level, b, first, size);
        for (size_t i = 0; i < count_of(&levels[0]); i++) {
            const size_t at[3] = { i % level->dims[0], i / level->dims[0] % level->dims[1],
                                   i / level->dims[0] / level->dims[1] };
            bool is_in = true;
            for (int a = 0; a < 3; a++)
                is_in = is_in && at[a] + BRICK_MARGIN >= first[a] &&
                        at[a] < first[a] + size[a] + BRICK_MARGIN;
            low = is_in ? fmin(low, rig->samples[0][i]) : low;
            high = is_in ? fmax(high, rig->samples[0][i]) : high;
        }
        assert_compare(entries[b].range[0], <=, low);
        assert_compare(entries[b].range[1], >=, high);
        assert_compare(entries[b].range[1], <=, 201); /* known, and not wider than all samples */
    }
    assert_compare(entries[sp_brick_count(level) - 1].range[1], <, 20); /* far from the ball */
    sp_frame_unref(&frame);
    sp_volume_unref(&volume);
}

static void a_chunk_that_fails_is_a_hole(void **state) {
    struct rig *rig = *state;
    struct sp_view view = make_view(rig);
    rig->bad_chunk = 0;
    struct sp_volume *volume = open_with(rig, 4 << 20);
    struct sp_frame *truth = render(rig, rig->whole, &view), *frame = render(rig, volume, &view);
    assert_int_equal(frame->stats.bricks.level, 0);
    assert_true(frame->stats.bricks.is_incomplete);
    assert_compare(frame->stats.bricks.resident, <, frame->stats.bricks.wanted);
    assert_compare(compare(truth, frame), <, 0.03); /* a coarser level is there */
    sp_frame_unref(&truth);
    sp_frame_unref(&frame);
    sp_volume_unref(&volume);
    rig->bad_chunk = -1;
}

static void a_chunk_that_failed_is_read_again(void **state) {
    struct rig *rig = *state;
    struct sp_view view = make_view(rig);
    struct sp_bricks_damage damage;
    rig->bad_chunk = 0;
    struct sp_volume *volume = open_with(rig, 4 << 20);
    struct sp_frame *truth = render(rig, rig->whole, &view), *frame = render(rig, volume, &view);
    assert_true(frame->stats.bricks.is_incomplete);
    assert_true(sp_bricks_get_damage(volume, &damage));
    sp_frame_unref(&frame);
    rig->bad_chunk = -1;
    frame = render(rig, volume, &view); /* it is not yet time */
    assert_true(frame->stats.bricks.is_incomplete);
    sp_frame_unref(&frame);
    sp_brick_store_of(volume)->retry_ms = 0;
    frame = render(rig, volume, &view);
    assert_true(sp_frame_bricks_is_complete(&frame->stats.bricks));
    assert_compare(compare(truth, frame), <, 1e-4);
    assert_false(sp_bricks_get_damage(volume, &damage));
    sp_frame_unref(&truth);
    sp_frame_unref(&frame);
    sp_volume_unref(&volume);
}

static void nothing_that_can_be_read_is_an_error(void **state) {
    struct rig *rig = *state;
    struct sp_load_options options = { .subvolume_bytes = 4 << 20 };
    struct sp_error err;
    rig->fails_all = true;
    assert_null(open_chunks(rig, &options, &err));
    assert_int_equal(err.code, SP_ERR_IO);
    assert_string_equal(err.text, "it is away");
    assert_int_equal(rig->closed, 1);
    rig->fails_all = false;
}

static bool stop(void *user, double fraction) {
    (void)user;
    (void)fraction;
    return false;
}

static void a_load_that_hangs_is_cancelled(void **state) {
    struct rig *rig = *state;
    struct sp_load_options options = { .subvolume_bytes = 4 << 20, .progress = stop };
    struct sp_error err;
    rig->hangs = true;
    assert_null(open_chunks(rig, &options, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    rig->hangs = false;
}

static void without_a_small_level_there_is_no_budget(void **state) {
    struct rig *rig = *state;
    struct sp_load_options options = { .subvolume_bytes = 64 << 10 };
    struct sp_error err;
    assert_null(open_chunks(rig, &options, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_non_null(strstr(err.text, "coarsest level of detail has 58275 bytes"));
    assert_int_equal(rig->closed, 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_image_equals_that_of_the_volume_and_reads_less_the_next_time),
        one_thread_test(coarser_levels_lie_at_the_same_place),
        one_thread_test(ranges_hold_for_a_brick_and_its_margin),
        one_thread_test(a_chunk_that_fails_is_a_hole),
        cmocka_unit_test(a_chunk_that_failed_is_read_again),
        cmocka_unit_test(nothing_that_can_be_read_is_an_error),
        cmocka_unit_test(a_load_that_hangs_is_cancelled),
        cmocka_unit_test(without_a_small_level_there_is_no_budget),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
