/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "http/assets.h"
#include "http/cors.h"
#include "http/headers.h"
#include "http/listener_private.h"
#include "http/routes.h"

/* The page loads nothing from other hosts and connects only to this daemon. Pages of the origins
 * that --allow-origin lists may frame it, others may not. */
static const char policy[] =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; worker-src 'self'; manifest-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors ";

/* Sets the policy. srv_cors_check_origins() limits the list, so that it fits. */
static void set_policy(struct srv_reply *reply, const char *origins) {
    char ancestors[SRV_ORIGINS_MAX + 1] = "'none'";
    if (origins && *origins)
        snprintf(ancestors, sizeof ancestors, "%s", origins);
    for (char *c = ancestors; *c; c++)
        if (*c == ',')
            *c = ' ';
    srv_reply_header(reply, "Content-Security-Policy", "%s%s", policy, ancestors);
}

static const struct srv_asset *find_asset(const char *path) {
    for (size_t i = 0; i < srv_asset_count; i++)
        if (strcmp(srv_assets[i].path, path) == 0)
            return &srv_assets[i];
    return NULL;
}

static void serve(struct srv_request *request, const struct srv_asset *asset,
                  struct srv_reply *reply) {
    const struct srv_packed_asset *packed = &request->http->packed[asset - srv_assets];
    srv_reply_static(reply, asset->mime, asset->begin, (size_t)(asset->end - asset->begin));
    reply->gzip = packed->gzip;
    reply->gzip_size = packed->gzip_size;
    srv_reply_header(reply, "ETag", "%s", packed->etag);
    srv_reply_header(reply, "Cache-Control", "no-cache");
}

bool srv_get_asset(struct srv_request *request, struct srv_reply *reply) {
    const char *path = strcmp(request->path, "/") == 0 ? "/index.html" : request->path;
    const struct srv_asset *asset = strncmp(path, "/api/", 5) == 0 ? NULL : find_asset(path);
    if (!asset)
        return false;
    serve(request, asset, reply);
    set_policy(reply, request->app->config->allow_origin);
    srv_reply_header(reply, "Referrer-Policy", "no-referrer");
    srv_reply_header(reply, "Cross-Origin-Opener-Policy", "same-origin");
    return true;
}

void srv_get_contract(struct srv_request *request, struct srv_reply *reply) {
    const struct srv_asset *asset = find_asset(request->path);
    if (asset)
        serve(request, asset, reply);
    else
        srv_reply_problem(reply, 404, NULL, "this build does not contain %s", request->path);
}

void srv_get_healthz(struct srv_request *request, struct srv_reply *reply) {
    (void)request;
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "status", "ok");
    srv_reply_json(reply, 200, json);
    srv_reply_header(reply, "Cache-Control", "no-store");
}

static proto_json *encode_state(struct srv_store *store) {
    struct srv_store_status status;
    srv_store_status(store, &status);
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "status",
                          !status.has_folder  ? "memory"
                          : status.is_failing ? "failing"
                                              : "written");
    if (status.is_failing)
        proto_json_set_string(&json, "reason", status.reason);
    proto_json_set_integer(&json, "waiting", status.waiting);
    return json;
}

void srv_get_readyz(struct srv_request *request, struct srv_reply *reply) {
    struct sp_renderer_info info[SRV_RENDERERS];
    const struct sp_renderer_info *backend = &info[0];
    srv_render_pool_info(request->app->render_pool, info);
    proto_json *json = proto_json_object(), *refused = proto_json_array();
    proto_json *vectorised = proto_json_array();
    proto_json_set_string(&json, "status", "ready");
    proto_json_set_string(&json, "version", SPLATD_VERSION);
    proto_json_set_string(&json, "backend", backend->backend);
    proto_json_set_string(&json, "device", backend->device);
    proto_json_set_string(&json, "isa", backend->isa);
    proto_json_set_integer(&json, "threads", backend->threads);
    proto_json_set_integer(&json, "lanes", backend->lanes);
    for (unsigned i = 0; backend->vectorised && backend->vectorised[i]; i++)
        proto_json_append_string(&vectorised, backend->vectorised[i]);
    proto_json_set(&json, "vectorised", vectorised);
    for (unsigned i = 0; i < request->app->refusal_count; i++)
        proto_json_append_string(&refused, request->app->refusals[i]);
    for (int i = 0; i < 2; i++)
        if (info[i].failover_reason[0])
            proto_json_append_string(&refused, info[i].failover_reason);
    for (int i = 0; i < 2; i++)
        if (info[i].fallback_reason[0])
            proto_json_append_string(&refused, info[i].fallback_reason);
    proto_json_set(&json, "refused", refused);
    proto_json_set(&json, "state", encode_state(request->app->store));
    srv_reply_json(reply, 200, json);
    srv_reply_header(reply, "Cache-Control", "no-store");
}
