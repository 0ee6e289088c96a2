/* SPDX-License-Identifier: Apache-2.0
 *
 * The stream thread over socket pairs: it checks only active streams, and all streams end.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/clock.h"
#include "common/timer_thread.h"
#include "http/streams.h"
#include "http/websocket.h"
#include "protocol/json.h"
#include "support/compare.h"
#include "unit/server/session/hub_fixture.h"

enum { SESSIONS = 2, EACH = 3, STREAMS = SESSIONS * EACH };

struct peer {
    int socket, other; /* the peer's end and the stream's end */
};

static struct {
    void *hub;
    struct srv_streams *streams;
    struct srv_timer_thread *timers;
    struct srv_timer_task task;
    char ids[SESSIONS][SRV_SESSION_ID_BYTES];
    struct peer peers[STREAMS];
    int ticks[2], ends[2]; /* socket pairs: one byte per tick or ended stream */
    atomic_uint checks[STREAMS];
    struct srv_ws *ws[STREAMS]; /* in the order in which they join */
    unsigned joined;
} t;

struct srv_ws *__real_srv_ws_create(const struct srv_ws_options *options, double now_ms,
                                    struct sp_error *err);
struct srv_ws *__wrap_srv_ws_create(const struct srv_ws_options *options, double now_ms,
                                    struct sp_error *err);
void __real_srv_ingress_tick(struct srv_ingress *ingress);
void __wrap_srv_ingress_tick(struct srv_ingress *ingress);
void __real_srv_ws_tick(struct srv_ws *ws, double now_ms);
void __wrap_srv_ws_tick(struct srv_ws *ws, double now_ms);

struct srv_ws *__wrap_srv_ws_create(const struct srv_ws_options *options, double now_ms,
                                    struct sp_error *err) {
    return t.ws[t.joined++] = __real_srv_ws_create(options, now_ms, err);
}

void __wrap_srv_ws_tick(struct srv_ws *ws, double now_ms) {
    for (unsigned i = 0; i < t.joined; i++)
        if (t.ws[i] == ws)
            atomic_fetch_add(&t.checks[i], 1);
    __real_srv_ws_tick(ws, now_ms);
}

static void write_byte(int pipe) {
    ssize_t written = write(pipe, "", 1);
    (void)written; /* if the buffer is full, enough ticks are waiting */
}

/* Marks the start of a tick: all earlier ticks are complete. */
void __wrap_srv_ingress_tick(struct srv_ingress *ingress) {
    write_byte(t.ticks[1]);
    __real_srv_ingress_tick(ingress);
}

static double on_timer(void *user, double now_ms) {
    (void)user;
    srv_streams_tick(t.streams);
    return now_ms + SRV_STREAMS_TICK_MS;
}

static void on_end(void *owner) {
    struct peer *peer = owner;
    close(peer->other);
    write_byte(t.ends[1]);
}

static void wait_for(int pipe, unsigned count) {
    char byte;
    while (count-- > 0)
        assert_int_equal(read(pipe, &byte, 1), 1);
}

/* Waits for `count` new ticks; earlier ones do not count. */
static void wait_for_ticks(unsigned count) {
    char bytes[512];
    ssize_t got = recv(t.ticks[0], bytes, sizeof bytes, MSG_DONTWAIT);
    (void)got;
    wait_for(t.ticks[0], count);
}

static void receive(struct peer *peer) {
    uint8_t bytes[4096];
    assert_compare(recv(peer->socket, bytes, sizeof bytes, 0), >, 0);
}

static void join(struct peer *peer, const char *session) {
    int pair[2];
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, pair), 0);
    assert_int_equal(fcntl(pair[1], F_SETFL, O_NONBLOCK), 0);
    peer->socket = pair[0];
    peer->other = pair[1];
    struct srv_stream_start start = {
        .role = SRV_ROLE_CONTROL, .socket = peer->other, .owner = peer, .close = on_end
    };
    strcpy(start.session, session);
    assert_true(srv_streams_add(t.streams, &start));
    receive(peer); /* so that it joins before the next one */
}

static int set_up(void **state) {
    (void)state;
    memset(&t, 0, sizeof t);
    assert_int_equal(hub_set_up(&t.hub), 0);
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, t.ticks), 0);
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, t.ends), 0);
    struct fixture *f = t.hub;
    struct srv_streams_options options = {
        .hub = f->hub, .message_bytes = 65536, .ping_ms = 3.6e6, .stall_ms = 3.6e6
    };
    t.streams = srv_streams_create(&options, NULL);
    assert_non_null(t.streams);
    t.timers = srv_timer_thread_create(NULL);
    assert_non_null(t.timers);
    t.task = (struct srv_timer_task){ .run = on_timer };
    srv_timer_thread_add(t.timers, &t.task, srv_clock_ms());
    assert_true(srv_hub_session_delete(f->hub, f->id, NULL));
    for (int i = 0; i < SESSIONS; i++) {
        proto_json *json =
            srv_hub_session_create(f->hub, NULL, &(const struct srv_owner){ .name = "" }, false,
                                   srv_clock_ms(), t.ids[i], NULL);
        assert_non_null(json);
        proto_json_free(&json);
        for (int k = 0; k < EACH; k++)
            join(&t.peers[i * EACH + k], t.ids[i]);
    }
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    srv_timer_thread_destroy(&t.timers);
    srv_streams_destroy(&t.streams);
    for (int i = 0; i < STREAMS; i++)
        close(t.peers[i].socket);
    for (int i = 0; i < 2; i++) {
        close(t.ticks[i]);
        close(t.ends[i]);
    }
    return hub_tear_down(&t.hub);
}

static void ping(struct peer *peer) {
    static const uint8_t frame[] = {
        0x89, 0x80, 0, 0, 0, 0
    }; /* an RFC 6455 ping, which wslay answers */
    assert_int_equal(send(peer->socket, frame, sizeof frame, 0), sizeof frame);
    receive(peer);
}

static void idle_streams_are_not_checked(void **state) {
    unsigned before[STREAMS];
    (void)state;
    wait_for_ticks(3); /* since they joined */
    for (int i = 0; i < STREAMS; i++)
        before[i] = atomic_load(&t.checks[i]);
    for (int i = 0; i < 5; i++) {
        ping(&t.peers[2]);
        wait_for_ticks(2);
    }
    for (int i = 0; i < STREAMS; i++)
        if (i != 2)
            assert_int_equal(atomic_load(&t.checks[i]), before[i]);
    assert_compare(atomic_load(&t.checks[2]), >=, before[2] + 5);
}

/* Streams from the middle and both ends of the list end, one by one and two at once. The others
 * continue. */
static void all_end(void **state) {
    static const int order[] = { 3, 0, STREAMS - 1 };
    (void)state;
    for (unsigned i = 0; i < sizeof order / sizeof *order; i++) {
        shutdown(t.peers[order[i]].socket, SHUT_RDWR);
        wait_for(t.ends[0], 1);
        ping(&t.peers[4]);
    }
    shutdown(t.peers[1].socket, SHUT_RDWR);
    shutdown(t.peers[2].socket, SHUT_RDWR);
    wait_for(t.ends[0], 2);
    ping(&t.peers[4]);
    srv_timer_thread_destroy(&t.timers);
    srv_streams_destroy(&t.streams);
    wait_for(t.ends[0], 1);
}

/* A peer that does not close its side after the close frame. */
static void lingering_streams_end(void **state) {
    struct fixture *f = t.hub;
    (void)state;
    assert_true(srv_hub_session_delete(f->hub, t.ids[0], NULL));
    wait_for(t.ends[0], EACH);
    ping(&t.peers[4]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(idle_streams_are_not_checked, set_up, tear_down),
        cmocka_unit_test_setup_teardown(all_end, set_up, tear_down),
        cmocka_unit_test_setup_teardown(lingering_streams_end, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
