/* SPDX-License-Identifier: Apache-2.0
 *
 * The stream thread over socket pairs: which streams it looks at, and that all of them end.
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
#include "unit/server/session/hub_fixture.h"

enum { SESSIONS = 2, EACH = 3, STREAMS = SESSIONS * EACH };

struct peer {
    int socket, other; /* the peer's end, and the stream's */
};

static struct {
    void *hub;
    struct srv_streams *streams;
    struct srv_timer_thread *timers;
    struct srv_timer_task task;
    char ids[SESSIONS][SRV_SESSION_ID_BYTES];
    struct peer peers[STREAMS];
    int ticks[2], ends[2]; /* pipes: a byte for each */
    atomic_uint looks[STREAMS];
    struct srv_ws *ws[STREAMS]; /* the stream thread's, as they join: the same order */
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
            atomic_fetch_add(&t.looks[i], 1);
    __real_srv_ws_tick(ws, now_ms);
}

static void tell(int pipe) {
    ssize_t written = write(pipe, "", 1);
    (void)written; /* of ticks there may be more than anybody waits for */
}

/* A tick begins; those before it are complete. */
void __wrap_srv_ingress_tick(struct srv_ingress *ingress) {
    tell(t.ticks[1]);
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
    tell(t.ends[1]);
}

static void wait_for(int pipe, unsigned count) {
    char byte;
    while (count-- > 0)
        assert_int_equal(read(pipe, &byte, 1), 1);
}

/* What was ticked before it was asked for does not count. */
static void wait_for_ticks(unsigned count) {
    char bytes[512];
    ssize_t got = recv(t.ticks[0], bytes, sizeof bytes, MSG_DONTWAIT);
    (void)got;
    wait_for(t.ticks[0], count);
}

static void hear(struct peer *peer) {
    uint8_t bytes[4096];
    assert_true(recv(peer->socket, bytes, sizeof bytes, 0) > 0);
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
    hear(peer); /* it joined before the next one */
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
        proto_json *json = srv_hub_session_create(f->hub, NULL, srv_clock_ms(), t.ids[i], NULL);
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

static void ask(struct peer *peer) {
    static const uint8_t ping[] = { 0x89, 0x80, 0, 0, 0, 0 }; /* RFC 6455: of the library */
    assert_int_equal(send(peer->socket, ping, sizeof ping, 0), sizeof ping);
    hear(peer);
}

static void who_does_nothing_is_not_looked_at(void **state) {
    unsigned before[STREAMS];
    (void)state;
    wait_for_ticks(3); /* since they joined */
    for (int i = 0; i < STREAMS; i++)
        before[i] = atomic_load(&t.looks[i]);
    for (int i = 0; i < 5; i++) {
        ask(&t.peers[2]);
        wait_for_ticks(2);
    }
    for (int i = 0; i < STREAMS; i++)
        if (i != 2)
            assert_int_equal(atomic_load(&t.looks[i]), before[i]);
    assert_true(atomic_load(&t.looks[2]) >= before[2] + 5);
}

/* From the middle, the ends, and at once; the others go on. */
static void all_end(void **state) {
    static const int order[] = { 3, 0, STREAMS - 1 };
    (void)state;
    for (unsigned i = 0; i < sizeof order / sizeof *order; i++) {
        shutdown(t.peers[order[i]].socket, SHUT_RDWR);
        wait_for(t.ends[0], 1);
        ask(&t.peers[4]);
    }
    shutdown(t.peers[1].socket, SHUT_RDWR);
    shutdown(t.peers[2].socket, SHUT_RDWR);
    wait_for(t.ends[0], 2);
    ask(&t.peers[4]);
    srv_timer_thread_destroy(&t.timers);
    srv_streams_destroy(&t.streams);
    wait_for(t.ends[0], 1);
}

/* A peer that does not close after the good-bye. */
static void who_lingers_ends(void **state) {
    struct fixture *f = t.hub;
    (void)state;
    assert_true(srv_hub_session_delete(f->hub, t.ids[0], NULL));
    wait_for(t.ends[0], EACH);
    ask(&t.peers[4]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(who_does_nothing_is_not_looked_at, set_up, tear_down),
        cmocka_unit_test_setup_teardown(all_end, set_up, tear_down),
        cmocka_unit_test_setup_teardown(who_lingers_ends, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
