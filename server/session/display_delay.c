/* SPDX-License-Identifier: Apache-2.0 */
#include "session/display_delay.h"

#define PART 0.25 /* of the newest frame in the mean */

void srv_display_delay_sent(struct srv_display_delay *delay, uint32_t frame, double updated_ms) {
    delay->sent[frame % SRV_DELAYED_FRAMES].frame = frame;
    delay->sent[frame % SRV_DELAYED_FRAMES].updated_ms = updated_ms;
}

void srv_display_delay_acked(struct srv_display_delay *delay, uint32_t frame, double now_ms) {
    if (frame == 0 || delay->sent[frame % SRV_DELAYED_FRAMES].frame != frame)
        return;
    const double ms = now_ms - delay->sent[frame % SRV_DELAYED_FRAMES].updated_ms;
    delay->sent[frame % SRV_DELAYED_FRAMES].frame = 0;
    delay->mean_ms += (ms - delay->mean_ms) * (delay->mean_ms > 0 ? PART : 1);
}
