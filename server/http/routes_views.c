/* SPDX-License-Identifier: Apache-2.0 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <gnutls/crypto.h>
#include <gnutls/gnutls.h>

#include "common/clock.h"
#include "http/headers.h"
#include "http/owned.h"
#include "http/paging.h"
#include "http/routes.h"
#include "http/saved_views.h"
#include "protocol/text.h"
#include "protocol/view.h"

/* Writes the first 128 bits of the SHA-256 of a text in hexadecimal. False when out of memory. */
static bool hash(const char *text, size_t size, char id[SRV_SAVED_VIEW_ID_BYTES]) {
    enum { SHA256_BYTES = 32 };
    uint8_t digest[SHA256_BYTES];
    if (gnutls_hash_fast(GNUTLS_DIG_SHA256, text, size, digest) != 0)
        return false;
    for (size_t i = 0; i < (SRV_SAVED_VIEW_ID_BYTES - 1) / 2; i++)
        snprintf(id + 2 * i, 3, "%02x", digest[i]);
    return true;
}

enum { SAVED_NAME_MAX = 200 }; /* bytes */
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

/* Returns the text of a record: the beginning, the name (NULL = none), the time and the view. NULL
 * when out of memory. */
static char *record_of(const char *beginning, const char *name, int64_t saved, const char *view,
                       size_t *size) {
    proto_json *about = proto_json_object();
    if (name)
        proto_json_set_string(&about, "name", name);
    if (saved)
        proto_json_set_integer(&about, "saved", saved);
    char *members = proto_json_to_canonical(about, NULL), *record = NULL;
    proto_json_free(&about);
    if (!members)
        return NULL;
    members[strlen(members) - 1] = 0; /* without the braces */
    int length = asprintf(&record, "%s%s%s\"view\":%s}", beginning, members + 1,
                          members[1] ? "," : "", view);
    free(members);
    *size = length > 0 ? (size_t)length : 0;
    return length < 0 ? NULL : record;
}

/* True if the request's token saved a view under this id. */
static bool is_own(const struct srv_request *request, const char *id) {
    char beginning[SRV_OWNED_BYTES];
    struct sp_error err;
    char *record = srv_store_get_any(request->app->store, SRV_KIND_VIEW, id, NULL, &err);
    srv_owned_beginning(request, beginning);
    const bool is_own = record && strncmp(record, beginning, strlen(beginning)) == 0;
    free(record);
    return is_own;
}

/* Writes the id of a view's text for the request's token. False when out of memory. */
static bool write_id(const struct srv_request *request, const char *text, size_t size,
                     char id[SRV_SAVED_VIEW_ID_BYTES]) {
    char beginning[SRV_OWNED_BYTES];
    if (!hash(text, size, id))
        return false;
    if (is_own(request, id)) /* saved by an earlier version */
        return true;
    srv_owned_beginning(request, beginning);
    char *owned = record_of(beginning, NULL, 0, text, &size);
    const bool ok = owned && hash(owned, size, id);
    free(owned);
    return ok;
}

/* Saves a text under its id. False: *err; SP_ERR_QUOTA if the token has too many saved views. */
static bool add_record(struct srv_request *request, const char *id, const char *text,
                       struct sp_error *err) {
    char beginning[SRV_OWNED_BYTES];
    size_t size;
    srv_owned_beginning(request, beginning);
    char *record = record_of(beginning, NULL, srv_clock_date().tv_sec, text, &size);
    if (!record)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a view");
    bool ok =
        srv_owned_add(request, SRV_KIND_VIEW, id, record, size, request->grant.quota.views, err);
    free(record);
    return ok;
}

/* Replies with {"id": id}. False when out of memory: the reply is a problem document. */
static bool reply_id(const char *id, struct srv_reply *reply) {
    proto_json *answer = proto_json_object();
    proto_json_set_string(&answer, "id", id);
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
    if (!text || !write_id(request, text, size, id)) {
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
    struct srv_volume *volume = NULL;
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

/* Encodes {"id", "owner", "name", "saved", "volume", "size"}; only the id if the view was deleted
 * meanwhile. */
static proto_json *encode_item(void *user, const void *item) {
    struct srv_request *request = user;
    struct sp_error err = { .code = SP_OK };
    proto_json *json = proto_json_object();
    proto_json *record = read_record(request->app->store, item, &err);
    const proto_json *inner = proto_json_get(record, "view"), *view = inner ? inner : record;
    const char *owner = proto_json_string(proto_json_get(record, "owner"));
    const char *name = proto_json_string(proto_json_get(record, "name"));
    const char *volume = proto_view_volume(view);
    const proto_json *size = proto_json_get(view, "size");
    int64_t width, height, saved;
    proto_json_set_string(&json, "id", item);
    if (owner)
        proto_json_set_string(&json, "owner", owner);
    if (name)
        proto_json_set_string(&json, "name", name);
    if (proto_json_integer(proto_json_get(record, "saved"), &saved))
        proto_json_set_integer(&json, "saved", saved);
    if (volume)
        proto_json_set_string(&json, "volume", volume);
    if (proto_json_integer(proto_json_at(size, 0), &width) &&
        proto_json_integer(proto_json_at(size, 1), &height)) {
        proto_json *copy = proto_json_array();
        proto_json_append_integer(&copy, width);
        proto_json_append_integer(&copy, height);
        proto_json_set(&json, "size", copy);
    }
    if (err.code == SP_ERR_MEMORY)
        proto_json_free(&json);
    proto_json_free(&record);
    return json;
}

void srv_get_views(struct srv_request *request, struct srv_reply *reply) {
    struct srv_page page;
    if (!srv_paging_begin(request, SRV_STORE_ID_MAX + 1, &page, reply))
        return;
    char beginning[SRV_OWNED_BYTES] = "";
    if (!(request->grant.rights & SRV_RIGHT_ADMIN)) /* an admin sees all */
        srv_owned_beginning(request, beginning);
    srv_store_page(request->app->store, SRV_KIND_VIEW, beginning, &page);
    srv_paging_reply(&page, "views", encode_item, request, reply);
}

static void reply_missing(const struct srv_request *request, struct srv_reply *reply) {
    srv_reply_problem(reply, 404, NULL, "there is no saved view '%.64s'", request->param);
}

/* Returns the record of the request's view if its token may change it; malloc'ed. NULL: the reply
 * is a problem document. */
static char *own_record(struct srv_request *request, size_t *size, struct srv_reply *reply) {
    struct sp_error err;
    char *record =
        srv_store_get_any(request->app->store, SRV_KIND_VIEW, request->param, size, &err);
    if (!record && err.code != SP_ERR_NOT_FOUND) {
        srv_reply_error(reply, &err);
    } else if (!record) {
        reply_missing(request, reply);
    } else if (!srv_owned_may_change(request, record)) {
        srv_reply_problem(reply, 403, NULL, "another token saved this view");
        free(record);
        record = NULL;
    }
    return record;
}

void srv_delete_view(struct srv_request *request, struct srv_reply *reply) {
    char *record = own_record(request, NULL, reply);
    if (!record)
        return;
    free(record);
    if (srv_store_remove(request->app->store, SRV_KIND_VIEW, request->param))
        srv_request_reply_changed(request, true, NULL);
    else
        reply_missing(request, reply);
}

/* Reads {"name"}: *name is NULL if it is null. False: the reply is a problem document. */
static bool read_name(const proto_json *body, const char **name, struct srv_reply *reply) {
    static const char *const known[] = { "name", NULL };
    const proto_json *given = proto_json_get(body, "name");
    struct sp_error err;
    *name = proto_json_string(given);
    size_t length = *name ? strlen(*name) : 1;
    bool is_null = given && proto_json_type(given) == PROTO_JSON_NULL;
    if (!proto_json_only(body, known, &err))
        srv_reply_error(reply, &err);
    else if (*name && !proto_text_is_plain(*name))
        srv_reply_problem(reply, 422, "/name", "must not contain invisible control characters");
    else if ((!*name && !is_null) || length < 1 || length > SAVED_NAME_MAX)
        srv_reply_problem(reply, 422, "/name", "must be text of 1 to %d bytes, or null",
                          SAVED_NAME_MAX);
    else
        return true;
    return false;
}

/* Replaces the name in a record that the token may change. */
static void rename_record(struct srv_request *request, const char *text, size_t size,
                          const char *name, struct srv_reply *reply) {
    struct sp_error err = { .code = SP_OK };
    char beginning[SRV_OWNED_BYTES];
    if (!srv_store_is_sound(request->app->store, SRV_KIND_VIEW, request->param, &err)) {
        srv_reply_error(reply, &err);
        return;
    }
    proto_json *old = proto_json_parse(text, size, &err);
    const char *owner = proto_json_string(proto_json_get(old, "owner"));
    const proto_json *inner = proto_json_get(old, "view");
    int64_t saved = 0;
    proto_json_integer(proto_json_get(old, "saved"), &saved);
    snprintf(beginning, sizeof beginning, owner ? "{\"owner\":\"%s\"," : "{", owner);
    char *view = proto_json_to_canonical(inner ? inner : old, NULL);
    char *record = view ? record_of(beginning, name, saved, view, &size) : NULL;
    if (!record)
        srv_reply_problem(reply, 503, NULL, "out of memory for a view");
    else
        srv_request_reply_changed(
            request,
            srv_store_put(request->app->store, SRV_KIND_VIEW, request->param, record, size, &err),
            &err);
    free(record);
    free(view);
    proto_json_free(&old);
}

void srv_patch_view(struct srv_request *request, struct srv_reply *reply) {
    const char *name;
    size_t size = 0;
    proto_json *body = srv_request_json(request, reply);
    char *record = body && read_name(body, &name, reply) ? own_record(request, &size, reply) : NULL;
    if (record)
        rename_record(request, record, size, name, reply);
    proto_json_free(&body);
    free(record);
}
