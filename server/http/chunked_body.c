/* SPDX-License-Identifier: Apache-2.0 */
#include "http/chunked_body.h"

#include <stdlib.h>

#include "common/clock.h"
#include "http/http.h"

enum { BLOCK = 64 * 1024 };

struct body {
    struct srv_request *request; /* alive whenever the body is read */
    struct srv_flow flow;
};

static void set_deadline(struct srv_request *request, double ms) {
    srv_guard_set_deadline(request->http->guard, request->guarded, ms);
}

static ssize_t on_read(void *user, uint64_t position, char *bytes, size_t size) {
    (void)position; /* bodies are read once, from begin to end */
    struct body *body = user;
    struct srv_request *request = body->request;
    ssize_t n = body->flow.read(body->flow.user, bytes, size);
    if (n == SRV_FLOW_ASLEEP)
        return 0;
    if (!body->flow.is_one)
        set_deadline(request, srv_clock_ms() + (double)request->app->config->request_time_ms);
    if (n > 0)
        srv_metrics_add(request->app->metrics, SRV_COUNT_HTTP_BYTES_OUT, (uint64_t)n);
    return n > 0               ? n
           : n == SRV_FLOW_END ? MHD_CONTENT_READER_END_OF_STREAM
                               : MHD_CONTENT_READER_END_WITH_ERROR;
}

static void on_finish(void *user) {
    struct body *body = user;
    body->flow.finish(body->flow.user);
    free(body);
}

void srv_reply_flow(struct srv_request *request, struct srv_reply *reply, uint64_t size,
                    const struct srv_flow *flow) {
    struct body *body = malloc(sizeof *body);
    if (body)
        *body = (struct body){ .request = request, .flow = *flow };
    reply->flow =
        body ? MHD_create_response_from_callback(size == SRV_FLOW_UNKNOWN ? MHD_SIZE_UNKNOWN : size,
                                                 BLOCK, on_read, body, on_finish)
             : NULL;
    if (reply->flow)
        return;
    flow->finish(flow->user);
    free(body);
    srv_reply_problem(reply, 503, NULL, "no memory for a body");
}

void srv_flow_sleep(struct srv_request *request) {
    set_deadline(request, 0);
    MHD_suspend_connection(request->connection);
}

void srv_flow_wake(struct srv_request *request) {
    MHD_resume_connection(request->connection);
}
