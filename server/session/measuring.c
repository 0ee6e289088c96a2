/* SPDX-License-Identifier: Apache-2.0
 *
 * The methods measure.put, measure.remove and measure.list, their notification, and what HTTP reads
 * of the measurements.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "session/rpc_private.h"

/* The time that one sample of a region costs of the quota, ms: 2 million samples per second. */
#define SAMPLE_MS (1 / 2000.0)
enum { MADE_ID_DIGITS = 16 };

/* A participant may edit if it has the role control, or if it holds control. */
static bool may_edit(struct srv_call *call) {
    const struct srv_participant *p = call->participant;
    return p->identity.role == SRV_ROLE_CONTROL || p->session->holder == p ||
           srv_call_refuse(call, PROTO_RPC_DENIED, NULL,
                           "this token may only watch; measuring needs the control token, or a "
                           "grant from the holder of control");
}

static bool has_quota(struct srv_call *call) {
    struct srv_participant *p = call->participant;
    const double next_ms =
        fmax(p->measured_ms, call->now_ms - 1000) + 1000.0 / SRV_MEASURES_PER_SECOND;
    if (next_ms > call->now_ms)
        return srv_call_refuse(call, PROTO_RPC_LIMIT, NULL,
                               "at most 20 changes of measurements per second, and fewer with "
                               "large regions; try again later");
    p->measured_ms = next_ms;
    return true;
}

/* Reads "id"; without one, the daemon makes one for a new measurement. */
static bool read_id(struct srv_call *call, bool is_needed, char id[PROTO_MEASURE_ID_MAX + 1]) {
    const proto_json *value = proto_json_get(call->params, "id");
    const char *given = proto_json_string(value);
    if (!value && !is_needed) {
        call->code = PROTO_RPC_INTERNAL;
        return srv_secret_hex(id, MADE_ID_DIGITS, &call->err);
    }
    if (!proto_measure_is_id(given))
        return srv_call_refuse(call, PROTO_RPC_PARAMS, "/id",
                               "must be 1 to 32 characters of A-Z a-z 0-9 _ -");
    strcpy(id, given);
    return true;
}

/* Fills in a new measurement, or a copy of the one that exists. */
static struct proto_measure begin(const struct srv_call *call, const char *id, bool *is_new) {
    const struct srv_participant *p = call->participant;
    const struct srv_measure_item *item = srv_measures_find(&p->session->measures, id);
    struct proto_measure measure = { .is_hidden = false };
    *is_new = !item;
    if (item)
        return item->measure;
    snprintf(measure.id, sizeof measure.id, "%s", id);
    snprintf(measure.volume, sizeof measure.volume, "%s", p->session->shared.view.volume);
    snprintf(measure.color, sizeof measure.color, "%s", srv_hub_color(p));
    snprintf(measure.author, sizeof measure.author, "%s", p->identity.name);
    return measure;
}

/* Computes the value without the mutex, so that others need not wait. The session may end
 * meanwhile, which is an error; the participant cannot, because this thread joined it. */
static bool compute(struct srv_call *call, struct proto_measure *measure) {
    const struct srv_volume_source *source = &call->hub->options.volumes;
    struct srv_participant *p = call->participant;
    if (strcmp(measure->volume, p->session->shared.view.volume) != 0) {
        call->code = PROTO_RPC_PARAMS;
        return sp_fail(&call->err, SP_ERR_INVALID, "/points",
                       "the measurement belongs to the volume %.100s, which the session does not "
                       "show; its points cannot change",
                       measure->volume);
    }
    void *volume = source->ref(source->user, p->session->shared.volume);
    pthread_mutex_unlock(&call->hub->mutex);
    const bool ok = source->measure(source->user, volume, &measure->geometry, SRV_MEASURE_SAMPLES,
                                    &measure->value, &call->err);
    pthread_mutex_lock(&call->hub->mutex);
    source->release(source->user, volume);
    call->code = PROTO_RPC_PARAMS;
    if (!ok)
        return false;
    const struct sp_statistics *statistics = &measure->value.result.statistics;
    p->measured_ms += (double)(statistics->count + statistics->nonfinite) * SAMPLE_MS;
    return p->session ||
           srv_call_refuse(call, PROTO_RPC_NOT_FOUND, NULL, "the session was deleted");
}

static void changed(struct srv_call *call) {
    struct srv_participant *p = call->participant;
    srv_hub_unsaved(call->hub, p->session);
    srv_hub_notify_others(call->hub, p->session, p->identity.id, SRV_NOTIFY_MEASURES);
}

bool srv_call_measure_put(struct srv_call *call) {
    static const char *const known[] = { "id", "kind", "points", "text", "color", "hidden", NULL };
    char id[PROTO_MEASURE_ID_MAX + 1];
    bool is_new;
    if (!srv_call_knows(call, known) || !may_edit(call) || !read_id(call, false, id))
        return false;
    struct proto_measure measure = begin(call, id, &is_new);
    call->code = PROTO_RPC_PARAMS;
    if (!proto_measure_apply(call->params, is_new, &measure, &call->err) || !has_quota(call))
        return false;
    if (proto_json_get(call->params, "points") && !compute(call, &measure))
        return false;
    if (!srv_measures_put(&call->participant->session->measures, &measure, &call->err)) {
        call->code = proto_rpc_code_from(call->err.code);
        return false;
    }
    changed(call);
    call->result = proto_measure_encode(&measure);
    return true;
}

bool srv_call_measure_remove(struct srv_call *call) {
    static const char *const known[] = { "id", NULL };
    char id[PROTO_MEASURE_ID_MAX + 1];
    if (!srv_call_knows(call, known) || !may_edit(call) || !read_id(call, true, id) ||
        !has_quota(call))
        return false;
    if (!srv_measures_remove(&call->participant->session->measures, id)) {
        call->code = PROTO_RPC_NOT_FOUND;
        return sp_fail(&call->err, SP_ERR_NOT_FOUND, "/id", "there is no measurement '%s'", id);
    }
    changed(call);
    call->result = proto_json_object();
    if (!proto_json_set_string(call->result, "id", id))
        proto_json_free(&call->result);
    return true;
}

bool srv_call_measure_list(struct srv_call *call) {
    static const char *const known[] = { NULL };
    if (!srv_call_knows(call, known))
        return false;
    call->result = proto_json_object();
    if (!proto_json_set(call->result, "measures",
                        srv_measures_encode(&call->participant->session->measures)))
        proto_json_free(&call->result);
    return true;
}

char *srv_measures_text(struct srv_participant *to, size_t *size) {
    const struct srv_measures *measures = &to->session->measures;
    proto_json *params = proto_json_object(), *ids = proto_json_array(), *news = proto_json_array();
    bool ok = true;
    for (size_t i = 0; i < measures->count; i++) {
        const struct srv_measure_item *item = &measures->items[i];
        ok = proto_json_append_string(ids, item->measure.id) && ok;
        if (item->clock > to->pending.measures_reported)
            ok = proto_json_append(news, proto_measure_encode(&item->measure)) && ok;
    }
    ok = proto_json_set(params, "ids", ids) && ok;
    ok = proto_json_set(params, "changed", news) && ok;
    if (!ok)
        proto_json_free(&params);
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
