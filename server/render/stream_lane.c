/* SPDX-License-Identifier: Apache-2.0
 *
 * The stream lane: renders what the hub wants.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "render/scheduler_private.h"
#include "sp/log.h"

#define KEPT_BYTES_MAX ((size_t)64 << 20)

static void keep(struct srv_scheduler *s, const struct srv_job *job, struct sp_frame *frame) {
    if (job->sharp && frame->stride_bytes * frame->height <= KEPT_BYTES_MAX)
        srv_kept_set(s, frame, srv_volume_identity(job->volume), &job->view);
}

/* Hands the job to the renderer. From now on srv_scheduler_interrupt() reaches it. */
static void begin_job(struct srv_scheduler *s, struct srv_job *job) {
    struct sp_error err = { .code = SP_OK };
    double start_ms = srv_clock_ms();
    pthread_mutex_lock(&s->mutex);
    struct srv_flight *flight = srv_flights_begin(&s->flights, job, start_ms);
    if (s->stop)
        srv_flights_cancel(&s->flights);
    srv_stills_give_way(s);
    pthread_mutex_unlock(&s->mutex);
    /* The view may have changed before the interruption could reach us, or another one. */
    if (!srv_hub_is_newest(s->hub, job))
        srv_scheduler_interrupt(s, job->session, SRV_NEWER_VIEW);
    if (job->yield_ms < INFINITY && srv_hub_moves(s->hub))
        srv_scheduler_interrupt(s, 0, SRV_MOVES);
    if (job->refinement)
        sp_log(SP_LOG_DEBUG, "refinement %ux%u begins", job->view.size[0], job->view.size[1]);
    const struct sp_render_options options = { .format = SP_RGBA8,
                                               .coarse = job->coarse,
                                               .cancel = &flight->cancel };
    bool ok = sp_renderer_begin(s->lanes[SRV_LANE_STREAMS].renderer, srv_volume_voxels(job->volume),
                                &job->view, s->pool, &options, &err);
    flight->spent_ms = srv_clock_ms() - start_ms;
    if (ok)
        return;
    pthread_mutex_lock(&s->mutex);
    srv_flights_undo(&s->flights);
    pthread_mutex_unlock(&s->mutex);
    srv_job_fail(s, job, &err, 0);
}

/* Waits for the oldest job that was begun. */
static void finish_job(struct srv_scheduler *s) {
    struct sp_error err = { .code = SP_OK };
    struct srv_flight *flight = srv_flights_oldest(&s->flights);
    struct srv_job *job = flight->job;
    double start_ms = srv_clock_ms();
    struct sp_frame *frame = sp_renderer_finish(s->lanes[SRV_LANE_STREAMS].renderer, &err);
    double now_ms = srv_clock_ms(), spent_ms = flight->spent_ms + now_ms - start_ms;
    pthread_mutex_lock(&s->mutex);
    srv_flights_end(&s->flights, now_ms);
    s->stream_ms = now_ms;
    pthread_mutex_unlock(&s->mutex);
    srv_lane_note_frame(s, SRV_LANE_STREAMS, job->volume);
    if (frame) {
        keep(s, job, frame);
        srv_encode_pass_on(s, (struct srv_work){ .frame = frame, .job = job });
    } else {
        srv_job_fail(s, job, &err, spent_ms);
    }
}

static void finish_jobs(struct srv_scheduler *s) {
    while (s->flights.count > 0)
        finish_job(s);
}

/* Begins the job, unless its picture is there or on its way. */
static void take_job(struct srv_scheduler *s, struct srv_job *job) {
    if (srv_flights_has_sharp(&s->flights, job))
        finish_jobs(s);
    struct sp_frame *frame = job->sharp ? srv_kept_find(s, job->volume, &job->view) : NULL;
    if (frame)
        srv_encode_pass_on(s, (struct srv_work){ .frame = frame, .job = job, .again = true });
    else
        begin_job(s, job);
}

/* Keeps as many jobs begun as the renderer takes: the next one is prepared while the GPU draws the
 * one before. */
void *srv_stream_lane_main(void *user) {
    struct srv_scheduler *s = user;
    struct srv_lane *lane = &s->lanes[SRV_LANE_STREAMS];
    struct srv_job *job = NULL;
    for (;;) {
        struct srv_turn turn = srv_lane_look(s, SRV_LANE_STREAMS);
        if (turn.forget)
            srv_kept_set(s, NULL, 0, NULL);
        srv_lane_forget(lane, turn.forget);
        if (turn.stop)
            break;
        double wait_ms = 1000;
        if (!job && !(job = malloc(sizeof *job)))
            sp_log(SP_LOG_ERROR, "no memory for a render job");
        bool takes = job && turn.room && s->flights.count < sp_renderer_depth(lane->renderer);
        if (takes && srv_hub_next_job(s->hub, srv_clock_ms(), job, &wait_ms)) {
            take_job(s, job);
            job = NULL;
        } else if (s->flights.count > 0) {
            finish_job(s);
        } else {
            srv_lane_wait(s, lane, turn.generation, turn.room ? wait_ms : 1000);
        }
    }
    finish_jobs(s);
    free(job);
    return NULL;
}
