/* SPDX-License-Identifier: Apache-2.0
 *
 * A client's stream over a transport in memory, with the clock in hand: what it may make the stream
 * thread do.
 */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "http/ws_conn.h"
#include "hub_fixture.h"
#include "support/played_memory.h"

enum { ROOM = 1 << 20 };

struct wire { /* what the client sent, and what it was sent */
    uint8_t *in, *out;
    size_t in_size, in_at, out_size;
    bool is_full; /* takes nothing */
};

struct stream {
    void *fixture;
    struct wire wire;
    struct srv_ws *ws;
};

static ssize_t wire_recv(void *user, uint8_t *bytes, size_t size) {
    struct wire *wire = user;
    size_t left = wire->in_size - wire->in_at;
    errno = EAGAIN;
    if (left == 0)
        return -1;
    if (size > left)
        size = left;
    memcpy(bytes, wire->in + wire->in_at, size);
    wire->in_at += size;
    return (ssize_t)size;
}

static ssize_t wire_send(void *user, const uint8_t *bytes, size_t size) {
    struct wire *wire = user;
    errno = EAGAIN;
    if (wire->is_full)
        return -1;
    assert_true(wire->out_size + size <= ROOM);
    memcpy(wire->out + wire->out_size, bytes, size);
    wire->out_size += size;
    return (ssize_t)size;
}

static int set_up(void **state) {
    struct stream *s = calloc(1, sizeof *s);
    assert_non_null(s);
    assert_int_equal(hub_set_up(&s->fixture), 0);
    s->wire = (struct wire){ .in = malloc(ROOM), .out = malloc(ROOM) };
    struct fixture *f = s->fixture;
    struct srv_ws_options options = { .hub = f->hub,
                                      .session = f->id,
                                      .role = SRV_ROLE_CONTROL,
                                      .user = s,
                                      .peer = "test",
                                      .message_bytes = ROOM,
                                      .ping_ms = 15000,
                                      .stall_ms = 20000,
                                      .transport = { &s->wire, wire_recv, wire_send } };
    s->ws = srv_ws_create(&options, 0, NULL);
    assert_true(s->wire.in && s->wire.out && s->ws);
    *state = s;
    return 0;
}

static int tear_down(void **state) {
    struct stream *s = *state;
    srv_ws_destroy(&s->ws, 0);
    int failed = hub_tear_down(&s->fixture);
    free(s->wire.in);
    free(s->wire.out);
    free(s);
    return failed;
}

/* A masked text frame; the mask is zero. */
static void say(struct wire *wire, const char *text, size_t size) {
    uint8_t *at = wire->in + wire->in_size;
    size_t head = size < 126 ? 2 : 10;
    assert_true(wire->in_size + head + 4 + size <= ROOM);
    at[0] = 0x81;
    at[1] = (uint8_t)(0x80 | (size < 126 ? size : 127));
    for (size_t i = 0; head == 10 && i < 8; i++)
        at[2 + i] = (uint8_t)((uint64_t)size >> (56 - 8 * i));
    memset(at + head, 0, 4);
    memcpy(at + head + 4, text, size);
    wire->in_size += head + 4 + size;
}

static void say_pings(struct wire *wire, unsigned count) {
    for (unsigned i = 0; i < count; i++) {
        char text[64];
        int size =
            snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"id\":%u,\"method\":\"ping\"}", i);
        say(wire, text, (size_t)size);
    }
}

/* Answers to requests so far. */
static unsigned answers(const struct wire *wire) {
    static const char answer[] = "\"result\":{}";
    unsigned count = 0;
    for (size_t at = 0; at + sizeof answer <= wire->out_size; at++)
        count += memcmp(wire->out + at, answer, sizeof answer - 1) == 0;
    return count;
}

/* Whatever happens before the next tick: the thread reads while that is wanted. */
static void run(struct stream *s, double now_ms) {
    for (int i = 0; i < 1000; i++) {
        if (srv_ws_wants_read(s->ws))
            srv_ws_read(s->ws, now_ms);
        srv_ws_write(s->ws, now_ms);
    }
}

static void a_flood_is_read_bit_by_bit_and_nothing_is_lost(void **state) {
    struct stream *s = *state;
    enum { PINGS = 200, A_PIECE = 12 }; /* so many of them are in 512 bytes, at most */
    say_pings(&s->wire, PINGS);
    unsigned before = 0;
    for (int tick = 1; before < PINGS; tick++) {
        run(s, 100.0 * tick);
        unsigned now = answers(&s->wire);
        assert_in_range(now - before, 1, 32 + A_PIECE);
        assert_int_equal(srv_ws_is_paused(s->ws), now - before >= 32);
        before = now;
        srv_ws_tick(s->ws, 100.0 * tick + 99);
        assert_true(srv_ws_wants_read(s->ws));
        assert_false(srv_ws_is_paused(s->ws));
    }
    assert_int_equal(before, PINGS);
}

static void a_large_message_comes_128_kib_at_a_time(void **state) {
    struct stream *s = *state;
    enum { SIZE = 300000 };
    char *text = malloc(SIZE);
    assert_non_null(text);
    int size = snprintf(text, SIZE, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"ping\"}");
    memset(text + size, ' ', (size_t)(SIZE - size));
    say(&s->wire, text, SIZE);
    free(text);
    for (size_t tick = 1; tick <= 3; tick++) {
        assert_int_equal(answers(&s->wire), 0);
        run(s, 100.0 * (double)tick);
        size_t all = s->wire.in_size, allowed = tick * 128 * 1024;
        assert_int_equal(s->wire.in_at, allowed < all ? allowed : all);
        srv_ws_tick(s->ws, 100.0 * (double)tick + 99);
    }
    assert_int_equal(answers(&s->wire), 1);
}

static void who_does_not_read_is_not_read(void **state) {
    struct stream *s = *state;
    enum { PINGS = 200 };
    say_pings(&s->wire, PINGS);
    run(s, 1);
    unsigned first = answers(&s->wire);
    s->wire.is_full = true;
    for (int tick = 1; tick <= 20; tick++) {
        srv_ws_tick(s->ws, 100.0 * tick);
        run(s, 100.0 * tick + 1);
    }
    assert_false(srv_ws_wants_read(s->ws));
    assert_false(srv_ws_is_paused(s->ws)); /* no tick helps */
    size_t read = s->wire.in_at;
    assert_true(read < s->wire.in_size);
    s->wire.is_full = false;
    for (int tick = 21; tick <= 40; tick++) {
        srv_ws_tick(s->ws, 100.0 * tick);
        run(s, 100.0 * tick + 1);
    }
    assert_true(first < PINGS);
    assert_int_equal(answers(&s->wire), PINGS);
}

/* The code of the close frame that was sent; 0 = none was. */
static unsigned close_code(const struct wire *wire) {
    for (size_t at = 0; at + 4 <= wire->out_size;) {
        size_t size = wire->out[at + 1], head = 2;
        if (wire->out[at] == 0x88)
            return wire->out[at + 2] * 256u + wire->out[at + 3];
        if (size == 126) {
            size = wire->out[at + 2] * 256u + wire->out[at + 3];
            head = 4;
        }
        at += head + size;
    }
    return 0;
}

/* Memory runs out at each allocation that a message costs, one after the other: the stream goes on,
 * says why not, or is over. */
static void out_of_memory(void **state) {
    static const char update[] = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"view.update\","
                                 "\"params\":{\"seq\":1,\"patch\":{\"background\":[1,0,0,1]}}}";
    unsigned closed = 0;
    bool answered = false;
    (void)state;
    for (unsigned n = 0; !answered; n++) {
        void *one = NULL;
        assert_int_equal(set_up(&one), 0);
        struct stream *s = one;
        run(s, 1); /* who is there, and the like */
        s->wire.out_size = 0;
        say(&s->wire, update, sizeof update - 1);
        memory_run_out(n, MEMORY_STAYS_OUT);
        srv_ws_read(s->ws, 2);
        answered = !memory_come_back();
        run(s, 3);
        unsigned code = close_code(&s->wire);
        assert_true(code == 0 || code == 1011);
        assert_true(code == 1011 || s->wire.out_size > 0 || srv_ws_is_lost(s->ws));
        assert_int_equal(srv_ws_is_over(s->ws), code == 1011 || srv_ws_is_lost(s->ws));
        closed += code == 1011;
        assert_int_equal(tear_down(&one), 0);
        assert_true(n < 10000);
    }
    assert_true(closed > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_flood_is_read_bit_by_bit_and_nothing_is_lost, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(a_large_message_comes_128_kib_at_a_time, set_up, tear_down),
        cmocka_unit_test_setup_teardown(who_does_not_read_is_not_read, set_up, tear_down),
        cmocka_unit_test(out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
