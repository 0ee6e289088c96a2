/* SPDX-License-Identifier: Apache-2.0
 *
 * The congestion window of one client's stream: when the next frame may begin, so that no queue
 * builds up on the way to the client. Pure: no clock, no lock.
 *
 *             lead                bytes / rate        base
 *   begin ───────────► sent ═══════════════════► ───────────────► acknowledged
 *           drawn,           on the slowest link      the way there
 *           encoded                                   and back
 *
 * The next frame begins so that it finds the link free: `lead` ms before all frames on the way have
 * passed the link. Each acknowledgement corrects this expected time. A client whose
 * acknowledgements are late gets no frame until the next acknowledgement arrives.
 *
 *   base  The round trip of a message without bytes: the shortest pong of the last 10 to 20 seconds
 *         before the newest one. An acknowledgement that takes less time shows that the pong was
 *         late; it replaces the pong until the next one.
 *   delay The wait of a busy client before it acknowledges. A ping goes before each frame and one
 *         behind it. Browsers answer pings while a page is busy, so the second pong tells when the
 *         frame has arrived. The time between both pongs tells what part of its time the link took;
 *         up to 6 ms of the rest, in which processes woke up, are left out. Where no pong came,
 *         frames of different sizes tell the wait (ack_delay.h). A pong is believed for a wait of
 *         up to 60 ms, because a proxy may have answered the ping.
 *   rate  The rate of the link. Two measurements estimate it; neither exceeds the true rate while
 *         base and delay are right, apart from jitter. The largest of the last 8 to 16 frames
 *         counts, or of the last 1 to 2 seconds, whichever is shorter.
 *           1. The bytes of a frame over its round trip beyond base and delay. Exact if no other
 *              frame was on the way before it.
 *           2. The bytes that were acknowledged while the frame was on its way, over that time, or
 *              over the time in which they were sent if that was longer. Exact if the link was busy
 *              (Cardwell et al., BBR, 2016).
 */
#ifndef SRV_SESSION_CONGESTION_H
#define SRV_SESSION_CONGESTION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "session/ack_delay.h"

enum {
    SRV_CONGESTION_FIRST = 2,
    SRV_CONGESTION_MAX = 64
}; /* frames before the first acknowledgement */

struct srv_congestion_frame {
    uint32_t frame;
    size_t bytes;
    double sent_ms;
    double begun_ms, arrived_ms; /* when the pongs around it came; 0 = not yet */
    double due_ms;               /* when its acknowledgement is expected */
    bool alone;                  /* no other frame was unacknowledged */
    bool is_first;               /* the link was free */
    uint64_t acked;              /* bytes acknowledged before it was sent */
    double acked_ms;  /* time of the last acknowledgement before it was sent; sent_ms if alone */
    double before_ms; /* when the frame of that acknowledgement was sent; sent_ms if alone */
};

struct srv_congestion {
    struct srv_congestion_frame inflight[SRV_CONGESTION_MAX]; /* ring of unacknowledged frames */
    unsigned head, count;                                     /* head: the oldest */
    size_t bytes;                                             /* of the unacknowledged frames */
    double base_ms[2];    /* shortest in the current and the previous 10 s; 0 = none */
    double base_epoch_ms; /* start of the current 10 s */
    bool is_base_exact;   /* the base was measured by a pong */
    struct srv_ack_delay delay;
    double rate[2]; /* bytes per ms, largest of the current and the previous 8 frames or second; 0 =
                       none */
    unsigned rate_acks;   /* acknowledged frames among the current 8 */
    double rate_epoch_ms; /* start of the current second */
    double free_ms;       /* when the frames on the way have passed the link */
    double frame_bytes;   /* mean of the last frames; 0 = none */
    uint64_t acked_bytes; /* so far */
    double last_ack_ms;   /* time of the newest acknowledgement; 0 = none yet */
    double last_sent_ms;  /* when the newest acknowledged frame was sent */
    uint32_t last_frame;  /* newest sent; 0 = none */
};

void srv_congestion_init(struct srv_congestion *window);

/* Call it when a frame goes to the socket. Frame numbers rise. At most SRV_CONGESTION_MAX frames
 * may be unacknowledged. */
void srv_congestion_sent(struct srv_congestion *window, uint32_t frame, size_t bytes,
                         double now_ms);

/* Call it when the client acknowledges `frame`, and so all older frames. False if the frame was
 * never sent. A repeated acknowledgement is harmless. */
bool srv_congestion_acked(struct srv_congestion *window, uint32_t frame, double now_ms);

/* Call it when the ping before a frame was answered, or the one behind it (is_end). Frames that are
 * not on their way are ignored. */
void srv_congestion_arrived(struct srv_congestion *window, uint32_t frame, bool is_end,
                            double now_ms);

/* Call it when a ping was answered after rtt_ms. There was no unacknowledged frame when the ping
 * was sent. */
void srv_congestion_ponged(struct srv_congestion *window, double rtt_ms, double now_ms);

struct srv_congestion_demand { /* for one more frame */
    unsigned waiting;          /* frames that are being made or wait for the socket */
    double lead_ms;            /* expected time to draw and encode it */
    int max_fps;
    size_t bytes_max; /* of unacknowledged frames */
};
/* Returns the time at which the frame may begin, ms; a time up to now_ms means now; INFINITY =
 * after the next acknowledgement. One frame is always allowed, however large. */
double srv_congestion_opens_ms(const struct srv_congestion *window,
                               const struct srv_congestion_demand *demand, double now_ms);

/* Returns the measured round trip, ms; 0 = not known yet. */
double srv_congestion_rtt_ms(const struct srv_congestion *window);
/* Returns the rate of the link, bytes per ms; 0 = not known yet. */
double srv_congestion_rate(const struct srv_congestion *window);
/* Returns how many frames of the present size are on the way at once while frames are sent as fast
 * as the link and the granted rate allow, [1, SRV_CONGESTION_MAX]. */
unsigned srv_congestion_frames(const struct srv_congestion *window, int max_fps);

/* Returns when the oldest unacknowledged frame was sent, ms; 0 = there is none. */
double srv_congestion_oldest_ms(const struct srv_congestion *window);

#endif
