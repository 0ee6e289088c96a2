/* SPDX-License-Identifier: Apache-2.0
 *
 * The methods measure.put, measure.remove and measure.list, their notification, and what HTTP reads
 * and changes of the measurements.
 */
#include "session/measure_edit.h"
#include "session/rpc_private.h"

#include <stdlib.h>
#include <string.h>

/* A participant may edit if it has the role control, or if it holds control. */
static bool may_edit(struct srv_call *call) {
    const struct srv_participant *p = call->participant;
    return p->identity.role == SRV_ROLE_CONTROL || p->session->holder == p ||
           srv_call_refuse(call, PROTO_RPC_DENIED, NULL,
                           "this token may only watch; measuring needs the control token, or a "
                           "grant from the holder of control");
}

static struct srv_measure_edit edit_by(const struct srv_call *call) {
    struct srv_participant *p = call->participant;
    return (struct srv_measure_edit){ .hub = call->hub,
                                      .session = p->session,
                                      .change = SRV_MEASURE_MERGE,
                                      .by = p->identity.id,
                                      .author = p->identity.name,
                                      .color = srv_hub_color(p),
                                      .now_ms = call->now_ms };
}

/* Returns the member "id"; what is not a text becomes "", which is refused as an id. */
static const char *id_of(const struct srv_call *call) {
    const proto_json *value = proto_json_get(call->params, "id");
    const char *text = proto_json_string(value);
    return text || !value ? text : "";
}

bool srv_call_measure_put(struct srv_call *call) {
    static const char *const known[] = { "id",   "kind",  "points", "range",
                                         "text", "color", "hidden", NULL };
    if (!srv_call_knows(call, known) || !may_edit(call))
        return false;
    const enum srv_measure_effort effort =
        srv_measure_edit_effort(call->participant->session, id_of(call), call->params);
    if (effort == SRV_MEASURE_LONG && call->hub->options.measuring)
        return srv_call_measure_late(call, call->hub->options.measuring, SRV_MEASURING_MAX);
    if (effort == SRV_MEASURE_SOON && call->hub->options.sampling)
        return srv_call_measure_late(call, call->hub->options.sampling, SRV_SAMPLING_MAX);
    struct srv_measure_edit edit = edit_by(call);
    bool ok = srv_measure_edit_prepare(&edit, id_of(call), call->params, &call->err);
    if (ok) {
        call->result = proto_measure_encode(&edit.made);
        ok = !call->result || srv_measure_edit_commit(&edit, &call->err);
    }
    if (!ok) {
        proto_json_free(&call->result);
        call->code = edit.code;
    }
    return ok;
}

bool srv_call_measure_remove(struct srv_call *call) {
    static const char *const known[] = { "id", NULL };
    if (!srv_call_knows(call, known) || !may_edit(call))
        return false;
    struct srv_measure_edit edit = edit_by(call);
    if (!srv_measure_edit_remove(&edit, id_of(call), &call->err)) {
        call->code = edit.code;
        return false;
    }
    call->result = proto_json_object();
    proto_json_set_string(&call->result, "id", id_of(call));
    return true;
}

bool srv_call_measure_list(struct srv_call *call) {
    static const char *const known[] = { NULL };
    if (!srv_call_knows(call, known))
        return false;
    call->result = proto_json_object();
    proto_json_set(&call->result, "measures",
                   srv_measures_encode(&call->participant->session->measures));
    return true;
}

char *srv_measures_text(struct srv_participant *to, size_t *size) {
    const struct srv_measures *measures = &to->session->measures;
    proto_json *params = proto_json_object(), *ids = proto_json_array(), *news = proto_json_array();
    for (size_t i = 0; i < measures->count; i++) {
        const struct srv_measure_item *item = &measures->items[i];
        proto_json_append_string(&ids, item->measure.id);
        if (item->clock > to->pending.measures_reported)
            proto_json_append(&news, proto_measure_encode(&item->measure));
    }
    proto_json_set(&params, "ids", ids);
    proto_json_set(&params, "changed", news);
    char *text = proto_rpc_notification("session.measures", params, size);
    if (text)
        to->pending.measures_reported = measures->clock;
    return text;
}

bool srv_hub_measures(struct srv_hub *hub, const char *id, double now_ms,
                      struct srv_measures *measures, struct sp_error *err) {
    pthread_mutex_lock(&hub->mutex);
    const struct srv_session *session = srv_hub_find(hub, id, now_ms, err);
    const bool ok =
        session && (srv_measures_copy(&session->measures, measures) ||
                    sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the measurements"));
    pthread_mutex_unlock(&hub->mutex);
    return ok;
}

/* Begins a change over HTTP; the mutex is held. False: there is no such session. */
static bool begin_edit(struct srv_hub *hub, const char *id, const char *author, double now_ms,
                       struct srv_measure_edit *edit, struct sp_error *err) {
    struct srv_session *session = srv_hub_find(hub, id, now_ms, err);
    *edit = (struct srv_measure_edit){ .hub = hub,
                                       .session = session,
                                       .author = author,
                                       .color = srv_hub_first_color(),
                                       .now_ms = now_ms };
    return session != NULL;
}

char *srv_hub_measure_put(struct srv_hub *hub, const char *session,
                          const struct srv_measure_request *request, double now_ms,
                          struct srv_measure_answer *answer, struct sp_error *err) {
    struct srv_measure_edit edit;
    char *text = NULL;
    pthread_mutex_lock(&hub->mutex);
    bool ok = begin_edit(hub, session, request->author, now_ms, &edit, err);
    edit.change = request->change;
    if (ok && srv_measure_edit_prepare(&edit, request->id, request->body, err)) {
        proto_json *json = proto_measure_encode(&edit.made);
        text = json ? proto_json_to_text(json, &answer->size) : NULL;
        proto_json_free(&json);
        ok = text ? srv_measure_edit_commit(&edit, err)
                  : sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the answer");
        answer->is_new = edit.is_new;
        memcpy(answer->id, edit.made.id, sizeof answer->id);
        if (!ok) {
            free(text);
            text = NULL;
        }
    }
    pthread_mutex_unlock(&hub->mutex);
    return text;
}

bool srv_hub_measure_remove(struct srv_hub *hub, const char *session, const char *id, double now_ms,
                            struct sp_error *err) {
    struct srv_measure_edit edit;
    pthread_mutex_lock(&hub->mutex);
    const bool ok =
        begin_edit(hub, session, "", now_ms, &edit, err) && srv_measure_edit_remove(&edit, id, err);
    pthread_mutex_unlock(&hub->mutex);
    return ok;
}

bool srv_hub_measures_fork(struct srv_hub *hub, const char *from, const char *to, double now_ms,
                           struct sp_error *err) {
    struct srv_measures copy;
    if (!srv_hub_measures(hub, from, now_ms, &copy, err))
        return err->code == SP_ERR_NOT_FOUND; /* a saved view, or a session that has just ended */
    pthread_mutex_lock(&hub->mutex);
    struct srv_session *session = srv_hub_find(hub, to, now_ms, err);
    if (session) {
        srv_measures_finish(&session->measures);
        session->measures = copy;
        srv_hub_unsaved(hub, session);
    } else {
        srv_measures_finish(&copy);
    }
    pthread_mutex_unlock(&hub->mutex);
    return session != NULL;
}
