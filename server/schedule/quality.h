/* SPDX-License-Identifier: Apache-2.0
 *
 * The quality controller: how much detail a frame of a moving view has, so that it keeps up with
 * the user, and which frames precede the sharp one when the view rests. Pure: no clock, no lock.
 */
#ifndef SRV_SCHEDULE_QUALITY_H
#define SRV_SCHEDULE_QUALITY_H

#include <stdbool.h>
#include <stdint.h>

#include "schedule/motion.h"
#include "session/encode_params.h"
#include "sp/renderer.h"

/* Detail is not reduced to be faster than 30 frames per second. */
#define SRV_QUALITY_BUDGET_MS (1000.0 / 30)
/* While several views move, their frame rate falls before the side of a frame falls below five
 * eighths, until one frame of each view together takes longer than this. */
#define SRV_QUALITY_ROUND_MS (1000.0 / 15)
/* Least side for clients that warp, in 128ths of the full one: people see coarse pixels more than
 * the mean square error says. */
enum { SRV_QUALITY_SIDE_WARPED = 92 };
/* An intermediate frame precedes a sharp frame that takes longer than this. It takes as long
 * itself, or a quarter of the time of the sharp frame if that is more. */
#define SRV_QUALITY_INTERMEDIATE_MS 150.0

struct srv_detail { /* of a frame */
    unsigned mip_level;
    uint32_t size[2];
    bool is_draft; /* asked for (sp_render_options.draft) */
};

/* Grades of frames by the work that they take: 0 = whole at mip level 0; 1 + n = a draft at mip
 * level n. Moving frames that are not as sharp as the view at rest are drafts. */
enum { SRV_GRADES = SP_MIP_LEVEL_MAX + 2 };

struct srv_quality_fit {         /* of one grade */
    double weight, x, y, xx, xy; /* weighted sums over (megapixels, ms); weight 0 = unknown */
    double ratio;                /* fixed / per_px as last seen, megapixels; 0 = not yet */
    double last_mpx;             /* size of the last frame */
    bool was_slow;               /* the last frame took more than twice the expected time */
    double load_log;             /* natural logarithm of the load that other levels showed since */
    double doubt;                /* part of the expected time that is not believed, [0, 0.5] */
    bool on_trial;               /* it is being tried again */
    unsigned failures;           /* trials that ended over the budget since the view rested */
};
/* The model:  time of a frame ≈ fixed + per_px · pixels       for each grade
 *
 * Grade 0 is the whole frame, grade n a draft at mip level n − 1.
 *
 * Exponentially weighted least squares fit both to the last frames of a grade. The fixed part, the
 * work per voxel, does not shrink with the frame: below pixels = fixed / per_px / 4 a smaller frame
 * gains nothing, and a higher mip level must help. Above it a smaller frame is closer to the sharp
 * one than a higher mip level of the same cost (6 to 10 dB on CT scans).
 *
 *   finest ────────────────────────────────────────────────────────► coarsest
 *   (0, 8/8)  (1, 8/8) (1, 7/8) … (1, 2/8)  (2, 8/8) … (2, 2/8)  (3, 8/8) … (3, 2/8) (grade, side)
 *                                             and then (3, 3/16) (3, 9/64) … down to 64 x 64 px
 *
 * A draft whose time is not known takes as long as a whole frame. Where the renderer ignores that
 * drafts are asked for, both are one grade, of the same times: frames of mip level 0.
 *
 * The last steps are for views so heavy that they would get less than ten frames per second: no
 * view may take that rate from other views. The time of the first frame is not known, so it has
 * half the side, or less if half the side gives more than a quarter of a megapixel.
 *
 * While the camera moves, the choice has the least expected error (error_model.h) of all whose time
 * is within the longest that is allowed. A whole frame of full size that fits the frame rate is
 * always taken. Clients that warp get at least SRV_QUALITY_SIDE_WARPED of the side where the time
 * allows it.
 *
 * For other changes of the view, detail is reduced when a frame is expected to exceed the budget.
 *
 * Detail comes back when the finer frame is expected within three quarters of the budget, or nine
 * tenths of the longest time while the camera moves, so that it does not flicker. At one mip level
 * the side changes by at most an eighth from frame to frame, unless a frame is expected to take
 * more than 1.2 times the limit, the view rested, or nothing was known. A choice whose error is a
 * little larger than the least is kept.
 *
 * The load of the machine changes. It shows in frames of the same level and size:
 *   - A frame that takes more than twice the expected time counts as twice. The second one in a row
 *     is believed, and the earlier frames are dropped.
 *   - A frame that is a third faster than expected is believed at once: nothing makes work faster
 *     than it is.
 *   - A change of one level's time changes the times of all levels.
 *   - A finer level that was too slow is doubted a little more with each frame drawn without it,
 *     until it is tried again. Each trial that is too slow doubles the time to the next one.
 *     A level that is twice too slow is not tried. */
struct srv_quality {
    struct srv_quality_fit fits[SRV_GRADES];
    unsigned grade, side; /* in use while moving; side in 128ths of the full one, 0 = none yet */
    bool ignores_drafts;  /* the last frame that was asked for as a draft was whole */
    bool is_settled;      /* the side follows from known times, and changes smoothly */
    /* Set by the caller: mip levels come before smaller frames, from the first frame on. They merge
     * points in the image, so that one of full size is sharper than a smaller frame of as many
     * points, and takes as long. */
    bool prefers_levels;
};

void srv_quality_init(struct srv_quality *quality);
/* As init, with the frame times of another view of the same volume as a guess, which the first
 * frame of each grade outweighs. */
void srv_quality_init_from(struct srv_quality *quality, const struct srv_quality *other);

/* Returns the time from one frame of a moving view to the next, if it is alone. `warps`: all
 * clients that get the frames warp them (SRV_WARP_INTERVAL_MS). */
double srv_quality_interval_ms(int max_fps, bool warps);

struct srv_quality_budget { /* how long a frame of a moving view may take */
    double ms;              /* so that its rate stays */
    double most_ms;         /* if it has at most five eighths of the side for that */
    bool warps;             /* the client that moves the view warps frames */
    double part;            /* of the time that the view gets, (0, 1] */
    double least_ms;        /* shorter frames are not shown more often */
    /* Set by srv_quality_budget_moves(): */
    bool moves;          /* the camera moves */
    double longest_ms;   /* how long a frame may take, whatever its size */
    double error_per_ms; /* that is added by each millisecond between frames */
    double voxel_px;     /* as in error_model.h */
};
/* Returns the budget of a view that gets `part` of the time, in (0, 1]. */
struct srv_quality_budget srv_quality_budget(int max_fps, bool warps, double part);
/* The camera moves with this speed; `height` of the full image, px. A view that is alone may have
 * frames of up to SRV_QUALITY_ROUND_MS, or SRV_WARP_INTERVAL_MS if clients warp. */
void srv_quality_budget_moves(struct srv_quality_budget *budget, const struct srv_speed *speed,
                              uint32_t height, double voxel_px);

/* Chooses the detail of the next frame of a moving view. Returns how long it may take, in ms: what
 * of the budget applies. */
double srv_quality_moving(struct srv_quality *quality, const uint32_t full[2],
                          const struct srv_quality_budget *budget, struct srv_detail *detail);

/* Returns the expected time of that frame; 0 = not known yet. */
double srv_quality_moving_ms(const struct srv_quality *quality, const uint32_t full[2],
                             const struct srv_quality_budget *budget);

/* Chooses an intermediate frame of at most `most` px a side for a view that does not move, after
 * `displayed`. It is a draft that takes at most SRV_QUALITY_INTERMEDIATE_MS, or a quarter of the
 * time of the sharp frame if that is more. False: none is worth it. */
bool srv_quality_intermediate(const struct srv_quality *quality, const uint32_t full[2],
                              const uint32_t most[2], const struct srv_detail *displayed,
                              struct srv_detail *detail);

/* Returns the expected time of a frame; 0 = not known yet. */
double srv_quality_expected_ms(const struct srv_quality *quality, const struct srv_detail *detail);

/* A frame was asked for as a draft: was it one? Call it before srv_quality_done(). */
void srv_quality_drafts(struct srv_quality *quality, bool are_drawn);
/* A frame took `ms` (render and encode); `moving`: chosen by srv_quality_moving(),
 * which returned budget_ms. */
void srv_quality_done(struct srv_quality *quality, const struct srv_detail *drawn, bool moving,
                      double budget_ms, double ms);

/* A frame was cancelled after `ms`. */
void srv_quality_cancelled(struct srv_quality *quality, const struct srv_detail *drawn, double ms);

/* Call it when the view rests. Drops the measured times of high mip levels that seem too slow, so
 * that the next motion tries these levels again. */
void srv_quality_rest(struct srv_quality *quality, const uint32_t full[2]);

#endif
