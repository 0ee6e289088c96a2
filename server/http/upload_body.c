/* SPDX-License-Identifier: Apache-2.0 */
#include "http/upload_body.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "common/clock.h"
#include "http/deadlines.h"
#include "http/listener_private.h"
#include "http/routes.h"
#include "http/routes_uploads.h"
#include "http/upload_headers.h"
#include "uploads/uploads.h"

enum { BLOCK_BYTES = 256 * 1024, CHECKSUM_MISMATCH = 460 };

struct srv_upload_body {
    struct srv_work work;
    struct srv_request *request; /* NULL once it has ended */
    struct srv_upload_writer writer;
    struct srv_checksum *checksum; /* NULL = none */
    struct sp_error err;           /* of a write that failed; code SP_OK = none */
    bool is_first_after_pause, is_ended;
    size_t used;
    char block[BLOCK_BYTES];
};

bool srv_upload_body_is_for(const struct srv_route *route) {
    return route && route->handle == srv_patch_upload;
}

static bool is_type(const char *content_type) {
    size_t length = sizeof SRV_UPLOAD_TYPE - 1;
    return content_type && strncasecmp(content_type, SRV_UPLOAD_TYPE, length) == 0 &&
           strchr("; \t", content_type[length]); /* also its NUL */
}

/* Reads the headers. False: the reply is a problem document. */
static bool read_headers(struct srv_request *request, uint64_t *offset, uint64_t *length,
                         struct srv_checksum **checksum) {
    struct srv_reply *reply = &request->reply;
    const char *sum = srv_request_header(request, "Upload-Checksum");
    const char *size = srv_request_header(request, "Content-Length");
    unsigned char digest[SRV_DIGEST_BYTES];
    int algorithm;
    *length = 0;
    *checksum = NULL;
    if (!srv_upload_check_version(request, reply))
        return false;
    if (!is_type(srv_request_header(request, "Content-Type"))) {
        srv_reply_problem(reply, 415, NULL, "the body must be " SRV_UPLOAD_TYPE);
        srv_reply_header(reply, "Accept-Patch", SRV_UPLOAD_TYPE);
    } else if (!srv_upload_number(srv_request_header(request, "Upload-Offset"), offset)) {
        srv_reply_problem(reply, 400, NULL,
                          "the header Upload-Offset must be the number of bytes sent before");
    } else if (size && !srv_upload_number(size, length)) {
        srv_reply_problem(reply, 413, NULL, "the body has %.20s bytes", size);
    } else if (sum && !srv_checksum_parse(sum, &algorithm, digest)) {
        srv_reply_problem(reply, 400, NULL,
                          "the header Upload-Checksum must be an algorithm of " SRV_TUS_CHECKSUMS
                          ", a space and the digest in base64");
    } else if (sum && !(*checksum = srv_checksum_create(algorithm, digest))) {
        srv_reply_problem(reply, 503, NULL, "out of memory for a checksum");
    } else {
        return true;
    }
    return false;
}

bool srv_upload_body_open(struct srv_request *request) {
    struct srv_upload_body *body = NULL;
    struct srv_checksum *checksum;
    struct sp_error err;
    uint64_t offset, length, at = UINT64_MAX;
    if (!read_headers(request, &offset, &length, &checksum))
        return false;
    if (!request->app->uploads)
        srv_uploads_reply_none(&request->reply);
    else if (!(body = malloc(sizeof *body)))
        srv_reply_problem(&request->reply, 503, NULL, "out of memory for an upload");
    else if (srv_upload_begin(request->app->uploads, request->param, srv_request_scope(request),
                              offset, length, checksum != NULL, &body->writer, &at, &err)) {
        body->request = request;
        body->checksum = checksum;
        body->err = (struct sp_error){ .code = SP_OK };
        body->is_first_after_pause = body->is_ended = false;
        body->used = 0;
        request->upload_body = body;
        return true;
    } else if (at != UINT64_MAX) { /* the offset is wrong */
        srv_reply_problem(&request->reply, 409, NULL, "%s", err.text);
        srv_upload_headers(&request->reply, NULL);
        srv_reply_header(&request->reply, "Upload-Offset", "%" PRIu64, at);
    } else {
        srv_uploads_reply_error(&request->reply, &err);
    }
    srv_checksum_matches(&checksum); /* frees it */
    free(body);
    return false;
}

/* On the disk thread, or without a request. */
static void write_block(struct srv_upload_body *body) {
    if (body->err.code == SP_OK && body->checksum)
        srv_checksum_add(body->checksum, body->block, body->used);
    if (body->err.code == SP_OK && body->used > 0)
        srv_upload_write(&body->writer, body->block, body->used, srv_clock_ms(), &body->err);
    body->used = 0;
}

static void run_block(struct srv_work *work) {
    struct srv_upload_body *body = (struct srv_upload_body *)work;
    write_block(body);
    srv_request_complete(body->request);
}

void srv_upload_body_append(struct srv_request *request, const char *bytes, size_t *size) {
    struct srv_upload_body *body = request->upload_body;
    if (body->is_first_after_pause)
        srv_deadlines_set(request->http->deadlines, request->connection,
                          srv_clock_ms() + (double)request->app->config->request_time_ms);
    body->is_first_after_pause = false;
    if (body->err.code != SP_OK) { /* the answer says why, as soon as the client reads it */
        request->body_seen += *size;
        *size = 0;
        return;
    }
    size_t left = BLOCK_BYTES - body->used, take = *size < left ? *size : left;
    memcpy(body->block + body->used, bytes, take);
    body->used += take;
    request->body_seen += take;
    *size -= take;
    if (body->used < BLOCK_BYTES)
        return;
    body->is_first_after_pause = true;
    body->work.run = run_block;
    srv_request_suspend(request);
    request->is_suspended = false; /* it goes on with its body, not with an answer */
    srv_work_queue_add(request->app->disk, &body->work);
}

static void reply_end(struct srv_upload_body *body, const struct srv_upload_info *info, bool ok,
                      bool is_intact) {
    struct srv_reply *reply = &body->request->reply;
    if (!is_intact) {
        srv_reply_problem(reply, CHECKSUM_MISMATCH, NULL,
                          "the bytes do not have the checksum of Upload-Checksum; send them again");
        srv_upload_headers(reply, NULL);
    } else if (!ok) {
        srv_uploads_reply_error(reply, &body->err);
    } else {
        reply->status = 204;
        srv_upload_headers(reply, info);
        srv_reply_header(reply, "X-Durable", "%s", info->is_private ? "no" : "yes");
    }
}

/* Writes what is left and ends the writer. */
static void end(struct srv_upload_body *body) {
    struct srv_upload_info info;
    struct sp_error err;
    write_block(body);
    bool is_atomic = body->checksum != NULL;
    bool is_whole = body->request && body->err.code == SP_OK; /* else the connection was lost */
    bool is_intact = srv_checksum_matches(&body->checksum) || !is_whole;
    bool ok = srv_upload_end(&body->writer, !is_atomic || (is_whole && is_intact), srv_clock_ms(),
                             &info, &err);
    if (!ok && body->err.code == SP_OK)
        body->err = err;
    body->is_ended = true;
    if (body->request)
        reply_end(body, &info, body->err.code == SP_OK, is_intact);
}

static void run_end(struct srv_work *work) {
    struct srv_upload_body *body = (struct srv_upload_body *)work;
    end(body);
    srv_request_complete(body->request);
}

void srv_patch_upload(struct srv_request *request, struct srv_reply *reply) {
    (void)reply;
    request->upload_body->work.run = run_end;
    srv_request_suspend(request);
    srv_work_queue_add(request->app->disk, &request->upload_body->work);
}

static void run_abandon(struct srv_work *work) {
    struct srv_upload_body *body = (struct srv_upload_body *)work;
    if (!body->is_ended)
        end(body);
    free(body);
}

void srv_upload_body_close(struct srv_request *request) {
    struct srv_upload_body *body = request->upload_body;
    request->upload_body = NULL;
    if (!body)
        return;
    body->request = NULL;
    body->work.run = run_abandon;
    srv_work_queue_add(request->app->disk, &body->work);
}
