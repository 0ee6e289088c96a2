/* SPDX-License-Identifier: Apache-2.0
 *
 * Presets: parts of views under names that clients choose. A preset is a patch, as in view.update,
 * which clients merge into a view.
 */
#include <ctype.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "http/owned.h"
#include "http/routes.h"
#include "session/view_check.h"
#include "store/store.h"

enum { NAME_BYTES_MAX = 64 };

static void reply_missing(const struct srv_request *request, struct srv_reply *reply) {
    srv_reply_problem(reply, 404, NULL, "there is no preset '%.64s'", request->param);
}

static bool is_name(const char *name) {
    size_t length = strlen(name);
    for (size_t i = 0; i < length; i++)
        if (!isalnum((unsigned char)name[i]) && !strchr("._-", name[i]))
            return false;
    return length >= 1 && length <= NAME_BYTES_MAX;
}

/* True if the preset is a valid patch. */
static bool check(const proto_json *patch, struct sp_error *err) {
    struct sp_view view;
    return srv_view_check(patch, &view, err);
}

void srv_get_presets(struct srv_request *request, struct srv_reply *reply) {
    proto_json *json = proto_json_object(), *list = proto_json_array();
    char *names = srv_store_ids(request->app->store, SRV_KIND_PRESET);
    if (!names)
        proto_json_free(&list);
    for (const char *name = names; name && *name; name += strlen(name) + 1)
        proto_json_append_string(&list, name);
    proto_json_set(&json, "presets", list);
    free(names);
    srv_reply_json(reply, 200, json);
}

/* Returns the patch of a record. Records of earlier versions are the patch alone, without an
 * owner. NULL when out of memory. */
static proto_json *patch_of(const char *record, size_t size) {
    struct sp_error ignored;
    proto_json *json = proto_json_parse(record, size, &ignored);
    proto_json *patch = (proto_json *)(uintptr_t)proto_json_get(json, "preset");
    if (!patch)
        return json;
    proto_json_ref(patch);
    proto_json_free(&json);
    return patch;
}

void srv_get_preset(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    size_t size = 0;
    char *text = srv_store_get(request->app->store, SRV_KIND_PRESET, request->param, &size, &err);
    if (text)
        srv_reply_json(reply, 200, patch_of(text, size));
    else if (err.code == SP_ERR_NOT_FOUND)
        reply_missing(request, reply);
    else
        srv_reply_error(reply, &err);
    free(text);
}

/* Checks that the token may change the preset. False: the reply is a problem document. */
static bool may_change(struct srv_request *request, const char *record, struct srv_reply *reply) {
    const bool has_owner = strncmp(record, "{\"owner\":", strlen("{\"owner\":")) == 0;
    if (!has_owner || srv_owned_may_change(request, record))
        return true;
    srv_reply_problem(reply, 403, NULL,
                      "another token saved the preset '%.64s'; that token or an admin may change "
                      "it; use another name",
                      request->param);
    return false;
}

/* {"owner", "preset"}; an existing owner stays. NULL when out of memory. */
static char *record_of(const struct srv_request *request, const char *old, const char *patch,
                       size_t *size) {
    char beginning[SRV_OWNED_BYTES], *record = NULL;
    int bytes = 0;
    srv_owned_beginning(request, beginning);
    if (old)
        sscanf(old, "{\"owner\":\"%*[^\"]\",%n", &bytes);
    const int length = asprintf(&record, "%.*s\"preset\":%s}", bytes ? bytes : SRV_OWNED_BYTES,
                                bytes ? old : beginning, patch);
    *size = length > 0 ? (size_t)length : 0;
    return length < 0 ? NULL : record;
}

static void put(struct srv_request *request, const proto_json *patch, struct srv_reply *reply) {
    struct srv_store *store = request->app->store;
    const char *name = request->param;
    struct sp_error err = { .code = SP_OK };
    size_t size = 0;
    char *old = srv_store_get_any(store, SRV_KIND_PRESET, name, NULL, &err);
    char *text = proto_json_to_canonical(patch, NULL);
    const bool is_sound = srv_store_is_sound(store, SRV_KIND_PRESET, name, NULL);
    char *record = text ? record_of(request, is_sound ? old : NULL, text, &size) : NULL;
    if (!record) {
        srv_reply_problem(reply, 503, NULL, "out of memory for a preset");
    } else if (!old && err.code != SP_ERR_NOT_FOUND) {
        srv_reply_error(reply, &err);
    } else if (!old || may_change(request, old, reply)) {
        if (old ? srv_store_put(store, SRV_KIND_PRESET, name, record, size, &err)
                : srv_owned_add(request, SRV_KIND_PRESET, name, record, size, 0, &err)) {
            reply->status = old ? 204 : 201;
            if (!old)
                srv_reply_header(reply, "Location", "%s", name);
            srv_request_reply_when_durable(request);
        } else {
            srv_reply_error(reply, &err);
        }
    }
    free(old);
    free(text);
    free(record);
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
    struct srv_store *store = request->app->store;
    struct sp_error err = { .code = SP_OK };
    char *record = srv_store_get_any(store, SRV_KIND_PRESET, request->param, NULL, &err);
    if (!record && err.code != SP_ERR_NOT_FOUND) {
        srv_reply_error(reply, &err);
    } else if (!record || may_change(request, record, reply)) {
        if (srv_store_remove(store, SRV_KIND_PRESET, request->param))
            srv_request_reply_changed(request, true, NULL);
        else
            reply_missing(request, reply);
    }
    free(record);
}
