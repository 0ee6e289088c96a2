/* SPDX-License-Identifier: Apache-2.0
 *
 * Collects the candidates of the sessions, for decide.h, and remembers what the decision changes:
 * virtual clocks and how long refinements waited.
 */
#include <assert.h>
#include <math.h>

#include "schedule/state.h"

#define POLL_MS 1.0           /* at least, until the network is asked again whether it is free */
#define FIRST_BURST_MS 2500.0 /* a fifth of it is half a second of first frames */
#define EARLY_PORTION 0.5     /* of an interval: a participant may share a frame so early */
enum { SLOW_JOBS_ALONE = 2 }; /* of the only participant: one is drawn, one encoded */

/* Returns when the participant's next frame may begin; INFINITY = after the next event. */
static double opens_ms(const struct srv_schedule *schedule, const struct srv_session *s,
                       const struct srv_participant *p, double now_ms) {
    const struct srv_delivery *d = &p->delivery;
    if (srv_policy_video(p) != SP_VIDEO_CODEC_COUNT && d->outbox.blob)
        return INFINITY; /* a newer frame must not replace a video frame that waits */
    const struct srv_congestion_demand demand = {
        .waiting = p->schedule->jobs + (d->outbox.blob ? 1 : 0),
        .lead_ms = fmin(s->stats.render_ms + s->stats.encode_ms, SRV_QUALITY_ROUND_MS),
        .max_fps = p->settings.max_fps,
        .bytes_max = schedule->hub->options.stream_bytes,
    };
    double at_ms = srv_congestion_opens_ms(&d->congestion_window, &demand, now_ms);
    return at_ms > now_ms ? fmax(at_ms, now_ms + POLL_MS) : at_ms;
}

/* Would the participant take a frame when its network is free, at opens_ms? */
static bool wants_frame(const struct srv_session *s, const struct srv_participant *p,
                        double opens_ms) {
    const struct srv_participant_schedule *plan = p->schedule;
    bool has_all = plan->newest.version >= s->shared.version && plan->newest.step == SRV_STEP_FINAL;
    return !has_all && plan->failed_version != s->shared.version && opens_ms < INFINITY;
}

static bool is_newer(const struct srv_session *s, const struct srv_participant *p) {
    return p->schedule->newest.version < s->shared.version;
}

/* The newest frame is ahead of a hand that moved no further. */
static bool is_ahead(const struct srv_session *s, const struct srv_participant *p) {
    return p->schedule->newest.is_ahead && !is_newer(s, p);
}

/* Expected time of a sharp frame; 0 = not known. */
static double sharp_ms(const struct srv_session *s, const struct srv_participant *p) {
    struct srv_detail sharp = { .mip_level = 0 };
    srv_hub_size(s, p, sharp.size);
    return srv_quality_expected_ms(&s->schedule->quality, &sharp);
}

bool srv_intermediate(const struct srv_session *s, const struct srv_participant *p,
                      struct srv_detail *detail) {
    uint32_t full[2], most[2];
    srv_hub_size(s, p, full);
    srv_rate_control_size(&p->delivery.rate_control, full, most);
    return srv_quality_intermediate(&s->schedule->quality, full, most, &p->schedule->newest.detail,
                                    detail);
}

static bool needs_intermediate(const struct srv_schedule *schedule, const struct srv_session *s,
                               const struct srv_participant *p) {
    struct srv_detail detail;
    const struct srv_newest_job *newest = &p->schedule->newest;
    return p->settings.progressive && newest->version > 0 && newest->step == SRV_STEP_MOVING &&
           !srv_skips_intermediate(schedule, p) && srv_intermediate(s, p, &detail);
}

/* Would the frame of this step be slow to encode? The last moving frame tells the size of the next
 * one, or else the size that is tried first. */
static bool is_slow(const struct srv_session *s, const struct srv_participant *p,
                    enum srv_frame_step step) {
    const struct srv_encoding encoding = srv_policy_encoding(p, step);
    const struct srv_moving_detail *moving = &p->policy.moving;
    uint32_t size[2];
    srv_hub_size(s, p, size);
    if (step == SRV_STEP_MOVING)
        for (int i = 0; i < 2; i++)
            size[i] = moving->full_size[i] == size[i] ? moving->size[i] : size[i] / 2;
    return srv_encoding_expected_ms(&encoding, size) > SRV_SLOW_ENCODE_MS;
}

static bool has_slow_slot(const struct srv_schedule *schedule, const struct srv_session *s) {
    unsigned most = schedule->hub->participants.count == 1 ? SLOW_JOBS_ALONE : 1;
    return s->schedule->slow_jobs < most && schedule->slow_jobs < SRV_SLOW_ENCODE_JOBS;
}

static double waited_ms(const struct srv_waiting *waiting, double now_ms) {
    return waiting->waited_ms + (waiting->ready_ms > 0 ? now_ms - waiting->ready_ms : 0);
}

/* True if the participant has no frame yet, and first frames have not used up their part of the
 * time: a fifth, with bursts of half a second. Else it is served like all others. */
static bool is_first(const struct srv_schedule *schedule, const struct srv_participant *p,
                     double now_ms) {
    return p->delivery.frames_sent == 0 && p->schedule->newest.version == 0 &&
           schedule->first_ms <= now_ms + FIRST_BURST_MS;
}

double srv_settles_at_ms(const struct srv_schedule *schedule, const struct srv_session *s) {
    return s->shared.changed_ms +
           srv_decide_settle_ms(s->schedule->gap_ms, schedule->hub->options.rest_ms);
}

static struct srv_demand demand_of(const struct srv_schedule *schedule, const struct srv_session *s,
                                   const struct srv_participant *p, double now_ms) {
    const struct srv_participant_schedule *plan = p->schedule;
    struct srv_demand demand = { .opens_ms = opens_ms(schedule, s, p, now_ms) };
    /* Without moving detail each frame would be final. */
    demand.wants_frame =
        wants_frame(s, p, demand.opens_ms) && (p->settings.progressive || !s->shared.is_waiting);
    if (!demand.wants_frame)
        return demand;
    demand.is_first = is_first(schedule, p, now_ms);
    demand.is_ahead = is_ahead(s, p);
    demand.is_newer = is_newer(s, p) || demand.is_ahead;
    demand.is_progressive = p->settings.progressive;
    demand.needs_intermediate = needs_intermediate(schedule, s, p);
    for (int step = 0; step < SRV_STEPS; step++)
        demand.is_slow[step] = is_slow(s, p, (enum srv_frame_step)step);
    demand.has_slow_slot = has_slow_slot(schedule, s);
    demand.max_fps = p->settings.max_fps;
    demand.next_frame_ms = plan->next_frame_ms;
    demand.rest_at_ms = srv_play_moves(s) || s->shared.is_waiting
                            ? INFINITY
                            : s->shared.changed_ms + schedule->hub->options.rest_ms;
    demand.settles_at_ms = demand.rest_at_ms < INFINITY ? srv_settles_at_ms(schedule, s) : INFINITY;
    demand.behind_ms = demand.is_ahead ? demand.settles_at_ms : plan->behind_ms;
    demand.is_alone = schedule->hub->participants.count == 1 && !s->schedule->must_finish;
    demand.has_frame = plan->newest.version > 0 && plan->newest.step == SRV_STEP_MOVING;
    demand.sharp_ms = sharp_ms(s, p);
    demand.waited_ms = waited_ms(&plan->waiting, now_ms);
    demand.spent_ms = plan->waiting.spent_ms;
    return demand;
}

/* The frame that a participant requests now. */
static struct srv_frame_request request_of(const struct srv_schedule *schedule,
                                           const struct srv_session *s,
                                           const struct srv_participant *p, double now_ms) {
    const struct srv_demand demand = demand_of(schedule, s, p, now_ms);
    return srv_decide_request(&demand, now_ms);
}

struct srv_frame_request srv_request_to_share(const struct srv_schedule *schedule,
                                              const struct srv_session *s,
                                              const struct srv_participant *p, double now_ms) {
    struct srv_demand demand = demand_of(schedule, s, p, now_ms);
    double early_ms = EARLY_PORTION * 1000.0 / p->settings.max_fps;
    demand.next_frame_ms -= early_ms;
    demand.opens_ms -= early_ms;
    return srv_decide_request(&demand, now_ms);
}

/* The starvation limit counts only time in which the refinement could have been drawn: not while
 * the window is closed, the frame rate is used up, or another frame is in progress. */
static void note_waiting(struct srv_waiting *waiting, const struct srv_frame_request *request,
                         double now_ms) {
    bool waits = request->is_wanted && request->protected_ms < INFINITY;
    if (waits)
        waiting->waited_ms = waited_ms(waiting, now_ms);
    waiting->ready_ms = waits ? now_ms : 0;
}

static bool moves_soon(const struct srv_schedule *schedule, const struct srv_session *s,
                       const struct srv_participant *p) {
    if (!p->settings.progressive || !is_newer(s, p))
        return false;
    double at_ms = opens_ms(schedule, s, p, schedule->now_ms);
    return wants_frame(s, p, at_ms) &&
           fmax(p->schedule->next_frame_ms, at_ms) - schedule->now_ms <= SRV_QUIET_MS;
}

bool srv_has_motion(const struct srv_schedule *schedule) {
    for (const struct srv_session *s = schedule->busy; s; s = s->schedule->next_busy)
        for (const struct srv_participant *p = s->participants; p; p = p->next)
            if (moves_soon(schedule, s, p))
                return true;
    return false;
}

/* Does nothing but an event change what is wanted of the session? */
static bool is_at_rest(const struct srv_schedule *schedule, const struct srv_session *s,
                       double now_ms) {
    const struct srv_session_schedule *plan = s->schedule;
    bool rests =
        plan->jobs == 0 && (plan->moved_ms == 0 || now_ms - plan->moved_ms >= SRV_MOVING_MS);
    rests = rests && !srv_play_is_on(s);
    for (const struct srv_participant *p = s->participants; p && rests; p = p->next)
        rests = !wants_frame(s, p, opens_ms(schedule, s, p, now_ms));
    return rests;
}

/* Removes the sessions from the list that want nothing until the next event. */
static void let_rest(struct srv_schedule *schedule, double now_ms) {
    for (struct srv_session *s = schedule->busy, *next; s; s = next) {
        next = s->schedule->next_busy;
        if (!is_at_rest(schedule, s, now_ms))
            continue;
        srv_schedule_rest(schedule, s);
        for (struct srv_participant *p = s->participants; p; p = p->next)
            p->schedule->waiting.ready_ms = 0;
    }
}

/* A session that asks for moving frames and does not take them gets none. */
static bool gets_moving_frames(const struct srv_session *s, double now_ms) {
    const double moved_ms = s->schedule->moved_ms;
    return moved_ms > 0 && now_ms - moved_ms < SRV_MOVING_MS;
}

static bool gets_frames(const struct srv_session *s, double now_ms) {
    const struct srv_session_schedule *plan = s->schedule;
    return plan->jobs > 0 || plan->wants_frame || gets_moving_frames(s, now_ms);
}

/* Counts the sessions that get frames now, their owners, and the sessions of each owner (struct
 * srv_schedule). */
static void count_owners(struct srv_schedule *schedule, double now_ms) {
    schedule->sharing = 0;
    schedule->owners = 0;
    for (struct srv_session *s = schedule->busy; s; s = s->schedule->next_busy) {
        unsigned others = 0;
        for (const struct srv_session *t = schedule->busy; t; t = t->schedule->next_busy) {
            const bool is_sibling = t != s && t->schedule->owner == s->schedule->owner;
            others += is_sibling && gets_frames(t, now_ms);
        }
        s->schedule->siblings = 1 + others;
        schedule->sharing += gets_frames(s, now_ms);
        schedule->owners += gets_frames(s, now_ms) ? 1.0 / (1 + others) : 0;
    }
}

/* The counted owners, with the owner of a session that may not be counted itself. */
static double owners_with(double owners, unsigned siblings, bool is_counted) {
    return fmax(1, round(owners + (siblings <= 1 && !is_counted)));
}

double srv_session_price(const struct srv_schedule *schedule, const struct srv_session *s) {
    const bool is_counted = gets_frames(s, schedule->now_ms);
    const unsigned siblings = s->schedule->siblings, all = schedule->sharing + !is_counted;
    return fmax(1, siblings) * owners_with(schedule->owners, siblings, is_counted) / fmax(1, all);
}

bool srv_session_warps(const struct srv_session *s) {
    if (s->holder && s->holder->settings.progressive)
        return s->holder->settings.depth;
    for (const struct srv_participant *p = s->participants; p; p = p->next)
        if (p->settings.progressive && !p->settings.depth)
            return false;
    return true;
}

/* Returns the height of a voxel at the camera's target, in px of a full image of this height; 0 =
 * not known. */
static double voxel_px(const struct srv_schedule *schedule, const struct srv_session *s,
                       uint32_t height) {
    const struct srv_volume_source *source = &schedule->hub->options.volumes;
    const double shown = srv_motion_height(&s->shared.view.camera);
    return source->spacing && shown > 0
               ? source->spacing(source->user, s->shared.displayed) * height / shown
               : 0;
}

struct srv_quality_budget srv_moving_budget(const struct srv_schedule *schedule,
                                            const struct srv_participant *p, int max_fps) {
    const struct srv_session *s = p->session;
    const double now_ms = schedule->now_ms;
    const unsigned siblings = s->schedule->siblings;
    const double owners = owners_with(schedule->owners, siblings, gets_frames(s, now_ms));
    const double own = srv_participant_portion(s, p) / (owners * fmax(1, siblings));
    const double others = srv_fair_used_portion(&schedule->use, now_ms) -
                          srv_fair_used_portion(&p->schedule->use, now_ms);
    struct srv_quality_budget budget =
        srv_quality_budget(max_fps, srv_session_warps(s), fmin(fmax(1 - others, own), 1));
    uint32_t full[2];
    struct srv_speed speed;
    srv_hub_size(s, p, full);
    if (srv_motion_speed(&s->schedule->motion, now_ms, &speed) && !srv_play_moves(s))
        srv_quality_budget_moves(&budget, &speed, full[1], voxel_px(schedule, s, full[1]));
    return budget;
}

/* Expected time of the next frame of a moving view, with its detail; 0 = not known. */
static double moving_frame_ms(const struct srv_schedule *schedule, const struct srv_session *s,
                              const struct srv_participant *p) {
    const struct srv_quality_budget budget = srv_moving_budget(schedule, p, p->settings.max_fps);
    uint32_t full[2];
    srv_hub_size(s, p, full);
    return srv_quality_moving_ms(&s->schedule->quality, full, &budget);
}

/* Expected time of what the participant gets; INFINITY = not known, or it begins with work that is
 * done once. Whoever joins gets its first frame at once, which is small: it counts as short. */
static double expected_ms(const struct srv_schedule *schedule, const struct srv_choice *choice) {
    const struct srv_session *s = choice->participant->session;
    if (choice->request.rank == SRV_RANK_FIRST)
        return SRV_QUALITY_ROUND_MS;
    double ms = choice->request.step == SRV_STEP_MOVING
                    ? moving_frame_ms(schedule, s, choice->participant)
                    : sharp_ms(s, choice->participant);
    return s->schedule->start.done >= s->schedule->start.cold && ms > 0 ? ms : INFINITY;
}

/* A participant that waits for the running job itself does not preempt it. */
static bool may_preempt(const struct srv_schedule *schedule, const struct srv_choice *choice,
                        const struct srv_running_job *running) {
    return choice->request.protected_ms == INFINITY &&
           choice->participant->schedule->newest.order != running->order &&
           srv_decide_is_short(expected_ms(schedule, choice), running->expected_ms,
                               running->drawn_ms);
}

/* Chooses the participant of a session. If `running` is not NULL, only among participants that may
 * preempt it. When all are idle the session's clock moves on to the last end. */
static bool choose_participant(struct srv_schedule *schedule, struct srv_session *s, double now_ms,
                               const struct srv_running_job *running, struct srv_choice *choice,
                               struct srv_candidate *candidate, double *wait_ms) {
    struct srv_candidate candidates[SRV_PARTICIPANTS_MAX];
    struct srv_choice choices[SRV_PARTICIPANTS_MAX];
    struct srv_session_schedule *plan = s->schedule;
    double in_ms = INFINITY, last_ms = plan->clock_ms;
    bool is_idle = plan->jobs == 0;
    int count = 0;
    for (struct srv_participant *p = s->participants; p; p = p->next) {
        struct srv_choice c = { p, request_of(schedule, s, p, now_ms) };
        double start_ms = srv_fair_start(&p->schedule->account, plan->clock_ms);
        in_ms = fmin(in_ms, c.request.in_ms);
        last_ms = fmax(last_ms, start_ms);
        note_waiting(&p->schedule->waiting, &c.request, now_ms);
        is_idle = is_idle && !c.request.is_wanted;
        if (!c.request.is_wanted || (running && !may_preempt(schedule, &c, running)))
            continue;
        candidates[count] = (struct srv_candidate){ .rank = c.request.rank,
                                                    .deadline_ms = c.request.deadline_ms,
                                                    .start_ms = start_ms,
                                                    .newest_order = p->schedule->newest.order };
        choices[count++] = c;
    }
    if (is_idle && in_ms == INFINITY)
        plan->clock_ms = last_ms;
    *wait_ms = fmin(*wait_ms, in_ms);
    int chosen = srv_decide_participant(candidates, count);
    if (chosen == SRV_NO_CANDIDATE)
        return false;
    *choice = choices[chosen];
    *candidate = candidates[chosen];
    candidate->newest_order = plan->newest_order;
    return true;
}

/* Returns the newest moving frame of another view; also of its own for a participant that wants
 * final frames only. 0 = none. */
static double last_motion_ms(const struct srv_schedule *schedule, const struct srv_participant *p) {
    double last_ms = 0;
    for (const struct srv_session *s = schedule->busy; s; s = s->schedule->next_busy)
        if (s != p->session || !p->settings.progressive)
            last_ms = fmax(last_ms, s->schedule->moved_ms);
    return last_ms;
}

/* Collects the best candidate of each busy session. When all are idle the clock moves on to the
 * last end. */
static int collect(struct srv_schedule *schedule, double now_ms, double *wait_ms) {
    double in_ms = INFINITY, last_ms = fmax(schedule->clock_ms, schedule->rested_ms);
    bool is_idle = true;
    int count = 0;
    for (struct srv_session *s = schedule->busy; s; s = s->schedule->next_busy) {
        struct srv_candidate *candidate = &schedule->candidates[count];
        assert((unsigned)count < schedule->hub->options.sessions_max);
        is_idle = is_idle && s->schedule->jobs == 0;
        last_ms = fmax(last_ms, s->schedule->account.end_ms);
        s->schedule->wants_frame = choose_participant(schedule, s, now_ms, NULL,
                                                      &schedule->choices[count], candidate, &in_ms);
        if (!s->schedule->wants_frame)
            continue;
        candidate->start_ms = srv_fair_start(&s->schedule->account, schedule->clock_ms);
        count++;
    }
    if (count == 0 && is_idle && in_ms == INFINITY)
        schedule->clock_ms = last_ms;
    *wait_ms = fmin(*wait_ms, in_ms);
    return count;
}

struct srv_choice srv_choose(struct srv_schedule *schedule, double now_ms, double *wait_ms) {
    const struct srv_choice none = { .participant = NULL };
    schedule->now_ms = now_ms;
    let_rest(schedule, now_ms);
    int count = collect(schedule, now_ms, wait_ms);
    count_owners(schedule, now_ms);
    const struct srv_decision decision =
        srv_decide_session(schedule->candidates, count, schedule->clock_ms);
    schedule->clock_ms = decision.clock_ms;
    if (decision.chosen == SRV_NO_CANDIDATE)
        return none;
    const struct srv_choice choice = schedule->choices[decision.chosen];
    if (choice.request.rank != SRV_RANK_REFINEMENT)
        return choice;
    double quiet_ms = srv_decide_quiet_ms(srv_has_motion(schedule),
                                          last_motion_ms(schedule, choice.participant), now_ms);
    if (quiet_ms <= 0)
        return choice;
    *wait_ms = fmin(*wait_ms, quiet_ms);
    return none;
}

/* A first frame is drawn at once, even if its session is in debt: sessions that are behind it do
 * not preempt it as long as it takes no longer than expected. */
static bool is_first_in_time(const struct srv_running_job *running) {
    return running->is_first && isfinite(running->expected_ms) &&
           running->drawn_ms < running->expected_ms;
}

struct srv_choice srv_choose_short(struct srv_schedule *schedule,
                                   const struct srv_running_job *running, double now_ms,
                                   double *wait_ms) {
    int count = 0;
    schedule->now_ms = now_ms;
    count_owners(schedule, now_ms);
    if (is_first_in_time(running))
        return (struct srv_choice){ .participant = NULL };
    for (struct srv_session *s = schedule->busy; s; s = s->schedule->next_busy) {
        struct srv_candidate *candidate = &schedule->candidates[count];
        if (!choose_participant(schedule, s, now_ms, running, &schedule->choices[count], candidate,
                                wait_ms))
            continue;
        bool is_own = s->identity.number == running->session;
        double start_ms = is_own ? candidate->start_ms
                                 : srv_fair_start(&s->schedule->account, schedule->clock_ms);
        const double reached_ms = is_own ? running->participant_start_ms + running->drawn_ms
                                         : running->start_ms + running->drawn_ms * running->price;
        candidate->lead_ms = start_ms - reached_ms;
        if (candidate->rank == SRV_RANK_FIRST)
            candidate->lead_ms = 0;
        count++;
    }
    int chosen = srv_decide_preemption(schedule->candidates, count, wait_ms);
    return chosen == SRV_NO_CANDIDATE ? (struct srv_choice){ .participant = NULL }
                                      : schedule->choices[chosen];
}
