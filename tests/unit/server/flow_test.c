/* SPDX-License-Identifier: Apache-2.0
 *
 * The window, the size while moving, and the outbox, driven by a simulated clock.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "session/flow.h"
#include "session/outbox.h"
#include "session/pace.h"

#define CAP ((size_t)1 << 30)

/* A client `rtt_ms` away that needs `serial_ms` for each frame, and a server that can make one
 * every `make_ms`. Returns the frames acknowledged in the last of `seconds`. */
static unsigned simulate(struct srv_flow *flow, double rtt_ms, double serial_ms, double make_ms,
                         double max_fps, int seconds, unsigned *window) {
    enum { QUEUE = 256 };
    double due[QUEUE], free_ms = 0, next_ms = 0;
    unsigned head = 0, tail = 0, last_second = 0;
    uint32_t frame = 0, acked = 0;
    srv_flow_init(flow);
    for (double now = 1; now < seconds * 1000.0; now += 0.25) {
        while (head != tail && due[head % QUEUE] <= now) {
            assert_true(srv_flow_acked(flow, ++acked, now));
            last_second += now >= (seconds - 1) * 1000.0;
            head++;
        }
        if (now < next_ms || !srv_flow_is_open(flow, 0, max_fps, CAP))
            continue;
        next_ms = now + (make_ms > 1000 / max_fps ? make_ms : 1000 / max_fps);
        srv_flow_sent(flow, ++frame, 1000, now);
        double arrives = now + rtt_ms / 2;
        free_ms = (arrives > free_ms ? arrives : free_ms) + serial_ms;
        due[tail++ % QUEUE] = free_ms + rtt_ms / 2;
    }
    *window = srv_flow_window(flow, max_fps);
    return last_second;
}

static void the_window_holds_the_rate_at_any_round_trip(void **state) {
    (void)state;
    struct srv_flow flow;
    unsigned window;
    static const double round_trips[] = { 1, 20, 50, 100, 250, 500 };
    for (size_t i = 0; i < sizeof round_trips / sizeof *round_trips; i++) {
        unsigned fps = simulate(&flow, round_trips[i], 0, 1, 30, 30, &window);
        assert_in_range(fps, 28, 31);
        assert_in_range(window, 2, (unsigned)(round_trips[i] / 33.3) + 2);
        assert_true(srv_flow_rtt_ms(&flow) >= round_trips[i] - 1);
        assert_true(srv_flow_rtt_ms(&flow) <= round_trips[i] + 1);
    }
}

static void a_slow_client_is_not_flooded(void **state) {
    (void)state;
    struct srv_flow flow;
    unsigned window;
    unsigned fps = simulate(&flow, 10, 100, 1, 60, 30, &window);
    assert_in_range(fps, 9, 11);
    assert_in_range(window, 2, 3);
    /* A far and slow one: what is on its way covers the round trip, little more. */
    fps = simulate(&flow, 400, 100, 1, 60, 40, &window);
    assert_in_range(fps, 8, 11);
    assert_in_range(window, 5, 8);
    /* A slow server needs no window. */
    fps = simulate(&flow, 50, 0, 200, 60, 30, &window);
    assert_in_range(fps, 4, 5);
    assert_in_range(window, 2, 4);
}

static void who_never_acknowledges_gets_the_first_two(void **state) {
    (void)state;
    struct srv_flow flow;
    srv_flow_init(&flow);
    uint32_t sent = 0;
    for (double now = 1; now < 60000; now += 10)
        if (srv_flow_is_open(&flow, 0, 30, CAP))
            srv_flow_sent(&flow, ++sent, 100, now);
    assert_int_equal(sent, SRV_FLOW_FIRST);
    assert_true(srv_flow_oldest_ms(&flow) == 1);
    assert_false(srv_flow_acked(&flow, 3, 60000));
    assert_false(srv_flow_acked(&flow, 0, 60000));
    assert_true(srv_flow_acked(&flow, 2, 60000));
    assert_true(srv_flow_acked(&flow, 1, 60000));
    assert_int_equal(flow.count, 0);
    assert_int_equal(flow.bytes, 0);
    assert_true(srv_flow_oldest_ms(&flow) == 0);
}

static void bytes_are_capped_but_one_frame_always_goes(void **state) {
    (void)state;
    struct srv_flow flow;
    srv_flow_init(&flow);
    assert_true(srv_flow_is_open(&flow, 0, 30, 10));
    srv_flow_sent(&flow, 1, 1000, 1);
    assert_false(srv_flow_is_open(&flow, 0, 30, 10));
    assert_true(srv_flow_is_open(&flow, 0, 30, 1001));
    assert_false(srv_flow_is_open(&flow, 1, 30, 1001));
    srv_flow_acked(&flow, 1, 2);
    assert_true(srv_flow_is_open(&flow, 0, 30, 10));
}

static void an_old_round_trip_is_forgotten(void **state) {
    (void)state;
    struct srv_flow flow;
    srv_flow_init(&flow);
    uint32_t frame = 0;
    double now = 1;
    for (; now < 1000; now += 100) {
        srv_flow_sent(&flow, ++frame, 1, now);
        srv_flow_acked(&flow, frame, now + 5);
    }
    assert_true(srv_flow_rtt_ms(&flow) <= 5.001);
    for (; now < 30000; now += 100) {
        srv_flow_sent(&flow, ++frame, 1, now);
        srv_flow_acked(&flow, frame, now + 80);
    }
    assert_true(srv_flow_rtt_ms(&flow) >= 79);
}

static void the_size_holds_the_budget(void **state) {
    (void)state;
    struct srv_pace pace;
    uint32_t full[2] = { 1920, 1080 }, size[2] = { 0, 0 };
    /* fixed ms, ms a megapixel → is a 33 ms budget held? */
    static const struct {
        double fixed, slope, expected_area_min, expected_area_max;
    } cases[] = {
        { 1, 5, 0.9, 1.01 },     /* fast: full size */
        { 2, 40, 0.2, 0.42 },    /* 31 ms buy 0.78 of 2.07 megapixels */
        { 2, 2000, 0.05, 0.08 }, /* hopeless: the smallest */
        { 200, 100, 0.1, 0.3 },  /* fixed work dominates: shrinking more gains nothing */
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        srv_pace_init(&pace);
        for (int frame = 0; frame < 40; frame++) {
            srv_pace_size(&pace, full, 1000.0 / 30, size);
            if (frame % 8 == 7)
                memcpy(size, full, sizeof size); /* refinements in between */
            double pixels = (double)size[0] * size[1];
            srv_pace_add(&pace, pixels, cases[i].fixed + cases[i].slope * pixels * 1e-6);
        }
        srv_pace_size(&pace, full, 1000.0 / 30, size);
        double area = (double)size[0] * size[1] / (1920.0 * 1080);
        assert_true(area >= cases[i].expected_area_min && area <= cases[i].expected_area_max);
        double expected = cases[i].fixed + cases[i].slope * 1920 * 1080e-6;
        double ratio = srv_pace_expect_ms(&pace, 1920.0 * 1080) / expected;
        assert_true(ratio > 0.9 && ratio < 1.1);
    }
    /* A first frame that took long for another reason does not hold the size up. */
    srv_pace_init(&pace);
    srv_pace_add(&pace, 960 * 540, 900);
    srv_pace_add(&pace, 1920 * 1080, 600);
    srv_pace_size(&pace, full, 1000.0 / 30, size);
    assert_true(size[0] < 1920 && size[1] < 1080);
    uint32_t tiny[2] = { 1, 3 };
    srv_pace_size(&pace, tiny, 0.001, size);
    assert_true(size[0] >= 1 && size[1] >= 1);
}

static void what_size_cannot_hold_coarseness_does(void **state) {
    (void)state;
    struct srv_pace levels[SP_COARSE_MAX + 1];
    uint32_t full[2] = { 512, 512 }, size[2];
    unsigned level = 9;
    for (int i = 0; i <= SP_COARSE_MAX; i++)
        srv_pace_init(&levels[i]);
    /* 800 ms a voxel pass at level 0, an eighth of it a level coarser. */
    for (int frame = 0; frame < 20; frame++) {
        level = srv_pace_level(levels, full, 1000.0 / 30, size);
        double pixels = (double)size[0] * size[1];
        srv_pace_add(&levels[level], pixels, 800.0 / (1 << 3 * level) + 20 * pixels * 1e-6);
    }
    assert_int_equal(level, 2);
    assert_int_equal(size[0], 512); /* there it is fast enough for the whole picture */
    /* Fifteen frames a second are enough: detail is not given up for thirty. */
    for (int i = 0; i <= SP_COARSE_MAX; i++)
        srv_pace_init(&levels[i]);
    for (int frame = 0; frame < 20; frame++) {
        level = srv_pace_level(levels, full, 1000.0 / 30, size);
        double pixels = (double)size[0] * size[1];
        srv_pace_add(&levels[level], pixels, 400.0 / (1 << 3 * level) + 20 * pixels * 1e-6);
    }
    assert_int_equal(level, 1);
    srv_pace_init(&levels[0]);
    for (int frame = 0; frame < 3; frame++)
        srv_pace_add(&levels[0], 512 * 512, 10);
    assert_int_equal(srv_pace_level(levels, full, 1000.0 / 30, size), 0);
    assert_int_equal(size[0], 512);
}

static void one_slow_moment_does_not_blur_a_drag(void **state) {
    (void)state;
    struct srv_pace levels[SP_COARSE_MAX + 1];
    uint32_t full[2] = { 512, 512 }, size[2];
    for (int i = 0; i <= SP_COARSE_MAX; i++)
        srv_pace_init(&levels[i]);
    srv_pace_add(&levels[0], 512 * 512, 400);
    srv_pace_add(&levels[1], 256 * 256, 100); /* it will take 20 ms, but something was in the way */
    unsigned finest = SP_COARSE_MAX;
    int tries = 0;
    for (int frame = 0; frame < 60; frame++) {
        unsigned level = srv_pace_level(levels, full, 1000.0 / 30, size);
        srv_pace_add(&levels[level], (double)size[0] * size[1], level == 1 ? 20 : level ? 10 : 400);
        srv_pace_drawn(levels, level);
        finest = level < finest ? level : finest;
        tries += level == 0;
    }
    assert_int_equal(finest, 1);
    assert_int_equal(tries, 0); /* more than twice too slow */
    assert_int_equal(srv_pace_level(levels, full, 1000.0 / 30, size), 1);
    /* After a rest a level that is far too slow is measured once more, no matter how slow it was.
     */
    srv_pace_add(&levels[1], 256 * 256, 10000);
    assert_int_equal(srv_pace_level(levels, full, 1000.0 / 30, size), 2);
    srv_pace_rest(levels);
    assert_int_equal(srv_pace_level(levels, full, 1000.0 / 30, size), 1);
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
        cmocka_unit_test(who_never_acknowledges_gets_the_first_two),
        cmocka_unit_test(bytes_are_capped_but_one_frame_always_goes),
        cmocka_unit_test(an_old_round_trip_is_forgotten),
        cmocka_unit_test(the_size_holds_the_budget),
        cmocka_unit_test(what_size_cannot_hold_coarseness_does),
        cmocka_unit_test(one_slow_moment_does_not_blur_a_drag),
        cmocka_unit_test(the_outbox_keeps_the_newest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
