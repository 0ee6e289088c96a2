/* SPDX-License-Identifier: Apache-2.0
 *
 * The life of a request: the callbacks of libmicrohttpd.
 */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "common/clock.h"
#include "http/head_errors.h"
#include "http/listener_private.h"
#include "http/request_checks.h"
#include "http/response.h"
#include "http/routes.h"
#include "http/upload_body.h"
#include "sp/log.h"

/* The body of a refused request is read and discarded up to this size: a client that is still
 * sending would otherwise not receive the answer. */
enum { DISCARD_BYTES = 16 * 1024 * 1024 };

/* Answers. */

static void count_answer(struct srv_request *request, unsigned status, size_t bytes) {
    struct srv_metrics *metrics = request->app->metrics;
    unsigned class = status >= 100 && status < 600 ? status / 100 - 1 : 4;
    srv_metrics_add(metrics, SRV_COUNT_HTTP_1XX + class, 1);
    srv_metrics_add(metrics, SRV_COUNT_HTTP_BYTES_IN, request->body_seen);
    srv_metrics_add(metrics, SRV_COUNT_HTTP_BYTES_OUT, bytes);
}

/* True if the request exceeded a limit. A request refused because of a shutdown did not. */
static bool is_over_limit(const struct srv_request *request) {
    static const unsigned statuses[] = { 413, 414, 429, 431, 503, 507 };
    bool found = false;
    for (size_t i = 0; i < sizeof statuses / sizeof *statuses; i++)
        found = found || request->reply.status == statuses[i];
    return found && request->reply.detail[0] && request->is_counted;
}

static void log_refusal(const struct srv_request *request) {
    const char *peer = srv_connection_peer(request->connection);
    sp_log_with(SP_LOG_WARN, SP_LOG_FIELDS({ "peer", peer }), "%s: %s %.100s refused: %u, %s", peer,
                request->method, request->path, request->reply.status, request->reply.detail);
}

static enum MHD_Result queue(struct srv_request *request) {
    const struct srv_reply *reply = &request->reply;
    const struct srv_config *config = request->app->config;
    struct MHD_Response *response = srv_response_create(request);
    if (!response)
        return MHD_NO;
    if (request->is_last)
        MHD_add_response_header(response, "Connection", "close");
    sp_log(SP_LOG_DEBUG, "%s %s %s: %u, %zu bytes", srv_connection_peer(request->connection),
           request->method, request->path, reply->status, reply->size);
    if (is_over_limit(request))
        log_refusal(request);
    if (!reply->chunked_body)
        srv_request_shrink_answer(request, reply->size);
    enum MHD_Result result = MHD_queue_response(request->mhd, reply->status, response);
    count_answer(request, reply->status, reply->size);
    MHD_destroy_response(response);
    request->is_answered = true;
    srv_deadlines_set(request->http->deadlines, request->connection,
                      srv_clock_ms() + (double)config->request_time_ms);
    return result;
}

/* Checks the token again after the body, because it may have been revoked meanwhile. */
static bool check_again(struct srv_request *request) {
    if (request->body_seen == 0 || !request->route)
        return true;
    srv_tokens_release(request->app->tokens, &request->grant);
    srv_tokens_acquire(request->app->tokens, srv_request_token(request), &request->grant);
    return srv_request_check_right(request, request->route->needs);
}

static void dispatch(struct srv_request *request) {
    request->is_dispatched = true;
    if (!request->is_refused && check_again(request)) {
        if (request->route)
            /* After this the reply of a suspended request belongs to the thread that completes it.
             */
            request->route->handle(request, &request->reply);
        else if (!srv_get_asset(request, &request->reply))
            srv_reply_problem(&request->reply, 404, NULL, "there is nothing at %.200s",
                              request->path);
    }
}

/* Callbacks of libmicrohttpd. */

/* Called when the request line was read. Returns the state for srv_on_request(). `target` lies in
 * the library's buffer, which the library parses afterwards. */
void *srv_on_target(void *user, const char *target, struct MHD_Connection *connection) {
    struct srv_http *http = user;
    struct srv_request *request = calloc(1, sizeof *request);
    const union MHD_ConnectionInfo *info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
    if (!request || !info || !info->socket_context) {
        free(request);
        return NULL;
    }
    request->http = http;
    request->app = &http->options;
    request->mhd = connection;
    request->connection = info->socket_context;
    srv_head_begin(request);
    request->target_size = target ? strlen(target) : 0;
    if (target)
        request->target = srv_smuggling_check_target((char *)(uintptr_t)target,
                                                     (size_t)http->options.config->header_size / 4);
    return request;
}

/* Delays a shutdown until uncount(). Does nothing if the shutdown has begun. */
static void count(struct srv_request *request) {
    struct srv_http *http = request->http;
    pthread_mutex_lock(&http->mutex);
    request->is_counted = !http->draining;
    if (request->is_counted)
        http->active++;
    pthread_mutex_unlock(&http->mutex);
}

static enum MHD_Result on_headers(struct srv_request *request, const char *version) {
    request->is_begun = true;
    srv_head_end(request);
    count(request);
    bool is_over = srv_request_is_refused_at_once(request, version);
    request->is_last = is_over || srv_connection_count_request(request->connection) >=
                                      (unsigned)request->app->config->connection_requests;
    request->is_refused = is_over || !srv_request_check(request);
    srv_deadlines_set(request->http->deadlines, request->connection,
                      srv_clock_ms() + (double)request->app->config->request_time_ms);
    /* A client that waits for permission to send its body gets the answer instead. */
    const char *length = srv_request_header(request, "Content-Length");
    bool is_too_long = length && strtoull(length, NULL, 10) > DISCARD_BYTES;
    if (is_over || (request->is_refused && (is_too_long || srv_request_header(request, "Expect"))))
        return queue(request);
    return MHD_YES;
}

/* Stores the bytes. Discards the bytes of a refused body, and bytes past body_max. */
static enum MHD_Result on_body(struct srv_request *request, const char *bytes, size_t *size) {
    size_t limit = (size_t)request->app->config->body_size, take = *size;
    if (request->upload_body && !request->is_refused) {
        srv_upload_body_append(request, bytes, size);
        return MHD_YES;
    }
    *size = 0;
    request->body_seen += take;
    if (request->body_seen > DISCARD_BYTES)
        return MHD_NO;
    if (!request->is_refused && request->body_seen > limit) {
        srv_reply_problem(&request->reply, 413, NULL,
                          "the body has more than the %zu bytes that --body-size allows", limit);
        request->is_refused = true;
    }
    if (request->is_refused || (request->body_max && request->body_seen > request->body_max))
        return MHD_YES;
    if (request->body_seen + 1 > request->body_capacity) {
        size_t capacity = (request->body_seen + 1) * 2;
        char *larger = realloc(request->body, capacity);
        if (!larger) {
            srv_reply_problem(&request->reply, 503, NULL, "out of memory for the body");
            request->is_refused = true;
            return MHD_YES;
        }
        request->body = larger;
        request->body_capacity = capacity;
    }
    memcpy(request->body + request->body_size, bytes, take);
    request->body_size += take;
    request->body[request->body_size] = 0;
    return MHD_YES;
}

/* Returns the path of a target, which may have the absolute form "http://host/path" (RFC 9112,
 * section 3.2.2). */
static const char *path_of(const char *target) {
    const char *authority = strncasecmp(target, "http://", 7) == 0    ? target + 7
                            : strncasecmp(target, "https://", 8) == 0 ? target + 8
                                                                      : NULL;
    const char *path = authority ? authority + strcspn(authority, "/") : target;
    return *path ? path : "/";
}

enum MHD_Result srv_on_request(void *user, struct MHD_Connection *connection, const char *path,
                               const char *method, const char *version, const char *bytes,
                               size_t *size, void **state) {
    (void)user;
    (void)connection;
    struct srv_request *request = *state;
    if (!request)
        return MHD_NO;
    request->path = path_of(path);
    request->method = method;
    if (!request->is_begun)
        return on_headers(request, version);
    if (*size > 0)
        return on_body(request, bytes, size);
    if (request->is_answered)
        return MHD_YES;
    if (!request->is_dispatched) {
        dispatch(request);
        if (request->is_suspended || request->is_answered)
            return MHD_YES;
    }
    return queue(request);
}

/* The request no longer delays a shutdown. Call once. */
static void uncount(struct srv_request *request) {
    struct srv_http *http = request->http;
    request->is_counted = false;
    pthread_mutex_lock(&http->mutex);
    http->active--;
    pthread_cond_broadcast(&http->idle);
    pthread_mutex_unlock(&http->mutex);
}

void srv_request_upgraded(struct srv_request *request) {
    count_answer(request, MHD_HTTP_SWITCHING_PROTOCOLS, 0);
    request->is_answered = true;
    srv_deadlines_set(request->http->deadlines, request->connection, 0);
    uncount(request);
}

void srv_on_completed(void *user, struct MHD_Connection *connection, void **state,
                      enum MHD_RequestTerminationCode code) {
    (void)connection;
    struct srv_http *http = user;
    struct srv_request *request = *state;
    *state = NULL;
    if (!request)
        return;
    srv_deadlines_set(http->deadlines, request->connection,
                      code == MHD_REQUEST_TERMINATED_COMPLETED_OK
                          ? srv_clock_ms() + (double)http->options.config->idle_time_ms
                          : 0);
    if (request->is_counted)
        uncount(request);
    if (!request->is_begun)
        srv_head_end(request);
    srv_upload_body_close(request);
    srv_reply_finish(&request->reply);
    srv_request_end_snapshot(request);
    srv_tokens_release(request->app->tokens, &request->grant);
    while (request->joined) {
        struct srv_joined_header *joined = request->joined;
        request->joined = joined->next;
        free(joined);
    }
    free(request->upgrade);
    free(request->body);
    free(request);
}
