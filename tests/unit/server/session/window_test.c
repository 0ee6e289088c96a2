/* SPDX-License-Identifier: Apache-2.0
 *
 * The window and the outbox, driven by a simulated clock.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "session/outbox.h"
#include "session/window.h"
#include "support/compare.h"

#define CAP ((size_t)1 << 30)

/* Simulates a client with a round trip of `rtt_ms` that needs `serial_ms` per frame, and a server
 * that needs `make_ms` per frame. Returns the frames acknowledged in the last of `seconds`, and the
 * size of the window in *frames. */
static unsigned simulate(struct srv_window *window, double rtt_ms, double serial_ms, double make_ms,
                         double max_fps, int seconds, unsigned *frames) {
    enum { QUEUE = 256 };
    double due[QUEUE], free_ms = 0, next_ms = 0;
    unsigned head = 0, tail = 0, last_second = 0;
    uint32_t frame = 0, acked = 0;
    srv_window_init(window);
    for (double now = 1; now < seconds * 1000.0; now += 0.25) {
        while (head != tail && due[head % QUEUE] <= now) {
            assert_true(srv_window_acked(window, ++acked, now));
            last_second += now >= (seconds - 1) * 1000.0;
            head++;
        }
        if (now < next_ms || !srv_window_is_open(window, 0, max_fps, CAP))
            continue;
        next_ms = now + (make_ms > 1000 / max_fps ? make_ms : 1000 / max_fps);
        srv_window_sent(window, ++frame, 1000, now);
        double arrives = now + rtt_ms / 2;
        free_ms = (arrives > free_ms ? arrives : free_ms) + serial_ms;
        due[tail++ % QUEUE] = free_ms + rtt_ms / 2;
    }
    *frames = srv_window_frames(window, max_fps);
    return last_second;
}

static void the_window_holds_the_rate_at_any_round_trip(void **state) {
    (void)state;
    struct srv_window window;
    unsigned frames;
    static const double round_trips[] = { 1, 20, 50, 100, 250, 500 };
    for (size_t i = 0; i < sizeof round_trips / sizeof *round_trips; i++) {
        unsigned fps = simulate(&window, round_trips[i], 0, 1, 30, 30, &frames);
        assert_in_range(fps, 28, 31);
        assert_in_range(frames, 2, (unsigned)(round_trips[i] / 33.3) + 2);
        assert_compare(srv_window_rtt_ms(&window), >=, round_trips[i] - 1);
        assert_compare(srv_window_rtt_ms(&window), <=, round_trips[i] + 1);
    }
}

static void a_slow_client_is_not_flooded(void **state) {
    (void)state;
    struct srv_window window;
    unsigned frames;
    unsigned fps = simulate(&window, 10, 100, 1, 60, 30, &frames);
    assert_in_range(fps, 9, 11);
    assert_in_range(frames, 2, 3);
    /* A distant and slow client: the frames in flight cover little more than the round trip. */
    fps = simulate(&window, 400, 100, 1, 60, 40, &frames);
    assert_in_range(fps, 8, 11);
    assert_in_range(frames, 5, 8);
    /* A slow server needs no window. */
    fps = simulate(&window, 50, 0, 200, 60, 30, &frames);
    assert_in_range(fps, 4, 5);
    assert_in_range(frames, 2, 4);
}

static void a_client_that_never_acknowledges_gets_two_frames(void **state) {
    (void)state;
    struct srv_window window;
    srv_window_init(&window);
    uint32_t sent = 0;
    for (double now = 1; now < 60000; now += 10)
        if (srv_window_is_open(&window, 0, 30, CAP))
            srv_window_sent(&window, ++sent, 100, now);
    assert_int_equal(sent, SRV_WINDOW_FIRST);
    assert_compare(srv_window_oldest_ms(&window), ==, 1);
    assert_false(srv_window_acked(&window, 3, 60000));
    assert_false(srv_window_acked(&window, 0, 60000));
    assert_true(srv_window_acked(&window, 2, 60000));
    assert_true(srv_window_acked(&window, 1, 60000));
    assert_int_equal(window.count, 0);
    assert_int_equal(window.bytes, 0);
    assert_compare(srv_window_oldest_ms(&window), ==, 0);
}

static void bytes_are_limited_but_one_frame_is_always_sent(void **state) {
    (void)state;
    struct srv_window window;
    srv_window_init(&window);
    assert_true(srv_window_is_open(&window, 0, 30, 10));
    srv_window_sent(&window, 1, 1000, 1);
    assert_false(srv_window_is_open(&window, 0, 30, 10));
    assert_true(srv_window_is_open(&window, 0, 30, 1001));
    assert_false(srv_window_is_open(&window, 1, 30, 1001));
    srv_window_acked(&window, 1, 2);
    assert_true(srv_window_is_open(&window, 0, 30, 10));
}

static void an_old_round_trip_is_dropped(void **state) {
    (void)state;
    struct srv_window window;
    srv_window_init(&window);
    uint32_t frame = 0;
    double now = 1;
    for (; now < 1000; now += 100) {
        srv_window_sent(&window, ++frame, 1, now);
        srv_window_acked(&window, frame, now + 5);
    }
    assert_compare(srv_window_rtt_ms(&window), <=, 5.001);
    for (; now < 30000; now += 100) {
        srv_window_sent(&window, ++frame, 1, now);
        srv_window_acked(&window, frame, now + 80);
    }
    assert_compare(srv_window_rtt_ms(&window), >=, 79);
}

static void the_outbox_keeps_the_newest(void **state) {
    (void)state;
    struct srv_outbox outbox;
    struct proto_frame_header header = { .seq = 1 }, got;
    struct srv_blob *a = srv_blob_create((const uint8_t *)"a", 1);
    struct srv_blob *b = srv_blob_create((const uint8_t *)"bb", 2);
    srv_outbox_init(&outbox);
    assert_null(srv_outbox_take(&outbox, &got));
    assert_true(srv_outbox_put(&outbox, 5, &header, a));
    header.seq = 2;
    assert_true(srv_outbox_put(&outbox, 7, &header, b));
    assert_int_equal(a->references, 1);
    header.seq = 3;
    assert_false(srv_outbox_put(&outbox, 6, &header, a)); /* late */
    assert_int_equal(outbox.dropped, 2);
    struct srv_blob *taken = srv_outbox_take(&outbox, &got);
    assert_ptr_equal(taken, b);
    assert_int_equal(got.seq, 2);
    assert_null(srv_outbox_take(&outbox, &got));
    assert_false(srv_outbox_put(&outbox, 7, &header, a));
    assert_true(srv_outbox_put(&outbox, 8, &header, a));
    srv_outbox_finish(&outbox);
    assert_int_equal(a->references, 1);
    srv_blob_unref(&taken);
    srv_blob_unref(&a);
    srv_blob_unref(&b);
    assert_null(a);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_window_holds_the_rate_at_any_round_trip),
        cmocka_unit_test(a_slow_client_is_not_flooded),
        cmocka_unit_test(a_client_that_never_acknowledges_gets_two_frames),
        cmocka_unit_test(bytes_are_limited_but_one_frame_is_always_sent),
        cmocka_unit_test(an_old_round_trip_is_dropped),
        cmocka_unit_test(the_outbox_keeps_the_newest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
