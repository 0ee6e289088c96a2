/* SPDX-License-Identifier: Apache-2.0
 *
 * A worker: one render thread with a renderer of its own. Three workers share nothing but the
 * processor, so that no kind of work stops another:
 *
 *   interactive  renders the frames of sessions
 *   preemption   renders short frames of sessions while the interactive worker's frame is paused
 *   snapshot     renders single images, in the background (at a low thread priority)
 *
 * A worker sleeps while it has nothing to do. Every event that it may wait for raises its
 * generation:
 *
 *   for (;;) {
 *       round = srv_worker_begin_round(worker);   reads the generation, evicts unloaded volumes
 *       if (!work found)
 *           srv_worker_wait(worker, round.generation, wait_ms);   returns at once if it has risen
 *   }
 *
 * So a wake-up between the search for work and the wait is never lost.
 */
#ifndef SRV_RENDER_WORKER_H
#define SRV_RENDER_WORKER_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "sp/renderer.h"

/* The order of srv_render_pool_info() and of srv_volume_status.cached_per_renderer. */
enum srv_worker_kind {
    SRV_WORKER_INTERACTIVE,
    SRV_WORKER_SNAPSHOT,
    SRV_WORKER_PREEMPTION,
    SRV_WORKERS
};

struct srv_eviction;

struct srv_worker {
    struct sp_renderer *renderer; /* NULL = not created yet; for the worker's thread */
    pthread_t thread;
    bool has_frame_memory; /* the renderer may keep memory of frames; for the worker's thread */
    double frame_ms;       /* when its last frame ended; for the worker's thread */
    bool is_running;       /* there is a thread to join; for the thread that starts and stops it */
    pthread_mutex_t mutex; /* guards what follows; no other lock is taken while it is held */
    pthread_cond_t changed;
    uint64_t generation; /* rises with every event that the thread may wait for */
    bool stop;
    struct srv_eviction *evictions; /* volumes whose cached data is to be dropped */
    struct sp_renderer_info info;   /* of the renderer; backend NULL = not created yet */
};

/* Takes over the renderer, which may be NULL. */
void srv_worker_init(struct srv_worker *worker, struct sp_renderer *renderer);
/* After srv_worker_join(). */
void srv_worker_finish(struct srv_worker *worker);

bool srv_worker_start(struct srv_worker *worker, void *(*main)(void *user), void *user,
                      struct sp_error *err);
void srv_worker_stop(struct srv_worker *worker); /* asks the thread to end; does not wait */
void srv_worker_join(struct srv_worker *worker); /* does nothing if it was not started */

/* Any thread. */
void srv_worker_wake(struct srv_worker *worker);
/* Makes the worker's renderer drop its cached data of the volume. Takes a reference of its own. If
 * memory runs out, the function logs that, and the data stays cached until the daemon ends. */
void srv_worker_evict(struct srv_worker *worker, struct sp_volume *volume);
void srv_worker_info(struct srv_worker *worker, struct sp_renderer_info *info);

/* The worker's thread. */

struct srv_worker_round {
    uint64_t generation;
    bool stop;
    bool has_evicted; /* a volume was unloaded since the last round */
};
struct srv_worker_round srv_worker_begin_round(struct srv_worker *worker);
/* Returns when the generation has risen, at the latest after wait_ms. */
void srv_worker_wait(struct srv_worker *worker, uint64_t generation, double wait_ms);
/* Call it after each frame: the renderer may have replaced its backend. True if the backend is
 * another one than before. */
bool srv_worker_update_info(struct srv_worker *worker);

#endif
