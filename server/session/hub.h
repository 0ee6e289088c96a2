/* SPDX-License-Identifier: Apache-2.0
 *
 * Sessions: one shared view and its participants.
 *
 *   view.update ─► session (newest wins) ─► srv_schedule_next ─► render, encode ─►
 * srv_schedule_deliver │ view.changed                                                  │ ▼ ▼ other
 * participants  ◄────────── srv_hub_next_message ◄──────────── outbox
 *
 * Everything is pulled: the stream lane asks for a job when it is free, and gets one only if some
 * participant has not seen the newest view and its flow control window is open; the stream thread
 * asks for the next message when the socket can take it. Notifications are bits that say what a
 * participant has not been told yet, so that no queue grows: what is told is the state then.
 *
 * The hub has one mutex; all functions are thread-safe. Callbacks are made with it held and must
 * not call the hub. A participant belongs to the thread that joined it: it alone makes it leave.
 */
#ifndef SRV_SESSION_HUB_H
#define SRV_SESSION_HUB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "config/secret.h"
#include "ops/metrics.h"
#include "protocol/json.h"
#include "schedule/quality.h"
#include "session/outbox.h"
#include "session/owner.h"
#include "sp/encode.h"
#include "sp/pick.h"
#include "sp/video.h"
#include "sp/view.h"

struct srv_hub;
struct srv_participant;

enum { SRV_PARTICIPANTS_MAX = 64, SRV_SESSION_ID_BYTES = 17, SRV_PARTICIPANT_NAME_BYTES = 65 };

/* Where volumes come from: the catalog. A volume handle is one counted use of a ready volume. */
struct srv_volume_source {
    void *user;
    /* A use of the volume; id NULL or "" = the first one loaded. Errors:
     * SP_ERR_VOLUME_UNKNOWN, SP_ERR_NOT_READY while it loads, SP_ERR_VOLUME_FAILED. */
    void *(*acquire)(void *user, const char *id, struct sp_error *err);
    void *(*ref)(void *user, void *volume);
    void (*release)(void *user, void *volume);
    void (*default_view)(void *user, void *volume, struct sp_view *view);
    /* As sp_pick_at(); called without the hub's lock. */
    void (*pick)(void *user, void *volume, const struct sp_view *view, const uint32_t size[2],
                 const double at[2], struct sp_pick *pick);
};

enum srv_interrupt {
    SRV_INTERRUPT_NEWER_VIEW,    /* the session's view changed */
    SRV_INTERRUPT_NEWER_REQUEST, /* the view is the same: one participant wants another picture of
                                    it */
    SRV_INTERRUPT_UNWANTED,      /* nobody wants anything that is under way for the session */
    SRV_INTERRUPT_MOTION /* some view moves: whatever gives way to that (struct srv_render_job) does
                            so */
};

struct srv_hub_options {
    struct srv_volume_source volumes;
    unsigned sessions_max, participants_max; /* the latter a session, [1, SRV_PARTICIPANTS_MAX] */
    double session_idle_ms; /* a session that nobody uses falls asleep, or ends, after this */
    double sleep_ms;        /* one that sleeps ends after this */
    double ran_ms; /* added to now_ms: for how long all daemons ran that kept the sessions */
    unsigned sleepers_max; /* when so many sleep no new session is made */
    double control_ms;     /* a request for control that nobody answers is granted after this */
    double rest_ms;        /* a view that did not change for this long is refined, step by step */
    size_t stream_bytes;   /* byte cap on the frames on their way to one client */
    uint64_t frame_px;     /* largest picture; 0 = what sp/view.h allows */
    struct srv_metrics *metrics; /* NULL = nothing is counted */
    void *user;
    void (*work)(void *user);  /* there may be something to render */
    void (*ready)(void *user); /* some participant has something to send */
    /* What is being rendered is no longer what is wanted first (struct srv_render_job says when it
     * may be given up). `of` is a session, or the participant of SRV_INTERRUPT_NEWER_REQUEST, or 0.
     */
    void (*interrupt)(void *user, uint64_t of, enum srv_interrupt why);
    /* There is something to save, or nothing of this session any more. NULL = nothing is kept. */
    void (*changed)(void *user);
    void (*ended)(void *user, const char *id);
    /* What was saved last of a session: malloc'ed, with a NUL behind it. NULL = nothing can be had
     * back, and sessions end instead of falling asleep. */
    char *(*recall)(void *user, const char *id, size_t *size, struct sp_error *err);
    /* What the token of this name may do (enum srv_right) and is allowed today; false: there is
     * none of it any more, and what was known of it holds on. NULL = neither changes. */
    bool (*token)(void *user, const char *name, unsigned *rights, struct srv_quota *quota);
    /* Can it be drawn? NULL = everything can. */
    bool (*supports)(void *user, const struct sp_view *view, struct sp_error *err);
};

struct srv_hub *srv_hub_create(const struct srv_hub_options *options, struct sp_error *err);
/* After every participant left and every job was finished. */
void srv_hub_destroy(struct srv_hub **hub);

/* Sessions (any thread); JSON answers are owned by the caller, NULL with *err set. */

/* The view that `base` and then `patch` make of the defaults of the volume that `base`, or else
 * `patch`, names. NULL or an empty object changes nothing; without a volume it is the first one.
 * *volume is acquired. For what comes by HTTP. */
bool srv_hub_resolve_view(struct srv_hub *hub, const proto_json *base, const proto_json *patch,
                          struct sp_view *view, void **volume, struct sp_error *err);

/* {"id", "tokens": {"control", "view"}, "view"}. SP_ERR_BUDGET over the limit of sessions: of those
 * that are awake, nobody takes part in and are saved the one that was used longest ago falls asleep
 * first, to make room. */
proto_json *srv_hub_session_create(struct srv_hub *hub, const proto_json *patch, double now_ms,
                                   char id[SRV_SESSION_ID_BYTES], struct sp_error *err);
/* The same of an owner: SP_ERR_QUOTA over its own limit, for which sessions
 * that sleep count, too. A guest, who has but a join token, is refused sooner: a quarter of all
 * sessions is for those who have a token of the daemon; and for it nothing falls asleep.
 * SP_ERR_DENIED for a guest where the owner has no token any more. */
proto_json *srv_hub_session_create_owned(struct srv_hub *hub, const proto_json *patch,
                                         const struct srv_owner *owner, bool is_guest,
                                         double now_ms, char id[SRV_SESSION_ID_BYTES],
                                         struct sp_error *err);
/* The tokens have changed: what sessions that are awake were allowed is asked again. Of a name that
 * has none any more those who take part by its token, or in a session that it made, are told to
 * leave (1008); so is who has a higher role by its token than that gives today. */
void srv_hub_renew_tokens(struct srv_hub *hub);
/* Whose session it is, awake or asleep; nobody's if there is none. */
void srv_hub_session_owner(struct srv_hub *hub, const char *id, struct srv_owner *owner);
/* {"id", "view", "participants"}; `with_tokens` adds "tokens". Like all that asks for a session by
 * its id, besides deletion, authorization and the list, it wakes one that sleeps: SP_ERR_NOT_READY
 * with what it waits for if that cannot be, SP_ERR_BUDGET if too many are awake. */
proto_json *srv_hub_session_get(struct srv_hub *hub, const char *id, bool with_tokens,
                                double now_ms, struct sp_error *err);
/* Merges a patch; returns the new view. */
proto_json *srv_hub_session_patch(struct srv_hub *hub, const char *id, const proto_json *patch,
                                  double now_ms, struct sp_error *err);
/* Its participants are told to leave. */
bool srv_hub_session_delete(struct srv_hub *hub, const char *id, struct sp_error *err);
/* The role of a join token: SP_ERR_NOT_FOUND (no such session), SP_ERR_DENIED (wrong token). */
bool srv_hub_authorize(struct srv_hub *hub, const char *id, const char *token, enum srv_role *role,
                       struct sp_error *err);
/* Could one more participant join now? SP_ERR_NOT_FOUND, SP_ERR_BUDGET. */
bool srv_hub_can_join(struct srv_hub *hub, const char *id, double now_ms, struct sp_error *err);

struct srv_session_info {
    char id[SRV_SESSION_ID_BYTES]; /* first: struct srv_page */
    char volume[SP_NAME_BYTES];
    char owner[SRV_TOKEN_NAME_BYTES]; /* "" = nobody's */
    bool is_asleep;
    unsigned participants;
    double idle_ms; /* since it was used last: 0 with participants */
};
struct srv_page;
/* Shows all sessions of an owner (NULL: of all), awake or asleep, to a page of struct
 * srv_session_info. */
void srv_hub_list(struct srv_hub *hub, const char *owner, double now_ms, struct srv_page *page);

/* Puts idle sessions to sleep or ends them, and passes control on; returns when to call again, in
 * ms from now (at most 1000). */
double srv_hub_tick(struct srv_hub *hub, double now_ms);
/* Tells all participants: a volume's state ("loading", "ready", "failed", "unloaded"), progress in
 * [0,1], and the reason of a failure ("" = none). Who joins later hears nothing of an unloaded one.
 */
void srv_hub_volume_progress(struct srv_hub *hub, const char *id, const char *state,
                             double progress, const char *reason);

/* Keeping (any thread). */

/* Calls save() with what is to be kept of each session that changed since, or was used long after;
 * it must not call the hub. False: save() failed, or memory was out; call again later. */
bool srv_hub_save(struct srv_hub *hub, double now_ms,
                  bool (*save)(void *user, const char *id, const char *text, size_t size),
                  void *user);
/* A session as it was saved, which sleeps since it was used then: recall() must give the same text.
 * SP_ERR_FORMAT if it is none. */
bool srv_hub_restore(struct srv_hub *hub, const char *id, const char *text, size_t size,
                     double now_ms, struct sp_error *err);

/* What the status line of clients shows besides the frame's own numbers; all are told at once. */
void srv_hub_set_backend(struct srv_hub *hub, const char *backend, const char *device);
void srv_hub_drain(struct srv_hub *hub);
struct srv_hub_numbers {
    unsigned sessions, asleep; /* sessions: awake */
    unsigned participants[2];  /* by role */
};
void srv_hub_numbers(struct srv_hub *hub, struct srv_hub_numbers *numbers);

/* Participants (stream thread). */

/* SP_ERR_NOT_FOUND, SP_ERR_BUDGET (participants), SP_ERR_DENIED. `token`: the name of the daemon's
 * token that it came by, which may have changed since; "" = one of the session's. `user` comes back
 * from srv_hub_take_ready(). */
struct srv_participant *srv_hub_join(struct srv_hub *hub, const char *id, enum srv_role role,
                                     const char *token, void *user, double now_ms,
                                     struct sp_error *err);
void srv_hub_leave(struct srv_hub *hub, struct srv_participant **participant, double now_ms);

/* Handles one text message. *answer is malloc'ed, or NULL if there is none. False: out of memory,
 * drop the client. */
bool srv_hub_message(struct srv_hub *hub, struct srv_participant *participant, const char *text,
                     size_t size, double now_ms, char **answer, size_t *answer_size);

/* The user pointer of one participant that has something to send, NULL if none has; each is handed
 * out once until something new comes up. */
void *srv_hub_take_ready(struct srv_hub *hub);

enum srv_message_kind { SRV_MESSAGE_NONE, SRV_MESSAGE_TEXT, SRV_MESSAGE_FRAME, SRV_MESSAGE_CLOSE };
struct srv_message {
    char *text; /* malloc'ed, the caller's */
    size_t size;
    struct srv_blob *blob; /* the caller's reference */
    struct proto_frame_header header;
    uint16_t close_code; /* with a constant reason */
    const char *reason;
};
/* The next thing to send; frames only if `frames` (the socket took the last one). */
enum srv_message_kind srv_hub_next_message(struct srv_hub *hub, struct srv_participant *participant,
                                           bool frames, double now_ms, struct srv_message *message);
/* Since when the oldest unacknowledged frame is on its way, ms; 0 = none. */
double srv_hub_oldest_unacked_ms(struct srv_hub *hub, struct srv_participant *participant);
uint64_t srv_participant_id(const struct srv_participant *participant);

/* Jobs (render and encode threads). */

struct srv_render_target {
    uint64_t participant;
    uint32_t seq;
    enum sp_image_format format;
    enum sp_video_codec video; /* SP_VIDEO_CODEC_COUNT = a still */
    int quality;
    enum sp_chroma chroma; /* of a JPEG; never AUTO */
    bool final;            /* the full picture in the granted quality: nothing follows */
};
/* A picture that takes longer than this to encode is dear. An encode thread cannot be interrupted,
 * so that dear ones have threads of their own, unless they are for the only participant that there
 * is; of a session at most one is under way (two for who is alone), and SRV_SLOW_ENCODE_JOBS in
 * all. Who gets cheap pictures has no part in jobs of dear ones. */
#define SRV_SLOW_ENCODE_MS 30.0
enum { SRV_SLOW_ENCODE_JOBS = 4 };
/* What comes first. */
enum srv_rank {
    SRV_RANK_INTERACTION, /* the view is newer than what is seen of it */
    SRV_RANK_REFINEMENT,  /* a better picture of it, or for who wants good ones alone */
    SRV_RANKS
};
/* What a picture is for, in the order in which a view that came to rest gets them. */
enum srv_frame_step {
    SRV_STEP_MOVING,       /* keeps up with the hand */
    SRV_STEP_INTERMEDIATE, /* at rest, before a sharp one that takes long */
    SRV_STEP_FINAL         /* full size, all voxels, granted quality */
};
struct srv_render_job {
    uint64_t session, version; /* of the view */
    uint64_t order;            /* rises from job to job */
    enum srv_frame_step step;
    bool is_refinement;  /* worthless as soon as a newer view exists */
    double protected_ms; /* gives way to whatever moves when it was drawn for so long: is given up,
                        and taken again; INFINITY = it does not */
    bool is_alone;       /* for the one participant that there is, of whatever session */
    bool is_slow_to_encode;     /* takes long to encode (SRV_SLOW_ENCODE_MS) */
    bool is_sharp;              /* full size and all voxels: only the encoding can get better */
    double cancellable_from_ms; /* a newer view gives it up from then on: 0 = at once, INFINITY =
                                   never */
    double budget_ms;           /* for which its detail was chosen */
    /* Of its session's and its participants' shares: where they started, by the clocks of those
     * (share.h), and what was charged until its time is known. */
    double expected_ms; /* that it will take; INFINITY = not known, or more: work done once */
    double start_ms, part_start_ms, charged_ms;
    unsigned mip_level;  /* as in sp/renderer.h; 0 if final */
    uint32_t full[2];    /* size at rest */
    struct sp_view view; /* with the size to render */
    void *volume;        /* a use of its own */
    uint32_t target_count;
    struct srv_render_target targets[SRV_PARTICIPANTS_MAX];
};
struct srv_render_result {
    uint32_t width, height, mip_level;
    double render_ms, encode_ms; /* encode_ms: the time of all encodings */
    double once_ms; /* of render_ms: work that the next frame of this volume will not need again */
    uint64_t splats, visible_voxels;
    bool again; /* not rendered: an earlier job's picture of the same view was encoded again */
};

/* The next thing to render (share.h says whose). False if there is none: *wait_ms says when to ask
 * again at the latest. */
bool srv_schedule_next(struct srv_hub *hub, double now_ms, struct srv_render_job *job,
                       double *wait_ms);
/* A job that is drawn, and has been for so long. */
struct srv_running_job {
    uint64_t session, order; /* as the job's, and the next three */
    double start_ms, part_start_ms, expected_ms;
    double drawn_ms;
};
/* A thing to render at once while another job stands still: of a session, or of another participant
 * of the same session, that has had less, and expected to take no longer than what is left of that
 * job. False as above. */
bool srv_schedule_next_short(struct srv_hub *hub, const struct srv_running_job *running,
                             double now_ms, struct srv_render_job *job, double *wait_ms);
/* Is its view still the newest of its session? */
bool srv_schedule_is_newest(struct srv_hub *hub, const struct srv_render_job *job);
/* Does anything move, or is about to? */
bool srv_schedule_has_motion(struct srv_hub *hub);
/* One encoded picture for target `i`. header: size, times, codec and LOSSLESS are the caller's; the
 * rest is filled in. */
void srv_schedule_deliver(struct srv_hub *hub, const struct srv_render_job *job, uint32_t i,
                          const struct proto_frame_header *header, struct srv_blob *blob);

/* Video (render/video.h has the law). Which frame of a video it is: `number` since the key frame
 * that began the epoch. Epochs are unique and never 0. */
struct srv_video_mark {
    uint64_t epoch;
    uint32_t number;
};
enum srv_video_need {
    SRV_VIDEO_NONE,  /* takes nothing of this job: it left, got a newer frame, or its last one still
                        waits for the socket; then it wants a newer one afterwards */
    SRV_VIDEO_DELTA, /* has all frames up to `next` */
    SRV_VIDEO_KEY    /* needs a key frame */
};
enum srv_video_need srv_schedule_video_need(struct srv_hub *hub, const struct srv_render_job *job,
                                            uint32_t i, const struct srv_video_mark *next);
/* Does anybody of the job's session who has all frames up to `next` get nothing of this job? */
bool srv_schedule_has_video(struct srv_hub *hub, const struct srv_render_job *job,
                            const struct srv_video_mark *next);
/* There is no encoder for those of the set, a bit each: they get stills, and are told so
 * (stream.policy), until one is there again. */
void srv_schedule_refuse_video(struct srv_hub *hub, const struct srv_render_job *job, uint64_t set);
/* As srv_schedule_deliver(), of the frame `mark`; number 0 is a key frame. Does nothing for who can
 * no longer use it. */
void srv_schedule_deliver_video(struct srv_hub *hub, const struct srv_render_job *job, uint32_t i,
                                const struct proto_frame_header *header, struct srv_blob *blob,
                                const struct srv_video_mark *mark);
/* It is drawn, and took so long, of which its session's share is known before the next job is
 * chosen. It ends later, when it is encoded. */
void srv_schedule_rendered(struct srv_hub *hub, struct srv_render_job *job, double render_ms);
/* Every job ends with exactly one of these, which also releases its volume. */
void srv_schedule_done(struct srv_hub *hub, struct srv_render_job *job,
                       const struct srv_render_result *result);
void srv_schedule_failed(struct srv_hub *hub, struct srv_render_job *job,
                         const struct sp_error *err);
/* It was rendered for elapsed_ms; 0 = not at all, or to the end. */
void srv_schedule_cancelled(struct srv_hub *hub, struct srv_render_job *job, double elapsed_ms);

#endif
