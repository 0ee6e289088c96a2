/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "common/clock.h"
#include "http/headers.h"
#include "http/listener_private.h"
#include "http/response.h"
#include "sp/log.h"

enum {
    DISCARD_BYTES =
        16 * 1024 *
        1024 /* read and discarded of a refused body, so that the client receives the answer */
};

/* The query parameters of a route besides "token" (struct srv_route). */
/* clang-format off */
#define NONE { NULL }
#define PAGE { "after", "limit" }
#define IMAGE { "format", "quality", "subsampling" }
#define SAVED_IMAGE { "camera", "size", "format", "quality", "subsampling" }
/* clang-format on */

static const struct srv_route routes[] = {
    { SRV_GET, "/healthz", SRV_RIGHT_NONE, srv_get_healthz, NONE },
    { SRV_GET, "/metrics", SRV_RIGHT_METRICS, srv_get_metrics, NONE },
    { SRV_GET, "/readyz", SRV_RIGHT_NONE, srv_get_readyz, NONE },
    { SRV_GET, "/api/v1/openapi.json", SRV_RIGHT_NONE, srv_get_contract, NONE },
    { SRV_GET, "/api/v1/openapi.yaml", SRV_RIGHT_NONE, srv_get_contract, NONE },
    { SRV_GET, "/api/v1/view.schema.json", SRV_RIGHT_NONE, srv_get_contract, NONE },
    { SRV_GET, "/api/v1/stream.md", SRV_RIGHT_NONE, srv_get_contract, NONE },
    { SRV_GET, "/api/v1/stream.schema.json", SRV_RIGHT_NONE, srv_get_contract, NONE },
    { SRV_GET, "/api/v1/volumes", SRV_RIGHT_VIEW, srv_get_volumes, NONE },
    { SRV_POST, "/api/v1/volumes", SRV_RIGHT_ADMIN, srv_post_volume, NONE },
    { SRV_GET, "/api/v1/volumes/{}", SRV_RIGHT_VIEW, srv_get_volume, NONE },
    { SRV_DELETE, "/api/v1/volumes/{}", SRV_RIGHT_ADMIN, srv_delete_volume, NONE },
    { SRV_GET, "/api/v1/volumes/{}/view", SRV_RIGHT_VIEW, srv_get_volume_view, NONE },
    { SRV_POST, "/api/v1/render", SRV_RIGHT_RENDER, srv_post_render, IMAGE },
    { SRV_GET, "/api/v1/render/{}", SRV_RIGHT_RENDER, srv_get_render, SAVED_IMAGE },
    { SRV_GET, "/api/v1/views", SRV_RIGHT_RENDER, srv_get_views, PAGE },
    { SRV_POST, "/api/v1/views", SRV_RIGHT_RENDER, srv_post_view, NONE },
    { SRV_GET, "/api/v1/views/{}", SRV_RIGHT_VIEW, srv_get_view, NONE },
    { SRV_DELETE, "/api/v1/views/{}", SRV_RIGHT_RENDER, srv_delete_view, NONE },
    { SRV_GET, "/api/v1/presets", SRV_RIGHT_VIEW, srv_get_presets, NONE },
    { SRV_GET, "/api/v1/presets/{}", SRV_RIGHT_VIEW, srv_get_preset, NONE },
    { SRV_PUT, "/api/v1/presets/{}", SRV_RIGHT_CONTROL, srv_put_preset, NONE },
    { SRV_DELETE, "/api/v1/presets/{}", SRV_RIGHT_CONTROL, srv_delete_preset, NONE },
    { SRV_GET, "/api/v1/paths", SRV_RIGHT_RENDER, srv_get_paths, PAGE },
    { SRV_POST, "/api/v1/paths", SRV_RIGHT_RENDER, srv_post_path, NONE },
    { SRV_GET, "/api/v1/paths/{}", SRV_RIGHT_RENDER, srv_get_path, NONE },
    { SRV_DELETE, "/api/v1/paths/{}", SRV_RIGHT_RENDER, srv_delete_path, NONE },
    { SRV_GET, "/api/v1/paths/{}/events", SRV_RIGHT_RENDER, srv_get_path_events, NONE },
    { SRV_GET, "/api/v1/paths/{}/frames/{}", SRV_RIGHT_RENDER, srv_get_path_frame, NONE },
    { SRV_GET, "/api/v1/paths/{}/archive", SRV_RIGHT_RENDER, srv_get_path_archive, NONE },
    { SRV_GET, "/api/v1/paths/{}/movie", SRV_RIGHT_RENDER, srv_get_path_movie, NONE },
    { SRV_GET, "/api/v1/sessions", SRV_RIGHT_CONTROL, srv_get_sessions, PAGE },
    { SRV_POST, "/api/v1/sessions", SRV_RIGHT_SESSION, srv_post_session, NONE },
    { SRV_GET, "/api/v1/sessions/{}", SRV_RIGHT_SESSION, srv_get_session, NONE },
    { SRV_PATCH, "/api/v1/sessions/{}", SRV_RIGHT_SESSION, srv_patch_session, NONE },
    { SRV_DELETE, "/api/v1/sessions/{}", SRV_RIGHT_CONTROL, srv_delete_session, NONE },
    { SRV_GET, "/api/v1/sessions/{}/stream", SRV_RIGHT_SESSION, srv_get_stream, NONE },
};
enum { ROUTES = sizeof routes / sizeof *routes };

/* A header that came in several lines, joined to one list. */
struct srv_joined_header {
    struct srv_joined_header *next;
    const char *name; /* owned by libmicrohttpd */
    char text[];
};

/* For handlers. */

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

bool srv_request_begin_snapshot(struct srv_request *request, uint64_t bytes, struct sp_error *err) {
    const struct srv_http_options *app = request->app;
    if (!srv_tokens_begin_snapshot(app->tokens, &request->grant, srv_clock_ms(), err))
        return false;
    if (!srv_snapshot_memory_reserve(app->snapshot_memory, bytes, err)) {
        srv_tokens_cancel_snapshot(app->tokens, &request->grant);
        return false;
    }
    request->has_snapshot = true;
    request->snapshot_bytes = bytes;
    return true;
}

static void end_snapshot(struct srv_request *request,
                         void (*end)(struct srv_tokens *tokens, const struct srv_grant *grant)) {
    if (!request->has_snapshot)
        return;
    request->has_snapshot = false;
    end(request->app->tokens, &request->grant);
    srv_snapshot_memory_change(request->app->snapshot_memory, &request->snapshot_bytes, 0);
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

void srv_request_complete(struct srv_request *request) {
    MHD_resume_connection(request->mhd);
}

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
    enum MHD_Result result = MHD_queue_response(request->mhd, reply->status, response);
    count_answer(request, reply->status, reply->size);
    MHD_destroy_response(response);
    request->is_answered = true;
    srv_deadlines_set(request->http->deadlines, request->connection,
                      srv_clock_ms() + (double)config->request_time_ms);
    return result;
}

/* True if the token has the right that the route needs; else the reply is a problem document. */
static bool check_right(struct srv_request *request, enum srv_right needs) {
    struct srv_reply *reply = &request->reply;
    if (needs == SRV_RIGHT_SESSION)
        return srv_session_admits(request, reply);
    if (needs == SRV_RIGHT_NONE || request->grant.rights & needs)
        return true;
    if (request->grant.rights) {
        srv_reply_problem(reply, 403, NULL, "the role of this token does not include this");
        return false;
    }
    srv_reply_problem(
        reply, 401, NULL,
        "give a token of the daemon as \"Authorization: Bearer TOKEN\" or ?token=TOKEN");
    srv_reply_header(reply, "WWW-Authenticate", "Bearer realm=\"splatd\"");
    return false;
}

/* Checks the token again after the body, because it may have been revoked meanwhile. */
static bool check_again(struct srv_request *request) {
    if (request->body_seen == 0 || !request->route)
        return true;
    srv_tokens_give_back(request->app->tokens, &request->grant);
    srv_tokens_find(request->app->tokens, srv_request_token(request), &request->grant);
    return check_right(request, request->route->needs);
}

static enum MHD_Result dispatch(struct srv_request *request) {
    request->is_dispatched = true;
    if (!request->is_refused && check_again(request)) {
        if (request->route)
            request->route->handle(request, &request->reply);
        /* From here on the reply of a suspended request belongs to the thread that completes it. */
        else if (!srv_get_asset(request, &request->reply))
            srv_reply_problem(&request->reply, 404, NULL, "there is nothing at %.200s",
                              request->path);
    }
    return MHD_YES;
}

/* Checks before the body. */

/* If the methods include PATCH: lists the media types of patches (RFC 5789, 2.2 and 3.1). */
static void list_patch_types(struct srv_reply *reply, unsigned methods) {
    if (methods & SRV_PATCH)
        srv_reply_header(reply, "Accept-Patch", SRV_JSON_TYPES);
}

static void refuse_method(struct srv_request *request, unsigned allowed) {
    char allow[64];
    srv_methods_to_text(allowed, allow);
    srv_reply_problem(&request->reply, 405, NULL, "the method %.16s is not allowed here; use %s",
                      request->method, allow);
    srv_reply_header(&request->reply, "Allow", "%s", allow);
    list_patch_types(&request->reply, allowed);
}

static bool check_limits(struct srv_request *request) {
    long long connections = request->http->connections;
    const struct sockaddr *host =
        (const struct sockaddr *)srv_connection_address(request->connection);
    unsigned from_host = srv_http_connections_from(request->http, host);
    size_t all, same_host;
    srv_deadlines_count(request->http->deadlines, host, &all, &same_host);
    if (all > (size_t)connections) {
        srv_connection_refused(request->app->metrics, SRV_REFUSED_FULL,
                               "%s refused: %zu connections, --connections %lld",
                               srv_connection_peer(request->connection), all, connections);
        srv_reply_problem(&request->reply, 503, NULL,
                          "%zu connections are open and --connections allows %lld; try again later",
                          all, connections);
    } else if (same_host > from_host) {
        srv_connection_refused(request->app->metrics, SRV_REFUSED_ADDRESS,
                               "%s refused: %zu connections, --connections-per-address %u",
                               srv_connection_peer(request->connection), same_host, from_host);
        srv_reply_problem(&request->reply, 429, NULL,
                          "%zu connections from your address are open and "
                          "--connections-per-address allows %u",
                          same_host, from_host);
    } else {
        return true;
    }
    request->reply.detail[0] = 0; /* logged already */
    request->is_last = true;
    return false;
}

struct header_scan {
    struct srv_request *request;
    struct srv_smuggling smuggling;
    bool has_memory;
};

/* Appends a line to the earlier lines of the same name. False when out of memory. */
static bool join_header(struct srv_request *request, const char *name, const char *value) {
    struct srv_joined_header **at = &request->joined;
    while (*at && strcasecmp((*at)->name, name) != 0)
        at = &(*at)->next;
    const char *before = srv_request_header(request, name);
    size_t had = before ? strlen(before) : 0, size = had + 2 + strlen(value) + 1;
    struct srv_joined_header *joined = realloc(*at, sizeof *joined + size);
    if (!joined)
        return false;
    if (!*at) {
        *joined = (struct srv_joined_header){ .name = name };
        memcpy(joined->text, before ? before : "", had);
    }
    snprintf(joined->text + had, size - had, ", %s", value);
    *at = joined;
    return true;
}

static enum MHD_Result on_header(void *user, enum MHD_ValueKind kind, const char *name,
                                 const char *value) {
    struct header_scan *scan = user;
    struct srv_request *request = scan->request;
    srv_smuggling_add_header(&scan->smuggling, name, value);
    bool is_first = MHD_lookup_connection_value(request->mhd, kind, name) == value;
    if (!is_first && value && scan->smuggling.all <= SRV_HEADERS_MAX)
        scan->has_memory = join_header(request, name, value) && scan->has_memory;
    return MHD_YES;
}

/* True if the request is answered at once, without header_scan its body, and the connection closes.
 */
static bool is_refused_at_once(struct srv_request *request, const char *version) {
    struct srv_rejection refusal = request->target;
    if (!refusal.status) {
        struct header_scan scan = { .request = request, .has_memory = true };
        MHD_get_connection_values(request->mhd, MHD_HEADER_KIND, on_header, &scan);
        refusal = srv_smuggling_check_headers(&scan.smuggling, version);
        if (!refusal.status && !scan.has_memory)
            refusal = (struct srv_rejection){ 503, "no memory for the headers" };
    }
    if (!refusal.status && !request->is_counted)
        refusal = (struct srv_rejection){ 503, "the daemon is shutting down" };
    if (!refusal.status)
        return false;
    srv_reply_problem(&request->reply, refusal.status, NULL, "%s", refusal.detail);
    return true;
}

struct query_check {
    struct srv_request *request;
    bool is_refused;
};

/* Refuses a query parameter that the route does not take, or that is given twice. */
static enum MHD_Result check_parameter(void *user, enum MHD_ValueKind kind, const char *name,
                                       const char *value) {
    struct query_check *query = user;
    const struct srv_route *route = query->request->route;
    bool is_known = srv_route_takes(route, name);
    if (is_known && MHD_lookup_connection_value(query->request->mhd, kind, name) == value)
        return MHD_YES;
    query->is_refused = true;
    if (is_known) {
        srv_reply_problem(&query->request->reply, 400, NULL,
                          "the query parameter \"%.64s\" is given more than once", name);
        return MHD_NO;
    }
    char known[128] = "";
    for (size_t i = 0; i < SRV_QUERY_NAMES && route->query[i]; i++)
        snprintf(known + strlen(known), sizeof known - strlen(known), "%s, ", route->query[i]);
    srv_reply_problem(&query->request->reply, 400, NULL,
                      "unknown query parameter \"%.64s\"; this path takes %stoken", name, known);
    return MHD_NO;
}

/* False if a query parameter was refused: the reply is a problem document. */
static bool check_query(struct srv_request *request) {
    struct query_check query = { .request = request };
    MHD_get_connection_values(request->mhd, MHD_GET_ARGUMENT_KIND, check_parameter, &query);
    return !query.is_refused;
}

/* Finds the route and checks the headers. False: the reply is set. */
static bool check(struct srv_request *request) {
    struct srv_reply *reply = &request->reply;
    unsigned allowed;
    if (!check_limits(request))
        return false;
    srv_tokens_find(request->app->tokens, srv_request_token(request), &request->grant);
    request->route =
        srv_route_find(routes, ROUTES, request->method, request->path, request->param, &allowed);
    if (allowed && srv_cors_is_preflight(request)) {
        srv_cors_reply_preflight(reply, allowed);
        return false;
    }
    bool is_api = strncmp(request->path, "/api/", 5) == 0;
    enum srv_right unknown = is_api ? SRV_RIGHT_VIEW : SRV_RIGHT_NONE;
    if (!check_right(request, request->route ? request->route->needs : unknown))
        return false;
    unsigned method = srv_method_from(request->method);
    if (!request->route && (allowed || method != SRV_GET) && !(is_api && !allowed)) {
        refuse_method(request, allowed ? allowed : SRV_GET);
        return false;
    }
    if (request->route && !check_query(request))
        return false;
    if (request->route && method & (SRV_POST | SRV_PUT | SRV_PATCH) &&
        !srv_header_is_json(srv_request_header(request, "Content-Type"))) {
        srv_reply_problem(reply, 415, NULL,
                          "the body must be application/json or application/merge-patch+json");
        list_patch_types(reply, method);
        return false;
    }
    const char *length = srv_request_header(request, "Content-Length");
    if (length && strtoull(length, NULL, 10) > (uint64_t)request->app->config->body_size) {
        srv_reply_problem(reply, 413, NULL, "the body has %.20s bytes and --body-size allows %lld",
                          length, (long long)request->app->config->body_size);
        return false;
    }
    return true;
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
    count(request);
    bool is_over = is_refused_at_once(request, version);
    request->is_last = is_over || srv_connection_count_request(request->connection) >=
                                      (unsigned)request->app->config->connection_requests;
    request->is_refused = is_over || !check(request);
    srv_deadlines_set(request->http->deadlines, request->connection,
                      srv_clock_ms() + (double)request->app->config->request_time_ms);
    /* A client that waits for permission to send its body gets the answer instead. */
    const char *length = srv_request_header(request, "Content-Length");
    bool is_too_long = length && strtoull(length, NULL, 10) > DISCARD_BYTES;
    if (is_over || (request->is_refused && (is_too_long || srv_request_header(request, "Expect"))))
        return queue(request);
    return MHD_YES;
}

/* Stores the bytes. Discards those of a refused body and those past body_max. */
static enum MHD_Result on_body(struct srv_request *request, const char *bytes, size_t *size) {
    size_t limit = (size_t)request->app->config->body_size, take = *size;
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
            srv_reply_problem(&request->reply, 503, NULL, "no memory for the body");
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
    srv_reply_finish(&request->reply);
    srv_request_end_snapshot(request);
    srv_tokens_give_back(request->app->tokens, &request->grant);
    while (request->joined) {
        struct srv_joined_header *joined = request->joined;
        request->joined = joined->next;
        free(joined);
    }
    free(request->upgrade);
    free(request->body);
    free(request);
}
