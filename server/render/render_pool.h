/* SPDX-License-Identifier: Apache-2.0
 *
 * The render pool: the threads that render and encode what schedule/ decides.
 *
 *   sessions ──► interactive worker ──┐
 *        └─────► preemption worker ───┼─► encode threads ─► outboxes, or done() of a snapshot
 *   snapshots ─► snapshot worker ─────┘
 *
 * Each worker is a thread with a renderer of its own (worker.h). README.md describes
 * how a frame passes through them. Where to read on:
 *
 *   interactive_worker.c  the frames of sessions; session_frame.c begins and finishes one
 *   frame_queue.h         in-flight frames, and which of them may be cancelled
 *   preemption_worker.c   short frames while a long one is paused
 *   snapshot_queue.h      images requested over HTTP, and frames of camera paths
 *   encode_pool.h         the encode threads; encode_task.c encodes and delivers
 *   frame_cache.h         the last final frame, for all requests of the same image
 *
 * When a backend fails, its renderer continues with the next one (sp/renderer.h), and the pool
 * tells the hub, which tells the clients.
 */
#ifndef SRV_RENDER_RENDER_POOL_H
#define SRV_RENDER_RENDER_POOL_H

#include "render/catalog.h"
#include "render/frame_memory.h"
#include "render/snapshot_queue.h"
#include "schedule/schedule.h"
#include "sp/renderer.h"

struct srv_render_pool;

struct srv_render_pool_options {
    struct srv_catalog *catalog;
    struct srv_metrics *metrics; /* NULL = nothing is counted */
    unsigned queue_max;      /* waiting snapshots, per class; in the foreground an owner may have
                                three quarters of them */
    unsigned encode_threads; /* [1, SRV_ENCODE_THREADS_MAX]; background threads come on top */
    /* limit of the frame sizes of all video encoders together, px; 0 = no video */
    uint64_t video_px;
    struct srv_frame_memory frame_memory; /* lives as long as the pool and its frames */
    /* Options of the snapshot worker's renderer, without frame_budget. The renderer of the
     * preemption worker gets half of this memory. Strings live as long as the pool. */
    struct sp_renderer_options renderer;
};

/* Takes over *renderer, for the interactive worker, on success. NULL with *err set. */
struct srv_render_pool *srv_render_pool_create(const struct srv_render_pool_options *options,
                                               struct sp_renderer **renderer, struct sp_error *err);
/* Starts the threads, which serve this scheduler. */
bool srv_render_pool_start(struct srv_render_pool *pool, struct srv_schedule *schedule,
                           struct sp_error *err);
/* Cancels all frames in progress; waiting snapshots are answered with SP_ERR_CANCELLED. */
void srv_render_pool_stop(struct srv_render_pool *pool);
void srv_render_pool_destroy(struct srv_render_pool **pool); /* stops first; accepts NULL */

/* Returns the queue to which snapshots are submitted. Any thread. */
struct srv_snapshot_queue *srv_render_pool_snapshots(struct srv_render_pool *pool);
/* Call it about ten times per second. Drops snapshots whose clients have left, and cancels moving
 * frames that are over their budget while a newer view waits. */
void srv_render_pool_tick(struct srv_render_pool *pool);
/* Describes the renderers, by enum srv_worker_kind. backend NULL = not created yet: the renderers
 * of the snapshot and preemption workers are created for their first frame. Any thread. */
void srv_render_pool_info(struct srv_render_pool *pool,
                          struct sp_renderer_info info[SRV_RENDERERS]);

/* For srv_hub_options and srv_catalog_options; `user` is the pool. */
void srv_render_pool_wake(void *user);
void srv_render_pool_step_loaded(void *user); /* snapshots may wait for it */
void srv_render_pool_interrupt(void *user, uint64_t of, enum srv_interrupt why);
void srv_render_pool_evict(void *user, struct sp_volume *volume); /* takes over the reference */
bool srv_render_pool_supports(void *user, const struct sp_view *view, struct sp_error *err);

#endif
