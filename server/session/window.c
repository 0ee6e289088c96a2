/* SPDX-License-Identifier: Apache-2.0 */
#include "session/window.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#define EPOCH_MS 10000.0

void srv_window_init(struct srv_window *window) {
    memset(window, 0, sizeof *window);
}

void srv_window_sent(struct srv_window *window, uint32_t frame, size_t bytes, double now_ms) {
    bool alone = window->count == 0;
    assert(window->count < SRV_WINDOW_MAX && frame > window->last_frame);
    window->inflight[(window->head + window->count++) % SRV_WINDOW_MAX] = (struct srv_window_frame){
        .frame = frame, .bytes = bytes, .sent_ms = now_ms, .alone = alone
    };
    window->bytes += bytes;
    window->last_frame = frame;
}

static void measure(struct srv_window *window, const struct srv_window_frame *frame,
                    double now_ms) {
    double sent_ms = frame->sent_ms, rtt = fmax(now_ms - sent_ms, 0.01);
    if (frame->alone && now_ms - window->epoch_ms > EPOCH_MS) {
        window->rtt_ms[1] = now_ms - window->epoch_ms > 2 * EPOCH_MS ? 0 : window->rtt_ms[0];
        window->rtt_ms[0] = 0;
        window->epoch_ms = now_ms;
    }
    if (window->rtt_ms[0] == 0 || rtt < window->rtt_ms[0])
        window->rtt_ms[0] = rtt;
    /* Time without an unacknowledged frame says nothing about the client. */
    double interval = fmax(now_ms - fmax(window->last_ack_ms, sent_ms), 0);
    window->interval_ms = window->interval_ms == 0
                              ? interval
                              : window->interval_ms + (interval - window->interval_ms) / 8;
    window->last_ack_ms = now_ms;
}

bool srv_window_acked(struct srv_window *window, uint32_t frame, double now_ms) {
    if (frame == 0 || frame > window->last_frame)
        return false;
    while (window->count > 0 && window->inflight[window->head].frame <= frame) {
        struct srv_window_frame *oldest = &window->inflight[window->head];
        measure(window, oldest, now_ms);
        window->bytes -= oldest->bytes;
        window->acked = oldest->frame;
        window->head = (window->head + 1) % SRV_WINDOW_MAX;
        window->count--;
    }
    return true;
}

double srv_window_rtt_ms(const struct srv_window *window) {
    if (window->rtt_ms[1] == 0)
        return window->rtt_ms[0];
    return window->rtt_ms[0] == 0 ? window->rtt_ms[1] : fmin(window->rtt_ms[0], window->rtt_ms[1]);
}

unsigned srv_window_frames(const struct srv_window *window, double max_fps) {
    double rtt = srv_window_rtt_ms(window);
    if (rtt == 0)
        return SRV_WINDOW_FIRST;
    double interval = fmax(1000.0 / max_fps, window->interval_ms);
    double frames = ceil(rtt / interval) + 1;
    return (unsigned)fmin(fmax(frames, SRV_WINDOW_FIRST), SRV_WINDOW_MAX);
}

bool srv_window_is_open(const struct srv_window *window, unsigned waiting, double max_fps,
                        size_t bytes_max) {
    unsigned all = window->count + waiting;
    if (all == 0)
        return true;
    return all < srv_window_frames(window, max_fps) && window->bytes < bytes_max;
}

double srv_window_oldest_ms(const struct srv_window *window) {
    return window->count ? window->inflight[window->head].sent_ms : 0;
}
