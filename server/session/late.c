/* SPDX-License-Identifier: Apache-2.0
 *
 * Calls that take time, so that the stream thread never does (struct srv_late_call).
 *
 *   stream thread: call ─► queue        thread of the queue: compute ─► late answer ─► stream
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "session/rpc_private.h"

struct srv_participant *srv_late_participant(const struct srv_late_call *late) {
    const struct srv_session *session = srv_hub_find_active(late->hub, late->session);
    struct srv_participant *p = session ? session->participants : NULL;
    while (p && p->identity.id != late->participant)
        p = p->next;
    return p;
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
    struct srv_late_call *late = (struct srv_late_call *)work;
    struct srv_hub *hub = late->hub;
    size_t size = 0;
    pthread_mutex_lock(&hub->mutex);
    char *text = late->answer(late, &size);
    struct srv_participant *p = srv_late_participant(late);
    if (p && late->message.has_id && text)
        add_answer(hub, p, text, size);
    else
        free(text);
    pthread_mutex_unlock(&hub->mutex);
    proto_rpc_finish(&late->message);
    free(late);
}

void *srv_call_later(struct srv_call *call, size_t bytes, struct srv_work_queue *queue,
                     unsigned most, const char *refusal) {
    const struct srv_participant *p = call->participant;
    const struct srv_owner *owner = &p->session->identity.owner;
    if (srv_work_queue_left(queue, owner->name, owner->quota.is_limited, most) == 0) {
        srv_call_refuse(call, PROTO_RPC_LIMIT, NULL, refusal);
        return NULL;
    }
    struct srv_late_call *late = calloc(1, bytes);
    if (!late) {
        call->code = PROTO_RPC_INTERNAL;
        sp_fail(&call->err, SP_ERR_MEMORY, NULL, "out of memory for a call");
        return NULL;
    }
    late->work.run = run;
    snprintf(late->work.owner, sizeof late->work.owner, "%s", owner->name);
    late->queue = queue;
    late->hub = call->hub;
    late->message = *call->message;
    memcpy(late->session, p->session->identity.id, sizeof late->session);
    late->participant = p->identity.id;
    late->now_ms = call->now_ms;
    call->later = late;
    return late;
}

char *srv_late_answer_pop(struct srv_participant *participant, size_t *size) {
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
        free(srv_late_answer_pop(participant, &size));
}
