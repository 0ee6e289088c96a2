/* SPDX-License-Identifier: Apache-2.0
 *
 * Fair queueing between sessions, and between the participants of one session, in virtual time.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "common/fair_queue.h"
#include "support/compare.h"
#include "unit/server/schedule/simulation.h"

static void an_idle_account_saves_up_nothing_and_keeps_its_debt(void **state) {
    (void)state;
    struct srv_fair_account share = { 0 };
    assert_compare(srv_fair_start(&share, 500), ==, 500);
    srv_fair_charge(&share, 500, 30);
    assert_compare(srv_fair_start(&share, 510), ==, 530);
    srv_fair_correct(&share, 70);
    assert_compare(srv_fair_start(&share, 510), ==, 600);
    srv_fair_correct(&share, -90);
    assert_compare(srv_fair_start(&share, 505), ==, 510);
    assert_compare(srv_fair_start(&share, 9000), ==, 9000);
    assert_compare(srv_fair_protected_ms(9999, 500), ==, 0);
    assert_compare(srv_fair_protected_ms(10000, 500), ==, 1000);
    assert_compare(srv_fair_protected_ms(999, 0), ==, 0);
    assert_compare(srv_fair_protected_ms(1000, 0), ==, 100);
}

/* Clients that always want the next frame, in full detail: 15 and 212 ms. */
#define SMALL "{\"max_fps\":120,\"progressive\":false,\"size\":[512,512]}"
#define LARGE "{\"max_fps\":120,\"progressive\":false,\"size\":[2048,2048]}"

static void sessions_have_equal_shares_of_time_not_of_frames(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    sim_session(s, id);
    struct sim_client *small = sim_join(s, 0, s->f->id, 8, SMALL);
    struct sim_client *large = sim_join(s, 1, id, 8, LARGE);
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 5000);
    assert_compare(large->frames, >, 0);
    assert_compare(small->frames, >, 2 * large->frames);
    assert_compare(fabs(small->took_ms - large->took_ms), <, 0.1 * large->took_ms);
}

/* The sessions of one owner share the render time of one owner, both with frames of full size and
 * with moving frames whose detail falls. */
static void owners_have_equal_shares_however_many_sessions_they_have(void **state) {
    struct simulation *s = *state;
    static const char *const settings[] = { "{\"progressive\":false,\"size\":[1024,1024]}",
                                            "{\"size\":[4096,4096]}" };
    for (int i = 0; i < 2; i++) {
        char id[SRV_SESSION_ID_BYTES];
        double greedy_ms = 0;
        struct sim_client *modest = sim_join(s, 0, s->f->id, 20, settings[i]);
        for (unsigned c = 1; c < SIM_CLIENTS; c++) {
            sim_session_of(s, "greedy", id);
            sim_join(s, c, id, 20, settings[i]);
        }
        sim_run(s, 10000);
        sim_reset(s);
        sim_run(s, 60000);
        for (unsigned c = 1; c < SIM_CLIENTS; c++) {
            greedy_ms += s->clients[c].took_ms;
            assert_compare(s->clients[c].took_ms, >, 60000 / 2.0 / (SIM_CLIENTS - 1) * 0.7);
        }
        assert_compare(modest->took_ms, >, 0.42 * (modest->took_ms + greedy_ms));
        assert_compare(modest->took_ms, <, 0.58 * (modest->took_ms + greedy_ms));
        sim_tear_down(state);
        sim_set_up(state);
        s = *state;
    }
}

static void use_is_forgotten_within_seconds(void **state) {
    (void)state;
    struct srv_fair_use use = { 0 };
    assert_compare(srv_fair_used_portion(&use, 1000), ==, 0);
    for (int at_ms = 1000; at_ms < 6000; at_ms += 10)
        srv_fair_add_use(&use, 3, at_ms);
    const double part = srv_fair_used_portion(&use, 6000);
    assert_float_equal(part, 0.3, 0.01);
    assert_float_equal(srv_fair_used_portion(&use, 6500), part / exp(1), 1e-9);
    assert_compare(srv_fair_used_portion(&use, 0), ==,
                   srv_fair_used_portion(&use, 5990)); /* no future */
    srv_fair_add_use(&use, -1e6, 6500);
    assert_compare(srv_fair_used_portion(&use, 6500), ==, 0);
}

/* A view that fills three quarters of the time alone gets smaller frames beside other owners, but
 * as many. */
static void moving_views_keep_their_rate_beside_other_owners(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct sim_client *small = sim_join(s, 0, s->f->id, 33, "{\"size\":[660,660]}");
    sim_session_of(s, "greedy", id);
    struct sim_client *large = sim_join(s, 1, id, 20, "{\"size\":[4096,4096]}");
    large->period_ms = 0;
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 5000);
    const unsigned alone = small->frames;
    const double alone_ms = small->took_ms;
    assert_compare(alone_ms, >, 0.6 * 5000);
    large->period_ms = 20;
    large->next_ms = s->now_ms;
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 5000);
    assert_compare(small->frames, >=, 0.95 * alone);
    assert_compare(small->took_ms, <, 0.55 * 5000);
    large->period_ms = 0;
    sim_run(s, 4000);
    sim_reset(s);
    sim_run(s, 5000);
    assert_compare(small->took_ms, >, 0.9 * alone_ms);
}

static void time_received_while_all_others_are_idle_is_no_debt(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    sim_session(s, id);
    struct sim_client *slow = sim_join(s, 0, s->f->id, 30, "{\"max_fps\":30,\"size\":[512,512]}");
    struct sim_client *other = sim_join(s, 1, id, 30, "{\"max_fps\":30,\"size\":[512,512]}");
    s->mpx_ms = 400; /* more than the machine can render for both */
    slow->period_ms = other->period_ms = 0;
    sim_run(s, 1000);
    sim_turn(s, slow);
    s->fixed_ms = 20000; /* one frame, while no other client wants one */
    sim_run(s, 60000);
    s->fixed_ms = 2;
    slow->period_ms = other->period_ms = 1000.0 / 30;
    slow->next_ms = other->next_ms = s->now_ms;
    sim_turn(s, other);
    sim_turn(s, slow);
    sim_reset(s);
    sim_run(s, 3000);
    assert_compare(slow->frames, >, 0.8 * other->frames);
}

static void a_client_keeps_its_rate_beside_a_larger_one(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    struct sim_client *small = sim_join(s, 0, s->f->id, 33, "{\"size\":[256,256]}");
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 5000);
    unsigned alone = small->frames;
    sim_session(s, id);
    sim_join(s, 1, id, 33, "{\"size\":[2048,2048]}");
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 5000);
    assert_in_range(small->frames, alone * 3 / 4, alone);
}

static void the_earliest_deadline_of_the_eligible_sessions_goes_first(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    sim_session(s, id);
    struct sim_client *slow = sim_join(s, 0, s->f->id, 0, "{\"max_fps\":10,\"size\":[64,64]}");
    struct sim_client *fast = sim_join(s, 1, id, 0, "{\"max_fps\":60,\"size\":[64,64]}");
    s->fixed_ms = s->mpx_ms = 0; /* no account has a debt */
    sim_run(s, 5000);
    sim_turn(s, fast);
    sim_run(s, 5000); /* both rest; the slow client received its last frame earlier */
    sim_turn(s, slow);
    s->now_ms += 1;
    sim_turn(s, fast);
    double wait_ms;
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &s->job, &wait_ms));
    assert_true(sim_is_for(&s->job, fast));
    s->begun_ms = s->now_ms;
    s->end_ms = s->now_ms + 3;
    sim_run(s, 200);
    assert_int_equal(slow->seq, 1);
}

/* It does not matter when they joined or how often the view changes. */
static void participants_of_equal_settings_share_frames(void **state) {
    struct simulation *s = *state;
    s->fixed_ms = s->mpx_ms = 0.1;
    sim_join(s, 0, s->f->id, 7, "{\"max_fps\":1,\"size\":[16,16]}");
    for (unsigned i = 1; i < SIM_CLIENTS; i++) {
        sim_join(s, i, s->f->id, 0, "{\"max_fps\":30,\"size\":[320,200]}");
        sim_run(s, 1011);
    }
    sim_reset(s);
    sim_run(s, 10000);
    for (int i = 1; i < SIM_CLIENTS; i++)
        assert_in_range(s->clients[i].frames, 299, 301);
    assert_in_range(s->jobs, 308, 312);
}

/* The time of rendering is charged once, before the next frame begins, even if the frame is not
 * encoded yet. */
static void rendering_is_charged_before_encoding_ends(void **state) {
    struct simulation *s = *state;
    struct srv_render_job job[3];
    struct sim_client *hog = sim_join(s, 0, s->f->id, 0, "{\"size\":[512,512]}");
    sim_run(s, 3000);
    double wait_ms;
    for (int i = 0; i < 3; i++) {
        s->now_ms += 50;
        sim_turn(s, hog);
        assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &job[i], &wait_ms));
        if (i == 0)
            srv_schedule_rendered(s->f->schedule, &job[0], 400);
        if (i == 1) {
            sim_deliver(s, &job[0], 400);
            sim_deliver(s, &job[1], 100);
        }
    }
    assert_float_equal(job[1].start_ms, job[0].start_ms + 400, 1e-3);
    assert_float_equal(job[2].start_ms, job[1].start_ms + 100, 1e-3);
    srv_schedule_cancelled(s->f->schedule, &job[2], 0);
}

static void encoding_is_charged(void **state) {
    struct simulation *s = *state;
    char id[SRV_SESSION_ID_BYTES];
    sim_session(s, id);
    struct sim_client *fast = sim_join(s, 0, s->f->id, 8, SMALL);
    s->slow_encoder = sim_join(s, 1, id, 8, SMALL);
    s->encode_ms = 105; /* and 15 ms to render, like the frames of the other client */
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 10000);
    unsigned slow_frames = s->slow_encoder->frames;
    assert_compare(slow_frames, >, 0);
    assert_compare(fast->frames, >, 7 * slow_frames);
    assert_compare(fast->frames, <, 9 * slow_frames);
}

/* A frame that occupies an encode thread for long must not delay other participants. */
static void frames_that_are_slow_to_encode_are_made_one_at_a_time(void **state) {
    struct simulation *s = *state;
    struct srv_render_job one, other, next;
    double wait_ms;
    struct sim_client *driver =
        sim_join(s, 0, s->f->id, 0, "{\"max_fps\":120,\"size\":[2048,2048]}");
    struct sim_client *viewer =
        sim_join(s, 1, s->f->id, 0, "{\"max_fps\":120,\"size\":[2048,2048]}");
    sim_send(s, viewer, "stream.configure", "{\"format\":\"png\"}");
    s->mpx_ms = 1; /* so that frames have full detail */
    for (int i = 0; i < 3; i++) {
        sim_turn(s, driver);
        sim_run(s, 5000);
    }
    sim_turn(s, driver); /* both frames have one size; encoding takes 15 and 63 ms */
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &one, &wait_ms));
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &other, &wait_ms));
    struct srv_render_job *slow = one.is_slow_to_encode ? &one : &other,
                          *fast = one.is_slow_to_encode ? &other : &one;
    assert_true(slow->is_slow_to_encode);
    assert_true(sim_is_for(slow, viewer));
    assert_false(sim_is_for(slow, driver));
    assert_false(fast->is_slow_to_encode);
    assert_true(sim_is_for(fast, driver));
    assert_false(sim_is_for(fast, viewer));
    sim_deliver(s, fast, 1);
    s->now_ms += 10;
    sim_turn(s, driver);
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &next, &wait_ms));
    assert_true(sim_is_for(&next, driver));
    assert_false(sim_is_for(&next, viewer));
    assert_false(srv_schedule_next(s->f->schedule, s->now_ms, fast, &wait_ms));
    sim_deliver(s, &next, 1);
    sim_deliver(s, slow, 1);
    assert_true(srv_schedule_next(s->f->schedule, s->now_ms, &next, &wait_ms));
    assert_true(next.is_slow_to_encode);
    assert_true(sim_is_for(&next, viewer));
    sim_deliver(s, &next, 1);
}

/* The request assumes the size of the last moving frame; simulation.c checks each frame. */
static void a_frame_that_grows_is_known_to_be_slow_to_encode(void **state) {
    struct simulation *s = *state;
    struct sim_client *client =
        sim_join(s, 0, s->f->id, 8, "{\"format\":\"png\",\"size\":[2200,2200]}");
    s->mpx_ms = 20;
    sim_run(s, 3000);
    assert_compare(s->job.view.size[0], <, 1400); /* quick to encode */
    s->mpx_ms = 0.1;
    sim_run(s, 3000);
    assert_int_equal(s->job.view.size[0], 2200);
    assert_compare(client->frames, >, 50);
}

static void participants_have_equal_shares_of_their_session(void **state) {
    struct simulation *s = *state;
    struct sim_client *driver = sim_join(s, 0, s->f->id, 8, SMALL);
    struct sim_client *viewer = sim_join(s, 1, s->f->id, 0, LARGE);
    sim_run(s, 2000);
    sim_reset(s);
    sim_run(s, 5000);
    assert_compare(viewer->frames, >, 0);
    assert_compare(fabs(driver->took_ms - viewer->took_ms), <, 0.1 * viewer->took_ms);
}

static void the_participant_in_control_receives_as_much_as_all_others_together(void **state) {
    struct simulation *s = *state;
    struct sim_client *driver = sim_join(s, 0, s->f->id, 8, LARGE);
    sim_run(s, 100);
    sim_join(s, 1, s->f->id, 0, "{\"max_fps\":120,\"progressive\":false,\"size\":[2048,2047]}");
    sim_join(s, 2, s->f->id, 0, "{\"max_fps\":120,\"progressive\":false,\"size\":[2048,2046]}");
    sim_run(s, 5000);
    sim_reset(s);
    sim_run(s, 20000);
    double others_ms = s->clients[1].took_ms + s->clients[2].took_ms;
    assert_compare(fabs(driver->took_ms - others_ms), <, 0.1 * others_ms);
    assert_compare(fabs(s->clients[1].took_ms - s->clients[2].took_ms), <, 0.1 * others_ms);
}

static void settings_of_a_participant_interrupt_its_own_frame_only(void **state) {
    struct simulation *s = *state;
    struct sim_client *driver = sim_join(s, 0, s->f->id, 0, "{\"size\":[256,256]}");
    struct sim_client *viewer = sim_join(s, 1, s->f->id, 0, "{\"size\":[64,64]}");
    sim_run(s, 5000);
    unsigned before = s->f->interrupts;
    sim_send(s, viewer, "stream.configure", "{\"quality\":30}");
    assert_int_equal(s->f->interrupts, before + 1);
    assert_int_equal(s->f->why, SRV_INTERRUPT_NEWER_REQUEST);
    assert_int_equal(s->f->of, srv_participant_id(viewer->participant));
    (void)driver;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_idle_account_saves_up_nothing_and_keeps_its_debt),
#define TEST(name) cmocka_unit_test_setup_teardown(name, sim_set_up, sim_tear_down)
        cmocka_unit_test(use_is_forgotten_within_seconds),
        TEST(sessions_have_equal_shares_of_time_not_of_frames),
        TEST(moving_views_keep_their_rate_beside_other_owners),
        TEST(owners_have_equal_shares_however_many_sessions_they_have),
        TEST(time_received_while_all_others_are_idle_is_no_debt),
        TEST(a_client_keeps_its_rate_beside_a_larger_one),
        TEST(the_earliest_deadline_of_the_eligible_sessions_goes_first),
        TEST(participants_of_equal_settings_share_frames),
        TEST(rendering_is_charged_before_encoding_ends),
        TEST(encoding_is_charged),
        TEST(frames_that_are_slow_to_encode_are_made_one_at_a_time),
        TEST(a_frame_that_grows_is_known_to_be_slow_to_encode),
        TEST(participants_have_equal_shares_of_their_session),
        TEST(the_participant_in_control_receives_as_much_as_all_others_together),
        TEST(settings_of_a_participant_interrupt_its_own_frame_only),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
