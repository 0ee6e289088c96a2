/* SPDX-License-Identifier: Apache-2.0
 *
 * The hub: all sessions of the daemon. A session is one shared view and its participants.
 *
 *                    POST /sessions
 *                          │
 *                          ▼      unused for --session-time
 *    participants ◄──► active ─────────────────────────────────────► hibernated ──► ended
 *    (participant.h)       ▲                                             │
 *                          └──────────── any request for its id ─────────┘
 *
 * The hub has one mutex, and all functions are thread-safe. The hub makes its callbacks with the
 * mutex held; a callback must not call the hub. This header is for HTTP handlers, the daemon and
 * persistence. participant.h is the API of one stream. session.h holds the structs, which only
 * session/ and schedule/ see.
 */
#ifndef SRV_SESSION_HUB_H
#define SRV_SESSION_HUB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "ops/metrics.h"
#include "protocol/json.h"
#include "session/measures.h"
#include "session/owner.h"
#include "sp/pick.h"
#include "sp/view.h"

struct srv_hub;
struct srv_page;
struct srv_volume; /* render/catalog.h; this folder and schedule/ only hold uses of it */

enum { SRV_PARTICIPANTS_MAX = 64, SRV_SESSION_ID_BYTES = 17 };

/* Where volumes come from: the catalog. A struct srv_volume is one counted use of a ready volume.
 */
struct srv_volume_source {
    void *user;
    /* Returns a use of the volume; id NULL or "" = the first one that was loaded. NULL with
     * SP_ERR_VOLUME_UNKNOWN, SP_ERR_NOT_READY or SP_ERR_VOLUME_FAILED at "/volume". */
    struct srv_volume *(*acquire)(void *user, const char *id, struct sp_error *err);
    struct srv_volume *(*ref)(void *user, struct srv_volume *volume);
    void (*release)(void *user, struct srv_volume *volume);
    /* The time steps of a volume (render/catalog.h explains them). The functions below accept a use
     * of a ready step in place of a use of the volume. step() returns NULL when out of memory. NULL
     * = volumes have one step. */
    uint32_t (*steps)(void *user, struct srv_volume *volume);
    struct srv_volume *(*step)(void *user, struct srv_volume *volume, uint32_t step);
    bool (*step_is_ready)(void *user, struct srv_volume *step, struct sp_error *err);
    struct srv_volume *(*nearest_step)(void *user, struct srv_volume *volume, uint32_t step);
    /* Writes uses of the time steps of other volumes that the view shows to steps[]. False when out
     * of memory; *count uses were taken before the failure. NULL = views show no other volumes. */
    bool (*other_steps)(void *user, struct srv_volume *volume, const struct sp_view *view,
                        struct srv_volume *steps[2 * SP_LAYERS_MAX], unsigned *count);
    void (*default_view)(void *user, struct srv_volume *volume, struct sp_view *view);
    /* Returns the smallest distance of samples, world units; 0 = it has none. NULL = not known. */
    double (*spacing)(void *user, struct srv_volume *volume);
    /* As sp_pick_at(). Runs without the hub's mutex. */
    bool (*pick)(void *user, struct srv_volume *volume, const struct sp_view *view,
                 const uint32_t size[2], const double at[2], struct sp_pick *pick,
                 struct sp_error *err);
    /* As sp_measure_compute(), for at most `samples` samples of a region. Parts and paths are
     * measured in the volume with the view's edits. Also runs without the hub's mutex. NULL = a
     * test never measures. */
    bool (*measure)(void *user, struct srv_volume *volume, const struct sp_view *view,
                    const struct sp_measure *measure, double samples,
                    struct proto_measure_value *value, struct sp_error *err);
    /* As sp_view_fits(); NULL = every view fits. */
    bool (*fits)(void *user, struct srv_volume *volume, const struct sp_view *view,
                 struct sp_error *err);
};

struct srv_hub_options {
    struct srv_volume_source volumes;
    unsigned sessions_max;     /* active sessions, at least 1 */
    unsigned participants_max; /* per session, [1, SRV_PARTICIPANTS_MAX] */
    unsigned hibernated_max; /* hibernated sessions, at least 1; if one more hibernates, another one
                                ends */
    double session_idle_ms;  /* an active session hibernates, or ends, this long after its last
                                use */
    double hibernation_ms;   /* a hibernated session ends this long after its last use */
    double past_run_ms;  /* added to now_ms: run time of earlier daemons with the same state, ms */
    double control_ms;   /* an unanswered request for control is granted after this time */
    double rest_ms;      /* a view that did not change for this long is at rest */
    size_t stream_bytes; /* limit of unacknowledged frame bytes per client */
    uint64_t frame_px;   /* largest frame; 0 = the limit of sp/view.h */
    struct srv_metrics *metrics; /* NULL = nothing is counted */
    void *user;
    void (*ready)(void *user); /* a participant has something to send */
    /* changed(): a session has something to save. ended(): a session ended. NULL = nothing is
     * persisted. */
    void (*changed)(void *user);
    void (*ended)(void *user, const char *id);
    /* Returns the last saved text of a session: malloc'ed, NUL-terminated. NULL = nothing is
     * persisted, and idle sessions end instead of hibernating. */
    char *(*recall)(void *user, const char *id, size_t *size, struct sp_error *err);
    /* Gets the current rights (enum srv_right) and quota of the token with this name. False: the
     * token is gone, and its last known quota stays valid. NULL = rights and quotas never change.
     */
    bool (*token)(void *user, const char *name, unsigned *rights, struct srv_quota *quota);
    /* The queue that measures parts and paths for streams; the answers come later. Owned by the
     * caller, who stops it before the hub is destroyed. NULL = they are measured at once. */
    struct srv_work_queue *measuring;
    /* The same for measurements that read samples: regions, profiles and markers. */
    struct srv_work_queue *sampling;
    /* The queue that answers picks of streams; owned like `measuring`. NULL = streams cannot
     * pick. */
    struct srv_work_queue *picking;
    /* True if the renderer can draw this view. NULL = it can draw every view. */
    bool (*supports)(void *user, const struct sp_view *view, struct sp_error *err);
};

struct srv_hub *srv_hub_create(const struct srv_hub_options *options, struct sp_error *err);
/* Call it after every participant left and every render job ended. */
void srv_hub_destroy(struct srv_hub **hub);

/* Sessions. The caller owns returned JSON; NULL with *err set. */

/* Applies `base` and then `patch` to the default view of a volume: the volume that `base` names, or
 * else `patch`, or else the first volume. NULL or an empty object changes nothing. The caller
 * releases *volume. For views that come over HTTP. */
bool srv_hub_resolve_view(struct srv_hub *hub, const proto_json *base, const proto_json *patch,
                          struct sp_view *view, struct srv_volume **volume, struct sp_error *err);

/* Returns {"id", "tokens": {"control", "view"}, "view"}. If too many sessions are active, the least
 * recently used session without participants hibernates first, provided that it is saved; otherwise
 * SP_ERR_BUDGET. SP_ERR_QUOTA over the owner's limit, which also counts hibernated sessions. A
 * guest holds only a join token. Its session counts for the owner, whose guests may use only a part
 * of the owner's share. It makes no other session hibernate, and gets SP_ERR_DENIED once the
 * owner's token is gone. */
proto_json *srv_hub_session_create(struct srv_hub *hub, const proto_json *patch,
                                   const struct srv_owner *owner, bool is_guest, double now_ms,
                                   char id[SRV_SESSION_ID_BYTES], struct sp_error *err);
/* Applies changed tokens to active sessions. Streams are closed with 1008 if their token is gone,
 * if it gives a lower role than they have, or if the token that created the session is gone. */
void srv_hub_renew_tokens(struct srv_hub *hub);
/* Gets the owner of an active or hibernated session; the name is empty if there is no such session
 * or no owner. */
void srv_hub_session_owner(struct srv_hub *hub, const char *id, struct srv_owner *owner);
/* Returns {"id", "view", "participants"}; `with_tokens` adds "tokens". This and all other functions
 * with an id, except delete, authorize and list, make a hibernated session active. SP_ERR_NOT_READY
 * with the reason if that is not possible yet, SP_ERR_BUDGET if too many are active. */
proto_json *srv_hub_session_get(struct srv_hub *hub, const char *id, bool with_tokens,
                                double now_ms, struct sp_error *err);
/* Merges a patch; returns the new view. */
proto_json *srv_hub_session_patch(struct srv_hub *hub, const char *id, const proto_json *patch,
                                  double now_ms, struct sp_error *err);
/* True if the daemon stops: measurements that take time must not begin. */
bool srv_hub_is_draining(struct srv_hub *hub);
/* Copies the measurements of a session; the caller finishes the copy. */
bool srv_hub_measures(struct srv_hub *hub, const char *id, double now_ms,
                      struct srv_measures *measures, struct sp_error *err);
struct srv_measure_request {
    const char *id; /* NULL: a new measurement */
    enum srv_measure_change change;
    const proto_json *body;
    const char *author; /* of a new measurement */
};
struct srv_measure_answer {
    char id[PROTO_MEASURE_ID_MAX + 1];
    bool is_new; /* it was added */
    size_t size; /* of the text */
};
/* Adds or changes a measurement. Returns it as JSON text, malloc'ed. The text is made before the
 * change, so that nothing changes when memory runs out. SP_ERR_NOT_FOUND, SP_ERR_QUOTA,
 * SP_ERR_MEMORY, and the errors of measure.put. */
char *srv_hub_measure_put(struct srv_hub *hub, const char *session,
                          const struct srv_measure_request *request, double now_ms,
                          struct srv_measure_answer *answer, struct sp_error *err);
bool srv_hub_measure_remove(struct srv_hub *hub, const char *session, const char *id, double now_ms,
                            struct sp_error *err);
/* Copies the measurements of the session `from` to the new session `to`. If `from` is not the id of
 * a session, nothing is copied. SP_ERR_MEMORY. */
bool srv_hub_measures_fork(struct srv_hub *hub, const char *from, const char *to, double now_ms,
                           struct sp_error *err);
/* True if a guest forked this session and it has not hibernated since. Then its control token may
 * end it. */
bool srv_hub_session_is_guests(struct srv_hub *hub, const char *id);
/* Ends the session and closes its streams. */
bool srv_hub_session_delete(struct srv_hub *hub, const char *id, struct sp_error *err);
/* Gets the role of a join token. SP_ERR_NOT_FOUND (no such session), SP_ERR_DENIED (wrong token).
 */
bool srv_hub_authorize(struct srv_hub *hub, const char *id, const char *token, enum srv_role *role,
                       struct sp_error *err);
/* True if one more participant can join now; `token` as for srv_hub_join(). SP_ERR_NOT_FOUND,
 * SP_ERR_BUDGET. */
bool srv_hub_can_join(struct srv_hub *hub, const char *id, const char *token, double now_ms,
                      struct sp_error *err);

struct srv_session_info {
    char id[SRV_SESSION_ID_BYTES]; /* first, as struct srv_page requires */
    char volume[SP_NAME_BYTES];
    char owner[SRV_TOKEN_NAME_BYTES]; /* "" = no owner */
    bool is_hibernated;
    unsigned participants;
    double idle_ms; /* since its last use; 0 with participants */
};
/* Adds all active and hibernated sessions of an owner (NULL = of all owners) to a page of struct
 * srv_session_info. */
void srv_hub_list(struct srv_hub *hub, const char *owner, double now_ms, struct srv_page *page);

/* Hibernates or ends idle sessions and passes control on. Returns the time until the next call, ms,
 * at most 1000. */
double srv_hub_tick(struct srv_hub *hub, double now_ms);
/* Notifies all participants of a volume's state ("loading", "ready", "failed", "unloaded"), its
 * progress in [0, 1], and the reason of a failure ("" = none). Participants that join later are not
 * notified of unloaded volumes. Sessions whose layers name a volume that is ready now get new
 * frames. */
void srv_hub_volume_progress(struct srv_hub *hub, const char *id, const char *state,
                             double progress, const char *reason, double now_ms);
/* Call it when loading a time step of the volume ended, with or without success. Sessions that wait
 * for the step show it. */
void srv_hub_step_loaded(struct srv_hub *hub, const char *id, double now_ms);
/* Call it when a volume was removed. Active sessions that show it change to the default view of the
 * first ready volume, or end if there is none. Call it after the source no longer finds the volume.
 * Hibernated sessions keep its name. */
void srv_hub_close_volume(struct srv_hub *hub, const char *id, double now_ms);
/* Returns how many sessions with participants show the volume. */
unsigned srv_hub_volume_sessions(struct srv_hub *hub, const char *id);
/* Sets the backend and the device that stream.stats reports, and notifies all participants. */
void srv_hub_set_backend(struct srv_hub *hub, const char *backend, const char *device);
/* Call it when the daemon shuts down. Notifies all participants; no more sessions are created. */
void srv_hub_drain(struct srv_hub *hub);

struct srv_hub_numbers {
    unsigned sessions, hibernated; /* active, hibernated */
    unsigned participants[2];      /* by enum srv_role */
};
void srv_hub_numbers(struct srv_hub *hub, struct srv_hub_numbers *numbers);

/* Persistence. */

/* Calls save() for each session whose view or time of use changed since its last save. save() must
 * not call the hub. False: save() failed, or memory ran out; call again later. */
bool srv_hub_save(struct srv_hub *hub, double now_ms,
                  bool (*save)(void *user, const char *id, const char *text, size_t size),
                  void *user);
/* Adds a saved session as hibernated since its last use; recall() must return the same text.
 * SP_ERR_FORMAT if the text does not describe a session. */
bool srv_hub_restore(struct srv_hub *hub, const char *id, const char *text, size_t size,
                     double now_ms, struct sp_error *err);

#endif
