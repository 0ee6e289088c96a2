/* SPDX-License-Identifier: Apache-2.0
 *
 * Short frames that preempt a long one, in virtual time.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/compare.h"
#include "unit/server/schedule/simulation.h"

/* Every frame of the hog is long, because each edit changes what takes long to classify. */
static void short_frames_preempt_long_ones(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct sim_client *moving = sim_join(s, 0, s->f->id, 33, "{\"size\":[256,256]}");
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 10000);
    unsigned alone = moving->frames;
    sim_session(s, id);
    s->hog = sim_join(s, 1, id, 33, "{\"size\":[512,512]}");
    s->once_ms = 280;
    sim_reset(s);
    sim_run(s, 10000);
    assert_in_range(moving->frames, 1, alone / 3); /* the two clients alternate */
    unsigned frames = s->hog->frames;
    s->has_preemption = true;
    sim_reset(s);
    sim_run(s, 10000);
    assert_in_range(moving->frames, alone * 95 / 100, alone + 2);
    assert_in_range(s->hog->frames, frames * 80 / 100,
                    frames); /* the hog loses only the time of the short frames */
}

/* The same for two participants of one session. */
static void short_frames_of_the_same_session_preempt_long_ones(void **state) {
    struct simulation *s = *state;
    struct sim_client *driver = sim_join(s, 0, s->f->id, 33, "{\"size\":[256,256]}");
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 10000);
    unsigned alone = driver->frames;
    s->hog = sim_join(s, 1, s->f->id, 0, "{\"size\":[512,512]}");
    s->once_ms = 280;
    s->has_preemption = true;
    sim_run(s, 1000);
    sim_reset(s);
    sim_run(s, 10000);
    assert_in_range(driver->frames, alone * 95 / 100, alone + 1);
    assert_compare(s->hog->frames, >, 10);
}

/* Two sessions that always want frames each receive half of the time, however it is divided. */
static void a_preempted_session_receives_its_fair_share(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct sim_client *many = sim_join(s, 0, s->f->id, 8, "{\"max_fps\":120,\"size\":[512,512]}");
    sim_run(s, 2000);
    sim_session(s, id);
    struct sim_client *hog = sim_join(s, 1, id, 8, "{\"max_fps\":120,\"size\":[512,512]}");
    s->hog = hog;
    s->once_ms = 280;
    s->has_preemption = true;
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 20000);
    double hog_ms = hog->frames * 280.0;
    assert_compare(hog_ms, >, 0.4 * 20000);
    assert_compare(hog_ms, <, 0.6 * 20000);
    assert_compare(many->frames, >, 3 * hog->frames);
}

static void update_tf(struct simulation *s, struct sim_client *c) {
    sim_send(s, c, "view.update",
             "{\"seq\":99,\"patch\":{\"transfer_function\":{\"points\":["
             "{\"value\":1,\"color\":[1,1,1],\"opacity\":0.1}]}}}");
}

static void rules_for_preempting_a_long_frame(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct srv_render_job job, before;
    double wait_ms;
    sim_session(s, id);
    struct sim_client *hog = sim_join(s, 0, s->f->id, 0, "{\"size\":[512,512]}");
    sim_run(s, 3000);
    sim_turn(s, hog);
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &job, &wait_ms));
    struct sim_client *other = sim_join(s, 1, id, 0, "{\"size\":[256,256]}");
    struct srv_running_job running;
#define BEFORE(ms)                                                                                 \
    (running = sim_running_job(&job, ms), running.expected_ms = INFINITY,                          \
     srv_schedule_next_short(s->f->schedule, &running, s->now_ms, &before, &wait_ms))
    assert_true(
        BEFORE(1e6)); /* a new client gets its first frame at once, though its time is unknown */
    srv_schedule_cancelled(s->f->schedule, &before, 0);
    srv_schedule_cancelled(s->f->schedule, &job, 0);
    sim_run(s, 3000);
    sim_turn(s, hog);
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &job, &wait_ms));
    assert_false(BEFORE(1e6)); /* the other session wants no frame */
    sim_turn(s, hog);
    assert_false(BEFORE(1e6)); /* a newer view of the running session itself does not preempt */
    sim_turn(s, other);
    assert_true(BEFORE(0));
    assert_int_not_equal(before.session, job.session);
    assert_false(before.is_refinement);
    sim_deliver(s, &before, 100); /* more than expected */
    s->now_ms += 50;
    sim_turn(s, other);
    assert_false(BEFORE(60)); /* the other session has received more */
    assert_compare(wait_ms, >, 0);
    assert_compare(wait_ms, <=, 40);
    assert_true(BEFORE(101));
    double takes_ms = before.expected_ms;
    assert_compare(takes_ms, >, 4);
    assert_compare(takes_ms, <, 40);
    srv_schedule_cancelled(s->f->schedule, &before, 0);
    const struct {
        double expected_ms;
        bool may;
    } cases[] = {
        { 1000 + takes_ms / 2, false }, /* the running frame ends sooner */
        { 1000 + 10 * takes_ms, true },
        { 20, true }, /* the expectation was wrong: it runs for 1000 ms already */
    };
    for (int i = 0; i < 3; i++) {
        s->now_ms += 50; /* the frame rate allows another frame */
        running.drawn_ms = 1000;
        running.expected_ms = cases[i].expected_ms;
        sim_turn(s, other);
        assert_int_equal(
            srv_schedule_next_short(s->f->schedule, &running, s->now_ms, &before, &wait_ms),
            cases[i].may);
        if (cases[i].may)
            srv_schedule_cancelled(s->f->schedule, &before, 0);
    }
    update_tf(s, other);
    assert_false(BEFORE(1e6)); /* its next frame begins with classification */
#undef BEFORE
    srv_schedule_cancelled(s->f->schedule, &job, 0);
}

static bool next_before(struct simulation *s, double drawn_ms, struct srv_render_job *before) {
    double wait_ms;
    struct srv_running_job running = sim_running_job(&s->job, drawn_ms);
    running.start_ms = 1e9; /* it has received more than any other */
    running.expected_ms = INFINITY;
    return srv_schedule_next_short(s->f->schedule, &running, s->now_ms, before, &wait_ms);
}

/* The time of the last frame does not decide: the next one has less detail. */
static void the_expected_time_of_the_next_frame_decides_if_it_is_short(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct srv_render_job before;
    double wait_ms, slowest_ms = 0;
    sim_session(s, id);
    struct sim_client *hog = sim_join(s, 0, s->f->id, 0, "{\"size\":[512,512]}");
    struct sim_client *other = sim_join(s, 1, id, 0, "{\"size\":[512,512]}");
    sim_run(s, 3000);
    sim_turn(s, hog);
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &s->job, &wait_ms));
    s->mpx_ms *= 20; /* the machine is busy */
    for (int i = 0; i < 20; i++) {
        s->now_ms += 50;
        sim_turn(s, other);
        assert_true(next_before(s, 600, &before));
        slowest_ms = fmax(slowest_ms, sim_duration(s, &before));
        sim_deliver(s, &before, sim_duration(s, &before));
    }
    assert_compare(slowest_ms, >, SRV_QUALITY_BUDGET_MS);
    assert_compare(sim_duration(s, &before), <, SRV_QUALITY_BUDGET_MS);
    for (int i = 0; i < 20; i++) { /* and busier, at every level of detail */
        s->now_ms += 50;
        sim_turn(s, other);
        assert_true(next_before(s, 2100, &before));
        sim_deliver(s, &before, 150);
    }
    s->now_ms += 50;
    sim_turn(s, other);
    assert_false(next_before(s, 600, &before)); /* a quarter of the running frame is not short */
    assert_true(next_before(s, 2100, &before));
    srv_schedule_cancelled(s->f->schedule, &before, 0);
    srv_schedule_cancelled(s->f->schedule, &s->job, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, sim_set_up, sim_tear_down)
        TEST(short_frames_preempt_long_ones),
        TEST(short_frames_of_the_same_session_preempt_long_ones),
        TEST(a_preempted_session_receives_its_fair_share),
        TEST(rules_for_preempting_a_long_frame),
        TEST(the_expected_time_of_the_next_frame_decides_if_it_is_short),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
