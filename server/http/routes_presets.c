/* SPDX-License-Identifier: Apache-2.0
 *
 * Presets: parts of views under names that clients choose. A preset is a patch, as in view.update,
 * which clients merge into a view.
 */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "http/routes.h"
#include "protocol/view.h"

enum { NAME_BYTES_MAX = 64 };

static bool is_name(const char *name) {
    size_t length = strlen(name);
    for (size_t i = 0; i < length; i++)
        if (!isalnum((unsigned char)name[i]) && !strchr("._-", name[i]))
            return false;
    return length >= 1 && length <= NAME_BYTES_MAX;
}

/* True if the preset is a valid patch. A preset belongs to no volume, so it is applied to the
 * default view of a cube. */
static bool check(const proto_json *patch, struct sp_error *err) {
    struct sp_volume_info cube = { .type = SP_UINT8, .components = 1, .range = { 0, 255 } };
    struct sp_view view, defaults;
    for (int i = 0; i < 3; i++) {
        cube.grid.dims[i] = 64;
        cube.grid.spacing[i] = 1;
        cube.grid.direction[i][i] = 1;
    }
    sp_view_init(&view, &cube, "cube");
    defaults = view;
    return proto_view_apply(patch, &defaults, &view, err);
}

void srv_get_presets(struct srv_request *request, struct srv_reply *reply) {
    proto_json *json = proto_json_object(), *list = proto_json_array();
    char *names = srv_store_ids(request->app->store, SRV_KIND_PRESET);
    bool ok = names != NULL;
    for (const char *name = names; ok && *name; name += strlen(name) + 1)
        ok = proto_json_append_string(list, name);
    ok = proto_json_set(json, "presets", list) && ok;
    if (!ok)
        proto_json_free(&json);
    free(names);
    srv_reply_json(reply, 200, json);
}

static void reply_missing(struct srv_request *request, struct srv_reply *reply) {
    srv_reply_problem(reply, 404, NULL, "there is no preset '%.64s'", request->param);
}

void srv_get_preset(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    size_t size = 0;
    char *text = srv_store_get(request->app->store, SRV_KIND_PRESET, request->param, &size, &err);
    if (text)
        srv_reply_json(reply, 200, proto_json_parse(text, size, &err));
    else if (err.code == SP_ERR_NOT_FOUND)
        reply_missing(request, reply);
    else
        srv_reply_error(reply, &err);
    free(text);
}

static void put(struct srv_request *request, const proto_json *patch, struct srv_reply *reply) {
    struct srv_store *store = request->app->store;
    struct sp_error err;
    size_t size = 0;
    char *old = srv_store_get(store, SRV_KIND_PRESET, request->param, NULL, &err);
    char *text = proto_json_to_canonical(patch, &size);
    if (!text) {
        srv_reply_problem(reply, 503, NULL, "out of memory for a preset");
    } else if (!old && err.code != SP_ERR_NOT_FOUND) {
        srv_reply_error(reply, &err);
    } else if (!srv_store_put(store, SRV_KIND_PRESET, request->param, text, size, &err)) {
        srv_reply_error(reply, &err);
    } else {
        reply->status = old ? 204 : 201;
        if (!old)
            srv_reply_header(reply, "Location", "%s", request->param);
        srv_request_reply_when_durable(request);
    }
    free(old);
    free(text);
}

void srv_put_preset(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    if (!is_name(request->param)) {
        srv_reply_problem(reply, 422, NULL,
                          "the name of a preset must have 1 to %d characters of [A-Za-z0-9._-]",
                          NAME_BYTES_MAX);
        return;
    }
    proto_json *patch = srv_request_json(request, reply);
    if (patch && check(patch, &err))
        put(request, patch, reply);
    else if (patch)
        srv_reply_view_error(reply, "", &err);
    proto_json_free(&patch);
}

void srv_delete_preset(struct srv_request *request, struct srv_reply *reply) {
    if (!srv_store_remove(request->app->store, SRV_KIND_PRESET, request->param)) {
        reply_missing(request, reply);
        return;
    }
    reply->status = 204;
    srv_request_reply_when_durable(request);
}
