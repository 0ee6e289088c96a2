/* SPDX-License-Identifier: Apache-2.0
 *
 * The stream lane: renders what the hub wants.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "render/render_pool_private.h"
#include "sp/inflight.h"
#include "sp/log.h"

#define KEPT_BYTES_MAX ((size_t)64 << 20)

static void keep(struct srv_render_pool *s, const struct srv_render_job *job,
                 struct sp_frame *frame) {
    if (job->is_sharp && frame->stride_bytes * frame->height <= KEPT_BYTES_MAX)
        srv_frame_cache_set(s, frame, job->volume, &job->view);
}

/* With the mutex held: a thread of the flight has come to a stand. */
static void charge_half(struct srv_render_pool *s, struct srv_inflight *flight) {
    struct srv_inflight *express = srv_frame_queue_oldest(&s->lanes[SRV_WORKER_PREEMPTION].flights);
    double shared_ms = srv_inflight_paused(flight, srv_clock_ms());
    if (express)
        atomic_store(&express->pause.paused_ms, shared_ms);
}

/* For struct sp_pause: what is given up goes on, to its end. */
static void stand_still(void *user) {
    struct srv_inflight *flight = user;
    struct srv_render_pool *s = flight->owner;
    pthread_mutex_lock(&s->mutex);
    if (atomic_load(&flight->pause.requested))
        charge_half(s, flight);
    while (atomic_load(&flight->pause.requested) && !atomic_load(&flight->cancel))
        pthread_cond_wait(&s->go_on, &s->mutex);
    pthread_mutex_unlock(&s->mutex);
}

static struct srv_inflight *take_off(struct srv_render_pool *s, enum srv_worker_name name,
                                     struct srv_render_job *job, double now_ms) {
    struct srv_worker *lane = &s->lanes[name];
    pthread_mutex_lock(&s->mutex);
    struct srv_inflight *flight = srv_frame_queue_begin(&lane->flights, job, now_ms);
    flight->owner = s;
    flight->pause.wait = stand_still;
    flight->pause.user = flight;
    if (s->stop)
        srv_frame_queue_cancel(&lane->flights);
    srv_snapshots_yield(s);
    if (name == SRV_WORKER_INTERACTIVE && !job->is_alone)
        srv_worker_wake(&s->lanes[SRV_WORKER_PREEMPTION]);
    pthread_mutex_unlock(&s->mutex);
    return flight;
}

/* What the express lane cannot draw is left to the stream lane, from now on. */
static void fail_job(struct srv_render_pool *s, enum srv_worker_name name,
                     struct srv_render_job *job, struct sp_error *err, double spent_ms) {
    if (name == SRV_WORKER_PREEMPTION && err->code != SP_ERR_CANCELLED) {
        srv_preemption_disable(s, err);
        sp_fail(err, SP_ERR_CANCELLED, NULL, "the stream lane draws it");
    }
    srv_job_fail(s, job, err, spent_ms);
}

/* From now on srv_render_pool_interrupt() reaches it. */
void srv_job_begin(struct srv_render_pool *s, enum srv_worker_name name,
                   struct srv_render_job *job) {
    struct sp_error err = { .code = SP_OK };
    struct srv_worker *lane = &s->lanes[name];
    double start_ms = srv_clock_ms();
    struct srv_inflight *flight = take_off(s, name, job, start_ms);
    /* The view may have changed before the interruption could reach us, or another one. */
    if (!srv_schedule_is_newest(s->hub, job))
        srv_render_pool_interrupt(s, job->session, SRV_INTERRUPT_NEWER_VIEW);
    if (job->protected_ms < INFINITY && srv_schedule_has_motion(s->hub))
        srv_render_pool_interrupt(s, 0, SRV_INTERRUPT_MOTION);
    if (job->is_refinement)
        sp_log(SP_LOG_DEBUG, "refinement %ux%u begins", job->view.size[0], job->view.size[1]);
    const struct sp_render_options options = { .format = SP_RGBA8,
                                               .mip_level = job->mip_level,
                                               .cancel = &flight->cancel,
                                               .pause = &flight->pause };
    bool ok = sp_renderer_begin(lane->renderer, srv_volume_voxels(job->volume), &job->view, s->pool,
                                &options, &err);
    flight->spent_ms = srv_clock_ms() - start_ms;
    if (ok)
        return;
    pthread_mutex_lock(&s->mutex);
    srv_frame_queue_undo(&lane->flights);
    pthread_mutex_unlock(&s->mutex);
    fail_job(s, name, job, &err, 0);
}

void srv_job_finish(struct srv_render_pool *s, enum srv_worker_name name) {
    struct sp_error err = { .code = SP_OK };
    struct srv_worker *lane = &s->lanes[name];
    struct srv_inflight *flight = srv_frame_queue_oldest(&lane->flights);
    struct srv_render_job *job = flight->job;
    bool is_express = name == SRV_WORKER_PREEMPTION;
    double start_ms = srv_clock_ms();
    struct sp_frame *frame = sp_renderer_finish(lane->renderer, &err);
    double now_ms = srv_clock_ms();
    pthread_mutex_lock(&s->mutex);
    srv_frame_queue_resume(&lane->flights, job->order, now_ms);
    double spent_ms = flight->spent_ms + now_ms - start_ms - atomic_load(&flight->pause.paused_ms);
    srv_frame_queue_pop(&lane->flights, now_ms);
    s->stream_ms = now_ms;
    pthread_mutex_unlock(&s->mutex);
    srv_worker_note_frame(s, name, job->volume);
    if (frame) {
        keep(s, job, frame);
        srv_schedule_rendered(s->hub, job, frame->stats.render_ms);
        srv_encode_submit(
            s, (struct srv_encode_task){ .frame = frame, .job = job, .is_express = is_express });
    } else {
        fail_job(s, name, job, &err, spent_ms);
    }
}

static void finish_jobs(struct srv_render_pool *s) {
    while (s->lanes[SRV_WORKER_INTERACTIVE].flights.count > 0)
        srv_job_finish(s, SRV_WORKER_INTERACTIVE);
}

/* Begins the job, unless its picture is there or on its way. */
static void take_job(struct srv_render_pool *s, struct srv_render_job *job) {
    if (srv_frame_queue_has_sharp(&s->lanes[SRV_WORKER_INTERACTIVE].flights, job))
        finish_jobs(s);
    struct sp_frame *frame =
        job->is_sharp ? srv_frame_cache_find(s, job->volume, &job->view) : NULL;
    if (frame)
        srv_encode_submit(s, (struct srv_encode_task){ .frame = frame, .job = job, .again = true });
    else
        srv_job_begin(s, SRV_WORKER_INTERACTIVE, job);
}

/* Keeps as many jobs begun as the renderer takes: the next one is prepared while the GPU draws the
 * one before. */
void *srv_interactive_worker_main(void *user) {
    struct srv_render_pool *s = user;
    struct srv_worker *lane = &s->lanes[SRV_WORKER_INTERACTIVE];
    struct srv_render_job *job = NULL;
    for (;;) {
        struct srv_worker_round turn = srv_worker_look(s, SRV_WORKER_INTERACTIVE);
        if (turn.forget)
            srv_frame_cache_set(s, NULL, NULL, NULL);
        srv_worker_evict(lane, turn.forget);
        if (turn.stop)
            break;
        double wait_ms = 1000;
        if (!job && !(job = malloc(sizeof *job)))
            sp_log(SP_LOG_ERROR, "no memory for a render job");
        bool takes = job && turn.room && lane->flights.count < sp_renderer_depth(lane->renderer);
        if (takes && srv_schedule_next(s->hub, srv_clock_ms(), job, &wait_ms)) {
            take_job(s, job);
            job = NULL;
        } else if (lane->flights.count > 0) {
            srv_job_finish(s, SRV_WORKER_INTERACTIVE);
        } else {
            srv_worker_wait(s, lane, turn.generation, turn.room ? wait_ms : 1000);
        }
    }
    finish_jobs(s);
    free(job);
    return NULL;
}
