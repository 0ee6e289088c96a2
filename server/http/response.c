/* SPDX-License-Identifier: Apache-2.0 */
#include "http/response.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "http/cors.h"
#include "http/gzip.h"
#include "http/headers.h"

static const char request_headers[] =
    "Authorization, Content-Type, If-None-Match, "
    "If-Range, Last-Event-ID, Range, Tus-Resumable, Upload-Checksum, "
    "Upload-Length, Upload-Metadata, Upload-Offset";
static const char exposed_headers[] =
    "Accept-Ranges, Content-Disposition, Content-Range, ETag, Location, "
    "Retry-After, WWW-Authenticate, X-Bricks-Lost, X-Camera, X-Complete, X-Level, X-Level-Asked, "
    "X-Render-Time, "
    "Tus-Checksum-Algorithm, Tus-Extension, Tus-Max-Size, Tus-Resumable, Tus-Version, "
    "Upload-Expires, Upload-Length, Upload-Offset, X-Encode-Time, X-Backend, X-Splats, X-Slice, "
    "X-Durable";

static bool is_allowed_origin(const struct srv_request *request) {
    return srv_cors_allows(request->app->config->allow_origin,
                           srv_request_header(request, "Origin"));
}

bool srv_cors_is_preflight(const struct srv_request *request) {
    return strcmp(request->method, "OPTIONS") == 0 &&
           srv_request_header(request, "Access-Control-Request-Method") &&
           is_allowed_origin(request);
}

void srv_cors_reply_preflight(struct srv_reply *reply, unsigned allowed) {
    char methods[64];
    srv_methods_to_text(allowed, methods);
    reply->status = 204;
    srv_reply_header(reply, "Access-Control-Allow-Methods", "%s", methods);
    srv_reply_header(reply, "Access-Control-Allow-Headers", "%s", request_headers);
    srv_reply_header(reply, "Access-Control-Max-Age", "600");
}

/* Replaces the body by a compressed one. False if the body does not change. */
static bool compress(struct srv_request *request) {
    struct srv_reply *reply = &request->reply;
    const char *accepted = srv_request_header(request, "Accept-Encoding");
    size_t size;
    if (!accepted || srv_header_accept_quality(accepted, "gzip") <= 0)
        return false;
    if (reply->gzip) {
        reply->body = reply->gzip;
        reply->size = reply->gzip_size;
        return true;
    }
    void *gzip = srv_gzip(reply->body, reply->size, SRV_GZIP_FAST, &size);
    if (!gzip)
        return false;
    free(reply->owned);
    reply->body = reply->owned = gzip;
    reply->size = size;
    return true;
}

static void add_headers(struct MHD_Response *response, const struct srv_request *request,
                        bool is_gzip, bool may_gzip) {
    const struct srv_reply *reply = &request->reply;
    const char *origins = request->app->config->allow_origin;
    if (reply->mime)
        MHD_add_response_header(response, "Content-Type", reply->mime);
    MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
    for (unsigned i = 0; i < reply->header_count; i++) {
        const char *name = reply->headers[i].name, *value = reply->headers[i].value;
        char weak[SRV_REPLY_VALUE + 2] =
            "W/"; /* weak, because the bytes differ from the uncompressed ones */
        if (is_gzip && strcmp(name, "ETag") == 0)
            value = strcat(weak, value);
        MHD_add_response_header(response, name, value);
    }
    if (is_gzip && reply->status != 304)
        MHD_add_response_header(response, "Content-Encoding", "gzip");
    if (may_gzip)
        MHD_add_response_header(response, "Vary", "Accept-Encoding");
    if (origins)
        MHD_add_response_header(response, "Vary", "Origin");
    if (is_allowed_origin(request)) {
        MHD_add_response_header(response, "Access-Control-Allow-Origin",
                                srv_request_header(request, "Origin"));
        MHD_add_response_header(response, "Access-Control-Expose-Headers", exposed_headers);
    }
}

/* True if the client has this version already. The answer is 304 then, with the headers of the
 * whole answer (RFC 9110, 15.4.5). */
static bool is_known(const struct srv_request *request) {
    const struct srv_reply *reply = &request->reply;
    const char *known = srv_request_header(request, "If-None-Match");
    for (unsigned i = 0; known && reply->status == 200 && i < reply->header_count; i++)
        if (strcmp(reply->headers[i].name, "ETag") == 0)
            return srv_header_has_etag(known, reply->headers[i].value);
    return false;
}

static void drop_body(struct srv_reply *reply) {
    free(reply->owned);
    reply->status = 304;
    reply->mime = NULL;
    reply->body = reply->owned = NULL;
    reply->size = 0;
}

struct MHD_Response *srv_response_create(struct srv_request *request) {
    struct srv_reply *reply = &request->reply;
    bool may_gzip = srv_gzip_is_for(reply->mime, reply->size);
    bool is_gzip = may_gzip && compress(request);
    if (!reply->chunked_body && is_known(request))
        drop_body(reply);
    struct MHD_Response *response =
        reply->chunked_body ? reply->chunked_body
        : reply->owned
            ? MHD_create_response_from_buffer(reply->size, reply->owned, MHD_RESPMEM_MUST_FREE)
            : MHD_create_response_from_buffer(reply->size, (void *)(uintptr_t)reply->body,
                                              MHD_RESPMEM_PERSISTENT);
    if (!response)
        return NULL;
    reply->owned = NULL;
    reply->chunked_body = NULL;
    add_headers(response, request, is_gzip, may_gzip);
    return response;
}
