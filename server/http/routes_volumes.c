/* SPDX-License-Identifier: Apache-2.0 */
#include <stdlib.h>
#include <string.h>

#include "http/routes.h"
#include "protocol/view.h"
#include "protocol/volume.h"

/* Encodes the memory of the volume: its voxels, and the cached data of all renderers. NULL when out
 * of memory. */
static proto_json *encode_memory(const struct srv_volume_status *status) {
    const struct sp_volume_info *info = sp_volume_info(status->volume);
    const uint32_t *dims = info->grid.dims;
    double samples = (double)dims[0] * dims[1] * dims[2];
    proto_json *memory = proto_json_object();
    bool ok = proto_json_set_integer(memory, "voxels", (int64_t)info->voxel_bytes);
    ok = proto_json_set_integer(memory, "derived", (int64_t)status->cached_bytes) && ok;
    ok = proto_json_set_number(memory, "derived_per_voxel",
                               (double)status->cached_bytes / samples) &&
         ok;
    if (!ok)
        proto_json_free(&memory);
    return memory;
}

/* Encodes {"id", "name", "source", "state", "progress", …} and, once the volume is loaded, its
 * description. NULL when out of memory. */
static proto_json *encode_volume(const struct srv_volume_status *status, bool in_full) {
    proto_json *json =
        status->volume ? proto_volume_encode(sp_volume_info(status->volume), status->id, in_full)
                       : proto_json_object();
    bool ok = proto_json_set_string(json, "id", status->id);
    ok = proto_json_set_string(json, "name", status->name) && ok;
    ok = proto_json_set_string(json, "source", status->source) && ok;
    ok = proto_json_set_string(json, "state", srv_volume_state_name(status->state)) && ok;
    ok = proto_json_set_number(json, "progress", status->progress) && ok;
    if (status->state == SRV_VOLUME_FAILED) {
        char reason[SP_ERROR_PLACE + SP_ERROR_TEXT + 4];
        snprintf(reason, sizeof reason, "%s%s%s", status->error.place,
                 status->error.place[0] ? ": " : "", status->error.text);
        ok = proto_json_set_string(json, "reason", reason) && ok;
    }
    if (status->volume && in_full) {
        ok = proto_json_set(json, "memory", encode_memory(status)) && ok;
        ok = proto_json_set_integer(json, "uses", status->uses) && ok;
    }
    if (!ok)
        proto_json_free(&json);
    return json;
}

void srv_get_volumes(struct srv_request *request, struct srv_reply *reply) {
    struct srv_volume_status status;
    proto_json *json = proto_json_object(), *list = proto_json_array();
    bool ok = true;
    for (unsigned i = 0; srv_catalog_at(request->app->catalog, i, &status); i++) {
        ok = proto_json_append(list, encode_volume(&status, false)) && ok;
        sp_volume_unref(&status.volume);
    }
    ok = proto_json_set(json, "volumes", list) && ok;
    if (!ok)
        proto_json_free(&json);
    srv_reply_json(reply, 200, json);
}

void srv_name_volumes(const struct srv_request *request, struct sp_error *err) {
    struct srv_volume_status status;
    char *text = err->text;
    size_t n = strlen(text);
    if ((err->code != SP_ERR_VOLUME_UNKNOWN && err->code != SP_ERR_NOT_FOUND) ||
        !(request->grant.rights & SRV_RIGHT_VIEW))
        return;
    for (unsigned i = 0; srv_catalog_at(request->app->catalog, i, &status); i++) {
        sp_volume_unref(&status.volume);
        bool is_full = n + strlen(status.id) + sizeof "; the daemon has , …" > sizeof err->text;
        n += (size_t)snprintf(text + n, sizeof err->text - n, "%s%s",
                              i ? ", " : "; the daemon has ", is_full ? "…" : status.id);
        if (is_full)
            break;
    }
}

static bool find(struct srv_request *request, const char *id, struct srv_volume_status *status,
                 struct srv_reply *reply) {
    struct sp_error err;
    if (srv_catalog_find(request->app->catalog, id, status))
        return true;
    sp_fail(&err, SP_ERR_NOT_FOUND, NULL, "there is no volume '%s'", id);
    srv_name_volumes(request, &err);
    srv_reply_error(reply, &err);
    return false;
}

void srv_get_volume(struct srv_request *request, struct srv_reply *reply) {
    struct srv_volume_status status;
    if (!find(request, request->param, &status, reply))
        return;
    srv_reply_json(reply, 200, encode_volume(&status, true));
    sp_volume_unref(&status.volume);
}

void srv_get_volume_view(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    struct sp_view view;
    void *volume = srv_catalog_acquire(request->app->catalog, request->param, &err);
    if (!volume) {
        /* Here the volume is the resource, not a member of a body. */
        srv_name_volumes(request, &err);
        err.place[0] = 0;
        srv_reply_error(reply, &err);
        return;
    }
    srv_catalog_default_view(request->app->catalog, volume, &view);
    srv_catalog_release(request->app->catalog, volume);
    srv_reply_json(reply, 200, proto_view_encode(&view));
}

/* Reads an optional member that must be a string. False: the reply is a problem document. */
static bool read_string(const proto_json *body, const char *key, const char *pointer,
                        const char **out, struct srv_reply *reply) {
    const proto_json *value = proto_json_get(body, key);
    *out = proto_json_string(value);
    if (value && !*out)
        srv_reply_problem(reply, 422, pointer, "must be a string");
    return !value || *out;
}

static bool read_request(const proto_json *body, struct srv_volume_request *load,
                         struct srv_reply *reply) {
    static const char *const known[] = { "path", "uri", "id", "name", NULL };
    const char *path, *uri;
    struct sp_error err;
    if (!proto_json_only(body, known, &err)) {
        srv_reply_error(reply, &err);
        return false;
    }
    if (!read_string(body, "path", "/path", &path, reply) ||
        !read_string(body, "uri", "/uri", &uri, reply) ||
        !read_string(body, "id", "/id", &load->id, reply) ||
        !read_string(body, "name", "/name", &load->name, reply))
        return false;
    if (!path == !uri)
        srv_reply_problem(reply, 422, NULL,
                          "give either \"path\" (below the data folder) or "
                          "\"uri\" (\"demo:NAME\")");
    else if (uri && strncmp(uri, "demo:", 5) != 0)
        srv_reply_problem(reply, 422, "/uri", "must be demo:NAME");
    else if (!*(path ? path : uri))
        srv_reply_problem(reply, 422, "/path", "must not be empty");
    else
        load->source = path ? path : uri;
    return load->source != NULL;
}

/* Waits until the volume is on disk, unless the store has no record of it. The volume is loaded in
 * any case. */
static void reply_durable(struct srv_request *request, const char *id, struct srv_reply *reply) {
    struct sp_error err;
    char *record = srv_store_get(request->app->store, SRV_KIND_VOLUME, id, NULL, &err);
    if (record)
        srv_request_reply_when_durable(request);
    else
        srv_reply_header(reply, "X-Durable", "no");
    free(record);
}

void srv_post_volume(struct srv_request *request, struct srv_reply *reply) {
    struct srv_volume_request load = { .confined = true };
    struct sp_error err;
    char id[SP_NAME_BYTES];
    bool existed, conflict;
    proto_json *body = srv_request_json(request, reply);
    if (!body)
        return;
    if (read_request(body, &load, reply)) {
        struct srv_volume_status status;
        if (!srv_catalog_add(request->app->catalog, &load, id, &existed, &conflict, &err)) {
            if (conflict)
                srv_reply_problem(reply, 409, err.place, "%s", err.text);
            else
                srv_reply_error(reply, &err);
        } else if (find(request, id, &status, reply)) {
            srv_reply_json(reply, existed ? 201 : 202, encode_volume(&status, false));
            sp_volume_unref(&status.volume);
            if (reply->status < 400) {
                srv_reply_header(reply, "Location", "volumes/%s", id);
                reply_durable(request, id, reply);
            }
        }
    }
    proto_json_free(&body);
}

void srv_delete_volume(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    bool conflict;
    if (srv_catalog_remove(request->app->catalog, request->param, &conflict, &err)) {
        reply->status = 204;
        srv_request_reply_when_durable(request);
    } else if (conflict) {
        srv_reply_problem(reply, 409, NULL, "%s", err.text);
    } else {
        srv_name_volumes(request, &err);
        srv_reply_error(reply, &err);
    }
}
