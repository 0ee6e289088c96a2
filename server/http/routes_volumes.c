/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "http/routes.h"
#include "http/routes_array.h"
#include "protocol/text.h"
#include "protocol/view.h"
#include "protocol/volume.h"
#include "render/data_folder.h"
#include "render/formats.h"
#include "render/source.h"
#include "sp/bricks.h"
#include "uploads/uploads.h"

enum {
    REASON_BYTES = 100, /* of a failed load, in the list */
    UPLOAD_BYTES = 256  /* "upload:" and an id that a client gave, truncated */
};

/* Encodes the memory of the volume: its samples and vectors, and the cached data of all renderers.
 * NULL when out of memory. */
static proto_json *encode_memory(const struct srv_volume_status *status) {
    const struct sp_volume_info *info = sp_volume_info(status->volume);
    const uint32_t *dims = info->grid.dims;
    double samples = (double)dims[0] * dims[1] * dims[2] + info->elements.count;
    proto_json *memory = proto_json_object();
    proto_json_set_integer(&memory, "voxels",
                           (int64_t)(sp_volume_bytes(info) + status->step_bytes));
    proto_json_set_integer(&memory, "derived", (int64_t)status->cached_bytes);
    proto_json_set_number(&memory, "derived_per_voxel", (double)status->cached_bytes / samples);
    return memory;
}

/* Writes why a load failed: with the place in the file, or only the first words. */
static void write_reason(const struct sp_error *err, bool in_full, char *reason, size_t size) {
    if (in_full) {
        snprintf(reason, size, "%s%s%s", err->place, err->place[0] ? ": " : "", err->text);
        return;
    }
    size_t length = strlen(err->text), most = REASON_BYTES;
    if (length > most) {
        while (most > REASON_BYTES / 2 && err->text[most] != ' ')
            most--;
        while (most > 0 && ((unsigned char)err->text[most] & 0xC0) == 0x80)
            most--;
    }
    snprintf(reason, size, "%.*s%s", (int)(length < most ? length : most), err->text,
             length > most ? " …" : "");
}

/* Returns the name of the format of a source, as clients see it. */
static const char *format_of(const struct srv_volume_status *status) {
    char file[sizeof status->source];
    snprintf(file, sizeof file, "%.*s", (int)sp_source_split(status->source).path_bytes,
             status->source);
    const char *format = srv_format_of(file);
    return srv_source_is_demo(status->source)     ? "built-in"
           : srv_source_is_memory(status->source) ? "shared memory"
           : format                               ? format
                                                  : "";
}

/* True if the request may close the volume: it is an admin's, or its token opened the volume. */
static bool may_close(const struct srv_request *request, const struct srv_volume_status *status) {
    const char *scope = srv_request_scope(request);
    return request->grant.rights & SRV_RIGHT_CONTROL &&
           (!scope || strcmp(scope, status->owner) == 0);
}

/* Adds a warning about bricks of the volume that could not be read. */
static void warn_of_damage(struct sp_volume *volume, struct sp_volume_info *info) {
    struct sp_bricks_damage damage;
    int at = 0;
    while (at < SP_WARNINGS_MAX - 1 && info->warnings[at][0])
        at++;
    if (!sp_bricks_get_damage(volume, &damage))
        return;
    const uint32_t *from = damage.box[0], *end = damage.box[1];
    snprintf(info->warnings[at], sizeof info->warnings[at],
             "%" PRIu64 " bricks cannot be read, the first at voxels (%u, %u, %u) to (%u, %u, %u), "
             "level %u: %.80s; coarser samples are shown there",
             damage.count, from[0], from[1], from[2], end[0] - 1, end[1] - 1, end[2] - 1,
             damage.level, damage.why.text);
}

/* The description of a loaded volume. NULL when out of memory. */
static proto_json *describe_volume(const struct srv_volume_status *status, bool in_full) {
    struct sp_volume_info *info = malloc(sizeof *info);
    if (!info)
        return NULL;
    *info = *sp_volume_info(status->volume);
    warn_of_damage(status->volume, info);
    proto_json *json = proto_volume_encode(info, status->id, in_full);
    free(info);
    return json;
}

proto_json *srv_encode_volume(const struct srv_request *request,
                              const struct srv_volume_status *status, bool in_full) {
    proto_json *json = status->volume ? describe_volume(status, in_full) : proto_json_object();
    proto_json_set_string(&json, "id", status->id);
    proto_json_set_string(&json, "name", status->name);
    proto_json_set_string(&json, "source", status->source);
    proto_json_set_string(&json, "format", format_of(status));
    proto_json_set_string(&json, "state", srv_volume_state_name(status->state));
    proto_json_set_number(&json, "progress", status->progress);
    proto_json_set_bool(&json, "may_close", may_close(request, status));
    if (status->state == SRV_VOLUME_FAILED) {
        char reason[SP_ERROR_PLACE + SP_ERROR_TEXT + 4];
        write_reason(&status->error, in_full, reason, sizeof reason);
        proto_json_set_string(&json, "reason", reason);
    }
    if (status->volume && in_full)
        proto_json_set(&json, "memory", encode_memory(status));
    return json;
}

/* Encodes what the token may do with volumes, so that a page offers nothing else. NULL when out of
 * memory. */
static proto_json *encode_rights(const struct srv_request *request) {
    const struct srv_http_options *app = request->app;
    bool may_open = request->grant.rights & SRV_RIGHT_CONTROL;
    proto_json *may = proto_json_object();
    proto_json_set_bool(&may, "open", may_open);
    proto_json_set_bool(&may, "browse", may_open && srv_catalog_data(app->catalog));
    proto_json_set_bool(&may, "upload", may_open && app->uploads);
    proto_json_set_bool(&may, "remote", may_open && srv_catalog_allows_hosts(app->catalog));
    return may;
}

void srv_get_volumes(struct srv_request *request, struct srv_reply *reply) {
    struct srv_volume_status status;
    proto_json *json = proto_json_object(), *list = proto_json_array();
    for (unsigned i = 0; srv_catalog_at(request->app->catalog, i, &status); i++) {
        proto_json_append(&list, srv_encode_volume(request, &status, false));
        sp_volume_unref(&status.volume);
    }
    proto_json_set(&json, "volumes", list);
    proto_json_set(&json, "may", encode_rights(request));
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

/* Returns the volume of the path, which the caller releases; NULL: the reply says why not. */
static struct srv_volume *acquire_volume(struct srv_request *request, const char *id,
                                         struct srv_reply *reply) {
    struct sp_error err;
    struct srv_volume *volume = srv_catalog_acquire(request->app->catalog, id, &err);
    if (!volume) {
        if (srv_store_is_sound(request->app->store, SRV_KIND_VOLUME, id, &err))
            srv_name_volumes(request, &err);
        err.place[0] = 0; /* the volume is the resource, not a member of a body */
        srv_reply_error(reply, &err);
    }
    return volume;
}

/* Reads the time step that a request is about. False: the reply is a problem document. */
static bool read_step(struct srv_request *request, struct srv_volume *volume,
                      const proto_json *view, uint32_t *step, struct srv_reply *reply) {
    const struct sp_volume_info *info = sp_volume_info(srv_volume_voxels(volume));
    const char *text = srv_request_query(request, "step");
    int64_t number = info->steps.index;
    if (view && !proto_json_integer(proto_json_get(proto_json_get(view, "time"), "step"), &number))
        number = info->steps.index;
    const bool is_whole = !text || (*text && strspn(text, "0123456789") == strlen(text));
    if (text)
        number = strlen(text) < 10 ? strtoll(text, NULL, 10) : INT64_MAX;
    *step = (uint32_t)number;
    if (is_whole && number < info->steps.count)
        return true;
    srv_reply_problem(reply, is_whole ? 422 : 400, NULL,
                      "?step=%.20s: must be a whole number in [0, %u], a time step of the volume",
                      text ? text : "", info->steps.count - 1);
    return false;
}

struct srv_volume *srv_acquire_step(struct srv_request *request, const char *id,
                                    const proto_json *view, struct srv_reply *reply) {
    struct srv_catalog *catalog = request->app->catalog;
    struct srv_volume *volume = acquire_volume(request, id, reply);
    struct sp_error err;
    uint32_t number;
    if (!volume)
        return NULL;
    if (!read_step(request, volume, view, &number, reply)) {
        srv_catalog_release(catalog, volume);
        return NULL;
    }
    volume = srv_catalog_ready_step(catalog, volume, number, &err);
    if (!volume) {
        err.place[0] = 0; /* the volume is the resource, not a member of a body */
        srv_reply_error(reply, &err);
    }
    return volume;
}

bool srv_find_volume(struct srv_request *request, const char *id, struct srv_volume_status *status,
                     struct srv_reply *reply) {
    struct sp_error err;
    if (srv_catalog_find(request->app->catalog, id, status))
        return true;
    sp_fail(&err, SP_ERR_NOT_FOUND, NULL, "there is no volume '%s'", id);
    if (srv_store_is_sound(request->app->store, SRV_KIND_VOLUME, id, &err))
        srv_name_volumes(request, &err);
    srv_reply_error(reply, &err);
    return false;
}

void srv_get_volume(struct srv_request *request, struct srv_reply *reply) {
    struct srv_volume_status status;
    if (!srv_find_volume(request, request->param, &status, reply))
        return;
    proto_json *json = srv_encode_volume(request, &status, true);
    if (status.volume) {
        unsigned sessions = srv_hub_volume_sessions(request->app->hub, status.id);
        proto_json_set_integer(&json, "uses", status.uses);
        proto_json_set_integer(&json, "sessions", sessions);
    }
    sp_volume_unref(&status.volume);
    srv_reply_json(reply, 200, json);
}

void srv_reply_default_view(struct srv_request *request, const char *id, struct srv_reply *reply) {
    struct sp_view view;
    struct srv_volume *volume = acquire_volume(request, id, reply);
    if (!volume)
        return;
    srv_catalog_default_view(request->app->catalog, volume, &view);
    srv_catalog_release(request->app->catalog, volume);
    srv_reply_json(reply, 200, proto_view_encode(&view));
}

void srv_get_volume_view(struct srv_request *request, struct srv_reply *reply) {
    srv_reply_default_view(request, request->param, reply);
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

/* The members that name what to load; a request has one of them. */
static const char *const sources[] = { "source", "path", "uri", "upload" };
static const char *const pointers[] = { "/source", "/path", "/uri", "/upload" };
enum { SOURCES = sizeof sources / sizeof *sources };

/* Checks the value of a member of `sources`. */
static bool check_source(const char *member, const char *pointer, const char *value,
                         struct srv_reply *reply) {
    bool is_demo = srv_source_is_demo(value);
    struct sp_error err;
    if (!*value)
        srv_reply_problem(reply, 422, pointer, "must not be empty");
    else if (strcmp(member, "uri") == 0 && !is_demo)
        srv_reply_problem(reply, 422, pointer, "must be demo:NAME");
    else if (strcmp(member, "path") == 0 && is_demo)
        srv_reply_problem(reply, 422, pointer,
                          "is a built-in volume; give it as \"source\" or \"uri\"");
    else if (srv_source_is_upload(value))
        srv_reply_problem(reply, 422, pointer,
                          "names an upload; give its id as \"upload\", or upload the file again");
    else if (strcmp(member, "upload") != 0 && !srv_data_check_relative(value, pointer, &err))
        srv_reply_error(reply, &err);
    else
        return true;
    return false;
}

/* Reads the name of a field, NULL if the body has none. */
static bool read_name(const proto_json *body, const char *key, const char *pointer,
                      const char **name, struct srv_reply *reply) {
    if (!read_string(body, key, pointer, name, reply))
        return false;
    if (!*name || **name)
        return true;
    srv_reply_problem(reply, 422, pointer, "must be the name of a field of the volume's file");
    return false;
}

/* Fills the source of other fields of a volume's file; *text, malloc'ed, holds it. */
static bool read_field(struct srv_catalog *catalog, const proto_json *body, const char *volume,
                       struct srv_volume_request *load, char **text, struct srv_reply *reply) {
    const char *field, *vectors;
    struct sp_error err;
    if (!read_name(body, "field", "/field", &field, reply) ||
        !read_name(body, "vectors", "/vectors", &vectors, reply))
        return false;
    if (!field && !vectors) {
        srv_reply_problem(reply, 422, "/field",
                          "give \"field\", \"vectors\" or both: names of the volume's file");
        return false;
    }
    if (!srv_catalog_field(catalog, volume, field, vectors, load, text, &err)) {
        srv_reply_error(reply, &err);
        return false;
    }
    load->source = *text;
    load->pointer = load->confined || srv_source_is_upload(*text) ? "/volume" : NULL;
    return true;
}

/* Fills load->source and its pointer. `upload` receives "upload:ID" if the body names an upload. */
static bool read_source(const proto_json *body, char upload[UPLOAD_BYTES],
                        struct srv_volume_request *load, struct srv_reply *reply) {
    unsigned given = 0;
    for (int i = 0; i < SOURCES; i++) {
        const char *value;
        if (!read_string(body, sources[i], pointers[i], &value, reply))
            return false;
        if (!value)
            continue;
        if (!check_source(sources[i], pointers[i], value, reply))
            return false;
        given++;
        load->source = value;
        load->pointer = pointers[i];
    }
    if (given != 1) {
        srv_reply_problem(reply, 422, NULL,
                          "give one of \"source\" (a path below the data folder, or demo:NAME), "
                          "\"upload\" (the id of an upload) and \"memory\" (the id of an array)");
        return false;
    }
    if (strcmp(load->pointer, "/upload") == 0) {
        snprintf(upload, UPLOAD_BYTES, SRV_SOURCE_UPLOAD "%s", load->source);
        load->source = upload;
    }
    return true;
}

static bool read_request(const struct srv_request *request, const proto_json *body,
                         char upload[UPLOAD_BYTES], char **field, struct srv_volume_request *load,
                         struct srv_reply *reply) {
    static const char *const known[] = { "source", "path",       "uri",     "upload", "memory",
                                         "volume", "field",      "vectors", "id",     "name",
                                         "dims",   "type",       "spacing", "origin", "direction",
                                         "unit",   "value_unit", "meaning", NULL };
    struct sp_error err;
    const char *volume;
    if (!proto_json_only(body, known, &err)) {
        srv_reply_error(reply, &err);
        return false;
    }
    if (!read_string(body, "id", "/id", &load->id, reply) ||
        !read_string(body, "name", "/name", &load->name, reply))
        return false;
    if (load->name && !proto_text_is_plain(load->name)) {
        srv_reply_problem(reply, 422, "/name", "must not contain invisible control characters");
        return false;
    }
    if (srv_array_is_for(body))
        return srv_array_read(request, body, upload, load, reply);
    if (!srv_array_check_absent(body, reply) ||
        !read_string(body, "volume", "/volume", &volume, reply))
        return false;
    for (int i = 0; !volume && i < 2; i++)
        if (proto_json_get(body, i ? "vectors" : "field")) {
            srv_reply_problem(reply, 422, i ? "/vectors" : "/field", "needs \"volume\"");
            return false;
        }
    for (int i = 0; volume && i < SOURCES; i++)
        if (proto_json_get(body, sources[i])) {
            srv_reply_problem(reply, 422, pointers[i], "excludes \"volume\"");
            return false;
        }
    return volume ? read_field(request->app->catalog, body, volume, load, field, reply)
                  : read_source(body, upload, load, reply);
}

/* The upload of another token does not exist for this one. */
static bool may_use_upload(const struct srv_request *request, const struct srv_volume_request *load,
                           struct srv_reply *reply) {
    struct srv_upload_info info;
    struct sp_error err;
    char id[SP_NAME_BYTES];
    if (!srv_source_upload_id(load->source, id) || !request->app->uploads ||
        srv_uploads_get(request->app->uploads, id, srv_request_scope(request), 0, &info, &err))
        return true;
    snprintf(err.place, sizeof err.place, "%s", load->pointer);
    srv_reply_error(reply, &err);
    return false;
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
    struct srv_volume_request load = { .confined = true,
                                       .owner = request->grant.name,
                                       .is_limited = srv_request_scope(request) != NULL,
                                       .volumes_max = request->grant.quota.volumes };
    struct sp_error err;
    char id[SP_NAME_BYTES], upload[UPLOAD_BYTES], *field = NULL;
    bool existed, conflict;
    proto_json *body = srv_request_json(request, reply);
    if (!body)
        return;
    if (read_request(request, body, upload, &field, &load, reply) &&
        may_use_upload(request, &load, reply)) {
        struct srv_volume_status status;
        if (!srv_catalog_add(request->app->catalog, &load, id, &existed, &conflict, &err)) {
            if (conflict)
                srv_reply_problem(reply, 409, err.place, "%s", err.text);
            else
                srv_reply_error(reply, &err);
        } else if (srv_find_volume(request, id, &status, reply)) {
            srv_array_opened(request, load.source);
            srv_reply_json(reply, existed ? 201 : 202, srv_encode_volume(request, &status, false));
            sp_volume_unref(&status.volume);
            if (reply->status < 400) {
                srv_reply_header(reply, "Location", "volumes/%s", id);
                reply_durable(request, id, reply);
            }
        }
    }
    free(field);
    proto_json_free(&body);
}

/* Nobody knows whose volume a damaged record is: an admin may remove it. */
static bool remove_damaged(struct srv_request *request, struct sp_error *err) {
    struct srv_store *store = request->app->store;
    return !srv_store_is_sound(store, SRV_KIND_VOLUME, request->param, err) &&
           !srv_request_scope(request) && srv_store_remove(store, SRV_KIND_VOLUME, request->param);
}

void srv_delete_volume(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    if (!srv_catalog_remove(request->app->catalog, request->param, srv_request_scope(request),
                            &err) &&
        !remove_damaged(request, &err)) {
        srv_name_volumes(request, &err);
        srv_reply_error(reply, &err);
        return;
    }
    srv_hub_close_volume(request->app->hub, request->param, srv_clock_ms());
    srv_request_reply_changed(request, true, NULL);
}
