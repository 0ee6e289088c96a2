/* SPDX-License-Identifier: Apache-2.0
 *
 * The stream of one client, over a transport in memory and with a simulated clock: how much work a
 * client can cause.
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

#include "http/websocket.h"
#include "session/session.h"
#include "support/compare.h"
#include "support/fake_memory.h"
#include "unit/server/session/hub_fixture.h"

enum { CAPACITY = 1 << 20 };

struct wire { /* bytes from the client, and bytes to it */
    uint8_t *in, *out;
    size_t in_size, in_at, out_size;
    bool is_full; /* the transport is full */
    size_t piece; /* bytes taken by every second send(); 0 = everything, each time */
    bool took;
};

struct stream {
    void *fixture;
    struct srv_ingress *ingress;
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

static ssize_t wire_send(void *user, const struct iovec *parts, size_t count, bool is_more) {
    struct wire *wire = user;
    size_t left = wire->piece ? wire->piece : CAPACITY, all = 0;
    (void)is_more;
    wire->took = !wire->took;
    errno = EAGAIN;
    if (wire->is_full || (wire->piece && !wire->took))
        return -1;
    for (size_t i = 0; i < count; i++) {
        size_t size = parts[i].iov_len < left ? parts[i].iov_len : left;
        assert_compare(wire->out_size + size, <=, CAPACITY);
        memcpy(wire->out + wire->out_size, parts[i].iov_base, size);
        wire->out_size += size;
        left -= size;
        all += size;
    }
    return (ssize_t)all;
}

struct sent { /* one frame of RFC 6455 */
    uint8_t first;
    const uint8_t *bytes;
    size_t size;
};

/* Decodes the frame at *at and moves *at past it. False at the end of the bytes. */
static bool next_sent(const struct wire *wire, size_t *at, struct sent *sent) {
    const uint8_t *from = wire->out + *at;
    if (*at == wire->out_size)
        return false;
    assert_compare(*at + 2, <=, wire->out_size);
    size_t more = from[1] == 126 ? 2 : from[1] == 127 ? 8 : 0;
    *sent = (struct sent){ from[0], from + 2 + more, more ? 0 : from[1] };
    for (size_t i = 0; i < more; i++)
        sent->size = sent->size << 8 | from[2 + i];
    assert_true(more != 2 || sent->size >= 126); /* the length must have the shortest form */
    assert_true(more != 8 || sent->size > UINT16_MAX);
    *at += 2 + more + sent->size;
    assert_compare(*at, <=, wire->out_size);
    return true;
}

/* Joins a client to a session of the hub. */
static struct srv_ws *join(struct stream *s, const char *session, struct wire *wire) {
    struct fixture *f = s->fixture;
    *wire = (struct wire){ .in = malloc(CAPACITY), .out = malloc(CAPACITY) };
    struct srv_ws_options options = { .hub = f->hub,
                                      .ingress = s->ingress,
                                      .token = "",
                                      .session = session,
                                      .role = SRV_ROLE_CONTROL,
                                      .user = s,
                                      .peer = "test",
                                      .message_bytes = CAPACITY,
                                      .ping_ms = 15000,
                                      .stall_ms = 20000,
                                      .transport = { wire, wire_recv, wire_send } };
    struct srv_ws *ws = srv_ws_create(&options, 0, NULL);
    assert_non_null(wire->in);
    assert_non_null(wire->out);
    assert_non_null(ws);
    return ws;
}

static int set_up(void **state) {
    struct stream *s = calloc(1, sizeof *s);
    assert_non_null(s);
    assert_int_equal(hub_set_up(&s->fixture), 0);
    s->ingress = srv_ingress_create(CAPACITY);
    assert_non_null(s->ingress);
    s->ws = join(s, ((struct fixture *)s->fixture)->id, &s->wire);
    *state = s;
    return 0;
}

static int tear_down(void **state) {
    struct stream *s = *state;
    srv_ws_destroy(&s->ws, 0);
    int failed = hub_tear_down(&s->fixture);
    srv_ingress_destroy(&s->ingress);
    free(s->wire.in);
    free(s->wire.out);
    free(s);
    return failed;
}

/* Appends a masked text frame from the client; the mask is zero. */
static void send_text(struct wire *wire, const char *text, size_t size) {
    uint8_t *at = wire->in + wire->in_size;
    size_t head = size < 126 ? 2 : 10;
    assert_compare(wire->in_size + head + 4 + size, <=, CAPACITY);
    at[0] = 0x81;
    at[1] = (uint8_t)(0x80 | (size < 126 ? size : 127));
    for (size_t i = 0; head == 10 && i < 8; i++)
        at[2 + i] = (uint8_t)((uint64_t)size >> (56 - 8 * i));
    memset(at + head, 0, 4);
    memcpy(at + head + 4, text, size);
    wire->in_size += head + 4 + size;
}

static void send_pings(struct wire *wire, unsigned count) {
    for (unsigned i = 0; i < count; i++) {
        char text[64];
        int size =
            snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"id\":%u,\"method\":\"ping\"}", i);
        send_text(wire, text, (size_t)size);
    }
}

/* Returns the number of answers sent so far. */
static unsigned answers(const struct wire *wire) {
    static const char answer[] = "\"result\":{}";
    unsigned count = 0;
    for (size_t at = 0; at + sizeof answer <= wire->out_size; at++)
        count += memcmp(wire->out + at, answer, sizeof answer - 1) == 0;
    return count;
}

static void tick(struct stream *s, double now_ms) {
    srv_ingress_tick(s->ingress);
    srv_ws_tick(s->ws, now_ms);
}

/* Runs everything that the stream thread does until the next tick. */
static void run(struct stream *s, double now_ms) {
    for (int i = 0; i < 1000; i++) {
        if (srv_ws_wants_read(s->ws))
            srv_ws_read(s->ws, now_ms);
        srv_ws_write(s->ws, now_ms);
    }
}

/* A single client may use the quota of all streams, until it has sent as many bytes as the longest
 * message has. */
static void a_flood_is_read_in_pieces_and_nothing_is_lost(void **state) {
    struct stream *s = *state;
    enum {
        PINGS = 2500,
        COST = SRV_INGRESS_FRAME_BYTES + 47,
        BURST_TICKS = CAPACITY / SRV_INGRESS_TICK_BYTES
    };
    /* A piece may exceed the quota of a tick; the next tick gets less then. */
    enum {
        FIRST = SRV_INGRESS_TICK_BYTES / COST + 12,
        THEN = SRV_INGRESS_STREAM_BYTES / COST + 12
    };
    send_pings(&s->wire, PINGS);
    unsigned before = 0, ticks = 0;
    for (; before < PINGS; ticks++) {
        s->wire.out_size = 0; /* drop the answers that were counted */
        run(s, 100.0 * ticks);
        unsigned now = before + answers(&s->wire);
        if (now < PINGS) {
            assert_true(srv_ws_is_paused(s->ws));
            assert_in_range(now - before, 1, ticks <= BURST_TICKS ? FIRST : THEN);
        }
        before = now;
        tick(s, 100.0 * ticks + 99);
        assert_true(srv_ws_wants_read(s->ws));
    }
    assert_int_equal(before, PINGS);
    assert_compare(ticks, >, 10);
}

/* A request of `size` bytes, most of them blanks. */
static void send_long(struct wire *wire, size_t size) {
    char *text = malloc(size);
    assert_non_null(text);
    int used = snprintf(text, size, "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"ping\"}");
    memset(text + used, ' ', size - (size_t)used);
    send_text(wire, text, size);
    free(text);
}

static void one_read_takes_a_few_kib(void **state) {
    struct stream *s = *state;
    send_long(&s->wire, 100000);
    srv_ws_read(s->ws, 1);
    assert_int_equal(s->wire.in_at, 8192);
    assert_true(srv_ws_wants_read(s->ws));
}

static void a_long_message_is_read_at_once(void **state) {
    struct stream *s = *state;
    send_long(&s->wire, SRV_INGRESS_TICK_BYTES / 2);
    run(s, 1);
    assert_int_equal(answers(&s->wire), 1);
}

/* The streams of one session do not delay another session, even if that one is read last. */
static void streams_of_one_session_do_not_delay_another(void **state) {
    enum { CROWD = 3, TICKS = 6, A_DRAG = 180 }; /* more than a quarter of the divided half */
    struct stream *s = *state;
    struct fixture *f = s->fixture;
    struct wire wires[CROWD];
    struct srv_ws *crowd[CROWD];
    char id[SRV_SESSION_ID_BYTES];
    proto_json *json = srv_hub_session_create(f->hub, NULL, 0, id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
    for (int i = 0; i < CROWD; i++) {
        crowd[i] = join(s, id, &wires[i]);
        send_long(&wires[i], CAPACITY - 100);
    }
    size_t before = 0;
    for (unsigned now = 1; now <= TICKS; now++) {
        for (bool more = true; more;) {
            more = false;
            for (int i = 0; i < CROWD; i++) {
                srv_ws_read(crowd[i], 100.0 * now);
                more = more || srv_ws_wants_read(crowd[i]);
            }
        }
        size_t all = 0;
        for (int i = 0; i < CROWD; i++)
            all += wires[i].in_at;
        assert_in_range(all - before, SRV_INGRESS_TICK_BYTES / 2, SRV_INGRESS_TICK_BYTES);
        before = all;
        send_pings(&s->wire, A_DRAG);
        run(s, 100.0 * now);
        assert_int_equal(answers(&s->wire), now * A_DRAG);
        tick(s, 100.0 * now + 99);
    }
    for (int i = 0; i < CROWD; i++) {
        srv_ws_destroy(&crowd[i], 0);
        free(wires[i].in);
        free(wires[i].out);
    }
}

static void reading_stops_while_the_client_does_not_read(void **state) {
    struct stream *s = *state;
    enum { PINGS = 2500 }; /* more than one tick reads */
    send_pings(&s->wire, PINGS);
    run(s, 1);
    unsigned first = answers(&s->wire);
    s->wire.is_full = true;
    for (int now = 1; now <= 20; now++) {
        tick(s, 100.0 * now);
        run(s, 100.0 * now + 1);
    }
    assert_false(srv_ws_wants_read(s->ws));
    assert_false(srv_ws_is_paused(s->ws)); /* it waits for the socket, not for a tick */
    size_t read = s->wire.in_at;
    assert_compare(read, <, s->wire.in_size);
    s->wire.is_full = false;
    for (int now = 21; now <= 40; now++) {
        tick(s, 100.0 * now);
        run(s, 100.0 * now + 1);
    }
    assert_compare(first, <, PINGS);
    assert_int_equal(answers(&s->wire), PINGS);
}

/* Returns the code of the close frame, which must be the last frame; 0 = no close frame. */
static unsigned close_code(const struct wire *wire) {
    struct sent sent;
    unsigned code = 0;
    for (size_t at = 0; next_sent(wire, &at, &sent);) {
        assert_int_equal(code, 0);
        if (sent.first == 0x88)
            code = sent.bytes[0] * 256u + sent.bytes[1];
    }
    return code;
}

/* Delivers an image of `size` bytes to the participant. The caller owns the reference. */
static struct srv_blob *deliver(struct stream *s, size_t size, double now_ms) {
    struct fixture *f = s->fixture;
    static struct srv_render_job job;
    double wait_ms;
    struct proto_frame_header header = { .codec = PROTO_CODEC_JPEG, .width = 300, .height = 200 };
    struct srv_render_result result = { .width = 300, .height = 200, .render_ms = 1 };
    uint8_t *bytes = malloc(size);
    for (size_t i = 0; i < size; i++)
        bytes[i] = (uint8_t)(i * 7 + i / 251);
    struct srv_blob *blob = srv_blob_create(bytes, size);
    free(bytes);
    assert_non_null(blob);
    assert_true(srv_schedule_next(f->schedule, now_ms, &job, &wait_ms));
    srv_schedule_deliver(f->schedule, &job, 0, &header, blob);
    srv_schedule_done(f->schedule, &job, &result);
    return blob;
}

/* Checks that the image was sent once and whole, and that all other frames are text. Returns their
 * number. */
static unsigned check_image(const struct wire *wire, const struct srv_blob *blob) {
    struct sent sent;
    struct proto_frame_header header;
    unsigned images = 0, others = 0;
    for (size_t at = 0; next_sent(wire, &at, &sent);) {
        if (sent.first != 0x82) {
            assert_int_equal(sent.first, 0x81);
            others++;
            continue;
        }
        images++;
        assert_true(proto_frame_header_decode(sent.bytes, sent.size, &header));
        assert_int_equal(header.payload_bytes, blob->size);
        assert_int_equal(header.width, 300);
        assert_int_equal(sent.size, PROTO_FRAME_HEADER_BYTES + blob->size);
        assert_memory_equal(sent.bytes + PROTO_FRAME_HEADER_BYTES, blob->bytes, blob->size);
    }
    assert_int_equal(images, 1);
    return others;
}

/* The sizes cover all forms of the frame length. Answers are queued while the image is being sent.
 */
static void an_image_arrives_whole_in_pieces_of_any_size(void **state) {
    static const size_t sizes[] = { 1, 93, 94, 65503, 65504, 300000 };
    (void)state;
    for (size_t i = 0; i < 2 * sizeof sizes / sizeof *sizes; i++) {
        void *one = NULL;
        assert_int_equal(set_up(&one), 0);
        struct stream *s = one;
        run(s, 1); /* sends the first notifications */
        s->wire.out_size = 0;
        struct srv_blob *blob = deliver(s, sizes[i / 2], 2);
        s->wire.piece = i % 2 ? 0 : sizes[i / 2] < 100 ? 1 : 999;
        srv_ws_write(s->ws, 2);
        send_pings(&s->wire, 3);
        run(s, 3);
        assert_int_equal(answers(&s->wire), 3);
        assert_compare(check_image(&s->wire, blob), >=, 3);
        assert_int_equal(close_code(&s->wire), 0);
        srv_blob_unref(&blob);
        assert_int_equal(tear_down(&one), 0);
    }
}

static void an_image_is_sent_without_a_copy(void **state) {
    struct stream *s = *state;
    run(s, 1);
    s->wire.out_size = 0;
    struct srv_blob *blob = deliver(s, 100000, 2);
    s->wire.piece = 30000;
    memory_fail_after(0, MEMORY_STAYS_OUT);
    for (int i = 0; i < 100 && s->wire.out_size < 90000; i++) {
        srv_ws_write(s->ws, 2);
        assert_int_equal(atomic_load(&blob->references), 2);
    }
    assert_false(memory_restore());
    run(s, 3);
    assert_int_equal(atomic_load(&blob->references), 1);
    check_image(&s->wire, blob);
    srv_blob_unref(&blob);
}

static void a_close_waits_for_the_image_before_it(void **state) {
    struct stream *s = *state;
    run(s, 1);
    s->wire.out_size = 0;
    struct srv_blob *blob = deliver(s, 100000, 2);
    s->wire.piece = 30000;
    srv_ws_write(s->ws, 2);
    srv_ws_close(s->ws, 1001, "bye", 3);
    s->wire.is_full = true;
    run(s, 3);
    assert_true(srv_ws_wants_write(s->ws));
    assert_false(srv_ws_is_over(s->ws));
    s->wire.is_full = false;
    run(s, 4);
    assert_true(srv_ws_is_over(s->ws));
    assert_int_equal(close_code(&s->wire), 1001);
    s->wire.out_size -= 2 + 2 + 3;
    assert_int_equal(check_image(&s->wire, blob), 0);
    srv_blob_unref(&blob);
}

static void a_protocol_error_does_not_corrupt_an_image(void **state) {
    struct stream *s = *state;
    run(s, 1);
    s->wire.out_size = 0;
    struct srv_blob *blob = deliver(s, 100000, 2);
    s->wire.piece = 30000;
    srv_ws_write(s->ws, 2);
    static const uint8_t ping[2] = {
        0x89, 0xfe
    }; /* a ping of more than 125 bytes, which RFC 6455 forbids */
    memcpy(s->wire.in + s->wire.in_size, ping, sizeof ping);
    s->wire.in_size += sizeof ping;
    run(s, 3);
    assert_true(srv_ws_is_over(s->ws));
    struct sent sent = { .size = 0 };
    size_t at = 0;
    assert_true(next_sent(&s->wire, &at, &sent));
    assert_int_equal(sent.first, 0x82);
    assert_memory_equal(sent.bytes + PROTO_FRAME_HEADER_BYTES, blob->bytes, blob->size);
    assert_true(next_sent(&s->wire, &at, &sent));
    assert_int_equal(sent.first, 0x88);
    assert_false(next_sent(&s->wire, &at, &sent));
    srv_blob_unref(&blob);
}

static void a_client_that_takes_half_an_image_has_stalled(void **state) {
    struct stream *s = *state;
    run(s, 1);
    struct srv_blob *blob = deliver(s, 100000, 2);
    s->wire.piece = 30000;
    srv_ws_write(s->ws, 2);
    s->wire.is_full = true;
    for (double now_ms = 102; now_ms < 19900; now_ms += 100) {
        run(s, now_ms);
        srv_ws_tick(s->ws, now_ms);
        send_pings(&s->wire, 1); /* the client is not silent */
    }
    assert_false(srv_ws_is_lost(s->ws));
    srv_ws_tick(s->ws, 20100);
    assert_true(srv_ws_is_lost(s->ws));
    srv_blob_unref(&blob);
}

/* Checks that the deadline is `due_ms`, that a tick just before it does nothing, and then ticks
 * after it. */
static void tick_at_deadline(struct stream *s, double due_ms) {
    assert_compare(srv_ws_deadline_ms(s->ws), ==, due_ms);
    s->wire.out_size = 0;
    for (int late = 0; late < 2; late++) {
        assert_false(srv_ws_is_over(s->ws));
        assert_int_equal(s->wire.out_size, 0);
        srv_ws_tick(s->ws, due_ms + (late ? 1 : -1));
        srv_ws_write(s->ws, due_ms + (late ? 1 : -1));
    }
}

static void a_silent_client_gets_two_pings_and_is_lost(void **state) {
    struct stream *s = *state;
    run(s, 10);
    for (int i = 0; i < 2; i++) {
        struct sent sent;
        size_t at = 0;
        tick_at_deadline(s, 15000 + 15001 * i);
        assert_true(next_sent(&s->wire, &at, &sent));
        assert_int_equal(sent.first, 0x89);
    }
    tick_at_deadline(s, 45000);
    assert_true(srv_ws_is_lost(s->ws));
}

/* Appends a masked pong from the client; the mask is zero. */
static void send_pong(struct wire *wire, uint8_t payload) {
    const uint8_t pong[] = { 0x8a, 0x81, 0, 0, 0, 0, payload };
    assert_compare(wire->in_size + sizeof pong, <=, CAPACITY);
    memcpy(wire->in + wire->in_size, pong, sizeof pong);
    wire->in_size += sizeof pong;
}

/* Returns the newest ping among the sent frames: its payload, 0 = there was none. */
static uint8_t find_ping(const struct wire *wire) {
    struct sent sent;
    uint8_t payload = 0;
    for (size_t at = 0; next_sent(wire, &at, &sent);)
        if (sent.first == 0x89)
            payload = sent.size == 1 ? sent.bytes[0] : 0;
    return payload;
}

static double round_trip(const struct stream *s) {
    struct fixture *f = s->fixture;
    return srv_window_rtt_ms(&srv_hub_find_active(f->hub, f->id)->participants->delivery.window);
}

static void the_round_trip_is_measured_while_no_image_is_on_its_way(void **state) {
    struct stream *s = *state;
    run(s, 10);
    const uint8_t first = find_ping(&s->wire); /* of time 0, when it joined */
    assert_int_equal(first, 1);
    send_pong(&s->wire, 77); /* nobody asked */
    run(s, 20);
    assert_compare(round_trip(s), ==, 0);
    send_pong(&s->wire, first);
    run(s, 30);
    assert_compare(round_trip(s), ==, 30);
    send_pong(&s->wire, first); /* again */
    run(s, 31);
    assert_compare(round_trip(s), ==, 30);
    struct srv_blob *blob = deliver(s, 100, 40);
    run(s, 40);
    s->wire.out_size = 0;
    tick(s, 300); /* the image is not acknowledged */
    run(s, 300);
    assert_int_equal(find_ping(&s->wire), 0);
    static const char ack[] =
        "{\"jsonrpc\":\"2.0\",\"method\":\"stream.ack\",\"params\":{\"frame\":1}}";
    send_text(&s->wire, ack, sizeof ack - 1);
    run(s, 400);
    tick(s, 500);
    run(s, 500);
    assert_int_equal(find_ping(&s->wire), 2);
    send_pong(&s->wire, 2);
    run(s, 512);
    assert_compare(round_trip(s), ==, 12);
    srv_blob_unref(&blob);
}

static void messages_delay_the_ping_and_a_flood_is_due_at_once(void **state) {
    struct stream *s = *state;
    run(s, 10);
    send_pings(&s->wire, 1);
    run(s, 5000);
    assert_compare(srv_ws_deadline_ms(s->ws), ==, 20000);
    send_pings(&s->wire, 2500); /* more than one tick reads */
    run(s, 6000);
    assert_true(srv_ws_is_paused(s->ws));
    assert_compare(srv_ws_deadline_ms(s->ws), <=, 6000);
}

static void an_image_without_acknowledgement_has_a_deadline(void **state) {
    struct stream *s = *state;
    run(s, 1);
    send_pings(&s->wire, 1);
    run(s, 12000); /* the client is not silent */
    srv_ws_tick(s->ws, 12050);
    struct srv_blob *blob = deliver(s, 100, 12100);
    run(s, 12100);
    assert_compare(srv_ws_deadline_ms(s->ws), ==, 27000);
    srv_ws_tick(s->ws, 27001); /* sends a ping */
    run(s, 27001);
    send_pings(&s->wire, 1);
    run(s, 31000);
    srv_ws_tick(s->ws, 31050);
    tick_at_deadline(s, 32100);
    assert_int_equal(close_code(&s->wire), 1008);
    srv_blob_unref(&blob);
}

static void bytes_that_the_socket_does_not_take_have_a_deadline(void **state) {
    struct stream *s = *state;
    run(s, 1);
    s->wire.is_full = true;
    send_pings(&s->wire, 1);
    run(s, 12000); /* the answer and everything after it wait */
    srv_ws_tick(s->ws, 12050);
    assert_compare(srv_ws_deadline_ms(s->ws), ==, 27000);
    srv_ws_tick(s->ws, 27001);
    srv_ws_write(s->ws, 27001);
    tick_at_deadline(s, 32000);
    assert_true(srv_ws_is_lost(s->ws));
}

static void a_close_that_is_not_taken_has_a_deadline(void **state) {
    struct stream *s = *state;
    run(s, 1);
    s->wire.is_full = true;
    srv_ws_close(s->ws, 1001, "good-bye", 100);
    srv_ws_write(s->ws, 100);
    tick_at_deadline(s, 2100);
    assert_true(srv_ws_is_lost(s->ws));
}

/* Every allocation from the n-th on fails, for each n: the stream continues, is closed with a
 * reason, or ends. */
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
        run(s, 1); /* sends the first notifications */
        s->wire.out_size = 0;
        send_text(&s->wire, update, sizeof update - 1);
        memory_fail_after(n, MEMORY_STAYS_OUT);
        srv_ws_read(s->ws, 2);
        answered = !memory_restore();
        run(s, 3);
        unsigned code = close_code(&s->wire);
        assert_true(code == 0 || code == 1011);
        assert_true(code == 1011 || s->wire.out_size > 0 || srv_ws_is_lost(s->ws));
        assert_int_equal(srv_ws_is_over(s->ws), code == 1011 || srv_ws_is_lost(s->ws));
        closed += code == 1011;
        assert_int_equal(tear_down(&one), 0);
        assert_compare(n, <, 10000);
    }
    assert_compare(closed, >, 0);
}

#define WITH_STREAM(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void) {
    const struct CMUnitTest tests[] = {
        WITH_STREAM(a_flood_is_read_in_pieces_and_nothing_is_lost),
        WITH_STREAM(one_read_takes_a_few_kib),
        WITH_STREAM(a_long_message_is_read_at_once),
        WITH_STREAM(streams_of_one_session_do_not_delay_another),
        WITH_STREAM(reading_stops_while_the_client_does_not_read),
        cmocka_unit_test(an_image_arrives_whole_in_pieces_of_any_size),
        WITH_STREAM(an_image_is_sent_without_a_copy),
        WITH_STREAM(a_close_waits_for_the_image_before_it),
        WITH_STREAM(a_protocol_error_does_not_corrupt_an_image),
        WITH_STREAM(a_silent_client_gets_two_pings_and_is_lost),
        WITH_STREAM(the_round_trip_is_measured_while_no_image_is_on_its_way),
        WITH_STREAM(messages_delay_the_ping_and_a_flood_is_due_at_once),
        WITH_STREAM(an_image_without_acknowledgement_has_a_deadline),
        WITH_STREAM(bytes_that_the_socket_does_not_take_have_a_deadline),
        WITH_STREAM(a_close_that_is_not_taken_has_a_deadline),
        WITH_STREAM(a_client_that_takes_half_an_image_has_stalled),
        cmocka_unit_test(out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
