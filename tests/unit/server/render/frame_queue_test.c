/* SPDX-License-Identifier: Apache-2.0
 *
 * The frame queue: order, cancellation and pauses.
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

static struct srv_frame_queue queue;
static struct srv_render_job jobs[4];

static int reset(void **state) {
    (void)state;
    memset(&queue, 0, sizeof queue);
    memset(jobs, 0, sizeof jobs);
    return 0;
}

/* Begins a moving frame that may be cancelled from 100 ms after now_ms on. */
static struct srv_inflight *begin(unsigned i, uint64_t session, double now_ms) {
    jobs[i].session = session;
    jobs[i].step = SRV_STEP_MOVING;
    jobs[i].cancellable_from_ms = now_ms + 100;
    return srv_frame_queue_begin(&queue, &jobs[i], now_ms);
}

static struct srv_inflight *begin_refinement(unsigned i, uint64_t session, double now_ms) {
    jobs[i] = (struct srv_render_job){ .session = session,
                                       .step = SRV_STEP_FINAL,
                                       .is_refinement = true };
    return srv_frame_queue_begin(&queue, &jobs[i], now_ms);
}

static void frames_end_in_the_order_in_which_they_began(void **state) {
    (void)state;
    assert_null(srv_frame_queue_oldest(&queue));
    begin(0, A, 0);
    for (unsigned i = 1; i < 10; i++) { /* wraps around the ring */
        begin(i % 4, A, 0);
        assert_ptr_equal(srv_frame_queue_oldest(&queue)->job, &jobs[(i - 1) % 4]);
        srv_frame_queue_pop(&queue, 0);
    }
    begin(2, B, 0);
    srv_frame_queue_undo(&queue);
    assert_ptr_equal(srv_frame_queue_oldest(&queue)->job, &jobs[1]);
    srv_frame_queue_pop(&queue, 0);
    assert_null(srv_frame_queue_oldest(&queue));
}

static void an_outdated_moving_frame_is_cancelled_when_its_time_is_over(void **state) {
    (void)state;
    struct srv_inflight *f = begin(0, A, 1000);
    srv_frame_queue_tick(&queue, 5000); /* no newer view waits */
    assert_false(f->cancel);
    srv_frame_queue_interrupt(&queue, B, SRV_INTERRUPT_NEWER_VIEW, 5000); /* of another session */
    assert_false(f->cancel);
    srv_frame_queue_interrupt(&queue, A, SRV_INTERRUPT_NEWER_VIEW, 1099);
    assert_false(f->cancel);
    srv_frame_queue_tick(&queue, 1100);
    assert_true(f->cancel);
}

static void a_hand_that_stops_cancels_what_ends_with_the_motion(void **state) {
    (void)state;
    struct srv_inflight *other = begin(0, B, 1000), *own = begin(1, A, 1000),
                        *kept = begin(2, A, 1000);
    jobs[0].ends_with_motion = jobs[1].ends_with_motion = true;
    srv_frame_queue_interrupt(&queue, A, SRV_INTERRUPT_STOPPED, 1001);
    assert_false(other->cancel);
    assert_true(own->cancel);
    assert_false(kept->cancel);
}

static void a_paused_frame_does_not_age(void **state) {
    (void)state;
    struct srv_inflight *f = begin(0, A, 1000);
    f->job->order = 7;
    srv_frame_queue_interrupt(&queue, A, SRV_INTERRUPT_NEWER_VIEW, 1010);
    srv_frame_queue_pause(&queue, 6, 1020); /* another job */
    assert_false(f->pause.requested);
    srv_frame_queue_pause(&queue, 7, 1020);
    assert_true(f->pause.requested);
    assert_float_equal(srv_inflight_paused(f, 1020), 0, 0);
    assert_float_equal(srv_inflight_age_ms(f, 1500), 20, 0);
    srv_frame_queue_tick(&queue, 5000);
    srv_frame_queue_resume(&queue, 6, 5000);
    assert_true(f->pause.requested);
    assert_false(f->cancel);
    srv_frame_queue_resume(&queue, 7, 5020);
    assert_false(f->pause.requested);
    assert_float_equal(f->pause.paused_ms, 4000, 0);
    assert_float_equal(srv_inflight_age_ms(f, 5030), 30, 0);
    srv_frame_queue_pause(&queue, 7, 5050);
    srv_inflight_paused(f, 5050);
    srv_frame_queue_resume(&queue, 7, 6050);
    srv_frame_queue_tick(&queue, 6099);
    assert_false(f->cancel);
    srv_frame_queue_tick(&queue, 6100);
    assert_true(f->cancel);
    srv_frame_queue_pause(&queue, 7, 7000);
    srv_frame_queue_pop(&queue, 7000);
    f = begin(1, A, 7000); /* in every place of the ring */
    for (int i = 0; i < SP_IN_FLIGHT_MAX; i++) {
        srv_frame_queue_pop(&queue, 7000);
        f = begin(1, A, 7000);
        assert_false(f->pause.requested);
        assert_float_equal(f->pause.paused_ms, 0, 0);
        assert_float_equal(f->pause_began_ms, 0, 0);
    }
    srv_frame_queue_pop(&queue, 7000);
    srv_frame_queue_pause(&queue, 0, 7000); /* the queue is empty */
    srv_frame_queue_resume(&queue, 0, 7000);
}

static void a_frame_that_has_not_stopped_yet_is_charged_half(void **state) {
    (void)state;
    struct srv_inflight *f = begin(0, A, 1000);
    f->job->order = 7;
    srv_frame_queue_pause(&queue, 7, 1010);
    assert_float_equal(srv_inflight_age_ms(f, 1014), 12, 0);
    assert_float_equal(srv_inflight_paused(f, 1014), 2, 0);
    assert_float_equal(srv_inflight_paused(f, 1018), 4, 0); /* its second thread */
    assert_float_equal(srv_inflight_age_ms(f, 1050), 14, 0);
    srv_frame_queue_resume(&queue, 7, 1050);
    assert_float_equal(f->pause.paused_ms, 36, 0);
    assert_float_equal(srv_inflight_age_ms(f, 1051), 15, 0);
    srv_frame_queue_pause(&queue, 7, 1060); /* again; no thread stops in time */
    srv_frame_queue_resume(&queue, 7, 1070);
    assert_float_equal(f->pause.paused_ms, 41, 0);
}

static void the_time_of_a_frame_starts_when_it_is_the_oldest(void **state) {
    (void)state;
    begin(0, B, 1000);
    struct srv_inflight *f = begin(1, A, 1010);
    srv_frame_queue_interrupt(&queue, A, SRV_INTERRUPT_NEWER_VIEW, 1020);
    srv_frame_queue_tick(&queue, 9000);
    assert_false(f->cancel);
    srv_frame_queue_pop(&queue, 9000);
    srv_frame_queue_tick(&queue, 9099);
    assert_false(f->cancel);
    srv_frame_queue_tick(&queue, 9101);
    assert_true(f->cancel);
}

static void refinements_and_unwanted_frames_are_cancelled_at_once(void **state) {
    (void)state;
    struct srv_inflight *first = begin(0, A, 1000), *second = begin_refinement(1, A, 1000);
    struct srv_inflight *other = begin(2, B, 1000);
    srv_frame_queue_interrupt(&queue, A, SRV_INTERRUPT_NEWER_VIEW, 1001);
    assert_false(first->cancel);
    assert_true(second->cancel);
    srv_frame_queue_interrupt(&queue, B, SRV_INTERRUPT_UNWANTED, 1002);
    assert_true(other->cancel);
    srv_frame_queue_pop(&queue, 1003);
    srv_frame_queue_pop(&queue, 1003); /* popping grants cancelled frames no time */
    srv_frame_queue_pop(&queue, 1003);
}

static void one_of_two_moving_frames_is_finished(void **state) {
    (void)state;
    struct srv_inflight *first = begin(0, A, 1000), *second = begin(1, A, 1000);
    struct srv_inflight *other = begin(2, B, 1000);
    srv_frame_queue_interrupt(&queue, A, SRV_INTERRUPT_NEWER_VIEW, 1000);
    srv_frame_queue_interrupt(&queue, B, SRV_INTERRUPT_NEWER_VIEW, 1000);
    srv_frame_queue_tick(&queue, 1100);
    assert_true(first->cancel);
    struct srv_inflight *third = begin(3, A, 1100); /* before the first frame has ended */
    srv_frame_queue_interrupt(&queue, A, SRV_INTERRUPT_NEWER_VIEW, 1100);
    srv_frame_queue_pop(&queue, 1100);
    srv_frame_queue_tick(&queue, 1e9);
    assert_false(second->cancel);
    assert_false(third->cancel);
    srv_frame_queue_pop(&queue, 1e9); /* the other session is not protected */
    srv_frame_queue_tick(&queue, 1e9 + 101);
    assert_true(other->cancel);
    srv_frame_queue_interrupt(&queue, A, SRV_INTERRUPT_UNWANTED,
                              1e9); /* unwanted: protection does not count */
    assert_true(third->cancel);
}

static void frames_that_yield_are_cancelled_by_motion(void **state) {
    (void)state;
    struct srv_inflight *moving = begin(0, A, 1000), *refinement = begin_refinement(1, A, 1000);
    struct srv_inflight *final = begin_refinement(2, B, 1000);
    jobs[2].is_refinement = false; /* for clients that want final frames only */
    jobs[2].cancellable_from_ms = final->cancellable_from_ms = INFINITY;
    jobs[0].protected_ms = INFINITY;
    jobs[1].protected_ms = 500; /* it has waited long enough to be protected */
    srv_frame_queue_interrupt(&queue, 0, SRV_INTERRUPT_MOTION, 1001);
    assert_true(final->cancel);
    srv_frame_queue_tick(&queue, 1499);
    assert_false(moving->cancel);
    assert_false(refinement->cancel);
    srv_frame_queue_pop(&queue, 1400);
    srv_frame_queue_tick(&queue, 1899);
    assert_false(refinement->cancel);
    srv_frame_queue_tick(&queue, 1900);
    assert_true(refinement->cancel);
}

static void a_newer_request_cancels_only_frames_of_its_participant(void **state) {
    (void)state;
    struct srv_inflight *own = begin_refinement(0, A, 1000), *common = begin_refinement(1, A, 1000);
    jobs[0].targets[0].participant = jobs[1].targets[0].participant = 7;
    jobs[1].targets[1].participant = 8;
    jobs[0].target_count = 1;
    jobs[1].target_count = 2;
    srv_frame_queue_interrupt(&queue, 8, SRV_INTERRUPT_NEWER_REQUEST, 1001);
    assert_false(own->cancel);
    assert_false(common->cancel);
    srv_frame_queue_interrupt(&queue, 7, SRV_INTERRUPT_NEWER_REQUEST, 1001);
    assert_true(own->cancel);
    assert_false(common->cancel);
}

static void all_frames_can_be_cancelled(void **state) {
    (void)state;
    struct srv_inflight *f[2] = { begin(0, A, 0), begin_refinement(1, B, 0) };
    srv_frame_queue_cancel(&queue);
    assert_true(f[0]->cancel);
    assert_true(f[1]->cancel);
}

static void a_final_frame_in_flight_is_found(void **state) {
    (void)state;
    struct srv_render_job wanted = { .session = B, .is_sharp = true, .view.size = { 9, 8 } };
    assert_false(srv_frame_queue_has_sharp(&queue, &wanted));
    begin(0, A, 0);
    jobs[0].view.size[0] = 9;
    jobs[0].view.size[1] = 8;
    assert_false(srv_frame_queue_has_sharp(&queue, &wanted));
    jobs[0].is_sharp = true;
    assert_true(srv_frame_queue_has_sharp(&queue, &wanted));
    wanted.view.size[1] = 9;
    assert_false(srv_frame_queue_has_sharp(&queue, &wanted));
    wanted = jobs[0];
    wanted.view.background[0] = 1;
    assert_false(srv_frame_queue_has_sharp(&queue, &wanted));
    wanted = jobs[0];
    wanted.volume = (struct srv_volume *)&wanted; /* another volume */
    assert_false(srv_frame_queue_has_sharp(&queue, &wanted));
}

#define TEST(name) cmocka_unit_test_setup(name, reset)

int main(void) {
    const struct CMUnitTest tests[] = {
        TEST(frames_end_in_the_order_in_which_they_began),
        TEST(an_outdated_moving_frame_is_cancelled_when_its_time_is_over),
        TEST(a_hand_that_stops_cancels_what_ends_with_the_motion),
        TEST(a_paused_frame_does_not_age),
        TEST(a_frame_that_has_not_stopped_yet_is_charged_half),
        TEST(the_time_of_a_frame_starts_when_it_is_the_oldest),
        TEST(refinements_and_unwanted_frames_are_cancelled_at_once),
        TEST(one_of_two_moving_frames_is_finished),
        TEST(frames_that_yield_are_cancelled_by_motion),
        TEST(a_newer_request_cancels_only_frames_of_its_participant),
        TEST(all_frames_can_be_cancelled),
        TEST(a_final_frame_in_flight_is_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
