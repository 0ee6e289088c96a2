/* SPDX-License-Identifier: Apache-2.0
 *
 * What a frame shows while its bricks are being read, and if not all of them fit into memory: the
 * most important ones, and in place of the others a coarser level.
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
#include "data/volume/volume.h"
#include "draw/working_set/working_set.h"
#include "sp/bricks.h"
#include "support/compare.h"
#include "support/one_thread.h"
#include "unit/draw/working_set/balls.h"

/* Expects that bricks are there which matter at least as much as each brick that is not. Returns
 * how many are not there. */
static unsigned expect_most_important(const struct sp_brick_need *need,
                                      const struct sp_blocks *blocks) {
    unsigned least = UINT16_MAX, most = 0, missing = 0, present = 0;
    assert_non_null(blocks);
    assert_memory_equal(blocks->count, need->count, sizeof need->count);
    for (uint64_t i = 0; i < sp_brick_need_count(need); i++) {
        const unsigned number = need->wanted[i];
        if (number < BRICK_WANTED)
            continue;
        if (blocks->block[i].samples) {
            least = number < least ? number : least;
            present++;
        } else {
            most = number > most ? number : most;
            missing++;
        }
    }
    assert_compare(present, >, 0);
    assert_compare(least, >=, most);
    return missing;
}

/* A source of chunks that stops at one of them until it may go on. */
struct source {
    const struct rig *rig;
    bool is_closed;
    atomic_int reads, gate; /* gate: that many chunks of the finest level may be read */
};

static const struct sp_chunk_level levels[2] = {
    { { WIDE, HIGH, DEEP }, { 64, 64, 64 }, { 1, 1, 1 }, { 0, 0, 0 } },
    { { WIDE / 2, HIGH / 2, DEEP / 2 }, { 64, 64, 64 }, { 2, 2, 2 }, { 0, 0, 0 } },
};

static bool read_chunk(void *user, unsigned reader, unsigned level, const uint32_t place[3],
                       void *out, bool (*is_cancelled)(void *cancel), void *cancel,
                       struct sp_error *err) {
    struct source *s = user;
    const uint32_t step = level ? 2 : 1;
    uint32_t first[3], size[3];
    uint8_t *to = out;
    assert_int_equal(reader, 0);
    sp_chunk_box(&levels[level], place, first, size);
    for (uint32_t i = 0; i < size[0] * size[1] * size[2]; i++) {
        const uint32_t x = (first[0] + i % size[0]) * step,
                       y = (first[1] + i / size[0] % size[1]) * step,
                       z = (first[2] + i / size[0] / size[1]) * step;
        to[i] = s->rig->samples[((size_t)z * HIGH + y) * WIDE + x];
    }
    if (level > 0)
        return true;
    atomic_fetch_add(&s->reads, 1);
    while (atomic_load(&s->reads) > atomic_load(&s->gate)) {
        if (is_cancelled(cancel))
            return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        sched_yield();
    }
    return true;
}

static void close_source(void *user) {
    struct source *s = user;
    s->is_closed = true;
}

static struct sp_volume *open_source(struct source *s) {
    struct sp_chunk_source source = { .info = *sp_volume_info(s->rig->whole),
                                      .levels = 2,
                                      .readers = 1,
                                      .user = s,
                                      .read = read_chunk,
                                      .close = close_source };
    struct sp_load_options options = { .subvolume_bytes = 32 << 20 };
    struct sp_error err;
    memcpy(source.level, levels, sizeof levels);
    struct sp_volume *volume =
        sp_brick_store_open_chunks(&source, "chunks", "chunks", &options, &err);
    if (!volume)
        fail_msg("%s", err.text);
    assert_int_equal(sp_bricks_base(volume), 1);
    sp_brick_store_of(volume)->publish_ms = 0; /* every part is shown at once */
    return volume;
}

/* Closes it now: the renderer has references. */
static void close_volume(const struct rig *rig, struct sp_volume **volume) {
    sp_renderer_evict(rig->renderer.renderer, *volume);
    sp_volume_unref(volume);
}

static struct sp_view make_view(const struct rig *rig) {
    struct sp_view view = balls_view(rig);
    /* Gradients are rounded to a share of the range. Here it is the range of the coarse volume. */
    view.shading.mode = SP_SHADING_NONE;
    for (int a = 0; a < 3; a++)
        view.camera.position[a] = view.camera.target[a] + 260;
    return view;
}

static void what_is_read_is_shown_meanwhile(void **state) {
    enum { GATE = 40 };
    struct rig *rig = *state;
    struct source source = { .rig = rig, .gate = GATE };
    struct sp_brick_need need;
    struct sp_brick_subvolume subvolume;
    struct sp_error err;
    balls_make(rig, SP_UINT8);
    struct sp_volume *volume = open_source(&source);
    struct sp_brick_store *store = sp_brick_store_of(volume);
    const struct sp_view view = make_view(rig);
    assert_true(sp_working_set_need(sp_brick_store_file(store), &view, 0, false, &need));
    need.is_sparse = true;
    assert_compare(sp_brick_need_wanted(&need), >, GATE);
    struct sp_frame *truth = rig_render(rig, rig->whole, &view, 0),
                    *first = rig_render_level(rig, volume, &view, 0, 1);
    /* Nothing was asked for yet. The call returns with the first part, not with the last. */
    assert_true(sp_brick_store_get(store, &need, INFINITY, true, NULL, NULL, &subvolume, &err));
    assert_false(subvolume.is_wanted);
    assert_compare(subvolume.missing, >, 0);
    assert_compare(subvolume.missing, <, sp_brick_need_wanted(&need));
    sp_volume_unref(&subvolume.volume);
    while (atomic_load(&source.reads) <= GATE)
        sched_yield();
    struct sp_frame *part = rig_render(rig, volume, &view, -1);
    const struct sp_frame_bricks *bricks = &part->stats.bricks;
    assert_true(bricks->is_incomplete);
    assert_true(bricks->is_being_read);
    assert_int_equal(bricks->asked, 0);
    assert_int_equal(bricks->level, 1); /* of what is missing */
    assert_int_equal(bricks->resident, GATE / BRICK_BATCH * BRICK_BATCH);
    assert_int_equal(bricks->wanted, sp_brick_need_wanted(&need));
    assert_true(sp_brick_store_get(store, &need, 0, false, NULL, NULL, &subvolume, &err));
    assert_false(subvolume.is_wanted);
    assert_int_equal(subvolume.missing, bricks->wanted - bricks->resident);
    assert_int_equal(expect_most_important(&need, sp_volume_blocks(subvolume.volume)),
                     subvolume.missing);
    sp_volume_unref(&subvolume.volume);
    atomic_store(&source.gate, INT32_MAX);
    struct sp_frame *last = rig_render(rig, volume, &view, 0);
    assert_true(sp_frame_bricks_is_complete(&last->stats.bricks));
    assert_false(last->stats.bricks.is_being_read);
    assert_int_equal(last->stats.bricks.resident, last->stats.bricks.wanted);
    const double db[3] = { rig_compare(truth, first), rig_compare(truth, part),
                           rig_compare(truth, last) };
    print_message("at first %.1f dB, then %.1f dB, at last %.1f dB\n", db[0], db[1], db[2]);
    assert_compare(db[1], >, db[0] + 1);
    assert_compare(db[2], >,
                   70); /* the range sets the steps of levels; here it is level 1's range */
    sp_frame_unref(&truth);
    sp_frame_unref(&first);
    sp_frame_unref(&part);
    sp_frame_unref(&last);
    free(need.wanted);
    close_volume(rig, &volume);
    balls_finish(rig);
}

static void a_volume_is_closed_while_it_is_read(void **state) {
    struct rig *rig = *state;
    struct source source = { .rig = rig, .gate = 20 };
    balls_make(rig, SP_UINT8);
    struct sp_volume *volume = open_source(&source);
    const struct sp_view view = make_view(rig);
    struct sp_frame *first = rig_render(rig, volume, &view, -1);
    while (atomic_load(&source.reads) <= 20)
        sched_yield();
    struct sp_frame *part = rig_render(rig, volume, &view, -1);
    assert_compare(part->stats.bricks.resident, ==, 16);
    sp_frame_unref(&first);
    sp_frame_unref(&part);
    close_volume(rig, &volume);
    assert_true(source.is_closed);
    balls_finish(rig);
}

static void without_memory_for_all_the_most_important_are_fine(void **state) {
    const uint64_t budget = 4864 << 10;
    struct rig *rig = *state;
    struct sp_error err;
    struct sp_working_set subvolume;
    struct sp_brick_subvolume place;
    struct sp_brick_need need;
    balls_make(rig, SP_UINT8);
    struct sp_volume *volume = rig_open_file(rig, budget);
    struct sp_brick_store *store = sp_brick_store_of(volume);
    const struct sp_view view = make_view(rig);
    const struct sp_working_set_job job = {
        .store = store, .view = &view, .wait_ms = INFINITY, .reads_blocks = true
    };
    assert_int_equal(sp_bricks_base(volume), 1);
    assert_true(sp_working_set_need(sp_brick_store_file(store), &view, 0, false, &need));
    if (!sp_working_set_choose(&job, &subvolume, &place, &err))
        fail_msg("%s", err.text);
    const unsigned dropped = expect_most_important(&need, sp_volume_blocks(subvolume.volume));
    assert_compare(dropped, >, 0);
    assert_int_equal(dropped + subvolume.wanted, sp_brick_need_wanted(&need));
    assert_true(subvolume.is_complete);
    sp_volume_unref(&subvolume.volume);
    struct sp_frame *truth = rig_render(rig, rig->whole, &view, 0),
                    *coarse = rig_render_level(rig, volume, &view, 0, 1),
                    *frame = rig_render(rig, volume, &view, 0);
    const struct sp_frame_bricks *bricks = &frame->stats.bricks;
    assert_false(bricks->is_incomplete); /* no better frame follows */
    assert_false(sp_frame_bricks_is_complete(bricks));
    assert_int_equal(bricks->level, 1);
    assert_int_equal(bricks->asked, 0);
    assert_int_equal(bricks->resident, subvolume.wanted);
    assert_compare(bricks->memory_bytes, <=, budget);
    const double db[2] = { rig_compare(truth, coarse), rig_compare(truth, frame) };
    print_message("%u of %u bricks are coarse: %.1f dB, level 1 %.1f dB\n", dropped,
                  (unsigned)sp_brick_need_wanted(&need), db[1], db[0]);
    assert_compare(db[1], >, db[0] + 1);
    sp_frame_unref(&truth);
    sp_frame_unref(&coarse);
    sp_frame_unref(&frame);
    free(need.wanted);
    close_volume(rig, &volume);
    balls_finish(rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_read_is_shown_meanwhile),
        cmocka_unit_test(a_volume_is_closed_while_it_is_read),
        one_thread_test(without_memory_for_all_the_most_important_are_fine),
    };
    return cmocka_run_group_tests(tests, balls_setup, balls_teardown);
}
