/* SPDX-License-Identifier: Apache-2.0
 *
 * The frame rate of a participant, in virtual time: how many frames it gets, and when.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <cmocka.h>

#include "support/compare.h"
#include "unit/server/schedule/simulation.h"

static const int rates[] = { 15, 24, 30, 45, 60, 90, 120 };

/* Returns the i-th of evenly spread numbers in [0, 1): multiples of the golden ratio. */
static double spread(unsigned i) {
    return fmod(i * 0.6180339887498949, 1);
}

/* Joins a client that sends `per_second` changes and gets at most `max_fps` frames per second. */
static struct sim_client *join(struct simulation *s, unsigned i, double per_second, int max_fps) {
    char settings[64];
    snprintf(settings, sizeof settings, "{\"max_fps\":%d,\"size\":[512,512]}", max_fps);
    return sim_join(s, i, s->f->id, per_second > 0 ? 1000 / per_second : 0, settings);
}

static void leave(struct simulation *s, struct sim_client *c) {
    srv_hub_leave(s->f->hub, &c->participant, s->now_ms);
}

/* Each change is delayed by up to an interval, at random. */
static void changes_that_come_as_often_as_frames_are_allowed_never_wait(void **state) {
    struct simulation *s = *state;
    double wait_ms;
    for (size_t k = 0; k < sizeof rates / sizeof *rates; k++) {
        struct sim_client *c = join(s, 0, 0, rates[k]);
        sim_run(s, 3000);
        double start_ms = s->now_ms, interval_ms = 1000.0 / rates[k];
        for (unsigned i = 1; i <= 200; i++) {
            s->now_ms = start_ms + (i + 0.99 * spread(i)) * interval_ms;
            sim_turn(s, c);
            assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &s->job, &wait_ms));
            sim_deliver(s, &s->job, 0);
        }
        leave(s, c);
        s->now_ms += 1000;
    }
}

static void the_frame_rate_limits_changes_that_come_faster(void **state) {
    struct simulation *s = *state;
    s->fixed_ms = s->mpx_ms = 0.1;
    for (size_t k = 0; k < sizeof rates / sizeof *rates; k++) {
        struct sim_client *c = join(s, 0, 500, rates[k]);
        sim_run(s, 3000);
        sim_reset(s);
        sim_run(s, 10000);
        assert_compare(c->frames, >=, 10 * rates[k] - 1);
        assert_compare(c->frames, <=, 10 * rates[k] + 1);
        assert_compare(c->gap_ms, <, 1000.0 / rates[k] + 2.1); /* a change comes every 2 ms */
        leave(s, c);
    }
}

static void a_pause_allows_one_more_frame(void **state) {
    struct simulation *s = *state;
    s->fixed_ms = s->mpx_ms = 0.1;
    struct sim_client *c = join(s, 0, 0, 10);
    sim_run(s, 5000);
    sim_reset(s);
    c->period_ms = 1;
    c->next_ms = s->now_ms;
    sim_run(s, 95);
    assert_int_equal(c->frames, 2);
    sim_run(s, 10);
    assert_int_equal(c->frames, 3);
}

/* For frames that take from next to nothing to longer than the interval of the changes. */
static void a_higher_frame_rate_never_gives_fewer_frames(void **state) {
    struct simulation *s = *state;
    static const double times_ms[] = { 0.1, 5, 10, 14, 17, 25 };
    s->mpx_ms = 0;
    for (size_t t = 0; t < sizeof times_ms / sizeof *times_ms; t++) {
        unsigned before = 0;
        s->fixed_ms = times_ms[t];
        for (size_t k = 0; k < sizeof rates / sizeof *rates; k++) {
            struct sim_client *c = join(s, 0, 60, rates[k]);
            sim_run(s, 3000);
            sim_reset(s);
            sim_run(s, 10000);
            assert_compare(c->frames + 1, >=, before);
            assert_compare(c->frames + 3, >=,
                           10 * fmin(fmin(rates[k], 60), floor(1000 / times_ms[t])));
            before = c->frames;
            leave(s, c);
        }
    }
}

/* The slower one takes part of the frames of the faster one, and never causes one. */
static void participants_share_all_frames_at_any_rates(void **state) {
    struct simulation *s = *state;
    s->fixed_ms = s->mpx_ms = 0.1;
    for (size_t k = 0; k < sizeof rates / sizeof *rates; k++)
        for (size_t l = 0; l <= k; l++) {
            struct sim_client *fast = join(s, 0, 500, rates[k]);
            sim_run(s, 1000 + 1000 * spread((unsigned)(10 * k + l)));
            struct sim_client *slow = join(s, 1, 0, rates[l]);
            sim_run(s, 3000);
            sim_reset(s);
            sim_run(s, 10000);
            assert_compare(fabs(fast->frames - 10.0 * rates[k]), <=, 1);
            assert_compare(fabs(slow->frames - 10.0 * rates[l]), <=, 2);
            assert_compare(s->jobs, <=, 10 * rates[k] + 1);
            leave(s, slow);
            leave(s, fast);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(changes_that_come_as_often_as_frames_are_allowed_never_wait,
                                        sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(the_frame_rate_limits_changes_that_come_faster, sim_set_up,
                                        sim_tear_down),
        cmocka_unit_test_setup_teardown(a_pause_allows_one_more_frame, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(a_higher_frame_rate_never_gives_fewer_frames, sim_set_up,
                                        sim_tear_down),
        cmocka_unit_test_setup_teardown(participants_share_all_frames_at_any_rates, sim_set_up,
                                        sim_tear_down),
    };
    return cmocka_run_group_tests_name("schedule/pacing", tests, NULL, NULL);
}
