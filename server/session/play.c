/* SPDX-License-Identifier: Apache-2.0
 *
 * Playing: the phase of the view's vectors moves with the clock, at the rate of the frames, without
 * a message from a client. The view has a new version whenever a frame took the last one.
 */
#include <math.h>

#include "session/rpc_private.h"

#define RATE_MIN 0.01 /* periods per second, either way; slower looks like standing */
#define RATE_MAX 10.0

/* The layer of vectors that is visible; NULL = none. */
static struct sp_layer *find_vectors(struct sp_view *view) {
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].type == SP_LAYER_VECTORS && view->layers[i].visible)
            return &view->layers[i];
    return NULL;
}

bool srv_play_moves(const struct srv_session *session) {
    return session->play.rate != 0;
}

void srv_play_place(const struct srv_session *session, double now_ms, struct sp_view *view) {
    const struct srv_play *play = &session->play;
    struct sp_layer *layer = srv_play_moves(session) ? find_vectors(view) : NULL;
    if (!layer)
        return;
    double phase = play->phase + play->rate * (now_ms - play->since_ms) / 1000;
    layer->phase = phase - floor(phase);
}

static void set_rate(struct srv_hub *hub, struct srv_session *session, double rate, double now_ms) {
    srv_play_place(session, now_ms, &session->shared.view);
    const struct sp_layer *layer = find_vectors(&session->shared.view);
    session->play =
        (struct srv_play){ .rate = rate, .phase = layer ? layer->phase : 0, .since_ms = now_ms };
    session->shared.version++;
    session->shared.image++;
    session->shared.changed_ms = now_ms;
    srv_hub_unsaved(hub, session);
    srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_TIME);
}

void srv_play_advance(struct srv_hub *hub, struct srv_session *session, double now_ms) {
    if (!find_vectors(&session->shared.view)) {
        set_rate(hub, session, 0, now_ms);
        return;
    }
    srv_play_place(session, now_ms, &session->shared.view);
    session->shared.version++;
    session->shared.image++;
    session->shared.changed_ms = now_ms;
}

/* NULL = out of memory. */
static proto_json *encode_rate(double rate) {
    proto_json *json = proto_json_object();
    if (!proto_json_set_number(json, "rate", rate))
        proto_json_free(&json);
    return json;
}

char *srv_play_text(const struct srv_participant *to, size_t *size) {
    return proto_rpc_notification("time.changed", encode_rate(to->session->play.rate), size);
}

static bool answer(struct srv_call *call, double rate) {
    struct srv_session *session = call->participant->session;
    set_rate(call->hub, session, rate, call->now_ms);
    srv_hub_emit(call->hub, SRV_VIEW_CHANGED, session, NULL, call->now_ms);
    call->result = encode_rate(rate);
    return true;
}

bool srv_call_time_play(struct srv_call *call) {
    static const char *const known[] = { "rate", NULL };
    double rate;
    if (!srv_call_knows(call, known))
        return false;
    if (!proto_json_number(proto_json_get(call->params, "rate"), &rate) ||
        !(fabs(rate) >= RATE_MIN && fabs(rate) <= RATE_MAX))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/rate",
                               "must be periods per second in [0.01, 10], or negative: backwards");
    if (!find_vectors(&call->participant->session->shared.view))
        return srv_call_refuse(call, PROTO_RPC_VIEW, NULL,
                               "nothing can be played: the view shows no layer of vectors");
    return srv_call_take_control(call) && answer(call, rate);
}

bool srv_call_time_stop(struct srv_call *call) {
    static const char *const known[] = { NULL };
    if (!srv_call_knows(call, known) || !srv_call_take_control(call))
        return false;
    if (srv_play_moves(call->participant->session))
        return answer(call, 0);
    call->result = encode_rate(0);
    return true;
}
