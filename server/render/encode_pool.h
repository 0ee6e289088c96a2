/* SPDX-License-Identifier: Apache-2.0
 *
 * The encode threads: a bounded queue of rendered frames, and threads that turn them into bytes.
 *
 *   workers ──► queue ──┬─► N threads             frames that are quick to encode
 *                       └─► N-1 background threads (at least one): snapshots, and session frames
 *                           that are slow to encode (SRV_SLOW_ENCODE_MS)
 *
 * An encoder cannot be interrupted. Therefore slow work has threads of its own: no quick frame
 * waits behind it. The exception is a daemon with a single participant, which delays no other one.
 * While the frames of several sessions wait, each session has at most one thread.
 *
 * A thread with nothing to do helps another thread with the stripes of a large JPEG, which is ready
 * sooner. Background threads help only background threads: a stripe that a quick frame waits for
 * must not run at a low priority. Of several foreground threads the first never helps with a
 * snapshot, so that one is always free for the frames of sessions.
 */
#ifndef SRV_RENDER_ENCODE_POOL_H
#define SRV_RENDER_ENCODE_POOL_H

#include "render/worker.h"
#include "schedule/schedule.h"

struct srv_encode_pool;
struct srv_snapshot_entry;

enum { SRV_ENCODE_THREADS_MAX = 8 }; /* foreground threads */

/* A rendered frame to encode: for the participants of a session (job) or for a snapshot. */
struct srv_encode_task {
    struct sp_frame *frame;     /* a reference */
    struct srv_render_job *job; /* owned; NULL = for a snapshot */
    struct srv_snapshot_entry *snapshot;
    enum srv_worker_kind worker; /* the worker that submitted the task */
    bool is_cached;              /* the frame was not rendered for this task */
};

struct srv_encode_pool_options {
    unsigned threads; /* foreground threads, [1, SRV_ENCODE_THREADS_MAX] */
    void *user;
    /* Encodes and delivers; takes over job and snapshot. The pool releases the frame. Called on an
     * encode thread, without a lock. */
    void (*run)(void *user, struct sp_encoder *encoder, const struct srv_encode_task *task);
    /* Called when a task of this worker has left the queue. Called with the pool's lock held: it
     * must not call the pool. */
    void (*on_dequeued)(void *user, enum srv_worker_kind worker);
    /* Does the housekeeping that srv_encode_pool_request_maintenance() requests. Called on an idle
     * encode thread, without a lock. */
    void (*maintain)(void *user);
};

/* NULL with *err set. Threads start with srv_encode_pool_start(). */
struct srv_encode_pool *srv_encode_pool_create(const struct srv_encode_pool_options *options,
                                               struct sp_error *err);
bool srv_encode_pool_start(struct srv_encode_pool *pool, struct sp_error *err);
/* After the last submit: encodes what waits, then ends the threads. */
void srv_encode_pool_stop(struct srv_encode_pool *pool);
void srv_encode_pool_destroy(struct srv_encode_pool **pool); /* stopped; accepts NULL */

/* Takes over the task. Call it only while srv_encode_pool_has_capacity() is true. */
void srv_encode_pool_submit(struct srv_encode_pool *pool, const struct srv_encode_task *task);
/* False while so many frames of this worker wait that it must not begin another frame. Session
 * frames that are slow to encode do not count, because SRV_SLOW_ENCODE_JOBS limits them. */
bool srv_encode_pool_has_capacity(struct srv_encode_pool *pool, enum srv_worker_kind worker);
unsigned srv_encode_pool_background_threads(const struct srv_encode_pool *pool);
void srv_encode_pool_request_maintenance(struct srv_encode_pool *pool);

#endif
