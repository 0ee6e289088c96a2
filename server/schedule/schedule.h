/* SPDX-License-Identifier: Apache-2.0
 *
 * The scheduler: decides what is drawn next, and accounts for it. README.md in this folder explains
 * the rules. This header is the API of the render and encode threads.
 *
 *   sessions ──► srv_schedule_next ──► job ──► render, encode ──► session/delivery.h ──► outboxes
 *       ▲                                          │
 *       └──── done, failed or cancelled ◄──────────┘
 *
 * All functions are thread-safe: they lock the hub's mutex. The callbacks run with it held and must
 * call neither the hub nor the scheduler.
 */
#ifndef SRV_SCHEDULE_SCHEDULE_H
#define SRV_SCHEDULE_SCHEDULE_H

#include <string.h>

#include "schedule/decide.h"
#include "session/delivery.h"

struct srv_schedule;

enum srv_interrupt {
    SRV_INTERRUPT_NEWER_VIEW,    /* the session's view changed */
    SRV_INTERRUPT_NEWER_REQUEST, /* the same view: a participant wants another frame of it */
    SRV_INTERRUPT_UNWANTED,      /* all that is in progress for the session is useless */
    SRV_INTERRUPT_STOPPED,       /* the hand stopped: frames that are ahead of it are useless */
    SRV_INTERRUPT_MOTION         /* a view moves: jobs that are not protected are cancelled */
};

struct srv_schedule_options {
    void *user;
    void (*wake)(void *user); /* there may be something to render */
    /* Jobs in progress may no longer be wanted. `of` is the number of a session; for
     * SRV_INTERRUPT_NEWER_REQUEST it is a participant; 0 = none. */
    void (*interrupt)(void *user, uint64_t of, enum srv_interrupt why);
};

/* Observes the sessions of the hub, which has none yet. */
struct srv_schedule *srv_schedule_create(struct srv_hub *hub,
                                         const struct srv_schedule_options *options,
                                         struct sp_error *err);
void srv_schedule_destroy(struct srv_schedule **schedule); /* after the hub */

/* Returns the hub that it observes. */
struct srv_hub *srv_schedule_hub(const struct srv_schedule *schedule);

/* A frame that takes longer than this to encode is slow. An encoder cannot be interrupted. So slow
 * frames have encode threads of their own, unless they are for the only participant of the daemon.
 * A session has one such frame in progress (two for the only participant), and the daemon
 * SRV_SLOW_ENCODE_JOBS. Participants that get fast frames do not share a job with slow ones. */
#define SRV_SLOW_ENCODE_MS 30.0
enum { SRV_SLOW_ENCODE_JOBS = 4 };

struct srv_render_job {
    uint64_t session;              /* its number */
    char id[SRV_SESSION_ID_BYTES]; /* of the session */
    uint64_t version;              /* of the view */
    uint64_t image; /* that the view gives: it may have newer versions with the same image */
    uint64_t order; /* rises from job to job */
    enum srv_frame_step step;
    bool is_refinement;     /* a newer view of the session cancels it at once */
    bool is_alone;          /* for the only participant of the daemon */
    bool is_first;          /* before others, for a client that has no frame yet */
    bool is_slow_to_encode; /* SRV_SLOW_ENCODE_MS */
    bool is_sharp;          /* whole, of full size, all voxels: only the encoding can get better */
    bool is_draft;          /* sp_render_options.draft */
    double protected_ms;    /* SRV_INTERRUPT_MOTION cancels it once it was drawn for so long;
                               INFINITY = never */
    double cancellable_from_ms; /* a newer view cancels it from this time on: 0 = at once,
                                   INFINITY = never */
    double budget_ms;           /* time for which its detail was chosen */
    double part;                /* of the time that the session gets, (0, 1] */
    double expected_ms;         /* INFINITY = not known, or it begins with classification */
    /* Virtual times at which the accounts of its session and of its first participant start.
     * charged_ms is charged until the true time of the job is known; the session pays `price` times
     * that time. */
    double start_ms, participant_start_ms, charged_ms, price;
    unsigned mip_level;  /* as in sp/renderer.h; 0 if final */
    uint32_t full[2];    /* size at rest, px */
    struct sp_view view; /* with the size to render */
    double ahead;        /* its camera was expected: its image is ahead by so many image heights */
    bool ends_with_motion;       /* SRV_INTERRUPT_STOPPED cancels it */
    struct srv_volume *volume;   /* a counted use, released when the job ends */
    struct srv_blob_owner owner; /* of the session; see srv_render_job_owner() */
    uint64_t too_large;     /* targets whose encoded frame does not fit; 0 = of all; for render/ */
    uint64_t encoder_bytes; /* taken from the memory of frames; for render/ */
    struct srv_bytes depth; /* precedes the image of targets that get depth; owned; for render/ */
    uint32_t target_count;
    struct srv_frame_target targets[SRV_PARTICIPANTS_MAX];
};

/* True if some target gets the depth of the frame. */
static inline bool srv_render_job_wants_depth(const struct srv_render_job *job) {
    for (uint32_t i = 0; i < job->target_count; i++)
        if (job->targets[i].depth)
            return true;
    return false;
}

/* Returns the properties of the job's frame that its delivery needs. */
static inline struct srv_drawn_frame srv_render_job_frame(const struct srv_render_job *job) {
    struct srv_drawn_frame frame = { .session = job->session,
                                     .order = job->order,
                                     .is_moving = job->step == SRV_STEP_MOVING,
                                     .full = { job->full[0], job->full[1] } };
    memcpy(frame.id, job->id, sizeof frame.id);
    return frame;
}

struct srv_render_result {
    uint32_t width, height, mip_level;
    bool is_draft;               /* as in sp/frame.h */
    bool has_depth;              /* the frame has depth; false if the job wants none */
    double render_ms, encode_ms; /* encode_ms: the time of all encodings */
    double once_ms; /* part of render_ms that the next frame of this volume does not need */
    uint64_t splats, visible_voxels;
    struct sp_frame_bricks bricks;
    bool again; /* the job was not rendered: the frame of an earlier job was encoded again */
};

/* Gets the next job. False: there is none; *wait_ms = when to ask again at the latest. */
bool srv_schedule_next(struct srv_schedule *schedule, double now_ms, struct srv_render_job *job,
                       double *wait_ms);

struct srv_running_job {
    uint64_t session, order; /* these six as in the job */
    double start_ms, participant_start_ms, expected_ms, price;
    double drawn_ms; /* for how long it has been drawn */
    uint64_t image;  /* these three as in the job */
    bool is_first, ends_with_motion;
};
/* Gets a short job that preempts the running one (decide.h). False as above. */
bool srv_schedule_next_short(struct srv_schedule *schedule, const struct srv_running_job *running,
                             double now_ms, struct srv_render_job *job, double *wait_ms);

/* True if the newest view of its session gives the image of the job. */
bool srv_schedule_is_newest(struct srv_schedule *schedule, const struct srv_render_job *job);
/* Returns in how many ms the hand of a job that ends with the motion seems to have stopped, unless
 * the view changes before; INFINITY = the view has changed since, or the session ended. */
double srv_schedule_stops_in_ms(struct srv_schedule *schedule, const struct srv_running_job *job,
                                double now_ms);
/* True if some client is connected to a session. */
bool srv_schedule_has_clients(struct srv_schedule *schedule);
/* The job's frame does not fit the memory of frames: for SRV_SHRINK_MS, frames of these targets (a
 * set, one bit each) have at most half of its pixels. False: it is as small as frames get, or the
 * targets have left. */
#define SRV_SHRINK_MS 10000.0
bool srv_schedule_shrink(struct srv_schedule *schedule, const struct srv_render_job *job,
                         uint64_t set, double now_ms);
/* Returns the owner that an encoded frame for these targets counts for. */
struct srv_blob_owner srv_render_job_owner(const struct srv_render_job *job, uint64_t set);
/* True if some view moves, or will within SRV_QUIET_MS. */
bool srv_schedule_has_motion(struct srv_schedule *schedule);

/* The video frame of target `i` was skipped (SRV_VIDEO_WAITS): it wants a newer one once the socket
 * has taken its last frame. */
void srv_schedule_skipped(struct srv_schedule *schedule, const struct srv_render_job *job,
                          uint32_t i);

/* The job was drawn in render_ms and is not encoded yet: charges its accounts, so that the next
 * decision knows. */
void srv_schedule_rendered(struct srv_schedule *schedule, struct srv_render_job *job,
                           double render_ms);
/* The job was drawn, but finer samples of its volume are missing. If it was to be the final frame
 * and they are being read, it becomes an intermediate one. A better one follows, unless it is the
 * final frame. Call it before the job is delivered. */
void srv_schedule_incomplete(struct srv_schedule *schedule, struct srv_render_job *job,
                             bool is_being_read);
/* Every job ends with exactly one of these three, which also releases its volume. */
void srv_schedule_done(struct srv_schedule *schedule, struct srv_render_job *job,
                       const struct srv_render_result *result);
void srv_schedule_failed(struct srv_schedule *schedule, struct srv_render_job *job,
                         const struct sp_error *err);
/* elapsed_ms: time of rendering; 0 = it was not rendered, or to the end. */
void srv_schedule_cancelled(struct srv_schedule *schedule, struct srv_render_job *job,
                            double elapsed_ms);

#endif
