/* SPDX-License-Identifier: Apache-2.0
 *
 * measure.put of measurements that take time: another thread computes them. The session keeps the
 * result if it still exists then.
 */
#include <stdio.h>
#include <stdlib.h>

#include "session/measure_edit.h"
#include "session/rpc_private.h"

struct late_measure {
    struct srv_late_call call; /* first: it is this struct */
    char author[PROTO_MEASURE_AUTHOR_MAX + 1];
    char color[PROTO_MEASURE_COLOR_BYTES];
};

static char *measure(struct srv_late_call *call, size_t *size) {
    struct late_measure *late = (struct late_measure *)call;
    struct sp_error err = { .code = SP_OK };
    struct srv_session *session = srv_hub_find_active(call->hub, call->session);
    struct srv_measure_edit edit = { .hub = call->hub,
                                     .session = session,
                                     .change = SRV_MEASURE_MERGE,
                                     .by = call->participant,
                                     .author = late->author,
                                     .color = late->color,
                                     .now_ms = call->now_ms,
                                     .code = PROTO_RPC_NOT_FOUND };
    const proto_json *params = call->message.params;
    const char *id = proto_json_string(proto_json_get(params, "id"));
    proto_json *result = NULL;
    bool ok = session && !call->hub->is_draining
                  ? srv_measure_edit_prepare(&edit, id, params, &err)
                  : sp_fail(&err, SP_ERR_NOT_FOUND, NULL, "the session was deleted");
    if (ok) {
        result = proto_measure_encode(&edit.made);
        ok = !result || srv_measure_edit_commit(&edit, &err);
    }
    if (ok)
        return proto_rpc_result(call->message.id, result, size);
    proto_json_free(&result);
    return proto_rpc_error(call->message.id, edit.code, &err, size);
}

bool srv_call_measure_late(struct srv_call *call, struct srv_work_queue *queue, unsigned most) {
    const struct srv_participant *p = call->participant;
    struct late_measure *late = srv_call_later(
        call, sizeof *late, queue, most, "many measurements wait for the daemon; try again later");
    if (!late)
        return false;
    late->call.answer = measure;
    snprintf(late->author, sizeof late->author, "%s", p->identity.name);
    snprintf(late->color, sizeof late->color, "%s", srv_hub_color(p));
    return true;
}
