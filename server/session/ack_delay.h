/* SPDX-License-Identifier: Apache-2.0
 *
 * How long a client waits before it acknowledges a frame that has arrived. Pure: no clock, no lock.
 *
 * If a frame finds the link free, its acknowledgement takes this much longer than the round trip:
 *
 *   ms ≈ delay + bytes / rate
 *
 * Frames of one size cannot distinguish a busy client from a slow link; frames of two sizes can.
 * The line through the quickest frame and the largest frame of the last seconds gives both the
 * delay and the rate. The quickest frame waited least. A wait of the largest frame therefore makes
 * the line steeper and the delay shorter, so the delay is a lower bound, apart from jitter. It is
 * never longer than the time of any frame. The shortest delay of the last seconds counts.
 */
#ifndef SRV_SESSION_ACK_DELAY_H
#define SRV_SESSION_ACK_DELAY_H

struct srv_ack_point { /* bytes 0 = none */
    double bytes, ms;
};

struct srv_ack_delay { /* all zero = nothing is known */
    /* in the current two seconds, and in the two seconds before */
    struct srv_ack_point quickest[2], largest[2];
    unsigned frames[2];
    double points_ms; /* start of the current two seconds */
    double delay_ms[2];
    double delay_epoch_ms; /* start of the current four seconds */
};

/* Adds a frame that found the link free. Its acknowledgement took `ms` longer than the round trip.
 * Returns the rate of the line, bytes per ms, if this frame changes the line; otherwise 0. */
double srv_ack_delay_add(struct srv_ack_delay *delay, double bytes, double ms, double now_ms);
/* Limits the delay: a frame took `ms` longer than the round trip, whether or not the link was
 * free. */
void srv_ack_delay_limit(struct srv_ack_delay *delay, double ms);
/* Returns the delay, ms; 0 = not known. */
double srv_ack_delay_ms(const struct srv_ack_delay *delay);

#endif
