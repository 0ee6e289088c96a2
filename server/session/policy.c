/* SPDX-License-Identifier: Apache-2.0
 *
 * How frames are encoded for a participant, and the notification that tells it.
 */
#include <math.h>
#include <string.h>

#include "protocol/rpc.h"
#include "session/session.h"

#define TELL_MS 500.0

static bool has_quality(const struct srv_encoding *e) { /* the format beside video is JPEG */
    return !sp_image_format_info(e->format)->is_lossless;
}

enum sp_video_codec srv_policy_video(const struct srv_participant *p) {
    bool is_slow =
        p->delivery.rate_control.is_video && p->settings.slow_video != SP_VIDEO_CODEC_COUNT;
    return is_slow ? p->settings.slow_video : p->settings.video;
}

void srv_policy_update_rate(struct srv_participant *p) {
    const struct srv_rate_demand demand = {
        .bytes_per_ms = srv_congestion_rate(&p->delivery.congestion_window),
        .interval_ms =
            fmax(1000.0 / p->settings.max_fps, p->settings.depth ? SRV_WARP_INTERVAL_MS : 0),
        .takes_video = p->settings.slow_video != SP_VIDEO_CODEC_COUNT,
        .quality = p->settings.quality,
        .is_video_refused = p->delivery.is_video_refused,
    };
    srv_rate_control_update(&p->delivery.rate_control, &demand);
}

struct srv_encoding srv_policy_encoding(const struct srv_participant *p, enum srv_frame_step step) {
    bool moving = step == SRV_STEP_MOVING, final = step == SRV_STEP_FINAL;
    struct srv_encoding e = {
        .format = final && p->settings.lossless ? SP_IMAGE_PNG : p->settings.format,
        .video = final ? SP_VIDEO_CODEC_COUNT : srv_policy_video(p),
        .quality = p->settings.quality,
    };
    int most = srv_rate_control_step(&p->delivery.rate_control).quality;
    if (moving && has_quality(&e) && e.quality > most)
        e.quality = most;
    e.chroma = sp_chroma_at(p->settings.chroma, e.quality);
    return e;
}

bool srv_policy_is_final(const struct srv_participant *p, const struct srv_encoding *e) {
    const struct srv_encoding final = srv_policy_encoding(p, SRV_STEP_FINAL);
    const struct srv_encode_params form = srv_encode_params_from(e->format, e->quality, e->chroma);
    const struct srv_encode_params last =
        srv_encode_params_from(final.format, final.quality, final.chroma);
    return e->video == SP_VIDEO_CODEC_COUNT && srv_encode_params_equal(&form, &last);
}

static bool is_same(const struct srv_moving_detail *a, const struct srv_moving_detail *b) {
    return a->full_size[0] == b->full_size[0] && a->full_size[1] == b->full_size[1] &&
           a->size[0] == b->size[0] && a->size[1] == b->size[1] && a->mip_level == b->mip_level &&
           a->is_draft == b->is_draft && a->is_shared == b->is_shared &&
           a->rate_step == b->rate_step && a->is_video == b->is_video;
}

void srv_policy_update(struct srv_hub *hub, struct srv_participant *p,
                       const struct srv_moving_detail *moving, double now_ms) {
    if (moving)
        p->policy.moving = *moving;
    bool is_due = !moving || now_ms - p->policy.told_ms >= TELL_MS;
    if (is_due && !is_same(&p->policy.moving, &p->policy.reported))
        srv_hub_notify(hub, p, SRV_NOTIFY_POLICY);
}

static bool is_image(const struct srv_participant *p, const struct srv_encoding *e) {
    return e->video == SP_VIDEO_CODEC_COUNT || p->delivery.is_video_refused;
}

/* detail: NULL = not known yet. */
static proto_json *encode(const struct srv_participant *p, const struct srv_encoding *e,
                          const struct srv_moving_detail *detail) {
    bool image = is_image(p, e);
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "format",
                          image ? sp_image_format_info(e->format)->name
                                : sp_video_codec_name(e->video));
    if (has_quality(e))
        proto_json_set_integer(&json, "quality", e->quality);
    if (image && e->format == SP_IMAGE_JPEG)
        proto_json_set_string(&json, "subsampling", sp_chroma_name(e->chroma));
    if (detail) {
        proto_json_set(&json, "size", proto_json_integers(detail->size, 2));
        proto_json_set_integer(&json, "coarse", detail->mip_level);
        if (detail->is_draft)
            proto_json_set_bool(&json, "draft", true);
    }
    return json;
}

/* Lists why a moving frame has less quality than the final one. */
static proto_json *reasons(const struct srv_participant *p, const struct srv_encoding *moving,
                           bool is_known) {
    const struct srv_moving_detail *m = &p->policy.moving;
    const struct srv_rate_control *rate = &p->delivery.rate_control;
    const struct srv_rate_control then = { .step = m->rate_step };
    uint32_t most[2];
    srv_rate_control_size(&then, m->full_size, most);
    bool is_less = is_known && (m->is_draft || m->mip_level > 0 || m->size[0] < most[0] ||
                                m->size[1] < most[1]);
    proto_json *list = proto_json_array();
    if (moving->video != SP_VIDEO_CODEC_COUNT && p->delivery.is_video_refused)
        proto_json_append_string(&list, "video_pixels");
    if (moving->quality < p->settings.quality)
        proto_json_append_string(&list, "quality");
    if (rate->step > 0 || rate->is_video)
        proto_json_append_string(&list, "bandwidth");
    if (is_less)
        proto_json_append_string(&list, m->sharp_ms > 0 ? "time" : "unknown_time");
    if (is_less && m->is_shared)
        proto_json_append_string(&list, "shared_time");
    return list;
}

char *srv_policy_text(struct srv_participant *p, double now_ms, size_t *size) {
    struct srv_encoding moving =
        srv_policy_encoding(p, p->settings.progressive ? SRV_STEP_MOVING : SRV_STEP_FINAL);
    struct srv_encoding final = srv_policy_encoding(p, SRV_STEP_FINAL);
    struct srv_moving_detail full = { .mip_level = 0 };
    srv_hub_size(p->session, p, full.size);
    bool is_known = p->settings.progressive && p->policy.moving.size[0] > 0;
    proto_json *params = proto_json_object();
    proto_json_set(&params, "moving",
                   encode(p, &moving,
                          is_known                   ? &p->policy.moving
                          : !p->settings.progressive ? &full
                                                     : NULL));
    proto_json_set(&params, "final", encode(p, &final, &full));
    proto_json_set(&params, "why", reasons(p, &moving, is_known));
    if (is_known) {
        proto_json_set_number(&params, "budget_ms", round(p->policy.moving.budget_ms * 10) / 10);
        proto_json_set_number(&params, "sharp_ms", p->policy.moving.sharp_ms);
    }
    p->policy.reported = p->policy.moving;
    p->policy.told_ms = now_ms;
    return proto_rpc_notification("stream.policy", params, size);
}
