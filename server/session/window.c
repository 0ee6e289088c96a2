/* SPDX-License-Identifier: Apache-2.0 */
#include "session/window.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#define EPOCH_MS 10000.0

void srv_window_init(struct srv_window *flow) {
    memset(flow, 0, sizeof *flow);
}

void srv_window_sent(struct srv_window *flow, uint32_t frame, size_t bytes, double now_ms) {
    bool alone = flow->count == 0;
    assert(flow->count < SRV_WINDOW_MAX && frame > flow->last_frame);
    flow->flying[(flow->head + flow->count++) % SRV_WINDOW_MAX] = (struct srv_window_frame){
        .frame = frame, .bytes = bytes, .sent_ms = now_ms, .alone = alone
    };
    flow->bytes += bytes;
    flow->last_frame = frame;
}

static void measure(struct srv_window *flow, const struct srv_window_frame *frame, double now_ms) {
    double sent_ms = frame->sent_ms, rtt = fmax(now_ms - sent_ms, 0.01);
    if (frame->alone && now_ms - flow->epoch_ms > EPOCH_MS) {
        flow->rtt_ms[1] = now_ms - flow->epoch_ms > 2 * EPOCH_MS ? 0 : flow->rtt_ms[0];
        flow->rtt_ms[0] = 0;
        flow->epoch_ms = now_ms;
    }
    if (flow->rtt_ms[0] == 0 || rtt < flow->rtt_ms[0])
        flow->rtt_ms[0] = rtt;
    /* Time in which nothing was on its way says nothing about the client. */
    double interval = fmax(now_ms - fmax(flow->last_ack_ms, sent_ms), 0);
    flow->interval_ms =
        flow->interval_ms == 0 ? interval : flow->interval_ms + (interval - flow->interval_ms) / 8;
    flow->last_ack_ms = now_ms;
}

bool srv_window_acked(struct srv_window *flow, uint32_t frame, double now_ms) {
    if (frame == 0 || frame > flow->last_frame)
        return false;
    while (flow->count > 0 && flow->flying[flow->head].frame <= frame) {
        struct srv_window_frame *oldest = &flow->flying[flow->head];
        measure(flow, oldest, now_ms);
        flow->bytes -= oldest->bytes;
        flow->acked = oldest->frame;
        flow->head = (flow->head + 1) % SRV_WINDOW_MAX;
        flow->count--;
    }
    return true;
}

double srv_window_rtt_ms(const struct srv_window *flow) {
    if (flow->rtt_ms[1] == 0)
        return flow->rtt_ms[0];
    return flow->rtt_ms[0] == 0 ? flow->rtt_ms[1] : fmin(flow->rtt_ms[0], flow->rtt_ms[1]);
}

unsigned srv_window_frames(const struct srv_window *flow, double max_fps) {
    double rtt = srv_window_rtt_ms(flow);
    if (rtt == 0)
        return SRV_WINDOW_FIRST;
    double interval = fmax(1000.0 / max_fps, flow->interval_ms);
    double window = ceil(rtt / interval) + 1;
    return (unsigned)fmin(fmax(window, SRV_WINDOW_FIRST), SRV_WINDOW_MAX);
}

bool srv_window_is_open(const struct srv_window *flow, unsigned waiting, double max_fps,
                        size_t bytes_max) {
    unsigned all = flow->count + waiting;
    if (all == 0)
        return true;
    return all < srv_window_frames(flow, max_fps) && flow->bytes < bytes_max;
}

double srv_window_oldest_ms(const struct srv_window *flow) {
    return flow->count ? flow->flying[flow->head].sent_ms : 0;
}
