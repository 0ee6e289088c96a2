/* SPDX-License-Identifier: Apache-2.0
 *
 * How long a client waits before it acknowledges a frame that has arrived. Pure: no clock, no lock.
 *
 * The acknowledgement of a frame that finds the link free comes, beyond the round trip, after
 *
 *   ms ≈ delay + bytes / rate
 *
 * Frames of one size do not tell a busy client from a slow link; frames of two sizes do. The line
 * through the quickest frame and the largest one of the last seconds gives both. The quickest frame
 * waited least, so that the wait of the largest one makes the line steeper and the delay too short:
 * the delay is a lower bound, apart from jitter, and it is never longer than a frame took. The
 * shortest of the last seconds counts.
 */
#ifndef SRV_SESSION_ACK_DELAY_H
#define SRV_SESSION_ACK_DELAY_H

struct srv_ack_point { /* bytes 0 = none */
    double bytes, ms;
};

struct srv_ack_delay {                            /* all zero = nothing is known */
    struct srv_ack_point quickest[2], largest[2]; /* of this second or two, and of those before */
    unsigned frames[2];
    double points_ms; /* start of the current two seconds */
    double delay_ms[2];
    double delay_epoch_ms; /* start of the current four seconds */
};

/* A frame found the link free, and its acknowledgement came `ms` later than the round trip. Returns
 * the rate of the line if this frame gives another one, bytes per ms; 0 = it does not. */
double srv_ack_delay_add(struct srv_ack_delay *delay, double bytes, double ms, double now_ms);
/* A frame took `ms` beyond the round trip, whether or not the link was free. */
void srv_ack_delay_limit(struct srv_ack_delay *delay, double ms);
/* Returns the delay, ms; 0 = not known. */
double srv_ack_delay_ms(const struct srv_ack_delay *delay);

#endif
