/* SPDX-License-Identifier: Apache-2.0
 *
 * Decides which frame is drawn next. Pure functions of explicit candidates and a clock: no session,
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

/* A sharp frame that takes up to this time replaces the last moving one. A client that warps frames
 * to the camera of the hand gets no intermediate frame before it either: that one would be 0.5 to 2
 * dB better than the warped frame, and delay the sharp one by 70 to 90 ms. */
#define SRV_SETTLED_SHARP_MS 250.0

/* Candidates of a lower rank are drawn only while no candidate has a higher one. */
enum srv_rank {
    SRV_RANK_FIRST,       /* the client has no frame yet, and this one is short */
    SRV_RANK_INTERACTION, /* the view is newer than what the client sees of it */
    SRV_RANK_REFINEMENT,  /* a better frame of the same view, or a frame for a client that takes
                             only final frames */
    SRV_RANKS
};

/* What the next frame of one participant depends on.
 *
 *   the participant wants a frame if          and gets it if
 *     the view is newer than its last job       its window is open (session/congestion.h)
 *     or its last frame was not of final        and its frame rate allows it
 *     quality
 *
 * A refinement begins when the hand seems to have stopped: no update came for longer than between
 * the last ones. If it began earlier, the next update would have to cancel it first.
 * The frame of final quality begins so late that it is ready when the view rests. */
struct srv_demand {
    bool wants_frame;        /* as above, without the frame rate and the rest */
    bool is_first;           /* the client has no frame yet, and may have one before others */
    bool is_newer;           /* a moving frame is due: the view is newer than its last job, or */
    bool is_ahead;           /* the frame of that job is ahead of a hand that did not move since */
    bool is_progressive;     /* the client takes frames of less detail while the view moves */
    bool needs_intermediate; /* the sharp frame takes long, so a faster one precedes it */
    bool is_slow[SRV_STEPS]; /* the frame of this step is slow to encode */
    bool has_slow_slot;      /* another slow frame may be encoded now */
    int max_fps;
    double next_frame_ms; /* the frame rate allows no frame before, */
    double opens_ms;      /* nor does the network */
    double behind_ms;     /* time since which the view is newer than its last job */
    double settles_at_ms; /* time at which the hand seems to have stopped, <= rest_at_ms */
    double rest_at_ms;    /* time at which the view is at rest, unless it changes */
    bool has_frame;       /* a moving frame of this motion is displayed */
    bool is_alone;        /* the only client, whose last moving frame was finished */
    double sharp_ms;      /* expected time of a sharp frame; 0 = not known */
    double waited_ms;     /* how long a refinement waited although it could be drawn */
    double spent_ms;      /* longest time for which it was drawn before it was cancelled */
};

/* Returns how long no update must come until the hand seems to have stopped. gap_ms: the longest
 * time between the last updates, 0 = not known; rest_ms: then the view is at rest. */
double srv_decide_settle_ms(double gap_ms, double rest_ms);

struct srv_frame_request {
    bool is_wanted;
    enum srv_frame_step step;
    enum srv_rank rank;
    bool is_refinement; /* a newer view cancels it */
    bool is_slow_to_encode;
    double protected_ms; /* moving views cancel it once it was drawn for longer than this;
                            INFINITY = they never cancel it */
    double deadline_ms;  /* when the next frame of a moving view is due */
    double in_ms;        /* if nothing is wanted now: when to ask again, INFINITY = after an
                            event */
};
/* Returns what the participant wants now. The deadline of a moving frame is the time of the frame
 * after it. A moving view wants no refinement, but its first frame after a rest is sharp if that is
 * fast. When the hand seems to have stopped, an intermediate or sharp frame replaces the
 * moving one of a client that is alone. */
struct srv_frame_request srv_decide_request(const struct srv_demand *demand, double now_ms);

/* A participant that wants a frame now, or the best participant of a session. */
struct srv_candidate {
    enum srv_rank rank;
    double deadline_ms;
    double start_ms;       /* virtual start of its account */
    uint64_t newest_order; /* of its newest job; in a tie the lower order wins */
    double lead_ms;        /* virtual time that it is ahead of the running job; preemption only */
};

enum { SRV_NO_CANDIDATE = -1 };

/* Returns the participant to draw next in a session: the highest rank, then the smallest virtual
 * start. */
int srv_decide_participant(const struct srv_candidate *candidates, int count);

struct srv_decision {
    int chosen;      /* index, or SRV_NO_CANDIDATE */
    double clock_ms; /* the virtual clock from now on */
};
/* Returns the session to draw next. Only candidates of the highest rank count; first frames do not
 * move the clock past the others. A session is
 * eligible if its virtual start is not later than the mean. The eligible session with the earliest
 * deadline is next; for refinements, the session with the smallest virtual start. */
struct srv_decision srv_decide_session(const struct srv_candidate *candidates, int count,
                                       double clock_ms);

/* Returns how long a refinement must wait, ms; 0 = it may start. It does not start between two
 * frames of another moving view, because the second one would cancel it. last_motion_ms: time of
 * the newest moving frame of any other view; 0 = none. */
double srv_decide_quiet_ms(bool has_motion, double last_motion_ms, double now_ms);

/* Preemption. The running job pauses for short frames of other sessions and participants that are
 * behind it in virtual time. So each session gets its share, even beside a session whose long
 * frames must not be cancelled. */

/* True if a moving frame is short enough to preempt the running job. It must not take longer than
 * the rest of that job: the shortest remaining work goes first. It must also not take longer than
 * SRV_QUALITY_ROUND_MS or a tenth of that rest, whichever is larger. expected_ms: time of the
 * frame, INFINITY = unknown; running_ms: expected time of the running job; drawn_ms: how long it
 * was drawn. A job that takes longer than expected counts as half done. */
bool srv_decide_is_short(double expected_ms, double running_ms, double drawn_ms);

/* Returns the candidate that preempts the running job: of the candidates that are not ahead of it
 * (lead_ms), it has the earliest deadline. Lowers *wait_ms to the time until another one may
 * preempt. */
int srv_decide_preemption(const struct srv_candidate *candidates, int count, double *wait_ms);

/* Returns the time before which the frame rate allows no further frame, after a frame at now_ms.
 * Each frame adds an interval. Up to one interval that was not used counts, so that changes which
 * come as often as frames are allowed do not wait, however irregularly they come (the generic cell
 * rate algorithm, ITU-T I.371). */
double srv_next_frame_ms(double next_ms, int max_fps, double now_ms);

#endif
