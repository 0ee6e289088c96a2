/* SPDX-License-Identifier: Apache-2.0
 *
 * The structs of sessions and participants, for session/ and schedule/ alone. The hub's mutex
 * guards everything here, unless a comment says otherwise.
 *
 *   srv_hub ──► srv_session ──► srv_participant      one struct per concern inside each of them
 *                  │                  │
 *                  └── schedule       └── schedule   what schedule/ remembers; opaque here
 */
#ifndef SRV_SESSION_SESSION_H
#define SRV_SESSION_SESSION_H

#include <pthread.h>

#include "common/timer_heap.h"
#include "config/secret.h"
#include "protocol/rpc.h"
#include "session/congestion.h"
#include "session/display_delay.h"
#include "session/encode_params.h"
#include "session/hub.h"
#include "session/measures.h"
#include "session/participant.h"
#include "session/rate_control.h"
#include "sp/renderer.h"

enum srv_notification { /* a participant has to be told about */
                        SRV_NOTIFY_VIEW = 1,
                        SRV_NOTIFY_PARTICIPANTS = 2,
                        SRV_NOTIFY_STATS = 4,
                        SRV_NOTIFY_ERROR = 8,
                        SRV_NOTIFY_DRAINING = 16,
                        SRV_NOTIFY_CLOSE = 32,
                        SRV_NOTIFY_CONTROL = 64,
                        SRV_NOTIFY_POLICY = 128,
                        SRV_NOTIFY_MEASURES = 256,
                        SRV_NOTIFY_TIME = 512
};

enum {
    SRV_HUB_VOLUMES = 64,  /* volumes whose last progress is remembered for notifications */
    SRV_HUB_BUCKETS = 4096 /* of the hash table of sessions, by id */
};

/* Participants. */

struct srv_identity {
    uint64_t id;                           /* unique in the daemon; constant */
    enum srv_role role;                    /* constant */
    char token[SRV_TOKEN_NAME_BYTES];      /* of srv_hub_join(); constant */
    char name[SRV_PARTICIPANT_NAME_BYTES]; /* UTF-8; never empty */
    unsigned color;                        /* index into the palette */
};

struct srv_control_request {
    uint64_t order;  /* of requests in the hub; 0 = none */
    double since_ms; /* the current holder has not answered since */
};

struct srv_pending {
    unsigned notifications;     /* bits of enum srv_notification */
    uint64_t volume_reported;   /* hub->volumes.clock up to which progress was told */
    uint64_t volume_start;      /* hub->volumes.clock when it joined */
    uint64_t measures_reported; /* the session's measures.clock up to which they were told */
    double stats_ms;            /* when statistics were sent last */
    struct sp_error error;      /* for SRV_NOTIFY_ERROR */
    uint16_t close_code;        /* for SRV_NOTIFY_CLOSE */
    const char *close_reason;
    struct srv_late_answer *answers; /* to calls that took time, oldest first; owned */
};

struct srv_late_answer {
    struct srv_late_answer *next;
    char *text; /* owned */
    size_t size;
};

struct srv_stream_settings { /* of stream.configure */
    enum sp_image_format format;
    enum sp_video_codec video;      /* while the view moves; SP_VIDEO_CODEC_COUNT = none */
    enum sp_video_codec slow_video; /* the same, where the network is too slow for images */
    enum sp_chroma chroma;          /* of its JPEGs */
    int quality;                    /* [1, 100] */
    int wanted_fps;                 /* frames per second that the client asked for */
    int max_fps;                    /* as granted: at most the quota of the session's owner */
    bool progressive;               /* wants frames of less detail while the view moves */
    bool lossless;                  /* wants PNG at rest */
    bool depth;                     /* wants the depth and the camera of each frame */
    int predict_ms;                 /* moving frames may show the camera so far ahead */
    uint32_t size[2];               /* px; 0 = the view's */
};

struct srv_delivery {
    uint32_t seq;      /* newest view.update of this client */
    double updated_ms; /* when that arrived */
    uint32_t sent_seq; /* of the newest frame sent */
    uint32_t frame;    /* number of the newest frame sent */
    struct srv_congestion congestion_window;
    struct srv_display_delay display_delay;
    struct srv_rate_control rate_control;
    struct srv_outbox outbox;
    struct srv_video_mark mark; /* the video frame that it can take next; epoch 0 = a key frame */
    bool is_video_refused;      /* no encoder is free: it gets images instead of video */
    uint64_t frames_sent, bytes_sent;
};

/* A limit of the pixels of frames, because larger frames do not fit the memory of frames. The first
 * change of the view after until_ms ends the limit. */
struct srv_memory_limit {
    uint64_t px; /* 0 = all fit */
    double until_ms;
};

struct srv_participant {
    struct srv_session *session; /* NULL = the session ended */
    struct srv_participant *next, *next_ready;
    bool is_ready; /* in the hub's ready list */
    void *user;    /* constant */
    struct srv_identity identity;
    struct srv_control_request control;
    double picked_ms;   /* its quota of picks is used up until this time */
    double measured_ms; /* the same for measurements */
    struct srv_pending pending;
    struct srv_stream_settings settings;
    struct srv_memory_limit memory;
    struct srv_policy policy;
    struct srv_delivery delivery;
    struct srv_participant_schedule *schedule; /* freed with the participant */
};

/* Sessions. */

struct srv_session_identity {
    uint64_t number;                      /* unique in the daemon; constant */
    char id[SRV_SESSION_ID_BYTES];        /* constant */
    char tokens[2][SRV_TOKEN_DIGITS + 1]; /* join tokens by role; constant */
    struct srv_owner owner;               /* its name is constant */
    bool has_token;                       /* the owner's token existed at the last check */
    bool is_guests;                       /* forked with a join token */
};

struct srv_view_state {
    struct sp_view view;
    struct srv_volume *volume; /* a counted use */
    /* Uses of the view's time step, which may still be loading or have failed (NULL = memory is
     * out), and of what frames show: the same, or a step near it until it is loaded. */
    struct srv_volume *step, *displayed;
    /* Uses of the time steps that the view shows of other volumes. Until they are loaded, frames
     * show steps near them. */
    struct srv_volume *others[2 * SP_LAYERS_MAX];
    unsigned other_count;
    uint32_t steps;      /* of the volume, at least 1 */
    bool is_waiting;     /* `displayed` is another step than the view's, or one of `others` loads */
    uint64_t version;    /* rises with every change, from 1 */
    uint64_t image;      /* rises with every change that gives another image */
    uint64_t changed_by; /* participant; 0 = HTTP */
    double changed_ms;
    char closed[SP_NAME_BYTES]; /* the volume that was closed while the session showed it; not saved
                                 */
};

struct srv_view_text { /* the notification view.changed, the same for all participants */
    char *bytes;       /* owned, with a NUL behind them; NULL = not made */
    size_t size;
    uint64_t version; /* of the view */
};

struct srv_play {    /* play.c; not saved */
    double rate;     /* of the vectors' phase, periods per second; 0 = the phase stands */
    double phase;    /* at since_ms */
    double since_ms; /* when the rate changed last */
    double steps;    /* time steps per second; 0 = the time stands */
    double step_ms;  /* when the time step changed last */
};

struct srv_saved {            /* what the store has */
    struct srv_timer unsaved; /* in hub->persistence.unsaved, in the order of changes */
    uint64_t version;         /* of the view */
    uint64_t measures_clock;  /* of the measurements */
    double used_ms;           /* time of the session's last use */
};

struct srv_session_stats { /* of the newest frame, for stream.stats */
    uint32_t width, height, mip_level;
    double render_ms, encode_ms;
    uint64_t splats, visible_voxels;
    struct sp_frame_bricks bricks;
    double interval_ms; /* mean time between frames; 0 = not known */
};

struct srv_session {
    struct srv_session *next, **link; /* in hub->active.first; `link` points to this session */
    struct srv_session *next_in_bucket;
    struct srv_timer timer; /* when srv_hub_tick() looks at it */
    struct srv_session_identity identity;
    struct srv_view_state shared;
    struct srv_view_text text;
    struct srv_play play;
    struct srv_measures measures;
    struct srv_saved saved;
    struct srv_session_stats stats;
    struct srv_participant *participants;
    struct srv_participant *holder; /* of control; NULL = it is free */
    unsigned participant_count;
    unsigned next_guest; /* number in the next default name */
    double empty_ms;     /* when the last participant left */
    double measured_ms;  /* its quota of measurements over HTTP is used up to this time */
    struct srv_session_schedule *schedule; /* freed with the session */
};

/* The layer above. */

enum srv_session_event {
    SRV_SESSION_STARTED,           /* it became active */
    SRV_SESSION_ENDED,             /* it ended or hibernates, and is freed next */
    SRV_SESSION_EMPTIED,           /* its last participant left */
    SRV_VIEW_CHANGED,              /* the view has a new version; so it has with the next two: */
    SRV_TRANSFER_FUNCTION_CHANGED, /* all voxels have to be classified again */
    SRV_VOLUME_CHANGED,
    SRV_SLICES_CHANGED, /* the view has a new version, which gives the same image */
    SRV_PARTICIPANT_JOINED,
    SRV_IMAGE_CHANGED,     /* the participant asked for another size, format or quality */
    SRV_CONFIGURED,        /* the participant's settings were read, changed or not */
    SRV_CONGESTION_CHANGED /* the participant acknowledged or took a frame */
};

/* The layer that decides which frames are drawn: schedule/. Each session and participant owns
 * zeroed memory for it. */
struct srv_session_observer {
    void *user;
    size_t session_bytes, participant_bytes;
    /* With the hub's mutex held. `participant` is NULL for the events of a whole session. */
    void (*event)(void *user, enum srv_session_event event, struct srv_session *session,
                  struct srv_participant *participant, double now_ms);
};

struct srv_volume_news {
    char id[SP_NAME_BYTES], state[16];
    double progress;
    char reason[SP_ERROR_TEXT];
    uint64_t clock; /* of its last change */
};

struct srv_active_sessions {
    struct srv_session *first;
    struct srv_session *buckets[SRV_HUB_BUCKETS]; /* the same sessions, by id */
    struct srv_timer_heap timers;
    unsigned count;
    uint64_t next_number;
};

struct srv_hibernated_sessions { /* hibernate.c */
    struct srv_hibernated_session *buckets[SRV_HUB_BUCKETS];
    struct srv_hibernated_owner *owners;
    const struct srv_hibernated_session *resumed; /* becomes active now, so it must not end */
    struct srv_timer_heap ends;
    unsigned count;
};

struct srv_session_persistence {
    struct srv_timer_heap unsaved; /* sessions that srv_hub_save() may have to save */
    uint64_t next_unsaved;
    double noted_ms; /* when changed times of use were last marked for saving */
};

struct srv_all_participants {
    unsigned count, by_role[2];
    uint64_t next_id, next_request;
    struct srv_participant *ready_head, *ready_tail;
};

struct srv_all_volumes {
    struct srv_volume_news news[SRV_HUB_VOLUMES];
    unsigned count;
    uint64_t clock; /* rises with each change */
};

struct srv_hub {
    struct srv_hub_options options; /* constant */
    pthread_mutex_t mutex;
    struct srv_session_observer observer; /* constant while there is a session */
    struct srv_active_sessions active;
    struct srv_hibernated_sessions hibernated;
    struct srv_session_persistence persistence;
    struct srv_all_participants participants;
    struct srv_all_volumes volumes;
    char backend[32], device[SP_DEVICE_NAME]; /* that render for sessions */
    bool is_draining;
};

/* Sets the observer. Call it before the first session is active. Without an observer nothing is
 * drawn. */
void srv_hub_observe(struct srv_hub *hub, const struct srv_session_observer *observer);
void srv_hub_emit(struct srv_hub *hub, enum srv_session_event event, struct srv_session *session,
                  struct srv_participant *participant, double now_ms);

/* Sessions (lifecycle.c). */

/* Returns an active session; NULL = there is none. */
struct srv_session *srv_hub_find_active(struct srv_hub *hub, const char *id);
/* Returns a session; makes it active if it is hibernated. */
struct srv_session *srv_hub_find(struct srv_hub *hub, const char *id, double now_ms,
                                 struct sp_error *err);
struct srv_session *srv_hub_alloc_session(const struct srv_hub *hub);
/* Frees it and releases its volume. */
void srv_hub_free_session(struct srv_hub *hub, struct srv_session *session);
/* Makes a session active that has its identity and view. */
void srv_hub_link_session(struct srv_hub *hub, struct srv_session *session, double now_ms);
/* Ends an active session for good and closes its streams. */
void srv_hub_end_session(struct srv_hub *hub, struct srv_session *session);
/* Makes sure that one more session with this identity can be active, within --sessions and within
 * the owner's share of them (common/fair_share.h). If necessary, an unused session of the owner
 * hibernates; if --sessions is reached, an unused session of an owner with more sessions. Sessions
 * of guests have a share of the owner's share, and make no other session hibernate. False:
 * SP_ERR_QUOTA (the share), SP_ERR_BUDGET. */
bool srv_hub_ensure_capacity(struct srv_hub *hub, const struct srv_session_identity *identity,
                             struct sp_error *err);
/* Hibernates an active session without participants; false when out of memory. */
bool srv_hub_hibernate(struct srv_hub *hub, struct srv_session *session, const char *why);
/* Returns when the session was last used, ms, if it has no participants. */
double srv_hub_used_ms(const struct srv_session *session);
/* Call it when the store has the newest view. An unused session may hibernate when its time has
 * come. */
void srv_hub_saved(struct srv_hub *hub, struct srv_session *session);
/* Calls options.ended(). */
void srv_hub_ended(struct srv_hub *hub, const char *id);

/* Notifications (lifecycle.c). */

/* Adds notifications, 0 = only that there is something to send. */
void srv_hub_notify(struct srv_hub *hub, struct srv_participant *participant,
                    unsigned notifications);
/* The same for all participants except the participant with the id `except`; 0 = for all. */
void srv_hub_notify_others(struct srv_hub *hub, struct srv_session *session, uint64_t except,
                           unsigned notifications);
/* Counts a dropped frame, unless the daemon is shutting down. */
void srv_hub_count_drop(struct srv_hub *hub, enum srv_counter reason);

/* The view (view.c). */

/* True if the view shows the volume, or one of its layers names it. */
bool srv_hub_view_names(const struct sp_view *view, const char *id);
/* Merges a patch into the session's view; participant `by` changed it, 0 = HTTP. */
bool srv_hub_apply(struct srv_hub *hub, struct srv_session *session, const proto_json *patch,
                   uint64_t by, double now_ms, struct sp_error *err);
/* SP_ERR_INVALID at "/size" over --frame-size. */
bool srv_hub_allows_size(const struct srv_hub *hub, const uint32_t size[2], struct sp_error *err);
/* Gets the full size of a participant's frames: what it asked for, or the view's, within the limit
 * of the owner's token. */
void srv_hub_size(const struct srv_session *session, const struct srv_participant *participant,
                  uint32_t size[2]);

/* Time steps (steps.c). */

/* Call it when the time step, the volume or the layers of the session's view changed. Takes uses of
 * the new steps, and reports a step that cannot be loaded. */
void srv_steps_follow(struct srv_hub *hub, struct srv_session *session);
/* True if the layers of two views show different volumes. */
bool srv_steps_show_others(const struct sp_view *a, const struct sp_view *b);
/* Releases the uses. */
void srv_steps_release(struct srv_hub *hub, struct srv_session *session);

/* Playing (play.c). */

/* True if the vectors of the view move. */
bool srv_play_moves(const struct srv_session *session);
/* Returns when the view changes by itself next: a past time if vectors move; INFINITY = never, or
 * not before another time step is loaded. */
double srv_play_due_ms(const struct srv_session *session);
/* True if the view changes by itself. */
bool srv_play_is_on(const struct srv_session *session);
/* Sets the phase of a copy of the view to the phase at `now_ms`. */
void srv_play_place(const struct srv_session *session, double now_ms, struct sp_view *view);
/* Gives a view that is due its next version, which is not saved. */
void srv_play_advance(struct srv_hub *hub, struct srv_session *session, double now_ms);
/* Stops playing time steps, because the volume changed or a step could not be loaded. */
void srv_play_stop_steps(struct srv_hub *hub, struct srv_session *session);
/* Returns the notification time.changed; malloc'ed, NULL when out of memory. */
char *srv_play_text(const struct srv_participant *to, size_t *size);

/* Tokens (tokens.c). */

/* Returns why a participant that joined with a token of the daemon may not keep its role; NULL = it
 * may. */
const char *srv_hub_denies(const struct srv_hub *hub, const struct srv_participant *participant);
/* Updates the quota from the owner's token; false: the token is gone. */
bool srv_hub_renew_quota(const struct srv_hub *hub, struct srv_owner *owner);
/* Asks the participant's client to close its stream; `reason` is a constant. */
void srv_hub_close_stream(struct srv_hub *hub, struct srv_participant *participant, uint16_t code,
                          const char *reason);

/* Persistence and hibernation (hibernate.c). */

/* Returns whether the store has the newest view and the newest measurements. */
bool srv_hub_is_view_saved(const struct srv_session *session);
/* Marks the session for saving and tells the options' changed(). */
void srv_hub_unsaved(struct srv_hub *hub, struct srv_session *session);
/* Marks sessions for saving whose time of use in the store is too old. Does so only at
 * intervals. */
void srv_hub_note_time(struct srv_hub *hub, double now_ms);
/* Adds a hibernated session like this active one; false when out of memory. If there are too many,
 * one ends: of the owner with the most, and unused for the longest time. */
bool srv_hibernated_add(struct srv_hub *hub, const struct srv_session *session);
/* Returns the owner's name, "" = no such session or no owner. */
const char *srv_hibernated_owner(struct srv_hub *hub, const char *id);
/* Returns a join token, valid until the session is active or ends; NULL = no such session. */
const char *srv_hibernated_token(struct srv_hub *hub, const char *id, enum srv_role role);
/* Makes a hibernated session active. NULL: there is none, or it must wait. */
struct srv_session *srv_hibernated_resume(struct srv_hub *hub, const char *id, double now_ms,
                                          struct sp_error *err);
unsigned srv_hub_bucket(const char *id); /* less than SRV_HUB_BUCKETS */
bool srv_hibernated_remove(struct srv_hub *hub, const char *id);
/* Returns false and says that there is no session, or that its record is damaged (SP_ERR_IO). */
bool srv_hibernated_missing(const struct srv_hub *hub, const char *id, struct sp_error *err);
/* Ends sessions that were hibernated for too long; returns when the next one ends. */
double srv_hibernated_tick(struct srv_hub *hub, double now_ms);
/* Returns how many hibernated sessions an owner has; *guests of them were created with join
 * tokens. */
unsigned srv_hibernated_count(struct srv_hub *hub, const char *owner, unsigned *guests);
void srv_hibernated_list(struct srv_hub *hub, const char *owner, double now_ms,
                         struct srv_page *page);
void srv_hibernated_free(struct srv_hub *hub);

/* Returns the id of the participant that holds control, or null. NULL when out of memory. */
proto_json *srv_hub_encode_holder(const struct srv_session *session);
/* Returns {"id", "role", "name", "color"} of each participant. NULL when out of memory. */
proto_json *srv_hub_encode_participants(const struct srv_session *session);
/* Returns the colour of a participant, "#rrggbb". A constant string. */
const char *srv_hub_color(const struct srv_participant *participant);
/* Returns the colour of the first participant, for what comes over HTTP. */
const char *srv_hub_first_color(void);
/* Returns the notification session.measures for a participant: malloc'ed, NULL when out of memory.
 * (measuring.c) */
char *srv_measures_text(struct srv_participant *to, size_t *size);

/* Late answers (measure_late.c). */

/* Takes the oldest one, which exists; malloc'ed. */
char *srv_late_answer_pop(struct srv_participant *participant, size_t *size);
void srv_late_answers_free(struct srv_participant *participant);

/* Control (control.c). */

/* Call it after a participant left; it is no longer in the list. */
void srv_control_leave(struct srv_hub *hub, struct srv_session *session,
                       const struct srv_participant *participant, double now_ms);
/* Acquires control if the participant may have it and control is free. True if the participant
 * holds control. */
bool srv_control_acquire(struct srv_hub *hub, struct srv_participant *participant, double now_ms);
/* Passes control on when --control-time is over; returns when that is next, INFINITY = never. */
double srv_control_tick(struct srv_hub *hub, struct srv_session *session, double now_ms);
/* Returns the notification session.control; malloc'ed. */
char *srv_control_text(const struct srv_hub *hub, const struct srv_participant *to, double now_ms,
                       size_t *size);

/* Stream policy (policy.c). */

/* Adapts the rate control to the measured network and the settings. Call it when either changes. */
void srv_policy_update_rate(struct srv_participant *participant);
/* Returns the video codec of its moving frames; SP_VIDEO_CODEC_COUNT = images. */
enum sp_video_codec srv_policy_video(const struct srv_participant *participant);
/* Returns the encoding of a participant's frames of one step. */
struct srv_encoding srv_policy_encoding(const struct srv_participant *participant,
                                        enum srv_frame_step step);
/* True if a sharp frame in this encoding is what the participant gets at rest, so that no other
 * frame has to follow it. */
bool srv_policy_is_final(const struct srv_participant *participant,
                         const struct srv_encoding *encoding);
/* Call it when a job was made for the participant. Notifies the participant if the detail of moving
 * frames changed: at most twice per second while the view moves, and once when it is at rest.
 * `moving`: the detail of this job, NULL = the job is not for a moving view. */
void srv_policy_update(struct srv_hub *hub, struct srv_participant *participant,
                       const struct srv_moving_detail *moving, double now_ms);
/* Returns the notification stream.policy; malloc'ed, NULL when out of memory. */
char *srv_policy_text(struct srv_participant *participant, double now_ms, size_t *size);

#endif
