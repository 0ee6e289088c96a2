/* SPDX-License-Identifier: Apache-2.0
 *
 * Time steps of a session: the frames while one is being loaded, and playing.
 */
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

/* Draws and acknowledges the frame that is due; returns its time step. */
static int draw(struct fixture *f, struct srv_participant *p, double now_ms, bool *is_final) {
    struct srv_render_job job;
    assert_true(hub_next_job(f, now_ms, &job));
    const struct fixture_step *shown = (const struct fixture_step *)job.volume;
    *is_final = job.targets[0].final;
    hub_finish(f, &job, 5);
    hub_ack(f, p, hub_drain(f, p, now_ms + 6).frame, now_ms + 8);
    return (int)(shown - f->steps);
}

/* Draws until nothing is wanted any more; returns the step of the last frame, which is final. */
static int settle(struct fixture *f, struct srv_participant *p, double now_ms) {
    struct srv_render_job job;
    const double end_ms = now_ms + 3000;
    bool is_final = false;
    int shown = -1;
    for (; hub_next_job(f, now_ms, &job); now_ms += 200) {
        assert_compare(now_ms, <, end_ms);
        shown = (int)((const struct fixture_step *)job.volume - f->steps);
        is_final = job.targets[0].final;
        hub_finish(f, &job, 5);
        hub_ack(f, p, hub_drain(f, p, now_ms + 6).frame, now_ms + 8);
    }
    assert_true(is_final);
    return shown;
}

static void load(struct fixture *f, unsigned step, double now_ms) {
    f->steps[step].is_loaded = true;
    srv_hub_step_loaded(f->hub, "v", now_ms);
}

/* Takes the messages of a participant; true if one of them contains `text`. */
static bool is_told(struct fixture *f, struct srv_participant *p, const char *text, double now_ms) {
    struct srv_message message;
    bool found = false;
    while (srv_hub_next_message(f->hub, p, SRV_NEXT_NOTIFICATIONS, now_ms, &message) ==
           SRV_MESSAGE_TEXT) {
        found = found || strstr(message.text, text);
        free(message.text);
    }
    return found;
}

static void frames_show_another_step_until_it_is_loaded(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    bool is_final;
    assert_int_equal(settle(f, p, 10), 0);
    hub_send(f, p, "view.update", "{\"seq\":1,\"patch\":{\"time\":{\"step\":2}}}", 10000);
    assert_true(is_told(f, p, "\"step\":2,\"count\":4,\"loading\":true", 10001));
    assert_int_equal(draw(f, p, 10010, &is_final), 0);
    assert_false(is_final);
    assert_false(hub_next_job(f, 20000, &job)); /* nothing sharper of the wrong step */
    hub_send(f, p, "view.update", "{\"seq\":2,\"patch\":{\"background\":[1,1,1,1]}}", 20010);
    assert_int_equal(draw(f, p, 20100, &is_final), 0);
    assert_false(is_final);
    load(f, 1, 20200); /* another one */
    assert_false(hub_next_job(f, 20300, &job));
    load(f, 2, 20400);
    assert_true(is_told(f, p, "\"step\":2,\"count\":4,\"loading\":false", 20401));
    assert_int_equal(settle(f, p, 20500), 2);
    srv_hub_leave(f->hub, &p, 30000);
}

/* A client that takes final frames only gets none of a wrong step. */
static void clients_without_moving_detail_wait(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    hub_send(f, p, "stream.configure", "{\"progressive\":false}", 1);
    assert_int_equal(settle(f, p, 10), 0);
    hub_send(f, p, "view.update", "{\"seq\":1,\"patch\":{\"time\":{\"step\":3}}}", 10000);
    assert_false(hub_next_job(f, 20000, &job));
    load(f, 3, 20100);
    assert_int_equal(settle(f, p, 20200), 3);
    srv_hub_leave(f->hub, &p, 30000);
}

static void steps_follow_the_clock_and_wait_for_their_loads(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    bool is_final;
    f->steps[1].is_loaded = f->steps[2].is_loaded = true;
    settle(f, p, 10);
    hub_send(f, p, "time.play", "{\"steps\":10}", 10000);
    assert_int_equal(draw(f, p, 10010, &is_final), 0); /* the rate is a change of the view */
    assert_false(hub_next_job(f, 10050, &job) && job.step == SRV_STEP_MOVING);
    assert_int_equal(draw(f, p, 10110, &is_final), 1);
    assert_int_equal(draw(f, p, 10210, &is_final), 2);
    assert_int_equal(draw(f, p, 10310, &is_final), 2); /* 3 is not loaded */
    assert_false(is_final);
    assert_false(hub_next_job(f, 12000, &job));
    load(f, 3, 12100);
    assert_int_equal(draw(f, p, 12110, &is_final), 3);
    assert_int_equal(draw(f, p, 12150, &is_final), 0); /* late, and from the start */
    hub_send(f, p, "time.play", "{\"steps\":-10}", 12200);
    assert_int_equal(draw(f, p, 12210, &is_final), 0);
    assert_int_equal(draw(f, p, 12310, &is_final), 3);
    hub_send(f, p, "time.stop", "{}", 12350);
    assert_int_equal(settle(f, p, 12360), 3);
    srv_hub_leave(f->hub, &p, 20000);
}

static void a_step_that_cannot_be_loaded_ends_playing(void **state) {
    struct fixture *f = *state;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    bool is_final;
    settle(f, p, 10);
    hub_send(f, p, "time.play", "{\"steps\":10}", 10000);
    draw(f, p, 10010, &is_final);
    assert_int_equal(draw(f, p, 10110, &is_final), 0);
    f->steps[1].has_failed = true;
    srv_hub_step_loaded(f->hub, "v", 10200);
    assert_true(is_told(f, p, "the disk is gone", 10210));
    hub_send(f, p, "view.update", "{\"seq\":1,\"patch\":{\"time\":{\"step\":0}}}", 10300);
    assert_int_equal(settle(f, p, 10310), 0);
    srv_hub_leave(f->hub, &p, 20000);
}

static void load_other(struct fixture *f, unsigned step, double now_ms) {
    f->others[step].is_loaded = true;
    srv_hub_step_loaded(f->hub, "w", now_ms);
}

/* The volumes that layers name follow the time, and frames are final once they are there. */
static void other_volumes_follow(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    bool is_final;
    f->steps[1].is_loaded = f->steps[2].is_loaded = true;
    assert_int_equal(settle(f, p, 10), 0);
    hub_send(f, p, "view.update",
             "{\"seq\":1,\"patch\":{\"layers\":[{\"type\":\"volume\"},"
             "{\"type\":\"points\",\"id\":\"w\"}]}}",
             10000);
    assert_true(is_told(f, p, "\"step\":0,\"count\":4,\"loading\":true", 10001));
    draw(f, p, 10010, &is_final);
    assert_false(is_final);
    load_other(f, 0, 10100);
    assert_int_equal(settle(f, p, 10200), 0);
    hub_send(f, p, "time.play", "{\"steps\":10}", 20000);
    draw(f, p, 20010, &is_final);
    assert_int_equal(draw(f, p, 20110, &is_final), 1);
    assert_false(is_final);
    assert_false(hub_next_job(f, 22000, &job)); /* the time waits for the other volume */
    load_other(f, 2, 22050);                    /* not the displayed step */
    assert_false(hub_next_job(f, 22100, &job));
    load_other(f, 1, 22150);
    assert_int_equal(draw(f, p, 22160, &is_final), 1);
    assert_int_equal(draw(f, p, 22270, &is_final), 2);
    hub_send(f, p, "time.stop", "{}", 22280);
    assert_int_equal(settle(f, p, 22300), 2);
    /* A layer that is gone needs no step. */
    hub_send(f, p, "view.update", "{\"seq\":2,\"patch\":{\"time\":{\"step\":1}}}", 30000);
    f->others[1].is_loaded = false;
    hub_send(f, p, "view.update", "{\"seq\":3,\"patch\":{\"layers\":[{\"type\":\"volume\"}]}}",
             30010);
    assert_int_equal(settle(f, p, 30100), 1);
    srv_hub_leave(f->hub, &p, 40000);
}

/* A volume is loaded after a layer has named it. From then on frames also wait for its time step.
 * Once it is unloaded, the session keeps no use of it. */
static void other_volumes_come_and_go(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    bool is_final;
    f->is_missing = f->steps[2].is_loaded = true;
    hub_send(f, p, "view.update",
             "{\"seq\":1,\"patch\":{\"time\":{\"step\":2},\"layers\":[{\"type\":\"volume\"},"
             "{\"type\":\"points\",\"id\":\"w\"}]}}",
             10);
    assert_int_equal(settle(f, p, 20), 2);
    f->is_missing = false;
    srv_hub_volume_progress(f->hub, "w", "ready", 1, "", 10000);
    draw(f, p, 10010, &is_final);
    assert_false(is_final);
    assert_false(hub_next_job(f, 13000, &job)); /* nothing sharper of another step */
    load_other(f, 2, 13100);
    assert_int_equal(settle(f, p, 13200), 2);
    const int uses = f->uses;
    f->is_missing = true;
    srv_hub_volume_progress(f->hub, "w", "unloaded", 0, "", 19000);
    assert_int_equal(f->uses, uses - 1);
    srv_hub_leave(f->hub, &p, 20000);
}

/* No frame that lacks another volume's step counts as final without a word. */
static void a_step_without_memory_is_reported(void **state) {
    struct fixture *f = *state;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    bool is_final;
    assert_int_equal(settle(f, p, 10), 0);
    f->is_out_of_memory = f->others[0].is_loaded = true;
    hub_send(f, p, "view.update",
             "{\"seq\":1,\"patch\":{\"layers\":[{\"type\":\"volume\"},"
             "{\"type\":\"points\",\"id\":\"w\"}]}}",
             10000);
    assert_true(is_told(f, p, "out of memory for a time step", 10001));
    draw(f, p, 10010, &is_final);
    assert_false(is_final);
    f->is_out_of_memory = false;
    f->steps[1].is_loaded = f->others[1].is_loaded = true;
    hub_send(f, p, "view.update", "{\"seq\":2,\"patch\":{\"time\":{\"step\":1}}}", 20000);
    assert_int_equal(settle(f, p, 20010), 1);
    srv_hub_leave(f->hub, &p, 30000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(frames_show_another_step_until_it_is_loaded,
                                        hub_set_up_series, hub_tear_down),
        cmocka_unit_test_setup_teardown(clients_without_moving_detail_wait, hub_set_up_series,
                                        hub_tear_down),
        cmocka_unit_test_setup_teardown(steps_follow_the_clock_and_wait_for_their_loads,
                                        hub_set_up_series, hub_tear_down),
        cmocka_unit_test_setup_teardown(other_volumes_follow, hub_set_up_series, hub_tear_down),
        cmocka_unit_test_setup_teardown(other_volumes_come_and_go, hub_set_up_series,
                                        hub_tear_down),
        cmocka_unit_test_setup_teardown(a_step_without_memory_is_reported, hub_set_up_series,
                                        hub_tear_down),
        cmocka_unit_test_setup_teardown(a_step_that_cannot_be_loaded_ends_playing,
                                        hub_set_up_series, hub_tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
