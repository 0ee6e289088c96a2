/* SPDX-License-Identifier: Apache-2.0
 *
 * Moving frames for the camera that the client will probably show (`predict` of stream.configure):
 * who gets them, and how far they are ahead. In virtual time.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <cmocka.h>

#include "schedule/state.h"
#include "session/session.h"
#include "support/compare.h"
#include "unit/server/session/hub_fixture.h"

enum { FIRST = 3, LAST = 40 };
#define STEP 1.0       /* of the camera, per update */
#define UPDATE_MS 20.0 /* between two updates, each of which is drawn */

static void move_to(struct fixture *f, struct srv_participant *p, unsigned seq, double now_ms) {
    char params[200];
    snprintf(
        params, sizeof params,
        "{\"seq\":%u,\"patch\":{\"camera\":{\"position\":[%.4f,300,0],\"target\":[%.4f,0,0]}}}",
        seq, STEP * seq, STEP * seq);
    hub_send(f, p, "view.update", params, now_ms);
}

/* Pans, with a frame per update that is acknowledged delay_ms after the update arrived. Returns the
 * last job, and by how many updates its camera is ahead. */
static struct srv_render_job pan(struct fixture *f, struct srv_participant *p,
                                 struct srv_participant *guest, double delay_ms, double *ahead) {
    struct srv_render_job job = { .order = 0 };
    for (unsigned seq = FIRST; seq <= LAST; seq++) {
        const double now_ms = 10000 + UPDATE_MS * seq;
        move_to(f, p, seq, now_ms);
        while (hub_next_job(f, now_ms + 1, &job)) {
            *ahead = job.view.camera.target[0] / STEP - seq;
            hub_finish(f, &job, 5);
        }
        struct proto_frame_header header = hub_drain(f, p, now_ms + delay_ms - 1);
        if (header.frame)
            hub_ack(f, p, header.frame, now_ms + delay_ms);
        header = guest ? hub_drain(f, guest, now_ms + delay_ms - 1) : header;
        if (guest && header.frame)
            hub_ack(f, guest, header.frame, now_ms + delay_ms);
    }
    return job;
}

/* Joins and draws the first frames. */
static struct srv_participant *join(struct fixture *f, const char *settings) {
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    hub_send(f, p, "stream.configure", settings, 1);
    struct srv_render_job job;
    for (unsigned i = 0; i < 3; i++) {
        while (hub_next_job(f, 2 + 1000 * i, &job))
            hub_finish(f, &job, 5);
        const struct proto_frame_header header = hub_drain(f, p, 10 + 1000 * i);
        if (header.frame)
            hub_ack(f, p, header.frame, 11 + 1000 * i);
    }
    return p;
}

static void frames_are_ahead_by_the_time_to_the_screen(void **state) {
    struct fixture *f = *state;
    double ahead = 0;
    f->has_depth = true;
    struct srv_participant *p = join(f, "{\"depth\":true,\"predict\":1000,\"max_fps\":60}");
    const struct srv_render_job job = pan(f, p, NULL, 15, &ahead);
    assert_int_equal(job.step, SRV_STEP_MOVING);
    assert_compare(job.ahead, >, 0);
    /* The delay, and half of the time between frames. */
    assert_float_equal(ahead, (15 + UPDATE_MS / 2) / UPDATE_MS, 0.2);
    /* It is not final, although it is sharp. */
    assert_true(job.is_sharp);
    assert_false(job.targets[0].final);
    assert_true(job.ends_with_motion);
    /* When the hand seems to have stopped, a frame of its own camera follows at once. */
    const double stopped_ms = 10000 + UPDATE_MS * LAST;
    struct srv_render_job next;
    assert_false(hub_next_job(f, stopped_ms + 29, &next));
    for (int step = SRV_STEP_MOVING; step <= SRV_STEP_FINAL; step += SRV_STEP_FINAL) {
        assert_true(hub_next_job(f, stopped_ms + (step == SRV_STEP_MOVING ? 31 : 200), &next));
        assert_int_equal(next.step, step);
        assert_compare(next.ahead, ==, 0);
        assert_float_equal(next.view.camera.target[0], STEP * LAST, 0);
        hub_finish(f, &next, 5);
    }
    srv_hub_leave(f->hub, &p, 30000);
}

/* A hand that stops while a frame that is ahead is drawn: the frame is cancelled, and one of the
 * hand's camera begins. Until a moving frame is finished, no other one ends with the motion. */
static void a_hand_that_stops_ends_the_frame_that_is_ahead(void **state) {
    struct fixture *f = *state;
    double ahead = 0;
    f->has_depth = true;
    struct srv_participant *p = join(f, "{\"depth\":true,\"predict\":1000,\"max_fps\":60}");
    pan(f, p, NULL, 15, &ahead);
    const double now_ms = 10000 + UPDATE_MS * (LAST + 1);
    struct srv_render_job job, next;
    move_to(f, p, LAST + 1, now_ms);
    assert_true(hub_next_job(f, now_ms + 1, &job));
    assert_compare(job.ahead, >, SRV_FAR_AHEAD);
    assert_true(job.ends_with_motion);
    struct srv_running_job running = { .session = job.session, .image = job.image };
    assert_float_equal(srv_schedule_stops_in_ms(f->schedule, &running, now_ms + 10), 20, 1e-6);
    running.image++; /* of another view */
    assert_false(isfinite(srv_schedule_stops_in_ms(f->schedule, &running, now_ms + 10)));
    const struct srv_render_job first = job;
    srv_schedule_cancelled(f->schedule, &job, 29);
    assert_false(srv_ends_with_motion(f->schedule, p, &first, now_ms + 30));
    assert_true(hub_next_job(f, now_ms + 31, &next));
    assert_compare(next.ahead, ==, 0);
    assert_float_equal(next.view.camera.target[0], STEP * (LAST + 1), 0);
    hub_finish(f, &next, 5);
    assert_true(srv_ends_with_motion(f->schedule, p, &first, now_ms + 40));
    struct srv_render_job late = first;
    late.ahead = 0;
    assert_true(srv_ends_with_motion(f->schedule, p, &late, now_ms + 40));
    /* If views rest late, the sharp frame is not the next one: a frame of the last view comes. */
    f->hub->options.rest_ms = 60000;
    assert_false(srv_ends_with_motion(f->schedule, p, &late, now_ms + 40));
    srv_hub_leave(f->hub, &p, 30000);
}

static void a_client_that_pauses_once_changes_nothing(void **state) {
    (void)state;
    struct srv_display_delay delay = { .count = 0 };
    assert_float_equal(srv_display_delay_ms(&delay), 0, 0);
    for (uint32_t frame = 1; frame < 200; frame++) {
        const double sent_ms = 20.0 * frame, took_ms = frame % 50 == 30 ? 4000 : 40;
        srv_display_delay_sent(&delay, frame, sent_ms);
        srv_display_delay_acked(&delay, frame, sent_ms + took_ms);
        srv_display_delay_acked(&delay, frame, sent_ms + 9000); /* again */
        srv_display_delay_acked(&delay, frame + 1, sent_ms);    /* was not sent yet */
        assert_float_equal(srv_display_delay_ms(&delay), 40, 1e-9);
    }
}

static void the_client_limits_how_far(void **state) {
    struct fixture *f = *state;
    double ahead = 0;
    f->has_depth = true;
    struct srv_participant *p = join(f, "{\"depth\":true,\"predict\":10,\"max_fps\":60}");
    pan(f, p, NULL, 15, &ahead);
    assert_float_equal(ahead, 10 / UPDATE_MS, 1e-6);
    srv_hub_leave(f->hub, &p, 30000);
}

static void others_get_the_camera_of_the_view(void **state) {
    struct fixture *f = *state;
    static const char *const settings[] = { "{\"depth\":true,\"max_fps\":60}",
                                            "{\"predict\":100,\"max_fps\":60}" };
    double ahead = 1;
    f->has_depth = true;
    for (int i = 0; i < 2; i++) {
        struct srv_participant *p = join(f, settings[i]);
        assert_compare(pan(f, p, NULL, 15, &ahead).ahead, ==, 0);
        assert_float_equal(ahead, 0, 1e-9);
        srv_hub_leave(f->hub, &p, 30000);
    }
    /* The backend computes no depth, so that the client cannot correct the error. */
    f->has_depth = false;
    struct srv_participant *p = join(f, "{\"depth\":true,\"predict\":100,\"max_fps\":60}");
    assert_compare(pan(f, p, NULL, 15, &ahead).ahead, ==, 0);
    assert_float_equal(ahead, 0, 1e-9);
    srv_hub_leave(f->hub, &p, 30000);
}

static void a_frame_that_a_guest_gets_too_is_not_ahead(void **state) {
    struct fixture *f = *state;
    double ahead = 1;
    f->has_depth = true;
    struct srv_participant *p = join(f, "{\"depth\":true,\"predict\":100,\"max_fps\":60}");
    struct srv_participant *guest = join(f, "{\"depth\":true,\"predict\":100,\"max_fps\":60}");
    const struct srv_render_job job = pan(f, p, guest, 15, &ahead);
    assert_int_equal(job.target_count, 2);
    assert_compare(job.ahead, ==, 0);
    assert_float_equal(ahead, 0, 1e-9);
    srv_hub_leave(f->hub, &guest, 30000);
    srv_hub_leave(f->hub, &p, 30000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(frames_are_ahead_by_the_time_to_the_screen, hub_set_up,
                                        hub_tear_down),
        cmocka_unit_test_setup_teardown(a_hand_that_stops_ends_the_frame_that_is_ahead, hub_set_up,
                                        hub_tear_down),
        cmocka_unit_test(a_client_that_pauses_once_changes_nothing),
        cmocka_unit_test_setup_teardown(the_client_limits_how_far, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(others_get_the_camera_of_the_view, hub_set_up,
                                        hub_tear_down),
        cmocka_unit_test_setup_teardown(a_frame_that_a_guest_gets_too_is_not_ahead, hub_set_up,
                                        hub_tear_down),
    };
    return cmocka_run_group_tests_name("session/ahead", tests, NULL, NULL);
}
