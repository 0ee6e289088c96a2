/* SPDX-License-Identifier: Apache-2.0
 *
 * A request, from its first line until its answer was sent, and what handlers may do with it.
 */
#ifndef SRV_HTTP_REQUEST_H
#define SRV_HTTP_REQUEST_H

#include <microhttpd.h>
#include <pthread.h>
#include <stdint.h>

#include "config/config.h"
#include "config/tokens.h"
#include "http/answers.h"
#include "http/deadlines.h"
#include "http/listener.h"
#include "http/reply.h"
#include "http/router.h"
#include "http/smuggling.h"
#include "http/streams.h"
#include "paths/paths.h"
#include "render/render_pool.h"
#include "store/store.h"

struct srv_work;
struct srv_work_queue;

/* A header that came in several lines, joined to one list. */
struct srv_joined_header {
    struct srv_joined_header *next;
    const char *name; /* owned by libmicrohttpd */
    char text[];
};

struct srv_request {
    struct srv_http *http;
    const struct srv_http_options *app;
    struct MHD_Connection *mhd;
    struct srv_connection *connection;
    const struct srv_route *route;
    const char *method, *path;
    char param[SRV_PARAM_BYTES]; /* the part of the path that matched {} */
    char *body;                  /* NUL-terminated; NULL = empty */
    size_t body_size;
    struct srv_grant grant;   /* rights of the token; 0 without a valid token of the daemon */
    bool has_snapshot;        /* a snapshot is being rendered for it */
    struct srv_answer answer; /* an image or a slice that is being sent */
    struct srv_reply reply;
    struct srv_upload_body *upload_body; /* of PATCH /uploads/{id}; NULL = none */
    void *upgrade;                       /* state of a stream's handshake; freed with the request */

    size_t body_max;  /* bytes of the body that are stored; the handler refuses a longer body. 0 =
                         --body-size */
    size_t body_seen; /* including bytes that were discarded */
    size_t body_capacity;
    struct srv_joined_header *joined; /* headers that came in several lines */
    struct srv_request *next_head;    /* head_errors.h */
    pthread_t head_thread;
    struct srv_rejection target; /* why the request target is refused */
    size_t target_size;          /* its bytes, before it was decoded */
    bool is_last;                /* the connection closes after the answer */
    bool is_begun, is_refused, is_answered, is_dispatched, is_suspended, is_counted;
};

/* Returns a header, or NULL if the client did not send it. Several lines are joined to one list
 * (RFC 9110, 5.3). The text lives as long as the request. */
const char *srv_request_header(const struct srv_request *request, const char *name);
const char *srv_request_query(const struct srv_request *request, const char *key);
/* Returns the bearer token, or else the token of ?token=; NULL = none. */
const char *srv_request_token(const struct srv_request *request);

/* Writes the name and the quota of the token; without a token the name is empty. */
void srv_request_owner(const struct srv_request *request, struct srv_owner *owner);

/* Returns the name of the token whose objects the request may change; NULL = objects of all tokens,
 * because the request is from an admin. */
const char *srv_request_scope(const struct srv_request *request);

/* Parses the body, which must be a JSON object; an empty body is {}. NULL: the reply is a problem
 * document. */
proto_json *srv_request_json(const struct srv_request *request, struct srv_reply *reply);

/* A handler whose answer takes time calls suspend first, then starts the work. The thread that
 * finishes the work fills request->reply, touches nothing else, and calls complete once. */
void srv_request_suspend(struct srv_request *request);
void srv_request_complete(struct srv_request *request);
/* Suspends the request and adds the work that completes it to a queue of at most `most` works.
 * `what` names them in the plural. False: there are too many, or too many of the request's token;
 * the reply is a problem document, and the work is the caller's. */
bool srv_request_queue(struct srv_request *request, struct srv_work_queue *queue,
                       struct srv_work *work, unsigned most, const char *what);
/* Fills the reply, or suspends the request. */
typedef void srv_handler(struct srv_request *request, struct srv_reply *reply);
/* Lets `handle` fill the reply on the thread of a queue. Otherwise as srv_request_queue(). */
void srv_request_handle_later(struct srv_request *request, struct srv_work_queue *queue,
                              unsigned most, const char *what, srv_handler *handle);

/* Call it last, after the reply is filled, instead of srv_request_suspend() and
 * srv_request_complete(); if the request is suspended, instead of srv_request_complete(). Sends the
 * answer once the changes of the store and of sessions are on disk. The header X-Durable is "no" if
 * they are only in memory (no --state, or a full disk). */
void srv_request_reply_when_durable(struct srv_request *request);
/* Like srv_request_reply_when_durable(), for a change whose answer has no body: replies 204 once
 * the change is on disk, or with the error if `ok` is false. */
void srv_request_reply_changed(struct srv_request *request, bool ok, const struct sp_error *err);
/* Takes the quota (tokens.h) of a snapshot, until srv_request_end_snapshot() or the end of the
 * request. False: *err names the quota that is exceeded. */
bool srv_request_begin_snapshot(struct srv_request *request, struct sp_error *err);
void srv_request_end_snapshot(struct srv_request *request);
/* Acquires the memory (answers.h) of an answer that is made next, until the end of the request.
 * bytes: the memory while the answer is made. Errors: those of srv_answers_acquire(). */
bool srv_request_reserve_answer(struct srv_request *request, uint64_t bytes, struct sp_error *err);
/* Acquires the memory of an answer that already exists. SP_ERR_QUOTA, SP_ERR_MEMORY. */
bool srv_request_count_answer(struct srv_request *request, uint64_t bytes, struct sp_error *err);
/* Reduces the memory of an answer to `bytes`, once it is made. */
void srv_request_shrink_answer(struct srv_request *request, uint64_t bytes);
/* Returns the quota and the memory of a snapshot that was refused. The snapshot does not count
 * towards the fps quota. */
void srv_request_cancel_snapshot(struct srv_request *request);
/* Call after an upgrade: the connection is a stream from now on, and no longer a request. */
void srv_request_upgraded(struct srv_request *request);

#endif
