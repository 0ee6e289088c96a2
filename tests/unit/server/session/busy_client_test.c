/* SPDX-License-Identifier: Apache-2.0
 *
 * The window and the rate control with a client that acknowledges late because its processor is
 * busy, driven by a simulated clock.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "session/congestion.h"
#include "session/rate_control.h"
#include "support/compare.h"

/* Bytes of a frame at full size: while the view moves in best quality, and when it rests. */
enum { SIDE = 1024, IMAGE = 100000, VIDEO = 10000, FINAL = 300000 };
#define MOVES_MS 3000.0
static const uint32_t full[2] = { SIDE, SIDE };

struct client {
    double rtt_ms, bytes_per_ms; /* of its network */
    double delay_ms, jitter_ms;  /* of its acknowledgements */
    double wake_ms;              /* until it answers a ping */
    bool takes_video, answers_pings;
};

struct seen {                /* in the last second */
    unsigned frames, finest; /* finest: frames of step 0 */
    unsigned videos;
    double used;             /* share of what the link carries */
    double rate, longest_ms; /* as measured; to send a frame */
};

static uint32_t next_random(uint32_t *seed) {
    return *seed = *seed * 1664525 + 1013904223;
}

static size_t bytes_of(const struct srv_rate_control *control) {
    const struct srv_rate_step step = srv_rate_control_step(control);
    const double part = pow((double)step.side / SRV_RATE_SIDES, 1.5) *
                        pow((double)step.quality / SRV_RATE_QUALITY_MAX, 0.6);
    return (size_t)(part * (control->is_video ? VIDEO : IMAGE));
}

/* Sends frames of a view that moves for three seconds and rests for a moment, again and again: at
 * most 60 per second, each as soon as the window opens. */
static struct seen simulate(const struct client *client, int seconds) {
    struct srv_congestion window;
    struct srv_rate_control control;
    struct seen seen = { 0 };
    double ack_ms = INFINITY, pong_ms[2] = { INFINITY, INFINITY }, free_ms = 0, next_ms = 0,
           rest_ms = MOVES_MS;
    uint32_t frame = 0, seed = 1;
    srv_congestion_init(&window);
    srv_rate_control_init(&control);
    srv_congestion_ponged(&window, client->rtt_ms, 1);
    for (double now = 1; now < seconds * 1000.0; now += 0.25) {
        const struct srv_congestion_demand demand = { .max_fps = 60, .bytes_max = 1u << 30 };
        const struct srv_rate_demand rate = { .bytes_per_ms = srv_congestion_rate(&window),
                                              .interval_ms = 1000.0 / 60,
                                              .takes_video = client->takes_video,
                                              .quality = 90 };
        for (int end = 0; end < 2; end++)
            if (now >= pong_ms[end]) {
                srv_congestion_arrived(&window, frame, end, now);
                pong_ms[end] = INFINITY;
            }
        if (now >= ack_ms) {
            assert_true(srv_congestion_acked(&window, frame, now));
            srv_rate_control_update(&control, &rate);
            ack_ms = INFINITY;
        }
        if (now < next_ms || isfinite(ack_ms) ||
            srv_congestion_opens_ms(&window, &demand, now) > now)
            continue;
        const bool is_final = now >= rest_ms;
        rest_ms += is_final ? MOVES_MS : 0;
        const struct srv_rate_step step = srv_rate_control_step(&control);
        struct srv_rate_frame drawn = { .is_video = control.is_video,
                                        .quality = step.quality,
                                        .full_size = { SIDE, SIDE },
                                        .bytes = is_final ? FINAL : bytes_of(&control) };
        srv_rate_control_size(&control, full, drawn.size);
        if (!is_final)
            srv_rate_control_learn(&control, &drawn);
        srv_congestion_sent(&window, ++frame, drawn.bytes, now);
        const double send_ms = (double)drawn.bytes / client->bytes_per_ms;
        pong_ms[0] = fmax(now, free_ms) + client->rtt_ms + client->wake_ms;
        free_ms = fmax(now, free_ms) + send_ms;
        pong_ms[1] = free_ms + client->rtt_ms + client->wake_ms;
        for (int end = 0; end < 2 && !client->answers_pings; end++)
            pong_ms[end] = INFINITY;
        ack_ms = free_ms + client->rtt_ms + client->delay_ms +
                 client->jitter_ms * (next_random(&seed) >> 8) / (1 << 24);
        next_ms = now + 1000.0 / 60;
        if (now >= (seconds - 1) * 1000.0 && !is_final) {
            seen.frames++;
            seen.finest += control.step == 0;
            seen.videos += control.is_video;
            seen.used += (double)drawn.bytes / (client->bytes_per_ms * 1000);
            seen.longest_ms = fmax(seen.longest_ms, send_ms);
        }
    }
    seen.rate = srv_congestion_rate(&window);
    return seen;
}

/* 1 Gbit/s and 100 Mbit/s, which carry an image in 0.8 and in 8 ms. */
static void a_busy_client_on_a_fast_network_gets_full_images(void **state) {
    (void)state;
    static const double rates[] = { 125000, 12500 }, delays[] = { 0, 5, 12, 20, 40 };
    for (int video = 0; video < 2; video++)
        for (size_t r = 0; r < sizeof rates / sizeof *rates; r++)
            for (size_t d = 0; d < sizeof delays / sizeof *delays; d++)
                for (double jitter_ms = 0; jitter_ms <= 8; jitter_ms += 4) {
                    const struct client client = { .rtt_ms = 1,
                                                   .bytes_per_ms = rates[r],
                                                   .delay_ms = delays[d],
                                                   .jitter_ms = jitter_ms,
                                                   .takes_video = video };
                    const struct seen seen = simulate(&client, 21);
                    assert_int_equal(seen.videos, 0);
                    assert_int_equal(seen.finest, seen.frames);
                }
}

/* Pongs tell how long acknowledgements wait, whatever the sizes of frames and the jitter. */
static void pings_behind_frames_tell_a_busy_client_from_a_slow_network(void **state) {
    const struct client busy = { .rtt_ms = 1,
                                 .bytes_per_ms = 12500,
                                 .delay_ms = 10,
                                 .jitter_ms = 40,
                                 .wake_ms = 10,
                                 .takes_video = true,
                                 .answers_pings = true };
    const struct client slow = {
        .rtt_ms = 1, .bytes_per_ms = 1000, .delay_ms = 10, .jitter_ms = 10, .answers_pings = true
    };
    const struct seen fast = simulate(&busy, 9), small = simulate(&slow, 9);
    (void)state;
    assert_int_equal(fast.videos, 0);
    assert_int_equal(fast.finest, fast.frames);
    assert_in_range((uintmax_t)small.rate, 900, 1100);
}

/* A proxy that answers pings in place of the client hides at most 60 ms. */
static void an_early_pong_is_believed_in_part(void **state) {
    struct srv_congestion window;
    (void)state;
    srv_congestion_init(&window);
    srv_congestion_ponged(&window, 1, 1);
    srv_congestion_sent(&window, 1, 100000, 10);
    for (int end = 0; end < 2; end++) {
        srv_congestion_arrived(&window, 1, end, 11);
        srv_congestion_arrived(&window, 7, end, 11);
    }
    assert_true(srv_congestion_acked(&window, 1, 171));
    assert_in_range((uintmax_t)srv_congestion_rate(&window), 990, 1020);
}

/* 8 Mbit/s carry an image in 100 ms: frames become smaller, and the measured rate is right. */
static void a_slow_network_is_still_seen(void **state) {
    (void)state;
    static const double delays[] = { 0, 5, 20 };
    for (int video = 0; video < 2; video++)
        for (size_t d = 0; d < sizeof delays / sizeof *delays; d++)
            for (double jitter_ms = 0; jitter_ms <= 8; jitter_ms += 4) {
                const struct client client = { .rtt_ms = 20,
                                               .bytes_per_ms = 1000,
                                               .delay_ms = delays[d],
                                               .jitter_ms = jitter_ms,
                                               .takes_video = video };
                const struct seen seen = simulate(&client, 21);
                assert_compare(seen.rate, <=, 1500);
                assert_compare(seen.longest_ms, <=, 50);
                assert_int_equal(seen.videos, video ? seen.frames : 0);
                if (!video)
                    assert_int_equal(seen.finest, 0);
            }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_busy_client_on_a_fast_network_gets_full_images),
        cmocka_unit_test(pings_behind_frames_tell_a_busy_client_from_a_slow_network),
        cmocka_unit_test(an_early_pong_is_believed_in_part),
        cmocka_unit_test(a_slow_network_is_still_seen),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
