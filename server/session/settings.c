/* SPDX-License-Identifier: Apache-2.0
 *
 * The method stream.configure: what a client requests and what it gets.
 */

#include <stdio.h>
#include <string.h>

#include "protocol/text.h"
#include "session/rpc_private.h"

enum { FORMATS_MAX = 16, /* that a client may list */ PREDICT_MS_MAX = 1000 };

static bool read_range(struct srv_call *call, const char *key, const char *pointer, int64_t max,
                       const char *text, int *out) {
    const proto_json *value = proto_json_get(call->params, key);
    int64_t number;
    if (!value)
        return true;
    if (!proto_json_integer(value, &number) || number < 1 || number > max)
        return srv_call_refuse(call, PROTO_RPC_PARAMS, pointer, text);
    *out = (int)number;
    return true;
}

static bool read_size(struct srv_call *call, struct srv_stream_settings *s) {
    const proto_json *value = proto_json_get(call->params, "size");
    if (!value)
        return true;
    if (proto_json_type(value) == PROTO_JSON_NULL) {
        s->size[0] = s->size[1] = 0;
        return true;
    }
    for (size_t i = 0; i < 2; i++) {
        int64_t px = 0;
        if (proto_json_size(value) != 2 || !proto_json_integer(proto_json_at(value, i), &px) ||
            px < 1 || px > SP_SIZE_MAX)
            return srv_call_refuse(
                call, PROTO_RPC_PARAMS, "/size",
                "must be [width, height], each in [1, 8192] px, or null for the view's");
        s->size[i] = (uint32_t)px;
    }
    call->code = PROTO_RPC_PARAMS;
    return srv_hub_allows_size(call->hub, s->size, &call->err) &&
           srv_owner_allows_size(&call->participant->session->identity.owner, s->size, &call->err);
}

/* *name: NULL = the participant keeps its name. */
static bool read_name(struct srv_call *call, const char **name) {
    const proto_json *value = proto_json_get(call->params, "name");
    *name = proto_json_string(value);
    if (!value)
        return true;
    size_t length = *name ? strlen(*name) : 0;
    return (length > 0 && length < SRV_PARTICIPANT_NAME_BYTES && proto_text_is_plain(*name)) ||
           srv_call_refuse(call, PROTO_RPC_PARAMS, "/name",
                           "must be a text of 1 to 64 bytes without control characters, "
                           "including those for the direction of text");
}

/* Video comes with JPEG: for frames at rest, and while no encoder is free. */
static bool grant_format(const char *name, struct srv_stream_settings *s) {
    enum sp_video_codec video = sp_video_codec_find(name);
    enum sp_image_format still =
        video == SP_VIDEO_CODEC_COUNT ? sp_image_format_find(name) : SP_IMAGE_JPEG;
    if (video != SP_VIDEO_CODEC_COUNT ? !sp_video_is_available(video)
                                      : still == SP_IMAGE_FORMAT_COUNT || still == SP_IMAGE_EXR)
        return false;
    s->video = video;
    s->slow_video = SP_VIDEO_CODEC_COUNT;
    s->format = still;
    return true;
}

/* A video format after an image format replaces it where the network is too slow for images. */
static void grant_slow_video(const char *name, struct srv_stream_settings *s) {
    enum sp_video_codec video = sp_video_codec_find(name);
    if (s->video == SP_VIDEO_CODEC_COUNT && s->slow_video == SP_VIDEO_CODEC_COUNT &&
        video != SP_VIDEO_CODEC_COUNT && sp_video_is_available(video))
        s->slow_video = video;
}

/* Reads a name or a list of names in order of preference: grants the first that is available, else
 * JPEG; and video for a slow network if that is an image format. */
static bool read_format(struct srv_call *call, const proto_json *format,
                        struct srv_stream_settings *s) {
    const char *name = proto_json_string(format);
    bool is_list = proto_json_type(format) == PROTO_JSON_ARRAY, granted = false;
    size_t count = is_list ? proto_json_size(format) : 0;
    if (name ? !grant_format(name, s) : count < 1 || count > FORMATS_MAX)
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/format",
                               "must be jpeg, png, webp, vp8, vp9, or h264 where it is built in; "
                               "or a list of 1 to 16 names in order of preference");
    for (size_t i = 0; i < count; i++) {
        name = proto_json_string(proto_json_at(format, i));
        if (!name)
            return srv_call_refuse(call, PROTO_RPC_PARAMS, "/format", "must be a list of names");
        if (granted)
            grant_slow_video(name, s);
        granted = granted || grant_format(name, s);
    }
    return !is_list || granted || grant_format("jpeg", s);
}

static bool read_chroma(struct srv_call *call, struct srv_stream_settings *s) {
    const proto_json *value = proto_json_get(call->params, "subsampling");
    const char *name = proto_json_string(value);
    if (!value)
        return true;
    s->chroma = name ? sp_chroma_find(name) : SP_CHROMA_COUNT;
    return s->chroma != SP_CHROMA_COUNT || srv_call_refuse(call, PROTO_RPC_PARAMS, "/subsampling",
                                                           "must be auto, 4:4:4, 4:2:2 or 4:2:0");
}

static bool read_settings(struct srv_call *call, struct srv_stream_settings *s) {
    const proto_json *format = proto_json_get(call->params, "format");
    const proto_json *progressive = proto_json_get(call->params, "progressive");
    const proto_json *lossless = proto_json_get(call->params, "lossless");
    const proto_json *depth = proto_json_get(call->params, "depth");
    const proto_json *predict = proto_json_get(call->params, "predict");
    int64_t predict_ms = s->predict_ms;
    if (format && !read_format(call, format, s))
        return false;
    if (progressive && !proto_json_bool(progressive, &s->progressive))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/progressive", "must be true or false");
    if (lossless && !proto_json_bool(lossless, &s->lossless))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/lossless", "must be true or false");
    if (predict && (!proto_json_integer(predict, &predict_ms) || predict_ms < 0 ||
                    predict_ms > PREDICT_MS_MAX))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/predict",
                               "must be a whole number in [0, 1000] ms");
    s->predict_ms = (int)predict_ms;
    if (depth && !proto_json_bool(depth, &s->depth))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/depth", "must be true or false");
    return read_range(call, "quality", "/quality", 100, "must be a whole number in [1, 100]",
                      &s->quality) &&
           read_range(call, "max_fps", "/max_fps", 120, "must be a whole number in [1, 120]",
                      &s->wanted_fps) &&
           read_chroma(call, s) && read_size(call, s);
}

static void set_name(struct srv_call *call, const char *name) {
    struct srv_participant *p = call->participant;
    if (!name || strcmp(name, p->identity.name) == 0)
        return;
    snprintf(p->identity.name, sizeof p->identity.name, "%s", name);
    srv_hub_notify_others(call->hub, p->session, 0, SRV_NOTIFY_PARTICIPANTS);
}

/* Returns the names of all formats that this daemon sends, so that a client offers no others. */
static proto_json *encode_formats(void) {
    proto_json *list = proto_json_array();
    for (int f = 0; f < SP_IMAGE_FORMAT_COUNT; f++)
        if (f != SP_IMAGE_EXR)
            proto_json_append_string(&list, sp_image_format_info((enum sp_image_format)f)->name);
    for (int v = 0; v < SP_VIDEO_CODEC_COUNT; v++)
        if (sp_video_is_available((enum sp_video_codec)v))
            proto_json_append_string(&list, sp_video_codec_name((enum sp_video_codec)v));
    return list;
}

/* Returns the settings as granted. */
static proto_json *encode_settings(const struct srv_participant *p) {
    uint32_t size[2];
    srv_hub_size(p->session, p, size);
    proto_json *result = proto_json_object();
    const char *format = p->settings.video == SP_VIDEO_CODEC_COUNT
                             ? sp_image_format_info(p->settings.format)->name
                             : sp_video_codec_name(p->settings.video);
    proto_json_set_string(&result, "format", format);
    proto_json_set_integer(&result, "quality", p->settings.quality);
    proto_json_set_string(&result, "subsampling", sp_chroma_name(p->settings.chroma));
    proto_json_set_integer(&result, "max_fps", p->settings.max_fps);
    proto_json_set(&result, "size", proto_json_integers(size, 2));
    proto_json_set_bool(&result, "progressive", p->settings.progressive);
    proto_json_set_bool(&result, "lossless", p->settings.lossless);
    proto_json_set_bool(&result, "depth", p->settings.depth);
    proto_json_set_integer(&result, "predict", p->settings.predict_ms);
    proto_json_set_string(&result, "name", p->identity.name);
    proto_json_set(&result, "formats", encode_formats());
    return result;
}

/* The frame rate alone changes no image. */
static bool gives_other_image(const struct srv_stream_settings *a,
                              const struct srv_stream_settings *b) {
    return a->format != b->format || a->video != b->video || a->slow_video != b->slow_video ||
           a->quality != b->quality || a->chroma != b->chroma || a->size[0] != b->size[0] ||
           a->size[1] != b->size[1] || a->progressive != b->progressive ||
           a->lossless != b->lossless || a->depth != b->depth;
}

bool srv_call_configure(struct srv_call *call) {
    static const char *const known[] = { "format",  "quality",     "subsampling", "max_fps",
                                         "size",    "progressive", "lossless",    "depth",
                                         "predict", "name",        NULL };
    struct srv_participant *p = call->participant;
    struct srv_stream_settings s = p->settings;
    const char *name;
    if (!srv_call_knows(call, known) || !read_settings(call, &s) || !read_name(call, &name))
        return false;
    s.max_fps = srv_owner_fps(&p->session->identity.owner, s.wanted_fps);
    const bool is_other_image = gives_other_image(&s, &p->settings);
    p->settings = s;
    set_name(call, name);
    if (is_other_image) {
        p->delivery.is_video_refused = false;
        srv_rate_control_forget(&p->delivery.rate_control);
        srv_policy_update_rate(p);
        srv_hub_emit(call->hub, SRV_IMAGE_CHANGED, p->session, p, call->now_ms);
        srv_hub_notify(call->hub, p, SRV_NOTIFY_POLICY);
    }
    srv_hub_emit(call->hub, SRV_CONFIGURED, p->session, p, call->now_ms);
    call->result = encode_settings(p);
    return true;
}
