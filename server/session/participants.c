/* SPDX-License-Identifier: Apache-2.0
 *
 * Participants join and leave.
 */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/fair_share.h"
#include "session/session.h"

enum { QUALITY_DEFAULT = 90, FPS_DEFAULT = 30 };

/* Colours of participants, chosen for colour-blind readers (Okabe and Ito 2008) and a dark
 * background. */
static const char *const palette[] = { "#56b4e9", "#e69f00", "#009e73", "#f0e442",
                                       "#cc79a7", "#d55e00", "#3d8ee0", "#cccccc" };
enum { COLORS = sizeof palette / sizeof *palette };

/* Returns the colour that the fewest participants have; of several, the first. */
static unsigned free_color(const struct srv_session *session) {
    unsigned uses[COLORS] = { 0 }, best = 0;
    for (const struct srv_participant *p = session->participants; p; p = p->next)
        uses[p->identity.color]++;
    for (unsigned i = 1; i < COLORS; i++)
        best = uses[i] < uses[best] ? i : best;
    return best;
}

/* True for the owner of the session and for admins. */
static bool may_use_all(const struct srv_hub *hub, const struct srv_session *session,
                        const char *token) {
    struct srv_quota unused;
    unsigned rights = 0;
    if (!token[0] || strcmp(session->identity.owner.name, token) == 0)
        return token[0];
    if (hub->options.token)
        hub->options.token(hub->options.user, token, &rights, &unused);
    return rights & SRV_RIGHT_ADMIN;
}

/* The last place is kept for the owner of the session and admins while only guests are there.
 * Another token has a fair share. */
static bool has_capacity(const struct srv_hub *hub, const struct srv_session *session,
                         const char *token, struct sp_error *err) {
    const unsigned most = hub->options.participants_max;
    struct srv_pool pool = { most, session->participant_count, 0 };
    for (const struct srv_participant *p = session->participants; p; p = p->next)
        pool.own += strcmp(p->identity.token, token) == 0;
    uint64_t left = srv_fair_left(&pool, token[0] && !may_use_all(hub, session, token));
    if (!token[0] && most >= SRV_FAIR_LEAST && left == 1 && pool.own + 1 == most)
        left = 0;
    return left > 0 || sp_fail(err, SP_ERR_BUDGET, NULL,
                               "the session has %u participants, %u of them %s, and --participants "
                               "allows %u; a place is kept for its owner",
                               session->participant_count, (unsigned)pool.own,
                               token[0] ? "by this token" : "guests", most);
}

bool srv_hub_can_join(struct srv_hub *hub, const char *id, const char *token, double now_ms,
                      struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find(hub, id, now_ms, err);
    bool is_free = session && has_capacity(hub, session, token, err);
    pthread_mutex_unlock(&hub->mutex);
    return is_free;
}

static struct srv_participant *alloc_participant(const struct srv_hub *hub) {
    struct srv_participant *p = calloc(1, sizeof *p);
    const size_t bytes = hub->observer.participant_bytes;
    if (!p || (bytes && !(p->schedule = calloc(1, bytes)))) {
        free(p);
        return NULL;
    }
    return p;
}

static void free_participant(struct srv_participant *p) {
    free(p->schedule);
    srv_late_answers_free(p);
    free(p);
}

/* The next number that is free: after a restart, guests return with the numbers that they had. */
static void set_default_name(struct srv_session *session, struct srv_participant *p) {
    const struct srv_participant *other = NULL;
    do {
        snprintf(p->identity.name, sizeof p->identity.name, "Guest %u", session->next_guest++);
        other = session->participants;
        while (other && strcmp(other->identity.name, p->identity.name) != 0)
            other = other->next;
    } while (other);
}

struct srv_participant *srv_hub_join(struct srv_hub *hub, const char *id, enum srv_role role,
                                     const char *token, void *user, double now_ms,
                                     struct sp_error *err) {
    struct srv_participant *p = alloc_participant(hub);
    if (!p) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a participant");
        return NULL;
    }
    p->user = user;
    p->identity.role = role;
    snprintf(p->identity.token, sizeof p->identity.token, "%s", token);
    p->settings.format = SP_IMAGE_JPEG;
    p->settings.video = p->settings.slow_video = SP_VIDEO_CODEC_COUNT;
    p->settings.quality = QUALITY_DEFAULT;
    p->settings.progressive = true;
    p->pending.stats_ms = now_ms;
    srv_congestion_init(&p->delivery.congestion_window);
    srv_rate_control_init(&p->delivery.rate_control);
    srv_outbox_init(&p->delivery.outbox);
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find(hub, id, now_ms, err);
    p->session = session;
    const char *why = session ? srv_hub_denies(hub, p) : NULL;
    if (why)
        sp_fail(err, SP_ERR_DENIED, NULL, "%s", why);
    if (why || (session && !has_capacity(hub, session, token, err)))
        session = NULL;
    if (session) {
        p->settings.wanted_fps = FPS_DEFAULT;
        p->settings.max_fps = srv_owner_fps(&session->identity.owner, p->settings.wanted_fps);
        p->identity.id = ++hub->participants.next_id;
        p->pending.volume_start = hub->volumes.clock;
        p->identity.color = free_color(session);
        set_default_name(session, p);
        p->next = session->participants;
        session->participants = p;
        session->participant_count++;
        hub->participants.count++;
        hub->participants.by_role[role]++;
        srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_PARTICIPANTS);
        srv_hub_notify(
            hub, p,
            SRV_NOTIFY_VIEW | SRV_NOTIFY_CONTROL | SRV_NOTIFY_POLICY |
                (session->measures.count > 0 ? SRV_NOTIFY_MEASURES : 0) |
                (srv_play_is_on(session) || session->shared.steps > 1 ? SRV_NOTIFY_TIME : 0) |
                (hub->is_draining ? SRV_NOTIFY_DRAINING : 0));
        srv_hub_emit(hub, SRV_PARTICIPANT_JOINED, session, p, now_ms);
    }
    pthread_mutex_unlock(&hub->mutex);
    if (!session) {
        free_participant(p);
        return NULL;
    }
    return p;
}

static void unlink_ready(struct srv_hub *hub, struct srv_participant *p) {
    struct srv_participant *previous = NULL;
    for (struct srv_participant *q = hub->participants.ready_head; q != p; q = q->next_ready)
        previous = q;
    if (previous)
        previous->next_ready = p->next_ready;
    else
        hub->participants.ready_head = p->next_ready;
    if (hub->participants.ready_tail == p)
        hub->participants.ready_tail = previous;
    p->is_ready = false;
}

void srv_hub_leave(struct srv_hub *hub, struct srv_participant **participant, double now_ms) {
    struct srv_participant *p = *participant;
    *participant = NULL;
    if (!p)
        return;
    pthread_mutex_lock(&hub->mutex);
    if (p->is_ready)
        unlink_ready(hub, p);
    if (p->delivery.outbox.blob)
        srv_hub_count_drop(hub, SRV_COUNT_DROP_LEFT);
    struct srv_session *session = p->session;
    if (session) {
        struct srv_participant **link = &session->participants;
        while (*link != p)
            link = &(*link)->next;
        *link = p->next;
        session->participant_count--;
        hub->participants.count--;
        hub->participants.by_role[p->identity.role]--;
        session->empty_ms = now_ms;
        if (session->participant_count == 0) {
            srv_hub_emit(hub, SRV_SESSION_EMPTIED, session, NULL, now_ms);
            srv_timer_set_by(&hub->active.timers, &session->timer,
                             now_ms + hub->options.session_idle_ms);
        }
        srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_PARTICIPANTS);
        srv_control_leave(hub, session, p, now_ms);
    }
    pthread_mutex_unlock(&hub->mutex);
    srv_outbox_finish(&p->delivery.outbox);
    free_participant(p);
}

void *srv_hub_pop_ready(struct srv_hub *hub) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *p = hub->participants.ready_head;
    if (p)
        unlink_ready(hub, p);
    pthread_mutex_unlock(&hub->mutex);
    return p ? p->user : NULL;
}

const char *srv_hub_first_color(void) {
    return palette[0];
}

const char *srv_hub_color(const struct srv_participant *participant) {
    return palette[participant->identity.color];
}

proto_json *srv_hub_encode_holder(const struct srv_session *session) {
    return session->holder ? proto_json_new_integer((int64_t)session->holder->identity.id)
                           : proto_json_new_null();
}

proto_json *srv_hub_encode_participants(const struct srv_session *session) {
    proto_json *list = proto_json_array();
    for (const struct srv_participant *p = session->participants; p; p = p->next) {
        proto_json *one = proto_json_object();
        proto_json_set_integer(&one, "id", (int64_t)p->identity.id);
        proto_json_set_string(&one, "role",
                              p->identity.role == SRV_ROLE_CONTROL ? "control" : "view");
        proto_json_set_string(&one, "name", p->identity.name);
        proto_json_set_string(&one, "color", palette[p->identity.color]);
        proto_json_append(&list, one);
    }
    return list;
}

uint64_t srv_participant_id(const struct srv_participant *participant) {
    return participant->identity.id;
}
