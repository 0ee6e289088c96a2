/* SPDX-License-Identifier: Apache-2.0
 *
 * The window and the outbox, driven by a simulated clock.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "session/congestion.h"
#include "session/outbox.h"
#include "support/compare.h"

#define CAP ((size_t)1 << 30)
#define FRAME 1000 /* bytes */

static bool is_open(const struct srv_congestion *window, unsigned waiting, int max_fps,
                    size_t bytes_max, double now_ms) {
    const struct srv_congestion_demand demand = { .waiting = waiting,
                                                  .max_fps = max_fps,
                                                  .bytes_max = bytes_max };
    return srv_congestion_opens_ms(window, &demand, now_ms) <= now_ms;
}

struct network {
    double rtt_ms, bytes_per_ms, make_ms; /* make_ms: the server needs it per frame */
    double jitter_ms;                     /* of every second acknowledgement */
    double pause_at_ms, pause_ms; /* nothing that is sent meanwhile is delivered before its end */
};

struct seen { /* in the last second */
    unsigned frames;
    double worst_ms, mean_ms; /* from sending to the acknowledgement */
};

/* Simulates a client on a network. */
static struct seen simulate(struct srv_congestion *window, const struct network *n, int max_fps,
                            int seconds) {
    enum { QUEUE = 256 };
    double due[QUEUE], sent[QUEUE], free_ms = 0, next_ms = 0;
    unsigned head = 0, tail = 0;
    uint32_t frame = 0, acked = 0;
    struct seen seen = { 0 };
    srv_congestion_init(window);
    srv_congestion_ponged(window, n->rtt_ms, 1);
    for (double now = 1; now < seconds * 1000.0; now += 0.25) {
        bool is_last = now >= (seconds - 1) * 1000.0;
        while (head != tail && due[head % QUEUE] <= now) {
            double took_ms = now - sent[head++ % QUEUE];
            assert_true(srv_congestion_acked(window, ++acked, now));
            seen.frames += is_last;
            seen.worst_ms = is_last && took_ms > seen.worst_ms ? took_ms : seen.worst_ms;
            seen.mean_ms += is_last ? (took_ms - seen.mean_ms) / seen.frames : 0;
        }
        if (now < next_ms || !is_open(window, 0, max_fps, CAP, now))
            continue;
        next_ms = now + (n->make_ms > 1000.0 / max_fps ? n->make_ms : 1000.0 / max_fps);
        srv_congestion_sent(window, ++frame, FRAME, now);
        sent[tail % QUEUE] = now;
        free_ms = (now > free_ms ? now : free_ms) + FRAME / n->bytes_per_ms;
        if (now >= n->pause_at_ms && now < n->pause_at_ms + n->pause_ms)
            free_ms = n->pause_at_ms + n->pause_ms;
        due[tail++ % QUEUE] = free_ms + n->rtt_ms + (frame % 2 ? n->jitter_ms : 0);
    }
    return seen;
}

static void the_rate_is_held_at_any_round_trip(void **state) {
    (void)state;
    struct srv_congestion window;
    static const double round_trips[] = { 1, 20, 50, 100, 250, 500 };
    for (size_t i = 0; i < sizeof round_trips / sizeof *round_trips; i++) {
        const struct network fast = { .rtt_ms = round_trips[i], .bytes_per_ms = 1e5, .make_ms = 1 };
        const struct seen seen = simulate(&window, &fast, 60, 10);
        assert_in_range(seen.frames, 58, 61);
        assert_compare(seen.worst_ms, <=, round_trips[i] + 1);
        assert_in_range(srv_congestion_frames(&window, 60), 2,
                        (unsigned)(round_trips[i] / 16.6) + 2);
        assert_compare(srv_congestion_rtt_ms(&window), ==, round_trips[i]);
    }
}

static void a_slow_link_is_busy_and_has_no_queue(void **state) {
    (void)state;
    struct srv_congestion window;
    static const double round_trips[] = { 1, 20, 100, 400 };
    for (size_t i = 0; i < sizeof round_trips / sizeof *round_trips; i++)
        for (int late = 0; late < 2; late++) {
            /* 25 ms per frame: 40 per second. Frames wait for the link for 3 ms, and longer by the
             * jitter. */
            const struct network slow = { .rtt_ms = round_trips[i],
                                          .bytes_per_ms = FRAME / 25.0,
                                          .make_ms = 1,
                                          .jitter_ms = late ? 4 : 0 };
            const struct seen seen = simulate(&window, &slow, 60, 10);
            assert_in_range(seen.frames, 36, 41);
            assert_compare(seen.worst_ms, <=, slow.rtt_ms + 25 + 3 + 1 + 3 * slow.jitter_ms);
            assert_compare(seen.mean_ms, <=, slow.rtt_ms + 25 + 3 + 2 + 2 * slow.jitter_ms);
            assert_compare(srv_congestion_rate(&window), >=, slow.bytes_per_ms * 0.95);
            assert_compare(srv_congestion_rate(&window), <=,
                           slow.bytes_per_ms * (late ? 1.25 : 1.05));
        }
}

static void a_slow_server_does_not_hide_what_the_link_carries(void **state) {
    (void)state;
    struct srv_congestion window;
    const struct network n = { .rtt_ms = 50, .bytes_per_ms = FRAME / 10.0, .make_ms = 200 };
    const struct seen seen = simulate(&window, &n, 60, 10);
    assert_in_range(seen.frames, 4, 5);
    assert_compare(srv_congestion_rate(&window), >=, FRAME / 10.5);
    assert_compare(srv_congestion_rate(&window), <=, FRAME / 9.5);
}

static void a_pause_of_the_network_builds_no_queue(void **state) {
    (void)state;
    struct srv_congestion window;
    const struct network n = {
        .rtt_ms = 20, .bytes_per_ms = 1e5, .make_ms = 1, .pause_at_ms = 8000, .pause_ms = 900
    };
    const struct seen seen = simulate(&window, &n, 60, 9);
    /* Some frames are on their way when it begins; then none is sent until it ends. */
    assert_in_range(seen.frames, 8, 16);
}

/* The first pong comes late, when much else begins. What acknowledgements show then is not taken
 * for a fast link. */
static void a_late_pong_does_not_hide_a_slow_link(void **state) {
    (void)state;
    struct srv_congestion window;
    srv_congestion_init(&window);
    srv_congestion_ponged(&window, 300, 1);
    double now = 1;
    for (uint32_t frame = 1; frame <= 30; frame++, now += 200) { /* 20 ms, 250 bytes per ms */
        srv_congestion_sent(&window, frame, 20000 + frame * 10, now);
        srv_congestion_acked(&window, frame, now + 20 + (20000 + frame * 10) / 250.0);
        assert_compare(srv_congestion_rate(&window), <=, 250.0);
    }
    srv_congestion_ponged(&window, 20, now);
    srv_congestion_sent(&window, 31, 20000, now);
    srv_congestion_acked(&window, 31, now + 20 + 80);
    assert_compare(srv_congestion_rate(&window), >=, 249.0);
    assert_compare(srv_congestion_rate(&window), <=, 251.0);
}

static void a_client_that_never_acknowledges_gets_two_frames(void **state) {
    (void)state;
    struct srv_congestion window;
    srv_congestion_init(&window);
    uint32_t sent = 0;
    for (double now = 1; now < 60000; now += 10)
        if (is_open(&window, 0, 30, CAP, now))
            srv_congestion_sent(&window, ++sent, 100, now);
    assert_int_equal(sent, SRV_CONGESTION_FIRST);
    assert_compare(srv_congestion_oldest_ms(&window), ==, 1);
    assert_false(srv_congestion_acked(&window, 3, 60000));
    assert_false(srv_congestion_acked(&window, 0, 60000));
    assert_true(srv_congestion_acked(&window, 2, 60000));
    assert_true(srv_congestion_acked(&window, 1, 60000));
    assert_int_equal(window.count, 0);
    assert_int_equal(window.bytes, 0);
    assert_compare(srv_congestion_oldest_ms(&window), ==, 0);
}

static void bytes_are_limited_but_one_frame_is_always_sent(void **state) {
    (void)state;
    struct srv_congestion window;
    srv_congestion_init(&window);
    assert_true(is_open(&window, 0, 30, 10, 1));
    srv_congestion_sent(&window, 1, 1000, 1);
    assert_false(is_open(&window, 0, 30, 10, 1));
    assert_true(is_open(&window, 0, 30, 1001, 1));
    assert_false(is_open(&window, 1, 30, 1001, 1));
    srv_congestion_acked(&window, 1, 2);
    assert_true(is_open(&window, 0, 30, 10, 2));
}

/* It begins so early that it is ready when the link is free. */
static void the_next_frame_is_drawn_while_the_last_one_is_sent(void **state) {
    (void)state;
    struct srv_congestion window;
    srv_congestion_init(&window);
    srv_congestion_ponged(&window, 20, 1);
    srv_congestion_sent(&window, 1, FRAME, 100);
    srv_congestion_acked(&window, 1, 160); /* 40 ms beyond the round trip */
    assert_compare(srv_congestion_rate(&window), ==, FRAME / 40.0);
    srv_congestion_sent(&window, 2, FRAME, 200);
    struct srv_congestion_demand demand = { .lead_ms = 0, .max_fps = 60, .bytes_max = CAP };
    const double idle_ms = srv_congestion_opens_ms(&window, &demand, 200);
    assert_compare(idle_ms, >, 230);
    assert_compare(idle_ms, <=, 240);
    demand.lead_ms = 15;
    assert_compare(srv_congestion_opens_ms(&window, &demand, 200), ==, idle_ms - 15);
    demand.waiting = 1; /* a frame that is being drawn comes before it */
    assert_compare(srv_congestion_opens_ms(&window, &demand, 200), ==, idle_ms - 15 + 40);
    /* The acknowledgement is late: nothing before it comes. */
    demand.waiting = 0;
    assert_compare(srv_congestion_opens_ms(&window, &demand, 300), ==, (double)INFINITY);
    assert_true(srv_congestion_acked(&window, 2, 310));
    assert_compare(srv_congestion_opens_ms(&window, &demand, 310), <=, 310);
}

static void an_old_round_trip_is_dropped(void **state) {
    (void)state;
    struct srv_congestion window;
    srv_congestion_init(&window);
    uint32_t frame = 0;
    double now = 1;
    for (; now < 1000; now += 100) {
        srv_congestion_sent(&window, ++frame, 1, now);
        srv_congestion_acked(&window, frame, now + 5);
    }
    assert_compare(srv_congestion_rtt_ms(&window), <=, 5.001);
    for (; now < 30000; now += 100) {
        srv_congestion_sent(&window, ++frame, 1, now);
        srv_congestion_acked(&window, frame, now + 80);
    }
    assert_compare(srv_congestion_rtt_ms(&window), >=, 79);
}

static void the_outbox_keeps_the_newest(void **state) {
    (void)state;
    struct srv_outbox outbox;
    struct proto_frame_header header = { .seq = 1 }, got;
    struct srv_blob *a = srv_blob_create(NULL, NULL, (const uint8_t *)"a", 1, NULL);
    struct srv_blob *b = srv_blob_create(NULL, NULL, (const uint8_t *)"bb", 2, NULL);
    srv_outbox_init(&outbox);
    assert_null(srv_outbox_pop(&outbox, &got));
    assert_true(srv_outbox_put(&outbox, 5, &header, a));
    header.seq = 2;
    assert_true(srv_outbox_put(&outbox, 7, &header, b));
    assert_int_equal(a->references, 1);
    header.seq = 3;
    assert_false(srv_outbox_put(&outbox, 6, &header, a)); /* late */
    assert_int_equal(outbox.dropped, 2);
    struct srv_blob *taken = srv_outbox_pop(&outbox, &got);
    assert_ptr_equal(taken, b);
    assert_int_equal(got.seq, 2);
    assert_null(srv_outbox_pop(&outbox, &got));
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
        cmocka_unit_test(the_rate_is_held_at_any_round_trip),
        cmocka_unit_test(a_slow_link_is_busy_and_has_no_queue),
        cmocka_unit_test(a_slow_server_does_not_hide_what_the_link_carries),
        cmocka_unit_test(a_pause_of_the_network_builds_no_queue),
        cmocka_unit_test(a_late_pong_does_not_hide_a_slow_link),
        cmocka_unit_test(the_next_frame_is_drawn_while_the_last_one_is_sent),
        cmocka_unit_test(a_client_that_never_acknowledges_gets_two_frames),
        cmocka_unit_test(bytes_are_limited_but_one_frame_is_always_sent),
        cmocka_unit_test(an_old_round_trip_is_dropped),
        cmocka_unit_test(the_outbox_keeps_the_newest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
