/* SPDX-License-Identifier: Apache-2.0
 *
 * Uploads: the core of the tus protocol 1.0 with its extensions creation, expiration, checksum and
 * termination. A client that is not a tus client creates an upload with JSON.
 */
#include "http/routes_uploads.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
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
    time_t at = time(NULL) + (time_t)(info->expires_ms / 1000);
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
    case SP_ERR_BUDGET:
        srv_reply_problem(reply, 507, pointer, "%s", err->text);
        break;
    case SP_ERR_UNSUPPORTED: /* more bytes than were declared */
        srv_reply_problem(reply, 413, pointer, "%s", err->text);
        break;
    case SP_ERR_INVALID: /* the offset; a member of the body has a pointer */
        srv_reply_problem(reply, pointer ? 422 : 409, pointer, "%s", err->text);
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
    bool ok = proto_json_set_string(json, "id", info->id);
    ok = proto_json_set_string(json, "name", info->name) && ok;
    ok = proto_json_set_string(json, "owner", info->owner) && ok;
    ok = proto_json_set_integer(json, "bytes", (int64_t)info->bytes) && ok;
    ok = proto_json_set_integer(json, "offset", (int64_t)info->offset) && ok;
    if (isfinite(info->expires_ms))
        ok = proto_json_set_number(json, "expires", round(info->expires_ms / 1000)) && ok;
    if (!ok)
        proto_json_free(&json);
    return json;
}

void srv_options_uploads(struct srv_request *request, struct srv_reply *reply) {
    if (!check(request, reply))
        return;
    struct srv_uploads_numbers numbers;
    srv_uploads_numbers(request->app->uploads, &numbers);
    reply->status = 204;
    srv_upload_headers(reply, NULL);
    srv_reply_header(reply, "Tus-Version", SRV_TUS_VERSION);
    srv_reply_header(reply, "Tus-Extension", SRV_TUS_EXTENSIONS);
    srv_reply_header(reply, "Tus-Checksum-Algorithm", SRV_TUS_CHECKSUMS);
    srv_reply_header(reply, "Tus-Max-Size", "%" PRIu64, numbers.bytes_max);
}

void srv_get_uploads(struct srv_request *request, struct srv_reply *reply) {
    if (!check(request, reply))
        return;
    struct srv_uploads_numbers numbers;
    struct srv_upload_info info;
    struct srv_uploads *uploads = request->app->uploads;
    proto_json *json = proto_json_object(), *list = proto_json_array();
    bool ok = true;
    for (unsigned i = 0; srv_uploads_at(uploads, i, srv_clock_ms(), &info); i++)
        ok = proto_json_append(list, encode_upload(&info)) && ok;
    srv_uploads_numbers(uploads, &numbers);
    ok = proto_json_set(json, "uploads", list) && ok;
    ok = proto_json_set_integer(json, "bytes", (int64_t)numbers.declared_bytes) && ok;
    ok = proto_json_set_integer(json, "bytes_max", (int64_t)numbers.bytes_max) && ok;
    if (!ok)
        proto_json_free(&json);
    srv_reply_json(reply, 200, json);
    srv_upload_headers(reply, NULL);
}

/* Creation. */

struct wanted {
    char name[SP_NAME_BYTES];
    uint64_t bytes;
};

/* Reads a name that the daemon could load. */
static bool take_name(const char *given, size_t length, struct wanted *wanted,
                      struct srv_reply *reply) {
    struct sp_error err;
    if (!srv_upload_name(given, length, wanted->name, &err)) {
        srv_uploads_reply_error(reply, &err);
        return false;
    }
    const char *extension = srv_format_extension(wanted->name);
    if (extension && strcmp(extension, ".nhdr") != 0 && strcmp(extension, ".json") != 0)
        return true;
    srv_reply_problem(reply, 422, "/name",
                      extension ? "'%.100s' is a header whose samples are in another file; upload "
                                  "one file that has both, for example .nrrd"
                                : "'%.100s' is not a volume that can be loaded: the name must end "
                                  "in .nrrd, .vtk, .vti, .vtr, .tif or .tiff",
                      wanted->name);
    return false;
}

static bool read_tus(struct srv_request *request, struct wanted *wanted, struct srv_reply *reply) {
    const char *length = srv_request_header(request, "Upload-Length");
    const char *metadata = srv_request_header(request, "Upload-Metadata");
    char name[SRV_METADATA_BYTES];
    size_t name_length;
    if (!srv_upload_number(length, &wanted->bytes) || wanted->bytes == 0)
        srv_reply_problem(reply, 400, NULL,
                          "the header Upload-Length must be the size of the file, at least 1");
    else if (!srv_upload_metadata(metadata, "filename", name, &name_length) &&
             !srv_upload_metadata(metadata, "name", name, &name_length))
        srv_reply_problem(reply, 400, NULL,
                          "the header Upload-Metadata must have the name of the file: \"filename "
                          "BASE64\"");
    else
        return take_name(name, name_length, wanted, reply);
    return false;
}

static bool read_json(struct srv_request *request, struct wanted *wanted, struct srv_reply *reply) {
    static const char *const known[] = { "name", "bytes", NULL };
    struct sp_error err;
    int64_t bytes = 0;
    bool ok = false;
    proto_json *body = srv_request_json(request, reply);
    if (!body)
        return false;
    const char *name = proto_json_string(proto_json_get(body, "name"));
    if (!proto_json_only(body, known, &err))
        srv_reply_error(reply, &err);
    else if (!name)
        srv_reply_problem(reply, 422, "/name", "must be the name of the file");
    else if (!proto_json_integer(proto_json_get(body, "bytes"), &bytes) || bytes < 1)
        srv_reply_problem(reply, 422, "/bytes",
                          "must be the size of the file in bytes, a whole number of at least 1");
    else
        ok = take_name(name, strlen(name), wanted, reply);
    wanted->bytes = (uint64_t)bytes;
    proto_json_free(&body);
    return ok;
}

void srv_post_upload(struct srv_request *request, struct srv_reply *reply) {
    struct wanted wanted;
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
    if (!srv_uploads_add(request->app->uploads, request->grant.name, wanted.name,
                         srv_format_extension(wanted.name), wanted.bytes, srv_clock_ms(), &info,
                         &err)) {
        bool is_too_large = err.code == SP_ERR_INVALID;
        if (is_too_large)
            err.code = SP_ERR_UNSUPPORTED; /* 413 */
        srv_uploads_reply_error(reply, &err);
        return;
    }
    srv_reply_json(reply, 201, encode_upload(&info));
    if (reply->status != 201) { /* out of memory */
        srv_uploads_remove(request->app->uploads, info.id, NULL);
        return;
    }
    srv_reply_header(reply, "Location", "uploads/%s", info.id);
    srv_upload_headers(reply, &info);
}

void srv_get_upload(struct srv_request *request, struct srv_reply *reply) {
    struct srv_upload_info info;
    struct sp_error err;
    if (!check(request, reply))
        return;
    if (!srv_uploads_get(request->app->uploads, request->param, srv_clock_ms(), &info, &err)) {
        srv_uploads_reply_error(reply, &err);
        return;
    }
    srv_reply_json(reply, 200, encode_upload(&info));
    srv_upload_headers(reply, &info);
}

void srv_delete_upload(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    if (!check(request, reply))
        return;
    if (!srv_uploads_remove(request->app->uploads, request->param, &err)) {
        srv_uploads_reply_error(reply, &err);
        return;
    }
    reply->status = 204;
    srv_upload_headers(reply, NULL);
}
