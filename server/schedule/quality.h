/* SPDX-License-Identifier: Apache-2.0
 *
 * How much detail a frame may have while the view moves, so that it keeps up with the hand, and on
 * which steps the picture sharpens when the view rests.
 *
 *   time of a frame ≈ fixed + per_px · pixels          for each level of coarseness (sp/renderer.h)
 *
 * Both are fitted to the last frames of a level by exponentially weighted least squares. The fixed
 * part (work a voxel) does not shrink with the picture: below pixels = fixed / per_px / 4 a smaller
 * picture gains nothing, and coarser voxels must help.
 *
 *   finest ────────────────────────────────────────────────────────► coarsest
 *   (0, 8/8) (0, 7/8) … (0, 4/8)  (1, 8/8) … (1, 4/8)  (2, 8/8) … (2, 2/8)     (coarse, side)
 *
 * Detail is given up when a frame is expected to take longer than the budget, and comes back when
 * the finer frame is expected within three quarters of it, so that it does not flicker.
 *
 * Load of the machine comes and goes; it is told from frames of one level and size:
 *   - one frame that takes more than twice what was expected counts as twice; the second in a row
 *     is believed, and what was known before is forgotten;
 *   - a frame that is a third faster than expected is believed at once: nothing makes work faster
 *     than it is;
 *   - what slows or speeds one level does so to all;
 *   - a finer level that was too slow is doubted a little more with each frame drawn without it,
 *     until it is tried again; each time that it was too slow after all, that takes twice as long.
 *     One that is twice too slow is not tried.
 *
 * Pure: no clock, no lock.
 */
#ifndef SRV_SESSION_PACE_H
#define SRV_SESSION_PACE_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/renderer.h"

#define SRV_QUALITY_BUDGET_MIN_MS                                                                  \
    66.0 /* 15 a second: no detail is given up to be faster than this */
#define SRV_QUALITY_INTERMEDIATE_MS                                                                \
    250.0 /* a sharp picture that takes longer is led up to by another */

struct srv_detail { /* what a frame is drawn with */
    unsigned mip_level;
    uint32_t size[2];
};

struct srv_quality_fit {         /* of one level */
    double weight, x, y, xx, xy; /* weighted sums over (megapixels, ms); weight 0 = unknown */
    double ratio;                /* fixed / per_px as last seen, megapixels; 0 = not yet */
    double last_mpx;             /* of the last frame */
    bool was_slow;               /* it took more than twice what was expected */
    double load_log;             /* of the load that other levels told of since; e's power */
    double doubt;                /* share of the expected time that is not believed, [0, 0.5] */
    bool on_trial;               /* it is drawn because of doubt */
    unsigned failures;           /* trials that ended over the budget since the view rested */
};
struct srv_quality {
    struct srv_quality_fit fits[SP_MIP_LEVEL_MAX + 1];
    unsigned mip_level,
        side; /* in use while moving; side in eighths of the full one, 0 = none yet */
};

void srv_quality_init(struct srv_quality *pace);
/* As init, with what frames of another view of the same volume took as a guess: the first frame of
 * each level outweighs it. */
void srv_quality_init_from(struct srv_quality *pace, const struct srv_quality *other);

/* Longest that a frame should take while the view moves. */
double srv_quality_budget_ms(int max_fps);

/* Detail for the next frame of a moving view. */
void srv_quality_moving(struct srv_quality *pace, const uint32_t full[2], double budget_ms,
                        struct srv_detail *detail);

/* What that frame is believed to take; 0 = nothing known yet. */
double srv_quality_moving_ms(const struct srv_quality *pace, const uint32_t full[2],
                             double budget_ms);

/* The view rests and `shown` is on the screen: is there something worth showing before the sharp
 * picture? It takes at most a quarter as long. */
bool srv_quality_intermediate(const struct srv_quality *pace, const uint32_t full[2],
                              const struct srv_detail *shown, struct srv_detail *detail);

/* Expected time of a frame; 0 = nothing known yet. */
double srv_quality_expected_ms(const struct srv_quality *pace, const struct srv_detail *detail);

/* A frame took `ms` (render and encode); `moving`: chosen by srv_quality_moving() for budget_ms. */
void srv_quality_done(struct srv_quality *pace, const struct srv_detail *drawn, bool moving,
                      double budget_ms, double ms);

/* A frame was given up after `ms`. */
void srv_quality_cancelled(struct srv_quality *pace, const struct srv_detail *drawn, double ms);

/* The view rests: coarse levels that seem too slow are forgotten, the next move finds out anew. */
void srv_quality_rest(struct srv_quality *pace, const uint32_t full[2]);

#endif
