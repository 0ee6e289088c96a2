/* SPDX-License-Identifier: Apache-2.0
 *
 * Which of the jobs in flight are given up.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "render/frame_queue.h"
#include "sp/inflight.h"

enum { A = 1, B = 2 }; /* sessions */

static struct srv_frame_queue flights;
static struct srv_render_job jobs[4];

static int reset(void **state) {
    (void)state;
    memset(&flights, 0, sizeof flights);
    memset(jobs, 0, sizeof jobs);
    return 0;
}

/* A moving frame begun at `now_ms` that is kept for 100 ms. */
static struct srv_inflight *begin(unsigned i, uint64_t session, double now_ms) {
    jobs[i].session = session;
    jobs[i].step = SRV_STEP_MOVING;
    jobs[i].cancellable_from_ms = now_ms + 100;
    return srv_frame_queue_begin(&flights, &jobs[i], now_ms);
}

static struct srv_inflight *begin_refinement(unsigned i, uint64_t session, double now_ms) {
    jobs[i] = (struct srv_render_job){ .session = session,
                                       .step = SRV_STEP_FINAL,
                                       .is_refinement = true };
    return srv_frame_queue_begin(&flights, &jobs[i], now_ms);
}

static void they_end_in_the_order_in_which_they_began(void **state) {
    (void)state;
    assert_null(srv_frame_queue_oldest(&flights));
    begin(0, A, 0);
    for (unsigned i = 1; i < 10; i++) { /* round the end */
        begin(i % 4, A, 0);
        assert_ptr_equal(srv_frame_queue_oldest(&flights)->job, &jobs[(i - 1) % 4]);
        srv_frame_queue_pop(&flights, 0);
    }
    begin(2, B, 0);
    srv_frame_queue_undo(&flights);
    assert_ptr_equal(srv_frame_queue_oldest(&flights)->job, &jobs[1]);
    srv_frame_queue_pop(&flights, 0);
    assert_null(srv_frame_queue_oldest(&flights));
}

static void a_moving_frame_is_kept_for_its_time(void **state) {
    (void)state;
    struct srv_inflight *f = begin(0, A, 1000);
    srv_frame_queue_tick(&flights, 5000); /* nothing newer waits */
    assert_false(f->cancel);
    srv_frame_queue_interrupt(&flights, B, SRV_INTERRUPT_NEWER_VIEW, 5000); /* of another session */
    assert_false(f->cancel);
    srv_frame_queue_interrupt(&flights, A, SRV_INTERRUPT_NEWER_VIEW, 1099);
    assert_false(f->cancel);
    srv_frame_queue_tick(&flights, 1100);
    assert_true(f->cancel);
}

static void what_stands_still_grows_no_older(void **state) {
    (void)state;
    struct srv_inflight *f = begin(0, A, 1000);
    f->job->order = 7;
    srv_frame_queue_interrupt(&flights, A, SRV_INTERRUPT_NEWER_VIEW, 1010);
    srv_frame_queue_pause(&flights, 6, 1020); /* another one */
    assert_false(f->pause.requested);
    srv_frame_queue_pause(&flights, 7, 1020);
    assert_true(f->pause.requested);
    assert_true(srv_inflight_paused(f, 1020) == 0);
    assert_true(srv_inflight_age_ms(f, 1500) == 20);
    srv_frame_queue_tick(&flights, 5000);
    srv_frame_queue_resume(&flights, 6, 5000);
    assert_true(f->pause.requested && !f->cancel);
    srv_frame_queue_resume(&flights, 7, 5020);
    assert_false(f->pause.requested);
    assert_true(f->pause.paused_ms == 4000 && srv_inflight_age_ms(f, 5030) == 30);
    srv_frame_queue_pause(&flights, 7, 5050);
    srv_inflight_paused(f, 5050);
    srv_frame_queue_resume(&flights, 7, 6050);
    srv_frame_queue_tick(&flights, 6099);
    assert_false(f->cancel);
    srv_frame_queue_tick(&flights, 6100);
    assert_true(f->cancel);
    srv_frame_queue_pause(&flights, 7, 7000);
    srv_frame_queue_pop(&flights, 7000);
    f = begin(1, A, 7000); /* in whatever place */
    for (int i = 0; i < SP_IN_FLIGHT_MAX; i++) {
        srv_frame_queue_pop(&flights, 7000);
        f = begin(1, A, 7000);
        assert_true(!f->pause.requested && f->pause.paused_ms == 0 && f->pause_began_ms == 0);
    }
    srv_frame_queue_pop(&flights, 7000);
    srv_frame_queue_pause(&flights, 0, 7000); /* nothing is begun */
    srv_frame_queue_resume(&flights, 0, 7000);
}

/* Until its threads stand the processor is shared, and half of that time is its own. */
static void what_is_to_stand_still_and_runs_pays_half(void **state) {
    (void)state;
    struct srv_inflight *f = begin(0, A, 1000);
    f->job->order = 7;
    srv_frame_queue_pause(&flights, 7, 1010);
    assert_true(srv_inflight_age_ms(f, 1014) == 12);
    assert_true(srv_inflight_paused(f, 1014) == 2);
    assert_true(srv_inflight_paused(f, 1018) == 4); /* another thread of it */
    assert_true(srv_inflight_age_ms(f, 1050) == 14);
    srv_frame_queue_resume(&flights, 7, 1050);
    assert_true(f->pause.paused_ms == 36 && srv_inflight_age_ms(f, 1051) == 15);
    srv_frame_queue_pause(&flights, 7, 1060); /* again, and nothing of it comes to a stand */
    srv_frame_queue_resume(&flights, 7, 1070);
    assert_true(f->pause.paused_ms == 41);
}

static void the_clock_of_one_behind_starts_when_it_is_the_oldest(void **state) {
    (void)state;
    begin(0, B, 1000);
    struct srv_inflight *f = begin(1, A, 1010);
    srv_frame_queue_interrupt(&flights, A, SRV_INTERRUPT_NEWER_VIEW, 1020);
    srv_frame_queue_tick(&flights, 9000);
    assert_false(f->cancel);
    srv_frame_queue_pop(&flights, 9000);
    srv_frame_queue_tick(&flights, 9099);
    assert_false(f->cancel);
    srv_frame_queue_tick(&flights, 9101);
    assert_true(f->cancel);
}

static void refinements_and_what_nobody_wants_go_at_once(void **state) {
    (void)state;
    struct srv_inflight *first = begin(0, A, 1000), *second = begin_refinement(1, A, 1000);
    struct srv_inflight *other = begin(2, B, 1000);
    srv_frame_queue_interrupt(&flights, A, SRV_INTERRUPT_NEWER_VIEW, 1001);
    assert_false(first->cancel);
    assert_true(second->cancel);
    srv_frame_queue_interrupt(&flights, B, SRV_INTERRUPT_UNWANTED, 1002);
    assert_true(other->cancel);
    srv_frame_queue_pop(&flights, 1003);
    srv_frame_queue_pop(&flights, 1003); /* no time is given back to those */
    srv_frame_queue_pop(&flights, 1003);
}

static void of_two_moving_frames_one_is_finished(void **state) {
    (void)state;
    struct srv_inflight *first = begin(0, A, 1000), *second = begin(1, A, 1000);
    struct srv_inflight *other = begin(2, B, 1000);
    srv_frame_queue_interrupt(&flights, A, SRV_INTERRUPT_NEWER_VIEW, 1000);
    srv_frame_queue_interrupt(&flights, B, SRV_INTERRUPT_NEWER_VIEW, 1000);
    srv_frame_queue_tick(&flights, 1100);
    assert_true(first->cancel);
    struct srv_inflight *third = begin(3, A, 1100); /* before the first has ended */
    srv_frame_queue_interrupt(&flights, A, SRV_INTERRUPT_NEWER_VIEW, 1100);
    srv_frame_queue_pop(&flights, 1100);
    srv_frame_queue_tick(&flights, 1e9);
    assert_false(second->cancel);
    assert_false(third->cancel);
    srv_frame_queue_pop(&flights, 1e9); /* the other session has nothing to do with it */
    srv_frame_queue_tick(&flights, 1e9 + 101);
    assert_true(other->cancel);
    srv_frame_queue_interrupt(&flights, A, SRV_INTERRUPT_UNWANTED, 1e9); /* this holds for all */
    assert_true(third->cancel);
}

static void what_gives_way_does_so_when_something_moves(void **state) {
    (void)state;
    struct srv_inflight *moving = begin(0, A, 1000), *refinement = begin_refinement(1, A, 1000);
    struct srv_inflight *final = begin_refinement(2, B, 1000);
    jobs[2].is_refinement = false; /* for who wants final pictures alone: kept for ever */
    jobs[2].cancellable_from_ms = final->cancellable_from_ms = INFINITY;
    jobs[0].protected_ms = INFINITY;
    jobs[1].protected_ms = 500; /* its patience was at an end */
    srv_frame_queue_interrupt(&flights, 0, SRV_INTERRUPT_MOTION, 1001);
    assert_true(final->cancel);
    srv_frame_queue_tick(&flights, 1499);
    assert_false(moving->cancel || refinement->cancel);
    srv_frame_queue_pop(&flights, 1400);
    srv_frame_queue_tick(&flights, 1899);
    assert_false(refinement->cancel);
    srv_frame_queue_tick(&flights, 1900);
    assert_true(refinement->cancel);
}

static void anothers_picture_is_none_of_ones_business(void **state) {
    (void)state;
    struct srv_inflight *own = begin_refinement(0, A, 1000), *common = begin_refinement(1, A, 1000);
    jobs[0].targets[0].participant = jobs[1].targets[0].participant = 7;
    jobs[1].targets[1].participant = 8;
    jobs[0].target_count = 1;
    jobs[1].target_count = 2;
    srv_frame_queue_interrupt(&flights, 8, SRV_INTERRUPT_NEWER_REQUEST, 1001);
    assert_false(own->cancel || common->cancel);
    srv_frame_queue_interrupt(&flights, 7, SRV_INTERRUPT_NEWER_REQUEST, 1001);
    assert_true(own->cancel);
    assert_false(common->cancel);
}

static void all_can_be_cancelled(void **state) {
    (void)state;
    struct srv_inflight *f[2] = { begin(0, A, 0), begin_refinement(1, B, 0) };
    srv_frame_queue_cancel(&flights);
    assert_true(f[0]->cancel && f[1]->cancel);
}

static void a_sharp_picture_on_its_way_is_known(void **state) {
    (void)state;
    struct srv_render_job wanted = { .session = B, .is_sharp = true, .view.size = { 9, 8 } };
    assert_false(srv_frame_queue_has_sharp(&flights, &wanted));
    begin(0, A, 0);
    jobs[0].view.size[0] = 9;
    jobs[0].view.size[1] = 8;
    assert_false(srv_frame_queue_has_sharp(&flights, &wanted));
    jobs[0].is_sharp = true;
    assert_true(srv_frame_queue_has_sharp(&flights, &wanted));
    wanted.view.size[1] = 9;
    assert_false(srv_frame_queue_has_sharp(&flights, &wanted));
    wanted = jobs[0];
    wanted.view.background[0] = 1;
    assert_false(srv_frame_queue_has_sharp(&flights, &wanted));
    wanted = jobs[0];
    wanted.volume = &wanted;
    assert_false(srv_frame_queue_has_sharp(&flights, &wanted));
}

#define TEST(name) cmocka_unit_test_setup(name, reset)

int main(void) {
    const struct CMUnitTest tests[] = {
        TEST(they_end_in_the_order_in_which_they_began),
        TEST(a_moving_frame_is_kept_for_its_time),
        TEST(what_stands_still_grows_no_older),
        TEST(what_is_to_stand_still_and_runs_pays_half),
        TEST(the_clock_of_one_behind_starts_when_it_is_the_oldest),
        TEST(refinements_and_what_nobody_wants_go_at_once),
        TEST(of_two_moving_frames_one_is_finished),
        TEST(what_gives_way_does_so_when_something_moves),
        TEST(anothers_picture_is_none_of_ones_business),
        TEST(all_can_be_cancelled),
        TEST(a_sharp_picture_on_its_way_is_known),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
