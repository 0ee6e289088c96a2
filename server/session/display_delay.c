/* SPDX-License-Identifier: Apache-2.0 */
#include "session/display_delay.h"

#include <stdlib.h>
#include <string.h>

void srv_display_delay_sent(struct srv_display_delay *delay, uint32_t frame, double updated_ms) {
    delay->sent[frame % SRV_DELAYED_FRAMES].frame = frame;
    delay->sent[frame % SRV_DELAYED_FRAMES].updated_ms = updated_ms;
}

void srv_display_delay_acked(struct srv_display_delay *delay, uint32_t frame, double now_ms) {
    if (frame == 0 || delay->sent[frame % SRV_DELAYED_FRAMES].frame != frame)
        return;
    delay->sent[frame % SRV_DELAYED_FRAMES].frame = 0;
    delay->ms[delay->count++ % SRV_DELAY_SAMPLES] =
        now_ms - delay->sent[frame % SRV_DELAYED_FRAMES].updated_ms;
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double srv_display_delay_ms(const struct srv_display_delay *delay) {
    const unsigned count = delay->count < SRV_DELAY_SAMPLES ? delay->count : SRV_DELAY_SAMPLES;
    double sorted[SRV_DELAY_SAMPLES];
    memcpy(sorted, delay->ms, sizeof sorted);
    qsort(sorted, count, sizeof *sorted, compare);
    return count > 0 ? sorted[count / 2] : 0;
}
