/* SPDX-License-Identifier: Apache-2.0
 *
 * Time limits, pings and round trips of a stream.
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
#include "unit/server/http/websocket_fixture.h"
#include "unit/server/session/hub_fixture.h"

static void a_client_that_takes_half_an_image_has_stalled(void **state) {
    struct stream *s = *state;
    stream_run(s, 1);
    struct srv_blob *blob = deliver(s, 100000, 2);
    s->wire.piece = 30000;
    srv_ws_write(s->ws, 2);
    s->wire.is_full = true;
    for (double now_ms = 102; now_ms < 19900; now_ms += 100) {
        stream_run(s, now_ms);
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
    stream_run(s, 10);
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
static uint8_t read_ping(const struct wire *wire) {
    struct sent sent;
    uint8_t payload = 0;
    for (size_t at = 0; next_sent(wire, &at, &sent);)
        if (sent.first == 0x89)
            payload = sent.size == 1 ? sent.bytes[0] : 0;
    return payload;
}

static double round_trip(const struct stream *s) {
    struct fixture *f = s->fixture;
    return srv_congestion_rtt_ms(
        &srv_hub_find_active(f->hub, f->id)->participants->delivery.congestion_window);
}

static void a_round_trip_ends_when_its_bytes_were_read(void **state) {
    struct stream *s = *state;
    stream_run(s, 10);
    send_pong(&s->wire, read_ping(&s->wire)); /* of time 0 */
    s->wire.clock_ms = 25;
    stream_run(s, 20); /* the time of the loop is older than the bytes */
    assert_compare(round_trip(s), ==, 25);
}

static void the_round_trip_is_measured_while_no_image_is_on_its_way(void **state) {
    struct stream *s = *state;
    stream_run(s, 10);
    const uint8_t first = read_ping(&s->wire); /* of time 0, when it joined */
    assert_int_equal(first, 1);
    send_pong(&s->wire, 77); /* no ping has this payload */
    stream_run(s, 20);
    assert_compare(round_trip(s), ==, 0);
    send_pong(&s->wire, first);
    stream_run(s, 30);
    assert_compare(round_trip(s), ==, 30);
    send_pong(&s->wire, first); /* again */
    stream_run(s, 31);
    assert_compare(round_trip(s), ==, 30);
    struct srv_blob *blob = deliver(s, 100, 40);
    stream_run(s, 40);
    s->wire.out_size = 0;
    stream_tick(s, 300); /* the image is not acknowledged */
    stream_run(s, 300);
    assert_int_equal(read_ping(&s->wire), 0);
    static const char ack[] =
        "{\"jsonrpc\":\"2.0\",\"method\":\"stream.ack\",\"params\":{\"frame\":1}}";
    send_text(&s->wire, ack, sizeof ack - 1);
    stream_run(s, 400);
    stream_tick(s, 500);
    stream_run(s, 500);
    assert_int_equal(read_ping(&s->wire), 2);
    send_pong(&s->wire, 2);
    stream_run(s, 512);
    assert_compare(round_trip(s), ==, 12);
    srv_blob_unref(&blob);
}

static void messages_delay_the_ping_and_a_flood_is_due_at_once(void **state) {
    struct stream *s = *state;
    stream_run(s, 10);
    send_pings(&s->wire, 1);
    stream_run(s, 5000);
    assert_compare(srv_ws_deadline_ms(s->ws), ==, 20000);
    send_pings(&s->wire, 2500); /* more than one tick reads */
    stream_run(s, 6000);
    assert_true(srv_ws_is_paused(s->ws));
    assert_compare(srv_ws_deadline_ms(s->ws), <=, 6000);
}

static void an_image_without_acknowledgement_has_a_deadline(void **state) {
    struct stream *s = *state;
    stream_run(s, 1);
    send_pings(&s->wire, 1);
    stream_run(s, 12000); /* the client is not silent */
    srv_ws_tick(s->ws, 12050);
    struct srv_blob *blob = deliver(s, 100, 12100);
    stream_run(s, 12100);
    assert_compare(srv_ws_deadline_ms(s->ws), ==, 27100); /* the image had a ping of its own */
    srv_ws_tick(s->ws, 27101);                            /* sends a ping */
    stream_run(s, 27101);
    send_pings(&s->wire, 1);
    stream_run(s, 31000);
    srv_ws_tick(s->ws, 31050);
    tick_at_deadline(s, 32100);
    assert_int_equal(close_code(&s->wire), 1008);
    srv_blob_unref(&blob);
}

static void bytes_that_the_socket_refuses_have_a_deadline(void **state) {
    struct stream *s = *state;
    stream_run(s, 1);
    s->wire.is_full = true;
    send_pings(&s->wire, 1);
    stream_run(s, 12000); /* the answer and everything after it wait */
    srv_ws_tick(s->ws, 12050);
    assert_compare(srv_ws_deadline_ms(s->ws), ==, 27000);
    srv_ws_tick(s->ws, 27001);
    srv_ws_write(s->ws, 27001);
    tick_at_deadline(s, 32000);
    assert_true(srv_ws_is_lost(s->ws));
}

static void a_close_that_is_not_taken_has_a_deadline(void **state) {
    struct stream *s = *state;
    stream_run(s, 1);
    s->wire.is_full = true;
    srv_ws_close(s->ws, 1001, "good-bye", 100);
    srv_ws_write(s->ws, 100);
    tick_at_deadline(s, 2100);
    assert_true(srv_ws_is_lost(s->ws));
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define WITH_STREAM(test) cmocka_unit_test_setup_teardown(test, stream_set_up, stream_tear_down)
        WITH_STREAM(a_client_that_takes_half_an_image_has_stalled),
        WITH_STREAM(a_silent_client_gets_two_pings_and_is_lost),
        WITH_STREAM(a_round_trip_ends_when_its_bytes_were_read),
        WITH_STREAM(the_round_trip_is_measured_while_no_image_is_on_its_way),
        WITH_STREAM(messages_delay_the_ping_and_a_flood_is_due_at_once),
        WITH_STREAM(an_image_without_acknowledgement_has_a_deadline),
        WITH_STREAM(bytes_that_the_socket_refuses_have_a_deadline),
        WITH_STREAM(a_close_that_is_not_taken_has_a_deadline),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
