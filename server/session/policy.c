/* SPDX-License-Identifier: Apache-2.0
 *
 * How pictures are encoded for a participant, and the notification that tells it.
 */
#include "session/policy.h"

#include <string.h>

#include "protocol/rpc.h"
#include "session/encode_params.h"

enum { QUALITY_MOVING = 60 };
#define TELL_MS 500.0

static bool has_quality(const struct srv_encoding *e) { /* video goes with JPEG */
    return !sp_image_format_info(e->format)->is_lossless;
}

struct srv_encoding srv_policy_encoding(const struct srv_participant *p, enum srv_frame_step step) {
    bool moving = step == SRV_STEP_MOVING, final = step == SRV_STEP_FINAL;
    struct srv_encoding e = {
        .format = final && p->lossless ? SP_IMAGE_PNG : p->format,
        .video = final ? SP_VIDEO_CODEC_COUNT : p->video,
        .quality = p->quality,
    };
    if (moving && has_quality(&e) && e.quality > QUALITY_MOVING)
        e.quality = QUALITY_MOVING;
    e.chroma = sp_chroma_at(p->chroma, e.quality);
    return e;
}

bool srv_policy_is_final(const struct srv_participant *p, const struct srv_encoding *e) {
    const struct srv_encoding final = srv_policy_encoding(p, SRV_STEP_FINAL);
    const struct srv_encode_params form = srv_encode_params_from(e->format, e->quality, e->chroma);
    const struct srv_encode_params last =
        srv_encode_params_from(final.format, final.quality, final.chroma);
    return e->video == SP_VIDEO_CODEC_COUNT && srv_encode_params_equal(&form, &last);
}

double srv_policy_encode_ms(const struct srv_encoding *e, const uint32_t size[2]) {
    static const double stills[SP_IMAGE_FORMAT_COUNT] = { [SP_IMAGE_JPEG] = 3.5e-6,
                                                          [SP_IMAGE_PNG] = 15e-6,
                                                          [SP_IMAGE_WEBP] = 48e-6,
                                                          [SP_IMAGE_EXR] = 120e-6 };
    const double videos = 7.5e-6;
    double px_ms = e->video == SP_VIDEO_CODEC_COUNT ? stills[e->format] : videos;
    return px_ms * size[0] * size[1];
}

static bool is_same(const struct srv_moving *a, const struct srv_moving *b) {
    return a->full[0] == b->full[0] && a->full[1] == b->full[1] &&
           a->detail.size[0] == b->detail.size[0] && a->detail.size[1] == b->detail.size[1] &&
           a->detail.mip_level == b->detail.mip_level && a->is_shared == b->is_shared;
}

void srv_policy_taken(struct srv_hub *hub, struct srv_participant *p,
                      const struct srv_render_job *job, double now_ms) {
    bool moving = job->step == SRV_STEP_MOVING;
    if (moving) {
        struct srv_detail sharp = { .size = { job->full[0], job->full[1] } };
        p->moving = (struct srv_moving){
            .full = { job->full[0], job->full[1] },
            .detail = { .mip_level = job->mip_level,
                        .size = { job->view.size[0], job->view.size[1] } },
            .budget_ms = job->budget_ms,
            .sharp_ms = srv_quality_expected_ms(&p->session->pace, &sharp),
            .is_shared = job->budget_ms < srv_quality_budget_ms(p->max_fps) * 0.99,
        };
    }
    bool is_due = !moving || now_ms - p->policy_ms >= TELL_MS;
    if (is_due && !is_same(&p->moving, &p->moving_told))
        srv_hub_notify(hub, p, SRV_NOTIFY_POLICY);
}

static bool is_still(const struct srv_participant *p, const struct srv_encoding *e) {
    return e->video == SP_VIDEO_CODEC_COUNT || p->video_refused;
}

static bool set_size(proto_json *json, const char *key, const uint32_t size[2]) {
    proto_json *pair = proto_json_array();
    bool ok = proto_json_append_integer(pair, size[0]) && proto_json_append_integer(pair, size[1]);
    return proto_json_set(json, key, pair) && ok;
}

/* detail: NULL = not known yet. */
static proto_json *encode(const struct srv_participant *p, const struct srv_encoding *e,
                          const struct srv_detail *detail) {
    bool still = is_still(p, e);
    proto_json *json = proto_json_object();
    bool ok = proto_json_set_string(json, "format",
                                    still ? sp_image_format_info(e->format)->name
                                          : sp_video_codec_name(e->video));
    if (has_quality(e))
        ok = proto_json_set_integer(json, "quality", e->quality) && ok;
    if (still && e->format == SP_IMAGE_JPEG)
        ok = proto_json_set_string(json, "subsampling", sp_chroma_name(e->chroma)) && ok;
    if (detail) {
        ok = set_size(json, "size", detail->size) && ok;
        ok = proto_json_set_integer(json, "coarse", detail->mip_level) && ok;
    }
    if (!ok)
        proto_json_free(&json);
    return json;
}

/* Why a moving picture is less than the final one. */
static proto_json *reasons(const struct srv_participant *p, const struct srv_encoding *moving,
                           bool is_known) {
    const struct srv_moving *m = &p->moving;
    bool is_less = is_known && (m->detail.mip_level > 0 || m->detail.size[0] != m->full[0] ||
                                m->detail.size[1] != m->full[1]);
    proto_json *list = proto_json_array();
    bool ok = list != NULL;
    if (moving->video != SP_VIDEO_CODEC_COUNT && p->video_refused)
        ok = proto_json_append_string(list, "video_pixels") && ok;
    if (moving->quality < p->quality)
        ok = proto_json_append_string(list, "quality") && ok;
    if (is_less)
        ok = proto_json_append_string(list, m->sharp_ms > 0 ? "time" : "unknown_time") && ok;
    if (is_less && m->is_shared)
        ok = proto_json_append_string(list, "shared_time") && ok;
    if (!ok)
        proto_json_free(&list);
    return list;
}

char *srv_policy_text(struct srv_participant *p, double now_ms, size_t *size) {
    struct srv_encoding moving =
        srv_policy_encoding(p, p->progressive ? SRV_STEP_MOVING : SRV_STEP_FINAL);
    struct srv_encoding final = srv_policy_encoding(p, SRV_STEP_FINAL);
    struct srv_detail full = { .mip_level = 0 };
    srv_hub_size(p->session, p, full.size);
    bool is_known = p->progressive && p->moving.detail.size[0] > 0;
    proto_json *params = proto_json_object();
    bool ok = proto_json_set(params, "moving",
                             encode(p, &moving,
                                    is_known          ? &p->moving.detail
                                    : !p->progressive ? &full
                                                      : NULL));
    ok = proto_json_set(params, "final", encode(p, &final, &full)) && ok;
    ok = proto_json_set(params, "why", reasons(p, &moving, is_known)) && ok;
    if (is_known) {
        ok = proto_json_set_number(params, "budget_ms", p->moving.budget_ms) && ok;
        ok = proto_json_set_number(params, "sharp_ms", p->moving.sharp_ms) && ok;
    }
    p->moving_told = p->moving;
    p->policy_ms = now_ms;
    if (!ok)
        proto_json_free(&params);
    return proto_rpc_notification("stream.policy", params, size);
}
