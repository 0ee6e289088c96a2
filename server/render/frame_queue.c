/* SPDX-License-Identifier: Apache-2.0 */
#include "render/frame_queue.h"
#include "sp/inflight.h"

#include <assert.h>
#include <math.h>
#include <string.h>

static struct srv_inflight *at(struct srv_frame_queue *flights, unsigned i) {
    return &flights->ring[(flights->first + i) % SP_IN_FLIGHT_MAX];
}

/* Of moving frames of one session the one behind another that was given up stays. */
static bool follows_given_up(struct srv_frame_queue *flights, const struct srv_render_job *job) {
    for (unsigned i = 0; i < flights->count; i++) {
        const struct srv_inflight *f = at(flights, i);
        if (f->job->session == job->session && f->job->step == SRV_STEP_MOVING &&
            atomic_load(&f->cancel))
            return job->step == SRV_STEP_MOVING;
    }
    return false;
}

struct srv_inflight *srv_frame_queue_begin(struct srv_frame_queue *flights,
                                           struct srv_render_job *job, double now_ms) {
    assert(flights->count < SP_IN_FLIGHT_MAX);
    bool is_kept = follows_given_up(flights, job);
    struct srv_inflight *f = at(flights, flights->count++);
    f->job = job;
    atomic_store(&f->cancel, false);
    f->is_outdated = f->yields = false;
    f->begun_ms = now_ms;
    f->cancellable_from_ms = is_kept ? INFINITY : job->cancellable_from_ms;
    f->kept_ms = job->cancellable_from_ms - now_ms;
    f->spent_ms = f->held_since_ms = f->stood_ms = 0;
    atomic_store(&f->pause.requested, false);
    atomic_store(&f->pause.paused_ms, 0);
    return f;
}

struct srv_inflight *srv_frame_queue_oldest(struct srv_frame_queue *flights) {
    return flights->count ? at(flights, 0) : NULL;
}

void srv_frame_queue_pop(struct srv_frame_queue *flights, double now_ms) {
    assert(flights->count > 0);
    flights->first = (flights->first + 1) % SP_IN_FLIGHT_MAX;
    flights->count--;
    struct srv_inflight *f = srv_frame_queue_oldest(flights);
    if (!f)
        return;
    f->begun_ms = now_ms;
    if (f->cancellable_from_ms > 0)
        f->cancellable_from_ms = fmax(f->cancellable_from_ms, now_ms + f->kept_ms);
}

void srv_frame_queue_undo(struct srv_frame_queue *flights) {
    assert(flights->count > 0);
    flights->count--;
}

/* For half the time in which the processor was shared it did not run. */
static double held_ms(const struct srv_inflight *f, double now_ms) {
    double before_ms = atomic_load(&f->pause.paused_ms);
    if (f->held_since_ms == 0)
        return before_ms;
    double shared_ms = (f->stood_ms > 0 ? f->stood_ms : now_ms) - f->held_since_ms;
    return before_ms + now_ms - f->held_since_ms - shared_ms / 2;
}

double srv_inflight_age_ms(const struct srv_inflight *f, double now_ms) {
    return now_ms - f->begun_ms - held_ms(f, now_ms);
}

void srv_frame_queue_pause(struct srv_frame_queue *flights, uint64_t order, double now_ms) {
    struct srv_inflight *f = srv_frame_queue_oldest(flights);
    if (!f || f->job->order != order || f->held_since_ms > 0)
        return;
    f->held_since_ms = now_ms;
    f->stood_ms = 0;
    atomic_store(&f->pause.requested, true);
}

double srv_inflight_paused(struct srv_inflight *f, double now_ms) {
    f->stood_ms = now_ms;
    return (now_ms - f->held_since_ms) / 2;
}

void srv_frame_queue_resume(struct srv_frame_queue *flights, uint64_t order, double now_ms) {
    struct srv_inflight *f = srv_frame_queue_oldest(flights);
    if (!f || f->job->order != order || f->held_since_ms == 0)
        return;
    atomic_store(&f->pause.paused_ms, held_ms(f, now_ms));
    f->held_since_ms = 0;
    atomic_store(&f->pause.requested, false);
}

static void give_up(struct srv_frame_queue *flights, unsigned i) {
    struct srv_inflight *f = at(flights, i);
    atomic_store(&f->cancel, true);
    for (unsigned k = i + 1; f->job->step == SRV_STEP_MOVING && k < flights->count; k++) {
        struct srv_inflight *next = at(flights, k);
        if (next->job->session == f->job->session && next->job->step == SRV_STEP_MOVING &&
            next->cancellable_from_ms > 0)
            next->cancellable_from_ms = INFINITY;
    }
}

void srv_frame_queue_tick(struct srv_frame_queue *flights, double now_ms) {
    for (unsigned i = 0; i < flights->count; i++) {
        struct srv_inflight *f = at(flights, i);
        double own_ms = now_ms - held_ms(f, now_ms);
        bool is_over = f->cancellable_from_ms == 0 || (i == 0 && own_ms >= f->cancellable_from_ms);
        bool yields = f->yields && own_ms - f->begun_ms >= f->job->protected_ms;
        if ((yields || (f->is_outdated && is_over)) && !atomic_load(&f->cancel))
            give_up(flights, i);
    }
}

static bool concerns(const struct srv_inflight *f, uint64_t of, enum srv_interrupt why) {
    const struct srv_render_job *job = f->job;
    if (why == SRV_INTERRUPT_MOTION)
        return job->protected_ms < INFINITY;
    if (why == SRV_INTERRUPT_NEWER_REQUEST) /* who else gets it still wants it */
        return job->target_count == 1 && job->targets[0].participant == of;
    return job->session == of;
}

void srv_frame_queue_interrupt(struct srv_frame_queue *flights, uint64_t of, enum srv_interrupt why,
                               double now_ms) {
    for (unsigned i = 0; i < flights->count; i++) {
        struct srv_inflight *f = at(flights, i);
        if (!concerns(f, of, why))
            continue;
        if (why == SRV_INTERRUPT_MOTION)
            f->yields = true;
        else
            f->is_outdated = true;
        if (why == SRV_INTERRUPT_UNWANTED)
            f->cancellable_from_ms = 0;
    }
    srv_frame_queue_tick(flights, now_ms);
}

void srv_frame_queue_cancel(struct srv_frame_queue *flights) {
    for (unsigned i = 0; i < flights->count; i++)
        atomic_store(&at(flights, i)->cancel, true);
}

bool srv_frame_queue_has_sharp(const struct srv_frame_queue *flights,
                               const struct srv_render_job *job) {
    for (unsigned i = 0; i < flights->count; i++) {
        const struct srv_render_job *other =
            flights->ring[(flights->first + i) % SP_IN_FLIGHT_MAX].job;
        if (other->is_sharp && job->is_sharp && other->volume == job->volume &&
            memcmp(&other->view, &job->view, sizeof job->view) == 0)
            return true;
    }
    return false;
}
