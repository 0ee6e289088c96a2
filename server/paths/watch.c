/* SPDX-License-Identifier: Apache-2.0
 *
 * Watches of a path: each sends the current state, then pauses until the state changes.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "paths/paths_private.h"

#define SILENCE_MS 15000.0 /* after this a comment keeps proxies from closing the connection */

/* Writes the id of the event for the current state. Different reasons give different ids. */
static void event_id(const struct srv_path *path, char id[32]) {
    uint32_t hash = 2166136261; /* FNV-1a: short, and equal on every machine and in every run */
    for (const char *c = path->reason; *c; c++)
        hash = (hash ^ (uint8_t)*c) * 16777619;
    int n = snprintf(id, 32, "%s-%u", srv_path_state_name(path), path->done);
    if (path->reason[0])
        snprintf(id + n, 32 - (size_t)n, "-%08x", hash);
}

static bool is_over(const struct srv_path *path) {
    return path->state == SRV_PATH_DONE || path->state == SRV_PATH_FAILED ||
           atomic_load(&path->is_removed);
}

/* The caller holds the mutex. */
static void wake(struct srv_path_watch *watch) {
    if (!watch->is_paused)
        return;
    watch->is_paused = false;
    watch->watcher.resume(watch->watcher.user);
}

void srv_paths_notify(struct srv_paths *paths, const struct srv_path *path) {
    for (struct srv_path_watch *watch = paths->watches; watch; watch = watch->next)
        if (watch->path == path)
            wake(watch);
}

void srv_paths_close(struct srv_paths *paths) {
    pthread_mutex_lock(&paths->mutex);
    atomic_store(&paths->stop, true);
    for (struct srv_path_watch *watch = paths->watches; watch; watch = watch->next)
        wake(watch);
    pthread_cond_broadcast(&paths->wake);
    pthread_mutex_unlock(&paths->mutex);
}

void srv_paths_tick(struct srv_paths *paths, double now_ms) {
    pthread_mutex_lock(&paths->mutex);
    for (struct srv_path_watch *watch = paths->watches; watch; watch = watch->next)
        if (watch->is_paused &&
            (now_ms - watch->sent_ms >= SILENCE_MS || watch->watcher.is_gone(watch->watcher.user)))
            wake(watch);
    pthread_mutex_unlock(&paths->mutex);
}

struct srv_path_watch *srv_paths_watch(struct srv_paths *paths, const char *id, const char *after,
                                       const struct srv_path_watcher *watcher, bool *over,
                                       struct sp_error *err) {
    struct srv_path_watch *watch = calloc(1, sizeof *watch);
    *over = false;
    if (!watch) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while watching a camera path");
        return NULL;
    }
    watch->paths = paths;
    watch->watcher = *watcher;
    watch->sent_ms = srv_clock_ms();
    snprintf(watch->last, sizeof watch->last, "%s", after ? after : "");
    pthread_mutex_lock(&paths->mutex);
    struct srv_path *path = paths->list;
    while (path && strcmp(path->id, id) != 0)
        path = path->next;
    if (path) {
        char now[32];
        event_id(path, now);
        *over = is_over(path) && strcmp(now, watch->last) == 0;
    }
    if (path && !*over) {
        path->refs++;
        watch->path = path;
        watch->next = paths->watches;
        paths->watches = watch;
    }
    pthread_mutex_unlock(&paths->mutex);
    if (watch->path)
        return watch;
    if (!*over)
        srv_path_missing(paths, id, err);
    free(watch);
    return NULL;
}

void srv_path_watch_end(struct srv_path_watch **pointer) {
    struct srv_path_watch *watch = *pointer;
    *pointer = NULL;
    if (!watch)
        return;
    struct srv_paths *paths = watch->paths;
    pthread_mutex_lock(&paths->mutex);
    struct srv_path_watch **at = &paths->watches;
    while (*at != watch)
        at = &(*at)->next;
    *at = watch->next;
    srv_path_unref(watch->path);
    pthread_mutex_unlock(&paths->mutex);
    free(watch);
}

/* The caller holds the mutex. */
static char *event_text(const struct srv_path *path, const char *id, size_t *size) {
    struct srv_path_info info;
    srv_path_describe(path, &info);
    proto_json *json = srv_path_info_encode(&info);
    char *data = proto_json_to_text(json, NULL), *text = NULL;
    const char *name = atomic_load(&path->is_removed) ? "removed"
                       : is_over(path)                ? srv_path_state_name(path)
                                                      : "progress";
    int n = data ? asprintf(&text, "id: %s\nevent: %s\ndata: %s\n\n", id, name, data) : -1;
    *size = n < 0 ? 0 : (size_t)n;
    proto_json_free(&json);
    free(data);
    return n < 0 ? NULL : text;
}

enum srv_path_watch_result srv_path_watch_next(struct srv_path_watch *watch, char **text,
                                               size_t *size) {
    struct srv_paths *paths = watch->paths;
    struct srv_path *path = watch->path;
    enum srv_path_watch_result result = SRV_WATCH_OVER;
    double now_ms = srv_clock_ms();
    char now[32];
    *text = NULL;
    pthread_mutex_lock(&paths->mutex);
    event_id(path, now);
    if (atomic_load(&path->is_removed))
        snprintf(now, sizeof now, "removed");
    bool has_news = strcmp(now, watch->last) != 0;
    if (has_news)
        *text = event_text(path, now, size);
    else if (!is_over(path) && now_ms - watch->sent_ms >= SILENCE_MS)
        *text = strdup(":\n\n"); /* a comment */
    if (*text && !has_news)
        *size = strlen(*text);
    if (*text) {
        memcpy(watch->last, now, sizeof watch->last);
        watch->sent_ms = now_ms;
        result = SRV_WATCH_EVENT;
    } else if (has_news) {
        result = SRV_WATCH_FAILED;
    } else if (!is_over(path) && !atomic_load(&paths->stop) &&
               !watch->watcher.is_gone(watch->watcher.user)) {
        watch->watcher.pause(watch->watcher.user);
        watch->is_paused = true;
        result = SRV_WATCH_WAITING;
    }
    pthread_mutex_unlock(&paths->mutex);
    return result;
}
