/* SPDX-License-Identifier: Apache-2.0
 *
 * Sessions without sockets and renderer: jobs are taken and answered by hand, the clock is given.
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

#include "unit/server/counted.h"
#include "unit/server/session/hub_fixture.h"

static struct srv_participant *join(struct fixture *f, double now_ms) {
    return hub_join(f, SRV_ROLE_CONTROL, now_ms);
}

static void update(struct fixture *f, struct srv_participant *p, unsigned seq, double now_ms) {
    char text[160], *answer;
    size_t size;
    snprintf(text, sizeof text,
             "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"view.update\",\"params\":{\"seq\":%u,"
             "\"patch\":{\"background\":[0.%u,0,0,1]}}}",
             seq, seq);
    assert_true(srv_hub_message(f->hub, p, text, strlen(text), now_ms, &answer, &size));
    assert_non_null(strstr(answer, "\"result\""));
    free(answer);
}

static void ack(struct fixture *f, struct srv_participant *p, unsigned frame, double now_ms) {
    char text[120], *answer;
    size_t size;
    snprintf(text, sizeof text,
             "{\"jsonrpc\":\"2.0\",\"method\":\"stream.ack\",\"params\":{\"frame\":%u}}", frame);
    assert_true(srv_hub_message(f->hub, p, text, strlen(text), now_ms, &answer, &size));
    assert_null(answer);
}

static unsigned session_count(struct fixture *f) {
    struct srv_hub_numbers numbers;
    srv_hub_numbers(f->hub, &numbers);
    return numbers.sessions;
}

static bool next_job(struct fixture *f, double now_ms, struct srv_render_job *job) {
    double wait_ms;
    return srv_schedule_next(f->schedule, now_ms, job, &wait_ms);
}

static void finish(struct fixture *f, struct srv_render_job *job, double render_ms) {
    struct proto_frame_header header = { .codec = PROTO_CODEC_JPEG,
                                         .width = (uint16_t)job->view.size[0],
                                         .height = (uint16_t)job->view.size[1] };
    struct srv_render_result result = { .width = job->view.size[0],
                                        .height = job->view.size[1],
                                        .render_ms = render_ms };
    struct srv_blob *blob = srv_blob_create((const uint8_t *)"image", 5);
    for (uint32_t i = 0; i < job->target_count; i++)
        srv_schedule_deliver(f->schedule, job, i, &header, blob);
    srv_blob_unref(&blob);
    srv_schedule_done(f->schedule, job, &result);
}

/* Drains all messages; returns the last frame's header, frame 0 if there was none. */
static struct proto_frame_header drain(struct fixture *f, struct srv_participant *p,
                                       double now_ms) {
    struct proto_frame_header last = { .frame = 0 };
    struct srv_message message;
    enum srv_message_kind kind;
    while ((kind = srv_hub_next_message(f->hub, p, true, now_ms, &message)) != SRV_MESSAGE_NONE) {
        assert_int_not_equal(kind, SRV_MESSAGE_CLOSE);
        if (kind == SRV_MESSAGE_FRAME)
            last = message.header;
        free(message.text);
        srv_blob_unref(&message.blob);
    }
    return last;
}

static void moving_then_final(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = join(f, 1000);
    assert_true(next_job(f, 1000, &job));
    assert_int_equal(job.step,
                     SRV_STEP_MOVING); /* nothing is known yet of the time that a picture takes */
    assert_true(job.view.size[0] < 512);
    assert_int_equal(job.targets[0].quality, 60);
    finish(f, &job, 5);
    struct proto_frame_header header = drain(f, p, 1010);
    assert_int_equal(header.frame, 1);
    assert_int_equal(header.flags, PROTO_FRAME_KEY);
    ack(f, p, 1, 1012);
    assert_true(next_job(f, 1200, &job));
    assert_true(job.step == SRV_STEP_FINAL && job.is_refinement);
    assert_int_equal(job.view.size[0], 512);
    assert_int_equal(job.targets[0].quality, 90);
    finish(f, &job, 20);
    header = drain(f, p, 1230);
    assert_int_equal(header.flags, PROTO_FRAME_KEY | PROTO_FRAME_FINAL);
    ack(f, p, 2, 1240);
    assert_false(next_job(f, 5000, &job)); /* it rests */
    update(f, p, 7, 5000);
    assert_true(next_job(f, 5001, &job));
    assert_int_equal(job.step, SRV_STEP_MOVING);
    assert_int_equal(job.targets[0].seq, 7);
    finish(f, &job, 5);
    assert_int_equal(drain(f, p, 5010).seq, 7);
    srv_hub_leave(f->hub, &p, 5020);
}

static void a_new_session_starts_with_the_known_times_of_its_volume(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    char id[SRV_SESSION_ID_BYTES];
    struct srv_participant *p = join(f, 1000);
    assert_true(next_job(f, 1000, &job));
    uint64_t first = job.session;
    finish(f, &job, 5);
    proto_json *json = srv_hub_session_create(f->hub, NULL, 1010, id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
    struct srv_participant *next = srv_hub_join(f->hub, id, SRV_ROLE_CONTROL, "", NULL, 1010, NULL);
    assert_non_null(next);
    assert_true(next_job(f, 1010, &job));
    assert_true(job.session != first && job.is_sharp);
    finish(f, &job, 20);
    srv_hub_leave(f->hub, &next, 1030);
    srv_hub_leave(f->hub, &p, 1030);
}

static void updates_coalesce_behind_a_job(void **state) {
    struct fixture *f = *state;
    struct srv_render_job first, second, none;
    struct srv_participant *p = join(f, 0);
    assert_true(next_job(f, 1, &first));
    for (unsigned seq = 1; seq <= 9; seq++)
        update(f, p, seq, 2);
    assert_true(next_job(f, 40, &second));
    assert_int_equal(second.targets[0].seq, 9);
    assert_false(srv_schedule_is_newest(f->schedule, &first));
    assert_true(srv_schedule_is_newest(f->schedule, &second));
    assert_false(next_job(f, 500, &none)); /* two are on their way: the first window */
    /* They come in the wrong order: the older one is dropped. */
    finish(f, &second, 1);
    finish(f, &first, 1);
    struct proto_frame_header header = drain(f, p, 60);
    assert_int_equal(header.frame, 1);
    assert_int_equal(header.seq, 9);
    srv_hub_leave(f->hub, &p, 70);
}

static void a_cancelled_refinement_is_drawn_again(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = join(f, 0);
    assert_true(next_job(f, 1, &job));
    finish(f, &job, 1);
    drain(f, p, 2);
    ack(f, p, 1, 3);
    assert_true(next_job(f, 200, &job));
    assert_true(job.is_refinement);
    unsigned before = f->interrupts;
    update(f, p, 1, 210);
    assert_int_equal(f->interrupts, before + 1);
    srv_schedule_cancelled(f->schedule, &job, 1);
    assert_true(next_job(f, 240, &job));
    assert_false(job.is_refinement);
    finish(f, &job, 1);
    drain(f, p, 250);
    ack(f, p, 2, 251);
    assert_true(next_job(f, 400, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    srv_schedule_cancelled(f->schedule, &job, 1); /* without a newer view, too */
    assert_true(next_job(f, 500, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    finish(f, &job, 1);
    srv_hub_leave(f->hub, &p, 600);
}

static void tell(struct fixture *f, struct srv_participant *p, const char *method,
                 const char *params, double now_ms) {
    char text[200], *answer;
    size_t size;
    snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"%s\",\"params\":%s}",
             method, params);
    assert_true(srv_hub_message(f->hub, p, text, strlen(text), now_ms, &answer, &size));
    assert_non_null(strstr(answer, "\"result\""));
    free(answer);
}

/* Whatever lies between them and the first frame, and with some jitter. */
static void changes_that_come_as_often_as_frames_are_due_do_not_wait(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    for (unsigned k = 1; k <= 10; k++) {
        double begin_ms = 10000.0 * k;
        struct srv_participant *p = join(f, begin_ms);
        tell(f, p, "stream.configure", "{\"max_fps\":30}", begin_ms);
        while (next_job(f, begin_ms++, &job)) {
            finish(f, &job, 1);
            ack(f, p, drain(f, p, begin_ms).frame, begin_ms);
        }
        for (unsigned i = 1; i <= 60; i++) {
            double now_ms = begin_ms + 9.7 * k + i * 1000.0 / 30 + i % 3;
            update(f, p, i, now_ms);
            assert_true(next_job(f, now_ms, &job));
            finish(f, &job, 1);
            ack(f, p, drain(f, p, now_ms).frame, now_ms);
        }
        srv_hub_leave(f->hub, &p, begin_ms + 5000);
    }
}

/* Updates, takes the job, finishes it after render_ms, acknowledges: one frame of a drag. */
static struct srv_render_job drag(struct fixture *f, struct srv_participant *p, unsigned seq,
                                  double now_ms, double render_ms) {
    struct srv_render_job job;
    update(f, p, seq, now_ms);
    assert_true(next_job(f, now_ms, &job));
    struct srv_render_job copy = job;
    finish(f, &job, render_ms);
    ack(f, p, drain(f, p, now_ms + render_ms).frame, now_ms + render_ms + 1);
    return copy;
}

static void moving_frames_are_cancelled_late_and_never_twice_in_a_row(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = join(f, 0);
    assert_true(next_job(f, 1000, &job));
    assert_true(job.cancellable_from_ms == INFINITY); /* it does what is done once */
    finish(f, &job, 5);
    ack(f, p, drain(f, p, 1005).frame, 1006);
    update(f, p, 1, 2000);
    assert_true(next_job(f, 2000, &job));
    assert_true(job.cancellable_from_ms == 2000 + 2 * SRV_QUALITY_BUDGET_MIN_MS);
    uint32_t before = job.view.size[0];
    update(f, p, 2, 2140);
    assert_int_equal(f->why, SRV_INTERRUPT_NEWER_VIEW);
    srv_schedule_cancelled(f->schedule, &job, 140);
    assert_true(next_job(f, 2141, &job));
    assert_int_equal(job.targets[0].seq, 2);
    assert_true(job.view.size[0] < before || job.mip_level > 0);
    assert_true(job.cancellable_from_ms == INFINITY);
    finish(f, &job, 30);
    ack(f, p, drain(f, p, 2171).frame, 2172);
    update(f, p, 3, 2300);
    assert_true(next_job(f, 2300, &job));
    assert_true(job.cancellable_from_ms < INFINITY || job.mip_level == SP_MIP_LEVEL_MAX);
    finish(f, &job, 30);
    ack(f, p, drain(f, p, 2330).frame, 2331);
    /* A new transfer function is work that the next picture needs as well. */
    tell(f, p, "view.update",
         "{\"seq\":4,\"patch\":{\"transfer_function\":{\"reference_length\":2}}}", 2500);
    assert_true(next_job(f, 2500, &job));
    assert_true(job.cancellable_from_ms == INFINITY);
    finish(f, &job, 30);
    srv_hub_leave(f->hub, &p, 2600);
    assert_int_equal(f->why, SRV_INTERRUPT_UNWANTED);
}

static void a_change_of_volume_or_stream_interrupts(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = join(f, 0);
    assert_true(next_job(f, 1, &job));
    tell(f, p, "view.update", "{\"seq\":1,\"patch\":{\"volume\":\"w\"}}", 5);
    assert_int_equal(f->why, SRV_INTERRUPT_UNWANTED);
    srv_schedule_cancelled(f->schedule, &job, 4);
    assert_true(next_job(f, 40, &job));
    tell(f, p, "view.update", "{\"seq\":2,\"patch\":{\"volume\":\"v\"}}", 45);
    assert_int_equal(f->why, SRV_INTERRUPT_NEWER_VIEW); /* to and fro would never show anything */
    assert_true(job.cancellable_from_ms == INFINITY);
    finish(f, &job, 10);
    unsigned before = f->interrupts;
    tell(f, p, "stream.configure", "{\"max_fps\":60}", 60);
    assert_int_equal(f->interrupts, before); /* the picture stays what it is */
    tell(f, p, "stream.configure", "{\"size\":[64,64]}", 60);
    assert_int_equal(f->interrupts, before + 1);
    srv_hub_leave(f->hub, &p, 70);
}

static void an_intermediate_frame_precedes_a_slow_sharp_one(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = join(f, 0);
    tell(f, p, "stream.configure", "{\"lossless\":true}", 0);
    assert_true(next_job(f, 0, &job)); /* 256 px: 500 ms, hence 2 s for all */
    finish(f, &job, 500);
    ack(f, p, drain(f, p, 500).frame, 501);
    assert_true(next_job(f, 700, &job));
    finish(f, &job, 2000);
    ack(f, p, drain(f, p, 2700).frame, 2701);
    struct srv_render_job moving = drag(f, p, 1, 5000, 60);
    assert_int_equal(moving.step, SRV_STEP_MOVING);
    assert_true(next_job(f, 5200, &job));
    assert_int_equal(job.step, SRV_STEP_INTERMEDIATE);
    assert_true(job.is_refinement && job.cancellable_from_ms == 0);
    assert_true(job.mip_level < moving.mip_level || job.view.size[0] > moving.view.size[0]);
    assert_int_equal(job.targets[0].quality, 90);
    assert_int_equal(job.targets[0].format, SP_IMAGE_JPEG);
    finish(f, &job, 400);
    struct proto_frame_header header = drain(f, p, 5600);
    assert_int_equal(header.flags & PROTO_FRAME_FINAL, 0);
    ack(f, p, header.frame, 5601);
    assert_true(next_job(f, 5602, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    assert_int_equal(job.mip_level, 0);
    assert_int_equal(job.view.size[0], 512);
    assert_int_equal(job.targets[0].format, SP_IMAGE_PNG);
    finish(f, &job, 2000);
    header = drain(f, p, 7602);
    assert_true(header.flags & PROTO_FRAME_FINAL);
    assert_false(next_job(f, 20000, &job));
    srv_hub_leave(f->hub, &p, 20000);
}

/* The first frame tells the time, the second one has all detail, and nothing comes after it. */
static void move_until_final(struct fixture *f, struct srv_participant *p) {
    struct srv_render_job job;
    assert_true(next_job(f, 0, &job));
    finish(f, &job, 5);
    ack(f, p, drain(f, p, 10).frame, 11);
    job = drag(f, p, 1, 100, 5);
    assert_true(job.step == SRV_STEP_MOVING && job.is_sharp && job.targets[0].final);
    assert_false(next_job(f, 5000, &job));
}

static void a_moving_frame_that_cannot_get_better_is_final(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = join(f, 0);
    tell(f, p, "stream.configure", "{\"quality\":60}", 0);
    move_until_final(f, p);
    /* With a higher quality at rest there is something left to do. */
    tell(f, p, "stream.configure", "{\"quality\":61}", 6000);
    job = drag(f, p, 2, 6000, 5);
    assert_true(job.is_sharp && !job.targets[0].final);
    assert_true(next_job(f, 6500, &job));
    assert_true(job.step == SRV_STEP_FINAL && job.is_sharp);
    finish(f, &job, 5);
    srv_hub_leave(f->hub, &p, 7000);
}

static void a_failed_view_is_reported_and_not_tried_again(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_message message;
    struct sp_error err;
    struct srv_participant *p = join(f, 0);
    drain(f, p, 0);
    assert_true(next_job(f, 1, &job));
    sp_fail(&err, SP_ERR_MEMORY, "/size", "no memory");
    srv_schedule_failed(f->schedule, &job, &err);
    assert_int_equal(srv_hub_next_message(f->hub, p, true, 2, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "render.error"));
    assert_non_null(strstr(message.text, "\"pointer\":\"/size\""));
    free(message.text);
    assert_false(next_job(f, 10000, &job));
    update(f, p, 1, 10000);
    assert_true(next_job(f, 10001, &job));
    finish(f, &job, 1);
    srv_hub_leave(f->hub, &p, 10002);
}

static void participants_with_equal_settings_share_a_frame(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job, other;
    struct srv_participant *a = join(f, 0), *b = join(f, 0), *c = join(f, 0);
    static const char text[] = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"stream.configure\","
                               "\"params\":{\"size\":[40,30],\"format\":\"png\"}}";
    char *answer;
    size_t size;
    assert_null(srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, "", f, 0, NULL)); /* three are allowed */
    assert_true(srv_hub_message(f->hub, c, text, sizeof text - 1, 0, &answer, &size));
    free(answer);
    assert_true(next_job(f, 1, &job));
    assert_true(next_job(f, 1, &other));
    assert_int_equal(job.target_count + other.target_count, 3);
    assert_true(job.target_count == 2 || other.target_count == 2);
    finish(f, &job, 1);
    finish(f, &other, 1);
    assert_int_equal(drain(f, a, 2).frame, 1);
    assert_int_equal(drain(f, b, 2).frame, 1);
    assert_int_equal(drain(f, c, 2).frame, 1);
    srv_hub_leave(f->hub, &a, 3);
    /* A job may outlive its participant and its session. */
    update(f, b, 1, 50);
    assert_true(next_job(f, 60, &job));
    srv_hub_leave(f->hub, &b, 61);
    assert_true(srv_hub_session_delete(f->hub, f->id, NULL));
    finish(f, &job, 1);
    struct srv_message message;
    assert_int_equal(srv_hub_next_message(f->hub, c, true, 70, &message), SRV_MESSAGE_CLOSE);
    assert_int_equal(message.close_code, 1000);
    srv_hub_leave(f->hub, &c, 71);
}

static void frames_for_participants_that_left_are_counted(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *a = join(f, 1000), *b = join(f, 1000);
    assert_true(next_job(f, 1000, &job));
    assert_int_equal(job.target_count, 2);
    srv_hub_leave(f->hub, &b, 1001);
    finish(f, &job, 5); /* that of b finds nobody, that of a waits for its socket */
    assert_int_equal(counted_drops(f->metrics, "left"), 1);
    srv_hub_leave(f->hub, &a, 1002);
    assert_int_equal(counted_drops(f->metrics, "left"), 2);
    a = join(f, 2000);
    assert_true(next_job(f, 2000, &job));
    srv_hub_leave(f->hub, &a, 2001);
    srv_schedule_cancelled(f->schedule, &job, 1); /* for nobody, not for a newer view */
    assert_int_equal(counted_drops(f->metrics, "left"), 3);
    a = join(f, 3000);
    assert_true(next_job(f, 3000, &job));
    update(f, a, 1, 3001);
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
    struct srv_participant *a = join(f, 1000), *b = join(f, 1000);
    assert_true(next_job(f, 1000, &job));
    srv_hub_drain(f->hub);
    srv_hub_leave(f->hub, &b, 1001);
    update(f, a, 1, 1002);
    assert_true(next_job(f, 1100, &other));
    finish(f, &other, 5);
    finish(f, &job, 5); /* late */
    update(f, a, 2, 1200);
    assert_true(next_job(f, 1300, &other));
    srv_schedule_failed(f->schedule, &other, &err);
    update(f, a, 3, 1400);
    assert_true(next_job(f, 1500, &other));
    srv_schedule_cancelled(f->schedule, &other, 1);
    srv_hub_leave(f->hub, &a, 1600);
    for (size_t i = 0; i < sizeof reasons / sizeof *reasons; i++)
        assert_int_equal(counted_drops(f->metrics, reasons[i]), 0);
}

static void idle_sessions_end(void **state) {
    struct fixture *f = *state;
    struct srv_participant *p = join(f, 0);
    srv_hub_tick(f->hub, 5000);
    assert_int_equal(session_count(f), 1);
    srv_hub_leave(f->hub, &p, 5000);
    srv_hub_tick(f->hub, 5999);
    assert_int_equal(session_count(f), 1);
    srv_hub_tick(f->hub, 6001);
    assert_int_equal(session_count(f), 0);
}

static void notifications_report_the_state_not_its_history(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = join(f, 0), *b = join(f, 0);
    struct srv_message message;
    drain(f, b, 0);
    for (unsigned seq = 1; seq <= 9; seq++)
        update(f, a, seq, seq);
    for (int i = 0; i <= 100; i++)
        srv_hub_volume_progress(f->hub, "w", i < 100 ? "loading" : "ready", i / 100.0, "");
    assert_int_equal(srv_hub_next_message(f->hub, b, true, 20, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "session.control")); /* the first update took it */
    free(message.text);
    assert_int_equal(srv_hub_next_message(f->hub, b, true, 20, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "view.changed"));
    assert_non_null(strstr(message.text, "\"background\":[0.9"));
    free(message.text);
    assert_int_equal(srv_hub_next_message(f->hub, b, true, 20, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "\"state\":\"ready\""));
    free(message.text);
    assert_int_equal(srv_hub_next_message(f->hub, b, true, 20, &message), SRV_MESSAGE_NONE);
    srv_hub_leave(f->hub, &a, 30);
    srv_hub_leave(f->hub, &b, 30);
}

static void an_unloaded_volume_is_reported_once(void **state) {
    struct fixture *f = *state;
    struct srv_participant *a = join(f, 0);
    struct srv_message message;
    drain(f, a, 0);
    srv_hub_volume_progress(f->hub, "w", "ready", 1, "");
    srv_hub_volume_progress(f->hub, "w", "unloaded", 0, "");
    assert_int_equal(srv_hub_next_message(f->hub, a, true, 20, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "\"state\":\"unloaded\""));
    free(message.text);
    assert_int_equal(srv_hub_next_message(f->hub, a, true, 20, &message), SRV_MESSAGE_NONE);
    struct srv_participant *b = join(f, 20);
    while (srv_hub_next_message(f->hub, b, true, 20, &message) == SRV_MESSAGE_TEXT) {
        assert_null(strstr(message.text, "volume.progress"));
        free(message.text);
    }
    srv_hub_volume_progress(f->hub, "w", "loading", 0, "");
    assert_int_equal(srv_hub_next_message(f->hub, b, true, 20, &message), SRV_MESSAGE_TEXT);
    assert_non_null(strstr(message.text, "\"state\":\"loading\""));
    free(message.text);
    srv_hub_leave(f->hub, &a, 30);
    srv_hub_leave(f->hub, &b, 30);
}

/* Takes all that there is for a participant; the last stream.policy among it, or "". */
static void take_policy(struct fixture *f, struct srv_participant *p, double now_ms,
                        char policy[512]) {
    struct srv_message message;
    enum srv_message_kind kind;
    policy[0] = 0;
    while ((kind = srv_hub_next_message(f->hub, p, true, now_ms, &message)) != SRV_MESSAGE_NONE) {
        if (kind == SRV_MESSAGE_TEXT && strstr(message.text, "stream.policy"))
            snprintf(policy, 512, "%.*s", (int)message.size, message.text);
        if (kind == SRV_MESSAGE_FRAME)
            ack(f, p, message.header.frame, now_ms);
        srv_blob_unref(&message.blob);
        free(message.text);
    }
}

static void the_policy_is_reported_with_its_reasons(void **state) {
    struct fixture *f = *state;
    struct srv_participant *p = join(f, 0);
    struct srv_render_job job;
    char policy[512];
    take_policy(f, p, 0, policy);
    assert_non_null(strstr(policy, "\"why\":[\"quality\"]"));
    assert_non_null(strstr(policy, "\"moving\":{\"format\":\"jpeg\",\"quality\":60,"
                                   "\"subsampling\":\"4:2:0\"}"));
    assert_non_null(strstr(policy, "\"final\":{\"format\":\"jpeg\",\"quality\":90,"
                                   "\"subsampling\":\"4:4:4\",\"size\":[512,512],\"coarse\":0}"));
    /* The first picture is small, since nothing is known; that is told when the view rests. */
    assert_true(next_job(f, 0, &job));
    assert_int_equal(job.step, SRV_STEP_MOVING);
    finish(f, &job, 200);
    take_policy(f, p, 10, policy);
    assert_string_equal(policy, "");
    double now_ms = 200;
    while (next_job(f, now_ms, &job))
        finish(f, &job, 800);
    take_policy(f, p, now_ms, policy);
    assert_non_null(strstr(policy, "\"why\":[\"quality\",\"unknown_time\"]"));
    assert_non_null(strstr(policy, "\"size\":[256,256]"));
    /* A sharp one takes 800 ms and there are 66: told at most twice a second. */
    unsigned told = 0;
    for (unsigned i = 1; i <= 9; i++) {
        now_ms += 200;
        update(f, p, i, now_ms);
        assert_true(next_job(f, now_ms, &job));
        finish(f, &job, 800.0 * job.view.size[0] / 512 / (1 << job.mip_level));
        char fresh[512];
        take_policy(f, p, now_ms, fresh);
        told += fresh[0] != 0;
        if (fresh[0])
            memcpy(policy, fresh, sizeof policy);
    }
    assert_in_range(told, 1, 4);
    assert_non_null(strstr(policy, "\"why\":[\"quality\",\"time\"]"));
    assert_non_null(strstr(policy, "\"budget_ms\":66"));
    assert_null(strstr(policy, "\"sharp_ms\":0,"));
    srv_hub_leave(f->hub, &p, now_ms);
}

static void png_has_no_quality_to_reduce(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    char policy[512];
    struct srv_participant *p = join(f, 0);
    tell(f, p, "stream.configure", "{\"format\":\"png\"}", 0);
    take_policy(f, p, 0, policy);
    assert_non_null(strstr(policy, "\"moving\":{\"format\":\"png\"}"));
    assert_non_null(strstr(policy, "\"final\":{\"format\":\"png\",\"size\":[512,512],"));
    assert_non_null(strstr(policy, "\"why\":[]"));
    move_until_final(f, p);
    /* With one at rest that would be the same there is nothing left to do, either. */
    tell(f, p, "stream.configure", "{\"lossless\":true}", 6000);
    job = drag(f, p, 2, 6000, 5);
    assert_true(job.is_sharp && job.targets[0].final);
    assert_false(next_job(f, 9000, &job));
    srv_hub_leave(f->hub, &p, 9000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, hub_set_up, hub_tear_down)
        TEST(the_policy_is_reported_with_its_reasons),
        TEST(png_has_no_quality_to_reduce),
        TEST(moving_then_final),
        TEST(a_new_session_starts_with_the_known_times_of_its_volume),
        TEST(changes_that_come_as_often_as_frames_are_due_do_not_wait),
        TEST(updates_coalesce_behind_a_job),
        TEST(a_cancelled_refinement_is_drawn_again),
        TEST(moving_frames_are_cancelled_late_and_never_twice_in_a_row),
        TEST(a_change_of_volume_or_stream_interrupts),
        TEST(an_intermediate_frame_precedes_a_slow_sharp_one),
        TEST(a_moving_frame_that_cannot_get_better_is_final),
        TEST(a_failed_view_is_reported_and_not_tried_again),
        TEST(participants_with_equal_settings_share_a_frame),
        TEST(frames_for_participants_that_left_are_counted),
        TEST(frames_dropped_at_shutdown_are_not_counted),
        TEST(idle_sessions_end),
        TEST(notifications_report_the_state_not_its_history),
        TEST(an_unloaded_volume_is_reported_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
