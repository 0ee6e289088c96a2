/* SPDX-License-Identifier: Apache-2.0
 *
 * Refinements and frames for clients of final frames only: interaction cancels them, and the
 * starvation limit lets them through at last. In virtual time.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/compare.h"
#include "support/sanitized.h"
#include "unit/server/schedule/simulation.h"

static void motion_elsewhere_cancels_a_refinement(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    sim_session(s, id);
    struct sim_client *resting = sim_join(s, 0, s->f->id, 0, "{\"size\":[4096,4096]}");
    sim_run(s, 5000); /* the time of its frames is known now: 840 ms */
    assert_int_equal(resting->finals, 1);
    struct sim_client *moving = sim_join(s, 1, id, 33, "{\"size\":[256,256]}");
    sim_run(s, 1000);
    sim_turn(s, resting);
    sim_reset(s);
    sim_run(s, 10000);
    assert_int_equal(resting->finals, 0);
    assert_compare(moving->gap_ms, <,
                   100); /* its own 33 ms, and a moving frame of the other client */
    sim_run(s, 20000);
    assert_int_equal(resting->finals, 1); /* the starvation limit lets it through */
    assert_compare(moving->frames, >, 30000 / 33 * 9 / 10);
}

/* A refinement that could not have been rendered did not wait for others. */
static void the_starvation_limit_does_not_count_while_the_window_is_closed(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    sim_session(s, id);
    s->bytes = 1 << 20; /* one frame in flight closes the window */
    struct sim_client *slow = sim_join(s, 0, s->f->id, 0, "{\"size\":[4096,4096]}");
    sim_run(s, 5000); /* the time of its frames is known now: 840 ms */
    assert_int_equal(slow->finals, 1);
    struct sim_client *moving = sim_join(s, 1, id, 33, "{\"size\":[256,256]}");
    sim_run(s, 1000);
    slow->is_stalled = true;
    sim_turn(s, slow);
    sim_run(s, 1000); /* the moving frame waits for the socket, the refinement for a free worker */
    sim_receive(s, slow, false);
    assert_int_not_equal(slow->unacked, 0);
    sim_reset(s);
    sim_run(s, 30000);
    slow->is_stalled = false;
    sim_ack(s, slow, slow->unacked);
    sim_run(s, 10000);
    assert_int_equal(slow->finals, 0);
    assert_compare(moving->gap_ms, <, 100);
    sim_run(s, 10000);
    assert_int_equal(slow->finals, 1);
}

/* The limit also does not count while the client's own frame rate delays the frame. */
static void the_starvation_limit_does_not_count_while_the_rate_is_used_up(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    sim_session(s, id);
    struct sim_client *slow =
        sim_join(s, 0, s->f->id, 0, "{\"max_fps\":1,\"progressive\":false,\"size\":[4096,4096]}");
    sim_run(s, 5000);
    assert_int_equal(slow->finals, 1);
    sim_join(s, 1, id, 133, "{\"size\":[256,256]}"); /* leaves 33 ms between its frames */
    sim_run(s, 1000);
    sim_turn(s, slow);
    sim_reset(s);
    sim_run(s, 30000);
    assert_int_equal(slow->finals, 0);
    assert_compare(slow->took_ms, >, 0); /* it was begun several times and cancelled */
    sim_run(s, 900000);
    assert_compare(slow->finals, >, 0);
}

static void a_view_that_moves_rarely_leaves_time_for_refinements(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    sim_session(s, id);
    struct sim_client *resting = sim_join(s, 0, s->f->id, 0, "{\"size\":[2048,2048]}");
    sim_run(s, 5000); /* the time of its frames is known now: 212 ms */
    sim_join(s, 1, id, 33, "{\"max_fps\":1,\"size\":[256,256]}");
    sim_run(s, 3000);
    sim_turn(s, resting);
    sim_reset(s);
    sim_run(s, 2000);
    assert_int_equal(resting->finals, 1);
}

static void a_client_of_final_frames_only_does_not_stop_the_others(void **state) {
    struct simulation *s = *state;
    struct sim_client *driver = sim_join(s, 0, s->f->id, 33, "{\"size\":[256,256]}");
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 30000);
    unsigned alone = driver->frames;
    struct sim_client *viewer =
        sim_join(s, 1, s->f->id, 0, "{\"progressive\":false,\"size\":[4096,4096]}");
    sim_run(s, 3000);
    sim_reset(s);
    sim_run(s, 60000);
    assert_in_range(driver->frames, 2 * alone * 9 / 10, 2 * alone);
    assert_compare(viewer->finals, >, 0);
    driver->period_ms = 0;
    sim_reset(s);
    sim_run(s, 3000);
    assert_int_equal(viewer->finals, 1);
}

static void frames_of_unknown_time_do_not_stop_the_others(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct sim_client *moving = sim_join(s, 0, s->f->id, 33, "{\"size\":[256,256]}");
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 60000);
    unsigned alone = moving->frames;
    sim_session(s, id);
    struct sim_client *greedy =
        sim_join(s, 1, id, 33, "{\"max_fps\":60,\"progressive\":false,\"size\":[8192,8192]}");
    sim_reset(s);
    sim_run(s, 60000);
    assert_in_range(moving->frames, alone * 85 / 100, alone);
    assert_int_equal(greedy->finals,
                     0); /* it takes 3.4 s, and it has not waited long enough for that */
    sim_run(s, 240000);
    assert_compare(greedy->finals, >, 0);
    assert_in_range(moving->frames, 5 * alone * 9 / 10, 5 * alone);
}

static uint32_t random_number(uint32_t *state, uint32_t below) {
    *state = *state * 1664525u + 1013904223u;
    return (uint32_t)((uint64_t)(*state >> 8) * below >> 24);
}

/* Two heavy views (17 s for a sharp frame) move, rest, wait until their refinements are protected,
 * or want final frames only. Whenever a client joins one of their sessions, it gets a frame within
 * FIRST_MS: whatever is running, and although the times of its frames are not known. */
static void whoever_joins_gets_a_frame_soon(void **state) {
    enum { HISTORIES = TEST_SANITIZED ? 6 : 40, STEPS = 12, FIRST_MS = 400 };
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    uint32_t random = 7;
    if (TEST_SANITIZED)
        print_message("reduced under a sanitizer: %d histories\n", HISTORIES);
    s->mpx_ms = 1000;
    s->has_preemption = true;
    sim_session(s, id);
    for (int history = 0; history < HISTORIES; history++) {
        static const char *const settings[] = { "{\"size\":[4096,4096]}",
                                                "{\"size\":[4096,4096],\"progressive\":false}",
                                                "{\"size\":[2048,2048],\"max_fps\":60}" };
        struct sim_client *heavy[2];
        for (unsigned i = 0; i < 2; i++)
            heavy[i] = sim_join(s, i, i ? id : s->f->id, random_number(&random, 2) * 33,
                                settings[random_number(&random, 3)]);
        for (int step = 0; step < STEPS; step++) {
            static const double waits_ms[] = { 5, 50, 500, 5000, 500000 };
            struct sim_client *c = heavy[random_number(&random, 2)];
            if (random_number(&random, 2)) {
                c->period_ms = c->period_ms > 0 ? 0 : 33;
                c->next_ms = s->now_ms + c->period_ms;
                sim_turn(s, c);
            }
            sim_run(s, waits_ms[random_number(&random, step % 4 ? 4 : 5)]);
            const double joined_ms = s->now_ms;
            struct sim_client *guest = sim_join(s, 2, random_number(&random, 2) ? id : s->f->id, 0,
                                                "{\"size\":[320,240]}");
            guest->last_ms = joined_ms;
            while (guest->frames == 0 && s->now_ms < joined_ms + 60000)
                sim_run(s, 5);
            if (guest->frames == 0 || guest->last_ms - joined_ms > FIRST_MS)
                fail_msg("history %d, step %d: first frame after %.0f ms", history, step,
                         guest->frames ? guest->last_ms - joined_ms : INFINITY);
            srv_hub_leave(s->f->hub, &guest->participant, s->now_ms);
        }
        for (unsigned i = 0; i < 2; i++)
            srv_hub_leave(s->f->hub, &heavy[i]->participant, s->now_ms);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, sim_set_up, sim_tear_down)
        TEST(motion_elsewhere_cancels_a_refinement),
        TEST(the_starvation_limit_does_not_count_while_the_window_is_closed),
        TEST(the_starvation_limit_does_not_count_while_the_rate_is_used_up),
        TEST(a_view_that_moves_rarely_leaves_time_for_refinements),
        TEST(a_client_of_final_frames_only_does_not_stop_the_others),
        TEST(frames_of_unknown_time_do_not_stop_the_others),
        TEST(whoever_joins_gets_a_frame_soon),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
