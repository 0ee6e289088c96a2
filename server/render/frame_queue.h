/* SPDX-License-Identifier: Apache-2.0
 *
 * The in-flight frames of a worker, oldest first, and the rules by which they are cancelled. A GPU
 * renders several at a time; then the next frame is prepared while the GPU renders the one before.
 *
 *   begin ──► behind others ──► the oldest ──► pop
 *
 * At any time, these frames are cancelled: a refinement of an older view, a frame that no client
 * wants, and a frame that yields to motion. The oldest frame is also cancelled when a newer view
 * waits and its time is used up. That time starts when the frame becomes the oldest, so that it
 * does not pay for the frames before it.
 *
 * Of two consecutive moving frames of a session, one is always finished: when a frame is cancelled,
 * the next frames are not.
 *
 * A frame can be paused while a shorter one is rendered (preemption_worker.c). A paused frame does
 * not age. Between the request to pause and the moment when its threads stop, both frames share the
 * processor; each of them is charged half of that time.
 *
 * Pure: no clock and no lock. The caller holds the lock that guards the queue.
 */
#ifndef SRV_RENDER_FRAME_QUEUE_H
#define SRV_RENDER_FRAME_QUEUE_H

#include <stdatomic.h>

#include "schedule/schedule.h"
#include "sp/inflight.h"
#include "sp/renderer.h"

struct srv_inflight {
    struct srv_render_job *job; /* the worker's */
    atomic_bool cancel;         /* of its rendering */
    bool is_outdated;           /* a newer view waits */
    bool yields;     /* something moves, to which the frame yields when its time is used up */
    double begun_ms; /* when it was begun, or when it became the oldest */
    double cancellable_from_ms; /* as in the job */
    double uncancellable_ms;    /* from the beginning to cancellable_from_ms */
    double spent_ms;            /* time in the renderer; for the worker's thread */
    struct sp_pause pause;      /* wait() and its user are the worker's */
    double pause_began_ms;      /* when it was asked to pause; 0 = it runs */
    double stopped_ms;          /* when its threads stopped; 0 = they still run */
    void *owner;                /* the worker's */
};

struct srv_frame_queue {
    struct srv_inflight ring[SP_IN_FLIGHT_MAX];
    unsigned first, count;
};

/* Appends a frame; the queue must not be full. The pointer is valid until the frame is popped. */
struct srv_inflight *srv_frame_queue_begin(struct srv_frame_queue *queue,
                                           struct srv_render_job *job, double now_ms);
/* NULL = the queue is empty. */
struct srv_inflight *srv_frame_queue_oldest(struct srv_frame_queue *queue);
/* Pops the oldest frame; the time of the next one starts. */
void srv_frame_queue_pop(struct srv_frame_queue *queue, double now_ms);
/* Removes the newest frame, because the renderer refused it. */
void srv_frame_queue_undo(struct srv_frame_queue *queue);

/* Returns how long the frame has been rendered, ms, without pauses. */
double srv_inflight_age_ms(const struct srv_inflight *frame, double now_ms);
/* Pauses or resumes the oldest frame if it is the job of this order. */
void srv_frame_queue_pause(struct srv_frame_queue *queue, uint64_t order, double now_ms);
void srv_frame_queue_resume(struct srv_frame_queue *queue, uint64_t order, double now_ms);
/* Call it when a thread of a frame that was asked to pause has stopped; the last call counts.
 * Returns the time that the shorter frame is not charged for: half of the time since the request,
 * ms. */
double srv_inflight_paused(struct srv_inflight *frame, double now_ms);

/* Handles an interrupt of the scheduler (struct srv_schedule_options): cancels the affected frames
 * that may be cancelled now. */
void srv_frame_queue_interrupt(struct srv_frame_queue *queue, uint64_t of, enum srv_interrupt why,
                               double now_ms);
/* Cancels the frames that may be cancelled by now. */
void srv_frame_queue_tick(struct srv_frame_queue *queue, double now_ms);
void srv_frame_queue_cancel(struct srv_frame_queue *queue); /* all of them */

/* True if the final image that this job renders is among the frames, for whatever session. */
bool srv_frame_queue_has_sharp(const struct srv_frame_queue *queue,
                               const struct srv_render_job *job);

#endif
