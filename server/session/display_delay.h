/* SPDX-License-Identifier: Apache-2.0
 *
 * How long a change of the view takes to the client's screen: from the update until the first frame
 * with it is acknowledged. The update arrives as late as the acknowledgement, so this is the time
 * from the hand to the image. Pure: no clock, no lock.
 */
#ifndef SRV_SESSION_DISPLAY_DELAY_H
#define SRV_SESSION_DISPLAY_DELAY_H

#include <stdint.h>

enum { SRV_DELAYED_FRAMES = 64 };

struct srv_display_delay { /* zeroed = nothing is known */
    struct {
        uint32_t frame;
        double updated_ms;
    } sent[SRV_DELAYED_FRAMES];
    double mean_ms; /* of the last frames; 0 = not known yet */
};

/* The frame that goes to the socket is the first one with an update that arrived at updated_ms. */
void srv_display_delay_sent(struct srv_display_delay *delay, uint32_t frame, double updated_ms);
/* The client acknowledged the frame. Frames that were not sent, or show no new update, are ignored.
 */
void srv_display_delay_acked(struct srv_display_delay *delay, uint32_t frame, double now_ms);

#endif
