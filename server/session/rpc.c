/* SPDX-License-Identifier: Apache-2.0
 *
 * The methods of a stream: text message in, answer out.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/view.h"
#include "session/rpc_private.h"

bool srv_call_refuse(struct srv_call *call, enum proto_rpc_code code, const char *place,
                     const char *text) {
    call->code = code;
    return sp_fail(&call->err, SP_ERR_INVALID, place, "%s", text);
}

bool srv_call_knows(struct srv_call *call, const char *const *known) {
    call->code = PROTO_RPC_PARAMS;
    return proto_json_only(call->params, known, &call->err);
}

static bool view_update(struct srv_call *call) {
    static const char *const known[] = { "seq", "patch", NULL };
    struct srv_participant *p = call->participant;
    int64_t seq;
    const proto_json *patch = proto_json_get(call->params, "patch");
    if (!srv_call_knows(call, known))
        return false;
    if (!proto_json_integer(proto_json_get(call->params, "seq"), &seq) || seq < 0 ||
        seq > UINT32_MAX)
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/seq",
                               "must be a whole number in [0, 4294967295]");
    if (proto_json_type(patch) != PROTO_JSON_OBJECT)
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/patch",
                               "must be an object: a merge patch");
    if (!srv_control_take(call->hub, p, call->now_ms))
        return p->role == SRV_ROLE_CONTROL
                   ? srv_call_refuse(call, PROTO_RPC_HELD, NULL,
                                     "another participant holds control; ask for it by "
                                     "session.request_control")
                   : srv_call_refuse(call, PROTO_RPC_DENIED, NULL,
                                     "this token may watch; changing the view needs the control "
                                     "token, or the grant of who holds control");
    if (!srv_hub_apply(call->hub, p->session, patch, p->id, call->now_ms, &call->err)) {
        call->code = proto_rpc_code_from(call->err.code);
        return false;
    }
    p->seq = (uint32_t)seq;
    call->result = proto_json_object();
    if (!proto_json_set_integer(call->result, "seq", seq))
        proto_json_free(&call->result);
    return true;
}

static bool view_get(struct srv_call *call) {
    static const char *const known[] = { NULL };
    if (!srv_call_knows(call, known))
        return false;
    call->result = proto_json_object();
    bool ok =
        proto_json_set(call->result, "view", proto_view_encode(&call->participant->session->view));
    ok = proto_json_set_integer(call->result, "seq", call->participant->seq) && ok;
    if (!ok)
        proto_json_free(&call->result);
    return true;
}

enum { FORMATS_MAX = 16 }; /* in a client's list */

struct stream_settings {
    enum sp_image_format format;
    enum sp_video_codec video;
    enum sp_chroma chroma;
    int64_t quality, max_fps, size[2];
    bool progressive, lossless;
    const char *name;
};

static bool read_range(struct srv_call *call, const char *key, const char *pointer, int64_t max,
                       const char *text, int64_t *out) {
    const proto_json *value = proto_json_get(call->params, key);
    int64_t number;
    if (!value)
        return true;
    if (!proto_json_integer(value, &number) || number < 1 || number > max)
        return srv_call_refuse(call, PROTO_RPC_PARAMS, pointer, text);
    *out = number;
    return true;
}

static bool read_size(struct srv_call *call, struct stream_settings *s) {
    const proto_json *value = proto_json_get(call->params, "size");
    if (!value)
        return true;
    if (proto_json_type(value) == PROTO_JSON_NULL) {
        s->size[0] = s->size[1] = 0;
        return true;
    }
    for (size_t i = 0; i < 2; i++)
        if (proto_json_size(value) != 2 ||
            !proto_json_integer(proto_json_at(value, i), &s->size[i]) || s->size[i] < 1 ||
            s->size[i] > SP_SIZE_MAX)
            return srv_call_refuse(
                call, PROTO_RPC_PARAMS, "/size",
                "must be [width, height], each in [1, 8192] px, or null for the view's");
    const uint32_t size[2] = { (uint32_t)s->size[0], (uint32_t)s->size[1] };
    call->code = PROTO_RPC_PARAMS;
    return srv_hub_allows_size(call->hub, size, &call->err) &&
           srv_owner_allows_size(&call->participant->session->owner, size, &call->err);
}

/* Has this UTF-8 text no character that controls, or that changes what stands beside it: no C0 nor
 * C1 control, line or paragraph separator, or Bidi_Control (Unicode, PropList)? */
static bool is_plain(const char *text) {
    for (const unsigned char *c = (const unsigned char *)text; *c; c++) {
        if (*c < 0x20 || *c == 0x7f || (c[0] == 0xc2 && c[1] < 0xa0) ||
            (c[0] == 0xd8 && c[1] == 0x9c)) /* U+061C */
            return false;
        unsigned last = c[0] == 0xe2 && (c[1] == 0x80 || c[1] == 0x81) ? c[1] * 256u + c[2] : 0;
        if (last == 0x808e || last == 0x808f || (last >= 0x80a8 && last <= 0x80ae) ||
            (last >= 0x81a6 && last <= 0x81a9)) /* U+200E, F, 2028 to E, 2066 to 9 */
            return false;
    }
    return true;
}

static bool read_name(struct srv_call *call, struct stream_settings *s) {
    const proto_json *value = proto_json_get(call->params, "name");
    if (!value)
        return true;
    s->name = proto_json_string(value);
    size_t length = s->name ? strlen(s->name) : 0;
    return (length > 0 && length < SRV_PARTICIPANT_NAME_BYTES && is_plain(s->name)) ||
           srv_call_refuse(call, PROTO_RPC_PARAMS, "/name",
                           "must be a text of 1 to 64 bytes without control characters, also "
                           "those of a text's direction");
}

/* Video goes with JPEG: for what is at rest, and when there is no video to be had. */
static bool grant_format(const char *name, struct stream_settings *s) {
    enum sp_video_codec video = sp_video_codec_find(name);
    enum sp_image_format still =
        video == SP_VIDEO_CODEC_COUNT ? sp_image_format_find(name) : SP_IMAGE_JPEG;
    if (video != SP_VIDEO_CODEC_COUNT ? !sp_video_is_available(video)
                                      : still == SP_IMAGE_FORMAT_COUNT || still == SP_IMAGE_EXR)
        return false;
    s->video = video;
    s->format = still;
    return true;
}

/* A name, or a list of them, the best first: the first that there is, else JPEG. */
static bool read_format(struct srv_call *call, const proto_json *format,
                        struct stream_settings *s) {
    const char *name = proto_json_string(format);
    bool is_list = proto_json_type(format) == PROTO_JSON_ARRAY, granted = false;
    size_t count = is_list ? proto_json_size(format) : 0;
    if (name ? !grant_format(name, s) : count < 1 || count > FORMATS_MAX)
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/format",
                               "must be jpeg, png, webp, vp8, vp9, or h264 where it is built in; "
                               "or a list of 1 to 16 names, the best first");
    for (size_t i = 0; i < count; i++) {
        name = proto_json_string(proto_json_at(format, i));
        if (!name)
            return srv_call_refuse(call, PROTO_RPC_PARAMS, "/format", "must hold names");
        granted = granted || grant_format(name, s);
    }
    return !is_list || granted || grant_format("jpeg", s);
}

static bool read_chroma(struct srv_call *call, struct stream_settings *s) {
    const proto_json *value = proto_json_get(call->params, "subsampling");
    const char *name = proto_json_string(value);
    if (!value)
        return true;
    s->chroma = name ? sp_chroma_find(name) : SP_CHROMA_COUNT;
    return s->chroma != SP_CHROMA_COUNT || srv_call_refuse(call, PROTO_RPC_PARAMS, "/subsampling",
                                                           "must be auto, 4:4:4, 4:2:2 or 4:2:0");
}

static bool read_settings(struct srv_call *call, struct stream_settings *s) {
    const proto_json *format = proto_json_get(call->params, "format");
    const proto_json *progressive = proto_json_get(call->params, "progressive");
    const proto_json *lossless = proto_json_get(call->params, "lossless");
    if (format && !read_format(call, format, s))
        return false;
    if (progressive && !proto_json_bool(progressive, &s->progressive))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/progressive", "must be true or false");
    if (lossless && !proto_json_bool(lossless, &s->lossless))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/lossless", "must be true or false");
    return read_range(call, "quality", "/quality", 100, "must be a whole number in [1, 100]",
                      &s->quality) &&
           read_range(call, "max_fps", "/max_fps", 120, "must be a whole number in [1, 120]",
                      &s->max_fps) &&
           read_chroma(call, s) && read_size(call, s) && read_name(call, s);
}

static void set_name(struct srv_call *call, const char *name) {
    struct srv_participant *p = call->participant;
    if (!name || strcmp(name, p->name) == 0)
        return;
    snprintf(p->name, sizeof p->name, "%s", name);
    srv_hub_notify_others(call->hub, p->session, 0, SRV_NOTIFY_PARTICIPANTS);
}

/* What was granted. */
static proto_json *encode_settings(const struct srv_participant *p) {
    uint32_t size[2];
    srv_hub_size(p->session, p, size);
    proto_json *result = proto_json_object(), *pair = proto_json_array();
    const char *format = p->video == SP_VIDEO_CODEC_COUNT ? sp_image_format_info(p->format)->name
                                                          : sp_video_codec_name(p->video);
    bool ok = proto_json_set_string(result, "format", format);
    ok = proto_json_set_integer(result, "quality", p->quality) && ok;
    ok = proto_json_set_string(result, "subsampling", sp_chroma_name(p->chroma)) && ok;
    ok = proto_json_set_integer(result, "max_fps", p->max_fps) && ok;
    ok = proto_json_append_integer(pair, size[0]) && proto_json_append_integer(pair, size[1]) && ok;
    ok = proto_json_set(result, "size", pair) && ok;
    ok = proto_json_set_bool(result, "progressive", p->progressive) && ok;
    ok = proto_json_set_bool(result, "lossless", p->lossless) && ok;
    ok = proto_json_set_string(result, "name", p->name) && ok;
    if (!ok)
        proto_json_free(&result);
    return result;
}

static bool stream_configure(struct srv_call *call) {
    static const char *const known[] = { "format",   "quality", "subsampling",
                                         "max_fps",  "size",    "progressive",
                                         "lossless", "name",    NULL };
    struct srv_participant *p = call->participant;
    struct stream_settings s = { .format = p->format,
                                 .video = p->video,
                                 .chroma = p->chroma,
                                 .quality = p->quality,
                                 .max_fps = p->wanted_fps,
                                 .size = { p->size[0], p->size[1] },
                                 .progressive = p->progressive,
                                 .lossless = p->lossless };
    if (!srv_call_knows(call, known) || !read_settings(call, &s))
        return false;
    bool changed = s.format != p->format || s.video != p->video || s.quality != p->quality ||
                   s.chroma != p->chroma || s.size[0] != p->size[0] || s.size[1] != p->size[1] ||
                   s.progressive != p->progressive || s.lossless != p->lossless;
    p->format = s.format;
    p->video = s.video;
    p->chroma = s.chroma;
    p->quality = (int)s.quality;
    p->wanted_fps = (int)s.max_fps;
    p->max_fps = srv_owner_fps(&p->session->owner, p->wanted_fps);
    p->size[0] = (uint32_t)s.size[0];
    p->size[1] = (uint32_t)s.size[1];
    p->progressive = s.progressive;
    p->lossless = s.lossless;
    set_name(call, s.name);
    p->next_frame_ms = fmin(p->next_frame_ms, call->now_ms + 1000.0 / p->max_fps);
    if (changed) { /* what was shown is not what is asked for now */
        p->video_refused = false;
        p->taken_version = p->failed_version = 0;
        p->behind_ms = call->now_ms;
        call->hub->options.interrupt(call->hub->options.user, p->id, SRV_INTERRUPT_NEWER_REQUEST);
        srv_hub_notify(call->hub, p, SRV_NOTIFY_POLICY);
    }
    srv_hub_work(call->hub, p->session);
    call->result = encode_settings(p);
    return true;
}

static bool stream_ack(struct srv_call *call) {
    static const char *const known[] = { "frame", NULL };
    struct srv_participant *p = call->participant;
    double sent_ms = srv_window_oldest_ms(&p->flow);
    int64_t frame;
    if (!srv_call_knows(call, known))
        return false;
    if (!proto_json_integer(proto_json_get(call->params, "frame"), &frame) || frame < 1 ||
        frame > UINT32_MAX || !srv_window_acked(&p->flow, (uint32_t)frame, call->now_ms))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/frame",
                               "must be the number of a frame that was sent");
    if (sent_ms > 0)
        srv_metrics_time(call->hub->options.metrics, SRV_TIME_ROUND_TRIP, call->now_ms - sent_ms);
    srv_hub_work(call->hub, p->session);
    call->result = proto_json_object();
    return true;
}

/* The client could not decode a frame of video. */
static bool stream_key(struct srv_call *call) {
    static const char *const known[] = { NULL };
    if (!srv_call_knows(call, known))
        return false;
    call->participant->mark.epoch = 0;
    call->result = proto_json_object();
    return true;
}

static bool ping(struct srv_call *call) {
    call->result = proto_json_object();
    return true;
}

static const struct {
    const char *name;
    srv_method_fn *call;
} methods[] = {
    { "view.update", view_update },
    { "view.get", view_get },
    { "stream.configure", stream_configure },
    { "stream.ack", stream_ack },
    { "stream.key", stream_key },
    { "session.request_control", srv_call_request_control },
    { "session.release_control", srv_call_release_control },
    { "session.grant_control", srv_call_grant_control },
    { "session.refuse_control", srv_call_refuse_control },
    { "pick", srv_call_pick },
    { "ping", ping },
};

static bool dispatch(struct srv_call *call, const char *method) {
    for (size_t i = 0; i < sizeof methods / sizeof *methods; i++) {
        if (strcmp(methods[i].name, method) != 0)
            continue;
        pthread_mutex_lock(&call->hub->mutex);
        call->hub->now_ms = call->now_ms;
        bool ok = call->participant->session
                      ? methods[i].call(call)
                      : srv_call_refuse(call, PROTO_RPC_NOT_FOUND, NULL, "the session was deleted");
        pthread_mutex_unlock(&call->hub->mutex);
        return ok;
    }
    call->code = PROTO_RPC_METHOD;
    return sp_fail(&call->err, SP_ERR_NOT_FOUND, NULL, "there is no method '%.64s'", method);
}

bool srv_hub_message(struct srv_hub *hub, struct srv_participant *participant, const char *text,
                     size_t size, double now_ms, char **answer, size_t *answer_size) {
    struct proto_rpc_message message;
    struct srv_call call = { .hub = hub, .participant = participant, .now_ms = now_ms };
    *answer = NULL;
    *answer_size = 0;
    bool decoded = proto_rpc_decode(text, size, &message, &call.code, &call.err), ok = decoded;
    /* What could not be read may be an acknowledgement, for which a stream would wait in vain. */
    if (!decoded && call.err.code == SP_ERR_MEMORY)
        return false;
    if (decoded) {
        call.params = message.params;
        ok = dispatch(&call, message.method);
    }
    bool wanted = !decoded || message.has_id;
    if (wanted)
        *answer = ok ? proto_rpc_result(message.id, call.result, answer_size)
                     : proto_rpc_error(message.id, call.code, &call.err, answer_size);
    else
        proto_json_free(&call.result);
    proto_rpc_finish(&message);
    return !wanted || *answer;
}
