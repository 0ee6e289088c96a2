/* SPDX-License-Identifier: Apache-2.0
 *
 * How pictures are encoded for a participant, and the notification that tells it.
 */
#include "session/policy.h"

#include <string.h>

#include "protocol/rpc.h"

enum { QUALITY_MOVING = 60 };

struct srv_encoding srv_policy_encoding(const struct srv_participant *p, enum srv_step step) {
    bool moving = step == SRV_STEP_MOVING, final = step == SRV_STEP_FINAL;
    int quality = moving && p->quality > QUALITY_MOVING ? QUALITY_MOVING : p->quality;
    return (struct srv_encoding){
        .format = final && p->lossless ? SP_IMAGE_PNG : p->format,
        .video = final ? SP_VIDEO_CODEC_COUNT : p->video,
        .quality = quality,
        .chroma = sp_chroma_at(p->chroma, quality),
    };
}

static proto_json *encode(const struct srv_participant *p, enum srv_step step) {
    struct srv_encoding e = srv_policy_encoding(p, step);
    bool still = e.video == SP_VIDEO_CODEC_COUNT || p->video_refused;
    proto_json *json = proto_json_object();
    bool ok = proto_json_set_string(json, "format",
                                    still ? sp_image_format_info(e.format)->name
                                          : sp_video_codec_name(e.video));
    ok = proto_json_set_integer(json, "quality", e.quality) && ok;
    if (still && e.format == SP_IMAGE_JPEG)
        ok = proto_json_set_string(json, "subsampling", sp_chroma_name(e.chroma)) && ok;
    if (!ok)
        proto_json_free(&json);
    return json;
}

static proto_json *reasons(const struct srv_participant *p) {
    proto_json *list = proto_json_array();
    bool ok = true;
    if (p->video != SP_VIDEO_CODEC_COUNT && p->video_refused)
        ok = proto_json_append_string(list, "video_pixels");
    if (!ok)
        proto_json_free(&list);
    return list;
}

char *srv_policy_text(const struct srv_participant *p, size_t *size) {
    proto_json *params = proto_json_object();
    bool ok = proto_json_set(params, "moving",
                             encode(p, p->progressive ? SRV_STEP_MOVING : SRV_STEP_FINAL));
    ok = proto_json_set(params, "final", encode(p, SRV_STEP_FINAL)) && ok;
    ok = proto_json_set(params, "why", reasons(p)) && ok;
    if (!ok)
        proto_json_free(&params);
    return proto_rpc_notification("stream.policy", params, size);
}
