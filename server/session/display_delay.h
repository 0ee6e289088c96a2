/* SPDX-License-Identifier: Apache-2.0
 *
 * How long a change of the view takes to the client's screen: from the update until the first frame
 * with it is acknowledged. The update arrives as late as the acknowledgement, so this is the time
 * from the hand to the image. Pure: no clock, no lock.
 */
#ifndef SRV_SESSION_DISPLAY_DELAY_H
#define SRV_SESSION_DISPLAY_DELAY_H

#include <stdint.h>

enum { SRV_DELAYED_FRAMES = 64, SRV_DELAY_SAMPLES = 5 };

struct srv_display_delay { /* zeroed = nothing is known */
    struct {
        uint32_t frame;
        double updated_ms;
    } sent[SRV_DELAYED_FRAMES];
    double ms[SRV_DELAY_SAMPLES]; /* of the last frames */
    unsigned count;               /* of all frames so far */
};

/* The frame that goes to the socket is the first one with an update that arrived at updated_ms. */
void srv_display_delay_sent(struct srv_display_delay *delay, uint32_t frame, double updated_ms);
/* The client acknowledged the frame. Does nothing for a frame without a new update. */
void srv_display_delay_acked(struct srv_display_delay *delay, uint32_t frame, double now_ms);
/* Returns the median of the last frames, so that a pause of the client does not count; 0 = not
 * known yet. */
double srv_display_delay_ms(const struct srv_display_delay *delay);

#endif
