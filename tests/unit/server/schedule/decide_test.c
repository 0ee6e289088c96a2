/* SPDX-License-Identifier: Apache-2.0
 *
 * The scheduler's decision for given candidates, in virtual time.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "schedule/decide.h"
#include "support/compare.h"

/* At 1000 ms: a moving view, 25 frames per second, a frame is due. */
static struct srv_demand moving(void) {
    return (struct srv_demand){ .wants_frame = true,
                                .is_newer = true,
                                .is_progressive = true,
                                .has_slow_slot = true,
                                .max_fps = 25,
                                .next_frame_ms = 990,
                                .behind_ms = 970,
                                .rest_at_ms = 1200,
                                .sharp_ms = 400 };
}

static void a_moving_view_gets_a_frame_that_motion_does_not_cancel(void **state) {
    (void)state;
    const struct srv_demand demand = moving();
    const struct srv_frame_request request = srv_decide_request(&demand, 1000);
    assert_true(request.is_wanted);
    assert_int_equal(request.step, SRV_STEP_MOVING);
    assert_int_equal(request.rank, SRV_RANK_INTERACTION);
    assert_false(request.is_refinement);
    assert_true(isinf(request.protected_ms));
    assert_float_equal(request.deadline_ms, 990 + 40, 1e-9);
}

static void a_closed_window_waits_for_an_event(void **state) {
    (void)state;
    struct srv_demand demand = moving();
    demand.wants_frame = false;
    const struct srv_frame_request request = srv_decide_request(&demand, 1000);
    assert_false(request.is_wanted);
    assert_true(isinf(request.in_ms));
}

static void the_frame_rate_and_the_rest_time_delay_a_frame(void **state) {
    (void)state;
    struct srv_demand demand = moving();
    demand.next_frame_ms = 1007;
    assert_float_equal(srv_decide_request(&demand, 1000).in_ms, 7, 1e-9);
    demand.is_newer = false;
    demand.sharp_ms = 0; /* not known */
    assert_float_equal(srv_decide_request(&demand, 1000).in_ms, 200, 1e-9);
}

static void a_refinement_begins_before_the_view_rests(void **state) {
    (void)state;
    struct srv_demand demand = moving();
    demand.is_newer = false;
    demand.settles_at_ms = 1030;
    demand.sharp_ms = 150; /* of the 200 until the view rests */
    assert_float_equal(srv_decide_request(&demand, 1000).in_ms, 50, 1e-9);
    demand.sharp_ms = 250;
    assert_float_equal(srv_decide_request(&demand, 1000).in_ms, 30, 1e-9);
    demand.settles_at_ms = 1000;
    struct srv_frame_request request = srv_decide_request(&demand, 1000);
    assert_int_equal(request.step, SRV_STEP_FINAL);
    assert_true(request.is_wanted && request.is_refinement);
    demand.needs_intermediate = true;
    demand.sharp_ms = 0;
    request = srv_decide_request(&demand, 1000);
    assert_int_equal(request.step, SRV_STEP_INTERMEDIATE);
    assert_true(request.is_wanted && request.is_refinement);
    assert_int_equal(request.rank, SRV_RANK_REFINEMENT);
    demand.is_newer = true; /* and not alone: others wait for moving frames only */
    assert_int_equal(srv_decide_request(&demand, 1000).step, SRV_STEP_MOVING);
    demand.is_alone = true;
    assert_int_equal(srv_decide_request(&demand, 1000).step, SRV_STEP_INTERMEDIATE);
    assert_int_equal(srv_decide_request(&demand, 999).step, SRV_STEP_MOVING);
    demand.needs_intermediate = false;
    demand.has_frame = true;
    demand.sharp_ms = 220; /* ready after the view rests, and soon */
    assert_int_equal(srv_decide_request(&demand, 1000).step, SRV_STEP_FINAL);
    demand.sharp_ms = 180;
    assert_int_equal(srv_decide_request(&demand, 1000).step, SRV_STEP_MOVING);
    demand.sharp_ms = 300;
    assert_int_equal(srv_decide_request(&demand, 1000).step, SRV_STEP_MOVING);
    demand.needs_intermediate = true;
    demand.is_newer = false;
    demand.rest_at_ms = demand.settles_at_ms = INFINITY; /* it plays, or waits for its volume */
    assert_false(srv_decide_request(&demand, 1000).is_wanted);
}

static void a_hand_with_gaps_settles_later(void **state) {
    (void)state;
    assert_float_equal(srv_decide_settle_ms(0, 120), 30, 1e-9);
    assert_float_equal(srv_decide_settle_ms(1000 / 60., 120), 30, 1e-9);
    assert_float_equal(srv_decide_settle_ms(40, 120), 60, 1e-9);
    assert_float_equal(srv_decide_settle_ms(100, 120), 120, 1e-9);
    assert_float_equal(srv_decide_settle_ms(0, 10), 10, 1e-9);
}

static void a_view_at_rest_gets_refinements(void **state) {
    (void)state;
    struct srv_demand demand = moving();
    demand.is_newer = false;
    demand.rest_at_ms = 900;
    struct srv_frame_request request = srv_decide_request(&demand, 1000);
    assert_int_equal(request.step, SRV_STEP_FINAL);
    assert_int_equal(request.rank, SRV_RANK_REFINEMENT);
    assert_true(request.is_refinement);
    demand.needs_intermediate = true;
    request = srv_decide_request(&demand, 1000);
    assert_int_equal(request.step, SRV_STEP_INTERMEDIATE);
}

static void a_first_frame_is_sharp_at_once_if_that_is_fast(void **state) {
    (void)state;
    struct srv_demand demand = moving();
    demand.rest_at_ms = 900;
    assert_int_equal(srv_decide_request(&demand, 1000).step, SRV_STEP_MOVING);
    demand.sharp_ms = 100;
    assert_int_equal(srv_decide_request(&demand, 1000).step, SRV_STEP_FINAL);
    demand.sharp_ms = 0; /* not known */
    assert_int_equal(srv_decide_request(&demand, 1000).step, SRV_STEP_MOVING);
}

static void the_starvation_limit_raises_the_rank(void **state) {
    (void)state;
    struct srv_demand demand = moving();
    demand.is_newer = false;
    demand.rest_at_ms = 900;
    demand.waited_ms = 20 * 400 - 1;
    assert_int_equal(srv_decide_request(&demand, 1000).rank, SRV_RANK_REFINEMENT);
    demand.waited_ms = 20 * 400;
    struct srv_frame_request request = srv_decide_request(&demand, 1000);
    assert_int_equal(request.rank, SRV_RANK_INTERACTION);
    assert_float_equal(request.protected_ms, 800, 1e-9);
    demand.spent_ms = 300; /* the expected time is at least twice that */
    assert_int_equal(srv_decide_request(&demand, 1000).rank, SRV_RANK_REFINEMENT);
}

static void a_frame_that_is_slow_to_encode_needs_a_slot(void **state) {
    (void)state;
    struct srv_demand demand = moving();
    demand.is_slow[SRV_STEP_MOVING] = true;
    demand.has_slow_slot = false;
    assert_false(srv_decide_request(&demand, 1000).is_wanted);
    demand.has_slow_slot = true;
    const struct srv_frame_request request = srv_decide_request(&demand, 1000);
    assert_true(request.is_wanted);
    assert_true(request.is_slow_to_encode);
}

static void rank_then_virtual_start_then_order_decide_in_a_session(void **state) {
    (void)state;
    const struct srv_candidate candidates[] = {
        { .rank = SRV_RANK_REFINEMENT, .start_ms = 0 },
        { .rank = SRV_RANK_INTERACTION, .start_ms = 20, .newest_order = 1 },
        { .rank = SRV_RANK_INTERACTION, .start_ms = 10, .newest_order = 5 },
        { .rank = SRV_RANK_INTERACTION, .start_ms = 10, .newest_order = 4 }
    };
    assert_int_equal(srv_decide_participant(candidates, 4), 3);
    assert_int_equal(srv_decide_participant(candidates, 3), 2);
    assert_int_equal(srv_decide_participant(candidates, 1), 0);
    assert_int_equal(srv_decide_participant(candidates, 0), SRV_NO_CANDIDATE);
}

static void the_earliest_deadline_of_the_eligible_sessions_goes_first(void **state) {
    (void)state;
    const struct srv_candidate candidates[] = {
        { .rank = SRV_RANK_INTERACTION, .start_ms = 100, .deadline_ms = 1 }, /* over the mean */
        { .rank = SRV_RANK_INTERACTION, .start_ms = 10, .deadline_ms = 30 },
        { .rank = SRV_RANK_INTERACTION, .start_ms = 40, .deadline_ms = 20 },
        { .rank = SRV_RANK_REFINEMENT, .start_ms = 0, .deadline_ms = 0 }
    };
    const struct srv_decision decision = srv_decide_session(candidates, 4, 5);
    assert_int_equal(decision.chosen, 2);
    assert_float_equal(decision.clock_ms, 10, 1e-9);
    assert_int_equal(srv_decide_session(candidates, 0, 5).chosen, SRV_NO_CANDIDATE);
    assert_float_equal(srv_decide_session(candidates, 0, 5).clock_ms, 5, 1e-9);
}

static void the_least_virtual_start_of_the_refinements_goes_first(void **state) {
    (void)state;
    const struct srv_candidate candidates[] = {
        { .rank = SRV_RANK_REFINEMENT, .start_ms = 7, .deadline_ms = 1 },
        { .rank = SRV_RANK_REFINEMENT, .start_ms = 5, .deadline_ms = 2 },
        { .rank = SRV_RANK_REFINEMENT, .start_ms = 30, .deadline_ms = 0 }
    };
    assert_int_equal(srv_decide_session(candidates, 3, 0).chosen, 1);
}

static void a_refinement_waits_until_other_views_are_quiet(void **state) {
    (void)state;
    assert_float_equal(srv_decide_quiet_ms(false, 0, 1000), 0, 1e-9);
    assert_float_equal(srv_decide_quiet_ms(true, 0, 1000), SRV_QUIET_MS, 1e-9);
    assert_float_equal(srv_decide_quiet_ms(false, 940, 1000), 40, 1e-9);
    assert_compare(srv_decide_quiet_ms(false, 890, 1000), <=, 0);
}

static void only_short_frames_preempt(void **state) {
    (void)state;
    assert_true(srv_decide_is_short(50, 300, 100));
    assert_false(srv_decide_is_short(70, 300, 100));   /* longer than a moving frame should be */
    assert_true(srv_decide_is_short(70, 1000, 100));   /* but a small part of what is left */
    assert_false(srv_decide_is_short(50, 120, 100));   /* the running job ends sooner */
    assert_true(srv_decide_is_short(50, 80, 100));     /* late: assumed to be half done */
    assert_true(srv_decide_is_short(60, INFINITY, 0)); /* nothing is known of the running job */
    assert_false(srv_decide_is_short(INFINITY, INFINITY, 100));
}

static void the_candidate_that_is_ahead_of_the_running_job_waits(void **state) {
    (void)state;
    const struct srv_candidate candidates[] = {
        { .rank = SRV_RANK_INTERACTION, .deadline_ms = 1, .lead_ms = 12 },
        { .rank = SRV_RANK_INTERACTION, .deadline_ms = 9, .lead_ms = -1 },
        { .rank = SRV_RANK_INTERACTION, .deadline_ms = 8, .lead_ms = 0 }
    };
    double wait_ms = 1000;
    assert_int_equal(srv_decide_preemption(candidates, 3, &wait_ms), 2);
    assert_float_equal(wait_ms, 12, 1e-9);
    assert_int_equal(srv_decide_preemption(candidates, 1, &wait_ms), SRV_NO_CANDIDATE);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_moving_view_gets_a_frame_that_motion_does_not_cancel),
        cmocka_unit_test(a_closed_window_waits_for_an_event),
        cmocka_unit_test(the_frame_rate_and_the_rest_time_delay_a_frame),
        cmocka_unit_test(a_refinement_begins_before_the_view_rests),
        cmocka_unit_test(a_hand_with_gaps_settles_later),
        cmocka_unit_test(a_view_at_rest_gets_refinements),
        cmocka_unit_test(a_first_frame_is_sharp_at_once_if_that_is_fast),
        cmocka_unit_test(the_starvation_limit_raises_the_rank),
        cmocka_unit_test(a_frame_that_is_slow_to_encode_needs_a_slot),
        cmocka_unit_test(rank_then_virtual_start_then_order_decide_in_a_session),
        cmocka_unit_test(the_earliest_deadline_of_the_eligible_sessions_goes_first),
        cmocka_unit_test(the_least_virtual_start_of_the_refinements_goes_first),
        cmocka_unit_test(a_refinement_waits_until_other_views_are_quiet),
        cmocka_unit_test(only_short_frames_preempt),
        cmocka_unit_test(the_candidate_that_is_ahead_of_the_running_job_waits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
