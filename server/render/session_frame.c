/* SPDX-License-Identifier: Apache-2.0
 *
 * One frame of a session: begin, pause and resume, finish. The interactive and the preemption
 * worker share this.
 */
#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "common/clock.h"
#include "render/render_pool_private.h"
#include "sp/inflight.h"
#include "sp/log.h"

bool srv_session_frame_reserve(struct srv_render_pool *pool, struct srv_render_job *job,
                               struct sp_error *err) {
    struct sp_budget *budget = pool->options.frame_memory.sessions;
    uint64_t most = 0;
    for (uint32_t i = 0; i < job->target_count; i++) {
        const uint64_t own = sp_encode_bytes(job->targets[i].format, job->view.size);
        most = own > most ? own : most; /* one after the other */
    }
    if (srv_render_job_wants_depth(job))
        most += srv_frame_depth_bytes(job->view.size);
    if (!sp_budget_acquire(budget, SP_BUDGET_ENCODERS, most))
        return sp_budget_fail(budget, "encoder", most, err);
    job->encoder_bytes = most;
    return true;
}

void srv_session_frame_free(struct srv_render_pool *pool, struct srv_render_job *job) {
    sp_budget_release(pool->options.frame_memory.sessions, SP_BUDGET_ENCODERS, job->encoder_bytes);
    srv_frame_depth_finish(&job->depth);
    free(job);
}

void srv_session_frame_fail(struct srv_render_pool *pool, struct srv_render_job *job,
                            const struct sp_error *err, double elapsed_ms) {
    if (err->code == SP_ERR_CANCELLED) {
        sp_log(SP_LOG_DEBUG, "%s cancelled after %.1f ms: %s",
               job->is_refinement ? "refinement" : "moving frame", elapsed_ms, err->text);
        srv_schedule_cancelled(pool->schedule, job, elapsed_ms);
    } else if (err->code == SP_ERR_FRAME_BUDGET &&
               srv_schedule_shrink(pool->schedule, job,
                                   job->too_large ? job->too_large : UINT64_MAX, srv_clock_ms())) {
        sp_log(SP_LOG_INFO, "a client's frames are drawn smaller for a while: %s", err->text);
        srv_schedule_cancelled(pool->schedule, job, elapsed_ms);
    } else {
        sp_log(SP_LOG_ERROR, "rendering a session's view failed: %s%s%s", err->place,
               err->place[0] ? ": " : "", err->text);
        srv_schedule_failed(pool->schedule, job, err);
    }
    srv_session_frame_free(pool, job);
}

/* The long frame that is paused leaves too little memory: it is finished first. */
static void finish_long_frame(struct srv_render_pool *pool) {
    pthread_mutex_lock(&pool->mutex);
    const struct srv_inflight *frame =
        srv_frame_queue_oldest(&pool->in_flight[SRV_WORKER_INTERACTIVE]);
    if (frame)
        pool->not_preempted = frame->job->order;
    pthread_mutex_unlock(&pool->mutex);
}

/* A frame that the preemption worker fails to render is left to the interactive worker, and so are
 * all later ones; if memory is scarce, those until the long frame is finished. */
static void fail(struct srv_render_pool *pool, enum srv_worker_kind kind,
                 struct srv_render_job *job, struct sp_error *err, double spent_ms) {
    if (kind == SRV_WORKER_PREEMPTION && err->code != SP_ERR_CANCELLED) {
        if (err->code == SP_ERR_FRAME_BUDGET)
            finish_long_frame(pool);
        else
            srv_preemption_disable(pool, err);
        sp_fail(err, SP_ERR_CANCELLED, NULL, "the interactive worker renders it");
    }
    srv_session_frame_fail(pool, job, err, spent_ms);
}

/* sp_pause.wait: a thread of the renderer stops here until the frame is resumed or cancelled.
 * After a cancellation the threads run on until they see the cancel flag. */
static void wait_while_paused(void *user) {
    struct srv_inflight *frame = user;
    struct srv_render_pool *pool = frame->owner;
    pthread_mutex_lock(&pool->mutex);
    if (atomic_load(&frame->pause.requested)) {
        double shared_ms = srv_inflight_paused(frame, srv_clock_ms());
        struct srv_inflight *shorter =
            srv_frame_queue_oldest(&pool->in_flight[SRV_WORKER_PREEMPTION]);
        if (shorter) /* is not charged for the time that this frame took from it */
            atomic_store(&shorter->pause.paused_ms, shared_ms);
    }
    while (atomic_load(&frame->pause.requested) && !atomic_load(&frame->cancel))
        pthread_cond_wait(&pool->resume, &pool->mutex);
    pthread_mutex_unlock(&pool->mutex);
}

/* From now on srv_render_pool_interrupt() reaches the frame. */
static struct srv_inflight *enqueue(struct srv_render_pool *pool, enum srv_worker_kind kind,
                                    struct srv_render_job *job, double now_ms) {
    struct srv_frame_queue *queue = &pool->in_flight[kind];
    pthread_mutex_lock(&pool->mutex);
    struct srv_inflight *frame = srv_frame_queue_begin(queue, job, now_ms);
    frame->owner = pool;
    frame->pause.wait = wait_while_paused;
    frame->pause.user = frame;
    if (pool->stop)
        srv_frame_queue_cancel(queue);
    pthread_mutex_unlock(&pool->mutex);
    srv_snapshot_queue_begin_session_frame(&pool->snapshots);
    if (kind == SRV_WORKER_INTERACTIVE && (!job->is_alone || job->ends_with_motion))
        srv_worker_wake(&pool->workers[SRV_WORKER_PREEMPTION]);
    return frame;
}

/* What happened between the hub's decision and enqueue() has not reached the frame: looks again. */
static void catch_up(struct srv_render_pool *pool, const struct srv_render_job *job) {
    if (!srv_schedule_is_newest(pool->schedule, job))
        srv_render_pool_interrupt(pool, job->session, SRV_INTERRUPT_NEWER_VIEW);
    if (job->protected_ms < INFINITY && srv_schedule_has_motion(pool->schedule))
        srv_render_pool_interrupt(pool, 0, SRV_INTERRUPT_MOTION);
}

void srv_session_frame_begin(struct srv_render_pool *pool, enum srv_worker_kind kind,
                             struct srv_render_job *job) {
    struct sp_error err = { .code = SP_OK };
    double start_ms = srv_clock_ms();
    struct srv_inflight *frame = enqueue(pool, kind, job, start_ms);
    catch_up(pool, job);
    if (job->is_refinement)
        sp_log(SP_LOG_DEBUG, "refinement %ux%u begins", job->view.size[0], job->view.size[1]);
    struct srv_loaded_search search = { .catalog = pool->options.catalog,
                                        .volume = job->volume,
                                        .step = job->view.time.step };
    const struct sp_render_options options = { .format = SP_RGBA8,
                                               .wants_depth = srv_render_job_wants_depth(job),
                                               .mip_level = job->mip_level,
                                               .draft = job->is_draft,
                                               .is_valid = true, /* session/view.c */
                                               .wait_ms = job->step == SRV_STEP_FINAL ? 0 : -1,
                                               .takes_parts = job->is_refinement,
                                               .find = srv_catalog_find_loaded,
                                               .user = &search,
                                               .cancel = &frame->cancel,
                                               .pause = &frame->pause };
    bool ok = srv_session_frame_reserve(pool, job, &err) &&
              sp_renderer_begin(pool->workers[kind].renderer, srv_volume_voxels(job->volume),
                                &job->view, pool->frames, &options, &err);
    double now_ms = srv_clock_ms();
    frame->spent_ms = now_ms - start_ms;
    if (search.is_other)
        job->is_sharp = false; /* the frame cache would keep it under the step of the view */
    if (ok)
        return;
    pthread_mutex_lock(&pool->mutex);
    srv_frame_queue_undo(&pool->in_flight[kind]);
    pthread_mutex_unlock(&pool->mutex);
    srv_snapshot_queue_end_session_frame(&pool->snapshots, now_ms);
    fail(pool, kind, job, &err, 0);
}

void srv_session_frame_finish(struct srv_render_pool *pool, enum srv_worker_kind kind) {
    struct sp_error err = { .code = SP_OK };
    struct srv_frame_queue *queue = &pool->in_flight[kind];
    struct srv_inflight *inflight = srv_frame_queue_oldest(queue);
    struct srv_render_job *job = inflight->job;
    double start_ms = srv_clock_ms();
    struct sp_frame *frame = sp_renderer_finish(pool->workers[kind].renderer, &err);
    double now_ms = srv_clock_ms();
    pthread_mutex_lock(&pool->mutex);
    srv_frame_queue_resume(queue, job->order, now_ms);
    double spent_ms =
        inflight->spent_ms + now_ms - start_ms - atomic_load(&inflight->pause.paused_ms);
    srv_frame_queue_pop(queue, now_ms);
    pthread_mutex_unlock(&pool->mutex);
    srv_snapshot_queue_end_session_frame(&pool->snapshots, now_ms);
    srv_render_pool_note_frame(pool, kind, job->volume);
    if (!frame) {
        fail(pool, kind, job, &err, spent_ms);
        return;
    }
    if (frame->stats.bricks.is_incomplete)
        srv_schedule_incomplete(pool->schedule, job, frame->stats.bricks.is_being_read);
    assert(!job->is_sharp || !frame->stats.is_draft);
    if (job->is_sharp) {
        const struct srv_fingerprint content =
            srv_catalog_fingerprint(pool->options.catalog, job->volume, &job->view);
        srv_frame_cache_put(&pool->cache, frame, &content, &job->view,
                            srv_render_job_wants_depth(job));
    }
    srv_schedule_rendered(pool->schedule, job, frame->stats.render_ms);
    srv_encode_pool_submit(pool->encoders,
                           &(struct srv_encode_task){ .frame = frame, .job = job, .worker = kind });
}
