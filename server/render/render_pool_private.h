/* SPDX-License-Identifier: Apache-2.0
 *
 * State that the workers and the encode threads share.
 *
 * Locks: the hub's is taken before any lock of the pool; `mutex` and the locks of the parts
 * (workers, snapshots, cache, encoders) are never held together, except that the snapshot queue and
 * the encode pool wake workers.
 */
#ifndef SRV_RENDER_RENDER_POOL_PRIVATE_H
#define SRV_RENDER_RENDER_POOL_PRIVATE_H

#include <pthread.h>
#include <stdatomic.h>

#include "render/encode_pool.h"
#include "render/frame_cache.h"
#include "render/frame_depth.h"
#include "render/frame_queue.h"
#include "render/render_pool.h"
#include "render/snapshot_queue.h"
#include "render/video.h"
#include "render/worker.h"

struct srv_render_pool {
    struct srv_render_pool_options options;
    struct srv_schedule *schedule;
    struct srv_worker workers[SRV_WORKERS];
    struct srv_snapshot_queue snapshots;
    struct srv_frame_cache cache;
    struct srv_encode_pool *encoders;
    struct srv_video_encoders *videos;
    struct sp_frame_pool *frames, *snapshot_frames; /* of sessions; of the snapshot worker */
    struct srv_blob_pool *blobs;                    /* encoded frames of sessions */
    _Atomic double frame_ms; /* when a frame was last drawn or encoded; SRV_REST_MS later the pool
                                is at rest */
    atomic_bool is_at_rest;  /* the memory of frames was released since the last frame */
    pthread_mutex_t mutex;   /* guards what follows */
    pthread_cond_t resume;   /* a paused frame may resume, or is cancelled */
    struct srv_frame_queue
        in_flight[SRV_WORKERS]; /* session frames; the snapshot worker has none */
    bool stop;
    bool has_no_preemption; /* the preemption worker's renderer failed: long frames are no longer
                               paused */
    uint64_t not_preempted; /* order of a long frame that leaves other frames too little memory */
};

/* The workers' threads; `user` is the pool. */
void *srv_interactive_worker_main(void *user);
void *srv_preemption_worker_main(void *user);
void *srv_snapshot_worker_main(void *user);

/* Returns the cached frame of this view: a reference that the caller owns. NULL = the cache has no
 * frame of this view, or none with the depth that is wanted. */
struct sp_frame *srv_render_pool_find(struct srv_render_pool *pool, const struct srv_volume *volume,
                                      const struct sp_view *view, bool wants_depth);

/* Call it when the worker's renderer has rendered a frame of the volume, or failed. Updates the
 * catalog and the hub. On the worker's thread. */
void srv_render_pool_note_frame(struct srv_render_pool *pool, enum srv_worker_kind kind,
                                struct srv_volume *volume);

/* Memory (render_pool.c). */

/* Call it while a frame is drawn or encoded. Any thread. */
void srv_render_pool_note_work(struct srv_render_pool *pool);
/* Frees the memory of the worker's renderer if the worker has been idle for SRV_REST_MS. No frame
 * is begun. The worker's thread. */
void srv_render_pool_rest(struct srv_render_pool *pool, enum srv_worker_kind kind);

/* Session frames (session_frame.c); the worker's thread. */

/* Acquires the memory of the encoders for the images of a job; SP_ERR_FRAME_BUDGET. */
bool srv_session_frame_reserve(struct srv_render_pool *pool, struct srv_render_job *job,
                               struct sp_error *err);
/* Releases this memory and frees the job. Any thread. */
void srv_session_frame_free(struct srv_render_pool *pool, struct srv_render_job *job);

/* Begins to render the job, or tells the hub that it failed. Takes it over. */
void srv_session_frame_begin(struct srv_render_pool *pool, enum srv_worker_kind kind,
                             struct srv_render_job *job);
/* Waits for the oldest frame that was begun and passes it to the encode threads. */
void srv_session_frame_finish(struct srv_render_pool *pool, enum srv_worker_kind kind);
/* Tells the hub that a job failed or was cancelled, and frees it. elapsed_ms: how long it was
 * rendered before it was cancelled. Any thread. */
void srv_session_frame_fail(struct srv_render_pool *pool, struct srv_render_job *job,
                            const struct sp_error *err, double elapsed_ms);

/* Stops preemption: from now on the interactive worker renders all session frames. */
void srv_preemption_disable(struct srv_render_pool *pool, const struct sp_error *why);

/* Encodes and delivers (encode_task.c); srv_encode_pool_options.run. */
void srv_encode_task_run(void *user, struct sp_encoder *encoder,
                         const struct srv_encode_task *task);

#endif
