/* SPDX-License-Identifier: Apache-2.0
 *
 * Control: the right to change the view of a session. At most one participant holds control.
 *
 *   free ──update or request by a control role──► held ──release, leave──► the first request of a
 *    ▲                                              │                       control role gets it,
 *    └──────────────────────────────────────────────┘                       or else it is free
 *
 * A participant that requests control waits until the holder grants or refuses it. Without an
 * answer within --control-time control passes on, but only to a control role. A view role gets
 * control only by a grant of the holder.
 */
#include <math.h>

#include "session/rpc_private.h"

static bool is_asking(const struct srv_participant *p) {
    return p->control.order > 0;
}

static bool may_control(const struct srv_participant *p) {
    return p->identity.role == SRV_ROLE_CONTROL;
}

static struct srv_participant *next_in_line(const struct srv_session *session) {
    struct srv_participant *first = NULL;
    for (struct srv_participant *p = session->participants; p; p = p->next)
        if (is_asking(p) && may_control(p) && (!first || p->control.order < first->control.order))
            first = p;
    return first;
}

/* `to` NULL = control is free. All other requests start to wait again: the new holder needs
 * time to answer. */
static void give(struct srv_hub *hub, struct srv_session *session, struct srv_participant *to,
                 double now_ms) {
    session->holder = to;
    if (to)
        to->control.order = 0;
    for (struct srv_participant *p = session->participants; p; p = p->next)
        p->control.since_ms = now_ms;
    srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_CONTROL);
}

void srv_control_leave(struct srv_hub *hub, struct srv_session *session,
                       const struct srv_participant *p, double now_ms) {
    if (session->holder == p)
        give(hub, session, next_in_line(session), now_ms);
    else if (is_asking(p))
        srv_hub_notify_others(hub, session, 0, SRV_NOTIFY_CONTROL);
}

bool srv_control_acquire(struct srv_hub *hub, struct srv_participant *p, double now_ms) {
    if (!p->session->holder && may_control(p))
        give(hub, p->session, p, now_ms);
    return p->session->holder == p;
}

double srv_control_tick(struct srv_hub *hub, struct srv_session *session, double now_ms) {
    struct srv_participant *p = next_in_line(session);
    if (!p)
        return INFINITY;
    double at_ms = p->control.since_ms + hub->options.control_ms;
    if (at_ms > now_ms)
        return at_ms;
    give(hub, session, p, now_ms);
    return srv_control_tick(hub, session, now_ms);
}

char *srv_control_text(const struct srv_hub *hub, const struct srv_participant *to, double now_ms,
                       size_t *size) {
    const struct srv_session *session = to->session;
    proto_json *params = proto_json_object(), *list = proto_json_array();
    proto_json_set(&params, "holder", srv_hub_encode_holder(session));
    for (const struct srv_participant *p = session->participants; p; p = p->next) {
        if (!is_asking(p))
            continue;
        proto_json *one = proto_json_object();
        double left_ms = fmax(hub->options.control_ms - (now_ms - p->control.since_ms), 0);
        proto_json_set_integer(&one, "id", (int64_t)p->identity.id);
        proto_json_set(&one, "seconds",
                       may_control(p) ? proto_json_new_number(left_ms / 1000)
                                      : proto_json_new_null());
        proto_json_append(&list, one);
    }
    proto_json_set(&params, "requests", list);
    return proto_rpc_notification("session.control", params, size);
}

/* The methods. */

static bool answer(struct srv_call *call) {
    const struct srv_participant *p = call->participant;
    call->result = proto_json_object();
    proto_json_set_bool(&call->result, "holds", p->session->holder == p);
    return true;
}

bool srv_call_request_control(struct srv_call *call) {
    static const char *const known[] = { NULL };
    struct srv_participant *p = call->participant;
    if (!srv_call_knows(call, known))
        return false;
    if (!p->session->holder && !may_control(p))
        return srv_call_refuse(
            call, PROTO_RPC_DENIED, NULL,
            "this token may only watch, and no participant holds control that could grant it");
    if (!srv_control_acquire(call->hub, p, call->now_ms) && !is_asking(p)) {
        p->control.order = ++call->hub->participants.next_request;
        p->control.since_ms = call->now_ms;
        srv_timer_set_by(&call->hub->active.timers, &p->session->timer,
                         p->control.since_ms + call->hub->options.control_ms);
        srv_hub_notify_others(call->hub, p->session, 0, SRV_NOTIFY_CONTROL);
    }
    return answer(call);
}

bool srv_call_release_control(struct srv_call *call) {
    static const char *const known[] = { NULL };
    struct srv_participant *p = call->participant;
    if (!srv_call_knows(call, known))
        return false;
    if (p->session->holder == p) {
        give(call->hub, p->session, next_in_line(p->session), call->now_ms);
    } else if (is_asking(p)) {
        p->control.order = 0;
        srv_hub_notify_others(call->hub, p->session, 0, SRV_NOTIFY_CONTROL);
    }
    return answer(call);
}

/* Returns the participant that "to" names, if the caller holds control. NULL: refused. */
static struct srv_participant *find_recipient(struct srv_call *call) {
    static const char *const known[] = { "to", NULL };
    const struct srv_session *session = call->participant->session;
    int64_t id;
    if (!srv_call_knows(call, known))
        return NULL;
    if (session->holder != call->participant) {
        srv_call_refuse(call, PROTO_RPC_HELD, NULL,
                        "only the holder of control can grant or refuse it");
        return NULL;
    }
    if (proto_json_integer(proto_json_get(call->params, "to"), &id))
        for (struct srv_participant *p = session->participants; p; p = p->next)
            if ((int64_t)p->identity.id == id)
                return p;
    srv_call_refuse(call, PROTO_RPC_PARAMS, "/to", "must be the id of a participant");
    return NULL;
}

bool srv_call_grant_control(struct srv_call *call) {
    struct srv_participant *to = find_recipient(call);
    if (!to)
        return false;
    give(call->hub, to->session, to, call->now_ms);
    return answer(call);
}

bool srv_call_refuse_control(struct srv_call *call) {
    struct srv_participant *to = find_recipient(call);
    if (!to)
        return false;
    to->control.order = 0;
    srv_hub_notify_others(call->hub, to->session, 0, SRV_NOTIFY_CONTROL);
    return answer(call);
}
