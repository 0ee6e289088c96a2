/* SPDX-License-Identifier: Apache-2.0
 *
 * How large a frame may be while the view moves, so that the rate holds.
 *
 *   time of a frame ≈ fixed + per_px · pixels
 *
 * Both are fitted to the last frames by exponentially weighted least squares. The fixed part (work
 * a voxel) does not shrink with the picture, so making it ever smaller gains nothing: below pixels
 * = fixed / per_px / 4 the picture stops shrinking, and coarser voxels (srv_pace_level) must help.
 * Pure: no clock, no lock.
 */
#ifndef SRV_SESSION_PACE_H
#define SRV_SESSION_PACE_H

#include <stdint.h>

#include "sp/renderer.h"

struct srv_pace {
    double weight, x, y, xx, xy; /* weighted sums over (pixels, ms) */
    double doubt; /* of what was measured, the longer ago the more: [0, SRV_PACE_DOUBT_MAX] */
};
#define SRV_PACE_DOUBT_MAX 0.5

#define SRV_PACE_AREA_MIN (1.0 / 16) /* of the full picture */
#define SRV_PACE_ENOUGH_MS 66.0      /* 15 a second: no detail is given up to be faster than this */

void srv_pace_init(struct srv_pace *pace);

/* A frame of `pixels` took `ms` (render and encode). */
void srv_pace_add(struct srv_pace *pace, double pixels, double ms);

/* Expected time of a frame; 0 = nothing known yet. */
double srv_pace_expect_ms(const struct srv_pace *pace, double pixels);

/* Writes the size to render at while moving: `full` scaled by one factor with area in
 * [SRV_PACE_AREA_MIN, 1] so that a frame takes `budget_ms`; at least 1×1. */
void srv_pace_size(const struct srv_pace *pace, const uint32_t full[2], double budget_ms,
                   uint32_t size[2]);

/* The same, with the choice of how coarse to draw (sp/renderer.h): the finest level that holds the
 * budget within a third or takes SRV_PACE_ENOUGH_MS, or that was never tried; else the coarsest.
 * One pace a level. */
unsigned srv_pace_level(const struct srv_pace levels[SP_COARSE_MAX + 1], const uint32_t full[2],
                        double budget_ms, uint32_t size[2]);

/* A frame was drawn at `level`: finer levels, which were too slow once, are doubted a little more,
 * so that one slow moment does not blur a long drag. A level twice too slow is not tried again. */
void srv_pace_drawn(struct srv_pace levels[SP_COARSE_MAX + 1], unsigned level);

/* The view rests: what coarse levels took is forgotten, the next move finds out anew. */
void srv_pace_rest(struct srv_pace levels[SP_COARSE_MAX + 1]);

#endif
