/* SPDX-License-Identifier: Apache-2.0 */
#include "http/request.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "common/clock.h"
#include "common/work_queue.h"
#include "http/headers.h"
#include "http/listener_private.h"

const char *srv_request_header(const struct srv_request *request, const char *name) {
    const struct srv_joined_header *joined = request->joined;
    while (joined && strcasecmp(joined->name, name) != 0)
        joined = joined->next;
    if (joined)
        return joined->text;
    return MHD_lookup_connection_value(request->mhd, MHD_HEADER_KIND, name);
}

const char *srv_request_query(const struct srv_request *request, const char *key) {
    return MHD_lookup_connection_value(request->mhd, MHD_GET_ARGUMENT_KIND, key);
}

const char *srv_request_token(const struct srv_request *request) {
    const char *bearer = srv_header_bearer_token(srv_request_header(request, "Authorization"));
    return bearer ? bearer : srv_request_query(request, "token");
}

const char *srv_request_scope(const struct srv_request *request) {
    return request->grant.rights & SRV_RIGHT_ADMIN ? NULL : request->grant.name;
}

void srv_request_owner(const struct srv_request *request, struct srv_owner *owner) {
    *owner = (struct srv_owner){ .quota = request->grant.quota };
    memcpy(owner->name, request->grant.name, sizeof owner->name);
}

proto_json *srv_request_json(const struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err = { .code = SP_OK };
    proto_json *json = request->body_size
                           ? proto_json_parse(request->body, request->body_size, &err)
                           : proto_json_parse("{}", 2, &err);
    if (!json) {
        srv_reply_error(reply, &err);
    } else if (proto_json_type(json) != PROTO_JSON_OBJECT) {
        proto_json_free(&json);
        srv_reply_problem(reply, 422, NULL, "the body must be a JSON object");
    }
    return json;
}

bool srv_request_begin_snapshot(struct srv_request *request, struct sp_error *err) {
    request->has_snapshot =
        srv_tokens_begin_snapshot(request->app->tokens, &request->grant, srv_clock_ms(), err);
    return request->has_snapshot;
}

static bool acquire_answer(struct srv_request *request, uint64_t bytes, bool is_made,
                           struct sp_error *err) {
    const struct srv_grant *grant = &request->grant;
    /* Guests of all sessions share what one owner may have. */
    struct srv_answer_owner owner = { .is_limited = grant->quota.is_limited || !grant->rights };
    snprintf(owner.name, sizeof owner.name, "%s", grant->name);
    return srv_answers_acquire(request->http->answers, &owner, bytes, is_made, &request->answer,
                               err);
}

bool srv_request_reserve_answer(struct srv_request *request, uint64_t bytes, struct sp_error *err) {
    return acquire_answer(request, bytes, false, err);
}

bool srv_request_count_answer(struct srv_request *request, uint64_t bytes, struct sp_error *err) {
    return acquire_answer(request, bytes, true, err);
}

void srv_request_shrink_answer(struct srv_request *request, uint64_t bytes) {
    srv_answers_shrink(request->http->answers, &request->answer, bytes);
}

static void end_snapshot(struct srv_request *request,
                         void (*end)(struct srv_tokens *tokens, const struct srv_grant *grant)) {
    srv_request_shrink_answer(request, 0);
    if (!request->has_snapshot)
        return;
    request->has_snapshot = false;
    end(request->app->tokens, &request->grant);
}

void srv_request_end_snapshot(struct srv_request *request) {
    end_snapshot(request, srv_tokens_end_snapshot);
}

void srv_request_cancel_snapshot(struct srv_request *request) {
    end_snapshot(request, srv_tokens_cancel_snapshot);
}

void srv_request_suspend(struct srv_request *request) {
    request->is_suspended = true;
    srv_deadlines_set(request->http->deadlines, request->connection, 0);
    MHD_suspend_connection(request->mhd);
}

bool srv_request_queue(struct srv_request *request, struct srv_work_queue *queue,
                       struct srv_work *work, unsigned most, const char *what) {
    const struct srv_grant *grant = &request->grant;
    /* Guests of all sessions share what one owner may have. */
    const bool is_limited = grant->quota.is_limited || !grant->rights;
    if (srv_work_queue_left(queue, grant->name, is_limited, most) == 0) {
        if (srv_work_queue_left(queue, grant->name, false, most) == 0)
            srv_reply_problem(&request->reply, 503, NULL, "%u %s wait already; try again later",
                              most, what);
        else
            srv_reply_problem(&request->reply, 429, NULL,
                              "too many %s of your token wait already; try again later", what);
        return false;
    }
    snprintf(work->owner, sizeof work->owner, "%s", grant->name);
    srv_request_suspend(request);
    srv_work_queue_add(queue, work);
    return true;
}

struct later {
    struct srv_work work; /* first: it is this struct */
    struct srv_request *request;
    srv_handler *handle;
};

static void run_later(struct srv_work *work) {
    struct later *later = (struct later *)work;
    struct srv_request *request = later->request;
    if (srv_hub_is_draining(request->app->hub))
        srv_reply_problem(&request->reply, 503, NULL, "the daemon stops");
    else
        later->handle(request, &request->reply);
    free(later);
    srv_request_complete(request);
}

void srv_request_handle_later(struct srv_request *request, struct srv_work_queue *queue,
                              unsigned most, const char *what, srv_handler *handle) {
    struct later *later = malloc(sizeof *later);
    if (!later) {
        srv_reply_problem(&request->reply, 503, NULL, "out of memory for a request");
        return;
    }
    *later = (struct later){ { .run = run_later }, request, handle };
    if (!srv_request_queue(request, queue, &later->work, most, what))
        free(later);
}

void srv_request_complete(struct srv_request *request) {
    MHD_resume_connection(request->mhd);
}

static void on_durable(void *user, bool durable) {
    struct srv_request *request = user;
    srv_reply_header(&request->reply, "X-Durable", "%s", durable ? "yes" : "no");
    srv_request_complete(request);
}

void srv_request_reply_when_durable(struct srv_request *request) {
    struct srv_store *store = request->app->store;
    if (!request->is_suspended)
        srv_request_suspend(request);
    /* From here on the request may be answered, and gone, at any moment. */
    srv_store_flush(store, on_durable, request);
}
void srv_request_reply_changed(struct srv_request *request, bool ok, const struct sp_error *err) {
    if (ok) {
        request->reply.status = 204;
        srv_request_reply_when_durable(request);
    } else {
        srv_reply_error(&request->reply, err);
    }
}
