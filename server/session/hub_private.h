/* SPDX-License-Identifier: Apache-2.0
 *
 * What the files of the hub share. Everything here is guarded by hub->mutex, besides what says
 * otherwise.
 */
#ifndef SRV_SESSION_HUB_PRIVATE_H
#define SRV_SESSION_HUB_PRIVATE_H

#include <pthread.h>

#include "common/timer_heap.h"
#include "protocol/rpc.h"
#include "schedule/fair_queue.h"
#include "schedule/quality.h"
#include "session/hub.h"
#include "session/window.h"

#define SRV_MOVING_MS 500.0  /* a session moves for so long after a moving frame */
enum { SRV_QUALITIES = 16 }; /* volumes of which it is known what their frames take */

enum srv_notification { /* what a participant has not been told yet */
                        SRV_NOTIFY_VIEW = 1,
                        SRV_NOTIFY_PARTICIPANTS = 2,
                        SRV_NOTIFY_STATS = 4,
                        SRV_NOTIFY_ERROR = 8,
                        SRV_NOTIFY_DRAINING = 16,
                        SRV_NOTIFY_CLOSE = 32,
                        SRV_NOTIFY_CONTROL = 64,
                        SRV_NOTIFY_POLICY = 128
};

enum {
    SRV_HUB_VOLUMES = 64,  /* volumes whose progress is remembered for notifications */
    SRV_HUB_BUCKETS = 4096 /* of sessions, by id */
};

/* What a moving picture was made with (policy.h). */
struct srv_moving {
    uint32_t full[2];         /* size at rest */
    struct srv_detail detail; /* size 0: none was made yet */
    double budget_ms;         /* that it had */
    double sharp_ms;          /* that one of full detail was expected to take; 0 = not known */
    bool is_shared;           /* other sessions moved, too, and had their part of the time */
};

struct srv_participant {
    struct srv_session *session; /* NULL = it was deleted */
    struct srv_participant *next, *next_ready;
    void *user;  /* constant */
    uint64_t id; /* constant */
    enum srv_role role;
    char token[SRV_TOKEN_NAME_BYTES];      /* constant: of srv_hub_join() */
    char name[SRV_PARTICIPANT_NAME_BYTES]; /* UTF-8; never empty */
    unsigned color;                        /* of the palette */
    uint64_t asked;                        /* for control, in the order of requests; 0 = does not */
    double asked_ms;                       /* since when the holder has not answered */
    double picked_ms;                      /* the share of picks is used up to here */
    bool is_ready;                         /* in the hub's ready list */
    unsigned notes;
    uint64_t volume_told;  /* hub->volume_clock up to which progress was told */
    uint64_t volume_start; /* hub->volume_clock when it joined */
    struct sp_error error;
    uint16_t close_code;
    const char *close_reason;

    enum sp_image_format format;
    enum sp_video_codec video;  /* while the view moves; SP_VIDEO_CODEC_COUNT = none */
    struct srv_video_mark mark; /* of the frame that it can take next; epoch 0 = a key frame */
    bool video_refused;         /* there is no encoder for it: stills */
    enum sp_chroma chroma;      /* of its JPEGs */
    int quality;
    int wanted_fps, max_fps; /* what it asked for, and what the session's owner may have of that */
    bool progressive, lossless;
    uint32_t size[2]; /* 0 = the view's */

    uint32_t seq; /* newest view.update of this client */
    struct srv_window flow;
    struct srv_outbox outbox;
    uint32_t frame;         /* number of the newest frame sent */
    unsigned pipeline;      /* jobs under way for it */
    uint64_t taken_version; /* newest view for which a job was made, with what came of it: */
    enum srv_frame_step taken_step;
    struct srv_detail taken_detail;
    uint64_t failed_version;               /* rendering it failed: not tried again */
    struct srv_moving moving, moving_told; /* the last one, and what was told of one */
    double policy_ms;                      /* when it was told */
    double next_frame_ms;                  /* not before, by max_fps */
    double behind_ms;                      /* since when the view is newer than its last job */
    double ready_ms;  /* when a refinement for it could be drawn last; 0 = it cannot be */
    double waited_ms; /* before that, while it could */
    double spent_ms;  /* on it before it gave way, the longest time */
    struct srv_fair_account share; /* of its session, by its clock */
    uint64_t taken_order;          /* of its newest job */
    double stats_ms;               /* when stats were told last */
    uint64_t frames_sent, bytes_sent;
};

struct srv_session {
    struct srv_session *next, **link; /* of the hub's list; `link` is what points to it */
    struct srv_session *next_awake;   /* of its bucket */
    struct srv_session *next_busy;
    struct srv_timer due;     /* when srv_hub_tick() looks at it */
    struct srv_timer unsaved; /* in the order of changes */
    bool is_busy;             /* in the hub's list of those */
    unsigned jobs, dear;      /* under way; the dear ones of them */
    uint64_t number;          /* unique */
    char id[SRV_SESSION_ID_BYTES];
    char tokens[2][SRV_TOKEN_DIGITS + 1]; /* by role */
    struct srv_owner owner;               /* its name is constant */
    bool has_token;                       /* the owner has one, when that was asked last */
    struct sp_view view;
    void *volume;
    uint64_t version;       /* of the view, from 1 */
    uint64_t saved_version; /* that was saved last, with when it had been used */
    double saved_used_ms;
    uint64_t changed_by; /* participant; 0 = HTTP */
    double changed_ms, empty_ms, served_ms;
    double moved_ms;               /* when it got a moving frame last; 0 = never */
    struct srv_fair_account share; /* of the stream lane, by the hub's clock */
    double clock_ms;               /* of its participants' shares */
    uint64_t taken_order;          /* of its newest job */
    double taken_ms;               /* when that was made */
    double slots_ms;               /* where a slot of each rate begins */
    struct srv_quality pace;
    /* The view in which the volume or the transfer function changed last, and the newest one that
     * a picture was finished of: before that, a picture begins with work that is done once. */
    uint64_t cold_version, done_version;
    uint64_t volume_version; /* in which the volume changed last */
    bool must_finish;        /* a moving frame was given up: the next one is not */
    struct srv_render_result last;
    double frame_ms; /* mean time between jobs, for fps; 0 = none */
    struct srv_participant *participants;
    struct srv_participant *holder; /* of control; NULL = nobody */
    unsigned participant_count;
    unsigned next_guest; /* number of the next one's name */
};

struct srv_volume_news {
    char id[SP_NAME_BYTES], state[16];
    double progress;
    char reason[SP_ERROR_TEXT];
    uint64_t clock;
};

struct srv_hub {
    struct srv_hub_options options; /* constant */
    pthread_mutex_t mutex;
    struct srv_session *sessions;
    struct srv_session *awake[SRV_HUB_BUCKETS]; /* the same, by id */
    struct srv_timer_heap dues; /* of sessions, when the time alone may change something of them */
    struct srv_timer_heap unsaved; /* sessions of which srv_hub_save() may have something to save */
    uint64_t next_unsaved;
    struct srv_session *busy; /* those where a picture may be wanted, now or by time: nothing that
                                 is done for a frame looks at the others */
    unsigned session_count;
    unsigned participant_count, role_counts[2];    /* in all, and by role */
    struct srv_sleeper *sleepers[SRV_HUB_BUCKETS]; /* keep.c */
    unsigned sleeper_count;
    struct srv_timer_heap sleeper_dues; /* their ends */
    double noted_ms;                    /* when the time of use was last to be saved */
    uint64_t next_number, next_participant, next_order, next_request;
    struct srv_participant *ready_head, *ready_tail;
    struct srv_volume_news volumes[SRV_HUB_VOLUMES];
    unsigned volume_count;
    uint64_t volume_clock;
    char backend[32], device[SP_DEVICE_NAME]; /* that renders for sessions */
    /* What the frames of a volume took, as the session told that had one last: the first guess of
     * the next session. The pointers are compared, and never used. */
    struct srv_known_quality {
        const void *volume;
        struct srv_quality pace;
    } paces[SRV_QUALITIES];
    unsigned next_pace;
    double clock_ms;     /* of the sessions' shares */
    double rested_ms;    /* by that clock, the last end of those that are not busy any more */
    unsigned dear;       /* jobs under way that take long to encode */
    double now_ms;       /* when something was told or asked last */
    unsigned giving_way; /* jobs under way that give way to what moves */
    bool draining;
};

/* One that is awake; NULL = there is none. */
struct srv_session *srv_hub_find_awake(struct srv_hub *hub, const char *id);
/* Wakes it if it sleeps. */
struct srv_session *srv_hub_find(struct srv_hub *hub, const char *id, double now_ms,
                                 struct sp_error *err);
/* When somebody used it last. */
double srv_hub_used_ms(const struct srv_session *session);
void srv_hub_notify(struct srv_hub *hub, struct srv_participant *participant, unsigned notes);
void srv_hub_notify_others(struct srv_hub *hub, struct srv_session *session, uint64_t but,
                           unsigned notes);
/* Merges a patch into the session's view; `by` changed it. */
bool srv_hub_apply(struct srv_hub *hub, struct srv_session *session, const proto_json *patch,
                   uint64_t by, double now_ms, struct sp_error *err);
/* A frame is dropped. What the end of the daemon takes away is not counted. */
void srv_hub_count_drop(struct srv_hub *hub, enum srv_counter reason);
/* Nobody looks at the session any more: what is rendered for it is given up. */
void srv_hub_abandon(struct srv_hub *hub, const struct srv_session *session);
/* A session that is complete but for the numbers that every new one has. */
void srv_hub_link_session(struct srv_hub *hub, struct srv_session *session, double now_ms);
/* There may be something of it that srv_hub_save() would save. */
void srv_hub_unsaved(struct srv_hub *hub, struct srv_session *session);
/* It is saved: if nobody uses it, it may sleep when it is time. */
void srv_hub_saved(struct srv_hub *hub, struct srv_session *session);
/* What was used long after it was saved is unsaved, now and then; so is the time. */
void srv_hub_note_time(struct srv_hub *hub, double now_ms);

/* Sessions that sleep (keep.c). */

/* A session of which all is saved; false when out of memory. The session itself stays. */
bool srv_hub_add_sleeper(struct srv_hub *hub, const struct srv_session *session);
/* "" if there is none, or it is nobody's. */
const char *srv_hub_sleeping_owner(struct srv_hub *hub, const char *id);
/* NULL: there is none. Lives as long as it sleeps. */
const char *srv_hub_sleeping_token(struct srv_hub *hub, const char *id, enum srv_role role);
/* NULL: there is none, or it cannot wake yet. */
struct srv_session *srv_hub_wake(struct srv_hub *hub, const char *id, double now_ms,
                                 struct sp_error *err);
/* Why who came by a token of the daemon may not take part as it does today; NULL = it may. */
const char *srv_hub_denies(const struct srv_hub *hub, const struct srv_participant *participant);
/* What the owner's token allows today; false: it has none any more. */
bool srv_hub_renew_quota(const struct srv_hub *hub, struct srv_owner *owner);
/* Is there room for one more awake? If need be one that nobody uses falls asleep. */
bool srv_hub_make_room(struct srv_hub *hub);
/* Of an id, less than SRV_HUB_BUCKETS. */
unsigned srv_hub_bucket(const char *id);
bool srv_hub_forget_sleeper(struct srv_hub *hub, const char *id);
/* Ends those that have slept for too long; when the next one does, INFINITY = never. */
double srv_hub_end_sleepers(struct srv_hub *hub, double now_ms);
/* Of this owner (its name). */
unsigned srv_hub_count_sleepers(const struct srv_hub *hub, const char *owner);
/* `owner` NULL: of all. */
void srv_hub_list_sleepers(struct srv_hub *hub, const char *owner, double now_ms,
                           struct srv_page *page);
void srv_hub_free_sleepers(struct srv_hub *hub);
/* There is nothing of this session any more. */
void srv_hub_ended(struct srv_hub *hub, const char *id);

/* {"id", "role", "name", "color"} of each. NULL when out of memory. */
proto_json *srv_hub_encode_participants(const struct srv_session *session);

/* Control (control.c). A participant goes: it is no longer in the list. */
void srv_control_leave(struct srv_hub *hub, struct srv_session *session,
                       const struct srv_participant *p, double now_ms);
/* Does it hold control, or take it because nobody does? */
bool srv_control_take(struct srv_hub *hub, struct srv_participant *p, double now_ms);
/* Passes control on when it is time; when that is next, INFINITY = not by time. */
double srv_control_tick(struct srv_hub *hub, struct srv_session *session, double now_ms);
/* The notification session.control; malloc'ed. */
char *srv_control_text(const struct srv_hub *hub, const struct srv_participant *to, double now_ms,
                       size_t *size);
/* There may be something to render, for this session (NULL: for others); what gives way to it does.
 */
void srv_hub_work(struct srv_hub *hub, struct srv_session *session);

/* Turns (turn.c): what one participant wants now. */
struct srv_frame_request {
    bool wanted;
    enum srv_frame_step step;
    enum srv_rank rank;
    bool is_refinement; /* as in struct srv_render_job, and the next two */
    bool is_slow_to_encode;
    double protected_ms, deadline_ms;
    double in_ms; /* if nothing is wanted now: ask again in; INFINITY = not by time */
};
struct srv_frame_request srv_turn_wish(const struct srv_hub *hub, const struct srv_session *s,
                                       const struct srv_participant *p, double now_ms);
/* Whose turn it is: the participant and its wish; NULL = nobody's. Lowers *wait_ms to when it may
 * be somebody's. */
struct srv_participant *srv_turn_next(struct srv_hub *hub, double now_ms,
                                      struct srv_frame_request *wish, double *wait_ms);
/* The same of those who may go before what is drawn, which goes on for longer: a frame of a moving
 * view, expected to be short, of a session that started no later than that one got to; or of its
 * own session, of a participant of whom that is so. */
struct srv_participant *srv_turn_before(struct srv_hub *hub, const struct srv_running_job *running,
                                        double now_ms, struct srv_frame_request *wish,
                                        double *wait_ms);
/* Takes it out of the list of those that are busy. */
void srv_turn_rest(struct srv_hub *hub, struct srv_session *session);
/* Does anybody get a frame of a moving view, now or in a moment? */
bool srv_turn_moves(const struct srv_hub *hub);

/* Is it no larger than --frame-size allows? SP_ERR_INVALID at "/size". */
bool srv_hub_allows_size(const struct srv_hub *hub, const uint32_t size[2], struct sp_error *err);
/* Of a session that has a volume, and no frame of it yet. */
void srv_hub_first_pace(const struct srv_hub *hub, struct srv_session *session);
/* What the next frame of a moving view is believed to take, with the detail that it would be drawn
 * with; 0 = nothing known yet. */
double srv_hub_moving_ms(const struct srv_hub *hub, const struct srv_session *session,
                         const struct srv_participant *participant, double now_ms);

/* The size of a participant's pictures at rest: what it wants, or the view's, as far as the owner's
 * token allows that. */
void srv_hub_size(const struct srv_session *session, const struct srv_participant *participant,
                  uint32_t size[2]);

#endif
