/* SPDX-License-Identifier: Apache-2.0
 *
 * The congestion window of one client's stream: how many frames may be unacknowledged. Pure: no
 * clock, no lock.
 */
#ifndef SRV_SESSION_WINDOW_H
#define SRV_SESSION_WINDOW_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SRV_WINDOW_FIRST = 2, SRV_WINDOW_MAX = 64 }; /* frames before the first acknowledgement */

struct srv_window_frame {
    uint32_t frame;
    size_t bytes;
    double sent_ms;
    bool alone; /* no other frame was unacknowledged */
};

/*   server  ──1──2──3──4──►  client        window = round trip / time between frames + 1
 *           ◄──ack 1──2────
 *
 * The round trip is the smallest one of the last 10 to 20 seconds, from handing a frame to the
 * socket to its acknowledgement, so that a queue that we caused ourselves does not count. It is
 * dropped only for frames that were sent alone, which happens whenever the view rests. The time
 * between frames is what the client achieves, never shorter than the granted rate allows. While the
 * window is the bottleneck, the mean time between acknowledgements is round trip / window: so the
 * window grows by one per round trip, until the network, the client or the granted rate is the
 * bottleneck. */
struct srv_window {
    struct srv_window_frame inflight[SRV_WINDOW_MAX]; /* ring of unacknowledged frames */
    unsigned head, count;                             /* head: the oldest */
    size_t bytes;                                     /* of the unacknowledged frames */
    double rtt_ms[2];           /* smallest in the current and the previous 10 s; 0 = none */
    double epoch_ms;            /* start of the current 10 s */
    double interval_ms;         /* mean time between acknowledgements; 0 = none yet */
    double last_ack_ms;         /* 0 = none yet */
    uint32_t last_frame, acked; /* newest sent, newest acknowledged; 0 = none */
};

void srv_window_init(struct srv_window *window);

/* A frame goes to the socket. Frame numbers rise. At most SRV_WINDOW_MAX may be unacknowledged. */
void srv_window_sent(struct srv_window *window, uint32_t frame, size_t bytes, double now_ms);

/* The client has `frame` and all older ones. False if it was never sent; an old one again is
 * harmless. */
bool srv_window_acked(struct srv_window *window, uint32_t frame, double now_ms);

/* Returns how many frames may be unacknowledged at a granted rate, [SRV_WINDOW_FIRST,
 * SRV_WINDOW_MAX]. */
unsigned srv_window_frames(const struct srv_window *window, double max_fps);

/* Returns the measured round trip, ms; 0 = not known yet. */
double srv_window_rtt_ms(const struct srv_window *window);

/* True if one more frame may be made while `waiting` frames are being made or wait for the socket.
 * One frame is always allowed, however large. */
bool srv_window_is_open(const struct srv_window *window, unsigned waiting, double max_fps,
                        size_t bytes_max);

/* Returns when the oldest unacknowledged frame was sent, ms; 0 = there is none. */
double srv_window_oldest_ms(const struct srv_window *window);

#endif
