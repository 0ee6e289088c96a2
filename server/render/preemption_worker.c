/* SPDX-License-Identifier: Apache-2.0
 *
 * The preemption worker: while the interactive worker renders a long frame, pauses that frame and
 * renders a short one of a session that is below its fair share. The paused frame loses nothing.
 *
 *   interactive worker  ██████████ · ██████ · ████████████    a frame of 300 ms
 *   preemption worker             █        █                  frames of 5 ms, 30 per second
 *
 * While the interactive worker renders, this worker also waits for the moment at which the hand
 * seems to have stopped, and then cancels a frame that ends with the motion.
 *
 * Only frames of the CPU backend can be paused (sp_renderer_info.can_pause); frames of a GPU are
 * short. The worker's renderer is created for its first frame. It caches data of the volume on its
 * own, beside what the interactive worker's renderer caches.
 */
#include <math.h>
#include <stdlib.h>

#include "common/clock.h"
#include "render/render_pool_private.h"
#include "sp/log.h"

#define LONG_MS 10.0 /* a frame that was rendered for this long may be paused */

/* Gets the interactive worker's frame. False: it has none that is not cancelled. */
static bool running_job(struct srv_render_pool *pool, struct srv_running_job *running) {
    pthread_mutex_lock(&pool->mutex);
    const struct srv_inflight *frame =
        srv_frame_queue_oldest(&pool->in_flight[SRV_WORKER_INTERACTIVE]);
    const bool found = frame && !atomic_load(&frame->cancel);
    if (found)
        *running =
            (struct srv_running_job){ .session = frame->job->session,
                                      .order = frame->job->order,
                                      .start_ms = frame->job->start_ms,
                                      .participant_start_ms = frame->job->participant_start_ms,
                                      .expected_ms = frame->job->expected_ms,
                                      .price = frame->job->price,
                                      .drawn_ms = srv_inflight_age_ms(frame, srv_clock_ms()),
                                      .image = frame->job->image,
                                      .is_first = frame->job->is_first,
                                      .ends_with_motion = frame->job->ends_with_motion };
    pthread_mutex_unlock(&pool->mutex);
    return found;
}

/* Cancels the interactive worker's frame if it ends with the motion, and the hand has stopped.
 * Returns when to ask again, in ms. */
static double stop_with_motion(struct srv_render_pool *pool) {
    struct srv_running_job running;
    if (!running_job(pool, &running) || !running.ends_with_motion)
        return INFINITY;
    const double in_ms = srv_schedule_stops_in_ms(pool->schedule, &running, srv_clock_ms());
    if (in_ms > 0)
        return in_ms;
    srv_render_pool_interrupt(pool, running.session, SRV_INTERRUPT_STOPPED);
    return INFINITY;
}

/* Finds the interactive worker's frame if it may be paused and is long by now. Else false; *wait_ms
 * is lowered to the time until it is. */
static bool find_long_frame(struct srv_render_pool *pool, struct srv_running_job *running,
                            double *wait_ms) {
    struct sp_renderer_info info;
    srv_worker_info(&pool->workers[SRV_WORKER_INTERACTIVE], &info);
    if (!info.can_pause || !running_job(pool, running))
        return false;
    pthread_mutex_lock(&pool->mutex);
    const bool may_pause = !pool->has_no_preemption && running->order != pool->not_preempted;
    pthread_mutex_unlock(&pool->mutex);
    if (may_pause && running->drawn_ms < LONG_MS)
        *wait_ms = LONG_MS - running->drawn_ms;
    return may_pause && running->drawn_ms >= LONG_MS;
}

void srv_preemption_disable(struct srv_render_pool *pool, const struct sp_error *err) {
    sp_log(SP_LOG_WARN, "preemption is off, short frames now wait for long ones: %s%s%s",
           err->place, err->place[0] ? ": " : "", err->text);
    pthread_mutex_lock(&pool->mutex);
    pool->has_no_preemption = true;
    pthread_mutex_unlock(&pool->mutex);
}

/* Uses the backend that the interactive worker has at the moment, and half of the memory of the
 * snapshot worker's renderer. */
static bool create_renderer(struct srv_render_pool *pool, struct sp_error *err) {
    struct srv_worker *worker = &pool->workers[SRV_WORKER_PREEMPTION];
    struct sp_renderer_options options = pool->options.renderer;
    struct sp_renderer_info info;
    srv_worker_info(&pool->workers[SRV_WORKER_INTERACTIVE], &info);
    options.backend = info.backend;
    options.memory_bytes /= 2;
    options.frame_budget = pool->options.frame_memory.sessions;
    return worker->renderer || (worker->renderer = sp_renderer_create(&options, err));
}

static void set_paused(struct srv_render_pool *pool, uint64_t order, bool is_paused) {
    struct srv_frame_queue *queue = &pool->in_flight[SRV_WORKER_INTERACTIVE];
    pthread_mutex_lock(&pool->mutex);
    if (is_paused)
        srv_frame_queue_pause(queue, order, srv_clock_ms());
    else
        srv_frame_queue_resume(queue, order, srv_clock_ms());
    pthread_cond_broadcast(&pool->resume);
    pthread_mutex_unlock(&pool->mutex);
}

/* Renders the job while the frame of this order is paused. */
static void preempt(struct srv_render_pool *pool, uint64_t order, struct srv_render_job *job) {
    struct sp_error err = { .code = SP_OK };
    if (!create_renderer(pool, &err)) {
        srv_preemption_disable(pool, &err);
        sp_fail(&err, SP_ERR_CANCELLED, NULL, "the interactive worker renders it");
        srv_session_frame_fail(pool, job, &err, 0);
        return;
    }
    set_paused(pool, order, true);
    srv_session_frame_begin(pool, SRV_WORKER_PREEMPTION, job);
    if (pool->in_flight[SRV_WORKER_PREEMPTION].count > 0)
        srv_session_frame_finish(pool, SRV_WORKER_PREEMPTION);
    set_paused(pool, order, false);
}

void *srv_preemption_worker_main(void *user) {
    struct srv_render_pool *pool = user;
    struct srv_worker *worker = &pool->workers[SRV_WORKER_PREEMPTION];
    struct srv_render_job *job = NULL;
    for (;;) {
        struct srv_worker_round round = srv_worker_begin_round(worker);
        if (round.stop)
            break;
        struct srv_running_job running;
        double wait_ms = 1000;
        const double stop_ms = stop_with_motion(pool);
        if (!job && !(job = malloc(sizeof *job)))
            sp_log(SP_LOG_ERROR, "out of memory for a render job");
        if (job && srv_encode_pool_has_capacity(pool->encoders, SRV_WORKER_PREEMPTION) &&
            find_long_frame(pool, &running, &wait_ms) &&
            srv_schedule_next_short(pool->schedule, &running, srv_clock_ms(), job, &wait_ms)) {
            preempt(pool, running.order, job);
            job = NULL;
        } else {
            srv_render_pool_rest(pool, SRV_WORKER_PREEMPTION);
            srv_worker_wait(worker, round.generation, fmin(wait_ms, stop_ms));
        }
    }
    free(job);
    return NULL;
}
