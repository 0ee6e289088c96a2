/* SPDX-License-Identifier: Apache-2.0 */
#include "paths/paths.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "config/secret.h"
#include "config/tokens.h"
#include "paths/paths_private.h"
#include "sp/log.h"

void srv_path_file_name(const struct srv_path_output *output, uint32_t frame, char name[32]) {
    snprintf(name, 32, "%06u%s", frame,
             output->is_movie ? ".vp9" : sp_image_format_info(output->format)->extension);
}

/* Paths. */

static struct srv_path *make_removed_path(struct srv_paths *paths, const char *id) {
    struct srv_path *path = calloc(1, sizeof *path);
    if (!path)
        return NULL;
    atomic_init(&path->is_removed, false);
    path->paths = paths;
    path->refs = 1;
    snprintf(path->id, sizeof path->id, "%s", id);
    return path;
}

static struct srv_path *make_path(struct srv_paths *paths, const char *id, const char *owner,
                                  const struct srv_keyframes *keyframes,
                                  const struct srv_fingerprint *content) {
    struct srv_path *path = make_removed_path(paths, id);
    const struct sp_view *view = srv_keyframes_key(keyframes, 0);
    if (!path)
        return NULL;
    path->output = *srv_keyframes_output(keyframes);
    memcpy(path->size, view->size, sizeof path->size);
    memcpy(path->volume, view->volume, sizeof path->volume);
    path->content = *content;
    snprintf(path->owner, sizeof path->owner, "%s", owner);
    return path;
}

void srv_path_unref(struct srv_path *path) {
    if (--path->refs == 0)
        free(path);
}

const char *srv_path_state_name(const struct srv_path *path) {
    static const char *const names[] = { "waiting", "running", "done", "failed" };
    return names[path->state];
}

void srv_path_describe(const struct srv_path *path, struct srv_path_info *info) {
    *info = (struct srv_path_info){ .state = srv_path_state_name(path),
                                    .size = { path->size[0], path->size[1] },
                                    .output = path->output,
                                    .done = path->done,
                                    .bytes = path->bytes };
    memcpy(info->id, path->id, sizeof info->id);
    memcpy(info->owner, path->owner, sizeof info->owner);
    memcpy(info->reason, path->reason, sizeof info->reason);
    memcpy(info->volume, path->volume, sizeof info->volume);
}

proto_json *srv_path_info_encode(const struct srv_path_info *info) {
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "id", info->id);
    if (info->owner[0])
        proto_json_set_string(&json, "owner", info->owner);
    proto_json_set_string(&json, "state", info->state);
    if (info->reason[0])
        proto_json_set_string(&json, "reason", info->reason);
    proto_json_set_string(&json, "volume", info->volume);
    proto_json_set(&json, "size", proto_json_integers(info->size, 2));
    proto_json_set_string(&json, "format", srv_path_format_name(&info->output));
    proto_json_set_number(&json, "fps", info->output.fps);
    proto_json_set_integer(&json, "frames", info->output.frames);
    proto_json_set_integer(&json, "done", info->done);
    proto_json_set_integer(&json, "bytes", (int64_t)info->bytes);
    return json;
}

struct srv_path **srv_paths_find(struct srv_paths *paths, const char *id) {
    struct srv_path **at = &paths->list;
    while (*at && strcmp((*at)->id, id) != 0)
        at = &(*at)->next;
    return at;
}

static void append(struct srv_paths *paths, struct srv_path *path) {
    struct srv_path **at = &paths->list;
    while (*at)
        at = &(*at)->next;
    *at = path;
}

struct file_filter {
    struct srv_path *path;
    bool has_movie;
};

/* True if the path needs this file. It does not need a file that was only partly written, nor the
 * packets of a movie that is complete. */
static bool is_file_of_path(void *user, const char *name) {
    const struct file_filter *l = user;
    char expected[32];
    if (l->has_movie)
        return strcmp(name, SRV_PATH_MOVIE_NAME) == 0;
    srv_path_file_name(&l->path->output, (uint32_t)strtoul(name, NULL, 10), expected);
    return strcmp(name, expected) == 0;
}

/* Finds the files of a path: its frames up to the first missing one, or its movie. */
static void count_files(struct srv_paths *paths, struct srv_path *path) {
    uint64_t size;
    char name[32];
    struct file_filter filter = { path, path->output.is_movie &&
                                            srv_folder_size(&paths->folder, path->id,
                                                            SRV_PATH_MOVIE_NAME, &size) };
    srv_folder_clean(&paths->folder, path->id, is_file_of_path, &filter);
    if (filter.has_movie) {
        path->done = path->output.frames;
        srv_path_quota_add(paths, path, size);
        path->state = SRV_PATH_DONE;
        return;
    }
    for (; path->done < path->output.frames; path->done++) {
        srv_path_file_name(&path->output, path->done, name);
        if (!srv_folder_size(&paths->folder, path->id, name, &size))
            break;
        srv_path_quota_add(paths, path, size);
    }
    if (!path->output.is_movie && path->done == path->output.frames)
        path->state = SRV_PATH_DONE;
}

/* Takes up a path whose removal was not finished; the thread finishes it. */
static bool restore_gone(struct srv_paths *paths, const char *id, struct sp_error *err) {
    struct srv_path *path = make_removed_path(paths, id);
    if (!path)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while creating a camera path");
    atomic_store(&path->is_removed, true);
    path->next = paths->gone;
    paths->gone = path;
    return true;
}

static bool restore_path(struct srv_paths *paths, const char *id, const proto_json *record,
                         struct sp_error *err) {
    struct srv_fingerprint content;
    const char *text = proto_json_string(proto_json_get(record, "content"));
    if (!srv_fingerprint_decode(text, &content))
        return sp_fail(err, SP_ERR_FORMAT, "/content", "the record is not a camera path");
    struct srv_keyframes *keyframes = srv_path_record_keyframes(record, err);
    const char *owner = proto_json_string(proto_json_get(record, "owner"));
    struct srv_path *path =
        keyframes ? make_path(paths, id, owner ? owner : "", keyframes, &content) : NULL;
    if (path)
        path->output.is_sealed = srv_path_record_is_sealed(record);
    const char *failed = proto_json_string(proto_json_get(record, "failed"));
    if (path && !(path->by = srv_path_quota_add_path(paths, path->owner, err))) {
        srv_path_unref(path);
        path = NULL;
    } else if (path) {
        count_files(paths, path);
        if (failed && path->state != SRV_PATH_DONE) {
            path->state = SRV_PATH_FAILED;
            snprintf(path->reason, sizeof path->reason, "%s", failed);
        }
        append(paths, path);
    } else if (keyframes) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while creating a camera path");
    }
    srv_keyframes_free(&keyframes);
    return path != NULL;
}

static bool restore(struct srv_paths *paths, const char *id, struct sp_error *err) {
    proto_json *record = srv_path_record_read(paths, id, err);
    bool ok = record && (srv_path_record_is_removed(record) ? restore_gone(paths, id, err)
                                                            : restore_path(paths, id, record, err));
    proto_json_free(&record);
    return ok;
}

/* `user`: a list of ids as srv_store_ids() returns it. */
static bool is_among(void *user, const char *id) {
    const char *at = user;
    while (*at && strcmp(at, id) != 0)
        at += strlen(at) + 1;
    return *at != 0;
}

/* Counts files without a record, which happens when the database was replaced. */
static void count_strays(struct srv_paths *paths, char *ids) {
    uint64_t bytes;
    unsigned count = srv_folder_strays(&paths->folder, is_among, ids, &bytes);
    paths->bytes += bytes;
    if (count > 0)
        sp_log(SP_LOG_WARN,
               "%u folders in %s (%llu bytes) belong to no known camera path; they are kept and "
               "count towards --path-bytes: delete them, or restore the database that knows them",
               count, paths->folder.root, (unsigned long long)bytes);
}

static bool restore_all(struct srv_paths *paths, struct sp_error *err) {
    char *ids = srv_store_ids(paths->options.store, SRV_KIND_PATH);
    if (!ids)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while restoring the camera paths");
    for (const char *id = ids; *id; id += strlen(id) + 1) {
        struct sp_error why;
        if (!restore(paths, id, &why))
            srv_store_damage(paths->options.store, SRV_KIND_PATH, id, &why);
    }
    count_strays(paths, ids);
    free(ids);
    return true;
}

struct srv_paths *srv_paths_create(const struct srv_paths_options *options, struct sp_error *err) {
    struct srv_paths *paths = calloc(1, sizeof *paths);
    if (!paths) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while creating the camera paths");
        return NULL;
    }
    paths->options = *options;
    atomic_init(&paths->stop, false);
    pthread_mutex_init(&paths->records, NULL);
    pthread_mutex_init(&paths->mutex, NULL);
    srv_clock_cond_init(&paths->wake);
    if (!(paths->encoder = sp_encoder_create(err)) ||
        !srv_folder_open(&paths->folder, options->state, err) || !restore_all(paths, err))
        srv_paths_destroy(&paths);
    return paths;
}

bool srv_paths_start(struct srv_paths *paths, struct sp_error *err) {
    int failed = pthread_create(&paths->thread, NULL, srv_paths_main, paths);
    paths->is_running = failed == 0;
    return !failed || sp_fail(err, SP_ERR_IO, NULL, "cannot start the thread for camera paths: %s",
                              strerror(failed));
}

static void drop(struct srv_paths *paths, struct srv_path *list) {
    while (list) {
        struct srv_path *next = list->next;
        if (paths->folder.is_private)
            srv_folder_remove(&paths->folder, list->id, NULL);
        srv_path_unref(list);
        list = next;
    }
}

void srv_paths_destroy(struct srv_paths **pointer) {
    struct srv_paths *paths = *pointer;
    *pointer = NULL;
    if (!paths)
        return;
    srv_paths_close(paths);
    if (paths->is_running)
        pthread_join(paths->thread, NULL);
    drop(paths, paths->list);
    drop(paths, paths->gone);
    while (paths->owners) {
        struct srv_path_owner *owner = paths->owners;
        paths->owners = owner->next;
        free(owner);
    }
    srv_folder_close(&paths->folder);
    sp_encoder_destroy(&paths->encoder);
    pthread_cond_destroy(&paths->wake);
    pthread_mutex_destroy(&paths->mutex);
    pthread_mutex_destroy(&paths->records);
    free(paths);
}

void srv_paths_unblock(struct srv_paths *paths) {
    paths->generation++;
    for (struct srv_path *path = paths->list; path; path = path->next)
        path->blocked_ms = 0;
    pthread_cond_broadcast(&paths->wake);
}

void srv_paths_wake(struct srv_paths *paths) {
    pthread_mutex_lock(&paths->mutex);
    srv_paths_unblock(paths);
    pthread_mutex_unlock(&paths->mutex);
}

void srv_paths_unloaded(struct srv_paths *paths, const char *volume) {
    pthread_mutex_lock(&paths->mutex);
    for (struct srv_path *path = paths->list; path; path = path->next)
        if (strcmp(path->volume, volume) == 0)
            path->is_unloaded = true;
    srv_paths_unblock(paths);
    pthread_mutex_unlock(&paths->mutex);
}

/* Requests. */

static const char *const members[] = { "view",   "keyframes", "frames", "fps",
                                       "format", "quality",   "size",   NULL };

/* Checks that the encoder of a movie fits into --video-pixels at all. */
static bool check_movie(struct srv_paths *paths, const struct srv_keyframes *keyframes,
                        struct sp_error *err) {
    const uint32_t *size = srv_keyframes_key(keyframes, 0)->size;
    uint64_t px = (uint64_t)size[0] * size[1], max = paths->options.video_px;
    return !srv_keyframes_output(keyframes)->is_movie || px <= max ||
           sp_fail(err, SP_ERR_INVALID, "/size",
                   "a movie of %u x %u has %llu px and --video-pixels allows %llu", size[0],
                   size[1], (unsigned long long)px, (unsigned long long)max);
}

/* Checks that the renderers support every frame. Only the names in a view decide that, and between
 * two keyframes all names come from one of them. */
static bool check_support(struct srv_paths *paths, const struct srv_keyframes *keyframes,
                          struct sp_error *err) {
    struct sp_error why;
    const struct sp_view *view;
    for (unsigned i = 0; (view = srv_keyframes_key(keyframes, i)); i++) {
        if (srv_render_pool_supports(paths->options.render_pool, view, &why))
            continue;
        *err = why;
        if (i == 0)
            snprintf(err->place, sizeof err->place, "/view%.200s", why.place);
        else
            snprintf(err->place, sizeof err->place, "/keyframes/%u/view%.200s", i - 1, why.place);
        return false;
    }
    return true;
}

/* Notes that the record has changed; flush() must follow, without the mutex. The caller holds it.
 */
static void begin_write(struct srv_path *path) {
    path->unwritten++;
    path->refs++;
}

/* Called also if writing failed: the record is valid in memory then. */
static void on_written(void *user, bool durable) {
    struct srv_path *path = user;
    struct srv_paths *paths = path->paths;
    (void)durable;
    pthread_mutex_lock(&paths->mutex);
    path->unwritten--;
    srv_path_unref(path);
    pthread_cond_broadcast(&paths->wake);
    pthread_mutex_unlock(&paths->mutex);
}

static void flush(struct srv_path *path) {
    srv_store_flush(path->paths->options.store, on_written, path);
}

/* Stores the path and its record. The path has been counted in the quotas. */
static proto_json *store_path(struct srv_paths *paths, struct srv_path *path,
                              const struct srv_keyframes *keyframes, const proto_json *body,
                              const struct sp_view *defaults, struct sp_error *err) {
    struct srv_path_info info;
    srv_path_describe(path, &info);
    proto_json *json = srv_path_info_encode(&info);
    bool ok =
        json || sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while creating a camera path");
    ok = ok && srv_path_record_put(paths, path, keyframes, body, defaults, err);
    pthread_mutex_lock(&paths->mutex);
    if (ok) {
        append(paths, path);
        begin_write(path);
    } else {
        srv_path_quota_remove_path(paths, path->by);
        srv_path_quota_release_owner(paths, path->by);
    }
    pthread_mutex_unlock(&paths->mutex);
    if (ok) {
        flush(path);
    } else {
        free(path);
        proto_json_free(&json);
    }
    return json;
}

proto_json *srv_paths_add(struct srv_paths *paths, const proto_json *body,
                          const struct srv_path_request *view, const char *owner,
                          char id[SRV_PATH_ID_BYTES], bool *is_full, struct sp_error *err) {
    struct srv_path *path = NULL;
    proto_json *json = NULL;
    *is_full = false;
    struct srv_keyframes *keyframes =
        proto_json_only(body, members, err)
            ? srv_keyframes_read(body, &view->view, &view->defaults, paths->options.frames_max, err)
            : NULL;
    bool ok = keyframes && check_movie(paths, keyframes, err) &&
              check_support(paths, keyframes, err) &&
              srv_secret_hex(id, SRV_PATH_ID_BYTES - 1, err);
    if (ok &&
        !(path = make_path(paths, id, owner, keyframes, srv_volume_fingerprint(view->volume))))
        ok = sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while creating a camera path");
    if (ok)
        path->output.is_sealed = true;
    if (ok && (path->by = srv_path_quota_request_path(paths, owner, is_full, err)))
        json = store_path(paths, path, keyframes, body, &view->defaults, err);
    else
        free(path);
    srv_keyframes_free(&keyframes);
    return json;
}

bool srv_path_missing(struct srv_paths *paths, const char *id, struct sp_error *err) {
    return srv_store_is_sound(paths->options.store, SRV_KIND_PATH, id, err) &&
           sp_fail(err, SP_ERR_NOT_FOUND, NULL, "there is no path '%.64s'", id);
}

proto_json *srv_paths_get(struct srv_paths *paths, const char *id, struct sp_error *err) {
    struct srv_path_info info;
    pthread_mutex_lock(&paths->mutex);
    struct srv_path *path = *srv_paths_find(paths, id);
    if (path)
        srv_path_describe(path, &info);
    pthread_mutex_unlock(&paths->mutex);
    proto_json *json = path ? srv_path_info_encode(&info) : NULL;
    if (!path)
        srv_path_missing(paths, id, err);
    else if (!json)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while creating a camera path");
    return json;
}

void srv_paths_list(struct srv_paths *paths, const char *owner, struct srv_page *page) {
    pthread_mutex_lock(&paths->mutex);
    for (struct srv_path *path = paths->list; path; path = path->next) {
        bool is_listed = !owner || strcmp(path->owner, owner) == 0;
        struct srv_path_info *info = is_listed ? srv_page_slot(page, path->id) : NULL;
        if (info)
            srv_path_describe(path, info);
    }
    pthread_mutex_unlock(&paths->mutex);
}

/* Moves a path to the removed ones, where no request finds it. */
static void mark_removed(struct srv_paths *paths, struct srv_path *path) {
    pthread_mutex_lock(&paths->mutex);
    *srv_paths_find(paths, path->id) = path->next;
    path->next = paths->gone;
    paths->gone = path;
    srv_path_quota_remove_path(paths, path->by);
    atomic_store(&path->is_removed, true);
    begin_write(path);
    srv_paths_notify(paths, path);
    pthread_cond_broadcast(&paths->wake);
    pthread_mutex_unlock(&paths->mutex);
}

/* Takes up a path whose record is damaged, so that its files can be deleted; its record says so on
 * success. NULL: there is none, or no memory. The caller holds `records`. */
static struct srv_path *remove_damaged(struct srv_paths *paths, const char *id,
                                       struct sp_error *err) {
    if (srv_path_missing(paths, id, err) || err->code != SP_ERR_IO)
        return NULL;
    struct srv_path *path = make_removed_path(paths, id);
    if (!path || !srv_path_record_remove(paths, id, err)) {
        if (!path)
            sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while deleting a camera path");
        free(path);
        return NULL;
    }
    pthread_mutex_lock(&paths->mutex);
    atomic_store(&path->is_removed, true);
    path->next = paths->gone;
    paths->gone = path;
    begin_write(path);
    pthread_mutex_unlock(&paths->mutex);
    return path;
}

bool srv_paths_remove(struct srv_paths *paths, const char *id, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    pthread_mutex_lock(&paths->records); /* only its holder removes paths from the list */
    pthread_mutex_lock(&paths->mutex);
    struct srv_path *path = *srv_paths_find(paths, id);
    pthread_mutex_unlock(&paths->mutex);
    bool ok = path && srv_path_record_remove(paths, id, &why);
    if (ok)
        mark_removed(paths, path);
    else if (!path)
        ok = (path = remove_damaged(paths, id, &why)) != NULL;
    if (!ok && err)
        *err = why;
    pthread_mutex_unlock(&paths->records);
    if (ok)
        flush(path);
    return ok;
}

void srv_paths_stats(struct srv_paths *paths, struct srv_paths_stats *stats) {
    pthread_mutex_lock(&paths->mutex);
    *stats = (struct srv_paths_stats){ .paths = paths->count, .bytes = paths->bytes };
    for (struct srv_path *path = paths->list; path; path = path->next) {
        stats->unfinished += path->state == SRV_PATH_WAITING || path->state == SRV_PATH_RUNNING;
        stats->waiting += path->state == SRV_PATH_WAITING && path->reason[0] != 0;
    }
    pthread_mutex_unlock(&paths->mutex);
}
