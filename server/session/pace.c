/* SPDX-License-Identifier: Apache-2.0 */
#include "session/pace.h"

#include <math.h>
#include <string.h>

#define FORGET 0.8 /* weight of the past against one new frame */

void srv_pace_init(struct srv_pace *pace) {
    memset(pace, 0, sizeof *pace);
}

void srv_pace_add(struct srv_pace *pace, double pixels, double ms) {
    double mpx = pixels * 1e-6;
    pace->weight = pace->weight * FORGET + 1;
    pace->x = pace->x * FORGET + mpx;
    pace->y = pace->y * FORGET + ms;
    pace->xx = pace->xx * FORGET + mpx * mpx;
    pace->xy = pace->xy * FORGET + mpx * ms;
    pace->doubt = 0;
}

/* fixed in ms, slope in ms a megapixel, both >= 0. */
static void fit(const struct srv_pace *pace, double *fixed, double *slope) {
    double mean_x = pace->x / pace->weight, mean_y = pace->y / pace->weight;
    double variance = pace->xx / pace->weight - mean_x * mean_x;
    double covariance = pace->xy / pace->weight - mean_x * mean_y;
    if (variance <= 1e-4 * mean_x * mean_x || covariance <= 0) {
        /* One size only, or noise: a third of the time for the pixels, until smaller pictures tell.
         */
        *slope = mean_x > 0 ? mean_y / mean_x / 3 : 0;
        *fixed = mean_y * 2 / 3;
        return;
    }
    *slope = covariance / variance;
    *fixed = mean_y - *slope * mean_x;
    if (*fixed < 0) {
        *fixed = 0;
        *slope = mean_y / mean_x;
    }
}

double srv_pace_expect_ms(const struct srv_pace *pace, double pixels) {
    if (pace->weight == 0)
        return 0;
    double fixed, slope;
    fit(pace, &fixed, &slope);
    return fixed + slope * pixels * 1e-6;
}

void srv_pace_size(const struct srv_pace *pace, const uint32_t full[2], double budget_ms,
                   uint32_t size[2]) {
    double pixels = (double)full[0] * full[1], area = 0.25; /* nothing known: half the side */
    if (pace->weight > 0) {
        double fixed, slope;
        fit(pace, &fixed, &slope);
        double affordable = slope > 0 ? (budget_ms - fixed) / slope * 1e6 : pixels;
        double useful = slope > 0 ? fixed / slope * 1e6 / 4 : pixels;
        area = fmax(affordable, useful) / pixels;
    }
    area = fmin(fmax(area, SRV_PACE_AREA_MIN), 1);
    /* Steps of an eighth of the side, so that the size does not flicker. */
    double side = area >= 0.95 ? 1 : fmax(floor(sqrt(area) * 8), 2) / 8;
    for (int i = 0; i < 2; i++)
        size[i] = (uint32_t)fmax(round(full[i] * side), 1);
}

unsigned srv_pace_level(const struct srv_pace levels[SP_COARSE_MAX + 1], const uint32_t full[2],
                        double budget_ms, uint32_t size[2]) {
    const uint32_t whole[2] = { full[0], full[1] };
    double limit_ms = fmax(budget_ms * 4 / 3, SRV_PACE_ENOUGH_MS);
    for (unsigned level = 0;; level++) {
        srv_pace_size(&levels[level], whole, budget_ms, size);
        double expected = srv_pace_expect_ms(&levels[level], (double)size[0] * size[1]) *
                          (1 - levels[level].doubt);
        if (level == SP_COARSE_MAX || expected <= limit_ms)
            return level;
    }
}

void srv_pace_drawn(struct srv_pace levels[SP_COARSE_MAX + 1], unsigned level) {
    for (unsigned finer = 0; finer < level; finer++)
        levels[finer].doubt = fmin(levels[finer].doubt + 0.02, SRV_PACE_DOUBT_MAX);
}

void srv_pace_rest(struct srv_pace levels[SP_COARSE_MAX + 1]) {
    for (unsigned level = 1; level <= SP_COARSE_MAX; level++)
        srv_pace_init(&levels[level]);
}
