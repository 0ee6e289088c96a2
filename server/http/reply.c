/* SPDX-License-Identifier: Apache-2.0 */
#include "http/reply.h"

#include <assert.h>
#include <microhttpd.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void srv_reply_finish(struct srv_reply *reply) {
    free(reply->owned);
    if (reply->chunked_body)
        MHD_destroy_response(reply->chunked_body);
    memset(reply, 0, sizeof *reply);
}

void srv_reply_header(struct srv_reply *reply, const char *name, const char *format, ...) {
    assert(reply->header_count < SRV_REPLY_HEADERS);
    va_list args;
    va_start(args, format);
    reply->headers[reply->header_count].name = name;
    char *value = reply->headers[reply->header_count++].value;
    vsnprintf(value, SRV_REPLY_VALUE, format, args);
    va_end(args);
    for (char *c = value; *c;
         c++) /* a header is one line, even if a name in it has control characters */
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            *c = '?';
}

static void set_text(struct srv_reply *reply, unsigned status, const char *mime, proto_json *json) {
    static const char no_memory[] =
        "{\"type\":\"about:blank\",\"title\":\"Service Unavailable\",\"status\":503,"
        "\"detail\":\"out of memory\"}";
    size_t size;
    char *text = proto_json_to_text(json, &size);
    proto_json_free(&json);
    if (text) {
        srv_reply_text(reply, status, mime, text, size);
        return;
    }
    free(reply->owned);
    reply->owned = NULL;
    reply->status = 503;
    reply->mime = "application/problem+json";
    reply->body = no_memory;
    reply->size = sizeof no_memory - 1;
}

void srv_reply_text(struct srv_reply *reply, unsigned status, const char *mime, char *text,
                    size_t size) {
    free(reply->owned);
    reply->body = reply->owned = text;
    reply->status = status;
    reply->mime = mime;
    reply->size = size;
}

void srv_reply_json(struct srv_reply *reply, unsigned status, proto_json *json) {
    set_text(reply, status, "application/json", json);
}

void srv_reply_static(struct srv_reply *reply, const char *mime, const void *body, size_t size) {
    reply->status = 200;
    reply->mime = mime;
    reply->body = body;
    reply->size = size;
}

static const char *title_of(unsigned status) {
    static const struct {
        unsigned status;
        const char *title;
    } titles[] = {
        { 400, "Bad Request" },
        { 401, "Unauthorized" },
        { 403, "Forbidden" },
        { 404, "Not Found" },
        { 405, "Method Not Allowed" },
        { 406, "Not Acceptable" },
        { 409, "Conflict" },
        { 412, "Precondition Failed" },
        { 413, "Content Too Large" },
        { 414, "URI Too Long" },
        { 415, "Unsupported Media Type" },
        { 416, "Range Not Satisfiable" },
        { 422, "Unprocessable Content" },
        { 426, "Upgrade Required" },
        { 429, "Too Many Requests" },
        { 460, "Checksum Mismatch" },
        { 500, "Internal Server Error" },
        { 503, "Service Unavailable" },
        { 507, "Insufficient Storage" },
    };
    for (size_t i = 0; i < sizeof titles / sizeof *titles; i++)
        if (titles[i].status == status)
            return titles[i].title;
    return "Error";
}

static void problem(struct srv_reply *reply, unsigned status, const char *pointer,
                    const char *detail) {
    proto_json *json = proto_json_object();
    snprintf(reply->detail, sizeof reply->detail, "%s", detail);
    proto_json_set_string(&json, "type", "about:blank");
    proto_json_set_string(&json, "title", title_of(status));
    proto_json_set_integer(&json, "status", status);
    proto_json_set_string(&json, "detail", detail);
    if (pointer && *pointer)
        proto_json_set_string(&json, "pointer", pointer);
    set_text(reply, status, "application/problem+json", json);
    if (status == 429 || status == 503)
        srv_reply_header(reply, "Retry-After", "1");
}

void srv_reply_problem(struct srv_reply *reply, unsigned status, const char *pointer,
                       const char *format, ...) {
    char detail[SP_ERROR_TEXT + 768]; /* it may have a list of all formats */
    va_list args;
    va_start(args, format);
    vsnprintf(detail, sizeof detail, format, args);
    va_end(args);
    problem(reply, status, pointer, detail);
}

unsigned srv_status_from(enum sp_code code) {
    switch (code) {
    case SP_ERR_INVALID:
    case SP_ERR_UNSUPPORTED:
        return 422;
    case SP_ERR_NOT_FOUND:
    case SP_ERR_VOLUME_UNKNOWN:
        return 404;
    case SP_ERR_FORMAT:
        return 400;
    case SP_ERR_DENIED:
        return 403;
    case SP_ERR_NOT_READY:
    case SP_ERR_VOLUME_FAILED:
        return 409;
    case SP_ERR_TOO_LARGE:
        return 413;
    case SP_ERR_QUOTA:
        return 429;
    case SP_ERR_MEMORY:
    case SP_ERR_BUDGET:
    case SP_ERR_FRAME_BUDGET:
    case SP_ERR_CANCELLED:
        return 503;
    case SP_OK:
    case SP_ERR_IO:
    case SP_ERR_TIMEOUT:
    case SP_ERR_CRASHED:
    case SP_ERR_BACKEND:
        break;
    }
    return 500;
}

void srv_reply_error(struct srv_reply *reply, const struct sp_error *err) {
    /* Only JSON pointers are sent; a place that names a file or a flag is not for the client. */
    bool pointer = err->place[0] == '/' && err->place[1] != '/';
    problem(reply, srv_status_from(err->code), pointer ? err->place : NULL, err->text);
    if (err->code == SP_ERR_NOT_READY)
        srv_reply_header(reply, "Retry-After", "1");
}

void srv_reply_result(struct srv_reply *reply, proto_json *json, const struct sp_error *err) {
    if (json)
        srv_reply_json(reply, 200, json);
    else
        srv_reply_error(reply, err);
}

void srv_reply_view_error(struct srv_reply *reply, const char *at, const struct sp_error *err) {
    struct sp_error here = *err;
    if (err->place[0] == '/')
        snprintf(here.place, sizeof here.place, "%s%.240s", at, err->place);
    if (err->code == SP_ERR_VOLUME_UNKNOWN)
        srv_reply_problem(reply, 422, here.place, "%s", err->text);
    else
        srv_reply_error(reply, &here);
}
