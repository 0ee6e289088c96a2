/* SPDX-License-Identifier: Apache-2.0
 *
 * One change of the measurements of a session, by a stream or over HTTP. Functions are called with
 * the hub's mutex held.
 */
#ifndef SRV_SESSION_MEASURE_EDIT_H
#define SRV_SESSION_MEASURE_EDIT_H

#include "protocol/rpc.h"
#include "session/session.h"

struct srv_measure_edit {
    struct srv_hub *hub;
    struct srv_session *session;
    enum srv_measure_change change;
    uint64_t by;        /* participant whose quota is charged and that is not notified; 0 = HTTP */
    const char *author; /* of a new measurement, and its colour */
    const char *color;  /* "#rrggbb" */
    double now_ms;
    enum proto_rpc_code code;  /* of an error */
    struct proto_measure made; /* the result of srv_measure_edit_prepare() */
    bool is_new;               /* it was added */
};

/* Returns how much work the change with the members of `body` takes. */
enum srv_measure_effort srv_measure_edit_effort(const struct srv_session *session, const char *id,
                                                const proto_json *body);
/* Computes the measurement `id` from the members of `body`; `id` NULL: a new one, whose id is made
 * here. Nobody sees it before srv_measure_edit_commit(), so that the caller can encode its answer
 * first. Releases the mutex while it computes. False with *err and edit->code. */
bool srv_measure_edit_prepare(struct srv_measure_edit *edit, const char *id, const proto_json *body,
                              struct sp_error *err);
/* Puts the computed measurement into the list, tells the participants, and marks the session for
 * saving. False with *err and edit->code. */
bool srv_measure_edit_commit(struct srv_measure_edit *edit, struct sp_error *err);
bool srv_measure_edit_remove(struct srv_measure_edit *edit, const char *id, struct sp_error *err);

#endif
