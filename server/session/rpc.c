/* SPDX-License-Identifier: Apache-2.0
 *
 * The methods of a stream: a text message comes in, an answer goes out.
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

bool srv_call_acquire_control(struct srv_call *call) {
    struct srv_participant *p = call->participant;
    if (srv_control_acquire(call->hub, p, call->now_ms))
        return true;
    return p->identity.role == SRV_ROLE_CONTROL
               ? srv_call_refuse(call, PROTO_RPC_HELD, NULL,
                                 "another participant holds control; ask for it by "
                                 "session.request_control")
               : srv_call_refuse(call, PROTO_RPC_DENIED, NULL,
                                 "this token may only watch; changing the view needs the "
                                 "control token, or a grant from the holder of control");
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
    if (!srv_call_acquire_control(call))
        return false;
    const uint64_t image = p->session->shared.image;
    if (!srv_hub_apply(call->hub, p->session, patch, p->identity.id, call->now_ms, &call->err)) {
        call->code = proto_rpc_code_from(call->err.code);
        return false;
    }
    p->delivery.seq = (uint32_t)seq;
    p->delivery.updated_ms = call->now_ms;
    call->result = proto_json_object();
    proto_json_set_integer(&call->result, "seq", seq);
    if (p->session->shared.image == image)
        proto_json_set(&call->result, "same_image", proto_json_new_bool(true));
    return true;
}

static bool view_get(struct srv_call *call) {
    static const char *const known[] = { NULL };
    if (!srv_call_knows(call, known))
        return false;
    call->result = proto_json_object();
    proto_json_set(&call->result, "view",
                   proto_view_encode(&call->participant->session->shared.view));
    proto_json_set_integer(&call->result, "seq", call->participant->delivery.seq);
    return true;
}

static bool stream_ack(struct srv_call *call) {
    static const char *const known[] = { "frame", NULL };
    struct srv_participant *p = call->participant;
    double sent_ms = srv_congestion_oldest_ms(&p->delivery.congestion_window);
    int64_t frame;
    if (!srv_call_knows(call, known))
        return false;
    if (!proto_json_integer(proto_json_get(call->params, "frame"), &frame) || frame < 1 ||
        frame > UINT32_MAX ||
        !srv_congestion_acked(&p->delivery.congestion_window, (uint32_t)frame, call->now_ms))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/frame",
                               "must be the number of a frame that was sent");
    srv_display_delay_acked(&p->delivery.display_delay, (uint32_t)frame, call->now_ms);
    srv_policy_update_rate(p);
    if (sent_ms > 0)
        srv_metrics_time(call->hub->options.metrics, SRV_TIME_ROUND_TRIP, call->now_ms - sent_ms);
    srv_hub_emit(call->hub, SRV_CONGESTION_CHANGED, p->session, p, call->now_ms);
    call->result = proto_json_object();
    return true;
}

/* The client could not decode a video frame: the next one is a key frame. */
static bool stream_key(struct srv_call *call) {
    static const char *const known[] = { NULL };
    if (!srv_call_knows(call, known))
        return false;
    call->participant->delivery.mark.epoch = 0;
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
    { "stream.configure", srv_call_configure },
    { "stream.ack", stream_ack },
    { "stream.key", stream_key },
    { "session.request_control", srv_call_request_control },
    { "session.release_control", srv_call_release_control },
    { "session.grant_control", srv_call_grant_control },
    { "session.refuse_control", srv_call_refuse_control },
    { "pick", srv_call_pick },
    { "measure.put", srv_call_measure_put },
    { "measure.remove", srv_call_measure_remove },
    { "measure.list", srv_call_measure_list },
    { "time.play", srv_call_time_play },
    { "time.stop", srv_call_time_stop },
    { "ping", ping },
};

static bool dispatch(struct srv_call *call, const char *method) {
    for (size_t i = 0; i < sizeof methods / sizeof *methods; i++) {
        if (strcmp(methods[i].name, method) != 0)
            continue;
        pthread_mutex_lock(&call->hub->mutex);
        bool ok = call->participant->session
                      ? methods[i].call(call)
                      : srv_call_refuse(call, PROTO_RPC_NOT_FOUND, NULL, "the session was deleted");
        pthread_mutex_unlock(&call->hub->mutex);
        if (call->later)
            srv_work_queue_add(call->later->queue, &call->later->work);
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
    /* A message that could not be read may be an acknowledgement. The stream would wait for it for
     * ever: close it. */
    if (!decoded && call.err.code == SP_ERR_MEMORY)
        return false;
    if (decoded) {
        call.params = message.params;
        call.message = &message;
        ok = dispatch(&call, message.method);
        if (call.later)
            return true;
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
