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

#include "support/compare.h"
#include "support/fake_memory.h"
#include "unit/server/http/websocket_fixture.h"
#include "unit/server/session/hub_fixture.h"

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
        stream_run(s, 100.0 * ticks);
        unsigned now = before + answers(&s->wire);
        if (now < PINGS) {
            assert_true(srv_ws_is_paused(s->ws));
            assert_in_range(now - before, 1, ticks <= BURST_TICKS ? FIRST : THEN);
        }
        before = now;
        stream_tick(s, 100.0 * ticks + 99);
        assert_true(srv_ws_wants_read(s->ws));
    }
    assert_int_equal(before, PINGS);
    assert_compare(ticks, >, 10);
}

/* An answer costs more than its request: a client that asks for the view again and again is read at
 * the rate at which it may be answered. */
static void answers_count_towards_the_ingress_quota(void **state) {
    struct stream *s = *state;
    static const char request[] = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"view.get\"}";
    enum { REQUESTS = 3000, TICKS = 20 };
    for (int i = 0; i < REQUESTS; i++)
        send_text(&s->wire, request, sizeof request - 1);
    size_t sent = 0;
    for (int tick = 0; tick < TICKS; tick++) {
        s->wire.out_size = 0;
        stream_run(s, 100.0 * tick);
        sent += s->wire.out_size;
        assert_true(srv_ws_is_paused(s->ws));
        stream_tick(s, 100.0 * tick + 99);
    }
    /* At first it has saved up the quota of one long message. */
    assert_compare(SRV_INGRESS_ANSWER * sent, >, TICKS * SRV_INGRESS_STREAM_BYTES / 2);
    assert_compare(SRV_INGRESS_ANSWER * sent, <,
                   CAPACITY + TICKS * SRV_INGRESS_STREAM_BYTES + SRV_INGRESS_TICK_BYTES);
    assert_compare(s->wire.in_at, <, s->wire.in_size);
}

static unsigned encoded_views;
proto_json *__real_proto_view_encode(const struct sp_view *view);
proto_json *__wrap_proto_view_encode(const struct sp_view *view);

proto_json *__wrap_proto_view_encode(const struct sp_view *view) {
    encoded_views++;
    return __real_proto_view_encode(view);
}

/* Sends a change of the background to `red` / 512, and runs the client. */
static void update(struct stream *s, unsigned red, double now_ms) {
    char text[160];
    int size = snprintf(text, sizeof text,
                        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"view.update\",\"params\":"
                        "{\"seq\":1,\"patch\":{\"background\":[%.10g,0,0,1]}}}",
                        red / 512.0);
    send_text(&s->wire, text, (size_t)size);
    srv_ws_read(s->ws, now_ms);
    srv_ws_write(s->ws, now_ms);
    assert_int_equal(s->wire.in_at, s->wire.in_size);
}

/* Returns the number of view.changed that report this red. */
static unsigned views_sent(const struct wire *wire, unsigned red) {
    char background[32];
    unsigned count = 0;
    int length = snprintf(background, sizeof background, "\"background\":[%.10g,", red / 512.0);
    struct sent sent;
    for (size_t at = 0; next_sent(wire, &at, &sent);)
        count += memmem(sent.bytes, sent.size, "view.changed", 12) &&
                 memmem(sent.bytes, sent.size, background, (size_t)length);
    return count;
}

static void a_view_is_encoded_once_for_all_participants(void **state) {
    enum { CROWD = 2 };
    struct stream *s = *state;
    struct wire wires[CROWD];
    struct srv_ws *crowd[CROWD];
    for (int i = 0; i < CROWD; i++) {
        crowd[i] = stream_join(s, ((struct fixture *)s->fixture)->id, &wires[i]);
        srv_ws_write(crowd[i], 1);
    }
    for (unsigned red = 1; red <= 2; red++) {
        encoded_views = 0;
        update(s, red, 2);
        for (int i = 0; i < CROWD; i++) {
            srv_ws_write(crowd[i], 2);
            assert_int_equal(views_sent(&wires[i], red), 1);
        }
        assert_int_equal(encoded_views, 1);
    }
    for (int i = 0; i < CROWD; i++) {
        srv_ws_destroy(&crowd[i], 3);
        free(wires[i].in);
        free(wires[i].out);
    }
}

/* A drag continues at its rate; the other participants get fewer views, and always the last view.
 */
static void participants_skip_views_over_the_quota_of_notifications(void **state) {
    enum { TICKS = 40, UPDATES = 30 };
    struct stream *s = *state;
    struct wire wire;
    struct srv_ws *other = stream_join(s, ((struct fixture *)s->fixture)->id, &wire);
    char text[16384];
    size_t size = (size_t)snprintf(text, sizeof text,
                                   "{\"jsonrpc\":\"2.0\",\"method\":\"view.update\",\"params\":"
                                   "{\"seq\":1,\"patch\":{\"transfer_function\":{\"points\":[");
    for (int i = 0; i < 128; i++)
        size +=
            (size_t)snprintf(text + size, sizeof text - size,
                             "%s{\"value\":%d,\"color\":[0,0,1],\"opacity\":0.5}", i ? "," : "", i);
    size += (size_t)snprintf(text + size, sizeof text - size, "]}}}}");
    send_text(&s->wire, text, size);
    stream_run(s, 0);
    size_t sent = 0;
    for (unsigned tick = 0; tick < TICKS; tick++) {
        wire.out_size = s->wire.out_size = 0;
        for (unsigned i = 0; i < UPDATES; i++) {
            update(s, tick + 1, 100.0 * tick);
            srv_ws_write(other, 100.0 * tick);
        }
        sent += wire.out_size;
        stream_tick(s, 100.0 * tick + 99);
    }
    assert_compare(sent, >, TICKS * SRV_INGRESS_STREAM_BYTES);
    assert_compare(sent, <, CAPACITY + (TICKS + 1) * SRV_INGRESS_STREAM_BYTES);
    wire.out_size = 0;
    for (unsigned i = 0; i <= UPDATES; i++) {
        update(s, 400 + i, 100.0 * TICKS);
        srv_ws_write(other, 100.0 * TICKS);
    }
    assert_int_equal(views_sent(&wire, 400 + UPDATES), 0);
    for (unsigned tick = TICKS; views_sent(&wire, 400 + UPDATES) == 0; tick++) {
        assert_compare(tick, <, TICKS + 3);
        assert_compare(srv_ws_deadline_ms(other), <=, 100.0 * tick); /* needs no other event */
        stream_tick(s, 100.0 * tick + 99);
        srv_ws_write(other, 100.0 * tick + 99);
    }
    srv_ws_destroy(&other, 0);
    free(wire.in);
    free(wire.out);
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
    stream_run(s, 1);
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
    proto_json *json = srv_hub_session_create(f->hub, NULL, &(const struct srv_owner){ .name = "" },
                                              false, 0, id, NULL);
    assert_non_null(json);
    proto_json_free(&json);
    for (int i = 0; i < CROWD; i++) {
        crowd[i] = stream_join(s, id, &wires[i]);
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
        stream_run(s, 100.0 * now);
        assert_int_equal(answers(&s->wire), now * A_DRAG);
        stream_tick(s, 100.0 * now + 99);
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
    stream_run(s, 1);
    unsigned first = answers(&s->wire);
    s->wire.is_full = true;
    for (int now = 1; now <= 20; now++) {
        stream_tick(s, 100.0 * now);
        stream_run(s, 100.0 * now + 1);
    }
    assert_false(srv_ws_wants_read(s->ws));
    assert_false(srv_ws_is_paused(s->ws)); /* it waits for the socket, not for a tick */
    size_t read = s->wire.in_at;
    assert_compare(read, <, s->wire.in_size);
    s->wire.is_full = false;
    for (int now = 21; now <= 40; now++) {
        stream_tick(s, 100.0 * now);
        stream_run(s, 100.0 * now + 1);
    }
    assert_compare(first, <, PINGS);
    assert_int_equal(answers(&s->wire), PINGS);
}

/* Checks that the image was sent once and whole, between pings with its number, of which a closed
 * stream lacks the second, and that all other frames are text. Returns their number. */
static unsigned check_image(const struct wire *wire, const struct srv_blob *blob, bool is_closed) {
    struct sent sent;
    struct proto_frame_header header;
    unsigned images = 0, pings = 0, others = 0;
    for (size_t at = 0; next_sent(wire, &at, &sent);) {
        if (sent.first == 0x89 && sent.size == 5) {
            assert_int_equal(sent.bytes[0], 1); /* the number of the frame */
            assert_int_equal(sent.bytes[4], images);
            pings++;
            continue;
        }
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
    assert_int_equal(pings, is_closed ? 1 : 2);
    return others;
}

/* The sizes cover all forms of the frame length. Answers are queued while the image is being sent.
 */
static void an_image_arrives_whole_in_pieces_of_any_size(void **state) {
    static const size_t sizes[] = { 1, 93, 94, 65503, 65504, 300000 };
    (void)state;
    for (size_t i = 0; i < 2 * sizeof sizes / sizeof *sizes; i++) {
        void *one = NULL;
        assert_int_equal(stream_set_up(&one), 0);
        struct stream *s = one;
        stream_run(s, 1); /* sends the first notifications */
        s->wire.out_size = 0;
        struct srv_blob *blob = deliver(s, sizes[i / 2], 2);
        s->wire.piece = i % 2 ? 0 : sizes[i / 2] < 100 ? 1 : 999;
        srv_ws_write(s->ws, 2);
        send_pings(&s->wire, 3);
        stream_run(s, 3);
        assert_int_equal(answers(&s->wire), 3);
        assert_compare(check_image(&s->wire, blob, false), >=, 3);
        assert_int_equal(close_code(&s->wire), 0);
        srv_blob_unref(&blob);
        assert_int_equal(stream_tear_down(&one), 0);
    }
}

static void an_image_is_sent_without_a_copy(void **state) {
    struct stream *s = *state;
    stream_run(s, 1);
    s->wire.out_size = 0;
    struct srv_blob *blob = deliver(s, 100000, 2);
    s->wire.piece = 30000;
    memory_fail_after(0, MEMORY_STAYS_OUT);
    for (int i = 0; i < 100 && s->wire.out_size < 90000; i++) {
        srv_ws_write(s->ws, 2);
        assert_int_equal(atomic_load(&blob->references), 2);
    }
    assert_false(memory_restore());
    stream_run(s, 3);
    assert_int_equal(atomic_load(&blob->references), 1);
    check_image(&s->wire, blob, false);
    srv_blob_unref(&blob);
}

static void a_close_waits_for_the_image_before_it(void **state) {
    struct stream *s = *state;
    stream_run(s, 1);
    s->wire.out_size = 0;
    struct srv_blob *blob = deliver(s, 100000, 2);
    s->wire.piece = 30000;
    srv_ws_write(s->ws, 2);
    srv_ws_close(s->ws, 1001, "bye", 3);
    s->wire.is_full = true;
    stream_run(s, 3);
    assert_true(srv_ws_wants_write(s->ws));
    assert_false(srv_ws_is_over(s->ws));
    s->wire.is_full = false;
    stream_run(s, 4);
    assert_true(srv_ws_is_over(s->ws));
    assert_int_equal(close_code(&s->wire), 1001);
    s->wire.out_size -= 2 + 2 + 3;
    assert_int_equal(check_image(&s->wire, blob, true), 0);
    srv_blob_unref(&blob);
}

static void a_protocol_error_does_not_corrupt_an_image(void **state) {
    struct stream *s = *state;
    stream_run(s, 1);
    s->wire.out_size = 0;
    struct srv_blob *blob = deliver(s, 100000, 2);
    s->wire.piece = 30000;
    srv_ws_write(s->ws, 2);
    static const uint8_t ping[2] = {
        0x89, 0xfe
    }; /* a ping of more than 125 bytes, which RFC 6455 forbids */
    memcpy(s->wire.in + s->wire.in_size, ping, sizeof ping);
    s->wire.in_size += sizeof ping;
    stream_run(s, 3);
    assert_true(srv_ws_is_over(s->ws));
    struct sent sent = { .size = 0 };
    size_t at = 0;
    assert_true(next_sent(&s->wire, &at, &sent));
    assert_int_equal(sent.first, 0x89); /* the ping before it */
    assert_true(next_sent(&s->wire, &at, &sent));
    assert_int_equal(sent.first, 0x82);
    assert_memory_equal(sent.bytes + PROTO_FRAME_HEADER_BYTES, blob->bytes, blob->size);
    assert_true(next_sent(&s->wire, &at, &sent));
    assert_int_equal(sent.first, 0x88);
    assert_false(next_sent(&s->wire, &at, &sent));
    srv_blob_unref(&blob);
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
        assert_int_equal(stream_set_up(&one), 0);
        struct stream *s = one;
        stream_run(s, 1); /* sends the first notifications */
        s->wire.out_size = 0;
        send_text(&s->wire, update, sizeof update - 1);
        memory_fail_after(n, MEMORY_STAYS_OUT);
        srv_ws_read(s->ws, 2);
        answered = !memory_restore();
        stream_run(s, 3);
        unsigned code = close_code(&s->wire);
        assert_true(code == 0 || code == 1011);
        assert_true(code == 1011 || s->wire.out_size > 0 || srv_ws_is_lost(s->ws));
        assert_int_equal(srv_ws_is_over(s->ws), code == 1011 || srv_ws_is_lost(s->ws));
        closed += code == 1011;
        assert_int_equal(stream_tear_down(&one), 0);
        assert_compare(n, <, 10000);
    }
    assert_compare(closed, >, 0);
}

#define WITH_STREAM(test) cmocka_unit_test_setup_teardown(test, stream_set_up, stream_tear_down)

int main(void) {
    const struct CMUnitTest tests[] = {
        WITH_STREAM(answers_count_towards_the_ingress_quota),
        WITH_STREAM(a_view_is_encoded_once_for_all_participants),
        WITH_STREAM(participants_skip_views_over_the_quota_of_notifications),
        WITH_STREAM(a_flood_is_read_in_pieces_and_nothing_is_lost),
        WITH_STREAM(one_read_takes_a_few_kib),
        WITH_STREAM(a_long_message_is_read_at_once),
        WITH_STREAM(streams_of_one_session_do_not_delay_another),
        WITH_STREAM(reading_stops_while_the_client_does_not_read),
        cmocka_unit_test(an_image_arrives_whole_in_pieces_of_any_size),
        WITH_STREAM(an_image_is_sent_without_a_copy),
        WITH_STREAM(a_close_waits_for_the_image_before_it),
        WITH_STREAM(a_protocol_error_does_not_corrupt_an_image),
        cmocka_unit_test(out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
