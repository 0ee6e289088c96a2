/* SPDX-License-Identifier: Apache-2.0
 *
 * stream.policy: what the daemon tells a client about its frames, and why.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "session/session.h"
#include "support/compare.h"
#include "unit/server/session/hub_fixture.h"

/* Takes all messages of a participant; policy = the last stream.policy among them, or "". */
static void receive_policy(struct fixture *f, struct srv_participant *p, double now_ms,
                           char policy[512]) {
    struct srv_message message;
    enum srv_message_kind kind;
    policy[0] = 0;
    while ((kind = srv_hub_next_message(f->hub, p, SRV_NEXT_ALL, now_ms, &message)) !=
           SRV_MESSAGE_NONE) {
        if (kind == SRV_MESSAGE_TEXT && strstr(message.text, "stream.policy"))
            snprintf(policy, 512, "%.*s", (int)message.size, message.text);
        if (kind == SRV_MESSAGE_FRAME)
            hub_ack(f, p, message.header.frame, now_ms);
        srv_blob_unref(&message.blob);
        free(message.text);
    }
}

static void the_policy_is_reported_with_its_reasons(void **state) {
    struct fixture *f = *state;
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    struct srv_render_job job;
    char policy[512];
    receive_policy(f, p, 0, policy);
    assert_non_null(strstr(policy, "\"why\":[\"quality\"]"));
    assert_non_null(strstr(policy, "\"moving\":{\"format\":\"jpeg\",\"quality\":60,"
                                   "\"subsampling\":\"4:2:0\"}"));
    assert_non_null(strstr(policy, "\"final\":{\"format\":\"jpeg\",\"quality\":90,"
                                   "\"subsampling\":\"4:4:4\",\"size\":[512,512],\"coarse\":0}"));
    /* The first frame is small, because its time is not known. The policy says so once the view
     * rests. */
    assert_true(hub_next_job(f, 0, &job));
    assert_int_equal(job.step, SRV_STEP_MOVING);
    hub_finish(f, &job, 200);
    receive_policy(f, p, 10, policy);
    assert_string_equal(policy, "");
    double now_ms = 200;
    while (hub_next_job(f, now_ms, &job))
        hub_finish(f, &job, 800);
    receive_policy(f, p, now_ms, policy);
    assert_non_null(strstr(policy, "\"why\":[\"quality\",\"unknown_time\"]"));
    assert_non_null(strstr(policy, "\"size\":[256,256]"));
    /* A sharp frame takes 800 ms and the budget is 33.3 ms. The policy is sent at most twice per
     * second. */
    unsigned reports = 0;
    for (unsigned i = 1; i <= 9; i++) {
        now_ms += 200;
        hub_update(f, p, i, now_ms);
        assert_true(hub_next_job(f, now_ms, &job));
        hub_finish(f, &job, 800.0 * job.view.size[0] / 512 / (1 << job.mip_level));
        char fresh[512];
        receive_policy(f, p, now_ms, fresh);
        reports += fresh[0] != 0;
        if (fresh[0])
            memcpy(policy, fresh, sizeof policy);
    }
    assert_in_range(reports, 1, 4);
    assert_non_null(strstr(policy, "\"why\":[\"quality\",\"time\"]"));
    assert_non_null(strstr(policy, "\"budget_ms\":33.3"));
    assert_null(strstr(policy, "\"sharp_ms\":0,"));
    srv_hub_leave(f->hub, &p, now_ms);
}

static void png_has_no_quality_to_reduce(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    char policy[512];
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    hub_send(f, p, "stream.configure", "{\"format\":\"png\"}", 0);
    receive_policy(f, p, 0, policy);
    assert_non_null(strstr(policy, "\"moving\":{\"format\":\"png\"}"));
    assert_non_null(strstr(policy, "\"final\":{\"format\":\"png\",\"size\":[512,512],"));
    assert_non_null(strstr(policy, "\"why\":[]"));
    hub_drag_until_final(f, p);
    /* A lossless frame at rest would be the same, so none follows. */
    hub_send(f, p, "stream.configure", "{\"lossless\":true}", 6000);
    job = hub_drag(f, p, 2, 6000, 5);
    assert_true(job.is_sharp);
    assert_true(job.targets[0].final);
    assert_false(hub_next_job(f, 9000, &job));
    srv_hub_leave(f->hub, &p, 9000);
}

/* The client takes video where the network is too slow for images, and only there. */
static void a_slow_network_is_a_reason(void **state) {
    struct fixture *f = *state;
    struct srv_render_job job;
    char policy[512];
    struct srv_participant *p = hub_join(f, SRV_ROLE_CONTROL, 0);
    hub_send(f, p, "stream.configure", "{\"format\":[\"jpeg\",\"vp8\",\"vp9\"]}", 0);
    receive_policy(f, p, 0, policy);
    assert_non_null(strstr(policy, "\"moving\":{\"format\":\"jpeg\",\"quality\":60"));
    p->delivery.rate_control.is_video = true;
    p->delivery.rate_control.step = 3;
    hub_update(f, p, 1, 5000);
    assert_true(hub_next_job(f, 5001, &job));
    assert_int_equal(job.targets[0].video, SP_VIDEO_VP8);
    assert_int_equal(job.targets[0].quality, 40);
    assert_compare(job.view.size[0], <=, 512 * 6 / 8);
    size_t size;
    char *text =
        srv_policy_text(p, 5001, &size); /* before an acknowledgement measures the network */
    assert_non_null(strstr(text, "\"format\":\"vp8\",\"quality\":40"));
    assert_non_null(strstr(text, "\"bandwidth\""));
    free(text);
    hub_finish(f, &job, 5);
    receive_policy(f, p, 5002, policy);
    /* With other formats, the choice for the previous formats is void at once. */
    hub_send(f, p, "stream.configure", "{\"format\":[\"vp9\",\"jpeg\"]}", 5010);
    hub_update(f, p, 2, 5100);
    assert_true(hub_next_job(f, 5101, &job));
    assert_int_equal(job.targets[0].video, SP_VIDEO_VP9);
    hub_finish(f, &job, 5);
    srv_hub_leave(f->hub, &p, 5200);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, hub_set_up, hub_tear_down)
        TEST(the_policy_is_reported_with_its_reasons),
        TEST(png_has_no_quality_to_reduce),
        TEST(a_slow_network_is_a_reason),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
