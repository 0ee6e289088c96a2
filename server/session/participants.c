/* SPDX-License-Identifier: Apache-2.0
 *
 * Joining, leaving, and what to tell a participant next.
 */
#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/view.h"
#include "session/policy.h"

enum { QUALITY_DEFAULT = 90, FPS_DEFAULT = 30 };

/* Colours of participants, told apart also by most who see fewer (Okabe and Ito 2008), readable on
 * dark ground. */
static const char *const palette[] = { "#56b4e9", "#e69f00", "#009e73", "#f0e442",
                                       "#cc79a7", "#d55e00", "#3d8ee0", "#cccccc" };
enum { COLORS = sizeof palette / sizeof *palette };

/* The first of those that the fewest others have. */
static unsigned free_color(const struct srv_session *session) {
    unsigned uses[COLORS] = { 0 }, best = 0;
    for (const struct srv_participant *p = session->participants; p; p = p->next)
        uses[p->color]++;
    for (unsigned i = 1; i < COLORS; i++)
        best = uses[i] < uses[best] ? i : best;
    return best;
}

static bool has_room(const struct srv_hub *hub, const struct srv_session *session,
                     struct sp_error *err) {
    return session->participant_count < hub->options.participants_max ||
           sp_fail(err, SP_ERR_BUDGET, NULL,
                   "the session has %u participants and --participants allows %u",
                   session->participant_count, hub->options.participants_max);
}

bool srv_hub_can_join(struct srv_hub *hub, const char *id, double now_ms, struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find(hub, id, now_ms, err);
    bool room = session && has_room(hub, session, err);
    pthread_mutex_unlock(&hub->mutex);
    return room;
}

struct srv_participant *srv_hub_join(struct srv_hub *hub, const char *id, enum srv_role role,
                                     const char *token, void *user, double now_ms,
                                     struct sp_error *err) {
    struct srv_participant *p = calloc(1, sizeof *p);
    if (!p) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for a participant");
        return NULL;
    }
    p->user = user;
    p->role = role;
    snprintf(p->token, sizeof p->token, "%s", token);
    p->format = SP_IMAGE_JPEG;
    p->video = SP_VIDEO_CODEC_COUNT;
    p->quality = QUALITY_DEFAULT;
    p->progressive = true;
    p->stats_ms = p->behind_ms = now_ms;
    srv_window_init(&p->flow);
    srv_outbox_init(&p->outbox);
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find(hub, id, now_ms, err);
    p->session = session;
    const char *why = session ? srv_hub_denies(hub, p) : NULL;
    if (why)
        sp_fail(err, SP_ERR_DENIED, NULL, "%s", why);
    if (why || (session && !has_room(hub, session, err)))
        session = NULL;
    if (session) {
        p->wanted_fps = FPS_DEFAULT;
        p->max_fps = srv_owner_fps(&session->owner, p->wanted_fps);
        p->id = ++hub->next_participant;
        p->volume_start = hub->volume_clock;
        p->color = free_color(session);
        snprintf(p->name, sizeof p->name, "Guest %u", session->next_guest++);
        p->next = session->participants;
        session->participants = p;
        session->participant_count++;
        hub->participant_count++;
        hub->role_counts[role]++;
        srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_PARTICIPANTS);
        srv_hub_notify(hub, p,
                       SRV_NOTIFY_VIEW | SRV_NOTIFY_CONTROL | SRV_NOTIFY_POLICY |
                           (hub->draining ? SRV_NOTIFY_DRAINING : 0));
        srv_hub_work(hub, session);
    }
    pthread_mutex_unlock(&hub->mutex);
    if (!session) {
        free(p);
        return NULL;
    }
    return p;
}

static void unlink_ready(struct srv_hub *hub, struct srv_participant *p) {
    struct srv_participant *previous = NULL;
    for (struct srv_participant *q = hub->ready_head; q != p; q = q->next_ready)
        previous = q;
    if (previous)
        previous->next_ready = p->next_ready;
    else
        hub->ready_head = p->next_ready;
    if (hub->ready_tail == p)
        hub->ready_tail = previous;
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
    if (p->outbox.blob)
        srv_hub_count_drop(hub, SRV_COUNT_DROP_LEFT);
    struct srv_session *session = p->session;
    if (session) {
        struct srv_participant **link = &session->participants;
        while (*link != p)
            link = &(*link)->next;
        *link = p->next;
        session->participant_count--;
        hub->participant_count--;
        hub->role_counts[p->role]--;
        session->empty_ms = now_ms;
        if (session->participant_count == 0) {
            srv_hub_abandon(hub, session);
            srv_timer_set_by(&hub->dues, &session->due, now_ms + hub->options.session_idle_ms);
        }
        srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_PARTICIPANTS);
        srv_control_leave(hub, session, p, now_ms);
    }
    pthread_mutex_unlock(&hub->mutex);
    srv_outbox_finish(&p->outbox);
    free(p);
}

void *srv_hub_take_ready(struct srv_hub *hub) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *p = hub->ready_head;
    if (p)
        unlink_ready(hub, p);
    pthread_mutex_unlock(&hub->mutex);
    return p ? p->user : NULL;
}

proto_json *srv_hub_encode_participants(const struct srv_session *session) {
    proto_json *list = proto_json_array();
    bool ok = true;
    for (const struct srv_participant *p = session->participants; p; p = p->next) {
        proto_json *one = proto_json_object();
        ok = proto_json_set_integer(one, "id", (int64_t)p->id) && ok;
        ok = proto_json_set_string(one, "role", p->role == SRV_ROLE_CONTROL ? "control" : "view") &&
             ok;
        ok = proto_json_set_string(one, "name", p->name) && ok;
        ok = proto_json_set_string(one, "color", palette[p->color]) && ok;
        ok = proto_json_append(list, one) && ok;
    }
    if (!ok)
        proto_json_free(&list);
    return list;
}

static char *text_of_participants(const struct srv_participant *to, size_t *size) {
    proto_json *params = proto_json_object();
    bool ok = proto_json_set_integer(params, "you", (int64_t)to->id);
    ok = proto_json_set(params, "participants", srv_hub_encode_participants(to->session)) && ok;
    if (!ok)
        proto_json_free(&params);
    return proto_rpc_notification("session.participants", params, size);
}

static char *text_of_view(const struct srv_participant *to, size_t *size) {
    proto_json *params = proto_json_object();
    bool ok = proto_json_set_integer(params, "by", (int64_t)to->session->changed_by);
    ok = proto_json_set(params, "view", proto_view_encode(&to->session->view)) && ok;
    if (!ok)
        proto_json_free(&params);
    return proto_rpc_notification("view.changed", params, size);
}

static char *text_of_stats(const struct srv_hub *hub, const struct srv_participant *to,
                           size_t *size) {
    const struct srv_session *session = to->session;
    const struct srv_render_result *last = &session->last;
    proto_json *params = proto_json_object();
    bool ok = proto_json_set_string(params, "backend", hub->backend);
    ok = proto_json_set_string(params, "device", hub->device) && ok;
    ok = proto_json_set_number(params, "fps",
                               session->frame_ms > 0 ? 1000 / session->frame_ms : 0) &&
         ok;
    ok = proto_json_set_number(params, "render_ms", last->render_ms) && ok;
    ok = proto_json_set_number(params, "encode_ms", last->encode_ms) && ok;
    ok = proto_json_set_integer(params, "width", last->width) && ok;
    ok = proto_json_set_integer(params, "height", last->height) && ok;
    ok = proto_json_set_integer(params, "coarse", last->mip_level) && ok;
    ok = proto_json_set_integer(params, "splats", (int64_t)last->splats) && ok;
    ok = proto_json_set_integer(params, "visible_voxels", (int64_t)last->visible_voxels) && ok;
    ok = proto_json_set_number(params, "rtt_ms", srv_window_rtt_ms(&to->flow)) && ok;
    ok = proto_json_set_integer(params, "window", srv_window_frames(&to->flow, to->max_fps)) && ok;
    ok = proto_json_set_integer(params, "frames", (int64_t)to->frames_sent) && ok;
    ok = proto_json_set_integer(params, "bytes", (int64_t)to->bytes_sent) && ok;
    ok = proto_json_set_integer(params, "dropped", (int64_t)to->outbox.dropped) && ok;
    if (!ok)
        proto_json_free(&params);
    return proto_rpc_notification("stream.stats", params, size);
}

/* The volume whose news are oldest among those that `p` has not been told. */
static char *text_of_volume(const struct srv_hub *hub, struct srv_participant *p, size_t *size) {
    const struct srv_volume_news *note = NULL;
    for (unsigned i = 0; i < hub->volume_count; i++)
        if (hub->volumes[i].clock > p->volume_told &&
            (hub->volumes[i].clock > p->volume_start ||
             strcmp(hub->volumes[i].state, "unloaded") != 0) &&
            (!note || hub->volumes[i].clock < note->clock))
            note = &hub->volumes[i];
    if (!note)
        return NULL;
    p->volume_told = note->clock;
    proto_json *params = proto_json_object();
    bool ok = proto_json_set_string(params, "volume", note->id);
    ok = proto_json_set_string(params, "state", note->state) && ok;
    ok = proto_json_set_number(params, "progress", note->progress) && ok;
    if (note->reason[0])
        ok = proto_json_set_string(params, "reason", note->reason) && ok;
    if (!ok)
        proto_json_free(&params);
    return proto_rpc_notification("volume.progress", params, size);
}

static char *text_of_error(const struct srv_participant *p, size_t *size) {
    proto_json *params = proto_json_object();
    bool ok = proto_json_set_integer(params, "code", proto_rpc_code_from(p->error.code));
    ok = proto_json_set_string(params, "message", p->error.text) && ok;
    if (p->error.place[0])
        ok = proto_json_set_string(params, "pointer", p->error.place) && ok;
    if (!ok)
        proto_json_free(&params);
    return proto_rpc_notification("render.error", params, size);
}

/* The text for one note; clears its bit. */
static char *take_note(struct srv_hub *hub, struct srv_participant *p, double now_ms,
                       size_t *size) {
    if (p->notes & SRV_NOTIFY_DRAINING) {
        p->notes &= ~(unsigned)SRV_NOTIFY_DRAINING;
        return proto_rpc_notification("server.draining", proto_json_object(), size);
    }
    if (p->notes & SRV_NOTIFY_PARTICIPANTS) {
        p->notes &= ~(unsigned)SRV_NOTIFY_PARTICIPANTS;
        return text_of_participants(p, size);
    }
    if (p->notes & SRV_NOTIFY_CONTROL) {
        p->notes &= ~(unsigned)SRV_NOTIFY_CONTROL;
        return srv_control_text(hub, p, now_ms, size);
    }
    if (p->notes & SRV_NOTIFY_ERROR) {
        p->notes &= ~(unsigned)SRV_NOTIFY_ERROR;
        return text_of_error(p, size);
    }
    if (p->notes & SRV_NOTIFY_VIEW) {
        p->notes &= ~(unsigned)SRV_NOTIFY_VIEW;
        return text_of_view(p, size);
    }
    if (p->notes & SRV_NOTIFY_POLICY) {
        p->notes &= ~(unsigned)SRV_NOTIFY_POLICY;
        return srv_policy_text(p, now_ms, size);
    }
    if (p->notes & SRV_NOTIFY_STATS) {
        p->notes &= ~(unsigned)SRV_NOTIFY_STATS;
        p->stats_ms = now_ms;
        return text_of_stats(hub, p, size);
    }
    return text_of_volume(hub, p, size);
}

static void take_frame(struct srv_hub *hub, struct srv_participant *p, double now_ms,
                       struct srv_message *message) {
    srv_metrics_add(hub->options.metrics, SRV_COUNT_FRAMES, 1);
    message->blob = srv_outbox_take(&p->outbox, &message->header);
    message->header.frame = ++p->frame;
    srv_window_sent(&p->flow, p->frame, message->blob->size + PROTO_FRAME_HEADER_BYTES, now_ms);
    p->frames_sent++;
    p->bytes_sent += message->blob->size + PROTO_FRAME_HEADER_BYTES;
    if (now_ms - p->stats_ms >= 500)
        p->notes |= SRV_NOTIFY_STATS;
}

enum srv_message_kind srv_hub_next_message(struct srv_hub *hub, struct srv_participant *p,
                                           bool frames, double now_ms,
                                           struct srv_message *message) {
    enum srv_message_kind kind = SRV_MESSAGE_NONE;
    *message = (struct srv_message){ .text = NULL };
    pthread_mutex_lock(&hub->mutex);
    if (p->notes & SRV_NOTIFY_CLOSE) {
        kind = SRV_MESSAGE_CLOSE;
        message->close_code = p->close_code;
        message->reason = p->close_reason;
    } else if (p->session) {
        if (frames && p->outbox.blob && p->flow.count < SRV_WINDOW_MAX) {
            take_frame(hub, p, now_ms, message);
            if (p->video != SP_VIDEO_CODEC_COUNT) /* is_open() waits for it */
                srv_hub_work(hub, p->session);
            kind = SRV_MESSAGE_FRAME;
        } else if ((message->text = take_note(hub, p, now_ms, &message->size))) {
            kind = SRV_MESSAGE_TEXT;
        }
    }
    pthread_mutex_unlock(&hub->mutex);
    return kind;
}

double srv_hub_oldest_unacked_ms(struct srv_hub *hub, struct srv_participant *p) {
    pthread_mutex_lock(&hub->mutex);
    double oldest = srv_window_oldest_ms(&p->flow);
    pthread_mutex_unlock(&hub->mutex);
    return oldest;
}

uint64_t srv_participant_id(const struct srv_participant *participant) {
    return participant->id;
}
