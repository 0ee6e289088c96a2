/* SPDX-License-Identifier: Apache-2.0
 *
 * measure.put of a part or a path, which takes up to seconds: the measuring thread computes it, and
 * the stream gets the answer among its notifications.
 *
 *   stream thread: measure.put ─► queue        measuring thread: compute ─► late answer ─► stream
 *
 * The participant may leave and the session may end meanwhile, so the work knows them by their ids.
 * What is computed then is kept if the session still exists.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "session/measure_edit.h"
#include "session/rpc_private.h"

struct late_measure {
    struct srv_work work; /* first: it is this struct */
    struct srv_hub *hub;
    struct proto_rpc_message message;
    char session[SRV_SESSION_ID_BYTES];
    uint64_t participant;
    char author[PROTO_MEASURE_AUTHOR_MAX + 1];
    char color[PROTO_MEASURE_COLOR_BYTES];
    double now_ms;
};

static struct srv_participant *find_participant(struct srv_session *session, uint64_t id) {
    struct srv_participant *p = session ? session->participants : NULL;
    while (p && p->identity.id != id)
        p = p->next;
    return p;
}

/* Measures with the mutex held, which is released meanwhile. Returns the answer. */
static char *measure(struct late_measure *late, size_t *size) {
    struct sp_error err = { .code = SP_OK };
    struct srv_session *session = srv_hub_find_active(late->hub, late->session);
    struct srv_measure_edit edit = { .hub = late->hub,
                                     .session = session,
                                     .change = SRV_MEASURE_MERGE,
                                     .by = late->participant,
                                     .author = late->author,
                                     .color = late->color,
                                     .quota_ms = session ? &session->measured_ms : NULL,
                                     .now_ms = late->now_ms,
                                     .code = PROTO_RPC_NOT_FOUND };
    const proto_json *params = late->message.params;
    const char *id = proto_json_string(proto_json_get(params, "id"));
    proto_json *result = NULL;
    bool ok = session && !late->hub->is_draining
                  ? srv_measure_edit_prepare(&edit, id, params, &err)
                  : sp_fail(&err, SP_ERR_NOT_FOUND, NULL, "the session was deleted");
    if (ok) {
        result = proto_measure_encode(&edit.made);
        ok = !result || srv_measure_edit_commit(&edit, &err);
    }
    if (ok)
        return proto_rpc_result(late->message.id, result, size);
    proto_json_free(&result);
    return proto_rpc_error(late->message.id, edit.code, &err, size);
}

static void add_answer(struct srv_hub *hub, struct srv_participant *p, char *text, size_t size) {
    struct srv_late_answer *answer = malloc(sizeof *answer), **end = &p->pending.answers;
    if (!answer) { /* the client would wait for ever */
        free(text);
        srv_hub_close_stream(hub, p, 1011, "out of memory");
        return;
    }
    *answer = (struct srv_late_answer){ .text = text, .size = size };
    while (*end)
        end = &(*end)->next;
    *end = answer;
    srv_hub_notify(hub, p, 0);
}

static void run(struct srv_work *work) {
    struct late_measure *late = (struct late_measure *)work;
    struct srv_hub *hub = late->hub;
    size_t size = 0;
    pthread_mutex_lock(&hub->mutex);
    char *text = measure(late, &size);
    struct srv_participant *p =
        find_participant(srv_hub_find_active(hub, late->session), late->participant);
    if (p && late->message.has_id && text)
        add_answer(hub, p, text, size);
    else
        free(text);
    pthread_mutex_unlock(&hub->mutex);
    proto_rpc_finish(&late->message);
    free(late);
}

bool srv_call_measure_late(struct srv_call *call) {
    const struct srv_participant *p = call->participant;
    const struct srv_owner *owner = &p->session->identity.owner;
    if (srv_work_queue_left(call->hub->options.measuring, owner->name, owner->quota.is_limited,
                            SRV_MEASURING_MAX) == 0)
        return srv_call_refuse(call, PROTO_RPC_LIMIT, NULL,
                               "the daemon is measuring many parts; try again later");
    struct late_measure *late = malloc(sizeof *late);
    if (!late) {
        call->code = PROTO_RPC_INTERNAL;
        return sp_fail(&call->err, SP_ERR_MEMORY, NULL, "out of memory for a measurement");
    }
    *late = (struct late_measure){ .work = { .run = run },
                                   .hub = call->hub,
                                   .message = *call->message,
                                   .participant = p->identity.id,
                                   .now_ms = call->now_ms };
    memcpy(late->session, p->session->identity.id, sizeof late->session);
    snprintf(late->work.owner, sizeof late->work.owner, "%s", owner->name);
    snprintf(late->author, sizeof late->author, "%s", p->identity.name);
    snprintf(late->color, sizeof late->color, "%s", srv_hub_color(p));
    call->later = &late->work;
    return true;
}

char *srv_late_answer_take(struct srv_participant *participant, size_t *size) {
    struct srv_late_answer *answer = participant->pending.answers;
    char *text = answer->text;
    *size = answer->size;
    participant->pending.answers = answer->next;
    free(answer);
    return text;
}

void srv_late_answers_free(struct srv_participant *participant) {
    size_t size;
    while (participant->pending.answers)
        free(srv_late_answer_take(participant, &size));
}
