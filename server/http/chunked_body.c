/* SPDX-License-Identifier: Apache-2.0 */
#include "http/chunked_body.h"

#include <stdlib.h>

#include "common/clock.h"
#include "http/listener_private.h"

enum { BLOCK = 64 * 1024 };

struct body {
    struct srv_request *request; /* alive whenever the body is read */
    struct srv_chunked_body body;
};

static void set_deadline(struct srv_request *request, double ms) {
    srv_deadlines_set(request->http->deadlines, request->connection, ms);
}

static ssize_t on_read(void *user, uint64_t position, char *bytes, size_t size) {
    (void)position; /* a body is read once, from start to end */
    struct body *body = user;
    struct srv_request *request = body->request;
    ssize_t n = body->body.read(body->body.user, bytes, size);
    if (n == SRV_BODY_PAUSED)
        return 0;
    if (!body->body.has_one_deadline)
        set_deadline(request, srv_clock_ms() + (double)request->app->config->request_time_ms);
    if (n > 0)
        srv_metrics_add(request->app->metrics, SRV_COUNT_HTTP_BYTES_OUT, (uint64_t)n);
    return n > 0               ? n
           : n == SRV_BODY_END ? MHD_CONTENT_READER_END_OF_STREAM
                               : MHD_CONTENT_READER_END_WITH_ERROR;
}

static void on_finish(void *user) {
    struct body *body = user;
    body->body.finish(body->body.user);
    free(body);
}

void srv_reply_chunked_body(struct srv_request *request, struct srv_reply *reply, uint64_t size,
                            const struct srv_chunked_body *from) {
    struct body *body = malloc(sizeof *body);
    if (body)
        *body = (struct body){ .request = request, .body = *from };
    reply->chunked_body = body ? MHD_create_response_from_callback(
                                     size == SRV_BODY_SIZE_UNKNOWN ? MHD_SIZE_UNKNOWN : size, BLOCK,
                                     on_read, body, on_finish)
                               : NULL;
    if (reply->chunked_body)
        return;
    from->finish(from->user);
    free(body);
    srv_reply_problem(reply, 503, NULL, "out of memory for a body");
}

void srv_chunked_body_pause(struct srv_request *request) {
    set_deadline(request, 0);
    MHD_suspend_connection(request->mhd);
}

void srv_chunked_body_resume(struct srv_request *request) {
    MHD_resume_connection(request->mhd);
}
