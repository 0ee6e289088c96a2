/* SPDX-License-Identifier: Apache-2.0 */
#include "http/request_checks.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "common/fair_owners.h"
#include "http/connection_limits.h"
#include "http/headers.h"
#include "http/listener_private.h"
#include "http/response.h"
#include "http/routes.h"
#include "http/upload_body.h"
#include "http/upload_headers.h"

void srv_request_refuse_token(struct srv_request *request, const char *how) {
    bool is_given = srv_request_token(request) != NULL;
    srv_reply_problem(
        &request->reply, 401, NULL, "%s; %s",
        is_given
            ? "the daemon does not know this token; the token of a session opens only this session"
            : "a token is missing",
        how);
    srv_reply_header(&request->reply, "WWW-Authenticate", "Bearer realm=\"splatd\"%s",
                     is_given ? ", error=\"invalid_token\"" : "");
}

bool srv_request_check_right(struct srv_request *request, enum srv_right needs) {
    struct srv_reply *reply = &request->reply;
    if (needs & (SRV_RIGHT_SESSION | SRV_RIGHT_SESSION_CONTROL))
        return srv_session_admits(request, reply);
    if (needs == SRV_RIGHT_NONE || request->grant.rights & needs)
        return true;
    if (request->grant.rights) {
        srv_reply_problem(reply, 403, NULL, "the role of this token does not include this");
        return false;
    }
    srv_request_refuse_token(
        request, "give a token of the daemon as \"Authorization: Bearer TOKEN\" or ?token=TOKEN");
    return false;
}

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
    const struct srv_route *patch =
        srv_routes_find("PATCH", request->path, request->param, &(unsigned){ 0 });
    if (srv_upload_body_is_for(patch))
        srv_reply_header(&request->reply, "Accept-Patch", SRV_UPLOAD_TYPE);
    else
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
                               "%s refused: %zu connections are open, --connections allows %lld",
                               srv_connection_peer(request->connection), all, connections);
        srv_reply_problem(&request->reply, 503, NULL,
                          "%zu connections are open and --connections allows %lld; try again later",
                          all, connections);
    } else if (same_host > from_host) {
        srv_connection_refused(request->app->metrics, SRV_REFUSED_ADDRESS,
                               "%s refused: %zu of its connections are open, "
                               "--connections-per-address allows %u",
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

/* Whose connection this is: the token, or for a stream of a guest the owner of its session. */
static void owner_of(const struct srv_request *request, bool is_stream,
                     char owner[SRV_FAIR_OWNER_BYTES]) {
    const struct srv_grant *grant = &request->grant;
    struct srv_owner session = { .name = "" };
    if (!grant->rights && is_stream)
        srv_hub_session_owner(request->app->hub, request->param, &session);
    snprintf(owner, SRV_FAIR_OWNER_BYTES, "%s%s", grant->rights ? "" : "guest ",
             grant->rights ? grant->name : session.name);
}

/* An owner has a share of the connections. Above it, requests are answered and their connections
 * closed, but streams, which stay open, are refused. */
static bool check_share(struct srv_request *request) {
    const struct srv_grant *grant = &request->grant;
    const long long most = request->http->connections;
    srv_handler *handle = request->route ? request->route->handle : NULL;
    const bool is_stream = handle == srv_get_stream || handle == srv_get_path_events;
    char owner[SRV_FAIR_OWNER_BYTES];
    size_t own;
    owner_of(request, is_stream, owner);
    if (srv_deadlines_own(request->http->deadlines, request->connection, owner,
                          grant->quota.is_limited || !grant->rights, (size_t)most, &own))
        return true;
    request->is_last = true;
    if (!is_stream)
        return true;
    const char *who = grant->rights ? grant->name : "the guests of the session's owner";
    srv_connection_refused(request->app->metrics, SRV_REFUSED_OWNER,
                           "%s refused: %s: %zu connections, the share of --connections %lld",
                           srv_connection_peer(request->connection), who, own, most);
    srv_reply_problem(&request->reply, 429, NULL,
                      "%s: %zu connections are open, and --connections allows %lld for all; the "
                      "rest is kept for others; close some",
                      who, own, most);
    request->reply.detail[0] = 0; /* logged already */
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
    if (value)
        srv_header_trim((char *)(uintptr_t)value); /* in the memory of the library */
    bool is_first = MHD_lookup_connection_value(request->mhd, kind, name) == value;
    if (!is_first && value && scan->smuggling.all <= SRV_HEADERS_MAX)
        scan->has_memory = join_header(request, name, value) && scan->has_memory;
    return MHD_YES;
}

/* Later versions of the library split a head in other ways, and are stricter themselves. */
static bool leaves_gaps(void) {
    return strcmp(MHD_get_version(), "0.9.75") <= 0;
}

bool srv_request_has_bad_head(struct srv_request *request) {
    struct header_scan scan = { .request = request, .has_memory = true };
    MHD_get_connection_values(request->mhd, MHD_HEADER_KIND, on_header, &scan);
    const struct srv_rejection refusal =
        srv_smuggling_check_headers(&scan.smuggling, MHD_HTTP_VERSION_1_1);
    if (refusal.status)
        srv_reply_problem(&request->reply, refusal.status, NULL, "%s", refusal.detail);
    return refusal.status != 0;
}

bool srv_request_is_refused_at_once(struct srv_request *request, const char *version) {
    struct srv_rejection refusal = request->target;
    if (!refusal.status) {
        struct header_scan scan = { .request = request, .has_memory = true };
        const union MHD_ConnectionInfo *head =
            MHD_get_connection_info(request->mhd, MHD_CONNECTION_INFO_REQUEST_HEADER_SIZE);
        const bool has_gaps = head && leaves_gaps();
        if (has_gaps)
            srv_smuggling_begin(&scan.smuggling, request->method, request->target_size, version);
        MHD_get_connection_values(request->mhd, MHD_HEADER_KIND, on_header, &scan);
        if (has_gaps)
            srv_smuggling_end(&scan.smuggling, request->method + head->header_size);
        refusal = srv_smuggling_check_headers(&scan.smuggling, version);
        if (!refusal.status && !scan.has_memory)
            refusal = (struct srv_rejection){ 503, "out of memory for the headers" };
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
    bool is_known = srv_route_accepts(route, name);
    if (is_known && value && MHD_lookup_connection_value(query->request->mhd, kind, name) == value)
        return MHD_YES;
    query->is_refused = true;
    if (is_known && !value) {
        srv_reply_problem(&query->request->reply, 400, NULL,
                          "the query parameter \"%.64s\" has no value; give %.64s=VALUE", name,
                          name);
        return MHD_NO;
    }
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

bool srv_request_check(struct srv_request *request) {
    struct srv_reply *reply = &request->reply;
    unsigned allowed;
    if (!check_limits(request))
        return false;
    srv_tokens_acquire(request->app->tokens, srv_request_token(request), &request->grant);
    request->route = srv_routes_find(request->method, request->path, request->param, &allowed);
    if (!check_share(request))
        return false;
    if (srv_cors_is_preflight(request)) {
        srv_routes_find("", request->path, request->param, &allowed);
        if (allowed) {
            srv_cors_reply_preflight(reply, allowed);
            return false;
        }
    }
    bool is_api = strncmp(request->path, "/api/", 5) == 0;
    enum srv_right unknown = is_api ? SRV_RIGHT_VIEW : SRV_RIGHT_NONE;
    if (!srv_request_check_right(request, request->route ? request->route->needs : unknown))
        return false;
    unsigned method = srv_method_bit(request->method);
    if (!request->route && (allowed || method != SRV_GET) && !(is_api && !allowed)) {
        refuse_method(request, allowed ? allowed : SRV_GET);
        return false;
    }
    if (request->route && !check_query(request))
        return false;
    if (srv_upload_body_is_for(request->route))
        return srv_upload_body_open(request);
    bool is_tus = request->route && request->route->handle == srv_post_upload &&
                  srv_request_header(request, "Upload-Length"); /* the headers say it all */
    if (request->route && method & (SRV_POST | SRV_PUT | SRV_PATCH) && !is_tus &&
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
