/* SPDX-License-Identifier: Apache-2.0
 *
 * Flow control of one client's stream: how many frames may be on their way.
 *
 *   server  ──1──2──3──4──►  client        window = round trip / time between frames + 1
 *           ◄──ack 1──2────
 *
 * The round trip is the smallest one seen in the last 10 to 20 seconds, from handing a frame to the
 * socket to its acknowledgement, so that a queue which we caused ourselves does not count; it is
 * forgotten only for frames that were sent alone, which happens whenever the view rests. The time
 * between frames is what the client achieves (its acknowledgements while frames were on their way),
 * never shorter than the granted rate allows. While the window is what limits the stream, the mean
 * time between acknowledgements is round trip / window: the window grows by one a round trip until
 * link, client or granted rate become the limit. Before the first acknowledgement it is
 * SRV_WINDOW_FIRST. Pure: no clock, no lock.
 */
#ifndef SRV_SESSION_FLOW_H
#define SRV_SESSION_FLOW_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SRV_WINDOW_FIRST = 2, SRV_WINDOW_MAX = 64 };

struct srv_window_frame {
    uint32_t frame;
    size_t bytes;
    double sent_ms;
    bool alone; /* nothing else was on its way */
};

struct srv_window {
    struct srv_window_frame flying[SRV_WINDOW_MAX]; /* ring, oldest at `head` */
    unsigned head, count;
    size_t bytes;               /* of the frames on their way */
    double rtt_ms[2];           /* smallest in the current and the previous 10 s; 0 = none */
    double epoch_ms;            /* start of the current 10 s */
    double interval_ms;         /* mean time between acknowledgements; 0 = none yet */
    double last_ack_ms;         /* 0 = none yet */
    uint32_t last_frame, acked; /* newest sent, newest acknowledged; 0 = none */
};

void srv_window_init(struct srv_window *flow);

/* A frame goes to the socket. Frame numbers rise. At most SRV_WINDOW_MAX may be on their way. */
void srv_window_sent(struct srv_window *flow, uint32_t frame, size_t bytes, double now_ms);

/* The client has `frame`, and with it every older one. False if it was never sent; an old one again
 * is harmless. */
bool srv_window_acked(struct srv_window *flow, uint32_t frame, double now_ms);

/* Frames that may be on their way at a granted rate, [SRV_WINDOW_FIRST, SRV_WINDOW_MAX]. */
unsigned srv_window_frames(const struct srv_window *flow, double max_fps);

/* The measured round trip, ms; 0 = not known yet. */
double srv_window_rtt_ms(const struct srv_window *flow);

/* May one more frame be made, when `waiting` are already being made or wait for the socket? One
 * frame is always allowed, however large. */
bool srv_window_is_open(const struct srv_window *flow, unsigned waiting, double max_fps,
                        size_t bytes_max);

/* Since when the oldest frame has been on its way; 0 = none is. */
double srv_window_oldest_ms(const struct srv_window *flow);

#endif
