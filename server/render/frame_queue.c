/* SPDX-License-Identifier: Apache-2.0 */
#include "render/frame_queue.h"

#include <assert.h>
#include <math.h>
#include <string.h>

static struct srv_inflight *at(struct srv_frame_queue *queue, unsigned i) {
    return &queue->ring[(queue->first + i) % SP_IN_FLIGHT_MAX];
}

/* True if the job is a moving frame behind a cancelled one of its session: it must be finished. */
static bool follows_cancelled(struct srv_frame_queue *queue, const struct srv_render_job *job) {
    for (unsigned i = 0; i < queue->count; i++) {
        const struct srv_inflight *f = at(queue, i);
        if (f->job->session == job->session && f->job->step == SRV_STEP_MOVING &&
            atomic_load(&f->cancel))
            return job->step == SRV_STEP_MOVING;
    }
    return false;
}

struct srv_inflight *srv_frame_queue_begin(struct srv_frame_queue *queue,
                                           struct srv_render_job *job, double now_ms) {
    assert(queue->count < SP_IN_FLIGHT_MAX);
    bool must_finish = follows_cancelled(queue, job);
    struct srv_inflight *f = at(queue, queue->count++);
    f->job = job;
    atomic_store(&f->cancel, false);
    f->is_outdated = f->yields = false;
    f->begun_ms = now_ms;
    f->cancellable_from_ms = must_finish ? INFINITY : job->cancellable_from_ms;
    f->uncancellable_ms = job->cancellable_from_ms - now_ms;
    f->spent_ms = f->pause_began_ms = f->stopped_ms = 0;
    atomic_store(&f->pause.requested, false);
    atomic_store(&f->pause.paused_ms, 0);
    return f;
}

struct srv_inflight *srv_frame_queue_oldest(struct srv_frame_queue *queue) {
    return queue->count ? at(queue, 0) : NULL;
}

void srv_frame_queue_pop(struct srv_frame_queue *queue, double now_ms) {
    assert(queue->count > 0);
    queue->first = (queue->first + 1) % SP_IN_FLIGHT_MAX;
    queue->count--;
    struct srv_inflight *f = srv_frame_queue_oldest(queue);
    if (!f)
        return;
    f->begun_ms = now_ms;
    if (f->cancellable_from_ms > 0)
        f->cancellable_from_ms = fmax(f->cancellable_from_ms, now_ms + f->uncancellable_ms);
}

void srv_frame_queue_undo(struct srv_frame_queue *queue) {
    assert(queue->count > 0);
    queue->count--;
}

/* Pauses so far. While both frames share the processor, half of the time counts as a pause. */
static double pauses_ms(const struct srv_inflight *f, double now_ms) {
    double before_ms = atomic_load(&f->pause.paused_ms);
    if (f->pause_began_ms == 0)
        return before_ms;
    double shared_ms = (f->stopped_ms > 0 ? f->stopped_ms : now_ms) - f->pause_began_ms;
    return before_ms + now_ms - f->pause_began_ms - shared_ms / 2;
}

double srv_inflight_age_ms(const struct srv_inflight *f, double now_ms) {
    return now_ms - f->begun_ms - pauses_ms(f, now_ms);
}

void srv_frame_queue_pause(struct srv_frame_queue *queue, uint64_t order, double now_ms) {
    struct srv_inflight *f = srv_frame_queue_oldest(queue);
    if (!f || f->job->order != order || f->pause_began_ms > 0)
        return;
    f->pause_began_ms = now_ms;
    f->stopped_ms = 0;
    atomic_store(&f->pause.requested, true);
}

double srv_inflight_paused(struct srv_inflight *f, double now_ms) {
    f->stopped_ms = now_ms;
    return (now_ms - f->pause_began_ms) / 2;
}

void srv_frame_queue_resume(struct srv_frame_queue *queue, uint64_t order, double now_ms) {
    struct srv_inflight *f = srv_frame_queue_oldest(queue);
    if (!f || f->job->order != order || f->pause_began_ms == 0)
        return;
    atomic_store(&f->pause.paused_ms, pauses_ms(f, now_ms));
    f->pause_began_ms = 0;
    atomic_store(&f->pause.requested, false);
}

/* Cancels frame i, and protects the moving frames of its session behind it. */
static void cancel(struct srv_frame_queue *queue, unsigned i) {
    struct srv_inflight *f = at(queue, i);
    atomic_store(&f->cancel, true);
    for (unsigned k = i + 1; f->job->step == SRV_STEP_MOVING && k < queue->count; k++) {
        struct srv_inflight *next = at(queue, k);
        if (next->job->session == f->job->session && next->job->step == SRV_STEP_MOVING &&
            next->cancellable_from_ms > 0)
            next->cancellable_from_ms = INFINITY;
    }
}

void srv_frame_queue_tick(struct srv_frame_queue *queue, double now_ms) {
    for (unsigned i = 0; i < queue->count; i++) {
        struct srv_inflight *f = at(queue, i);
        double own_now_ms = now_ms - pauses_ms(f, now_ms);
        bool is_over =
            f->cancellable_from_ms == 0 || (i == 0 && own_now_ms >= f->cancellable_from_ms);
        bool yields = f->yields && own_now_ms - f->begun_ms >= f->job->protected_ms;
        if ((yields || (f->is_outdated && is_over)) && !atomic_load(&f->cancel))
            cancel(queue, i);
    }
}

static bool concerns(const struct srv_inflight *f, uint64_t of, enum srv_interrupt why) {
    const struct srv_render_job *job = f->job;
    if (why == SRV_INTERRUPT_MOTION)
        return job->protected_ms < INFINITY;
    if (why == SRV_INTERRUPT_NEWER_REQUEST) /* other participants still want the frame */
        return job->target_count == 1 && job->targets[0].participant == of;
    return job->session == of && (why != SRV_INTERRUPT_STOPPED || job->ends_with_motion);
}

void srv_frame_queue_interrupt(struct srv_frame_queue *queue, uint64_t of, enum srv_interrupt why,
                               double now_ms) {
    for (unsigned i = 0; i < queue->count; i++) {
        struct srv_inflight *f = at(queue, i);
        if (!concerns(f, of, why))
            continue;
        if (why == SRV_INTERRUPT_MOTION)
            f->yields = true;
        else
            f->is_outdated = true;
        if (why == SRV_INTERRUPT_UNWANTED || why == SRV_INTERRUPT_STOPPED)
            f->cancellable_from_ms = 0;
    }
    srv_frame_queue_tick(queue, now_ms);
}

void srv_frame_queue_cancel(struct srv_frame_queue *queue) {
    for (unsigned i = 0; i < queue->count; i++)
        atomic_store(&at(queue, i)->cancel, true);
}

bool srv_frame_queue_has_sharp(const struct srv_frame_queue *queue,
                               const struct srv_render_job *job) {
    for (unsigned i = 0; i < queue->count; i++) {
        const struct srv_render_job *other = queue->ring[(queue->first + i) % SP_IN_FLIGHT_MAX].job;
        if (other->is_sharp && job->is_sharp && other->volume == job->volume &&
            sp_view_equal(&other->view, &job->view))
            return true;
    }
    return false;
}
