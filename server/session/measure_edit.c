/* SPDX-License-Identifier: Apache-2.0 */
#include "session/measure_edit.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* The time that one sample costs of the quota, ms: 2 million samples of regions per second, and 40
 * million of volumes with parts. */
#define SAMPLE_MS (1 / 2000.0)
#define PART_SAMPLE_MS (1 / 40000.0)
enum { MADE_ID_DIGITS = 16 };

static bool refuse(struct srv_measure_edit *edit, enum proto_rpc_code code) {
    edit->code = code;
    return false;
}

/* Returns the time up to which the quota is used: of the participant, or, over HTTP and if it has
 * left, of the session. Valid until the mutex is released. */
static double *quota_of(const struct srv_measure_edit *edit) {
    for (struct srv_participant *p = edit->session->participants; p; p = p->next)
        if (p->identity.id == edit->by)
            return &p->measured_ms;
    return &edit->session->measured_ms;
}

static bool has_quota(struct srv_measure_edit *edit, struct sp_error *err) {
    double *quota_ms = quota_of(edit);
    const double next_ms = fmax(*quota_ms, edit->now_ms - 1000) + 1000.0 / SRV_MEASURES_PER_SECOND;
    if (next_ms > edit->now_ms) {
        sp_fail(err, SP_ERR_QUOTA, NULL,
                "at most 20 changes of measurements per second, and fewer with large regions; try "
                "again later");
        return refuse(edit, PROTO_RPC_LIMIT);
    }
    *quota_ms = next_ms;
    return true;
}

/* The id is a member of a message, but over HTTP a part of the address. */
static const char *id_place(const struct srv_measure_edit *edit) {
    return edit->by ? "/id" : NULL;
}

/* Checks the id, or makes one. */
static bool choose_id(struct srv_measure_edit *edit, const char *id,
                      char chosen[PROTO_MEASURE_ID_MAX + 1], struct sp_error *err) {
    if (!id)
        return srv_secret_hex(chosen, MADE_ID_DIGITS, err) || refuse(edit, PROTO_RPC_INTERNAL);
    if (!proto_measure_is_id(id)) {
        sp_fail(err, SP_ERR_INVALID, id_place(edit),
                "must be 1 to %d characters of A-Z a-z 0-9 _ -", PROTO_MEASURE_ID_MAX);
        return refuse(edit, PROTO_RPC_PARAMS);
    }
    strcpy(chosen, id);
    return true;
}

/* Fills in edit->made: a copy of the existing measurement, or a new one. */
static bool begin(struct srv_measure_edit *edit, const char *id, bool is_named,
                  const proto_json *body, struct sp_error *err) {
    const struct srv_measure_item *item = srv_measures_find(&edit->session->measures, id);
    struct proto_measure *made = &edit->made;
    edit->is_new = !item;
    if (is_named && !item &&
        (edit->change == SRV_MEASURE_CHANGE ||
         (edit->change == SRV_MEASURE_MERGE && !proto_json_get(body, "kind")))) {
        sp_fail(err, SP_ERR_NOT_FOUND, id_place(edit),
                "there is no measurement '%s'; give kind and points to add one", id);
        return refuse(edit, PROTO_RPC_NOT_FOUND);
    }
    if (item && edit->change != SRV_MEASURE_REPLACE) {
        *made = item->measure;
        return true;
    }
    *made = (struct proto_measure){ .is_hidden = false };
    snprintf(made->id, sizeof made->id, "%s", id);
    snprintf(made->volume, sizeof made->volume, "%s", edit->session->shared.view.volume);
    snprintf(made->color, sizeof made->color, "%s", edit->color);
    snprintf(made->author, sizeof made->author, "%s", item ? item->measure.author : edit->author);
    return true;
}

static bool has_place(const proto_json *body) {
    return proto_json_get(body, "points") || proto_json_get(body, "range");
}

enum srv_measure_effort srv_measure_edit_effort(const struct srv_session *session, const char *id,
                                                const proto_json *body) {
    const struct srv_measure_item *item = id ? srv_measures_find(&session->measures, id) : NULL;
    const char *name = proto_json_string(proto_json_get(body, "kind"));
    enum sp_measure_kind kind =
        item ? item->measure.geometry.kind : SP_MEASURE_DISTANCE; /* refused without a kind */
    for (enum sp_measure_kind k = 0; name && k < SP_MEASURE_KINDS; k++)
        if (strcmp(name, sp_measure_kind_name(k)) == 0)
            kind = k;
    return has_place(body) ? srv_measure_effort_of(kind) : SRV_MEASURE_AT_ONCE;
}

/* Computes the value without the mutex, so that others need not wait. The session may end
 * meanwhile, which is an error. */
static bool compute(struct srv_measure_edit *edit, struct sp_error *err) {
    struct srv_hub *hub = edit->hub;
    const struct srv_volume_source *source = &hub->options.volumes;
    struct proto_measure *made = &edit->made;
    char id[SRV_SESSION_ID_BYTES];
    memcpy(id, edit->session->identity.id, sizeof id);
    edit->code = PROTO_RPC_PARAMS;
    if (strcmp(made->volume, edit->session->shared.view.volume) != 0)
        return sp_fail(err, SP_ERR_INVALID, "/points",
                       "the measurement belongs to the volume %.100s, which the session does not "
                       "show; its points cannot change",
                       made->volume);
    const struct sp_view view = edit->session->shared.view;
    if (edit->session->shared.is_waiting)
        return sp_fail(err, SP_ERR_NOT_READY, "/points",
                       "time step %u is not loaded yet; measure again", view.time.step);
    struct srv_volume *volume = source->ref(source->user, edit->session->shared.displayed);
    pthread_mutex_unlock(&hub->mutex);
    const bool ok = source->measure(source->user, volume, &view, &made->geometry,
                                    SRV_MEASURE_SAMPLES, &made->value, err);
    pthread_mutex_lock(&hub->mutex);
    source->release(source->user, volume);
    if (!ok) {
        if (err->code == SP_ERR_MEMORY)
            edit->code = PROTO_RPC_INTERNAL;
        return false;
    }
    if (srv_hub_find_active(hub, id) != edit->session) {
        sp_fail(err, SP_ERR_NOT_FOUND, NULL, "the session was deleted");
        return refuse(edit, PROTO_RPC_NOT_FOUND);
    }
    const struct sp_statistics *statistics = &made->value.result.statistics;
    *quota_of(edit) += (double)(statistics->count + statistics->nonfinite) * SAMPLE_MS +
                       made->value.volume_samples * PART_SAMPLE_MS;
    return true;
}

static void changed(struct srv_measure_edit *edit) {
    srv_hub_unsaved(edit->hub, edit->session);
    srv_hub_notify_others(edit->hub, edit->session, edit->by, SRV_NOTIFY_MEASURES);
}

bool srv_measure_edit_prepare(struct srv_measure_edit *edit, const char *id, const proto_json *body,
                              struct sp_error *err) {
    char chosen[PROTO_MEASURE_ID_MAX + 1];
    if (!choose_id(edit, id, chosen, err) || !begin(edit, chosen, id != NULL, body, err))
        return false;
    const bool is_whole = edit->is_new || edit->change == SRV_MEASURE_REPLACE;
    if (!proto_measure_apply(body, is_whole, &edit->made, err))
        return refuse(edit, PROTO_RPC_PARAMS);
    return has_quota(edit, err) && (!has_place(body) || compute(edit, err));
}

bool srv_measure_edit_commit(struct srv_measure_edit *edit, struct sp_error *err) {
    if (!srv_measures_put(&edit->session->measures, &edit->made, err))
        return refuse(edit, proto_rpc_code_from(err->code));
    changed(edit);
    return true;
}

bool srv_measure_edit_remove(struct srv_measure_edit *edit, const char *id, struct sp_error *err) {
    char chosen[PROTO_MEASURE_ID_MAX + 1];
    if (!choose_id(edit, id ? id : "", chosen, err) || !has_quota(edit, err))
        return false;
    if (!srv_measures_remove(&edit->session->measures, chosen)) {
        sp_fail(err, SP_ERR_NOT_FOUND, id_place(edit), "there is no measurement '%s'", chosen);
        return refuse(edit, PROTO_RPC_NOT_FOUND);
    }
    changed(edit);
    return true;
}
