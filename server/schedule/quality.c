/* SPDX-License-Identifier: Apache-2.0 */
#include "schedule/quality.h"

#include <math.h>
#include <string.h>

#include "schedule/error_model.h"

#define DECAY 0.8        /* weight of the past with each new frame */
#define SLOW 2.0         /* times the expected time: the load rose for a moment, or for good */
#define FAST (2 / 3.)    /* of the expected time: the load fell */
#define RAISE 0.75       /* of the budget: detail comes back */
#define RAISE_MOVING 0.9 /* the same, of the longest time */
#define INDIFFERENT 0.05 /* part of the error that is not worth a change */
#define TRUST 0.2        /* in the ratio of a new line, as a power */
#define SAME_SIZE 0.05   /* part of the pixels */
#define NEAR_SIZE 0.35   /* the change from frame to frame: the model tells the time */
#define EXPLODES 1.2     /* times the limit: the side falls at once */
#define GUESS 9.0        /* load_log of a guess from another view */
#define DOUBT_STEP 0.02
#define DOUBT_MAX 0.5
#define SPREAD 0.2            /* of sizes, for a line: sum of squares of (size / mean - 1) */
#define PIXELLESS 2.0         /* fixed time over time of the pixels, if nothing is known */
#define FADE 0.01             /* how much each frame lowers the weight of older ratios */
#define DRAFT_TIME 0.5        /* of the whole frame's, if only the draft's is known */
#define INTERMEDIATE_TIME 0.8 /* of the sharp frame's: else it gains nothing */
#define INTERMEDIATE_SIDE 1.5 /* times the side of the displayed frame, at least */
#define NEXT_LEVEL 0.25       /* of the time, where mip levels come first */
/* Times the limit: sides below SIDE_MIN, so that each view gets 10 frames/s. */
#define LAST_RESORT 2.0
#define LEAST_MPX 0.00411 /* no frame is smaller for the sake of time */
#define FIRST_MPX 0.27    /* of a first frame, whose time is not known */
enum { SIDE_CHANGE = 8 }; /* the side changes by at most 1 / SIDE_CHANGE of itself */
enum { SIDES = 128, SIDE_STEP = 4, SIDE_MIN = 32, FAILURES_MAX = 5 };
enum { WHOLE = 0, DRAFT = 1 }; /* grades; a draft at mip level n is DRAFT + n */
enum { SIDE_SHARED = 80 }; /* frames of several moving views get as small before they get fewer */

struct model { /* time = fixed + slope · megapixels, ms; both >= 0 */
    double fixed, slope;
    double guessed_mpx; /* the ratio is a guess from frames of this size; 0 = it is known */
};

void srv_quality_init(struct srv_quality *quality) {
    memset(quality, 0, sizeof *quality);
}

void srv_quality_init_from(struct srv_quality *quality, const struct srv_quality *other) {
    srv_quality_init(quality);
    quality->ignores_drafts = other->ignores_drafts;
    for (unsigned grade = 0; grade < SRV_GRADES; grade++) {
        const struct srv_quality_fit *fit = &other->fits[grade];
        quality->fits[grade] = (struct srv_quality_fit){ .weight = fit->weight,
                                                         .x = fit->x,
                                                         .y = fit->y,
                                                         .xx = fit->xx,
                                                         .xy = fit->xy,
                                                         .ratio = fit->ratio,
                                                         .last_mpx = fit->last_mpx,
                                                         .load_log = GUESS };
    }
}

static unsigned mip_level_of(unsigned grade) {
    return grade > DRAFT ? grade - DRAFT : 0;
}

static unsigned grade_of(const struct srv_detail *detail) {
    return detail->is_draft || detail->mip_level > 0 ? DRAFT + detail->mip_level : WHOLE;
}

/* Returns the index of the grade's fit. */
static unsigned fit_of(const struct srv_quality *quality, unsigned grade) {
    return grade == DRAFT && quality->ignores_drafts ? WHOLE : grade;
}

static double megapixels(const uint32_t size[2]) {
    return (double)size[0] * size[1] * 1e-6;
}

/* Fits a line if the sizes of the frames differ enough: else noise would decide. */
static bool fit_line(const struct srv_quality_fit *fit, struct model *model) {
    double mean_x = fit->x / fit->weight, mean_y = fit->y / fit->weight;
    double variance = fit->xx / fit->weight - mean_x * mean_x;
    double covariance = fit->xy / fit->weight - mean_x * mean_y;
    if (fit->weight * variance <= SPREAD * mean_x * mean_x || covariance <= 0)
        return false;
    model->slope = covariance / variance;
    model->fixed = mean_y - model->slope * mean_x;
    if (model->fixed < 0) {
        model->fixed = 0;
        model->slope = mean_y / mean_x;
    }
    return true;
}

/* Returns fixed / per_px of a fit as last seen, or derives it from another one: footprints cover
 * the frame alike, and each mip level has an eighth of the voxels. 0 = no grade had several
 * sizes. */
static double ratio_of(const struct srv_quality *quality, unsigned index) {
    if (quality->fits[index].ratio > 0)
        return quality->fits[index].ratio;
    for (unsigned other = 0; other < SRV_GRADES; other++)
        if (quality->fits[other].ratio > 0)
            return ldexp(quality->fits[other].ratio,
                         3 * ((int)mip_level_of(other) - (int)mip_level_of(index)));
    return 0;
}

/* Returns the model of a fit that has frames: the mean of the last ones, with the ratio that many
 * frames gave. If no ratio is known, a third of the time is assumed to be for the pixels. */
static struct model model_of_drawn(const struct srv_quality *quality, unsigned index) {
    const struct srv_quality_fit *fit = &quality->fits[index];
    struct model model;
    double mean_x = fit->x / fit->weight, mean_y = fit->y / fit->weight;
    double ratio = ratio_of(quality, index);
    model.slope = mean_y / (mean_x + (ratio > 0 ? ratio : PIXELLESS * mean_x));
    model.fixed = mean_y - model.slope * mean_x;
    model.guessed_mpx = ratio > 0 ? 0 : mean_x;
    return model;
}

static bool is_known(const struct srv_quality *quality, unsigned grade) {
    return quality->fits[fit_of(quality, grade)].weight > 0;
}

/* A draft that was never drawn takes as long as the whole frame. A mip level that was never drawn
 * takes an eighth of the next finer one's fixed time, or a quarter of all its time where mip levels
 * come first. All 0: unknown. */
static struct model model_of(const struct srv_quality *quality, unsigned grade) {
    struct model model = { 0, 0, 0 };
    unsigned known = grade + 1;
    while (known > 0 && !is_known(quality, known - 1))
        known--;
    if (known == 0 && (grade != WHOLE || !is_known(quality, DRAFT)))
        return model;
    if (known == 0) {
        model = model_of_drawn(quality, DRAFT);
        return (struct model){ model.fixed / DRAFT_TIME, model.slope / DRAFT_TIME,
                               model.guessed_mpx };
    }
    model = model_of_drawn(quality, fit_of(quality, known - 1));
    for (unsigned level = mip_level_of(known - 1); level < mip_level_of(grade); level++) {
        model.fixed *= quality->prefers_levels ? NEXT_LEVEL : 1 / 8.0;
        model.slope *= quality->prefers_levels ? NEXT_LEVEL : 1;
    }
    return model;
}

static double time_of(const struct model *model, double mpx) {
    return model->fixed + model->slope * mpx;
}

/* The same while the camera moves. If the ratio is a guess, smaller frames are tried before coarser
 * mip levels: they are assumed to take a time in proportion. */
static double moving_time_of(const struct model *model, double mpx) {
    return mpx < model->guessed_mpx ? time_of(model, model->guessed_mpx) * mpx / model->guessed_mpx
                                    : time_of(model, mpx);
}

double srv_quality_expected_ms(const struct srv_quality *quality, const struct srv_detail *detail) {
    struct model model = model_of(quality, grade_of(detail));
    return time_of(&model, megapixels(detail->size));
}

static void scale(const uint32_t full[2], unsigned side, uint32_t size[2]) {
    for (int i = 0; i < 2; i++)
        size[i] = (uint32_t)fmax(round(full[i] * (double)side / SIDES), 1);
}

static double mpx_of(const uint32_t full[2], unsigned side) {
    uint32_t size[2];
    scale(full, side, size);
    return megapixels(size);
}

struct choice {
    unsigned grade, side;
};

static struct srv_detail detail_of(struct choice choice, const uint32_t full[2]) {
    struct srv_detail detail = { .mip_level = mip_level_of(choice.grade),
                                 .is_draft = choice.grade != WHOLE };
    scale(full, choice.side, detail.size);
    return detail;
}

static bool is_finer(struct choice a, struct choice b) {
    return a.grade < b.grade || (a.grade == b.grade && a.side > b.side);
}

/* Returns the part of a grade's expected time that is believed; doubt counts at mip levels below
 * that of `doubted`. */
static double confidence_of(const struct srv_quality *quality, unsigned grade, unsigned doubted) {
    return mip_level_of(grade) < mip_level_of(doubted)
               ? 1 - quality->fits[fit_of(quality, grade)].doubt
               : 1;
}

/* Halves the side while the frame takes far longer than limit_ms and a smaller one saves time. */
static unsigned last_resort(const struct model *model, const uint32_t full[2], double useful,
                            double limit_ms) {
    unsigned side = SIDE_MIN;
    while (side > 1 && time_of(model, mpx_of(full, side)) > limit_ms * LAST_RESORT &&
           mpx_of(full, side) > fmax(useful, LEAST_MPX))
        side -= (side + 3) / 4;
    return side;
}

struct limits {
    unsigned grade;   /* the finest one that is taken */
    double ms;        /* of the expected time */
    unsigned largest; /* side of the largest frame, unless smaller ones take as long */
    unsigned doubted; /* grade in use (confidence_of) */
};

/* Returns the finest choice that is expected within the limits, else the coarsest that is
 * useful. */
static struct choice finest(const struct srv_quality *quality, const uint32_t full[2],
                            const struct limits *limits) {
    for (unsigned grade = limits->grade;; grade++) {
        bool last = grade == SRV_GRADES - 1;
        struct model model = model_of(quality, grade);
        double confidence = confidence_of(quality, grade, limits->doubted);
        double useful = model.slope > 0 ? model.fixed / model.slope / 4 : INFINITY;
        const unsigned least = quality->prefers_levels && !last ? SIDES : SIDE_MIN;
        unsigned side = SIDES;
        while (side > limits->largest && side > least && mpx_of(full, side) > useful)
            side -= SIDE_STEP;
        if (grade == WHOLE && side < SIDES)
            continue;
        for (;; side -= SIDE_STEP) {
            const double mpx = mpx_of(full, side);
            if (time_of(&model, mpx) * confidence <= limits->ms)
                return (struct choice){ grade, side };
            if (side == least || mpx <= useful || grade == WHOLE)
                break;
        }
        if (last && side == SIDE_MIN)
            side = last_resort(&model, full, useful, limits->ms);
        if (last)
            return (struct choice){ grade, side };
    }
}

/* Returns the expected error of a choice whose frames take `ms`. */
static double error_of(const struct srv_quality *quality, const struct srv_quality_budget *budget,
                       struct choice choice, double ms) {
    const unsigned mip_level = mip_level_of(choice.grade);
    const double interval_ms = fmax(ms / budget->part, budget->least_ms);
    const bool is_draft = choice.grade != WHOLE && !quality->ignores_drafts;
    return srv_error_of_width((double)SIDES / choice.side, mip_level, budget->voxel_px) +
           (is_draft ? SRV_ERROR_DRAFT : 0) + budget->error_per_ms * interval_ms;
}

struct best {
    struct choice choice; /* side 0 = none is within the limit */
    double error;
};

static double longest_of(const struct srv_quality_budget *budget, unsigned side) {
    return side <= SIDE_SHARED ? fmax(budget->longest_ms, budget->most_ms) : budget->longest_ms;
}

/* True if frames that take `ms` are within the limit. To be finer than now takes more. */
static bool is_within(const struct srv_quality *quality, const struct srv_quality_budget *budget,
                      struct choice choice, double ms) {
    const struct choice now = { quality->grade, quality->side };
    const double raise = now.side > 0 && is_finer(choice, now) ? RAISE_MOVING : 1;
    return ms <= longest_of(budget, choice.side) * raise;
}

/* Adds the frames of a grade whose side is in [least, SIDES]. */
static void add_grade(const struct srv_quality *quality, const uint32_t full[2],
                      const struct srv_quality_budget *budget, unsigned grade, unsigned least,
                      struct best *best) {
    const struct model model = model_of(quality, grade);
    const double confidence = confidence_of(quality, grade, quality->side ? quality->grade : WHOLE);
    for (unsigned side = SIDES; side >= least; side -= SIDE_STEP) {
        const struct choice choice = { grade, side };
        const double ms = moving_time_of(&model, mpx_of(full, side)) * confidence;
        const double error = error_of(quality, budget, choice, ms);
        const bool is_less = best->choice.side == 0 || error < best->error;
        if (is_less && is_within(quality, budget, choice, ms))
            *best = (struct best){ choice, error };
    }
}

/* Returns the least side of drafts of a grade: for clients that warp the largest one within the
 * limit, up to SRV_QUALITY_SIDE_WARPED. So the side falls smoothly where the time gets short. */
static unsigned least_side(const struct srv_quality *quality, const uint32_t full[2],
                           const struct srv_quality_budget *budget, unsigned grade) {
    const struct model model = model_of(quality, grade);
    const double confidence = confidence_of(quality, grade, quality->side ? quality->grade : WHOLE);
    unsigned side = budget->warps ? SRV_QUALITY_SIDE_WARPED : SIDE_MIN;
    while (side > SIDE_MIN && !is_within(quality, budget, (struct choice){ grade, side },
                                         moving_time_of(&model, mpx_of(full, side)) * confidence))
        side -= SIDE_STEP;
    return side;
}

/* Returns the choice of the least error while the camera moves. */
static struct best least_error(const struct srv_quality *quality, const uint32_t full[2],
                               const struct srv_quality_budget *budget) {
    struct best best = { .choice.side = 0 };
    const struct model whole = model_of(quality, WHOLE);
    const bool is_whole = quality->side == SIDES && quality->grade == WHOLE;
    if (time_of(&whole, mpx_of(full, SIDES)) <=
        fmin(budget->ms, SRV_QUALITY_BUDGET_MS * budget->part) * (is_whole ? 1 : RAISE))
        return (struct best){ { WHOLE, SIDES }, 0 };
    add_grade(quality, full, budget, WHOLE, SIDES, &best);
    for (unsigned grade = DRAFT; grade < SRV_GRADES; grade++)
        if (grade == DRAFT || !budget->warps || best.choice.side == 0)
            add_grade(quality, full, budget, grade, least_side(quality, full, budget, grade),
                      &best);
    return best;
}

/* Returns what is in use if it is within the limit and hardly worse than the best. */
static struct choice keep(const struct srv_quality *quality, const uint32_t full[2],
                          const struct srv_quality_budget *budget, const struct best *best) {
    const struct choice now = { quality->grade, quality->side };
    if (best->choice.grade == WHOLE ||
        now.side < least_side(quality, full, budget, now.grade > DRAFT ? now.grade : DRAFT))
        return best->choice;
    const struct srv_detail detail = detail_of(now, full);
    const double ms = srv_quality_expected_ms(quality, &detail);
    const bool is_good = error_of(quality, budget, now, ms) <= best->error * (1 + INDIFFERENT);
    return ms <= longest_of(budget, now.side) && is_good ? now : best->choice;
}

/* Returns the next choice on the way from what is in use to `best`. */
static struct choice approach(const struct srv_quality *quality, const uint32_t full[2],
                              struct choice best, double limit_ms) {
    const struct choice now = { quality->grade, quality->side };
    const bool is_smooth = quality->is_settled && now.side >= SIDE_MIN && best.side >= SIDE_MIN &&
                           mip_level_of(now.grade) == mip_level_of(best.grade);
    const unsigned step = now.side / SIDE_CHANGE / SIDE_STEP * SIDE_STEP;
    const unsigned most = now.side + (step > SIDE_STEP ? step : SIDE_STEP);
    const unsigned least = now.side - (step > SIDE_STEP ? step : SIDE_STEP);
    if (!is_smooth || (best.side <= most && best.side >= least))
        return best;
    struct choice next = best;
    next.side = best.side > most ? most : least;
    if (next.side < SIDES && next.grade == WHOLE)
        next.grade = DRAFT;
    const struct srv_detail detail = detail_of(next, full);
    return srv_quality_expected_ms(quality, &detail) > EXPLODES * limit_ms ? best : next;
}

/* The detail of a frame whose time is not known: half the side, or less if that is large. */
static struct choice first_choice(const struct srv_quality *quality, const uint32_t full[2]) {
    struct choice first = { DRAFT, SIDES / 2 };
    if (quality->prefers_levels)
        return (struct choice){ SRV_GRADES - 1, SIDES };
    while (first.side > 1 && mpx_of(full, first.side) > FIRST_MPX)
        first.side /= 2;
    return first;
}

/* A frame is large although its rate falls, because smaller ones seem to take as long. That may
 * have been so at another time: forgets it, so that a smaller frame is tried now and then. */
static void forget_ratio(struct srv_quality_fit *fit) {
    if (fit->ratio > 0)
        fit->ratio *= pow(PIXELLESS * fit->x / fit->weight / fit->ratio, FADE);
}

/* Chooses by the time alone, and returns the limit. */
static double choose_by_time(struct srv_quality *quality, const uint32_t full[2],
                             const struct srv_quality_budget *budget, struct choice *chosen) {
    const struct choice now = { quality->grade, quality->side }, small = { DRAFT, SIDE_SHARED };
    const unsigned doubted = now.side ? now.grade : WHOLE;
    double budget_ms = budget->ms, now_ms = budget->ms;
    struct choice best =
        finest(quality, full, &(struct limits){ WHOLE, budget_ms * RAISE, SIDES, doubted });
    if (budget->most_ms > budget_ms && is_finer(small, best)) {
        budget_ms = budget->most_ms;
        best = finest(quality, full,
                      &(struct limits){ WHOLE, budget_ms * RAISE, SIDE_SHARED, doubted });
    }
    if (!is_finer(now, small))
        now_ms = budget_ms;
    if (now.side) {
        const struct srv_detail detail = detail_of(now, full);
        if (srv_quality_expected_ms(quality, &detail) <= now_ms && !is_finer(best, now))
            best = now;
    }
    if (budget_ms > budget->ms && is_finer(best, small))
        forget_ratio(&quality->fits[fit_of(quality, best.grade)]);
    *chosen = best;
    return budget_ms;
}

double srv_quality_moving(struct srv_quality *quality, const uint32_t full[2],
                          const struct srv_quality_budget *budget, struct srv_detail *detail) {
    struct choice choice = first_choice(quality, full);
    double budget_ms = budget->ms;
    const bool is_timed = is_known(quality, WHOLE) || is_known(quality, DRAFT);
    if (is_timed) {
        struct best best = { .choice.side = 0 };
        if (budget->moves && !quality->prefers_levels)
            best = least_error(quality, full, budget);
        if (best.choice.side > 0) {
            choice = keep(quality, full, budget, &best);
            budget_ms = longest_of(budget, choice.side);
        } else
            budget_ms = choose_by_time(quality, full, budget, &choice);
        choice = approach(quality, full, choice, budget_ms);
    }
    quality->is_settled = is_timed;
    quality->grade = choice.grade;
    quality->side = choice.side;
    *detail = detail_of(choice, full);
    if (budget->moves) /* a frame that takes twice as long as it should is cancelled */
        budget_ms = fmin(budget_ms, fmax(budget->ms, srv_quality_expected_ms(quality, detail)));
    return budget_ms;
}

double srv_quality_moving_ms(const struct srv_quality *quality, const uint32_t full[2],
                             const struct srv_quality_budget *budget) {
    struct srv_quality next = *quality;
    struct srv_detail detail;
    srv_quality_moving(&next, full, budget, &detail);
    return srv_quality_expected_ms(quality, &detail) *
           confidence_of(quality, grade_of(&detail), quality->side ? quality->grade : WHOLE);
}

bool srv_quality_intermediate(const struct srv_quality *quality, const uint32_t full[2],
                              const uint32_t most[2], const struct srv_detail *displayed,
                              struct srv_detail *detail) {
    struct srv_detail sharp = { .size = { full[0], full[1] } };
    double sharp_ms = srv_quality_expected_ms(quality, &sharp);
    if (sharp_ms <= SRV_QUALITY_INTERMEDIATE_MS)
        return false;
    const unsigned was = displayed->mip_level;
    const double most_ms = fmax(SRV_QUALITY_INTERMEDIATE_MS, sharp_ms / 4);
    *detail =
        detail_of(finest(quality, full, &(struct limits){ DRAFT, most_ms, SIDES, WHOLE }), full);
    for (int i = 0; i < 2; i++)
        detail->size[i] = detail->size[i] < most[i] ? detail->size[i] : most[i];
    const double ms = srv_quality_expected_ms(quality, detail);
    if (ms > INTERMEDIATE_TIME * sharp_ms)
        return false;
    return detail->mip_level < was ||
           (detail->mip_level == was && detail->size[0] >= INTERMEDIATE_SIDE * displayed->size[0]);
}

static void decay(struct srv_quality_fit *fit, double factor) {
    fit->weight *= factor;
    fit->x *= factor;
    fit->y *= factor;
    fit->xx *= factor;
    fit->xy *= factor;
}

/* True if the last frame had nearly this size. */
static bool is_near(const struct srv_quality_fit *fit, double mpx, double part) {
    return fit->weight > 0 && fabs(mpx - fit->last_mpx) <= part * mpx;
}

/* Returns the weight of the past after a frame that took *ms; expected_ms 0 = nothing to compare
 * with. Limits the effect of a single slow frame. */
static double decay_of(struct srv_quality_fit *fit, double expected_ms, double *ms) {
    double load = fabs(fit->load_log);
    bool slow = expected_ms > 0 && *ms > SLOW * expected_ms;
    bool believed = slow ? fit->was_slow : *ms < FAST * expected_ms;
    fit->load_log = 0;
    fit->was_slow = slow;
    if (believed || load > log(SLOW))
        return 0;
    if (slow)
        *ms = SLOW * expected_ms;
    return DECAY;
}

static void add(struct srv_quality_fit *fit, double mpx, double expected_ms, double ms) {
    decay(fit, decay_of(fit, expected_ms, &ms));
    fit->last_mpx = mpx;
    fit->weight += 1;
    fit->x += mpx;
    fit->y += ms;
    fit->xx += mpx * mpx;
    fit->xy += mpx * ms;
    struct model model;
    if (!fit_line(fit, &model))
        return;
    /* A load that changes with the size, for example because a frame was late and the next one is
     * smaller, bends a single line. */
    const double ratio = fmax(model.fixed / model.slope, 1e-6), was = fit->ratio;
    fit->ratio = was > 0 ? was * pow(ratio / was, TRUST) : ratio;
}

/* Adds a frame. If the last one had the same size, a difference in time is load, not an error of
 * the model, and applies to the other fits. */
static void learn(struct srv_quality *quality, unsigned index, double mpx, double ms) {
    struct srv_quality_fit *fit = &quality->fits[index];
    double was = 0;
    const bool is_same = is_near(fit, mpx, SAME_SIZE);
    if (is_near(fit, mpx, NEAR_SIZE)) {
        struct model before = model_of_drawn(quality, index);
        was = time_of(&before, mpx);
    }
    add(fit, mpx, was, ms);
    struct model after = model_of_drawn(quality, index);
    double is = time_of(&after, mpx);
    if (!is_same || was <= 0 || is <= 0)
        return;
    double load = fmin(is / was, 4);
    for (unsigned other = 0; other < SRV_GRADES; other++)
        if (other != index) {
            quality->fits[other].y *= load;
            quality->fits[other].xy *= load;
            quality->fits[other].load_log += log(load);
        }
}

/* The time is known now: ends its doubt or trial. */
static void judge(struct srv_quality_fit *fit, bool is_over_budget) {
    fit->on_trial = fit->on_trial || fit->doubt > 0;
    fit->doubt = 0;
    if (!is_over_budget || !fit->on_trial)
        return;
    fit->on_trial = false;
    fit->failures += fit->failures < FAILURES_MAX;
}

void srv_quality_drafts(struct srv_quality *quality, bool are_drawn) {
    if (quality->ignores_drafts != are_drawn)
        return;
    quality->ignores_drafts = !are_drawn;
    for (unsigned grade = DRAFT; grade < SRV_GRADES; grade++) {
        quality->fits[grade].load_log = GUESS; /* the times are those of other frames */
        quality->fits[grade].last_mpx = 0;
    }
}

void srv_quality_done(struct srv_quality *quality, const struct srv_detail *drawn, bool moving,
                      double budget_ms, double ms) {
    const unsigned index = fit_of(quality, grade_of(drawn));
    learn(quality, index, megapixels(drawn->size), ms);
    judge(&quality->fits[index], moving && ms > budget_ms);
    for (unsigned finer = 0; moving && finer < drawn->mip_level; finer++) {
        struct srv_quality_fit *f = &quality->fits[fit_of(quality, DRAFT + finer)];
        f->doubt = fmin(f->doubt + DOUBT_STEP / (1u << f->failures), DOUBT_MAX);
    }
}

void srv_quality_cancelled(struct srv_quality *quality, const struct srv_detail *drawn, double ms) {
    const unsigned index = fit_of(quality, grade_of(drawn));
    struct srv_quality_fit *fit = &quality->fits[index];
    if (ms <= srv_quality_expected_ms(quality, drawn))
        return;
    fit->was_slow = true; /* believe it, as the second slow frame in a row */
    learn(quality, index, megapixels(drawn->size), ms);
    judge(fit, true);
}

/* A draft never takes longer than the whole frame, which was drawn since. */
static void limit_drafts(struct srv_quality *quality, const uint32_t full[2]) {
    struct srv_quality_fit *fit = &quality->fits[DRAFT];
    if (fit->weight == 0 || quality->fits[WHOLE].weight == 0)
        return;
    const struct model draft = model_of(quality, DRAFT), whole = model_of(quality, WHOLE);
    const double ratio =
        time_of(&whole, mpx_of(full, SIDES)) / time_of(&draft, mpx_of(full, SIDES));
    if (ratio < 1) {
        fit->y *= ratio;
        fit->xy *= ratio;
    }
}

void srv_quality_rest(struct srv_quality *quality, const uint32_t full[2]) {
    limit_drafts(quality, full);
    for (unsigned grade = 0; grade < SRV_GRADES; grade++) {
        struct srv_quality_fit *fit = &quality->fits[grade];
        const struct srv_detail whole = detail_of((struct choice){ grade, SIDES }, full);
        fit->failures = 0;
        quality->is_settled = false;
        if (grade > DRAFT && !quality->prefers_levels &&
            srv_quality_expected_ms(quality, &whole) > SRV_QUALITY_BUDGET_MS * RAISE)
            *fit = (struct srv_quality_fit){ .ratio = fit->ratio };
    }
}
