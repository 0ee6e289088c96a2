/* SPDX-License-Identifier: Apache-2.0 */
#include "session/hub.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/pagination.h"
#include "config/tokens.h"
#include "protocol/view.h"
#include "session/hub_private.h"
#include "sp/log.h"

#define RETRY_MS 1000.0 /* where memory is short */

struct srv_hub *srv_hub_create(const struct srv_hub_options *options, struct sp_error *err) {
    struct srv_hub *hub = calloc(1, sizeof *hub);
    if (!hub) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for the sessions");
        return NULL;
    }
    assert(options->participants_max >= 1 && options->participants_max <= SRV_PARTICIPANTS_MAX);
    hub->options = *options;
    pthread_mutex_init(&hub->mutex, NULL);
    return hub;
}

static void session_free(struct srv_hub *hub, struct srv_session *session) {
    assert(!session->participants);
    hub->options.volumes.release(hub->options.volumes.user, session->volume);
    free(session);
}

void srv_hub_destroy(struct srv_hub **hub_pointer) {
    struct srv_hub *hub = *hub_pointer;
    *hub_pointer = NULL;
    if (!hub)
        return;
    while (hub->sessions) {
        struct srv_session *session = hub->sessions;
        hub->sessions = session->next;
        session_free(hub, session);
    }
    srv_hub_free_sleepers(hub);
    pthread_mutex_destroy(&hub->mutex);
    free(hub);
}

struct srv_session *srv_hub_find_awake(struct srv_hub *hub, const char *id) {
    struct srv_session *s = hub->awake[srv_hub_bucket(id)];
    while (s && strcmp(s->id, id) != 0)
        s = s->next_awake;
    return s;
}

struct srv_session *srv_hub_find(struct srv_hub *hub, const char *id, double now_ms,
                                 struct sp_error *err) {
    struct srv_session *session = srv_hub_find_awake(hub, id);
    return session ? session : srv_hub_wake(hub, id, now_ms, err);
}

double srv_hub_used_ms(const struct srv_session *session) {
    return fmax(session->empty_ms, session->changed_ms);
}

void srv_hub_notify(struct srv_hub *hub, struct srv_participant *participant, unsigned notes) {
    participant->notes |= notes;
    if (participant->is_ready)
        return;
    participant->is_ready = true;
    participant->next_ready = NULL;
    if (hub->ready_tail)
        hub->ready_tail->next_ready = participant;
    else
        hub->ready_head = participant;
    hub->ready_tail = participant;
    hub->options.ready(hub->options.user);
}

void srv_hub_notify_others(struct srv_hub *hub, struct srv_session *session, uint64_t but,
                           unsigned notes) {
    for (struct srv_participant *p = session->participants; p; p = p->next)
        if (p->id != but)
            srv_hub_notify(hub, p, notes);
}

bool srv_hub_allows_size(const struct srv_hub *hub, const uint32_t size[2], struct sp_error *err) {
    uint64_t px = (uint64_t)size[0] * size[1], most = hub->options.frame_px;
    return !most || px <= most ||
           sp_fail(err, SP_ERR_INVALID, "/size",
                   "%u x %u are %llu px, and --frame-size allows %llu", size[0], size[1],
                   (unsigned long long)px, (unsigned long long)most);
}

/* Larger than allowed, or nothing that the renderer can draw? */
static bool can_show(const struct srv_hub *hub, const struct sp_view *view, struct sp_error *err) {
    return srv_hub_allows_size(hub, view->size, err) &&
           (!hub->options.supports || hub->options.supports(hub->options.user, view, err));
}

bool srv_hub_resolve_view(struct srv_hub *hub, const proto_json *base, const proto_json *patch,
                          struct sp_view *view, void **volume, struct sp_error *err) {
    const struct srv_volume_source *source = &hub->options.volumes;
    const char *of_base = base ? proto_view_volume(base) : NULL;
    const char *id = of_base || !patch ? of_base : proto_view_volume(patch);
    *volume = source->acquire(source->user, id, err);
    if (!*volume)
        return false;
    source->default_view(source->user, *volume, view);
    struct sp_view defaults = *view;
    if ((!base || proto_view_apply(base, &defaults, view, err)) &&
        (!patch || proto_view_apply(patch, &defaults, view, err)) && can_show(hub, view, err))
        return true;
    source->release(source->user, *volume);
    *volume = NULL;
    return false;
}

bool srv_hub_apply(struct srv_hub *hub, struct srv_session *session, const proto_json *patch,
                   uint64_t by, double now_ms, struct sp_error *err) {
    const struct srv_volume_source *source = &hub->options.volumes;
    const char *id = proto_view_volume(patch);
    void *volume = NULL;
    struct sp_view view = session->view, defaults;
    if (id && strcmp(id, session->view.volume) != 0) {
        volume = source->acquire(source->user, id, err);
        if (!volume)
            return false;
        source->default_view(source->user, volume, &view);
        defaults = view;
        memcpy(view.size, session->view.size, sizeof view.size);
        memcpy(view.background, session->view.background, sizeof view.background);
    } else {
        source->default_view(source->user, session->volume, &defaults);
    }
    if (!proto_view_apply(patch, &defaults, &view, err) || !can_show(hub, &view, err) ||
        (memcmp(view.size, session->view.size, sizeof view.size) != 0 &&
         !srv_owner_allows_size(&session->owner, view.size, err))) {
        if (volume)
            source->release(source->user, volume);
        return false;
    }
    if (volume || memcmp(&session->view.transfer_function, &view.transfer_function,
                         sizeof view.transfer_function) != 0)
        session->cold_version = session->version + 1;
    session->view = view;
    if (volume) {
        source->release(source->user, session->volume);
        session->volume = volume;
        session->volume_version = session->version + 1;
        srv_hub_first_pace(hub, session);
    }
    for (struct srv_participant *p = session->participants; p; p = p->next)
        if (p->taken_version == session->version)
            p->behind_ms = now_ms;
    session->version++;
    session->changed_by = by;
    session->changed_ms = now_ms;
    srv_hub_unsaved(hub, session);
    srv_hub_notify_others(hub, session, by, SRV_NOTIFY_VIEW);
    /* Of another volume's picture nothing is of use to the next one. */
    bool useless = volume && !session->must_finish;
    hub->options.interrupt(hub->options.user, session->number,
                           useless ? SRV_INTERRUPT_UNWANTED : SRV_INTERRUPT_NEWER_VIEW);
    srv_hub_work(hub, session);
    return true;
}

void srv_hub_count_drop(struct srv_hub *hub, enum srv_counter reason) {
    if (!hub->draining)
        srv_metrics_add(hub->options.metrics, reason, 1);
}

void srv_hub_abandon(struct srv_hub *hub, const struct srv_session *session) {
    hub->options.interrupt(hub->options.user, session->number, SRV_INTERRUPT_UNWANTED);
}

void srv_hub_size(const struct srv_session *session, const struct srv_participant *participant,
                  uint32_t size[2]) {
    for (int i = 0; i < 2; i++)
        size[i] = participant->size[0] ? participant->size[i] : session->view.size[i];
    srv_owner_fit_size(&session->owner, size); /* which may allow less than when it was set */
}

void srv_hub_ended(struct srv_hub *hub, const char *id) {
    if (hub->options.ended)
        hub->options.ended(hub->options.user, id);
}

static proto_json *encode_session(const struct srv_session *session, bool with_tokens,
                                  struct sp_error *err) {
    proto_json *json = proto_json_object();
    bool ok = proto_json_set_string(json, "id", session->id);
    if (with_tokens) {
        proto_json *tokens = proto_json_object();
        ok = proto_json_set_string(tokens, "control", session->tokens[SRV_ROLE_CONTROL]) && ok;
        ok = proto_json_set_string(tokens, "view", session->tokens[SRV_ROLE_VIEW]) && ok;
        ok = proto_json_set(json, "tokens", tokens) && ok;
    }
    ok = proto_json_set(json, "view", proto_view_encode(&session->view)) && ok;
    ok = (session->holder ? proto_json_set_integer(json, "holder", (int64_t)session->holder->id)
                          : proto_json_set_null(json, "holder")) &&
         ok;
    ok = proto_json_set(json, "participants", srv_hub_encode_participants(session)) && ok;
    if (!ok) {
        proto_json_free(&json);
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for the answer");
    }
    return json;
}

/* It sleeps or ends then, if nobody uses it meanwhile. */
static double end_of_use_ms(const struct srv_hub *hub, const struct srv_session *session) {
    return srv_hub_used_ms(session) + hub->options.session_idle_ms;
}

void srv_hub_link_session(struct srv_hub *hub, struct srv_session *session, double now_ms) {
    session->version = session->cold_version = session->next_guest = 1;
    session->changed_ms = session->empty_ms = now_ms;
    srv_hub_first_pace(hub, session);
    session->number = ++hub->next_number;
    session->next = hub->sessions;
    session->link = &hub->sessions;
    if (hub->sessions)
        hub->sessions->link = &session->next;
    hub->sessions = session;
    struct srv_session **bucket = &hub->awake[srv_hub_bucket(session->id)];
    session->next_awake = *bucket;
    *bucket = session;
    hub->session_count++;
    session->due.of = session->unsaved.of = session;
    srv_timer_set(&hub->dues, &session->due, end_of_use_ms(hub, session));
}

/* May this owner have one more session, awake or asleep? */
static bool has_quota(const struct srv_hub *hub, const struct srv_owner *owner,
                      struct sp_error *err) {
    unsigned most = owner->quota.sessions, awake = 0;
    if (!most)
        return true;
    for (const struct srv_session *s = hub->sessions; s; s = s->next)
        awake += strcmp(s->owner.name, owner->name) == 0;
    unsigned asleep = srv_hub_count_sleepers(hub, owner->name);
    return awake + asleep < most ||
           sp_fail(err, SP_ERR_QUOTA, NULL,
                   "%s has %u sessions, of which %u sleep, and its token allows %u; delete some",
                   owner->name, awake + asleep, asleep, most);
}

bool srv_hub_renew_quota(const struct srv_hub *hub, struct srv_owner *owner) {
    unsigned unused;
    return !hub->options.token || !owner->name[0] ||
           hub->options.token(hub->options.user, owner->name, &unused, &owner->quota);
}

static void tell_to_leave(struct srv_hub *hub, struct srv_participant *p, uint16_t code,
                          const char *reason) {
    p->close_code = code;
    p->close_reason = reason;
    srv_hub_notify(hub, p, SRV_NOTIFY_CLOSE);
}

const char *srv_hub_denies(const struct srv_hub *hub, const struct srv_participant *p) {
    struct srv_quota unused;
    unsigned rights;
    enum srv_role role;
    if (!hub->options.token || !p->token[0])
        return NULL;
    if (!hub->options.token(hub->options.user, p->token, &rights, &unused))
        return "the token is not valid any more";
    bool takes_part = srv_owner_role(&p->session->owner, p->token, rights, &role);
    return takes_part && role >= p->role ? NULL : "the role of the token is a lower one";
}

void srv_hub_renew_tokens(struct srv_hub *hub) {
    pthread_mutex_lock(&hub->mutex);
    for (struct srv_session *s = hub->sessions; s; s = s->next) {
        bool had_token = s->has_token;
        s->has_token = srv_hub_renew_quota(hub, &s->owner);
        for (struct srv_participant *p = s->participants; p; p = p->next) {
            const char *why = srv_hub_denies(hub, p);
            p->max_fps = srv_owner_fps(&s->owner, p->wanted_fps);
            srv_hub_notify(hub, p, SRV_NOTIFY_POLICY); /* of a size that may be another one */
            if (why)
                tell_to_leave(hub, p, 1008, why);
            else if (had_token && !s->has_token)
                tell_to_leave(hub, p, 1008,
                              "the token that made the session is not valid any more");
        }
    }
    pthread_mutex_unlock(&hub->mutex);
}

/* How many of `most` there may be before a guest, or who is none, makes one more. */
static unsigned limit_for(bool is_guest, unsigned most) {
    return is_guest ? most - most / 4 : most;
}

static bool session_add(struct srv_hub *hub, struct srv_session *session, bool is_guest,
                        double now_ms, struct sp_error *err) {
    const unsigned awake_max = limit_for(is_guest, hub->options.sessions_max);
    const unsigned asleep_max = limit_for(is_guest, hub->options.sleepers_max);
    if (hub->draining)
        return sp_fail(err, SP_ERR_BUDGET, NULL, "the daemon is shutting down");
    const char *whom = is_guest ? " guests" : "";
    if (hub->options.recall && hub->sleeper_count >= asleep_max)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "%u sessions sleep and --sleeping-sessions allows%s %u; delete some",
                       hub->sleeper_count, whom, asleep_max);
    if (is_guest && !srv_hub_renew_quota(hub, &session->owner))
        return sp_fail(err, SP_ERR_DENIED, NULL,
                       "the token that made the session is not valid any more; a fork needs one of "
                       "the daemon's own");
    if (!has_quota(hub, &session->owner, err))
        return false;
    if (is_guest ? hub->session_count >= awake_max : !srv_hub_make_room(hub))
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "%u sessions are open and --sessions allows%s %u; try again later",
                       hub->session_count, whom, awake_max);
    session->has_token = true;
    srv_hub_link_session(hub, session, now_ms);
    srv_hub_unsaved(hub, session);
    return true;
}

proto_json *srv_hub_session_create(struct srv_hub *hub, const proto_json *patch, double now_ms,
                                   char id[SRV_SESSION_ID_BYTES], struct sp_error *err) {
    const struct srv_owner nobody = { .name = "" };
    return srv_hub_session_create_owned(hub, patch, &nobody, false, now_ms, id, err);
}

void srv_hub_session_owner(struct srv_hub *hub, const char *id, struct srv_owner *owner) {
    *owner = (struct srv_owner){ .name = "" };
    pthread_mutex_lock(&hub->mutex);
    const struct srv_session *session = srv_hub_find_awake(hub, id);
    if (session) {
        *owner = session->owner;
    } else {
        snprintf(owner->name, sizeof owner->name, "%s", srv_hub_sleeping_owner(hub, id));
        srv_hub_renew_quota(hub, owner);
    }
    pthread_mutex_unlock(&hub->mutex);
}

proto_json *srv_hub_session_create_owned(struct srv_hub *hub, const proto_json *patch,
                                         const struct srv_owner *owner, bool is_guest,
                                         double now_ms, char id[SRV_SESSION_ID_BYTES],
                                         struct sp_error *err) {
    struct srv_session *session = calloc(1, sizeof *session);
    if (!session) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a session");
        return NULL;
    }
    if (!srv_hub_resolve_view(hub, NULL, patch, &session->view, &session->volume, err)) {
        free(session);
        return NULL;
    }
    proto_json *json = NULL;
    session->owner = *owner;
    pthread_mutex_lock(&hub->mutex);
    bool ok = srv_owner_allows_size(owner, session->view.size, err) &&
              srv_secret_hex(session->id, sizeof session->id - 1, err) &&
              srv_secret_hex(session->tokens[0], SRV_TOKEN_DIGITS, err) &&
              srv_secret_hex(session->tokens[1], SRV_TOKEN_DIGITS, err) &&
              (json = encode_session(session, true, err)) &&
              session_add(hub, session, is_guest, now_ms, err);
    if (ok)
        memcpy(id, session->id, sizeof session->id);
    pthread_mutex_unlock(&hub->mutex);
    if (!ok) {
        proto_json_free(&json);
        session_free(hub, session);
    }
    return json;
}

proto_json *srv_hub_session_get(struct srv_hub *hub, const char *id, bool with_tokens,
                                double now_ms, struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find(hub, id, now_ms, err);
    proto_json *json = session ? encode_session(session, with_tokens, err) : NULL;
    pthread_mutex_unlock(&hub->mutex);
    return json;
}

proto_json *srv_hub_session_patch(struct srv_hub *hub, const char *id, const proto_json *patch,
                                  double now_ms, struct sp_error *err) {
    proto_json *json = NULL;
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find(hub, id, now_ms, err);
    if (session && srv_hub_apply(hub, session, patch, 0, now_ms, err)) {
        json = proto_view_encode(&session->view);
        if (!json)
            sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for the answer");
    }
    pthread_mutex_unlock(&hub->mutex);
    return json;
}

static void session_unlink(struct srv_hub *hub, struct srv_session *session) {
    *session->link = session->next;
    if (session->next)
        session->next->link = session->link;
    struct srv_session **link = &hub->awake[srv_hub_bucket(session->id)];
    while (*link != session)
        link = &(*link)->next_awake;
    *link = session->next_awake;
    hub->session_count--;
    srv_timer_clear(&hub->dues, &session->due);
    srv_timer_clear(&hub->unsaved, &session->unsaved);
    srv_turn_rest(hub, session);
    srv_hub_abandon(hub, session);
}

/* Participants stay, without a session, and are told to leave. */
static void session_remove(struct srv_hub *hub, struct srv_session *session) {
    session_unlink(hub, session);
    srv_hub_ended(hub, session->id);
    while (session->participants) {
        struct srv_participant *p = session->participants;
        session->participants = p->next;
        hub->participant_count--;
        hub->role_counts[p->role]--;
        p->session = NULL;
        tell_to_leave(hub, p, 1000, "the session was deleted");
    }
    session_free(hub, session);
}

bool srv_hub_session_delete(struct srv_hub *hub, const char *id, struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find_awake(hub, id);
    bool found =
        session || srv_hub_forget_sleeper(hub, id) ||
        sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no session '%s'; it may have ended", id);
    if (session)
        session_remove(hub, session);
    else if (found)
        srv_hub_ended(hub, id);
    pthread_mutex_unlock(&hub->mutex);
    return found;
}

bool srv_hub_authorize(struct srv_hub *hub, const char *id, const char *token, enum srv_role *role,
                       struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    const struct srv_session *session = srv_hub_find_awake(hub, id);
    const char *tokens[2];
    for (int r = 0; r < 2; r++)
        tokens[r] =
            session ? session->tokens[r] : srv_hub_sleeping_token(hub, id, (enum srv_role)r);
    bool ok = false;
    if (!tokens[0]) {
        sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no session '%s'; it may have ended", id);
    } else {
        bool control = srv_secret_equal(tokens[SRV_ROLE_CONTROL], token);
        bool view = srv_secret_equal(tokens[SRV_ROLE_VIEW], token);
        *role = control ? SRV_ROLE_CONTROL : SRV_ROLE_VIEW;
        ok = control || view ||
             sp_fail(err, SP_ERR_DENIED, NULL,
                     "this is no token of that session; POST /api/v1/sessions gives one");
    }
    pthread_mutex_unlock(&hub->mutex);
    return ok;
}

/* Its view. */
static bool is_saved(const struct srv_session *session) {
    return session->saved_version == session->version;
}

static bool fall_asleep(struct srv_hub *hub, struct srv_session *session, const char *why) {
    if (!srv_hub_add_sleeper(hub, session))
        return false;
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", session->id }), "session %s sleeps: %s",
                session->id, why);
    session_unlink(hub, session);
    session_free(hub, session);
    return true;
}

bool srv_hub_make_room(struct srv_hub *hub) {
    struct srv_session *idle = NULL;
    if (hub->session_count < hub->options.sessions_max)
        return true;
    for (struct srv_session *s = hub->options.recall ? hub->sessions : NULL; s; s = s->next)
        if (!s->participants && is_saved(s) &&
            (!idle || srv_hub_used_ms(s) < srv_hub_used_ms(idle)))
            idle = s;
    if (idle)
        fall_asleep(hub, idle, "others need room (--sessions)");
    return hub->session_count < hub->options.sessions_max;
}

/* It is no longer used: it ends, or falls asleep as soon as it is saved and there is memory. */
static void retire(struct srv_hub *hub, struct srv_session *session, double now_ms) {
    char why[64];
    snprintf(why, sizeof why, "nobody joined for %.0f s (--session-time)",
             hub->options.session_idle_ms / 1000);
    if (!hub->options.recall) {
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", session->id }), "session %s ended: %s",
                    session->id, why);
        session_remove(hub, session);
    } else if (!is_saved(session)) {
        srv_hub_unsaved(hub, session);
    } else if (!fall_asleep(hub, session, why)) {
        srv_timer_set(&hub->dues, &session->due, now_ms + RETRY_MS);
    }
}

void srv_hub_saved(struct srv_hub *hub, struct srv_session *session) {
    if (session->participant_count == 0)
        srv_timer_set_by(&hub->dues, &session->due, end_of_use_ms(hub, session));
}

/* Does what is due of it, and sets when something is next. */
static void look_at(struct srv_hub *hub, struct srv_session *session, double now_ms) {
    bool is_used = session->participant_count > 0;
    double at_ms = is_used ? srv_control_tick(hub, session, now_ms) : end_of_use_ms(hub, session);
    if (at_ms > now_ms)
        srv_timer_set(&hub->dues, &session->due, at_ms);
    else
        retire(hub, session, now_ms);
}

double srv_hub_tick(struct srv_hub *hub, double now_ms) {
    pthread_mutex_lock(&hub->mutex);
    for (struct srv_session *s; (s = srv_timer_take(&hub->dues, now_ms));)
        look_at(hub, s, now_ms);
    double next_ms = fmin(srv_timer_next(&hub->dues), srv_hub_end_sleepers(hub, now_ms));
    srv_hub_note_time(hub, now_ms);
    pthread_mutex_unlock(&hub->mutex);
    return fmin(next_ms - now_ms, 1000);
}

void srv_hub_list(struct srv_hub *hub, const char *owner, double now_ms, struct srv_page *page) {
    pthread_mutex_lock(&hub->mutex);
    for (const struct srv_session *s = hub->sessions; s; s = s->next) {
        if (owner && strcmp(s->owner.name, owner) != 0)
            continue;
        struct srv_session_info *note = srv_page_slot(page, s->id);
        if (!note)
            continue;
        *note = (struct srv_session_info){ .participants = s->participant_count };
        note->idle_ms = s->participants ? 0 : now_ms - srv_hub_used_ms(s);
        memcpy(note->id, s->id, sizeof note->id);
        memcpy(note->volume, s->view.volume, sizeof note->volume);
        memcpy(note->owner, s->owner.name, sizeof note->owner);
    }
    srv_hub_list_sleepers(hub, owner, now_ms, page);
    pthread_mutex_unlock(&hub->mutex);
}

void srv_hub_volume_progress(struct srv_hub *hub, const char *id, const char *state,
                             double progress, const char *reason) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_volume_news *note = NULL;
    for (unsigned i = 0; i < hub->volume_count; i++)
        if (strcmp(hub->volumes[i].id, id) == 0)
            note = &hub->volumes[i];
    if (!note && hub->volume_count < SRV_HUB_VOLUMES)
        note = &hub->volumes[hub->volume_count++];
    if (!note) { /* the one that changed least recently */
        note = &hub->volumes[0];
        for (unsigned i = 1; i < SRV_HUB_VOLUMES; i++)
            if (hub->volumes[i].clock < note->clock)
                note = &hub->volumes[i];
    }
    snprintf(note->id, sizeof note->id, "%s", id);
    snprintf(note->state, sizeof note->state, "%s", state);
    snprintf(note->reason, sizeof note->reason, "%s", reason);
    note->progress = progress;
    note->clock = ++hub->volume_clock;
    for (struct srv_session *s = hub->sessions; s; s = s->next)
        srv_hub_notify_others(hub, s, 0, 0);
    pthread_mutex_unlock(&hub->mutex);
}

void srv_hub_set_backend(struct srv_hub *hub, const char *backend, const char *device) {
    pthread_mutex_lock(&hub->mutex);
    snprintf(hub->backend, sizeof hub->backend, "%s", backend);
    snprintf(hub->device, sizeof hub->device, "%s", device);
    for (struct srv_session *s = hub->sessions; s; s = s->next)
        srv_hub_notify_others(hub, s, 0, SRV_NOTIFY_STATS);
    pthread_mutex_unlock(&hub->mutex);
}

void srv_hub_drain(struct srv_hub *hub) {
    pthread_mutex_lock(&hub->mutex);
    hub->draining = true;
    for (struct srv_session *s = hub->sessions; s; s = s->next)
        srv_hub_notify_others(hub, s, 0, SRV_NOTIFY_DRAINING);
    pthread_mutex_unlock(&hub->mutex);
}

void srv_hub_numbers(struct srv_hub *hub, struct srv_hub_numbers *numbers) {
    *numbers = (struct srv_hub_numbers){ .sessions = 0 };
    pthread_mutex_lock(&hub->mutex);
    numbers->sessions = hub->session_count;
    numbers->asleep = hub->sleeper_count;
    memcpy(numbers->participants, hub->role_counts, sizeof hub->role_counts);
    pthread_mutex_unlock(&hub->mutex);
}
