/* SPDX-License-Identifier: Apache-2.0 */
#include "session/congestion.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#define BASE_EPOCH_MS 10000.0
#define RATE_EPOCH_MS 1000.0
enum { RATE_EPOCH_ACKS = 8 };
/* Shorter times are jitter: a small frame says little about a fast link. */
#define TRIP_MIN_MS 2.0
#define EARLY_MS 3.0 /* a frame may wait so long for the link: it must not idle by jitter */
/* Processes on both sides may take so long to wake up. The pongs cannot tell more: the network may
 * deliver both pings and the frame at once. */
#define WAKE_MAX_MS 6.0
#define WAIT_MAX_MS 60.0   /* a client may wait so long before it acknowledges a frame */
#define WAIT_USUAL_MS 30.0 /* of a busy client, after which its acknowledgement is late */
#define LATE_MS 10.0       /* an acknowledgement may be so late, and an interval between frames */

void srv_congestion_init(struct srv_congestion *window) {
    memset(window, 0, sizeof *window);
}

static struct srv_congestion_frame *at(struct srv_congestion *window, unsigned i) {
    return &window->inflight[(window->head + i) % SRV_CONGESTION_MAX];
}

static double send_ms(const struct srv_congestion *window, double bytes) {
    double rate = srv_congestion_rate(window);
    return rate > 0 ? bytes / rate : 0;
}

/* Expects when the link has carried the frame. */
static void expect(struct srv_congestion *window, struct srv_congestion_frame *f) {
    window->free_ms = fmax(window->free_ms, f->sent_ms) + send_ms(window, (double)f->bytes);
    f->due_ms = window->free_ms + srv_congestion_rtt_ms(window);
}

void srv_congestion_sent(struct srv_congestion *window, uint32_t frame, size_t bytes,
                         double now_ms) {
    bool alone = window->count == 0;
    assert(window->count < SRV_CONGESTION_MAX && frame > window->last_frame);
    struct srv_congestion_frame *f = at(window, window->count++);
    *f = (struct srv_congestion_frame){ .frame = frame,
                                        .bytes = bytes,
                                        .sent_ms = now_ms,
                                        .alone = alone,
                                        .is_first = alone || window->free_ms <= now_ms,
                                        .acked = window->acked_bytes,
                                        .acked_ms = alone ? now_ms : window->last_ack_ms,
                                        .before_ms = alone ? now_ms : window->last_sent_ms };
    expect(window, f);
    window->bytes += bytes;
    window->last_frame = frame;
    window->frame_bytes +=
        ((double)bytes - window->frame_bytes) / (window->frame_bytes > 0 ? 4 : 1);
}

/* `may_drop`: older measurements are dropped when their time is over. */
static void measure_base(struct srv_congestion *window, double rtt_ms, bool may_drop,
                         double now_ms) {
    double age_ms = now_ms - window->base_epoch_ms;
    if (may_drop && age_ms > BASE_EPOCH_MS) {
        window->base_ms[1] = age_ms > 2 * BASE_EPOCH_MS ? 0 : window->base_ms[0];
        window->base_ms[0] = 0;
        window->base_epoch_ms = now_ms;
    }
    if (window->base_ms[0] == 0 || rtt_ms < window->base_ms[0])
        window->base_ms[0] = fmax(rtt_ms, 0.01);
}

/* Returns the rate of a frame over its time on the way, bytes per ms. */
static double rate_of(struct srv_congestion *window, const struct srv_congestion_frame *f,
                      double now_ms) {
    const double trip_ms = now_ms - f->sent_ms - srv_congestion_rtt_ms(window);
    double rate = 0;
    if (f->arrived_ms > 0) {
        const double between_ms = f->begun_ms > 0 ? now_ms - f->begun_ms : trip_ms;
        const double took_ms = fmin(fmax(between_ms, trip_ms - WAKE_MAX_MS), trip_ms);
        return (double)f->bytes / fmax(took_ms, TRIP_MIN_MS);
    }
    srv_ack_delay_limit(&window->delay, trip_ms);
    if (f->is_first)
        rate = srv_ack_delay_add(&window->delay, (double)f->bytes, trip_ms, now_ms);
    return fmax(rate,
                (double)f->bytes / fmax(trip_ms - srv_ack_delay_ms(&window->delay), TRIP_MIN_MS));
}

static void measure_rate(struct srv_congestion *window, const struct srv_congestion_frame *f,
                         double now_ms) {
    double bytes = (double)(window->acked_bytes - f->acked);
    double took_ms = fmax(now_ms - f->acked_ms, f->sent_ms - f->before_ms);
    double rate = bytes / fmax(took_ms, TRIP_MIN_MS);
    if (window->is_base_exact)
        rate = fmax(rate, rate_of(window, f, now_ms));
    if (window->rate_acks++ == RATE_EPOCH_ACKS || now_ms - window->rate_epoch_ms > RATE_EPOCH_MS) {
        window->rate[1] = window->rate[0];
        window->rate[0] = 0;
        window->rate_acks = 1;
        window->rate_epoch_ms = now_ms;
    }
    window->rate[0] = fmax(window->rate[0], rate);
}

/* The frames before the unacknowledged ones had passed the link by `passed_ms`. */
static void predict_arrivals(struct srv_congestion *window, double passed_ms) {
    window->free_ms = passed_ms;
    for (unsigned i = 0; i < window->count; i++)
        expect(window, at(window, i));
}

void srv_congestion_arrived(struct srv_congestion *window, uint32_t frame, bool is_end,
                            double now_ms) {
    for (unsigned i = 0; i < window->count; i++) {
        struct srv_congestion_frame *f = at(window, i);
        double *when = is_end ? &f->arrived_ms : &f->begun_ms;
        if (f->frame == frame && *when == 0)
            *when = now_ms;
    }
}

/* Returns when a frame arrived that is acknowledged now. */
static double arrival_ms(const struct srv_congestion_frame *f, double now_ms) {
    return f->arrived_ms > 0 ? fmax(f->arrived_ms, now_ms - WAIT_MAX_MS) : now_ms;
}

static void measure_acked(struct srv_congestion *window, const struct srv_congestion_frame *f,
                          double arrived_ms) {
    const double rtt_ms = arrived_ms - f->sent_ms;
    const bool has_pong = window->is_base_exact,
               is_shorter = rtt_ms < srv_congestion_rtt_ms(window);
    if (!has_pong || is_shorter) {
        window->is_base_exact = has_pong && f->arrived_ms > 0;
        measure_base(window, rtt_ms, f->alone && !has_pong, arrived_ms);
    }
    measure_rate(window, f, arrived_ms);
}

bool srv_congestion_acked(struct srv_congestion *window, uint32_t frame, double now_ms) {
    if (frame == 0 || frame > window->last_frame)
        return false;
    double arrived_ms = 0;
    while (window->count > 0 && at(window, 0)->frame <= frame) {
        struct srv_congestion_frame *oldest = at(window, 0);
        arrived_ms = fmax(arrival_ms(oldest, now_ms), window->last_ack_ms);
        window->acked_bytes += oldest->bytes;
        window->bytes -= oldest->bytes;
        measure_acked(window, oldest, arrived_ms);
        window->last_sent_ms = oldest->sent_ms;
        window->head = (window->head + 1) % SRV_CONGESTION_MAX;
        window->count--;
    }
    if (arrived_ms > 0) {
        window->last_ack_ms = arrived_ms;
        predict_arrivals(window, arrived_ms - srv_congestion_rtt_ms(window));
    }
    return true;
}

void srv_congestion_ponged(struct srv_congestion *window, double rtt_ms, double now_ms) {
    if (!window->is_base_exact)
        window->base_ms[0] = window->base_ms[1] = 0;
    window->is_base_exact = true;
    measure_base(window, rtt_ms, true, now_ms);
}

static bool is_late(const struct srv_congestion *window, int max_fps, double now_ms) {
    const struct srv_congestion_frame *oldest = &window->inflight[window->head];
    if (window->count == 0)
        return false;
    const double waits_ms = oldest->arrived_ms > 0 ? oldest->arrived_ms + WAIT_USUAL_MS : 0;
    return now_ms > fmax(oldest->due_ms, waits_ms) + LATE_MS + 1000.0 / max_fps;
}

double srv_congestion_opens_ms(const struct srv_congestion *window,
                               const struct srv_congestion_demand *demand, double now_ms) {
    unsigned all = window->count + demand->waiting;
    if (all == 0)
        return now_ms;
    if (all >= SRV_CONGESTION_MAX || window->bytes >= demand->bytes_max)
        return INFINITY;
    if (srv_congestion_rate(window) == 0)
        return all < SRV_CONGESTION_FIRST ? now_ms : INFINITY;
    if (is_late(window, demand->max_fps, now_ms))
        return INFINITY;
    double free_ms =
        fmax(window->free_ms, now_ms) + send_ms(window, demand->waiting * window->frame_bytes);
    return free_ms - demand->lead_ms - EARLY_MS;
}

double srv_congestion_rtt_ms(const struct srv_congestion *window) {
    if (window->base_ms[1] == 0)
        return window->base_ms[0];
    return window->base_ms[0] == 0 ? window->base_ms[1]
                                   : fmin(window->base_ms[0], window->base_ms[1]);
}

double srv_congestion_rate(const struct srv_congestion *window) {
    return fmax(window->rate[0], window->rate[1]);
}

unsigned srv_congestion_frames(const struct srv_congestion *window, int max_fps) {
    double interval_ms = fmax(1000.0 / max_fps, send_ms(window, window->frame_bytes));
    return (unsigned)fmin(ceil(srv_congestion_rtt_ms(window) / interval_ms) + 1,
                          SRV_CONGESTION_MAX);
}

double srv_congestion_oldest_ms(const struct srv_congestion *window) {
    return window->count ? window->inflight[window->head].sent_ms : 0;
}
