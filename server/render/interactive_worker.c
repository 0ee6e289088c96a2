/* SPDX-License-Identifier: Apache-2.0
 *
 * The interactive worker: renders the frames of sessions, in the order that schedule/ decides. It
 * keeps as many frames in flight as its renderer takes (sp_renderer_depth()): begin, begin, finish,
 * begin, finish, … It never waits for a second frame: without another job it finishes the oldest.
 */
#include <stdlib.h>

#include "common/clock.h"
#include "render/render_pool_private.h"
#include "sp/inflight.h"
#include "sp/log.h"

static void finish_all(struct srv_render_pool *pool) {
    while (pool->in_flight[SRV_WORKER_INTERACTIVE].count > 0)
        srv_session_frame_finish(pool, SRV_WORKER_INTERACTIVE);
}

/* Begins the job, unless its frame is cached or about to be. */
static void begin_job(struct srv_render_pool *pool, struct srv_render_job *job) {
    if (srv_frame_queue_has_sharp(&pool->in_flight[SRV_WORKER_INTERACTIVE], job))
        finish_all(pool);
    struct sp_frame *frame = job->is_sharp ? srv_render_pool_find(pool, job->volume, &job->view,
                                                                  srv_render_job_wants_depth(job))
                                           : NULL;
    if (!frame) {
        srv_session_frame_begin(pool, SRV_WORKER_INTERACTIVE, job);
        return;
    }
    struct sp_error err = { .code = SP_OK };
    if (!srv_session_frame_reserve(pool, job, &err)) {
        sp_frame_unref(&frame);
        srv_session_frame_fail(pool, job, &err, 0);
        return;
    }
    srv_encode_pool_submit(
        pool->encoders,
        &(struct srv_encode_task){
            .frame = frame, .job = job, .worker = SRV_WORKER_INTERACTIVE, .is_cached = true });
}

void *srv_interactive_worker_main(void *user) {
    struct srv_render_pool *pool = user;
    struct srv_worker *worker = &pool->workers[SRV_WORKER_INTERACTIVE];
    const struct srv_frame_queue *queue = &pool->in_flight[SRV_WORKER_INTERACTIVE];
    struct srv_render_job *job = NULL;
    for (;;) {
        struct srv_worker_round round = srv_worker_begin_round(worker);
        if (round.has_evicted)
            srv_frame_cache_clear(&pool->cache);
        if (round.stop)
            break;
        double wait_ms = 1000;
        if (!job && !(job = malloc(sizeof *job)))
            sp_log(SP_LOG_ERROR, "out of memory for a render job");
        bool has_capacity = srv_encode_pool_has_capacity(pool->encoders, SRV_WORKER_INTERACTIVE);
        bool may_begin = job && has_capacity && queue->count < sp_renderer_depth(worker->renderer);
        if (may_begin && srv_schedule_next(pool->schedule, srv_clock_ms(), job, &wait_ms)) {
            begin_job(pool, job);
            job = NULL;
        } else if (queue->count > 0) {
            srv_session_frame_finish(pool, SRV_WORKER_INTERACTIVE);
        } else {
            srv_render_pool_rest(pool, SRV_WORKER_INTERACTIVE);
            srv_worker_wait(worker, round.generation, has_capacity ? wait_ms : 1000);
        }
    }
    finish_all(pool);
    free(job);
    return NULL;
}
