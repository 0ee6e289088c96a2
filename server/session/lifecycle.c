/* SPDX-License-Identifier: Apache-2.0
 *
 * The hub: active sessions, their timers, and notifications to participants.
 */

#include "session/hub.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/pagination.h"
#include "session/session.h"
#include "sp/log.h"

#define RETRY_MS 1000.0 /* until a hibernation is tried again that lacked memory */

struct srv_hub *srv_hub_create(const struct srv_hub_options *options, struct sp_error *err) {
    struct srv_hub *hub = calloc(1, sizeof *hub);
    if (!hub) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the sessions");
        return NULL;
    }
    assert(options->participants_max >= 1 && options->participants_max <= SRV_PARTICIPANTS_MAX);
    hub->options = *options;
    pthread_mutex_init(&hub->mutex, NULL);
    return hub;
}

void srv_hub_observe(struct srv_hub *hub, const struct srv_session_observer *observer) {
    pthread_mutex_lock(&hub->mutex);
    assert(!hub->active.first);
    hub->observer = *observer;
    pthread_mutex_unlock(&hub->mutex);
}

void srv_hub_emit(struct srv_hub *hub, enum srv_session_event event, struct srv_session *session,
                  struct srv_participant *participant, double now_ms) {
    if (hub->observer.event)
        hub->observer.event(hub->observer.user, event, session, participant, now_ms);
}

struct srv_session *srv_hub_alloc_session(const struct srv_hub *hub) {
    struct srv_session *session = calloc(1, sizeof *session);
    const size_t bytes = hub->observer.session_bytes;
    if (!session || (bytes && !(session->schedule = calloc(1, bytes)))) {
        free(session);
        return NULL;
    }
    return session;
}

void srv_hub_free_session(struct srv_hub *hub, struct srv_session *session) {
    assert(!session->participants);
    srv_steps_release(hub, session);
    if (session->shared.volume)
        hub->options.volumes.release(hub->options.volumes.user, session->shared.volume);
    srv_measures_finish(&session->measures);
    free(session->text.bytes);
    free(session->schedule);
    free(session);
}

void srv_hub_destroy(struct srv_hub **hub_pointer) {
    struct srv_hub *hub = *hub_pointer;
    *hub_pointer = NULL;
    if (!hub)
        return;
    while (hub->active.first) {
        struct srv_session *session = hub->active.first;
        hub->active.first = session->next;
        srv_hub_free_session(hub, session);
    }
    srv_hibernated_free(hub);
    pthread_mutex_destroy(&hub->mutex);
    free(hub);
}

struct srv_session *srv_hub_find_active(struct srv_hub *hub, const char *id) {
    struct srv_session *s = hub->active.buckets[srv_hub_bucket(id)];
    while (s && strcmp(s->identity.id, id) != 0)
        s = s->next_in_bucket;
    return s;
}

struct srv_session *srv_hub_find(struct srv_hub *hub, const char *id, double now_ms,
                                 struct sp_error *err) {
    struct srv_session *session = srv_hub_find_active(hub, id);
    return session ? session : srv_hibernated_resume(hub, id, now_ms, err);
}

double srv_hub_used_ms(const struct srv_session *session) {
    return fmax(session->empty_ms, session->shared.changed_ms);
}

void srv_hub_ended(struct srv_hub *hub, const char *id) {
    if (hub->options.ended)
        hub->options.ended(hub->options.user, id);
}

/* Returns when the session hibernates or ends, unless it is used before. */
static double end_of_use_ms(const struct srv_hub *hub, const struct srv_session *session) {
    return srv_hub_used_ms(session) + hub->options.session_idle_ms;
}

void srv_hub_link_session(struct srv_hub *hub, struct srv_session *session, double now_ms) {
    session->shared.version = session->next_guest = 1;
    session->shared.changed_ms = session->empty_ms = now_ms;
    session->identity.number = ++hub->active.next_number;
    srv_steps_follow(hub, session);
    session->next = hub->active.first;
    session->link = &hub->active.first;
    if (hub->active.first)
        hub->active.first->link = &session->next;
    hub->active.first = session;
    struct srv_session **bucket = &hub->active.buckets[srv_hub_bucket(session->identity.id)];
    session->next_in_bucket = *bucket;
    *bucket = session;
    hub->active.count++;
    session->timer.of = session->saved.unsaved.of = session;
    srv_timer_set(&hub->active.timers, &session->timer, end_of_use_ms(hub, session));
    srv_hub_emit(hub, SRV_SESSION_STARTED, session, NULL, now_ms);
}

static void unlink_session(struct srv_hub *hub, struct srv_session *session) {
    *session->link = session->next;
    if (session->next)
        session->next->link = session->link;
    struct srv_session **link = &hub->active.buckets[srv_hub_bucket(session->identity.id)];
    while (*link != session)
        link = &(*link)->next_in_bucket;
    *link = session->next_in_bucket;
    hub->active.count--;
    srv_timer_clear(&hub->active.timers, &session->timer);
    srv_timer_clear(&hub->persistence.unsaved, &session->saved.unsaved);
    srv_hub_emit(hub, SRV_SESSION_ENDED, session, NULL, 0);
}

/* Participants stay without a session until their streams are closed. */
static void end_session(struct srv_hub *hub, struct srv_session *session, const char *why) {
    unlink_session(hub, session);
    srv_hub_ended(hub, session->identity.id);
    while (session->participants) {
        struct srv_participant *p = session->participants;
        session->participants = p->next;
        hub->participants.count--;
        hub->participants.by_role[p->identity.role]--;
        p->session = NULL;
        srv_hub_close_stream(hub, p, 1000, why);
    }
    srv_hub_free_session(hub, session);
}

void srv_hub_end_session(struct srv_hub *hub, struct srv_session *session) {
    end_session(hub, session, "the session was deleted");
}

bool srv_hub_is_view_saved(const struct srv_session *session) {
    return session->saved.version == session->shared.version &&
           session->saved.measures_clock == session->measures.clock;
}

bool srv_hub_hibernate(struct srv_hub *hub, struct srv_session *session, const char *why) {
    if (!srv_hibernated_add(hub, session))
        return false;
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", session->identity.id }),
                "session %s hibernates: %s", session->identity.id, why);
    unlink_session(hub, session);
    srv_hub_free_session(hub, session);
    return true;
}

/* Ends an unused session, or hibernates it once it is saved; tries again later if memory is short.
 */
static void retire(struct srv_hub *hub, struct srv_session *session, double now_ms) {
    char why[64];
    snprintf(why, sizeof why, "no client joined for %.0f s (--session-time)",
             hub->options.session_idle_ms / 1000);
    if (!hub->options.recall) {
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", session->identity.id }),
                    "session %s ended: %s", session->identity.id, why);
        srv_hub_end_session(hub, session);
    } else if (!srv_hub_is_view_saved(session)) {
        srv_hub_unsaved(hub, session);
    } else if (!srv_hub_hibernate(hub, session, why)) {
        srv_timer_set(&hub->active.timers, &session->timer, now_ms + RETRY_MS);
    }
}

void srv_hub_saved(struct srv_hub *hub, struct srv_session *session) {
    if (session->participant_count == 0)
        srv_timer_set_by(&hub->active.timers, &session->timer, end_of_use_ms(hub, session));
}

/* Handles the session's timer and sets it again. */
static void handle_timer(struct srv_hub *hub, struct srv_session *session, double now_ms) {
    bool is_used = session->participant_count > 0;
    double at_ms = is_used ? srv_control_tick(hub, session, now_ms) : end_of_use_ms(hub, session);
    if (at_ms > now_ms)
        srv_timer_set(&hub->active.timers, &session->timer, at_ms);
    else
        retire(hub, session, now_ms);
}

double srv_hub_tick(struct srv_hub *hub, double now_ms) {
    pthread_mutex_lock(&hub->mutex);
    for (struct srv_session *s; (s = srv_timer_pop(&hub->active.timers, now_ms));)
        handle_timer(hub, s, now_ms);
    double next_ms = fmin(srv_timer_next(&hub->active.timers), srv_hibernated_tick(hub, now_ms));
    srv_hub_note_time(hub, now_ms);
    pthread_mutex_unlock(&hub->mutex);
    return fmin(next_ms - now_ms, 1000);
}

void srv_hub_notify(struct srv_hub *hub, struct srv_participant *participant, unsigned notes) {
    participant->pending.notifications |= notes;
    if (participant->is_ready)
        return;
    participant->is_ready = true;
    participant->next_ready = NULL;
    if (hub->participants.ready_tail)
        hub->participants.ready_tail->next_ready = participant;
    else
        hub->participants.ready_head = participant;
    hub->participants.ready_tail = participant;
    hub->options.ready(hub->options.user);
}

void srv_hub_notify_others(struct srv_hub *hub, struct srv_session *session, uint64_t but,
                           unsigned notes) {
    for (struct srv_participant *p = session->participants; p; p = p->next)
        if (p->identity.id != but)
            srv_hub_notify(hub, p, notes);
}

bool srv_hub_is_draining(struct srv_hub *hub) {
    pthread_mutex_lock(&hub->mutex);
    const bool is_draining = hub->is_draining;
    pthread_mutex_unlock(&hub->mutex);
    return is_draining;
}

void srv_hub_count_drop(struct srv_hub *hub, enum srv_counter reason) {
    if (!hub->is_draining)
        srv_metrics_add(hub->options.metrics, reason, 1);
}

static bool has_layer_of(const struct sp_view *view, const char *id) {
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].visible &&
            (strcmp(view->layers[i].id, id) == 0 || strcmp(view->layers[i].color_by, id) == 0))
            return true;
    return false;
}

/* Before, the frames of such sessions failed. They need a time step of the volume now. */
static void renew_frames_with(struct srv_hub *hub, const char *id, double now_ms) {
    for (struct srv_session *s = hub->active.first; s; s = s->next)
        if (has_layer_of(&s->shared.view, id)) {
            srv_steps_follow(hub, s);
            s->shared.version++;
            s->shared.image++;
            s->shared.changed_ms = now_ms;
            srv_hub_emit(hub, SRV_VIEW_CHANGED, s, NULL, now_ms);
        }
}

/* Sessions keep no memory of a volume that only their layers name. */
static void drop_steps_of(struct srv_hub *hub, const char *id) {
    for (struct srv_session *s = hub->active.first; s; s = s->next)
        if (has_layer_of(&s->shared.view, id))
            srv_steps_follow(hub, s);
}

void srv_hub_volume_progress(struct srv_hub *hub, const char *id, const char *state,
                             double progress, const char *reason, double now_ms) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_volume_news *note = NULL;
    for (unsigned i = 0; i < hub->volumes.count; i++)
        if (strcmp(hub->volumes.news[i].id, id) == 0)
            note = &hub->volumes.news[i];
    if (!note && hub->volumes.count < SRV_HUB_VOLUMES)
        note = &hub->volumes.news[hub->volumes.count++];
    if (!note) { /* replace the volume that changed least recently */
        note = &hub->volumes.news[0];
        for (unsigned i = 1; i < SRV_HUB_VOLUMES; i++)
            if (hub->volumes.news[i].clock < note->clock)
                note = &hub->volumes.news[i];
    }
    snprintf(note->id, sizeof note->id, "%s", id);
    snprintf(note->state, sizeof note->state, "%s", state);
    snprintf(note->reason, sizeof note->reason, "%s", reason);
    note->progress = progress;
    note->clock = ++hub->volumes.clock;
    for (struct srv_session *s = hub->active.first; s; s = s->next)
        srv_hub_notify_others(hub, s, 0, 0);
    if (strcmp(state, "ready") == 0)
        renew_frames_with(hub, id, now_ms);
    else if (strcmp(state, "unloaded") == 0)
        drop_steps_of(hub, id);
    pthread_mutex_unlock(&hub->mutex);
}

/* Returns a patch to the first volume that is ready; NULL = there is none, or memory is out. */
static proto_json *patch_to_first_volume(const struct srv_hub *hub) {
    const struct srv_volume_source *source = &hub->options.volumes;
    struct sp_view view;
    struct srv_volume *volume = source->acquire(source->user, NULL, NULL);
    if (!volume)
        return NULL;
    source->default_view(source->user, volume, &view);
    source->release(source->user, volume);
    proto_json *patch = proto_json_object();
    proto_json_set_string(&patch, "volume", view.volume);
    return patch;
}

void srv_hub_close_volume(struct srv_hub *hub, const char *id, double now_ms) {
    pthread_mutex_lock(&hub->mutex);
    proto_json *patch = patch_to_first_volume(hub);
    for (struct srv_session *next, *s = hub->active.first; s; s = next) {
        next = s->next;
        if (strcmp(s->shared.view.volume, id) != 0)
            continue;
        snprintf(s->shared.closed, sizeof s->shared.closed, "%s", id);
        bool is_moved = patch && srv_hub_apply(hub, s, patch, 0, now_ms, NULL);
        sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "session", s->identity.id }, { "volume", id }),
                    "session %s %s: its volume %s was closed", s->identity.id,
                    is_moved ? "shows another volume" : "ended", id);
        if (!is_moved)
            end_session(hub, s, "its volume was closed and no other is loaded");
    }
    proto_json_free(&patch);
    pthread_mutex_unlock(&hub->mutex);
}

unsigned srv_hub_volume_sessions(struct srv_hub *hub, const char *id) {
    unsigned count = 0;
    pthread_mutex_lock(&hub->mutex);
    for (struct srv_session *s = hub->active.first; s; s = s->next)
        count += s->participant_count > 0 && strcmp(s->shared.view.volume, id) == 0;
    pthread_mutex_unlock(&hub->mutex);
    return count;
}

void srv_hub_set_backend(struct srv_hub *hub, const char *backend, const char *device) {
    pthread_mutex_lock(&hub->mutex);
    snprintf(hub->backend, sizeof hub->backend, "%s", backend);
    snprintf(hub->device, sizeof hub->device, "%s", device);
    for (struct srv_session *s = hub->active.first; s; s = s->next)
        srv_hub_notify_others(hub, s, 0, SRV_NOTIFY_STATS);
    pthread_mutex_unlock(&hub->mutex);
}

void srv_hub_drain(struct srv_hub *hub) {
    pthread_mutex_lock(&hub->mutex);
    hub->is_draining = true;
    for (struct srv_session *s = hub->active.first; s; s = s->next)
        srv_hub_notify_others(hub, s, 0, SRV_NOTIFY_DRAINING);
    pthread_mutex_unlock(&hub->mutex);
}

void srv_hub_numbers(struct srv_hub *hub, struct srv_hub_numbers *numbers) {
    *numbers = (struct srv_hub_numbers){ .sessions = 0 };
    pthread_mutex_lock(&hub->mutex);
    numbers->sessions = hub->active.count;
    numbers->hibernated = hub->hibernated.count;
    memcpy(numbers->participants, hub->participants.by_role, sizeof hub->participants.by_role);
    pthread_mutex_unlock(&hub->mutex);
}
