/* SPDX-License-Identifier: Apache-2.0
 *
 * One call of a method, for the files that hold methods. Methods run with the hub's mutex held.
 */
#ifndef SRV_SESSION_RPC_PRIVATE_H
#define SRV_SESSION_RPC_PRIVATE_H

#include "common/work_queue.h"
#include "session/session.h"

/* A call that takes time. A queue computes the answer, and the stream sends it among its
 * notifications. The participant may leave and the session may end meanwhile, so the work stores
 * their ids. (late.c) */
struct srv_late_call {
    struct srv_work work; /* first: the queue's */
    struct srv_work_queue *queue;
    struct srv_hub *hub;
    struct proto_rpc_message message;
    char session[SRV_SESSION_ID_BYTES];
    uint64_t participant;
    double now_ms; /* of the call */
    /* Returns the answer: malloc'ed, NULL when out of memory. With the mutex held, which it may
     * release meanwhile. */
    char *(*answer)(struct srv_late_call *late, size_t *size);
};

struct srv_call {
    struct srv_hub *hub;
    struct srv_participant *participant; /* the caller; its session exists */
    const proto_json *params;
    double now_ms;
    proto_json *result; /* NULL after success = out of memory */
    enum proto_rpc_code code;
    struct sp_error err;
    /* The method may take it over and set `later`: work that answers the call. */
    struct proto_rpc_message *message;
    struct srv_late_call *later; /* added to its queue once the mutex is released */
};

/* True with *result, or false with *code and *err. */
typedef bool srv_method_fn(struct srv_call *call);

/* Sets code and error; returns false. */
bool srv_call_refuse(struct srv_call *call, enum proto_rpc_code code, const char *place,
                     const char *text);
/* Refuses members of the params that are not `known`, which ends with NULL. */
bool srv_call_knows(struct srv_call *call, const char *const *known);

/* Acquires control for a method that changes the view. False with code and error: the participant
 * may not take control. */
bool srv_call_acquire_control(struct srv_call *call);

srv_method_fn srv_call_time_play, srv_call_time_stop; /* play.c */
srv_method_fn srv_call_request_control, srv_call_release_control, srv_call_grant_control,
    srv_call_refuse_control;      /* control.c */
srv_method_fn srv_call_configure; /* settings.c */
srv_method_fn srv_call_pick;      /* pick.c */
srv_method_fn srv_call_measure_put, srv_call_measure_remove,
    srv_call_measure_list; /* measuring.c */
/* Sets call->later to a call that `queue` answers, where at most `most` calls wait. `bytes`: the
 * size of the caller's struct, which begins with struct srv_late_call. NULL: the call is refused
 * with `refusal`, or memory is out. */
void *srv_call_later(struct srv_call *call, size_t bytes, struct srv_work_queue *queue,
                     unsigned most, const char *refusal);
/* The participant of a late call; NULL = it left. With the mutex held. */
struct srv_participant *srv_late_participant(const struct srv_late_call *late);

/* Sets call->later to measure.put with these params, which `queue` computes; at most `most` of its
 * calls wait (measure_late.c). */
bool srv_call_measure_late(struct srv_call *call, struct srv_work_queue *queue, unsigned most);

#endif
