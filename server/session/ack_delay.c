/* SPDX-License-Identifier: Apache-2.0 */
#include "session/ack_delay.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#define POINTS_MS 2000.0
#define DELAY_MS 4000.0
#define LARGER 1.5    /* times the bytes: less says little about the slope */
#define ALIKE 0.9     /* of the bytes: the quicker one counts */
#define JITTER_MS 2.0 /* a shorter time is none */
enum { FRAMES_MIN = 4 };

/* Drops what is old. */
static void renew(struct srv_ack_delay *delay, double now_ms) {
    const double age_ms = now_ms - delay->points_ms;
    if (age_ms > POINTS_MS) {
        const bool is_gap = age_ms > 2 * POINTS_MS;
        delay->quickest[1] = is_gap ? (struct srv_ack_point){ 0, 0 } : delay->quickest[0];
        delay->largest[1] = is_gap ? (struct srv_ack_point){ 0, 0 } : delay->largest[0];
        delay->frames[1] = is_gap ? 0 : delay->frames[0];
        delay->quickest[0] = delay->largest[0] = (struct srv_ack_point){ 0, 0 };
        delay->frames[0] = 0;
        delay->points_ms = now_ms;
    }
}

static struct srv_ack_point quicker(struct srv_ack_point a, struct srv_ack_point b) {
    return a.bytes == 0 || (b.bytes > 0 && b.ms < a.ms) ? b : a;
}

static struct srv_ack_point larger(struct srv_ack_point a, struct srv_ack_point b) {
    const bool is_alike = fmin(a.bytes, b.bytes) > ALIKE * fmax(a.bytes, b.bytes);
    return is_alike ? quicker(a, b) : a.bytes > b.bytes ? a : b;
}

/* Keeps the shortest delay of the current and the previous seconds. */
static void put(struct srv_ack_delay *delay, double ms, double now_ms) {
    if (now_ms - delay->delay_epoch_ms > DELAY_MS) {
        delay->delay_ms[1] = delay->delay_epoch_ms == 0 ? ms : delay->delay_ms[0];
        delay->delay_ms[0] = ms;
        delay->delay_epoch_ms = now_ms;
    }
    delay->delay_ms[0] = fmin(delay->delay_ms[0], ms);
}

static bool is_same(struct srv_ack_point a, struct srv_ack_point b) {
    return a.bytes == b.bytes && a.ms == b.ms;
}

double srv_ack_delay_add(struct srv_ack_delay *delay, double bytes, double ms, double now_ms) {
    const struct srv_ack_point point = { bytes, ms };
    renew(delay, now_ms);
    delay->frames[0]++;
    delay->quickest[0] = quicker(delay->quickest[0], point);
    delay->largest[0] = larger(delay->largest[0], point);
    const struct srv_ack_point quick = quicker(delay->quickest[0], delay->quickest[1]);
    const struct srv_ack_point large = larger(delay->largest[0], delay->largest[1]);
    if (delay->frames[0] + delay->frames[1] < FRAMES_MIN || large.bytes < LARGER * quick.bytes)
        return 0;
    const double more = large.bytes - quick.bytes, longer_ms = fmax(large.ms - quick.ms, 0);
    put(delay, fmax(quick.ms - quick.bytes * longer_ms / more, 0), now_ms);
    return is_same(point, quick) || is_same(point, large) ? more / fmax(longer_ms, JITTER_MS) : 0;
}

void srv_ack_delay_limit(struct srv_ack_delay *delay, double ms) {
    for (int i = 0; i < 2; i++)
        delay->delay_ms[i] = fmin(delay->delay_ms[i], fmax(ms, 0));
}

double srv_ack_delay_ms(const struct srv_ack_delay *delay) {
    return fmin(delay->delay_ms[0], delay->delay_ms[1]);
}
