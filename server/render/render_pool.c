/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "render/render_pool_private.h"
#include "sp/log.h"

static_assert((int)SRV_WORKERS == (int)SRV_RENDERERS, "a renderer a lane");
#define POOL_IDLE_BYTES ((size_t)128 << 20)

struct srv_render_pool *srv_render_pool_create(const struct srv_render_pool_options *options,
                                               struct sp_renderer **renderer,
                                               struct sp_error *err) {
    struct srv_render_pool *s = calloc(1, sizeof *s);
    if (!s) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "no memory for the scheduler");
        return NULL;
    }
    assert(options->encode_threads >= 1 && options->encode_threads <= SRV_ENCODE_THREADS_MAX);
    s->options = *options;
    pthread_mutex_init(&s->mutex, NULL);
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    for (int l = 0; l < SRV_WORKERS; l++)
        pthread_cond_init(&s->lanes[l].wake, &monotonic);
    pthread_cond_init(&s->encode, NULL);
    pthread_cond_init(&s->made, NULL);
    pthread_cond_init(&s->go_on, NULL);
    pthread_condattr_destroy(&monotonic);
    bool ok =
        (s->pool = sp_frame_pool_create(POOL_IDLE_BYTES, err)) != NULL &&
        (s->videos = srv_video_encoders_create(options->video_px, options->metrics, err)) != NULL &&
        srv_encode_create(s, err);
    if (!ok) {
        srv_render_pool_destroy(&s);
        return NULL;
    }
    s->lanes[SRV_WORKER_INTERACTIVE].renderer = *renderer;
    sp_renderer_info(*renderer, &s->lanes[SRV_WORKER_INTERACTIVE].info);
    *renderer = NULL;
    return s;
}
/* With the mutex held. */
void srv_worker_wake(struct srv_worker *lane) {
    lane->generation++;
    pthread_cond_signal(&lane->wake);
}

/* What the lanes have in common. */

/* After anything that may have changed the renderer's backend. */
static void note_backend(struct srv_render_pool *s, enum srv_worker_name name) {
    struct srv_worker *lane = &s->lanes[name];
    struct sp_renderer_info info;
    sp_renderer_info(lane->renderer, &info);
    bool is_another = !lane->info.backend || strcmp(info.backend, lane->info.backend) != 0;
    if (!is_another && strcmp(info.fallback_reason, lane->info.fallback_reason) == 0)
        return;
    pthread_mutex_lock(&s->mutex);
    lane->info = info;
    pthread_mutex_unlock(&s->mutex);
    if (is_another && name == SRV_WORKER_INTERACTIVE)
        srv_hub_set_backend(s->hub, info.backend, info.device);
}

/* After a frame of the volume was drawn, or not. */
void srv_worker_note_frame(struct srv_render_pool *s, enum srv_worker_name name,
                           struct srv_volume *volume) {
    struct srv_worker *lane = &s->lanes[name];
    srv_catalog_set_cached(s->options.catalog, volume, name,
                           sp_renderer_memory(lane->renderer, srv_volume_voxels(volume)));
    note_backend(s, name);
}

void srv_worker_evict(struct srv_worker *lane, struct srv_evict_item *list) {
    while (list) {
        struct srv_evict_item *next = list->next;
        if (lane->renderer)
            sp_renderer_evict(lane->renderer, list->volume);
        sp_volume_unref(&list->volume);
        free(list);
        list = next;
    }
}

struct srv_worker_round srv_worker_look(struct srv_render_pool *s, enum srv_worker_name name) {
    struct srv_worker *lane = &s->lanes[name];
    pthread_mutex_lock(&s->mutex);
    struct srv_worker_round turn = { .generation = lane->generation,
                                     .stop = s->stop,
                                     .room = lane->encodes < SRV_WORKER_ENCODES,
                                     .forget = lane->forget };
    lane->forget = NULL;
    pthread_mutex_unlock(&s->mutex);
    return turn;
}

void srv_worker_wait(struct srv_render_pool *s, struct srv_worker *lane, uint64_t generation,
                     double wait_ms) {
    struct timespec until = srv_clock_at(srv_clock_ms() + wait_ms + 1e-6);
    pthread_mutex_lock(&s->mutex);
    while (lane->generation == generation && !s->stop)
        if (pthread_cond_timedwait(&lane->wake, &s->mutex, &until) == ETIMEDOUT)
            break;
    pthread_mutex_unlock(&s->mutex);
}

/* Start, stop, and what other threads call. */

bool srv_render_pool_start(struct srv_render_pool *s, struct srv_hub *hub, struct sp_error *err) {
    s->hub = hub;
    srv_hub_set_backend(hub, s->lanes[SRV_WORKER_INTERACTIVE].info.backend,
                        s->lanes[SRV_WORKER_INTERACTIVE].info.device);
    if (!srv_encode_start(s, err))
        return false;
    static void *(*const mains[SRV_WORKERS])(void *) = { srv_interactive_worker_main,
                                                         srv_snapshot_worker_main,
                                                         srv_preemption_worker_main };
    for (int l = 0; l < SRV_WORKERS; l++) {
        int failed = pthread_create(&s->lanes[l].thread, NULL, mains[l], s);
        if (failed)
            return sp_fail(err, SP_ERR_IO, NULL, "cannot start a render thread: %s",
                           strerror(failed));
        s->lanes[l].running = true;
    }
    return true;
}

void srv_render_pool_stop(struct srv_render_pool *s) {
    pthread_mutex_lock(&s->mutex);
    s->stop = true;
    srv_snapshots_cancel(s);
    for (int l = 0; l < SRV_WORKERS; l++) {
        srv_frame_queue_cancel(&s->lanes[l].flights);
        srv_worker_wake(&s->lanes[l]);
    }
    pthread_cond_broadcast(&s->go_on);
    pthread_mutex_unlock(&s->mutex);
    for (int l = 0; l < SRV_WORKERS; l++) {
        if (s->lanes[l].running)
            pthread_join(s->lanes[l].thread, NULL);
        s->lanes[l].running = false;
    }
    srv_snapshots_drop(s);
    srv_encode_stop(s);
}

void srv_render_pool_destroy(struct srv_render_pool **render_pool) {
    struct srv_render_pool *s = *render_pool;
    *render_pool = NULL;
    if (!s)
        return;
    srv_render_pool_stop(s);
    srv_frame_cache_set(s, NULL, NULL, NULL);
    for (int l = 0; l < SRV_WORKERS; l++) {
        srv_worker_evict(&s->lanes[l], s->lanes[l].forget);
        sp_renderer_destroy(&s->lanes[l].renderer);
        pthread_cond_destroy(&s->lanes[l].wake);
    }
    srv_encode_destroy(s);
    srv_video_encoders_destroy(&s->videos);
    sp_frame_pool_destroy(&s->pool);
    pthread_cond_destroy(&s->made);
    pthread_cond_destroy(&s->encode);
    pthread_cond_destroy(&s->go_on);
    pthread_mutex_destroy(&s->mutex);
    free(s);
}

void srv_render_pool_tick(struct srv_render_pool *s) {
    srv_snapshots_tick(s);
    bool idle = srv_video_encoders_are_idle(s->videos, srv_clock_ms());
    pthread_mutex_lock(&s->mutex);
    for (int l = 0; l < SRV_WORKERS; l++)
        srv_frame_queue_tick(&s->lanes[l].flights, srv_clock_ms());
    pthread_cond_broadcast(&s->go_on);
    s->videos_due = idle;
    if (idle)
        pthread_cond_broadcast(&s->encode);
    pthread_mutex_unlock(&s->mutex);
}

void srv_render_pool_info(struct srv_render_pool *s, struct sp_renderer_info info[SRV_RENDERERS]) {
    pthread_mutex_lock(&s->mutex);
    for (int l = 0; l < SRV_WORKERS; l++)
        info[l] = s->lanes[l].info;
    pthread_mutex_unlock(&s->mutex);
}

unsigned srv_render_pool_unanswered(struct srv_render_pool *s) {
    pthread_mutex_lock(&s->mutex);
    unsigned waiting = s->still_unanswered;
    pthread_mutex_unlock(&s->mutex);
    return waiting;
}

void srv_render_pool_wake(void *user) {
    struct srv_render_pool *s = user;
    pthread_mutex_lock(&s->mutex);
    srv_worker_wake(&s->lanes[SRV_WORKER_INTERACTIVE]);
    if (s->lanes[SRV_WORKER_INTERACTIVE].flights.count > 0)
        srv_worker_wake(&s->lanes[SRV_WORKER_PREEMPTION]);
    pthread_mutex_unlock(&s->mutex);
}

void srv_render_pool_interrupt(void *user, uint64_t of, enum srv_interrupt why) {
    struct srv_render_pool *s = user;
    pthread_mutex_lock(&s->mutex);
    for (int l = 0; l < SRV_WORKERS; l++)
        srv_frame_queue_interrupt(&s->lanes[l].flights, of, why, srv_clock_ms());
    pthread_cond_broadcast(&s->go_on);
    pthread_mutex_unlock(&s->mutex);
}

void srv_render_pool_evict(void *user, struct sp_volume *volume) {
    struct srv_render_pool *s = user;
    for (int l = 0; l < SRV_WORKERS; l++) {
        struct srv_evict_item *item = malloc(sizeof *item);
        if (!item) { /* what was derived stays until the end */
            sp_log(SP_LOG_ERROR, "no memory to tell a renderer that a volume is gone");
            continue;
        }
        item->volume = sp_volume_ref(volume);
        pthread_mutex_lock(&s->mutex);
        item->next = s->lanes[l].forget;
        s->lanes[l].forget = item;
        srv_worker_wake(&s->lanes[l]);
        pthread_mutex_unlock(&s->mutex);
    }
    sp_volume_unref(&volume);
}

bool srv_render_pool_supports(void *user, const struct sp_view *view, struct sp_error *err) {
    struct srv_render_pool *s = user;
    return sp_renderer_supports(s->lanes[SRV_WORKER_INTERACTIVE].renderer, view, err);
}
