/* SPDX-License-Identifier: Apache-2.0 */
#include "session/delivery.h"

#include "session/session.h"

/* Returns the session of the frame; NULL = it ended. */
static struct srv_session *find_session(struct srv_hub *hub, const struct srv_drawn_frame *frame) {
    struct srv_session *session = srv_hub_find_active(hub, frame->id);
    /* It may have hibernated and become active again meanwhile. */
    return session && session->identity.number == frame->session ? session : NULL;
}

/* Returns a participant of the frame's session; NULL = it left. */
static struct srv_participant *find_participant(struct srv_hub *hub,
                                                const struct srv_drawn_frame *frame,
                                                const struct srv_frame_target *target) {
    const struct srv_session *session = find_session(hub, frame);
    struct srv_participant *p = session ? session->participants : NULL;
    while (p && p->identity.id != target->participant)
        p = p->next;
    return p;
}

/* Tells the rate control how large a moving frame became. */
static void learn(struct srv_participant *p, const struct srv_drawn_frame *drawn,
                  const struct srv_frame_target *target, const struct proto_frame_header *header,
                  size_t bytes) {
    bool is_video = proto_codec_is_video(header->codec);
    if (!drawn->is_moving || (is_video && header->flags & PROTO_FRAME_KEY))
        return;
    const struct srv_rate_frame frame = {
        .is_video = is_video,
        .is_lossless = !is_video && sp_image_format_info(target->format)->is_lossless,
        .quality = target->quality,
        .size = { header->width, header->height },
        .full_size = { drawn->full[0], drawn->full[1] },
        .bytes = bytes,
    };
    srv_rate_control_learn(&p->delivery.rate_control, &frame);
}

static bool put(struct srv_hub *hub, struct srv_participant *p, const struct srv_drawn_frame *frame,
                const struct srv_frame_target *target, const struct proto_frame_header *header,
                struct srv_blob *blob) {
    struct srv_outbox *outbox = &p->delivery.outbox;
    struct proto_frame_header full = *header;
    full.flags |= target->final ? PROTO_FRAME_FINAL : 0;
    full.seq = target->seq;
    full.flags |= blob->image_at > 0 ? PROTO_FRAME_DEPTH : 0;
    full.payload_bytes = (uint32_t)(blob->size - blob->image_at);
    bool replaces = outbox->blob != NULL;
    bool is_put = srv_outbox_put(outbox, frame->order, &full, blob);
    learn(p, frame, target, &full, blob->size);
    if (is_put) {
        outbox->updated_ms = target->updated_ms;
        srv_hub_notify(hub, p, 0);
    }
    if (!is_put || replaces)
        srv_hub_count_drop(hub, is_put ? SRV_COUNT_DROP_REPLACED : SRV_COUNT_DROP_LATE);
    return is_put;
}

void srv_hub_deliver(struct srv_hub *hub, const struct srv_drawn_frame *frame,
                     const struct srv_frame_target *target, const struct proto_frame_header *header,
                     struct srv_blob *blob) {
    struct proto_frame_header image = *header;
    image.flags |= PROTO_FRAME_KEY;
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *p = find_participant(hub, frame, target);
    if (p) {
        const struct srv_outbox *outbox = &p->delivery.outbox;
        bool holds_video = outbox->blob && proto_codec_is_video(outbox->header.codec);
        if (put(hub, p, frame, target, &image, blob) && holds_video)
            p->delivery.mark.epoch = 0; /* the replaced video frame never arrives */
    } else {
        srv_hub_count_drop(hub, SRV_COUNT_DROP_LEFT);
    }
    pthread_mutex_unlock(&hub->mutex);
}

/* Does it still ask for the video of its target? */
static bool is_video_asked(const struct srv_participant *p, const struct srv_frame_target *target) {
    return target->video == p->settings.video || target->video == p->settings.slow_video;
}

static void set_refused(struct srv_hub *hub, struct srv_participant *p, bool is_refused) {
    if (p->delivery.is_video_refused != is_refused)
        srv_hub_notify(hub, p, SRV_NOTIFY_POLICY);
    p->delivery.is_video_refused = is_refused;
}

void srv_hub_refuse_video(struct srv_hub *hub, const struct srv_drawn_frame *frame,
                          const struct srv_frame_target *targets, uint32_t count, uint64_t set) {
    pthread_mutex_lock(&hub->mutex);
    for (uint32_t i = 0; i < count; i++) {
        struct srv_participant *p = find_participant(hub, frame, &targets[i]);
        if (p && set >> i & 1 && is_video_asked(p, &targets[i]))
            set_refused(hub, p, true);
    }
    pthread_mutex_unlock(&hub->mutex);
}

static bool has_all_before(const struct srv_participant *p, const struct srv_video_mark *next) {
    const struct srv_video_mark *mark = &p->delivery.mark;
    return mark->epoch && mark->epoch == next->epoch && mark->number == next->number;
}

static bool is_target(const struct srv_frame_target *targets, uint32_t count,
                      const struct srv_participant *p) {
    for (uint32_t i = 0; i < count; i++)
        if (targets[i].participant == p->identity.id)
            return true;
    return false;
}

bool srv_hub_has_video(struct srv_hub *hub, const struct srv_drawn_frame *frame,
                       const struct srv_frame_target *targets, uint32_t count,
                       const struct srv_video_mark *next) {
    bool has = false;
    pthread_mutex_lock(&hub->mutex);
    const struct srv_session *s = find_session(hub, frame);
    for (const struct srv_participant *p = s ? s->participants : NULL; p; p = p->next)
        has = has || (has_all_before(p, next) && !is_target(targets, count, p));
    pthread_mutex_unlock(&hub->mutex);
    return has;
}

enum srv_video_need srv_hub_video_need(struct srv_hub *hub, const struct srv_drawn_frame *frame,
                                       const struct srv_frame_target *target,
                                       const struct srv_video_mark *next) {
    enum srv_video_need need = SRV_VIDEO_NONE;
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *p = find_participant(hub, frame, target);
    if (!p)
        srv_hub_count_drop(hub, SRV_COUNT_DROP_LEFT);
    if (p && is_video_asked(p, target))
        set_refused(hub, p, false);
    if (p && frame->order > p->delivery.outbox.order)
        need = p->delivery.outbox.blob   ? SRV_VIDEO_WAITS
               : has_all_before(p, next) ? SRV_VIDEO_DELTA
                                         : SRV_VIDEO_KEY;
    pthread_mutex_unlock(&hub->mutex);
    return need;
}

void srv_hub_deliver_video(struct srv_hub *hub, const struct srv_drawn_frame *frame,
                           const struct srv_frame_target *target,
                           const struct proto_frame_header *header, struct srv_blob *blob,
                           const struct srv_video_mark *mark) {
    pthread_mutex_lock(&hub->mutex);
    struct srv_participant *p = find_participant(hub, frame, target);
    bool fits = p && !p->delivery.outbox.blob &&
                (mark->number == 0 || (p->delivery.mark.epoch == mark->epoch &&
                                       p->delivery.mark.number == mark->number));
    if (fits && put(hub, p, frame, target, header, blob))
        p->delivery.mark = (struct srv_video_mark){ mark->epoch, mark->number + 1 };
    else if (!p)
        srv_hub_count_drop(hub, SRV_COUNT_DROP_LEFT);
    pthread_mutex_unlock(&hub->mutex);
}
