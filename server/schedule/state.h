/* SPDX-License-Identifier: Apache-2.0
 *
 * The state of the scheduler, and functions that its files share. The hub's mutex guards
 * everything.
 */
#ifndef SRV_SCHEDULE_STATE_H
#define SRV_SCHEDULE_STATE_H

#include "common/fair_queue.h"
#include "schedule/motion.h"
#include "schedule/predict.h"
#include "schedule/quality.h"
#include "schedule/schedule.h"
#include "session/session.h"

#define SRV_MOVING_MS 500.0  /* a session counts as moving this long after a moving frame */
#define SRV_FAR_AHEAD 0.005  /* image heights: a frame that is this far ahead does not stay */
enum { SRV_QUALITIES = 16 }; /* volumes whose frame times are remembered */

struct srv_newest_job { /* that was made for a participant, and what came of it */
    uint64_t order;
    uint64_t version; /* of the view; 0 = it does not count: a frame is wanted again */
    enum srv_frame_step step;
    struct srv_detail detail;
    bool is_ahead; /* its image is far ahead of the view's */
};

struct srv_waiting {  /* of a refinement, for the starvation limit */
    double ready_ms;  /* when it could have been drawn last; 0 = it cannot */
    double waited_ms; /* before that, while it could */
    double spent_ms;  /* longest time that was spent on it before it was cancelled */
};

struct srv_participant_schedule {
    unsigned jobs; /* in progress */
    struct srv_newest_job newest;
    uint64_t failed_version; /* of the view: rendering it failed and is not tried again */
    double next_frame_ms;    /* its frame rate allows no frame before */
    double behind_ms;        /* since when the view is newer than its newest job */
    struct srv_waiting waiting;
    struct srv_fair_account account; /* by its session's clock */
    struct srv_fair_use use;         /* time of the frames that it got */
};

struct srv_cold_start { /* the view's versions since which work is done that is needed once */
    uint64_t cold;      /* the volume or transfer function changed last */
    uint64_t done;      /* newest version of which a frame was finished */
    uint64_t volume;    /* the volume changed last */
};

struct srv_session_schedule {
    bool is_busy; /* in the list of busy sessions */
    struct srv_session *next_busy;
    unsigned jobs, slow_jobs;        /* in progress; of them, slow to encode */
    uint64_t newest_order;           /* of its newest job */
    double newest_ms;                /* when the newest job was made */
    double moved_ms;                 /* when its last moving frame began; 0 = never */
    struct srv_fair_account account; /* by the scheduler's clock */
    uint64_t owner;                  /* equal for sessions of one owner */
    bool wants_frame;                /* when the last frame was chosen */
    unsigned siblings;               /* sessions of its owner that get frames now, with itself */
    double clock_ms;                 /* of its participants' accounts */
    struct srv_quality quality;
    struct srv_motion motion;
    double changed_ms; /* when the view changed last */
    double gap_ms; /* the longest time between changes, of which newer ones count more; 0 = none */
    struct srv_past past;
    bool has_depth; /* the last frame of a job that wants depth had it */
    struct srv_cold_start start;
    bool must_finish; /* a moving frame was cancelled: the next one is not */
    bool has_stopped; /* the same, because the hand stopped: the next one does not end with it */
};

struct srv_known_quality {           /* first guess for new sessions of the volume */
    const struct srv_volume *volume; /* compared, never used */
    struct srv_quality quality;
};

struct srv_schedule {
    struct srv_hub *hub;
    struct srv_schedule_options options;
    struct srv_session *busy; /* sessions where a frame may be wanted, now or later: the work per
                                 frame does not depend on the other sessions */
    struct srv_candidate *candidates; /* options.sessions_max of the hub, and so these */
    struct srv_choice *choices;
    double clock_ms;         /* of the sessions' accounts */
    struct srv_fair_use use; /* of all sessions */
    double first_ms;         /* first frames have used their part of the time up to then */
    double rested_ms;        /* last end of accounts of sessions that are no longer busy */
    double now_ms;           /* of the last call or event that had a time */
    unsigned sharing;        /* sessions that get frames now, */
    double owners;           /* and their owners */
    uint64_t next_order;     /* of jobs */
    unsigned slow_jobs;      /* in progress that are slow to encode */
    unsigned cancellable;    /* jobs in progress that motion may cancel */
    struct srv_known_quality qualities[SRV_QUALITIES];
    unsigned next_quality;
};

struct srv_choice { /* a participant, and what it gets */
    struct srv_participant *participant;
    struct srv_frame_request request;
};

/* What the participant takes of a frame that is drawn now for another one: as above, up to half an
 * interval before its frame rate allows it. So participants of equal rates share all frames,
 * whenever they joined. */
struct srv_frame_request srv_request_to_share(const struct srv_schedule *schedule,
                                              const struct srv_session *session,
                                              const struct srv_participant *participant,
                                              double now_ms);
/* Chooses the participant that is served next; NULL = none. Lowers *wait_ms to when there may be
 * one.
 */
struct srv_choice srv_choose(struct srv_schedule *schedule, double now_ms, double *wait_ms);
/* Chooses the participant whose frame preempts the running job; NULL = none. */
struct srv_choice srv_choose_short(struct srv_schedule *schedule,
                                   const struct srv_running_job *running, double now_ms,
                                   double *wait_ms);
/* Returns the time at which the hand seems to have stopped, unless the view changes before. */
double srv_settles_at_ms(const struct srv_schedule *schedule, const struct srv_session *session);
/* Chooses the detail of an intermediate frame for the participant, as large as its network allows.
 * False: none is worth it. */
bool srv_intermediate(const struct srv_session *session, const struct srv_participant *participant,
                      struct srv_detail *detail);
/* True if some participant gets a frame of a moving view now or within SRV_QUIET_MS. */
bool srv_has_motion(const struct srv_schedule *schedule);
/* The price of a millisecond for the session: owners have equal shares of the time, and the
 * sessions of one owner equal parts of its share. 1 if each owner has as many. */
double srv_session_price(const struct srv_schedule *schedule, const struct srv_session *session);
/* Returns the part of its session's time that a participant has if all want frames. */
double srv_participant_portion(const struct srv_session *session,
                               const struct srv_participant *participant);
/* True if the holder of control warps moving frames; without a holder that takes them, if all
 * participants that take them do. */
bool srv_session_warps(const struct srv_session *session);
/* Time that a moving frame for the participant may take: the part of its interval that others
 * leave, but at least its own fair part. So it gets less detail instead of fewer frames. */
struct srv_quality_budget srv_moving_budget(const struct srv_schedule *schedule,
                                            const struct srv_participant *p, int max_fps);

/* Replaces the camera of a moving frame by the one that its only recipient will probably show with
 * it, if that one moves the view and asked for predicted frames. Returns by how much the image is
 * ahead, image heights; 0 = the camera was not replaced. (ahead.c) */
double srv_predict_job(const struct srv_schedule *schedule, const struct srv_participant *only,
                       struct srv_render_job *job, double now_ms);

/* True if the client warps the last moving frame to the camera of the hand, and the sharp frame is
 * expected soon, because it is fast and views rest soon: then no other frame precedes it. (ahead.c)
 */
bool srv_skips_intermediate(const struct srv_schedule *schedule,
                            const struct srv_participant *participant);
/* True if a moving frame for its only recipient is cancelled when the hand stops: it is ahead, or
 * it began late, so that the sharp frame can be ready nearly as soon. Of two such frames in a row,
 * at least one is finished, and so is a frame whose work the next one would repeat. (ahead.c) */
bool srv_ends_with_motion(const struct srv_schedule *schedule, const struct srv_participant *only,
                          const struct srv_render_job *job, double now_ms);
/* True if a job that was cancelled was cancelled for that reason. Then the scheduler goes on as if
 * its frame had been finished. session: NULL = it ended. (ahead.c) */
bool srv_has_stopped(const struct srv_session *session, const struct srv_render_job *job);

/* There may be something to render, for this session (NULL = for others). (events.c) */
void srv_schedule_wake(struct srv_schedule *schedule, struct srv_session *session);
/* Removes the session from the list of busy ones. */
void srv_schedule_rest(struct srv_schedule *schedule, struct srv_session *session);

#endif
