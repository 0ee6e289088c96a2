/* SPDX-License-Identifier: Apache-2.0
 *
 * The express lane: short frames of who has had less, while the stream lane draws a long one, which
 * stands still and loses nothing.
 *
 *   stream lane   ██████████ · ██████ · ████████████      somebody's frame of 300 ms
 *   express lane            █        █                    another one's of 5 ms, 30 a second
 *
 * Only what the processor draws stands still (sp_renderer_info.can_pause): the frames of a GPU are
 * short. The lane has a renderer of its own, made for its first job, which derives again from the
 * volume what the stream lane's has derived.
 */
#include <stdlib.h>

#include "common/clock.h"
#include "render/render_pool_private.h"
#include "sp/log.h"

#define LONG_MS 10.0 /* what is drawn for so long stands still for others */

/* What the stream lane draws, if that is long. *wait_ms: until it is. */
static bool find_long(struct srv_render_pool *s, struct srv_running_job *running, double *wait_ms) {
    struct srv_worker *streams = &s->lanes[SRV_WORKER_INTERACTIVE];
    pthread_mutex_lock(&s->mutex);
    const struct srv_inflight *f = srv_frame_queue_oldest(&streams->flights);
    bool found = f && streams->info.can_pause && !s->has_no_express && !atomic_load(&f->cancel);
    if (found)
        *running = (struct srv_running_job){ .session = f->job->session,
                                             .order = f->job->order,
                                             .start_ms = f->job->start_ms,
                                             .part_start_ms = f->job->part_start_ms,
                                             .expected_ms = f->job->expected_ms,
                                             .drawn_ms = srv_inflight_age_ms(f, srv_clock_ms()) };
    pthread_mutex_unlock(&s->mutex);
    if (found && running->drawn_ms < LONG_MS) {
        *wait_ms = LONG_MS - running->drawn_ms;
        found = false;
    }
    return found;
}

void srv_preemption_disable(struct srv_render_pool *s, const struct sp_error *err) {
    sp_log(SP_LOG_WARN,
           "no renderer for short frames, which wait for long ones from now on: %s%s%s", err->place,
           err->place[0] ? ": " : "", err->text);
    pthread_mutex_lock(&s->mutex);
    s->has_no_express = true;
    pthread_mutex_unlock(&s->mutex);
}

/* The same as the stream lane's is at the moment, with half the memory of the still lane's. */
static bool make_renderer(struct srv_render_pool *s, struct sp_error *err) {
    struct srv_worker *lane = &s->lanes[SRV_WORKER_PREEMPTION];
    struct sp_renderer_options options = s->options.stills;
    pthread_mutex_lock(&s->mutex);
    options.backend = s->lanes[SRV_WORKER_INTERACTIVE].info.backend;
    pthread_mutex_unlock(&s->mutex);
    options.memory_bytes /= 2;
    return lane->renderer || (lane->renderer = sp_renderer_create(&options, err));
}

static void stand_still(struct srv_render_pool *s, uint64_t order, bool still) {
    struct srv_frame_queue *flights = &s->lanes[SRV_WORKER_INTERACTIVE].flights;
    pthread_mutex_lock(&s->mutex);
    if (still)
        srv_frame_queue_pause(flights, order, srv_clock_ms());
    else
        srv_frame_queue_resume(flights, order, srv_clock_ms());
    pthread_cond_broadcast(&s->go_on);
    pthread_mutex_unlock(&s->mutex);
}

static void draw_before(struct srv_render_pool *s, uint64_t order, struct srv_render_job *job) {
    struct sp_error err = { .code = SP_OK };
    if (!make_renderer(s, &err)) {
        srv_preemption_disable(s, &err);
        sp_fail(&err, SP_ERR_CANCELLED, NULL, "the stream lane draws it");
        srv_job_fail(s, job, &err, 0);
        return;
    }
    stand_still(s, order, true);
    srv_job_begin(s, SRV_WORKER_PREEMPTION, job);
    if (s->lanes[SRV_WORKER_PREEMPTION].flights.count > 0)
        srv_job_finish(s, SRV_WORKER_PREEMPTION);
    stand_still(s, order, false);
}

void *srv_preemption_worker_main(void *user) {
    struct srv_render_pool *s = user;
    struct srv_worker *lane = &s->lanes[SRV_WORKER_PREEMPTION];
    struct srv_render_job *job = NULL;
    for (;;) {
        struct srv_worker_round turn = srv_worker_look(s, SRV_WORKER_PREEMPTION);
        srv_worker_evict(lane, turn.forget);
        if (turn.stop)
            break;
        struct srv_running_job running;
        double wait_ms = 1000;
        if (!job && !(job = malloc(sizeof *job)))
            sp_log(SP_LOG_ERROR, "no memory for a render job");
        if (job && turn.room && find_long(s, &running, &wait_ms) &&
            srv_schedule_next_short(s->hub, &running, srv_clock_ms(), job, &wait_ms)) {
            draw_before(s, running.order, job);
            job = NULL;
        } else {
            srv_worker_wait(s, lane, turn.generation, wait_ms);
        }
    }
    free(job);
    return NULL;
}
