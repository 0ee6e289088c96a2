/* SPDX-License-Identifier: Apache-2.0
 *
 * One call of a method, for the files that hold methods. Methods run with the hub's mutex held.
 */
#ifndef SRV_SESSION_RPC_PRIVATE_H
#define SRV_SESSION_RPC_PRIVATE_H

#include "common/work_queue.h"
#include "session/session.h"

struct srv_call {
    struct srv_hub *hub;
    struct srv_participant *participant; /* its session exists */
    const proto_json *params;
    double now_ms;
    proto_json *result; /* NULL after success = out of memory */
    enum proto_rpc_code code;
    struct sp_error err;
    /* The method may take it over and set `later`: work that answers the call. */
    struct proto_rpc_message *message;
    struct srv_work *later; /* added to the hub's queue once the mutex is released */
};

/* True with *result, or false with *code and *err. */
typedef bool srv_method_fn(struct srv_call *call);

/* Sets code and error; returns false. */
bool srv_call_refuse(struct srv_call *call, enum proto_rpc_code code, const char *place,
                     const char *text);
/* Refuses members of the params that are not `known`, which ends with NULL. */
bool srv_call_knows(struct srv_call *call, const char *const *known);

/* Takes control for a method that changes the view. False with code and error: it may not. */
bool srv_call_take_control(struct srv_call *call);

srv_method_fn srv_call_time_play, srv_call_time_stop; /* play.c */
srv_method_fn srv_call_request_control, srv_call_release_control, srv_call_grant_control,
    srv_call_refuse_control;      /* control.c */
srv_method_fn srv_call_configure; /* settings.c */
srv_method_fn srv_call_measure_put, srv_call_measure_remove,
    srv_call_measure_list; /* measuring.c */
/* Sets call->later to measure.put with these params (measure_late.c). */
bool srv_call_measure_late(struct srv_call *call);

#endif
