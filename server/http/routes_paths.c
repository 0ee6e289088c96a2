/* SPDX-License-Identifier: Apache-2.0
 *
 * Camera paths (paths/paths.h) and their results.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "http/chunked_body.h"
#include "http/deadlines.h"
#include "http/headers.h"
#include "http/paging.h"
#include "http/routes.h"
#include "sp/log.h"

/* Creation. */

/* Returns a patch with the members of "view". With has_own_size the view's "size" is left out, and
 * `size`, the body's own, takes its place; NULL = none. NULL when out of memory. */
static proto_json *view_patch(const proto_json *view, bool has_own_size, const proto_json *size) {
    const proto_json *value;
    const char *key;
    void *at = NULL;
    proto_json *patch = proto_json_object();
    while (proto_json_next(view, &at, &key, &value))
        if (!has_own_size || strcmp(key, "size") != 0)
            proto_json_set(&patch, key, proto_json_ref((proto_json *)(uintptr_t)value));
    if (size)
        proto_json_set(&patch, "size", proto_json_ref((proto_json *)(uintptr_t)size));
    return patch;
}

/* Resolves a patch, which it frees. On success view->volume is in use. */
static bool resolve_patch(struct srv_request *request, proto_json *patch,
                          struct srv_path_request *view, struct sp_error *err) {
    bool ok = patch ? srv_hub_resolve_view(request->app->hub, NULL, patch, &view->view,
                                           &view->volume, err)
                    : sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a path");
    proto_json_free(&patch);
    return ok;
}

/* On success view->volume is in use. The pointer of an error is "/size" or "/view/…": a view that
 * is refused with the body's own size is resolved again without it. */
static bool resolve(struct srv_request *request, const proto_json *body,
                    const struct srv_owner *owner, struct srv_path_request *view,
                    struct srv_reply *reply) {
    struct srv_catalog *catalog = request->app->catalog;
    const proto_json *base = proto_json_get(body, "view"), *size = proto_json_get(body, "size");
    const char *at = size ? "" : "/view";
    struct sp_error err;
    if (base && proto_json_type(base) != PROTO_JSON_OBJECT) {
        srv_reply_problem(reply, 422, "/view", "must be an object");
        return false;
    }
    bool ok = resolve_patch(request, view_patch(base, size != NULL, size), view, &err);
    if (ok) {
        srv_catalog_default_view(catalog, view->volume, &view->defaults);
        ok = srv_owner_allows_size(owner, view->view.size, &err);
        if (!ok)
            srv_catalog_release(catalog, view->volume);
    } else if (size) {
        if (resolve_patch(request, view_patch(base, true, NULL), view, &err))
            srv_catalog_release(catalog, view->volume);
        else
            at = "/view";
    }
    if (!ok) {
        srv_name_volumes(request, &err);
        srv_reply_view_error(reply, at, &err);
    }
    return ok;
}

/* Replies with the new path. Removes the path if the reply cannot be made. */
static void reply_created(struct srv_request *request, proto_json *json, const char *id,
                          struct srv_reply *reply) {
    struct sp_error err;
    srv_reply_json(reply, 202, json);
    if (reply->status != 202) {
        srv_paths_remove(request->app->paths, id, &err);
        return;
    }
    srv_reply_header(reply, "Location", "paths/%s", id);
    sp_log_with(SP_LOG_INFO, SP_LOG_FIELDS({ "path", id }), "path %s created for %s", id,
                srv_connection_peer(request->connection));
    srv_request_reply_when_durable(request);
}

void srv_post_path(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    struct srv_path_request view;
    struct srv_owner owner;
    char id[SRV_PATH_ID_BYTES];
    bool is_full;
    proto_json *body = srv_request_json(request, reply);
    srv_request_owner(request, &owner);
    if (body && resolve(request, body, &owner, &view, reply)) {
        proto_json *json =
            srv_paths_add(request->app->paths, body, &view, owner.name, id, &is_full, &err);
        srv_catalog_release(request->app->catalog, view.volume);
        if (json)
            reply_created(request, json, id, reply);
        else if (is_full)
            srv_reply_problem(reply, 507, NULL, "%s", err.text);
        else
            srv_reply_error(reply, &err);
    }
    proto_json_free(&body);
}

static proto_json *encode_item(void *user, const void *item) {
    (void)user;
    return srv_path_info_encode(item);
}

/* An admin token lists all paths, other tokens list their own. */
void srv_get_paths(struct srv_request *request, struct srv_reply *reply) {
    bool sees_all = request->grant.rights & SRV_RIGHT_ADMIN;
    struct srv_page page;
    if (!srv_paging_begin(request, sizeof(struct srv_path_info), &page, reply))
        return;
    srv_paths_list(request->app->paths, sees_all ? NULL : request->grant.name, &page);
    srv_paging_reply(&page, "paths", encode_item, NULL, reply);
}

void srv_get_path(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    proto_json *json = srv_paths_get(request->app->paths, request->param, &err);
    srv_reply_result(reply, json, &err);
}

void srv_delete_path(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    const bool ok = srv_paths_remove(request->app->paths, request->param, &err);
    (void)reply;
    srv_request_reply_changed(request, ok, &err);
}

/* Files. */

struct file {
    int fd;
    uint64_t left; /* bytes left to send */
};

static ssize_t read_file(void *user, char *bytes, size_t size) {
    struct file *file = user;
    ssize_t n = read(file->fd, bytes, size < file->left ? size : (size_t)file->left);
    file->left -= n > 0 ? (uint64_t)n : 0;
    return n; /* 0 and −1 have the meaning of SRV_BODY_END and SRV_BODY_FAILED */
}

static void close_file(void *user) {
    struct file *file = user;
    close(file->fd);
    free(file);
}

/* Replies with a result of the path, which never changes. `name` distinguishes it from the other
 * results of the path in the ETag. */
static void reply_file(struct srv_request *request, const struct srv_path_file *result,
                       const char *name, struct srv_reply *reply) {
    char etag[96];
    struct file *file = malloc(sizeof *file);
    snprintf(etag, sizeof etag, "\"%.32s-%.32s\"", request->param, name);
    uint64_t from, count;
    enum srv_range range = srv_header_range(srv_request_header(request, "Range"),
                                            srv_request_header(request, "If-Range"), etag,
                                            result->size, &from, &count);
    bool has_it = srv_header_has_etag(srv_request_header(request, "If-None-Match"), etag);
    if (!file || has_it || range == SRV_RANGE_NONE ||
        lseek(result->fd, (off_t)from, SEEK_SET) < 0) {
        close(result->fd);
        if (has_it)
            reply->status = 304;
        else if (range == SRV_RANGE_NONE)
            srv_reply_problem(reply, 416, NULL,
                              "the range is outside of the file, which has %llu bytes",
                              (unsigned long long)result->size);
        else
            srv_reply_problem(reply, 503, NULL, "out of memory for a file");
        free(file);
    } else {
        *file = (struct file){ .fd = result->fd, .left = count };
        reply->status = range == SRV_RANGE_PARTIAL ? 206 : 200;
        reply->mime = result->mime;
        srv_reply_chunked_body(
            request, reply, count,
            &(struct srv_chunked_body){ .user = file, .read = read_file, .finish = close_file });
    }
    if (reply->status < 400) {
        srv_reply_header(reply, "ETag", "%s", etag);
        srv_reply_header(reply, "Cache-Control", "private, max-age=31536000, immutable");
        srv_reply_header(reply, "Accept-Ranges", "bytes");
    }
    if (reply->status == 206)
        srv_reply_header(reply, "Content-Range", "bytes %llu-%llu/%llu", (unsigned long long)from,
                         (unsigned long long)(from + count - 1), (unsigned long long)result->size);
    else if (reply->status == 416)
        srv_reply_header(reply, "Content-Range", "bytes */%llu", (unsigned long long)result->size);
}

void srv_get_path_frame(struct srv_request *request, struct srv_reply *reply) {
    enum { DIGITS_MAX = 9 };
    struct srv_path_file file;
    struct sp_error err;
    char *number = strchr(request->param, '/');
    *number++ = 0; /* the parameters are "ID/N" */
    size_t digits = strspn(number, "0123456789");
    if (number[digits] || digits > DIGITS_MAX)
        srv_reply_problem(reply, 404, NULL, "'%.32s' is not a frame number", number);
    else if (srv_paths_open_frame(request->app->paths, request->param,
                                  (uint32_t)strtoul(number, NULL, 10), &file, &err))
        reply_file(request, &file, number, reply);
    else
        srv_reply_error(reply, &err);
}

void srv_get_path_movie(struct srv_request *request, struct srv_reply *reply) {
    struct srv_path_file file;
    struct sp_error err;
    if (srv_paths_open_movie(request->app->paths, request->param, &file, &err))
        reply_file(request, &file, "movie", reply);
    else
        srv_reply_error(reply, &err);
}

static void close_archive(void *user) {
    struct srv_archive *archive = user;
    srv_archive_destroy(&archive);
}

void srv_get_path_archive(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    struct srv_archive *archive = srv_paths_open_archive(request->app->paths, request->param, &err);
    if (!archive) {
        srv_reply_error(reply, &err);
        return;
    }
    reply->status = 200;
    reply->mime = "application/x-tar";
    srv_reply_header(reply, "Content-Disposition", "attachment; filename=\"%.32s.tar\"",
                     request->param);
    srv_reply_chunked_body(request, reply, SRV_BODY_SIZE_UNKNOWN,
                           &(struct srv_chunked_body){ .user = archive,
                                                       .read = srv_archive_read,
                                                       .finish = close_archive });
}

/* Events. */

struct watching { /* one event stream */
    struct srv_request *request;
    struct srv_path_watch *watch;
    char *text; /* the event being sent; NULL = none */
    size_t size, at;
};

static void on_pause(void *user) {
    struct watching *w = user;
    srv_chunked_body_pause(w->request);
}

static void on_resume(void *user) {
    struct watching *w = user;
    srv_chunked_body_resume(w->request);
}

static bool is_gone(void *user) {
    struct watching *w = user;
    return srv_connection_is_gone(w->request->connection);
}

static ssize_t read_events(void *user, char *bytes, size_t size) {
    struct watching *w = user;
    if (w->at == w->size) {
        free(w->text);
        w->text = NULL;
        w->at = w->size = 0;
        switch (srv_path_watch_next(w->watch, &w->text, &w->size)) {
        case SRV_WATCH_WAITING:
            return SRV_BODY_PAUSED;
        case SRV_WATCH_OVER:
            return SRV_BODY_END;
        case SRV_WATCH_FAILED: /* a cut connection, which the client cannot mistake for the end */
            return SRV_BODY_FAILED;
        case SRV_WATCH_EVENT:
            break;
        }
    }
    size_t n = w->size - w->at < size ? w->size - w->at : size;
    memcpy(bytes, w->text + w->at, n);
    w->at += n;
    return (ssize_t)n;
}

static void end_events(void *user) {
    struct watching *w = user;
    srv_path_watch_end(&w->watch);
    free(w->text);
    free(w);
}

void srv_get_path_events(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err = { .code = SP_ERR_MEMORY, .text = "out of memory while watching a path" };
    struct watching *w = calloc(1, sizeof *w);
    bool is_over = false;
    if (w) {
        const struct srv_path_watcher watcher = { w, on_pause, on_resume, is_gone };
        w->request = request;
        w->watch =
            srv_paths_watch(request->app->paths, request->param,
                            srv_request_header(request, "Last-Event-ID"), &watcher, &is_over, &err);
    }
    if (!w || !w->watch) {
        free(w);
        if (is_over)
            reply->status = 204; /* tells a browser not to reconnect */
        else
            srv_reply_error(reply, &err);
        return;
    }
    reply->status = 200;
    reply->mime = "text/event-stream";
    srv_reply_header(reply, "Cache-Control", "no-store");
    srv_reply_header(reply, "X-Accel-Buffering", "no"); /* nginx does not buffer events */
    srv_reply_chunked_body(
        request, reply, SRV_BODY_SIZE_UNKNOWN,
        &(struct srv_chunked_body){ .user = w, .read = read_events, .finish = end_events });
}
