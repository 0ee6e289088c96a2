/* SPDX-License-Identifier: Apache-2.0
 *
 * Which frames follow a change of the view, and which jobs it cancels: moving, intermediate and
 * final frames. The test takes and ends the jobs, and passes the time.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "unit/server/session/hub_fixture.h"

static void moving_then_final(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 1000);
    assert_true(hub_next_job(f, 1000, &job));
    /* The time of a frame is not known yet. */
    assert_int_equal(job.step, SRV_STEP_MOVING);
    assert_compare(job.view.size[0], <, 512);
    assert_int_equal(job.targets[0].quality, 60);
    hub_finish(f, &job, 5);
    struct proto_frame_header header = hub_drain(f, p, 1010);
    assert_int_equal(header.frame, 1);
    assert_int_equal(header.flags, PROTO_FRAME_KEY);
    hub_ack(f, p, 1, 1012);
    assert_true(hub_next_job(f, 1200, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    assert_true(job.is_refinement);
    assert_int_equal(job.view.size[0], 512);
    assert_int_equal(job.targets[0].quality, 90);
    hub_finish(f, &job, 20);
    header = hub_drain(f, p, 1230);
    assert_int_equal(header.flags, PROTO_FRAME_KEY | PROTO_FRAME_FINAL);
    hub_ack(f, p, 2, 1240);
    assert_false(hub_next_job(f, 5000, &job)); /* the view rests */
    hub_update(f, p, 7, 5000);
    assert_true(hub_next_job(f, 5001, &job));
    assert_int_equal(job.step, SRV_STEP_MOVING);
    assert_int_equal(job.targets[0].seq, 7);
    hub_finish(f, &job, 5);
    header = hub_drain(f, p, 5010);
    assert_int_equal(header.seq, 7);
    /* It arrived at 5000 and was sent at 5010. */
    assert_int_equal(header.queue_us + header.render_us + header.encode_us, 10000);
    hub_ack(f, p, 3, 5012);
    assert_true(hub_next_job(f, 5200, &job));
    hub_finish(f, &job, 20);
    header = hub_drain(f, p, 5230);
    assert_int_equal(header.seq, 7);
    assert_int_equal(header.queue_us, 0); /* the user has seen the update */
    srv_hub_leave(f->hub, &p, 5020);
}

/* For a volume larger than memory, frames show the bricks read so far before the final frame. */
static void a_view_at_rest_is_shown_while_it_is_read(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 1000);
    assert_true(hub_next_job(f, 1000, &job));
    hub_finish(f, &job, 5);
    hub_drain(f, p, 1010);
    hub_ack(f, p, 1, 1012);
    for (unsigned frame = 2; frame <= 4; frame++) {
        const bool is_being_read = frame < 4;
        const double now_ms = 1000.0 + 1000 * frame;
        assert_true(hub_next_job(f, now_ms, &job));
        assert_int_equal(job.step, SRV_STEP_FINAL);
        assert_true(job.is_refinement);
        /* The last one lacks damaged bricks: nothing better follows. */
        srv_schedule_incomplete(f->schedule, &job, is_being_read);
        hub_finish(f, &job, 20);
        const struct proto_frame_header header = hub_drain(f, p, now_ms + 30);
        assert_int_equal(header.frame, frame);
        assert_int_equal(header.flags & PROTO_FRAME_FINAL, is_being_read ? 0 : PROTO_FRAME_FINAL);
        hub_ack(f, p, frame, now_ms + 32);
    }
    assert_false(hub_next_job(f, 9000, &job));
    srv_hub_leave(f->hub, &p, 9010);
}

/* A client that wants final frames only never gets a part, also with others in the session. */
static void who_wants_final_frames_gets_no_parts(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 1000);
    struct srv_participant *q = hub_join(f, SRV_ROLE_CONTROL, 1000);
    bool is_shared = false;
    hub_send(f, q, "stream.configure", "{\"progressive\":false}", 1000);
    for (double now_ms = 1001; hub_next_job(f, now_ms, &job); now_ms += 1000) {
        assert_true(job.is_refinement || job.step == SRV_STEP_MOVING || job.target_count == 2);
        assert_false(job.is_refinement && job.target_count == 2); /* only these take parts */
        is_shared = is_shared || (job.step == SRV_STEP_FINAL && job.target_count == 2);
        hub_finish(f, &job, 5);
        hub_ack(f, p, hub_drain(f, p, now_ms + 10).frame, now_ms + 12);
        hub_ack(f, q, hub_drain(f, q, now_ms + 10).frame, now_ms + 12);
    }
    assert_true(is_shared);
    srv_hub_leave(f->hub, &p, 9000);
    srv_hub_leave(f->hub, &q, 9000);
}

static void a_new_session_starts_with_the_known_times_of_its_volume(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    char id[SRV_SESSION_ID_BYTES];
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 1000);
    assert_true(hub_next_job(f, 1000, &job));
    uint64_t first = job.session;
    hub_finish(f, &job, 5);
    proto_json *json = srv_hub_session_create(f->hub, NULL, &(const struct srv_owner){ .name = "" },
                                              false, 1010, id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
    struct srv_participant *next = srv_hub_join(f->hub, id, SRV_ROLE_CONTROL, "", NULL, 1010, NULL);
    assert_non_null(next);
    assert_true(hub_next_job(f, 1010, &job));
    assert_int_not_equal(job.session, first);
    assert_true(job.is_sharp);
    hub_finish(f, &job, 20);
    srv_hub_leave(f->hub, &next, 1030);
    srv_hub_leave(f->hub, &p, 1030);
}

static void updates_coalesce_while_a_job_runs(void **state) {
    struct fixture *f = *state;
    struct srv_render_job first, second, none;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    assert_true(hub_next_job(f, 1, &first));
    for (unsigned seq = 1; seq <= 9; seq++)
        hub_update(f, p, seq, 2);
    assert_true(hub_next_job(f, 40, &second));
    assert_int_equal(second.targets[0].seq, 9);
    assert_false(srv_schedule_is_newest(f->schedule, &first));
    assert_true(srv_schedule_is_newest(f->schedule, &second));
    assert_false(hub_next_job(f, 500, &none)); /* two are in flight: the first window is full */
    /* They end in the wrong order: the older frame is dropped. */
    hub_finish(f, &second, 1);
    hub_finish(f, &first, 1);
    struct proto_frame_header header = hub_drain(f, p, 60);
    assert_int_equal(header.frame, 1);
    assert_int_equal(header.seq, 9);
    srv_hub_leave(f->hub, &p, 70);
}

static void a_cancelled_refinement_is_rendered_again(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    assert_true(hub_next_job(f, 1, &job));
    hub_finish(f, &job, 1);
    hub_drain(f, p, 2);
    hub_ack(f, p, 1, 3);
    assert_true(hub_next_job(f, 200, &job));
    assert_true(job.is_refinement);
    unsigned before = f->interrupts;
    hub_update(f, p, 1, 210);
    assert_int_equal(f->interrupts, before + 1);
    srv_schedule_cancelled(f->schedule, &job, 1);
    assert_true(hub_next_job(f, 240, &job));
    assert_false(job.is_refinement);
    hub_finish(f, &job, 1);
    hub_drain(f, p, 250);
    hub_ack(f, p, 2, 251);
    assert_true(hub_next_job(f, 400, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    srv_schedule_cancelled(f->schedule, &job, 1); /* also without a newer view */
    assert_true(hub_next_job(f, 500, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    hub_finish(f, &job, 1);
    srv_hub_leave(f->hub, &p, 600);
}

/* Slices beside the image give the view a new version while a frame of it is drawn. */
static void a_cancelled_frame_is_rendered_again_after_a_change_of_slices(void **state) {
    static const char *const slices = "{\"seq\":1,\"patch\":{\"slices\":{\"mode\":\"oblique\"}}}";
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    assert_true(hub_next_job(f, 1, &job));
    hub_finish(f, &job, 1);
    hub_drain(f, p, 2);
    hub_ack(f, p, 1, 3);
    assert_true(hub_next_job(f, 200, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    hub_send(f, p, "view.update", slices, 210);
    assert_true(srv_schedule_is_newest(f->schedule, &job));
    srv_schedule_cancelled(f->schedule, &job, 1);
    assert_true(hub_next_job(f, 420, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    hub_finish(f, &job, 1);
    assert_false(hub_next_job(f, 600, &job));
    srv_hub_leave(f->hub, &p, 610);
}

/* For any time between the changes and the first frame, and with some jitter. */
static void changes_that_come_as_often_as_frames_are_due_do_not_wait(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    for (unsigned k = 1; k <= 10; k++) {
        double begin_ms = 10000.0 * k;
        struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, begin_ms);
        hub_send(f, p, "stream.configure", "{\"max_fps\":30}", begin_ms);
        while (hub_next_job(f, begin_ms++, &job)) {
            hub_finish(f, &job, 1);
            hub_ack(f, p, hub_drain(f, p, begin_ms).frame, begin_ms);
        }
        for (unsigned i = 1; i <= 60; i++) {
            double now_ms = begin_ms + 9.7 * k + i * 1000.0 / 30 + i % 3;
            hub_update(f, p, i, now_ms);
            assert_true(hub_next_job(f, now_ms, &job));
            hub_finish(f, &job, 1);
            hub_ack(f, p, hub_drain(f, p, now_ms).frame, now_ms);
        }
        srv_hub_leave(f->hub, &p, begin_ms + 5000);
    }
}

static void moving_frames_are_cancelled_late_and_never_twice_in_a_row(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    assert_true(hub_next_job(f, 1000, &job));
    assert_compare(job.cancellable_from_ms, ==, INFINITY); /* it classifies for all later frames */
    hub_finish(f, &job, 5);
    hub_ack(f, p, hub_drain(f, p, 1005).frame, 1006);
    hub_update(f, p, 1, 2000);
    assert_true(hub_next_job(f, 2000, &job));
    assert_compare(job.cancellable_from_ms, ==, 2000 + 2 * SRV_QUALITY_BUDGET_MS);
    uint32_t before = job.view.size[0];
    hub_update(f, p, 2, 2140);
    assert_int_equal(f->why, SRV_INTERRUPT_NEWER_VIEW);
    srv_schedule_cancelled(f->schedule, &job, 140);
    assert_true(hub_next_job(f, 2141, &job));
    assert_int_equal(job.targets[0].seq, 2);
    if (job.mip_level == 0)
        assert_compare(job.view.size[0], <, before);
    assert_compare(job.cancellable_from_ms, ==, INFINITY);
    hub_finish(f, &job, 30);
    hub_ack(f, p, hub_drain(f, p, 2171).frame, 2172);
    hub_update(f, p, 3, 2300);
    assert_true(hub_next_job(f, 2300, &job));
    if (job.mip_level != SP_MIP_LEVEL_MAX)
        assert_compare(job.cancellable_from_ms, <, INFINITY);
    hub_finish(f, &job, 30);
    hub_ack(f, p, hub_drain(f, p, 2330).frame, 2331);
    /* A new transfer function is work that the next frame needs as well. */
    hub_send(f, p, "view.update",
             "{\"seq\":4,\"patch\":{\"transfer_function\":{\"reference_length\":2}}}", 2500);
    assert_true(hub_next_job(f, 2500, &job));
    assert_compare(job.cancellable_from_ms, ==, INFINITY);
    hub_finish(f, &job, 30);
    srv_hub_leave(f->hub, &p, 2600);
    assert_int_equal(f->why, SRV_INTERRUPT_UNWANTED);
}

static uint64_t pixels(const uint32_t size[2]) {
    return (uint64_t)size[0] * size[1];
}

static uint64_t bit_of(const struct srv_render_job *job, const struct srv_participant *p) {
    for (uint32_t i = 0; i < job->target_count; i++)
        if (job->targets[i].participant == srv_participant_id(p))
            return UINT64_C(1) << i;
    return 0;
}

static void a_frame_that_does_not_fit_makes_those_of_its_clients_smaller(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job, next;
    struct srv_participant *a = hub_join(f, SRV_ROLE_CONTROL, 0),
                           *b = hub_join(f, SRV_ROLE_VIEW, 0);
    assert_true(hub_next_job(f, 1000, &job));
    assert_int_equal(job.target_count, 2);
    assert_false(srv_schedule_shrink(f->schedule, &job, 0, 1000));
    assert_true(srv_schedule_shrink(f->schedule, &job, bit_of(&job, a), 1000));
    srv_schedule_cancelled(f->schedule, &job, 0);
    for (int i = 0; i < 2; i++) {
        assert_true(hub_next_job(f, 1000, &next));
        assert_int_equal(next.target_count, 1);
        if (bit_of(&next, a))
            assert_compare(pixels(next.full), <=, pixels(job.view.size) / 2);
        else
            assert_compare(pixels(next.full), ==, pixels(job.full));
        memcpy(next.view.size, (uint32_t[]){ 128, 128 }, sizeof next.view.size);
        assert_false(srv_schedule_shrink(f->schedule, &next, UINT64_MAX, 1000));
        hub_finish(f, &next, 5);
    }
    hub_ack(f, a, hub_drain(f, a, 1005).frame, 1006);
    hub_ack(f, b, hub_drain(f, b, 1005).frame, 1006);
    hub_update(f, a, 1, 1000 + SRV_SHRINK_MS);
    assert_true(hub_next_job(f, 1000 + SRV_SHRINK_MS, &next));
    assert_int_equal(next.target_count, 2);
    assert_compare(pixels(next.full), ==, pixels(job.full));
    hub_finish(f, &next, 5);
    srv_hub_leave(f->hub, &b, 12000);
    srv_hub_leave(f->hub, &a, 12000);
}

/* The session has no owner, so that "ann" is a guest. */
static void frames_that_only_guests_get_count_for_the_guests(void **state) {
    struct fixture *f = *state;
    struct srv_quota quota = { .fps = 0 };
    struct srv_render_job job;
    f->quota = &quota;
    f->rights = SRV_RIGHT_VIEW;
    struct srv_participant *owner = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_participant *guest = srv_hub_join(f->hub, f->id, SRV_ROLE_VIEW, "ann", f, 0, NULL);
    assert_non_null(guest);
    assert_true(hub_next_job(f, 0, &job));
    assert_int_equal(job.target_count, 2);
    const uint64_t owners = bit_of(&job, owner), guests = bit_of(&job, guest);
    assert_true(srv_render_job_owner(&job, guests).is_guests);
    assert_false(srv_render_job_owner(&job, owners).is_guests);
    assert_false(srv_render_job_owner(&job, owners | guests).is_guests);
    hub_finish(f, &job, 5);
    srv_hub_leave(f->hub, &owner, 10);
    srv_hub_leave(f->hub, &guest, 10);
}

static void a_change_of_volume_or_stream_interrupts(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    assert_true(hub_next_job(f, 1, &job));
    hub_send(f, p, "view.update", "{\"seq\":1,\"patch\":{\"volume\":\"w\"}}", 5);
    assert_int_equal(f->why, SRV_INTERRUPT_UNWANTED);
    srv_schedule_cancelled(f->schedule, &job, 4);
    assert_true(hub_next_job(f, 40, &job));
    hub_send(f, p, "view.update", "{\"seq\":2,\"patch\":{\"volume\":\"v\"}}", 45);
    assert_int_equal(f->why,
                     SRV_INTERRUPT_NEWER_VIEW); /* switching to and fro must show something */
    assert_compare(job.cancellable_from_ms, ==, INFINITY);
    hub_finish(f, &job, 10);
    unsigned before = f->interrupts;
    hub_send(f, p, "stream.configure", "{\"max_fps\":60}", 60);
    assert_int_equal(f->interrupts, before); /* the frame stays the same */
    hub_send(f, p, "stream.configure", "{\"size\":[64,64]}", 60);
    assert_int_equal(f->interrupts, before + 1);
    srv_hub_leave(f->hub, &p, 70);
}

static void an_intermediate_frame_precedes_a_slow_sharp_one(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    hub_send(f, p, "stream.configure", "{\"lossless\":true}", 0);
    assert_true(hub_next_job(f, 0, &job)); /* 256 px take 500 ms, hence the full size 2 s */
    hub_finish(f, &job, 500);
    hub_ack(f, p, hub_drain(f, p, 500).frame, 501);
    assert_true(hub_next_job(f, 700, &job));
    hub_finish(f, &job, 2000);
    hub_ack(f, p, hub_drain(f, p, 2700).frame, 2701);
    struct srv_render_job moving = hub_drag(f, p, 1, 5000, 60);
    assert_int_equal(moving.step, SRV_STEP_MOVING);
    assert_true(hub_next_job(f, 5200, &job));
    assert_int_equal(job.step, SRV_STEP_INTERMEDIATE);
    assert_true(job.is_refinement);
    assert_compare(job.cancellable_from_ms, ==, 0);
    if (job.mip_level >= moving.mip_level)
        assert_compare(job.view.size[0], >, moving.view.size[0]);
    assert_int_equal(job.targets[0].quality, 90);
    assert_int_equal(job.targets[0].format, SP_IMAGE_JPEG);
    hub_finish(f, &job, 400);
    struct proto_frame_header header = hub_drain(f, p, 5600);
    assert_int_equal(header.flags & PROTO_FRAME_FINAL, 0);
    hub_ack(f, p, header.frame, 5601);
    assert_true(hub_next_job(f, 5602, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    assert_int_equal(job.mip_level, 0);
    assert_int_equal(job.view.size[0], 512);
    assert_int_equal(job.targets[0].format, SP_IMAGE_PNG);
    hub_finish(f, &job, 2000);
    header = hub_drain(f, p, 7602);
    assert_int_equal(header.flags & PROTO_FRAME_FINAL, PROTO_FRAME_FINAL);
    assert_false(hub_next_job(f, 20000, &job));
    srv_hub_leave(f->hub, &p, 20000);
}

static void a_moving_frame_that_cannot_get_better_is_final(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    hub_send(f, p, "stream.configure", "{\"quality\":60}", 0);
    hub_drag_until_final(f, p);
    /* With a higher quality at rest, another frame follows. */
    hub_send(f, p, "stream.configure", "{\"quality\":61}", 6000);
    job = hub_drag(f, p, 2, 6000, 5);
    assert_true(job.is_sharp);
    assert_false(job.targets[0].final);
    assert_true(hub_next_job(f, 6500, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    assert_true(job.is_sharp);
    hub_finish(f, &job, 5);
    srv_hub_leave(f->hub, &p, 7000);
}

/* Renders the newest view in 60 ms, or in 20 as a draft, of full size. */
static struct srv_render_job render(struct fixture *f, struct srv_participant *p, unsigned seq,
                                    double now_ms) {
    struct srv_render_job job;
    hub_update(f, p, seq, now_ms);
    assert_true(hub_next_job(f, now_ms, &job));
    const double part = (double)job.view.size[0] * job.view.size[1] / (job.full[0] * job.full[1]);
    const struct srv_render_job copy = job;
    const double ms = (job.is_draft ? 20 : 60) * (0.2 + 0.8 * part);
    hub_finish(f, &job, ms);
    hub_ack(f, p, hub_drain(f, p, now_ms + ms).frame, now_ms + ms + 1);
    return copy;
}

static void a_draft_is_drawn_again_when_the_view_rests(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    f->draws_drafts = true;
    hub_send(f, p, "stream.configure", "{\"quality\":60}", 0);
    assert_true(hub_next_job(f, 0, &job));
    assert_true(job.is_draft);
    hub_finish(f, &job, 8);
    hub_ack(f, p, hub_drain(f, p, 8).frame, 9);
    for (unsigned i = 1; i < 40; i++)
        job = render(f, p, i, 100 * i);
    assert_int_equal(job.step, SRV_STEP_MOVING);
    assert_int_equal(job.mip_level, 0);
    assert_int_equal(job.view.size[0], job.full[0]);
    assert_true(job.is_draft);
    assert_false(job.is_sharp);
    assert_false(job.targets[0].final);
    assert_true(hub_next_job(f, 6500, &job));
    assert_int_equal(job.step, SRV_STEP_FINAL);
    assert_false(job.is_draft);
    assert_true(job.is_sharp);
    hub_finish(f, &job, 60);
    const struct proto_frame_header header = hub_drain(f, p, 6560);
    assert_int_equal(header.flags & PROTO_FRAME_FINAL, PROTO_FRAME_FINAL);
    assert_false(hub_next_job(f, 20000, &job));
    srv_hub_leave(f->hub, &p, 20000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, hub_set_up, hub_tear_down)
        TEST(moving_then_final),
        TEST(a_view_at_rest_is_shown_while_it_is_read),
        TEST(who_wants_final_frames_gets_no_parts),
        TEST(a_new_session_starts_with_the_known_times_of_its_volume),
        TEST(updates_coalesce_while_a_job_runs),
        TEST(a_cancelled_refinement_is_rendered_again),
        TEST(a_cancelled_frame_is_rendered_again_after_a_change_of_slices),
        TEST(changes_that_come_as_often_as_frames_are_due_do_not_wait),
        TEST(moving_frames_are_cancelled_late_and_never_twice_in_a_row),
        TEST(a_frame_that_does_not_fit_makes_those_of_its_clients_smaller),
        TEST(frames_that_only_guests_get_count_for_the_guests),
        TEST(a_change_of_volume_or_stream_interrupts),
        TEST(an_intermediate_frame_precedes_a_slow_sharp_one),
        TEST(a_moving_frame_that_cannot_get_better_is_final),
        TEST(a_draft_is_drawn_again_when_the_view_rests),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
