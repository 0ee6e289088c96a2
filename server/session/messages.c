/* SPDX-License-Identifier: Apache-2.0
 *
 * The next message to a participant: a notification or a frame.
 */

#include <stdlib.h>
#include <string.h>

#include "protocol/view.h"
#include "session/session.h"

static char *text_of_participants(const struct srv_participant *to, size_t *size) {
    proto_json *params = proto_json_object();
    proto_json_set_integer(&params, "you", (int64_t)to->identity.id);
    proto_json_set(&params, "participants", srv_hub_encode_participants(to->session));
    return proto_rpc_notification("session.participants", params, size);
}

static char *encode_view(const struct srv_view_state *shared, size_t *size) {
    proto_json *params = proto_json_object();
    proto_json_set_integer(&params, "by", (int64_t)shared->changed_by);
    proto_json_set(&params, "view", proto_view_encode(&shared->view));
    return proto_rpc_notification("view.changed", params, size);
}

/* Copies the text of the view's version, which is encoded once for all participants. */
static char *text_of_view(struct srv_session *session, size_t *size) {
    struct srv_view_text *text = &session->text;
    if (!text->bytes || text->version != session->shared.version) {
        free(text->bytes);
        text->bytes = encode_view(&session->shared, &text->size);
        text->version = session->shared.version;
    }
    char *copy = text->bytes ? malloc(text->size + 1) : NULL;
    *size = text->size;
    return copy ? memcpy(copy, text->bytes, text->size + 1) : NULL;
}

/* Voxels: [[first], [past the last]]. */
static proto_json *encode_box(const uint32_t box[2][3]) {
    proto_json *json = proto_json_array();
    for (int side = 0; side < 2; side++)
        proto_json_append(&json, proto_json_integers(box[side], 3));
    return json;
}

/* Of a volume that is larger than memory. */
static void set_bricks(proto_json **params, const struct sp_frame_bricks *bricks) {
    if (bricks->memory_bytes == 0)
        return;
    proto_json *numbers = proto_json_object();
    proto_json_set_integer(&numbers, "resident", (int64_t)bricks->resident);
    proto_json_set_integer(&numbers, "wanted", (int64_t)bricks->wanted);
    proto_json_set_integer(&numbers, "level", bricks->level);
    proto_json_set_integer(&numbers, "asked", bricks->asked);
    proto_json_set_integer(&numbers, "lost", (int64_t)bricks->lost);
    proto_json_set_bool(&numbers, "complete", sp_frame_bricks_is_complete(bricks));
    if (bricks->lost)
        proto_json_set(&numbers, "lost_at", encode_box(bricks->lost_box));
    proto_json_set(params, "bricks", numbers);
    proto_json_set_integer(params, "memory", (int64_t)bricks->memory_bytes);
}

static char *text_of_stats(const struct srv_hub *hub, const struct srv_participant *to,
                           size_t *size) {
    const struct srv_session *session = to->session;
    const struct srv_session_stats *last = &session->stats;
    proto_json *params = proto_json_object();
    proto_json_set_string(&params, "backend", hub->backend);
    proto_json_set_string(&params, "device", hub->device);
    proto_json_set_number(&params, "fps", last->interval_ms > 0 ? 1000 / last->interval_ms : 0);
    proto_json_set_number(&params, "render_ms", last->render_ms);
    proto_json_set_number(&params, "encode_ms", last->encode_ms);
    proto_json_set_integer(&params, "width", last->width);
    proto_json_set_integer(&params, "height", last->height);
    proto_json_set_integer(&params, "coarse", last->mip_level);
    proto_json_set_integer(&params, "splats", (int64_t)last->splats);
    proto_json_set_integer(&params, "visible_voxels", (int64_t)last->visible_voxels);
    set_bricks(&params, &last->bricks);
    proto_json_set_number(&params, "rtt_ms",
                          srv_congestion_rtt_ms(&to->delivery.congestion_window));
    proto_json_set_number(&params, "bandwidth",
                          srv_congestion_rate(&to->delivery.congestion_window) * 1000);
    proto_json_set_integer(
        &params, "window",
        srv_congestion_frames(&to->delivery.congestion_window, to->settings.max_fps));
    proto_json_set_integer(&params, "frames", (int64_t)to->delivery.frames_sent);
    proto_json_set_integer(&params, "bytes", (int64_t)to->delivery.bytes_sent);
    proto_json_set_integer(&params, "dropped", (int64_t)to->delivery.outbox.dropped);
    return proto_rpc_notification("stream.stats", params, size);
}

/* True if the participant may learn about the volume. A watcher with a join token learns only about
 * volumes that the view names, and about the volume that was closed while the session showed it. */
static bool may_learn_of(const struct srv_participant *p, const char *id) {
    return p->identity.role != SRV_ROLE_VIEW || p->identity.token[0] ||
           srv_hub_view_names(&p->session->shared.view, id) ||
           strcmp(p->session->shared.closed, id) == 0;
}

/* Reports the volume that changed first since the last report to `p`. */
static char *text_of_volume(const struct srv_hub *hub, struct srv_participant *p, size_t *size) {
    const struct srv_volume_news *note = NULL;
    for (unsigned i = 0; i < hub->volumes.count; i++)
        if (hub->volumes.news[i].clock > p->pending.volume_reported &&
            (hub->volumes.news[i].clock > p->pending.volume_start ||
             strcmp(hub->volumes.news[i].state, "unloaded") != 0) &&
            (!note || hub->volumes.news[i].clock < note->clock) &&
            may_learn_of(p, hub->volumes.news[i].id))
            note = &hub->volumes.news[i];
    if (!note)
        return NULL;
    p->pending.volume_reported = note->clock;
    proto_json *params = proto_json_object();
    proto_json_set_string(&params, "volume", note->id);
    proto_json_set_string(&params, "state", note->state);
    proto_json_set_number(&params, "progress", note->progress);
    if (note->reason[0])
        proto_json_set_string(&params, "reason", note->reason);
    return proto_rpc_notification("volume.progress", params, size);
}

static char *text_of_error(const struct srv_participant *p, size_t *size) {
    proto_json *params = proto_json_object();
    proto_json_set_integer(&params, "code", proto_rpc_code_from(p->pending.error.code));
    proto_json_set_string(&params, "message", p->pending.error.text);
    if (p->pending.error.place[0])
        proto_json_set_string(&params, "pointer", p->pending.error.place);
    return proto_rpc_notification("render.error", params, size);
}

/* Returns the text of one pending answer, or of the end of the daemon, and clears it. */
static char *consume_urgent(struct srv_participant *p, size_t *size) {
    if (p->pending.answers)
        return srv_late_answer_pop(p, size);
    if (p->pending.notifications & SRV_NOTIFY_DRAINING) {
        p->pending.notifications &= ~(unsigned)SRV_NOTIFY_DRAINING;
        return proto_rpc_notification("server.draining", proto_json_object(), size);
    }
    return NULL;
}

/* Returns the text of one pending notification of a state and clears it. */
static char *consume_state(struct srv_hub *hub, struct srv_participant *p, double now_ms,
                           size_t *size) {
    if (p->pending.notifications & SRV_NOTIFY_PARTICIPANTS) {
        p->pending.notifications &= ~(unsigned)SRV_NOTIFY_PARTICIPANTS;
        return text_of_participants(p, size);
    }
    if (p->pending.notifications & SRV_NOTIFY_CONTROL) {
        p->pending.notifications &= ~(unsigned)SRV_NOTIFY_CONTROL;
        return srv_control_text(hub, p, now_ms, size);
    }
    if (p->pending.notifications & SRV_NOTIFY_ERROR) {
        p->pending.notifications &= ~(unsigned)SRV_NOTIFY_ERROR;
        return text_of_error(p, size);
    }
    if (p->pending.notifications & SRV_NOTIFY_VIEW) {
        p->pending.notifications &= ~(unsigned)SRV_NOTIFY_VIEW;
        return text_of_view(p->session, size);
    }
    if (p->pending.notifications & SRV_NOTIFY_MEASURES) {
        p->pending.notifications &= ~(unsigned)SRV_NOTIFY_MEASURES;
        return srv_measures_text(p, size);
    }
    if (p->pending.notifications & SRV_NOTIFY_TIME) {
        p->pending.notifications &= ~(unsigned)SRV_NOTIFY_TIME;
        return srv_play_text(p, size);
    }
    if (p->pending.notifications & SRV_NOTIFY_POLICY) {
        p->pending.notifications &= ~(unsigned)SRV_NOTIFY_POLICY;
        return srv_policy_text(p, now_ms, size);
    }
    if (p->pending.notifications & SRV_NOTIFY_STATS) {
        p->pending.notifications &= ~(unsigned)SRV_NOTIFY_STATS;
        p->pending.stats_ms = now_ms;
        return text_of_stats(hub, p, size);
    }
    return text_of_volume(hub, p, size);
}

/* Returns how long a frame that is sent now waited since its update arrived; 0 if the update was
 * shown before. */
static uint32_t queue_us_of(const struct srv_delivery *delivery,
                            const struct proto_frame_header *header, double now_ms) {
    double took_us = (now_ms - delivery->outbox.updated_ms) * 1000;
    double waited_us = took_us - header->render_us - (double)header->encode_us;
    if (header->seq == delivery->sent_seq || !(waited_us > 0))
        return 0;
    return waited_us < UINT32_MAX ? (uint32_t)waited_us : UINT32_MAX;
}

static void pop_frame(struct srv_hub *hub, struct srv_participant *p, double now_ms,
                      struct srv_message *message) {
    srv_metrics_add(hub->options.metrics, SRV_COUNT_FRAMES, 1);
    message->blob = srv_outbox_pop(&p->delivery.outbox, &message->header);
    message->header.frame = ++p->delivery.frame;
    message->header.queue_us = queue_us_of(&p->delivery, &message->header, now_ms);
    if (message->header.seq != p->delivery.sent_seq)
        srv_display_delay_sent(&p->delivery.display_delay, p->delivery.frame,
                               p->delivery.outbox.updated_ms);
    p->delivery.sent_seq = message->header.seq;
    srv_congestion_sent(&p->delivery.congestion_window, p->delivery.frame,
                        message->blob->size + PROTO_FRAME_HEADER_BYTES, now_ms);
    p->delivery.frames_sent++;
    p->delivery.bytes_sent += message->blob->size + PROTO_FRAME_HEADER_BYTES;
    if (now_ms - p->pending.stats_ms >= 500)
        p->pending.notifications |= SRV_NOTIFY_STATS;
}

enum srv_message_kind srv_hub_next_message(struct srv_hub *hub, struct srv_participant *p,
                                           enum srv_next allowed, double now_ms,
                                           struct srv_message *message) {
    enum srv_message_kind kind = SRV_MESSAGE_NONE;
    *message = (struct srv_message){ .text = NULL };
    pthread_mutex_lock(&hub->mutex);
    if (p->pending.notifications & SRV_NOTIFY_CLOSE) {
        kind = SRV_MESSAGE_CLOSE;
        message->close_code = p->pending.close_code;
        message->reason = p->pending.close_reason;
    } else if (p->session) {
        if (allowed != SRV_NEXT_NOTIFICATIONS && p->delivery.outbox.blob &&
            p->delivery.congestion_window.count < SRV_CONGESTION_MAX) {
            pop_frame(hub, p, now_ms, message);
            if (srv_policy_video(p) != SP_VIDEO_CODEC_COUNT) /* the next frame waits for that */
                srv_hub_emit(hub, SRV_CONGESTION_CHANGED, p->session, p, now_ms);
            kind = SRV_MESSAGE_FRAME;
        } else {
            message->text = consume_urgent(p, &message->size);
            if (!message->text && allowed != SRV_NEXT_FRAMES)
                message->text = consume_state(hub, p, now_ms, &message->size);
            kind = message->text ? SRV_MESSAGE_TEXT : SRV_MESSAGE_NONE;
        }
    }
    pthread_mutex_unlock(&hub->mutex);
    return kind;
}

double srv_hub_oldest_unacked_ms(struct srv_hub *hub, struct srv_participant *p) {
    pthread_mutex_lock(&hub->mutex);
    double oldest = srv_congestion_oldest_ms(&p->delivery.congestion_window);
    pthread_mutex_unlock(&hub->mutex);
    return oldest;
}

void srv_hub_arrived(struct srv_hub *hub, struct srv_participant *p, uint32_t frame, bool is_end,
                     double now_ms) {
    pthread_mutex_lock(&hub->mutex);
    srv_congestion_arrived(&p->delivery.congestion_window, frame, is_end, now_ms);
    pthread_mutex_unlock(&hub->mutex);
}

void srv_hub_ponged(struct srv_hub *hub, struct srv_participant *p, double rtt_ms, double now_ms) {
    pthread_mutex_lock(&hub->mutex);
    srv_congestion_ponged(&p->delivery.congestion_window, rtt_ms, now_ms);
    pthread_mutex_unlock(&hub->mutex);
}
