/* SPDX-License-Identifier: Apache-2.0 */
#include "schedule/decide.h"

#include <math.h>

#include "common/fair_queue.h"
#include "schedule/quality.h"

#define FIRST_FRAME_MS 150.0 /* a first frame that takes longer has less detail at first */
#define SETTLE_MS 30.0       /* two updates of 60 per second, nearly */
#define SETTLE_GAPS 1.5      /* times the longest time between updates */
#define ROUNDING_MS 1e-6     /* of a mean of equal numbers */
#define SHORT_PORTION 0.1    /* of the work that it preempts */

/* True if the sharp frame is expected soon, so that no other frame has to precede it. */
static bool is_sharp_soon(const struct srv_demand *d) {
    return d->sharp_ms > 0 && d->sharp_ms <= FIRST_FRAME_MS;
}

/* Work that was cancelled takes twice the time that was spent on it at least. */
static double protected_ms(const struct srv_demand *d) {
    return srv_fair_protected_ms(d->waited_ms, fmax(d->sharp_ms, 2 * d->spent_ms));
}

static enum srv_frame_step step_of(const struct srv_demand *d, bool is_refinement) {
    if (!d->is_newer || (is_refinement && d->needs_intermediate))
        return d->needs_intermediate ? SRV_STEP_INTERMEDIATE : SRV_STEP_FINAL;
    return !d->is_progressive || is_refinement ? SRV_STEP_FINAL : SRV_STEP_MOVING;
}

double srv_decide_settle_ms(double gap_ms, double rest_ms) {
    return fmin(rest_ms, fmax(SETTLE_MS, SETTLE_GAPS * gap_ms));
}

/* Returns in how many ms the refinement may begin. */
static double refinement_in_ms(const struct srv_demand *d, double now_ms) {
    const double settles_ms = d->settles_at_ms - now_ms;
    return d->needs_intermediate ? settles_ms
                                 : fmax(d->rest_at_ms - d->sharp_ms - now_ms, settles_ms);
}

/* True if a better frame than a moving one is drawn of a view that has no frame yet. */
static bool skips_moving(const struct srv_demand *d, double now_ms) {
    if (now_ms < d->settles_at_ms)
        return false;
    if (d->needs_intermediate)
        return d->is_alone && !d->is_ahead;
    if (now_ms >= d->rest_at_ms)
        return is_sharp_soon(d);
    return d->is_alone && d->has_frame && d->sharp_ms <= SRV_SETTLED_SHARP_MS &&
           d->rest_at_ms - d->sharp_ms <= now_ms;
}

struct srv_frame_request srv_decide_request(const struct srv_demand *d, double now_ms) {
    struct srv_frame_request request = { .in_ms = INFINITY };
    if (!d->wants_frame)
        return request;
    double in_ms = fmax(d->next_frame_ms, d->opens_ms) - now_ms;
    if (d->is_ahead)
        in_ms = fmax(in_ms, d->settles_at_ms - now_ms);
    else if (!d->is_newer)
        in_ms = fmax(in_ms, refinement_in_ms(d, now_ms));
    if (in_ms > 0) {
        request.in_ms = in_ms;
        return request;
    }
    request.deadline_ms = fmax(d->next_frame_ms, d->behind_ms) + 1000.0 / d->max_fps;
    request.is_refinement = d->is_progressive && (!d->is_newer || skips_moving(d, now_ms));
    request.step = step_of(d, request.is_refinement);
    request.is_slow_to_encode = d->is_slow[request.step];
    request.is_wanted = !request.is_slow_to_encode || d->has_slow_slot;
    request.protected_ms = d->is_newer && d->is_progressive ? INFINITY : protected_ms(d);
    request.rank = request.protected_ms == 0 ? SRV_RANK_REFINEMENT : SRV_RANK_INTERACTION;
    if (d->is_first && request.protected_ms == INFINITY)
        request.rank = SRV_RANK_FIRST;
    return request;
}

static bool is_before_in_session(const struct srv_candidate *a, const struct srv_candidate *b) {
    if (a->rank != b->rank)
        return a->rank < b->rank;
    if (a->start_ms != b->start_ms)
        return a->start_ms < b->start_ms;
    return a->newest_order < b->newest_order;
}

int srv_decide_participant(const struct srv_candidate *candidates, int count) {
    int best = SRV_NO_CANDIDATE;
    for (int i = 0; i < count; i++)
        if (best == SRV_NO_CANDIDATE || is_before_in_session(&candidates[i], &candidates[best]))
            best = i;
    return best;
}

/* True if `a` goes before `b`; both are eligible. */
static bool is_due_before(const struct srv_candidate *a, const struct srv_candidate *b) {
    if (a->rank != SRV_RANK_REFINEMENT && a->deadline_ms != b->deadline_ms)
        return a->deadline_ms < b->deadline_ms;
    if (a->start_ms != b->start_ms)
        return a->start_ms < b->start_ms;
    return a->newest_order < b->newest_order;
}

static enum srv_rank highest_rank(const struct srv_candidate *candidates, int count) {
    enum srv_rank rank = SRV_RANKS;
    for (int i = 0; i < count; i++)
        rank = candidates[i].rank < rank ? candidates[i].rank : rank;
    return rank;
}

struct srv_decision srv_decide_session(const struct srv_candidate *candidates, int count,
                                       double clock_ms) {
    struct srv_decision decision = { .chosen = SRV_NO_CANDIDATE, .clock_ms = clock_ms };
    const enum srv_rank rank = highest_rank(candidates, count);
    double sum = 0, least = INFINITY, ranked = 0;
    for (int i = 0; i < count; i++) {
        if (candidates[i].rank <= SRV_RANK_INTERACTION || candidates[i].rank == rank)
            least = fmin(least, candidates[i].start_ms);
        if (candidates[i].rank == rank) {
            sum += candidates[i].start_ms;
            ranked++;
        }
    }
    if (ranked == 0)
        return decision;
    decision.clock_ms = fmax(clock_ms, least);
    for (int i = 0; i < count; i++) {
        bool is_eligible =
            candidates[i].rank == rank && candidates[i].start_ms <= sum / ranked + ROUNDING_MS;
        if (is_eligible && (decision.chosen == SRV_NO_CANDIDATE ||
                            is_due_before(&candidates[i], &candidates[decision.chosen])))
            decision.chosen = i;
    }
    return decision;
}

double srv_decide_quiet_ms(bool has_motion, double last_motion_ms, double now_ms) {
    double quiet_ms = has_motion ? SRV_QUIET_MS : 0;
    return last_motion_ms > 0 ? fmax(quiet_ms, last_motion_ms + SRV_QUIET_MS - now_ms) : quiet_ms;
}

bool srv_decide_is_short(double expected_ms, double running_ms, double drawn_ms) {
    double left_ms = running_ms > drawn_ms ? running_ms - drawn_ms : drawn_ms;
    double known_ms = isfinite(left_ms) ? left_ms : drawn_ms;
    return expected_ms <= fmin(left_ms, fmax(SRV_QUALITY_ROUND_MS, known_ms * SHORT_PORTION));
}

int srv_decide_preemption(const struct srv_candidate *candidates, int count, double *wait_ms) {
    int best = SRV_NO_CANDIDATE;
    for (int i = 0; i < count; i++) {
        if (candidates[i].lead_ms > 0)
            *wait_ms = fmin(*wait_ms, candidates[i].lead_ms);
        else if (best == SRV_NO_CANDIDATE || is_due_before(&candidates[i], &candidates[best]))
            best = i;
    }
    return best;
}

double srv_next_frame_ms(double next_ms, int max_fps, double now_ms) {
    const double interval_ms = 1000.0 / max_fps;
    return fmax(next_ms, now_ms - interval_ms) + interval_ms;
}
