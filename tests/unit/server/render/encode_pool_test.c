/* SPDX-License-Identifier: Apache-2.0
 *
 * The encode threads: frames and encodings that are used again, slow encodings, and threads that
 * share the stripes of one image.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <sched.h>
#include <stdio.h>

#include "common/clock.h"
#include "render/encode_pool.h"
#include "support/compare.h"
#include "support/gate.h"
#include "unit/server/counted.h"
#include "unit/server/render/snapshot_fixture.h"

static int set_up(void **state) {
    return snap_set_up(state, 1);
}

static int set_up_two(void **state) {
    return snap_set_up(state, 2);
}

static int set_up_sharing(void **state) {
    return snap_set_up(state, SNAP_STREAM_THREADS);
}

static void the_final_frame_of_a_session_is_not_rendered_again(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client client = { 0 };
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    snap_await_final_frame(f, f->participant);
    long renders = counted_stages(f->render.metrics, "render");
    assert_compare(renders, >, 0);
    assert_true(snap_request(f, &client, 512, false));
    gate_await(&client.answers, 1);
    assert_int_equal(client.images, 1);
    assert_int_equal(counted_stages(f->render.metrics, "render"), renders);
    assert_int_equal(gate_count(&gate.entered), 0);
}

static void a_snapshot_with_the_same_parameters_is_not_encoded_again(void **state) {
    struct snap_fixture *f = *state;
    struct snap_client same = { 0 }, other = { .quality = 17 };
    char id[SRV_SESSION_ID_BYTES];
    render_fixture_session(&f->render, id);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    snap_await_final_frame(f, f->participant);
    assert_int_equal(gate_count(&snap_seen.sharp), 1);
    struct srv_participant *elsewhere = render_fixture_join(&f->render, id, SRV_ROLE_CONTROL);
    snap_await_final_frame(f, elsewhere);
    srv_hub_leave(f->render.hub, &elsewhere, srv_clock_ms());
    assert_true(snap_request(f, &same, 512, false));
    gate_await(&same.answers, 1);
    assert_int_equal(gate_count(&snap_seen.sharp), 1);
    unsigned encoded = gate_count(&snap_seen.encoded);
    assert_true(snap_request(f, &other, 512, false));
    gate_await(&other.answers, 1);
    assert_int_equal(gate_count(&snap_seen.encoded), encoded + 1);
    assert_int_equal(counted_stages(f->render.metrics, "encode"), encoded + 1);
    assert_in_range(other.size, 1, same.size - 1);
}

/* A PNG has no quality: one encoding serves all. */
static void parameters_that_a_format_ignores_do_not_cause_another_encoding(void **state) {
    struct snap_fixture *f = *state;
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    struct srv_participant *other = render_fixture_join(&f->render, f->id, SRV_ROLE_VIEW);
    snap_await_final_frame(f, f->participant);
    snap_await_final_frame(f, other);
    snap_send(f, other, "stream.configure",
              "{\"format\":\"png\",\"quality\":70,\"subsampling\":\"4:2:0\"}");
    snap_await_final_frame(f, other);
    assert_int_equal(gate_count(&snap_seen.pngs), 1);
    snap_send(f, f->participant, "stream.configure", "{\"format\":\"png\",\"quality\":80}");
    snap_await_final_frame(f, f->participant);
    assert_int_equal(gate_count(&snap_seen.pngs), 1);
    srv_hub_leave(f->render.hub, &other, srv_clock_ms());
}

/* A large PNG occupies an encode thread, and an encoder cannot be interrupted. The other
 * participants of the session, and other sessions, receive their frames all the same. */
static void slow_encodings_leave_a_thread_to_the_others(void **state) {
    struct snap_fixture *f = *state;
    char id[SRV_SESSION_ID_BYTES], params[60];
    render_fixture_session(&f->render, id);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    snap_await_final_frame(f, f->participant);
    snap_block_png(SNAP_SLOW_PX);
    struct srv_participant *hog = render_fixture_join(&f->render, f->id, SRV_ROLE_VIEW);
    struct srv_participant *hogs = render_fixture_join(&f->render, id, SRV_ROLE_CONTROL);
    snap_send(f, hog, "stream.configure", "{\"format\":\"png\",\"size\":[4096,4096]}");
    snap_send(f, hogs, "stream.configure", "{\"format\":\"png\",\"size\":[4096,4096]}");
    for (uint32_t seq = 1; seq <= 20; seq++) {
        snprintf(params, sizeof params, "{\"seq\":%u,\"patch\":{\"background\":[0,0,%g,1]}}", seq,
                 seq / 32.0);
        snap_send(f, hogs, "view.update", params);
        snap_send(f, f->participant, "view.update", params);
        while (snap_next_frame(f, f->participant).seq < seq)
            ;
    }
    gate_await(&snap_seen.pngs, 1);
    snap_block_png(0);
    snap_await_final_frame(f, hog);
    snap_await_final_frame(f, hogs);
    srv_hub_leave(f->render.hub, &hog, srv_clock_ms());
    srv_hub_leave(f->render.hub, &hogs, srv_clock_ms());
}

/* The slow frames of a single participant delay no other client, so they may use all threads. */
static void a_single_participant_may_use_all_threads(void **state) {
    struct snap_fixture *f = *state;
    char params[60];
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    snap_send(f, f->participant, "stream.configure", "{\"format\":\"png\",\"size\":[4096,4096]}");
    snap_await_final_frame(f, f->participant);
    snap_block_png(SNAP_SLOW_PX);
    unsigned pngs = gate_count(&snap_seen.pngs);
    for (uint32_t seq = 1; gate_count(&snap_seen.pngs) < pngs + 2; seq++) {
        snprintf(params, sizeof params, "{\"seq\":%u,\"patch\":{\"background\":[0,0,%g,1]}}", seq,
                 seq % 32 / 32.0);
        snap_send(f, f->participant, "view.update", params);
        sched_yield();
    }
    snap_block_png(0);
}

static void idle_threads_help_with_a_snapshot_except_the_reserved_one(void **state) {
    enum { IMAGES = 50 };
    struct snap_fixture *f = *state;
    for (unsigned n = 1; n <= IMAGES; n++) {
        struct snap_client client = { 0 };
        snap_share_by(SNAP_ENCODE_THREADS - 1); /* one is reserved for session frames */
        assert_true(snap_request(f, &client, 100, false));
        gate_let_through(1);
        gate_await(&client.answers, 1);
        assert_int_equal(client.images, 1);
        for (int i = 0; i < SNAP_STRIPES; i++)
            assert_int_equal(snap_seen.made[i], n);
    }
    assert_int_equal(snap_seen.by[0], 0);
    for (int t = 1; t < SNAP_ENCODE_THREADS; t++)
        assert_compare(snap_seen.by[t], >=, IMAGES);
}

static void idle_foreground_threads_help_with_a_session_frame(void **state) {
    struct snap_fixture *f = *state;
    snap_share_by(SNAP_STREAM_THREADS);
    f->participant = render_fixture_join(&f->render, f->id, SRV_ROLE_CONTROL);
    snap_await_final_frame(f, f->participant);
    for (int i = 0; i < SNAP_STRIPES; i++)
        assert_int_equal(snap_seen.made[i], gate_count(&snap_seen.encoded));
    for (int t = 0; t < SNAP_ENCODE_THREADS; t++)
        assert_int_equal(snap_seen.by[t] > 0, t < SNAP_STREAM_THREADS);
}

static void count_maintenance(void *user) {
    pthread_mutex_lock(&gate.mutex);
    ++*(unsigned *)user;
    pthread_mutex_unlock(&gate.mutex);
}

static void an_idle_thread_does_the_maintenance_once_per_request(void **state) {
    (void)state;
    unsigned done = 0;
    const struct srv_encode_pool_options options = { .threads = 2,
                                                     .user = &done,
                                                     .maintain = count_maintenance };
    struct srv_encode_pool *pool = srv_encode_pool_create(&options, NULL);
    assert_non_null(pool);
    assert_true(srv_encode_pool_start(pool, NULL));
    for (unsigned i = 1; i <= 3; i++) {
        srv_encode_pool_request_maintenance(pool);
        gate_await(&done, i);
    }
    srv_encode_pool_stop(pool);
    assert_int_equal(done, 3);
    srv_encode_pool_destroy(&pool);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, snap_tear_down)
        TEST(the_final_frame_of_a_session_is_not_rendered_again),
        cmocka_unit_test(an_idle_thread_does_the_maintenance_once_per_request),
        TEST(a_snapshot_with_the_same_parameters_is_not_encoded_again),
        TEST(parameters_that_a_format_ignores_do_not_cause_another_encoding),
        TEST(slow_encodings_leave_a_thread_to_the_others),
        cmocka_unit_test_setup_teardown(a_single_participant_may_use_all_threads, set_up_two,
                                        snap_tear_down),
        cmocka_unit_test_setup_teardown(idle_threads_help_with_a_snapshot_except_the_reserved_one,
                                        set_up_sharing, snap_tear_down),
        cmocka_unit_test_setup_teardown(idle_foreground_threads_help_with_a_session_frame,
                                        set_up_sharing, snap_tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
