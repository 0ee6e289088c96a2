/* SPDX-License-Identifier: Apache-2.0
 *
 * Playing: frames follow the clock without messages of the client, for as long as a layer of
 * vectors is visible and no participant stops it.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "unit/server/session/hub_fixture.h"

/* Sends a request; true if the answer contains `text`. */
static bool call(struct fixture *f, struct srv_participant *p, const char *method,
                 const char *params, double now_ms, const char *text) {
    char message[256], *answer;
    size_t size;
    snprintf(message, sizeof message,
             "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"%s\",\"params\":%s}", method, params);
    assert_true(srv_hub_message(f->hub, p, message, strlen(message), now_ms, &answer, &size));
    bool found = strstr(answer, text);
    free(answer);
    return found;
}

static void show_vectors(struct fixture *f, struct srv_participant *p, double now_ms) {
    hub_send(f, p, "view.update", "{\"seq\":1,\"patch\":{\"layers\":[{\"type\":\"vectors\"}]}}",
             now_ms);
}

/* True if a notification of the participant contains `text`. */
static bool is_notified(struct fixture *f, struct srv_participant *p, const char *text,
                        double now_ms) {
    struct srv_message message;
    bool found = false;
    while (srv_hub_next_message(f->hub, p, SRV_NEXT_NOTIFICATIONS, now_ms, &message) ==
           SRV_MESSAGE_TEXT) {
        found = found || strstr(message.text, text);
        free(message.text);
    }
    return found;
}

/* Draws and acknowledges the frame that is due. */
static double draw(struct fixture *f, struct srv_participant *p, enum srv_frame_step step,
                   double now_ms) {
    struct srv_render_job job;
    assert_true(hub_next_job(f, now_ms, &job));
    assert_int_equal(job.step, step);
    double phase = job.view.layers[0].phase;
    hub_finish(f, &job, 5);
    hub_ack(f, p, hub_drain(f, p, now_ms + 6).frame, now_ms + 8);
    return phase;
}

/* Draws until nothing is wanted any more. */
static void settle(struct fixture *f, struct srv_participant *p, double now_ms) {
    struct srv_render_job job;
    double end_ms = now_ms + 3000;
    for (; hub_next_job(f, now_ms, &job); now_ms += 300) {
        assert_compare(now_ms, <, end_ms);
        hub_finish(f, &job, 5);
        hub_ack(f, p, hub_drain(f, p, now_ms + 6).frame, now_ms + 8);
    }
}

static void frames_follow_the_clock(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    settle(f, p, 10);
    show_vectors(f, p, 10000);
    draw(f, p, SRV_STEP_MOVING, 10010);
    hub_send(f, p, "time.play", "{\"rate\":2}", 10500);
    for (int i = 1; i <= 20; i++) {
        double phase = draw(f, p, SRV_STEP_MOVING, 10500 + 40 * i);
        assert_true(fabs(phase - fmod(2 * 0.04 * i, 1)) < 1e-9);
    }
    hub_send(f, p, "time.stop", "{}", 11333);
    double last = draw(f, p, SRV_STEP_MOVING, 11400);
    assert_true(fabs(last - fmod(2 * 0.833, 1)) < 1e-9);
    settle(f, p, 12000);
    assert_false(hub_next_job(f, 20000, &job)); /* it rests */
    hub_send(f, p, "time.play", "{\"rate\":-0.5}", 30000);
    double back = draw(f, p, SRV_STEP_MOVING, 30020);
    assert_true(fabs(back - (last - 0.01)) < 1e-9);
    srv_hub_leave(f->hub, &p, 30300);
}

/* Playing outdates no frame that is being drawn, however slow or rare frames are. A view that plays
 * never rests. */
static void no_frame_is_outdated_by_playing(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job, none;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    settle(f, p, 10);
    show_vectors(f, p, 10000);
    draw(f, p, SRV_STEP_MOVING, 10010);
    for (int is_progressive = 0; is_progressive < 2; is_progressive++) {
        double start_ms = 20000 + 20000 * is_progressive;
        hub_send(f, p, "stream.configure",
                 is_progressive ? "{\"max_fps\":1,\"progressive\":true}"
                                : "{\"max_fps\":1,\"progressive\":false}",
                 start_ms);
        settle(f, p, start_ms + 1000);
        hub_send(f, p, "time.play", "{\"rate\":0.01}", start_ms + 8000);
        for (int i = 0; i < 5; i++) {
            double now_ms = start_ms + 10000 + 1100 * i;
            assert_true(hub_next_job(f, now_ms, &job));
            assert_int_equal(job.step, is_progressive ? SRV_STEP_MOVING : SRV_STEP_FINAL);
            for (int poll = 1; poll < 4; poll++) {
                assert_false(hub_next_job(f, now_ms + 200 * poll, &none));
                assert_true(srv_schedule_is_newest(f->schedule, &job));
            }
            hub_finish(f, &job, 700);
            hub_ack(f, p, hub_drain(f, p, now_ms + 710).frame, now_ms + 720);
        }
        hub_send(f, p, "time.stop", "{}", start_ms + 16000);
        settle(f, p, start_ms + 17000);
    }
    srv_hub_leave(f->hub, &p, 60000);
}

/* A patch of the phase has no effect while it moves, and stopping twice changes nothing. */
static void the_clock_has_the_phase(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    settle(f, p, 10);
    show_vectors(f, p, 10000);
    hub_send(f, p, "time.play", "{\"rate\":1}", 10100);
    hub_send(f, p, "view.update",
             "{\"seq\":2,\"patch\":{\"layers\":[{\"type\":\"vectors\",\"phase\":0.9}]}}", 10200);
    assert_true(call(f, p, "view.get", "{}", 10200, "\"phase\":0.1,"));
    hub_send(f, p, "time.stop", "{}", 10350);
    settle(f, p, 10400);
    hub_send(f, p, "time.stop", "{}", 20000);
    assert_false(hub_next_job(f, 20100, &job));
    srv_hub_leave(f->hub, &p, 20200);
}

static void participants_are_told_and_only_control_plays(void **state) {
    struct fixture *f = *state;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_participant *guest = hub_join(f, SRV_ROLE_VIEW, 0);
    assert_true(call(f, p, "time.play", "{\"rate\":1}", 10, "-32000")); /* no vectors */
    show_vectors(f, p, 20);
    assert_true(call(f, p, "time.play", "{\"rate\":0}", 30, "/rate"));
    assert_true(call(f, p, "time.play", "{\"rate\":11}", 30, "/rate"));
    assert_true(call(f, p, "time.play", "{\"rate\":1e-300}", 30, "/rate"));
    assert_true(call(f, p, "time.play", "{\"speed\":1}", 30, "-32602"));
    assert_true(call(f, guest, "time.play", "{\"rate\":1}", 30, "-32004"));
    assert_false(is_notified(f, guest, "time.changed", 40));
    assert_true(call(f, p, "time.play", "{\"rate\":1}", 50, "\"rate\":1"));
    assert_true(is_notified(f, guest, "\"time.changed\",\"params\":{\"rate\":1,", 60));
    assert_true(call(f, guest, "time.stop", "{}", 70, "-32004"));
    struct srv_participant *late = hub_join(f, SRV_ROLE_VIEW, 80);
    assert_true(is_notified(f, late, "\"time.changed\",\"params\":{\"rate\":1,", 90));
    assert_true(call(f, p, "time.stop", "{}", 100, "\"rate\":0"));
    assert_true(is_notified(f, late, "\"time.changed\",\"params\":{\"rate\":0,", 110));
    srv_hub_leave(f->hub, &p, 120);
    srv_hub_leave(f->hub, &guest, 120);
    srv_hub_leave(f->hub, &late, 120);
}

/* Playing ends when the layer that moves is removed. */
static void it_ends_with_the_layer(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    settle(f, p, 10);
    show_vectors(f, p, 10000);
    draw(f, p, SRV_STEP_MOVING, 10010);
    hub_send(f, p, "time.play", "{\"rate\":1}", 10050);
    draw(f, p, SRV_STEP_MOVING, 10100);
    hub_send(f, p, "view.update", "{\"seq\":2,\"patch\":{\"layers\":null}}", 10150);
    settle(f, p, 10160);
    assert_true(call(f, p, "time.play", "{\"rate\":1}", 20000, "-32000"));
    show_vectors(f, p, 20010);
    settle(f, p, 20020);
    assert_false(hub_next_job(f, 30000, &job)); /* it does not go on by itself */
    srv_hub_leave(f->hub, &p, 30010);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(frames_follow_the_clock, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(no_frame_is_outdated_by_playing, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(the_clock_has_the_phase, hub_set_up, hub_tear_down),
        cmocka_unit_test_setup_teardown(participants_are_told_and_only_control_plays, hub_set_up,
                                        hub_tear_down),
        cmocka_unit_test_setup_teardown(it_ends_with_the_layer, hub_set_up, hub_tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
