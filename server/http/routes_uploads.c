/* SPDX-License-Identifier: Apache-2.0
 *
 * Uploads: the core of the tus protocol 1.0 with its extensions creation, expiration, checksum and
 * termination. A client that is not a tus client creates an upload with JSON.
 */
#include "http/routes_uploads.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "common/clock.h"
#include "http/routes.h"
#include "http/upload_headers.h"
#include "render/formats.h"

bool srv_upload_check_version(const struct srv_request *request, struct srv_reply *reply) {
    const char *version = srv_request_header(request, "Tus-Resumable");
    if (!version || strcmp(version, SRV_TUS_VERSION) == 0)
        return true;
    srv_reply_problem(reply, 412, NULL, "Tus-Resumable: %.20s is not %s", version, SRV_TUS_VERSION);
    srv_reply_header(reply, "Tus-Version", SRV_TUS_VERSION);
    return false;
}

void srv_upload_headers(struct srv_reply *reply, const struct srv_upload_info *info) {
    srv_reply_header(reply, "Tus-Resumable", SRV_TUS_VERSION);
    if (!info)
        return;
    srv_reply_header(reply, "Upload-Offset", "%" PRIu64, info->offset);
    srv_reply_header(reply, "Upload-Length", "%" PRIu64, info->bytes);
    srv_reply_header(reply, "Cache-Control", "no-store");
    if (!isfinite(info->expires_ms))
        return;
    char text[40];
    struct tm utc;
    time_t at = srv_clock_date().tv_sec + (time_t)(info->expires_ms / 1000);
    if (gmtime_r(&at, &utc) && strftime(text, sizeof text, "%a, %d %b %Y %H:%M:%S GMT", &utc))
        srv_reply_header(reply, "Upload-Expires", "%s", text);
}

void srv_uploads_reply_none(struct srv_reply *reply) {
    srv_reply_problem(reply, 403, NULL,
                      "this daemon takes no uploads; start it with --upload-bytes SIZE");
}

void srv_uploads_reply_error(struct srv_reply *reply, const struct sp_error *err) {
    const char *pointer = err->place[0] == '/' ? err->place : NULL;
    switch (err->code) {
    case SP_ERR_BUDGET: /* to wait does not help: no 429 and no Retry-After */
    case SP_ERR_QUOTA:
        srv_reply_problem(reply, 507, pointer, "%s", err->text);
        break;
    case SP_ERR_CANCELLED:
        srv_reply_problem(reply, 409, pointer, "%s", err->text);
        break;
    case SP_ERR_IO: /* the client may try again; the log has the details */
        srv_reply_problem(reply, 503, pointer, "%s", err->text);
        break;
    default:
        srv_reply_error(reply, err);
    }
    srv_upload_headers(reply, NULL);
}

static bool check(struct srv_request *request, struct srv_reply *reply) {
    if (request->app->uploads)
        return srv_upload_check_version(request, reply);
    srv_uploads_reply_none(reply);
    return false;
}

/* Encodes {"id", "name", …}. NULL when out of memory. */
static proto_json *encode_upload(const struct srv_upload_info *info) {
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "id", info->id);
    proto_json_set_string(&json, "name", info->name);
    proto_json_set_string(&json, "owner", info->owner);
    if (info->header[0])
        proto_json_set_string(&json, "header", info->header);
    proto_json_set_integer(&json, "bytes", (int64_t)info->bytes);
    proto_json_set_integer(&json, "offset", (int64_t)info->offset);
    if (info->modified_ms)
        proto_json_set_integer(&json, "modified", info->modified_ms);
    if (isfinite(info->expires_ms))
        proto_json_set_number(&json, "expires", round(info->expires_ms / 1000));
    return json;
}

void srv_options_uploads(struct srv_request *request, struct srv_reply *reply) {
    if (!check(request, reply))
        return;
    struct srv_uploads_numbers numbers;
    srv_uploads_numbers(request->app->uploads, request->grant.name, &numbers);
    reply->status = 204;
    srv_upload_headers(reply, NULL);
    srv_reply_header(reply, "Tus-Version", SRV_TUS_VERSION);
    srv_reply_header(reply, "Tus-Extension", SRV_TUS_EXTENSIONS);
    srv_reply_header(reply, "Tus-Checksum-Algorithm", SRV_TUS_CHECKSUMS);
    srv_reply_header(reply, "Tus-Max-Size", "%" PRIu64, numbers.own_bytes_max);
}

void srv_get_uploads(struct srv_request *request, struct srv_reply *reply) {
    if (!check(request, reply))
        return;
    struct srv_uploads_numbers numbers;
    struct srv_upload_info info;
    struct srv_uploads *uploads = request->app->uploads;
    const char *by = srv_request_scope(request);
    proto_json *json = proto_json_object(), *list = proto_json_array();
    for (unsigned i = 0; srv_uploads_at(uploads, i, by, srv_clock_ms(), &info); i++)
        proto_json_append(&list, encode_upload(&info));
    srv_uploads_numbers(uploads, request->grant.name, &numbers);
    proto_json_set(&json, "uploads", list);
    proto_json_set_integer(&json, "bytes", (int64_t)numbers.own_bytes);
    proto_json_set_integer(&json, "bytes_max", (int64_t)numbers.own_bytes_max);
    proto_json_set_integer(&json, "bytes_free", (int64_t)numbers.free_bytes);
    proto_json_set_integer(&json, "uploads_free", numbers.free_count);
    srv_reply_json(reply, 200, json);
    srv_upload_headers(reply, NULL);
}

/* Creation. */

struct wanted {
    char name[SRV_UPLOAD_NAME_BYTES], header[SRV_UPLOAD_ID_BYTES]; /* header: "" = none */
    uint64_t bytes, modified_ms;                                   /* 0 = not known */
};

/* Reads a name that the daemon could load, or any name for a companion of a header. */
static bool parse_name(const char *given, size_t length, struct wanted *wanted,
                       struct srv_reply *reply) {
    struct sp_error err;
    char known[SRV_FORMAT_LIST];
    if (!srv_upload_name(given, length, wanted->name, &err)) {
        srv_uploads_reply_error(reply, &err);
        return false;
    }
    if (wanted->header[0] || srv_format_extension(wanted->name))
        return true;
    srv_format_list(known);
    srv_reply_problem(reply, 422, "/name",
                      "'%.100s' is not a volume: its name must end in %s; a file with the samples "
                      "of a header must come together with it (\"header\", the id of its upload)",
                      wanted->name, known);
    return false;
}

/* Reads the id of the header's upload. */
static bool parse_header(const char *given, struct wanted *wanted, struct srv_reply *reply) {
    if (!srv_folder_is_id(given)) {
        srv_reply_problem(reply, 422, "/header", "must be the id of an upload");
        return false;
    }
    memcpy(wanted->header, given, sizeof wanted->header);
    return true;
}

/* Reads "modified" of Upload-Metadata. */
static bool parse_modified(const char *metadata, struct wanted *wanted, struct srv_reply *reply) {
    char text[SRV_METADATA_BYTES];
    size_t length;
    if (!srv_upload_metadata(metadata, "modified", text, &length) ||
        (srv_upload_number(text, &wanted->modified_ms) && wanted->modified_ms > 0))
        return true;
    srv_reply_problem(reply, 400, NULL,
                      "\"modified\" of Upload-Metadata must be milliseconds since 1970");
    return false;
}

static bool read_tus(struct srv_request *request, struct wanted *wanted, struct srv_reply *reply) {
    const char *length = srv_request_header(request, "Upload-Length");
    const char *metadata = srv_request_header(request, "Upload-Metadata");
    char name[SRV_METADATA_BYTES], header[SRV_METADATA_BYTES];
    size_t name_length, header_length;
    if (!srv_upload_number(length, &wanted->bytes) || wanted->bytes == 0)
        srv_reply_problem(reply, 400, NULL,
                          "the header Upload-Length must be the size of the file, at least 1");
    else if (!srv_upload_metadata(metadata, "filename", name, &name_length) &&
             !srv_upload_metadata(metadata, "name", name, &name_length))
        srv_reply_problem(reply, 400, NULL,
                          "the header Upload-Metadata must have the name of the file: \"filename "
                          "BASE64\"");
    else
        return (!srv_upload_metadata(metadata, "header", header, &header_length) ||
                parse_header(header, wanted, reply)) &&
               parse_modified(metadata, wanted, reply) &&
               parse_name(name, name_length, wanted, reply);
    return false;
}

static bool read_json(struct srv_request *request, struct wanted *wanted, struct srv_reply *reply) {
    static const char *const known[] = { "name", "bytes", "header", "modified", NULL };
    struct sp_error err;
    int64_t bytes = 0, modified_ms = 0;
    bool ok = false;
    proto_json *body = srv_request_json(request, reply);
    if (!body)
        return false;
    const char *name = proto_json_string(proto_json_get(body, "name"));
    const proto_json *header = proto_json_get(body, "header");
    const char *header_id = proto_json_string(header);
    const proto_json *modified = proto_json_get(body, "modified");
    if (!proto_json_only(body, known, &err))
        srv_reply_error(reply, &err);
    else if (!name)
        srv_reply_problem(reply, 422, "/name", "must be the name of the file");
    else if (!proto_json_integer(proto_json_get(body, "bytes"), &bytes) || bytes < 1)
        srv_reply_problem(reply, 422, "/bytes",
                          "must be the size of the file in bytes, a whole number of at least 1");
    else if (modified && (!proto_json_integer(modified, &modified_ms) || modified_ms < 1))
        srv_reply_problem(reply, 422, "/modified",
                          "must be milliseconds since 1970, a whole number of at least 1");
    else
        ok = (!header || parse_header(header_id ? header_id : "", wanted, reply)) &&
             parse_name(name, strlen(name), wanted, reply);
    wanted->bytes = (uint64_t)bytes;
    wanted->modified_ms = (uint64_t)modified_ms;
    proto_json_free(&body);
    return ok;
}

/* An answer that waits for the disk thread. */
struct sync {
    struct srv_work work; /* first: it is this struct */
    struct srv_request *request;
    struct srv_upload_info info;
};

static void run_sync(struct srv_work *work) {
    struct sync *sync = (struct sync *)work;
    struct srv_request *request = sync->request;
    struct srv_uploads *uploads = request->app->uploads;
    const bool is_new = request->reply.status == 201;
    const bool is_durable = is_new ? srv_uploads_sync(uploads, &sync->info)
                                   : srv_uploads_sync_removal(uploads, sync->info.id);
    srv_reply_header(&request->reply, "X-Durable", "%s", is_durable ? "yes" : "no");
    free(sync);
    srv_request_complete(request);
}

/* Replies once the upload, or its removal, is on the disk. */
static void reply_when_synced(struct srv_request *request, const struct srv_upload_info *info) {
    struct sync *sync = malloc(sizeof *sync);
    if (!sync) {
        srv_reply_header(&request->reply, "X-Durable", "no");
        return;
    }
    *sync = (struct sync){ .work = { .run = run_sync }, .request = request, .info = *info };
    srv_request_suspend(request);
    srv_work_queue_add(request->app->disk, &sync->work);
}

void srv_post_upload(struct srv_request *request, struct srv_reply *reply) {
    struct wanted wanted = { .header = "" };
    struct srv_upload_info info;
    struct sp_error err;
    if (!check(request, reply))
        return;
    if (srv_request_header(request, "Upload-Defer-Length")) {
        srv_reply_problem(reply, 400, NULL, "an upload needs its size from the beginning");
        return;
    }
    bool is_tus = srv_request_header(request, "Upload-Length") != NULL;
    if (!(is_tus ? read_tus(request, &wanted, reply) : read_json(request, &wanted, reply)))
        return;
    const struct srv_upload_request upload = {
        .owner = request->grant.name,
        .name = wanted.name,
        .extension = wanted.header[0] ? NULL : srv_format_extension(wanted.name),
        .header = wanted.header[0] ? wanted.header : NULL,
        .is_admin = !srv_request_scope(request),
        .bytes = wanted.bytes,
        .modified_ms = (int64_t)wanted.modified_ms,
    };
    if (!srv_uploads_add(request->app->uploads, &upload, srv_clock_ms(), &info, &err)) {
        srv_uploads_reply_error(reply, &err);
        return;
    }
    srv_reply_json(reply, 201, encode_upload(&info));
    if (reply->status != 201) { /* out of memory */
        srv_uploads_remove(request->app->uploads, info.id, NULL, NULL);
        return;
    }
    srv_reply_header(reply, "Location", "uploads/%s", info.id);
    srv_upload_headers(reply, &info);
    reply_when_synced(request, &info);
}

void srv_get_upload(struct srv_request *request, struct srv_reply *reply) {
    struct srv_upload_info info;
    struct sp_error err;
    if (!check(request, reply))
        return;
    if (!srv_uploads_get(request->app->uploads, request->param, srv_request_scope(request),
                         srv_clock_ms(), &info, &err)) {
        srv_uploads_reply_error(reply, &err);
        return;
    }
    srv_reply_json(reply, 200, encode_upload(&info));
    srv_upload_headers(reply, &info);
}

void srv_delete_upload(struct srv_request *request, struct srv_reply *reply) {
    struct srv_upload_info info;
    struct sp_error err;
    if (!check(request, reply))
        return;
    if (!srv_uploads_get(request->app->uploads, request->param, srv_request_scope(request),
                         srv_clock_ms(), &info, &err) ||
        !srv_uploads_remove(request->app->uploads, request->param, srv_request_scope(request),
                            &err)) {
        srv_uploads_reply_error(reply, &err);
        return;
    }
    reply->status = 204;
    srv_upload_headers(reply, NULL);
    reply_when_synced(request, &info);
}
