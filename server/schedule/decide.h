/* SPDX-License-Identifier: Apache-2.0
 *
 * The decision what is drawn next. Pure functions of explicit candidates and a clock: no session,
 * no lock, no thread, so that tests run them in virtual time. candidates.c collects the input from
 * the sessions, and jobs.c carries the decision out.
 *
 *   srv_demand ──► srv_decide_request ──► srv_candidate ─┬─► srv_decide_participant   per session
 *   (one participant's situation)                        └─► srv_decide_session       of these
 *
 * All times are milliseconds. "now" and deadlines are of the system clock; starts are of the
 * virtual clock of the accounts (fair_queue.h).
 */
#ifndef SRV_SCHEDULE_DECIDE_H
#define SRV_SCHEDULE_DECIDE_H

#include <stdbool.h>
#include <stdint.h>

#include "session/encode_params.h"

#define SRV_QUIET_MS 100.0 /* views are quiet this long after their last moving frame */

/* Candidates of a lower rank are drawn only while no candidate has a higher one. */
enum srv_rank {
    SRV_RANK_INTERACTION, /* the view is newer than what the client sees of it */
    SRV_RANK_REFINEMENT,  /* a better frame of the same view, or a frame for a client that wants
                             final frames only */
    SRV_RANKS
};

/* The situation of one participant, as far as it decides on its next frame.
 *
 *   the participant wants a frame if          and gets it if
 *     the view is newer than its last job       its window is open (session/window.h)
 *     or the view rests, and its last frame     and its frame rate allows it
 *     was not of final quality */
struct srv_demand {
    bool wants_frame;        /* the above, besides the frame rate and the rest */
    bool is_newer;           /* the view is newer than its last job */
    bool is_progressive;     /* the client takes frames of less detail while the view moves */
    bool needs_intermediate; /* at rest, the sharp frame takes long: another one goes before it */
    bool is_slow[SRV_STEPS]; /* to encode, by step */
    bool has_slow_slot;      /* one more frame that is slow to encode may be in progress */
    int max_fps;
    double next_frame_ms; /* the frame rate allows no frame before */
    double behind_ms;     /* since when the view is newer than its last job */
    double rest_at_ms;    /* when the view is at rest, if nothing changes it */
    double sharp_ms;      /* expected time of a sharp frame; 0 = not known */
    double waited_ms;     /* how long a refinement waited that could have been drawn */
    double spent_ms;      /* longest time that was spent on it before it was cancelled */
};

struct srv_frame_request {
    bool is_wanted;
    enum srv_frame_step step;
    enum srv_rank rank;
    bool is_refinement; /* a newer view cancels it */
    bool is_slow_to_encode;
    double protected_ms; /* motion elsewhere cancels it unless it is drawn for less than this;
                            INFINITY = motion never cancels it */
    double deadline_ms;  /* when the next frame of a moving view is due */
    double in_ms;        /* if nothing is wanted now: when to ask again, INFINITY = after an
                            event */
};
/* What the participant wants now. Its frame of a moving view is due when the next one would be. A
 * refinement is not wanted from a moving view, except that the first frame after a rest is sharp at
 * once if that is fast. */
struct srv_frame_request srv_decide_request(const struct srv_demand *demand, double now_ms);

/* What wants a frame now: a participant of a session, or the best one of a session. */
struct srv_candidate {
    enum srv_rank rank;
    double deadline_ms;
    double start_ms;       /* virtual start of its account */
    uint64_t newest_order; /* of its newest job: the one that was served longer ago wins ties */
    double lead_ms;        /* virtual time that it is ahead of the running job; preemption only */
};

enum { SRV_NO_CANDIDATE = -1 };

/* Returns the participant that goes first in its session: the highest rank, then the least virtual
 * start. */
int srv_decide_participant(const struct srv_candidate *candidates, int count);

struct srv_decision {
    int chosen;      /* index, or SRV_NO_CANDIDATE */
    double clock_ms; /* the virtual clock from now on */
};
/* Returns which session is drawn next. Of the highest rank that is wanted, the sessions are
 * eligible that start no later than the mean start. Of the eligible ones the frame with the
 * earliest deadline goes first; of refinements, the least virtual start. */
struct srv_decision srv_decide_session(const struct srv_candidate *candidates, int count,
                                       double clock_ms);

/* Returns for how long a refinement must not begin, 0 = it may: not between two frames of a moving
 * view, which would cancel it in a moment. last_motion_ms: the newest moving frame of any other
 * view, 0 = none. */
double srv_decide_quiet_ms(bool has_motion, double last_motion_ms, double now_ms);

/* Preemption. The job that is being drawn pauses while short frames of sessions, and of other
 * participants of its session, are drawn that are behind it in virtual time. So every session gets
 * its share, even beside one whose frames take long and must not be cancelled. */

/* True if a frame of a moving view that is expected to take expected_ms (INFINITY = not known) is
 * short enough. It must take no longer than what is left of the running job, because the shortest
 * remaining work goes first; and no longer than a moving frame should take, or a tenth of what is
 * left. running_ms: expected time of the running job, drawn_ms: for how long it was drawn. What
 * takes longer than expected is assumed to be half done. */
bool srv_decide_is_short(double expected_ms, double running_ms, double drawn_ms);

/* Returns the candidate that preempts the running job: of those that are not ahead of it (lead_ms),
 * the one with the earliest deadline. Lowers *wait_ms to when the first of the others may. */
int srv_decide_preemption(const struct srv_candidate *candidates, int count, double *wait_ms);

#endif
