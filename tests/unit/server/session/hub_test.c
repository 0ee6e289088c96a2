/* SPDX-License-Identifier: Apache-2.0
 *
 * The hub without sockets and renderer: participants, notifications, and the end of sessions. The
 * test passes the time.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "unit/server/counted.h"
#include "unit/server/session/hub_fixture.h"

static unsigned session_count(struct fixture *f) {
    struct srv_hub_numbers numbers;
    srv_hub_numbers(f->hub, &numbers);
    return numbers.sessions;
}

static void idle_sessions_end(void **state) {
    struct fixture *f = *state;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    srv_hub_tick(f->hub, 5000);
    assert_int_equal(session_count(f), 1);
    srv_hub_leave(f->hub, &p, 5000);
    srv_hub_tick(f->hub, 5999);
    assert_int_equal(session_count(f), 1);
    srv_hub_tick(f->hub, 6001);
    assert_int_equal(session_count(f), 0);
}

static void participants_with_equal_settings_share_a_frame(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job, other;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 0),
                           *b = hub_join(f, SRV_ROLE_CONTROL, 0),
                           *c = hub_join(f, SRV_ROLE_CONTROL, 0);
    static const char text[] = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\","
                               "\"params\":{\"size\":[40,30],\"format\":\"png\"}}";
    char *answer;
    size_t size;
    assert_null(srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, "", f, 0,
                             NULL)); /* --participants allows three */
    assert_true(srv_hub_message(f->hub, c, text, sizeof text - 1, 0, &answer, &size));
    free(answer);
    assert_true(hub_next_job(f, 1, &job));
    assert_true(hub_next_job(f, 1, &other));
    assert_int_equal(job.target_count + other.target_count, 3);
    assert_in_range(job.target_count, 1, 2);
    hub_finish(f, &job, 1);
    hub_finish(f, &other, 1);
    assert_int_equal(hub_drain(f, a, 2).frame, 1);
    assert_int_equal(hub_drain(f, b, 2).frame, 1);
    assert_int_equal(hub_drain(f, c, 2).frame, 1);
    srv_hub_leave(f->hub, &a, 3);
    /* A job may outlive its participant and its session. */
    hub_update(f, b, 1, 50);
    assert_true(hub_next_job(f, 60, &job));
    srv_hub_leave(f->hub, &b, 61);
    assert_true(srv_hub_session_delete(f->hub, f->id, NULL));
    hub_finish(f, &job, 1);
    struct srv_message message;
    assert_int_equal(srv_hub_next_message(f->hub, c, SRV_NEXT_ALL, 70, &message),
                     SRV_MESSAGE_CLOSE);
    assert_int_equal(message.close_code, 1000);
    srv_hub_leave(f->hub, &c, 71);
}

static void a_failed_view_is_reported_and_not_tried_again(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_message message;
    struct sp_error err;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    hub_drain(f, p, 0);
    assert_true(hub_next_job(f, 1, &job));
    sp_fail(&err, SP_ERR_MEMORY, "/size", "out of memory");
    srv_schedule_failed(f->schedule, &job, &err);
    assert_int_equal(srv_hub_next_message(f->hub, p, SRV_NEXT_ALL, 2, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "render.error"));
    assert_non_null(strstr(message.text, "\"pointer\":\"/size\""));
    free(message.text);
    assert_false(hub_next_job(f, 10000, &job));
    hub_update(f, p, 1, 10000);
    assert_true(hub_next_job(f, 10001, &job));
    hub_finish(f, &job, 1);
    srv_hub_leave(f->hub, &p, 10002);
}

static void frames_for_participants_that_left_are_counted(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 1000),
                           *b = hub_join(f, SRV_ROLE_CONTROL, 1000);
    assert_true(hub_next_job(f, 1000, &job));
    assert_int_equal(job.target_count, 2);
    srv_hub_leave(f->hub, &b, 1001);
    hub_finish(f, &job, 5); /* b's frame is dropped, a's frame waits for its socket */
    assert_int_equal(counted_drops(f->metrics, "left"), 1);
    srv_hub_leave(f->hub, &a, 1002);
    assert_int_equal(counted_drops(f->metrics, "left"), 2);
    a = hub_join(f, SRV_ROLE_CONTROL, 2000);
    assert_true(hub_next_job(f, 2000, &job));
    srv_hub_leave(f->hub, &a, 2001);
    srv_schedule_cancelled(f->schedule, &job,
                           1); /* because the client left, not for a newer view */
    assert_int_equal(counted_drops(f->metrics, "left"), 3);
    a = hub_join(f, SRV_ROLE_CONTROL, 3000);
    assert_true(hub_next_job(f, 3000, &job));
    hub_update(f, a, 1, 3001);
    srv_schedule_cancelled(f->schedule, &job, 1);
    assert_int_equal(counted_drops(f->metrics, "outdated"), 1);
    assert_int_equal(counted_drops(f->metrics, "left"), 3);
    srv_hub_leave(f->hub, &a, 3002);
}

static void frames_dropped_at_shutdown_are_not_counted(void **state) {
    static const char *const reasons[] = { "replaced", "late", "outdated", "failed", "left" };
    struct fixture *f = *state;
    struct srv_render_job job, other;
    struct sp_error err;
    sp_fail(&err, SP_ERR_IO, NULL, "no");
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 1000),
                           *b = hub_join(f, SRV_ROLE_CONTROL, 1000);
    assert_true(hub_next_job(f, 1000, &job));
    srv_hub_drain(f->hub);
    srv_hub_leave(f->hub, &b, 1001);
    hub_update(f, a, 1, 1002);
    assert_true(hub_next_job(f, 1100, &other));
    hub_finish(f, &other, 5);
    hub_finish(f, &job, 5); /* late */
    hub_update(f, a, 2, 1200);
    assert_true(hub_next_job(f, 1300, &other));
    srv_schedule_failed(f->schedule, &other, &err);
    hub_update(f, a, 3, 1400);
    assert_true(hub_next_job(f, 1500, &other));
    srv_schedule_cancelled(f->schedule, &other, 1);
    srv_hub_leave(f->hub, &a, 1600);
    for (size_t i = 0; i < sizeof reasons / sizeof *reasons; i++)
        assert_int_equal(counted_drops(f->metrics, reasons[i]), 0);
}

static void notifications_report_the_newest_state(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 0),
                           *b = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_message message;
    hub_drain(f, b, 0);
    for (unsigned seq = 1; seq <= 9; seq++)
        hub_update(f, a, seq, seq);
    for (int i = 0; i <= 100; i++)
        srv_hub_volume_progress(f->hub, "w", i < 100 ? "loading" : "ready", i / 100.0, "", 0);
    assert_int_equal(srv_hub_next_message(f->hub, b, SRV_NEXT_ALL, 20, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "session.control")); /* the first update took control */
    free(message.text);
    assert_int_equal(srv_hub_next_message(f->hub, b, SRV_NEXT_ALL, 20, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "view.changed"));
    assert_non_null(strstr(message.text, "\"background\":[0.9"));
    free(message.text);
    assert_int_equal(srv_hub_next_message(f->hub, b, SRV_NEXT_ALL, 20, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "\"state\":\"ready\""));
    free(message.text);
    assert_int_equal(srv_hub_next_message(f->hub, b, SRV_NEXT_ALL, 20, &message), SRV_MESSAGE_NONE);
    srv_hub_leave(f->hub, &a, 30);
    srv_hub_leave(f->hub, &b, 30);
}

/* The frames of a session failed while a volume was missing that a layer shows. */
static void a_session_gets_new_frames_when_the_volume_of_a_layer_is_ready(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct sp_error err;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    hub_send(f, p, "view.update",
             "{\"seq\":1,\"patch\":{\"layers\":[{\"type\":\"points\",\"id\":\"w\"}]}}", 0);
    hub_drain(f, p, 0);
    assert_true(hub_next_job(f, 1, &job));
    sp_fail(&err, SP_ERR_VOLUME_UNKNOWN, "/layers/0/id", "no volume \"w\" is loaded");
    srv_schedule_failed(f->schedule, &job, &err);
    srv_hub_volume_progress(f->hub, "w", "loading", 0.5, "", 9000);
    srv_hub_volume_progress(f->hub, "another", "ready", 1, "", 9000);
    assert_false(hub_next_job(f, 9000, &job));
    srv_hub_volume_progress(f->hub, "w", "ready", 1, "", 9000);
    assert_true(hub_next_job(f, 9001, &job));
    hub_finish(f, &job, 1);
    srv_hub_leave(f->hub, &p, 9500);
}

static void an_unloaded_volume_is_reported_once(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_message message;
    hub_drain(f, a, 0);
    srv_hub_volume_progress(f->hub, "w", "ready", 1, "", 0);
    srv_hub_volume_progress(f->hub, "w", "unloaded", 0, "", 0);
    assert_int_equal(srv_hub_next_message(f->hub, a, SRV_NEXT_ALL, 20, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "\"state\":\"unloaded\""));
    free(message.text);
    assert_int_equal(srv_hub_next_message(f->hub, a, SRV_NEXT_ALL, 20, &message), SRV_MESSAGE_NONE);
    struct srv_participant *b = hub_join(f, SRV_ROLE_CONTROL, 20);
    while (srv_hub_next_message(f->hub, b, SRV_NEXT_ALL, 20, &message) == SRV_MESSAGE_TEXT) {
        assert_null(strstr(message.text, "volume.progress"));
        free(message.text);
    }
    srv_hub_volume_progress(f->hub, "w", "loading", 0, "", 20);
    assert_int_equal(srv_hub_next_message(f->hub, b, SRV_NEXT_ALL, 20, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "\"state\":\"loading\""));
    free(message.text);
    srv_hub_leave(f->hub, &a, 30);
    srv_hub_leave(f->hub, &b, 30);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, hub_set_up, hub_tear_down)
        TEST(idle_sessions_end),
        TEST(participants_with_equal_settings_share_a_frame),
        TEST(a_failed_view_is_reported_and_not_tried_again),
        TEST(frames_for_participants_that_left_are_counted),
        TEST(frames_dropped_at_shutdown_are_not_counted),
        TEST(notifications_report_the_newest_state),
        TEST(an_unloaded_volume_is_reported_once),
        TEST(a_session_gets_new_frames_when_the_volume_of_a_layer_is_ready),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
