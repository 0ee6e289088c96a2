/* SPDX-License-Identifier: Apache-2.0
 *
 * Playing: the phase of the view's vectors moves with the clock, at the rate of the frames, and
 * time steps follow one another at a rate of their own, without a message from a client. The view
 * has a new version whenever a frame took the last one. No time step is left out: one that is not
 * loaded yet, or a client that cannot take its frame, makes the time wait.
 */
#include <math.h>

#include "session/rpc_private.h"

#define RATE_MIN 0.01 /* periods per second, either way; slower looks like standing */
#define RATE_MAX 10.0
#define STEPS_MIN 0.01 /* time steps per second, either way */
#define STEPS_MAX 120.0

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

bool srv_play_is_on(const struct srv_session *session) {
    return session->play.rate != 0 || session->play.steps != 0;
}

static double next_step_ms(const struct srv_session *session) {
    const struct srv_play *play = &session->play;
    return play->steps == 0 || session->shared.is_waiting
               ? INFINITY
               : play->step_ms + 1000 / fabs(play->steps);
}

double srv_play_due_ms(const struct srv_session *session) {
    return srv_play_moves(session) ? 0 : next_step_ms(session);
}

void srv_play_place(const struct srv_session *session, double now_ms, struct sp_view *view) {
    const struct srv_play *play = &session->play;
    struct sp_layer *layer = srv_play_moves(session) ? find_vectors(view) : NULL;
    if (!layer)
        return;
    double phase = play->phase + play->rate * (now_ms - play->since_ms) / 1000;
    layer->phase = phase - floor(phase);
}

static void set_rates(struct srv_hub *hub, struct srv_session *session, double rate, double steps,
                      double now_ms) {
    srv_play_place(session, now_ms, &session->shared.view);
    const struct sp_layer *layer = find_vectors(&session->shared.view);
    session->play = (struct srv_play){ .rate = rate,
                                       .phase = layer ? layer->phase : 0,
                                       .since_ms = now_ms,
                                       .steps = steps,
                                       .step_ms = now_ms };
    session->shared.version++;
    session->shared.image++;
    session->shared.changed_ms = now_ms;
    srv_hub_unsaved(hub, session);
    srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_TIME);
}

void srv_play_stop_steps(struct srv_hub *hub, struct srv_session *session) {
    if (session->play.steps == 0)
        return;
    session->play.steps = 0;
    srv_hub_unsaved(hub, session);
    srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_TIME);
}

/* Steps that are late do not follow one another any faster. */
static void advance_step(struct srv_hub *hub, struct srv_session *session, double now_ms) {
    struct srv_play *play = &session->play;
    const uint32_t count = session->shared.steps;
    const double interval_ms = 1000 / fabs(play->steps);
    session->shared.view.time.step =
        (session->shared.view.time.step + (play->steps > 0 ? 1 : count - 1)) % count;
    play->step_ms = fmax(play->step_ms + interval_ms, now_ms - interval_ms);
    srv_steps_follow(hub, session);
    srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_TIME);
    srv_hub_emit(hub, SRV_TRANSFER_FUNCTION_CHANGED, session, NULL, now_ms);
}

void srv_play_advance(struct srv_hub *hub, struct srv_session *session, double now_ms) {
    const bool has_step = next_step_ms(session) <= now_ms;
    if (srv_play_moves(session) && !find_vectors(&session->shared.view)) {
        set_rates(hub, session, 0, session->play.steps, now_ms);
        return;
    }
    srv_play_place(session, now_ms, &session->shared.view);
    session->shared.version++;
    session->shared.image++;
    session->shared.changed_ms = now_ms;
    if (has_step)
        advance_step(hub, session, now_ms);
}

/* NULL = out of memory. */
static proto_json *encode_time(const struct srv_session *session) {
    proto_json *json = proto_json_object();
    proto_json_set_number(&json, "rate", session->play.rate);
    proto_json_set_number(&json, "steps", session->play.steps);
    proto_json_set_integer(&json, "step", session->shared.view.time.step);
    proto_json_set_integer(&json, "count", session->shared.steps);
    proto_json_set_bool(&json, "loading", session->shared.is_waiting);
    return json;
}

char *srv_play_text(const struct srv_participant *to, size_t *size) {
    return proto_rpc_notification("time.changed", encode_time(to->session), size);
}

static bool answer(struct srv_call *call, double rate, double steps) {
    struct srv_session *session = call->participant->session;
    set_rates(call->hub, session, rate, steps, call->now_ms);
    srv_hub_emit(call->hub, SRV_VIEW_CHANGED, session, NULL, call->now_ms);
    call->result = encode_time(session);
    return true;
}

/* Reads a rate that a client gives; without one it stays. */
static bool read_rate(struct srv_call *call, const char *name, double low, double high,
                      const char *problem, double *rate) {
    char pointer[16];
    const proto_json *json = proto_json_get(call->params, name);
    if (!json || (proto_json_number(json, rate) && fabs(*rate) >= low && fabs(*rate) <= high))
        return true;
    snprintf(pointer, sizeof pointer, "/%s", name);
    return srv_call_refuse(call, PROTO_RPC_PARAMS, pointer, problem);
}

bool srv_call_time_play(struct srv_call *call) {
    static const char *const known[] = { "rate", "steps", NULL };
    struct srv_session *session = call->participant->session;
    double rate = session->play.rate, steps = session->play.steps;
    if (!srv_call_knows(call, known) ||
        !read_rate(call, "rate", RATE_MIN, RATE_MAX,
                   "must be periods per second in [0.01, 10], or negative: backwards", &rate) ||
        !read_rate(call, "steps", STEPS_MIN, STEPS_MAX,
                   "must be time steps per second in [0.01, 120], or negative: backwards", &steps))
        return false;
    if (!proto_json_get(call->params, "rate") && !proto_json_get(call->params, "steps"))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/rate",
                               "is missing: periods per second of the vectors, or \"steps\": time "
                               "steps per second");
    if (rate != 0 && !find_vectors(&session->shared.view))
        return srv_call_refuse(call, PROTO_RPC_VIEW, NULL,
                               "nothing can be played: the view shows no layer of vectors");
    if (steps != 0 && session->shared.steps < 2)
        return srv_call_refuse(call, PROTO_RPC_VIEW, NULL,
                               "nothing can be played: the volume has one time step");
    return srv_call_acquire_control(call) && answer(call, rate, steps);
}

bool srv_call_time_stop(struct srv_call *call) {
    static const char *const known[] = { NULL };
    if (!srv_call_knows(call, known) || !srv_call_acquire_control(call))
        return false;
    if (srv_play_is_on(call->participant->session))
        return answer(call, 0, 0);
    call->result = encode_time(call->participant->session);
    return true;
}
