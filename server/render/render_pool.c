/* SPDX-License-Identifier: Apache-2.0 */
#include "render/render_pool.h"

#include <assert.h>
#include <stdlib.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "common/clock.h"
#include "render/render_pool_private.h"

static_assert((int)SRV_WORKERS == (int)SRV_RENDERERS, "each worker has one renderer");
#define IDLE_FRAMES_BYTES ((size_t)128 << 20)

static void on_dequeued(void *user, enum srv_worker_kind kind) {
    struct srv_render_pool *pool = user;
    srv_worker_wake(&pool->workers[kind]);
}

/* After the workers (srv_render_pool_rest). The frame cache stays while clients are connected. */
static void give_back_memory(struct srv_render_pool *pool) {
    if (!srv_schedule_has_clients(pool->schedule))
        srv_frame_cache_clear(&pool->cache);
    sp_frame_pool_trim(pool->frames);
    sp_frame_pool_trim(pool->snapshot_frames);
#ifdef __GLIBC__
    malloc_trim(0);
#endif
}

static void on_maintain(void *user) {
    struct srv_render_pool *pool = user;
    srv_video_encoders_tick(pool->videos, srv_clock_ms());
    if (atomic_load(&pool->is_at_rest))
        give_back_memory(pool);
}

void srv_render_pool_note_work(struct srv_render_pool *pool) {
    atomic_store(&pool->frame_ms, srv_clock_ms());
    atomic_store(&pool->is_at_rest, false);
}

void srv_render_pool_rest(struct srv_render_pool *pool, enum srv_worker_kind kind) {
    struct srv_worker *worker = &pool->workers[kind];
    if (!worker->has_frame_memory || srv_clock_ms() - worker->frame_ms < SRV_REST_MS)
        return;
    sp_renderer_trim(worker->renderer);
    worker->has_frame_memory = false;
}

/* True once per rest, when the workers have given back their memory. */
static bool begins_rest(struct srv_render_pool *pool) {
    const double workers_ms = 1500; /* they look at least once per second */
    const double idle_ms = srv_clock_ms() - atomic_load(&pool->frame_ms);
    return idle_ms >= SRV_REST_MS + workers_ms && !atomic_exchange(&pool->is_at_rest, true);
}

/* No client waits for the encodings of the frame cache. */
static void reclaim_blobs(void *user) {
    struct srv_render_pool *pool = user;
    srv_frame_cache_clear_bytes(&pool->cache);
}

static bool create_pools(struct srv_render_pool *pool, struct sp_error *err) {
    const struct srv_encode_pool_options encoders = { .threads = pool->options.encode_threads,
                                                      .user = pool,
                                                      .run = srv_encode_task_run,
                                                      .on_dequeued = on_dequeued,
                                                      .maintain = on_maintain };
    const struct srv_frame_memory *memory = &pool->options.frame_memory;
    const struct srv_blob_pool_options blobs = { .budget = memory->sessions,
                                                 .reclaim = reclaim_blobs,
                                                 .user = pool };
    if (!(pool->frames = sp_frame_pool_create(IDLE_FRAMES_BYTES, err)) ||
        !(pool->snapshot_frames = sp_frame_pool_create(IDLE_FRAMES_BYTES, err)) ||
        !(pool->blobs = srv_blob_pool_create(&blobs, err)) ||
        !(pool->videos = srv_video_encoders_create(pool->options.video_px, memory->sessions,
                                                   pool->blobs, pool->options.metrics, err)) ||
        !(pool->encoders = srv_encode_pool_create(&encoders, err)))
        return false;
    sp_frame_pool_set_budget(pool->frames, memory->sessions);
    sp_frame_pool_set_budget(pool->snapshot_frames, memory->snapshots);
    return true;
}

/* Frees the pool with what create_pools() made. */
static void free_parts(struct srv_render_pool *pool) {
    srv_frame_cache_finish(&pool->cache);
    srv_encode_pool_destroy(&pool->encoders);
    srv_video_encoders_destroy(&pool->videos);
    srv_blob_pool_destroy(&pool->blobs);
    sp_frame_pool_destroy(&pool->frames);
    sp_frame_pool_destroy(&pool->snapshot_frames);
    pthread_cond_destroy(&pool->resume);
    pthread_mutex_destroy(&pool->mutex);
    free(pool);
}

struct srv_render_pool *srv_render_pool_create(const struct srv_render_pool_options *options,
                                               struct sp_renderer **renderer,
                                               struct sp_error *err) {
    struct srv_render_pool *pool = calloc(1, sizeof *pool);
    if (!pool) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the render pool");
        return NULL;
    }
    pool->options = *options;
    pthread_mutex_init(&pool->mutex, NULL);
    pthread_cond_init(&pool->resume, NULL);
    srv_frame_cache_init(&pool->cache);
    if (!create_pools(pool, err)) {
        free_parts(pool);
        return NULL;
    }
    for (int k = 0; k < SRV_WORKERS; k++)
        srv_worker_init(&pool->workers[k], k == SRV_WORKER_INTERACTIVE ? *renderer : NULL);
    *renderer = NULL;
    const struct srv_snapshot_queue_options snapshots = {
        .catalog = options->catalog,
        .metrics = options->metrics,
        .worker = &pool->workers[SRV_WORKER_SNAPSHOT],
        .budget = options->frame_memory.snapshots,
        .waiting_max = options->queue_max,
        .unencoded_max = srv_encode_pool_background_threads(pool->encoders)
    };
    srv_snapshot_queue_init(&pool->snapshots, &snapshots);
    return pool;
}

bool srv_render_pool_start(struct srv_render_pool *pool, struct srv_schedule *schedule,
                           struct sp_error *err) {
    static void *(*const mains[SRV_WORKERS])(
        void *) = { [SRV_WORKER_INTERACTIVE] = srv_interactive_worker_main,
                    [SRV_WORKER_SNAPSHOT] = srv_snapshot_worker_main,
                    [SRV_WORKER_PREEMPTION] = srv_preemption_worker_main };
    const struct sp_renderer_info *info = &pool->workers[SRV_WORKER_INTERACTIVE].info;
    pool->schedule = schedule;
    srv_hub_set_backend(srv_schedule_hub(schedule), info->backend, info->device);
    if (!srv_encode_pool_start(pool->encoders, err))
        return false;
    for (int k = 0; k < SRV_WORKERS; k++)
        if (!srv_worker_start(&pool->workers[k], mains[k], pool, err))
            return false;
    return true;
}

void srv_render_pool_stop(struct srv_render_pool *pool) {
    /* First the workers, so that none of them begins another frame after its own is cancelled. */
    for (int k = 0; k < SRV_WORKERS; k++)
        srv_worker_stop(&pool->workers[k]);
    srv_snapshot_queue_stop(&pool->snapshots);
    pthread_mutex_lock(&pool->mutex);
    pool->stop = true;
    for (int k = 0; k < SRV_WORKERS; k++)
        srv_frame_queue_cancel(&pool->in_flight[k]);
    pthread_cond_broadcast(&pool->resume);
    pthread_mutex_unlock(&pool->mutex);
    for (int k = 0; k < SRV_WORKERS; k++)
        srv_worker_join(&pool->workers[k]);
    srv_snapshot_queue_drop_waiting(&pool->snapshots);
    srv_encode_pool_stop(pool->encoders);
}

void srv_render_pool_destroy(struct srv_render_pool **pool_pointer) {
    struct srv_render_pool *pool = *pool_pointer;
    *pool_pointer = NULL;
    if (!pool)
        return;
    srv_render_pool_stop(pool);
    srv_snapshot_queue_finish(&pool->snapshots);
    for (int k = 0; k < SRV_WORKERS; k++)
        srv_worker_finish(&pool->workers[k]);
    free_parts(pool);
}

struct sp_frame *srv_render_pool_find(struct srv_render_pool *pool, const struct srv_volume *volume,
                                      const struct sp_view *view, bool wants_depth) {
    const struct srv_fingerprint content =
        srv_catalog_fingerprint(pool->options.catalog, volume, view);
    return srv_frame_cache_find(&pool->cache, &content, view, wants_depth);
}

void srv_render_pool_note_frame(struct srv_render_pool *pool, enum srv_worker_kind kind,
                                struct srv_volume *volume) {
    struct srv_worker *worker = &pool->workers[kind];
    worker->has_frame_memory = true;
    worker->frame_ms = srv_clock_ms();
    srv_render_pool_note_work(pool);
    srv_catalog_set_cached(pool->options.catalog, volume, kind,
                           sp_renderer_memory(worker->renderer, srv_volume_voxels(volume)));
    if (srv_worker_update_info(worker) && kind == SRV_WORKER_INTERACTIVE)
        srv_hub_set_backend(srv_schedule_hub(pool->schedule), worker->info.backend,
                            worker->info.device);
}

struct srv_snapshot_queue *srv_render_pool_snapshots(struct srv_render_pool *pool) {
    return &pool->snapshots;
}

void srv_render_pool_tick(struct srv_render_pool *pool) {
    srv_snapshot_queue_tick(&pool->snapshots);
    pthread_mutex_lock(&pool->mutex);
    for (int k = 0; k < SRV_WORKERS; k++)
        srv_frame_queue_tick(&pool->in_flight[k], srv_clock_ms());
    pthread_cond_broadcast(&pool->resume);
    pthread_mutex_unlock(&pool->mutex);
    /* Destroying an encoder joins its threads, which takes time: an encode thread does it. */
    const bool rests = begins_rest(pool);
    if (rests || srv_video_encoders_are_idle(pool->videos, srv_clock_ms()))
        srv_encode_pool_request_maintenance(pool->encoders);
}

void srv_render_pool_info(struct srv_render_pool *pool,
                          struct sp_renderer_info info[SRV_RENDERERS]) {
    for (int k = 0; k < SRV_WORKERS; k++)
        srv_worker_info(&pool->workers[k], &info[k]);
}

void srv_render_pool_wake(void *user) {
    struct srv_render_pool *pool = user;
    pthread_mutex_lock(&pool->mutex);
    bool is_rendering = pool->in_flight[SRV_WORKER_INTERACTIVE].count > 0;
    pthread_mutex_unlock(&pool->mutex);
    srv_worker_wake(&pool->workers[SRV_WORKER_INTERACTIVE]);
    if (is_rendering)
        srv_worker_wake(&pool->workers[SRV_WORKER_PREEMPTION]);
}

void srv_render_pool_step_loaded(void *user) {
    struct srv_render_pool *pool = user;
    srv_worker_wake(&pool->workers[SRV_WORKER_SNAPSHOT]);
}

void srv_render_pool_interrupt(void *user, uint64_t of, enum srv_interrupt why) {
    struct srv_render_pool *pool = user;
    pthread_mutex_lock(&pool->mutex);
    for (int k = 0; k < SRV_WORKERS; k++)
        srv_frame_queue_interrupt(&pool->in_flight[k], of, why, srv_clock_ms());
    pthread_cond_broadcast(&pool->resume);
    pthread_mutex_unlock(&pool->mutex);
}

void srv_render_pool_evict(void *user, struct sp_volume *volume) {
    struct srv_render_pool *pool = user;
    for (int k = 0; k < SRV_WORKERS; k++)
        srv_worker_evict(&pool->workers[k], volume);
    sp_volume_unref(&volume);
}

bool srv_render_pool_supports(void *user, const struct sp_view *view, struct sp_error *err) {
    struct srv_render_pool *pool = user;
    return sp_renderer_supports(pool->workers[SRV_WORKER_INTERACTIVE].renderer, view, err);
}
