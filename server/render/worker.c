/* SPDX-License-Identifier: Apache-2.0 */
#include "render/worker.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "sp/log.h"

struct srv_eviction {
    struct srv_eviction *next;
    struct sp_volume *volume; /* a reference */
};

void srv_worker_init(struct srv_worker *worker, struct sp_renderer *renderer) {
    *worker = (struct srv_worker){ .renderer = renderer };
    pthread_mutex_init(&worker->mutex, NULL);
    srv_clock_cond_init(&worker->changed);
    if (renderer)
        sp_renderer_info(renderer, &worker->info);
}

/* Drops the cached data of the listed volumes and frees the list. */
static void evict_all(struct sp_renderer *renderer, struct srv_eviction *list) {
    while (list) {
        struct srv_eviction *next = list->next;
        if (renderer)
            sp_renderer_evict(renderer, list->volume);
        sp_volume_unref(&list->volume);
        free(list);
        list = next;
    }
}

void srv_worker_finish(struct srv_worker *worker) {
    evict_all(worker->renderer, worker->evictions);
    sp_renderer_destroy(&worker->renderer);
    pthread_cond_destroy(&worker->changed);
    pthread_mutex_destroy(&worker->mutex);
}

bool srv_worker_start(struct srv_worker *worker, void *(*main)(void *user), void *user,
                      struct sp_error *err) {
    int failed = pthread_create(&worker->thread, NULL, main, user);
    worker->is_running = !failed;
    return !failed ||
           sp_fail(err, SP_ERR_IO, NULL, "cannot start a render thread: %s", strerror(failed));
}

/* With the mutex held. */
static void raise_generation(struct srv_worker *worker) {
    worker->generation++;
    pthread_cond_signal(&worker->changed);
}

void srv_worker_stop(struct srv_worker *worker) {
    pthread_mutex_lock(&worker->mutex);
    worker->stop = true;
    raise_generation(worker);
    pthread_mutex_unlock(&worker->mutex);
}

void srv_worker_join(struct srv_worker *worker) {
    if (worker->is_running)
        pthread_join(worker->thread, NULL);
    worker->is_running = false;
}

void srv_worker_wake(struct srv_worker *worker) {
    pthread_mutex_lock(&worker->mutex);
    raise_generation(worker);
    pthread_mutex_unlock(&worker->mutex);
}

void srv_worker_evict(struct srv_worker *worker, struct sp_volume *volume) {
    struct srv_eviction *eviction = malloc(sizeof *eviction);
    if (!eviction) {
        sp_log(SP_LOG_ERROR, "out of memory: a renderer keeps the cached data of a volume that was "
                             "unloaded");
        return;
    }
    eviction->volume = sp_volume_ref(volume);
    pthread_mutex_lock(&worker->mutex);
    eviction->next = worker->evictions;
    worker->evictions = eviction;
    raise_generation(worker);
    pthread_mutex_unlock(&worker->mutex);
}

void srv_worker_info(struct srv_worker *worker, struct sp_renderer_info *info) {
    pthread_mutex_lock(&worker->mutex);
    *info = worker->info;
    pthread_mutex_unlock(&worker->mutex);
}

struct srv_worker_round srv_worker_begin_round(struct srv_worker *worker) {
    pthread_mutex_lock(&worker->mutex);
    struct srv_eviction *evictions = worker->evictions;
    struct srv_worker_round round = { .generation = worker->generation,
                                      .stop = worker->stop,
                                      .has_evicted = evictions != NULL };
    worker->evictions = NULL;
    pthread_mutex_unlock(&worker->mutex);
    evict_all(worker->renderer, evictions);
    return round;
}

void srv_worker_wait(struct srv_worker *worker, uint64_t generation, double wait_ms) {
    struct timespec until = srv_clock_at(srv_clock_ms() + wait_ms + 1e-6);
    pthread_mutex_lock(&worker->mutex);
    while (worker->generation == generation && !worker->stop)
        if (pthread_cond_timedwait(&worker->changed, &worker->mutex, &until) == ETIMEDOUT)
            break;
    pthread_mutex_unlock(&worker->mutex);
}

bool srv_worker_update_info(struct srv_worker *worker) {
    struct sp_renderer_info info;
    sp_renderer_info(worker->renderer, &info);
    /* Only this thread writes worker->info, so it reads it without the lock. */
    bool is_another = !worker->info.backend || strcmp(info.backend, worker->info.backend) != 0;
    if (!is_another && strcmp(info.fallback_reason, worker->info.fallback_reason) == 0)
        return false;
    pthread_mutex_lock(&worker->mutex);
    worker->info = info;
    pthread_mutex_unlock(&worker->mutex);
    return is_another;
}
