/* SPDX-License-Identifier: Apache-2.0 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <gnutls/crypto.h>
#include <gnutls/gnutls.h>

#include "http/headers.h"
#include "http/paging.h"
#include "http/routes.h"
#include "http/saved_views.h"
#include "protocol/view.h"

bool srv_saved_view_id(const char *text, size_t size, char id[SRV_SAVED_VIEW_ID_BYTES]) {
    enum { SHA256_BYTES = 32 };
    uint8_t digest[SHA256_BYTES];
    if (gnutls_hash_fast(GNUTLS_DIG_SHA256, text, size, digest) != 0)
        return false;
    for (size_t i = 0; i < (SRV_SAVED_VIEW_ID_BYTES - 1) / 2; i++)
        snprintf(id + 2 * i, 3, "%02x", digest[i]);
    return true;
}

enum { BEGINNING_BYTES = SRV_TOKEN_NAME_BYTES + 32 };

/* Writes how the records of the token begin. Names have no characters that JSON would escape. */
static void beginning_of(const struct srv_request *request, char text[BEGINNING_BYTES]) {
    snprintf(text, BEGINNING_BYTES, "{\"owner\":\"%s\",", request->grant.name);
}

static proto_json *read_record(struct srv_store *store, const char *id, struct sp_error *err) {
    size_t size;
    struct sp_error why;
    char *text = srv_store_get(store, SRV_KIND_VIEW, id, &size, &why);
    if (!text && why.code == SP_ERR_NOT_FOUND)
        sp_fail(err, why.code, NULL, "there is no saved view '%.64s'", id);
    else if (!text)
        *err = why;
    proto_json *json = text ? proto_json_parse(text, size, err) : NULL;
    free(text);
    return json;
}

proto_json *srv_saved_view_get(struct srv_store *store, const char *id, struct sp_error *err) {
    proto_json *record = read_record(store, id, err);
    proto_json *view = (proto_json *)(uintptr_t)proto_json_get(record, "view");
    if (!view)
        return record;
    proto_json_ref(view);
    proto_json_free(&record);
    return view;
}

/* Saves a text under its id. False: *err; SP_ERR_QUOTA if the token has too many saved views. */
static bool add_record(struct srv_request *request, const char *id, const char *text,
                       struct sp_error *err) {
    char beginning[BEGINNING_BYTES], *record = NULL;
    const struct srv_store_share share = { .beginning = beginning,
                                           .most = request->grant.quota.views,
                                           .name = request->grant.name };
    beginning_of(request, beginning);
    int size = asprintf(&record, "%s\"view\":%s}", beginning, text);
    if (size < 0)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a view");
    bool ok =
        srv_store_add(request->app->store, SRV_KIND_VIEW, id, record, (size_t)size, &share, err);
    free(record);
    return ok;
}

/* Replies with {"id": id}. False when out of memory: the reply is a problem document. */
static bool reply_id(const char *id, struct srv_reply *reply) {
    proto_json *answer = proto_json_object();
    if (!proto_json_set_string(answer, "id", id))
        proto_json_free(&answer);
    srv_reply_json(reply, 201, answer);
    return reply->status == 201;
}

/* Saves the view and replies with its id once the view is on disk. */
static void save_view(struct srv_request *request, const struct sp_view *view,
                      struct srv_reply *reply) {
    struct sp_error err;
    char id[SRV_SAVED_VIEW_ID_BYTES];
    size_t size = 0;
    proto_json *json = proto_view_encode(view);
    char *text = proto_json_to_canonical(json, &size);
    proto_json_free(&json);
    if (!text || !srv_saved_view_id(text, size, id)) {
        srv_reply_problem(reply, 503, NULL, "out of memory for a view");
    } else if (reply_id(id, reply)) { /* first, so that nothing is saved if there is no memory for
                                         the reply */
        if (add_record(request, id, text, &err)) {
            srv_reply_header(reply, "Location", "views/%s", id);
            srv_request_reply_when_durable(request);
        } else {
            srv_reply_error(reply, &err);
        }
    }
    free(text);
}

void srv_post_view(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    struct sp_view view;
    void *volume = NULL;
    proto_json *patch = srv_request_json(request, reply);
    if (!patch)
        return;
    bool ok = srv_hub_resolve_view(request->app->hub, NULL, patch, &view, &volume, &err);
    proto_json_free(&patch);
    if (!ok) {
        srv_reply_view_error(reply, "", &err);
        return;
    }
    srv_catalog_release(request->app->catalog, volume);
    save_view(request, &view, reply);
}

void srv_get_view(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    proto_json *json = srv_saved_view_get(request->app->store, request->param, &err);
    if (!json) {
        srv_reply_error(reply, &err);
        return;
    }
    char etag[SRV_SAVED_VIEW_ID_BYTES + 2];
    snprintf(etag, sizeof etag, "\"%.32s\"", request->param);
    srv_reply_json(reply, 200, json);
    srv_reply_header(reply, "ETag", "%s", etag);
    srv_reply_header(reply, "Cache-Control", "private, max-age=31536000, immutable");
}

/* Encodes {"id", "owner", "volume", "size"}; only the id if the view was deleted meanwhile. */
static proto_json *encode_item(void *user, const void *item) {
    struct srv_request *request = user;
    struct sp_error err = { .code = SP_OK };
    proto_json *json = proto_json_object();
    proto_json *record = read_record(request->app->store, item, &err);
    const proto_json *inner = proto_json_get(record, "view"), *view = inner ? inner : record;
    const char *owner = proto_json_string(proto_json_get(record, "owner"));
    const char *volume = proto_view_volume(view);
    const proto_json *size = proto_json_get(view, "size");
    int64_t width, height;
    bool ok = proto_json_set_string(json, "id", item) && err.code != SP_ERR_MEMORY;
    if (owner)
        ok = proto_json_set_string(json, "owner", owner) && ok;
    if (volume)
        ok = proto_json_set_string(json, "volume", volume) && ok;
    if (proto_json_integer(proto_json_at(size, 0), &width) &&
        proto_json_integer(proto_json_at(size, 1), &height)) {
        proto_json *copy = proto_json_array();
        ok = proto_json_append_integer(copy, width) && ok;
        ok = proto_json_append_integer(copy, height) && ok;
        ok = proto_json_set(json, "size", copy) && ok;
    }
    if (!ok)
        proto_json_free(&json);
    proto_json_free(&record);
    return json;
}

/* An admin token sees all saved views. */
static bool sees_all(const struct srv_request *request) {
    return request->grant.rights & SRV_RIGHT_ADMIN;
}

void srv_get_views(struct srv_request *request, struct srv_reply *reply) {
    struct srv_page page;
    if (!srv_paging_begin(request, SRV_STORE_ID_MAX + 1, &page, reply))
        return;
    char beginning[BEGINNING_BYTES] = "";
    if (!sees_all(request))
        beginning_of(request, beginning);
    srv_store_page(request->app->store, SRV_KIND_VIEW, beginning, &page);
    srv_paging_reply(&page, "views", encode_item, request, reply);
}

void srv_delete_view(struct srv_request *request, struct srv_reply *reply) {
    struct srv_store *store = request->app->store;
    char beginning[BEGINNING_BYTES];
    struct sp_error err;
    char *record = srv_store_get(store, SRV_KIND_VIEW, request->param, NULL, &err);
    beginning_of(request, beginning);
    bool may = sees_all(request) || (record && strncmp(record, beginning, strlen(beginning)) == 0);
    bool is_there = record != NULL;
    free(record);
    if (!is_there && err.code != SP_ERR_NOT_FOUND) {
        srv_reply_error(reply, &err);
    } else if (is_there && !may) {
        srv_reply_problem(reply, 403, NULL, "another token saved this view");
    } else if (!is_there || !srv_store_remove(store, SRV_KIND_VIEW, request->param)) {
        srv_reply_problem(reply, 404, NULL, "there is no saved view '%.64s'", request->param);
    } else {
        reply->status = 204;
        srv_request_reply_when_durable(request);
    }
}
