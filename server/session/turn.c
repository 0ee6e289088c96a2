/* SPDX-License-Identifier: Apache-2.0
 *
 * Whose turn it is in the stream lane.
 *
 *   a participant wants a frame if        and gets it if
 *     the view is newer than its last job   its window is open (flow.h) and its rate allows it
 *     or the view rests and its last frame
 *     was not of final quality
 *
 * Interaction comes before refinement. Within a rank sessions have equal shares of render time, and
 * so have the participants of a session (share.h). A frame of a moving view is due by when the next
 * one is.
 *
 * Who wants nothing but final pictures gets refinements. A refinement gives way to whatever moves:
 * it is not begun while a view moves elsewhere, and given up when one does. When its patience is at
 * an end (share.h) it is as good as interaction, for a time.
 *
 * What is being drawn may take long and is not lost for that: it stands still for short frames of
 * sessions, and of other participants of its own, that have had less, as a preemptive server would
 * have it. So each has its share though another one's frames, each of which takes as much at once
 * as many of its own, never give way.
 *
 * Shares are of time that rendering and encoding take. An encode thread does not stand still for
 * anything: see SRV_SLOW_ENCODE_MS for what takes one for long. Who holds control of a session
 * counts for as much as all its other participants: however many look on, its view turns at half
 * the speed at worst.
 *
 * All that is done for a frame looks at busy sessions alone: those where somebody wants a picture,
 * or will by time. A session is busy from each event on that may change that (srv_hub_work()).
 */
#include <math.h>

#include "session/policy.h"

#define FIRST_PICTURE_MS 150.0 /* a first picture that takes longer is shown coarse first */
#define QUIET_MS 100.0         /* nothing moves: so long after the last moving frame */
#define ROUNDING_MS 1e-6       /* of a mean of equal numbers */
#define SHORT_PART 0.1         /* of what it goes before */
enum { DEAR_ALONE = 2 };       /* jobs of one who is alone: one is drawn, one encoded */

static bool is_open(const struct srv_hub *hub, const struct srv_participant *p) {
    unsigned waiting = p->pipeline + (p->outbox.blob ? 1 : 0);
    if (p->video != SP_VIDEO_CODEC_COUNT && p->outbox.blob)
        return false; /* a frame of video that waits must not be replaced */
    return srv_window_is_open(&p->flow, waiting, p->max_fps, hub->options.stream_bytes) &&
           p->flow.count + waiting < SRV_WINDOW_MAX;
}

/* What a view that rests gets next. */
static enum srv_frame_step next_step(const struct srv_session *s, const struct srv_participant *p) {
    struct srv_detail detail;
    uint32_t full[2];
    srv_hub_size(s, p, full);
    bool middle = p->progressive && p->taken_step == SRV_STEP_MOVING &&
                  srv_quality_intermediate(&s->pace, full, &p->taken_detail, &detail);
    return middle ? SRV_STEP_INTERMEDIATE : SRV_STEP_FINAL;
}

/* Of the sharp picture; 0 = not known. */
static double sharp_ms(const struct srv_session *s, const struct srv_participant *p) {
    struct srv_detail sharp = { .mip_level = 0 };
    srv_hub_size(s, p, sharp.size);
    return srv_quality_expected_ms(&s->pace, &sharp);
}

/* Is the sharp picture known to be there soon, so that nothing need be shown before it? */
static bool is_sharp_soon(const struct srv_session *s, const struct srv_participant *p) {
    double expected_ms = sharp_ms(s, p);
    return expected_ms > 0 && expected_ms <= FIRST_PICTURE_MS;
}

/* Wants a frame now or by the time, and gets it. */
static bool wants(const struct srv_hub *hub, const struct srv_session *s,
                  const struct srv_participant *p) {
    bool has_all = p->taken_version >= s->version && p->taken_step == SRV_STEP_FINAL;
    return !has_all && p->failed_version != s->version && is_open(hub, p);
}

/* Would what it gets next take long to encode? Of a moving view the last one tells its size, or
 * else what is tried first. */
static bool is_slow_to_encode(const struct srv_session *s, const struct srv_participant *p,
                              enum srv_frame_step step) {
    const struct srv_encoding encoding = srv_policy_encoding(p, step);
    uint32_t size[2];
    srv_hub_size(s, p, size);
    if (step == SRV_STEP_MOVING)
        for (int i = 0; i < 2; i++)
            size[i] = p->moving.full[i] == size[i] ? p->moving.detail.size[i] : size[i] / 2;
    return srv_policy_encode_ms(&encoding, size) > SRV_SLOW_ENCODE_MS;
}

static bool has_room_for_dear(const struct srv_hub *hub, const struct srv_session *s) {
    return s->dear < (hub->participant_count == 1 ? DEAR_ALONE : 1) &&
           hub->dear < SRV_SLOW_ENCODE_JOBS;
}

/* How long a refinement that can be drawn now has waited. */
static double waited_ms(const struct srv_participant *p, double now_ms) {
    return p->waited_ms + (p->ready_ms > 0 ? now_ms - p->ready_ms : 0);
}

/* Of a refinement. What was begun and gave way takes twice as long at least. */
static double yield_ms(const struct srv_session *s, const struct srv_participant *p,
                       double now_ms) {
    return srv_fair_protected_ms(waited_ms(p, now_ms), fmax(sharp_ms(s, p), 2 * p->spent_ms));
}

/* Patience is for who could have been drawn: while the window is closed, or the rate used up, or a
 * picture under way, nothing is waited for. */
static void note_waiting(struct srv_participant *p, const struct srv_frame_request *wish,
                         double now_ms) {
    bool waits = wish->wanted && wish->protected_ms < INFINITY;
    if (waits)
        p->waited_ms = waited_ms(p, now_ms);
    p->ready_ms = waits ? now_ms : 0;
}

struct srv_frame_request srv_turn_wish(const struct srv_hub *hub, const struct srv_session *s,
                                       const struct srv_participant *p, double now_ms) {
    struct srv_frame_request wish = { .in_ms = INFINITY };
    if (!wants(hub, s, p))
        return wish;
    bool newer = p->taken_version < s->version;
    double rate_ms = p->next_frame_ms - now_ms;
    double rest_ms = s->changed_ms + hub->options.rest_ms - now_ms;
    if (!newer)
        rate_ms = fmax(rate_ms, rest_ms);
    if (rate_ms > 0) {
        wish.in_ms = rate_ms;
        return wish;
    }
    wish.wanted = true;
    wish.deadline_ms = fmax(p->next_frame_ms, p->behind_ms) + 1000.0 / p->max_fps;
    wish.is_refinement = p->progressive && (!newer || (rest_ms <= 0 && is_sharp_soon(s, p)));
    if (!newer)
        wish.step = next_step(s, p);
    else
        wish.step = !p->progressive || wish.is_refinement ? SRV_STEP_FINAL : SRV_STEP_MOVING;
    wish.is_slow_to_encode = is_slow_to_encode(s, p, wish.step);
    if (wish.is_slow_to_encode && !has_room_for_dear(hub, s))
        wish.wanted = false;
    wish.protected_ms = newer && p->progressive ? INFINITY : yield_ms(s, p, now_ms);
    wish.rank = wish.protected_ms == 0 ? SRV_RANK_REFINEMENT : SRV_RANK_INTERACTION;
    return wish;
}

static bool moves(const struct srv_hub *hub, const struct srv_session *s) {
    for (const struct srv_participant *p = s->participants; p; p = p->next)
        if (p->progressive && p->taken_version < s->version && wants(hub, s, p) &&
            p->next_frame_ms - hub->now_ms <= QUIET_MS)
            return true;
    return false;
}

bool srv_turn_moves(const struct srv_hub *hub) {
    for (const struct srv_session *s = hub->busy; s; s = s->next_busy)
        if (moves(hub, s))
            return true;
    return false;
}

void srv_turn_rest(struct srv_hub *hub, struct srv_session *s) {
    struct srv_session **link = &hub->busy;
    if (!s->is_busy)
        return;
    while (*link != s)
        link = &(*link)->next_busy;
    *link = s->next_busy;
    s->is_busy = false;
    hub->rested_ms = fmax(hub->rested_ms, s->share.end_ms);
}

/* Nothing but an event changes what is wanted of it. */
static bool is_at_rest(const struct srv_hub *hub, const struct srv_session *s, double now_ms) {
    bool rests = s->jobs == 0 && (s->moved_ms == 0 || now_ms - s->moved_ms >= SRV_MOVING_MS);
    for (const struct srv_participant *p = s->participants; p && rests; p = p->next)
        rests = !wants(hub, s, p);
    return rests;
}

static void let_rest(struct srv_hub *hub, double now_ms) {
    for (struct srv_session *s = hub->busy, *next; s; s = next) {
        next = s->next_busy;
        if (!is_at_rest(hub, s, now_ms))
            continue;
        srv_turn_rest(hub, s);
        for (struct srv_participant *p = s->participants; p; p = p->next)
            p->ready_ms = 0;
    }
}

void srv_hub_work(struct srv_hub *hub, struct srv_session *session) {
    if (session && !session->is_busy) {
        session->is_busy = true;
        session->next_busy = hub->busy;
        hub->busy = session;
    }
    if (hub->giving_way > 0 && srv_turn_moves(hub))
        hub->options.interrupt(hub->options.user, 0, SRV_INTERRUPT_MOTION);
    hub->options.work(hub->options.user);
}

struct claim { /* of a participant within its session, or of that for its session */
    struct srv_participant *p;
    struct srv_frame_request wish;
    double start_ms;
};

/* What it gets is expected to take; INFINITY = not known, or work that is done once is left. */
static double expect_ms(const struct srv_hub *hub, const struct claim *c) {
    const struct srv_session *s = c->p->session;
    double expected_ms = c->wish.step == SRV_STEP_MOVING
                             ? srv_hub_moving_ms(hub, s, c->p, hub->now_ms)
                             : sharp_ms(s, c->p);
    return s->done_version >= s->cold_version && expected_ms > 0 ? expected_ms : INFINITY;
}

/* What takes longer than was expected is taken to be half done. */
static double left_ms(const struct srv_running_job *running) {
    double left = running->expected_ms - running->drawn_ms;
    return left > 0 ? left : running->drawn_ms;
}

/* May it be drawn while that stands still? Who waits for that very job may not; nor what takes
 * longer than what is left of it: what takes least goes first, so that the least is waited for. And
 * it must be short: no longer than a moving frame should take, or a small part of what is left. */
static bool may_go_before(const struct srv_hub *hub, const struct claim *c,
                          const struct srv_running_job *running) {
    double left = left_ms(running), known_ms = isfinite(left) ? left : running->drawn_ms;
    double most_ms = fmin(left, fmax(SRV_QUALITY_BUDGET_MIN_MS, known_ms * SHORT_PART));
    return c->wish.protected_ms == INFINITY && c->p->taken_order != running->order &&
           expect_ms(hub, c) <= most_ms;
}

/* The participant of the lowest rank that has had least, of those who may go before what is
 * running, if that is not NULL. Where all rest the clock moves on to the last end: what was had
 * while nobody else wanted anything is no debt. */
static struct claim claim_of(struct srv_hub *hub, struct srv_session *s, double now_ms,
                             const struct srv_running_job *running, double *wait_ms) {
    struct claim best = { .p = NULL };
    double in_ms = INFINITY, last_ms = s->clock_ms;
    bool rests = s->jobs == 0;
    for (struct srv_participant *p = s->participants; p; p = p->next) {
        struct claim c = { p, srv_turn_wish(hub, s, p, now_ms),
                           srv_fair_start(&p->share, s->clock_ms) };
        in_ms = fmin(in_ms, c.wish.in_ms);
        last_ms = fmax(last_ms, c.start_ms);
        note_waiting(p, &c.wish, now_ms);
        rests = rests && !c.wish.wanted;
        if (!c.wish.wanted || (running && !may_go_before(hub, &c, running)))
            continue;
        bool better = !best.p || c.wish.rank < best.wish.rank ||
                      (c.wish.rank == best.wish.rank &&
                       (c.start_ms < best.start_ms ||
                        (c.start_ms == best.start_ms && p->taken_order < best.p->taken_order)));
        if (better)
            best = c;
    }
    if (rests && in_ms == INFINITY)
        s->clock_ms = last_ms;
    *wait_ms = fmin(*wait_ms, in_ms);
    return best;
}

/* Of two that are entitled. */
static bool is_due_before(const struct claim *a, const struct claim *b) {
    if (a->wish.rank == SRV_RANK_INTERACTION && a->wish.deadline_ms != b->wish.deadline_ms)
        return a->wish.deadline_ms < b->wish.deadline_ms;
    if (a->start_ms != b->start_ms)
        return a->start_ms < b->start_ms;
    return a->p->session->taken_order < b->p->session->taken_order;
}

/* The first rank of those who want something; the clock moves on to the least start of it, or where
 * all rest, to the last end. Returns the mean start. */
static double mean_start(struct srv_hub *hub, double now_ms, enum srv_rank *rank, double *wait_ms) {
    double sum = 0, least = INFINITY, in_ms = INFINITY;
    double last_ms = fmax(hub->clock_ms, hub->rested_ms);
    unsigned count = 0;
    bool rests = true;
    *rank = SRV_RANKS;
    for (struct srv_session *s = hub->busy; s; s = s->next_busy) {
        struct claim c = claim_of(hub, s, now_ms, NULL, &in_ms);
        rests = rests && s->jobs == 0;
        last_ms = fmax(last_ms, s->share.end_ms);
        if (!c.p || c.wish.rank > *rank)
            continue;
        if (c.wish.rank < *rank) {
            *rank = c.wish.rank;
            sum = count = 0;
            least = INFINITY;
        }
        c.start_ms = srv_fair_start(&s->share, hub->clock_ms);
        sum += c.start_ms;
        least = fmin(least, c.start_ms);
        count++;
    }
    *wait_ms = fmin(*wait_ms, in_ms);
    if (count > 0)
        hub->clock_ms = fmax(hub->clock_ms, least);
    else if (rests && in_ms == INFINITY)
        hub->clock_ms = last_ms;
    return count > 0 ? sum / count : 0;
}

/* When a refinement may begin, 0 = now: not between two frames of a view that moves, where it would
 * have to give way in a moment. */
static double quiet_in_ms(const struct srv_hub *hub, const struct srv_participant *p,
                          double now_ms) {
    double in_ms = srv_turn_moves(hub) ? QUIET_MS : 0;
    for (const struct srv_session *s = hub->busy; s; s = s->next_busy)
        if (s->moved_ms > 0 && (s != p->session || !p->progressive))
            in_ms = fmax(in_ms, s->moved_ms + QUIET_MS - now_ms);
    return in_ms;
}

struct srv_participant *srv_turn_next(struct srv_hub *hub, double now_ms,
                                      struct srv_frame_request *wish, double *wait_ms) {
    struct claim best = { .p = NULL };
    enum srv_rank rank;
    hub->now_ms = now_ms;
    let_rest(hub, now_ms);
    double mean_ms = mean_start(hub, now_ms, &rank, wait_ms);
    for (struct srv_session *s = hub->busy; s; s = s->next_busy) {
        struct claim c = claim_of(hub, s, now_ms, NULL, wait_ms);
        if (!c.p || c.wish.rank != rank)
            continue;
        c.start_ms = srv_fair_start(&s->share, hub->clock_ms);
        bool is_entitled = c.start_ms <= mean_ms + ROUNDING_MS;
        if (is_entitled && (!best.p || is_due_before(&c, &best)))
            best = c;
    }
    double quiet_ms = best.p && rank == SRV_RANK_REFINEMENT ? quiet_in_ms(hub, best.p, now_ms) : 0;
    *wait_ms = quiet_ms > 0 ? fmin(*wait_ms, quiet_ms) : *wait_ms;
    if (!best.p || quiet_ms > 0)
        return NULL;
    *wish = best.wish;
    return best.p;
}

struct srv_participant *srv_turn_before(struct srv_hub *hub, const struct srv_running_job *running,
                                        double now_ms, struct srv_frame_request *wish,
                                        double *wait_ms) {
    struct claim best = { .p = NULL };
    hub->now_ms = now_ms;
    for (struct srv_session *s = hub->busy; s; s = s->next_busy) {
        struct claim c = claim_of(hub, s, now_ms, running, wait_ms);
        if (!c.p)
            continue;
        bool is_own = s->number == running->session;
        double start_ms = is_own ? running->part_start_ms : running->start_ms;
        double ahead_ms = is_own ? c.start_ms : srv_fair_start(&s->share, hub->clock_ms);
        ahead_ms -= start_ms + running->drawn_ms;
        if (ahead_ms > 0)
            *wait_ms = fmin(*wait_ms, ahead_ms);
        else if (!best.p || is_due_before(&c, &best))
            best = c;
    }
    *wish = best.wish;
    return best.p;
}
