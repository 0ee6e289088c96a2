/* SPDX-License-Identifier: Apache-2.0
 *
 * The jobs that the stream lane has begun and not finished, oldest first, and which of them may be
 * given up.
 *
 *   begun ──► behind others ──► the oldest ──► finished
 *                 │                 │
 *                 │                 └ a newer view waits, and it is over its budget: its clock
 *                 │                   starts here, so that nobody pays for the frame before his
 *                 └ at any time: a refinement of an older view, what nobody wants, and
 *                   what gives way when something moves
 *
 * Of two moving frames of a session one is always finished: when one is given up, those behind it
 * stay. What stands still for another (express_lane.c) grows no older meanwhile; until its threads
 * have come to that, the two share the processor, and each is charged half. No clock, no lock:
 * whoever calls holds the lane's.
 */
#ifndef SRV_RENDER_FRAME_QUEUE_H
#define SRV_RENDER_FRAME_QUEUE_H

#include <stdatomic.h>

#include "session/hub.h"
#include "sp/inflight.h"
#include "sp/renderer.h"

struct srv_inflight {
    struct srv_render_job *job;          /* the lane's */
    atomic_bool cancel;                  /* of its rendering */
    bool is_outdated;                    /* a newer view waits */
    bool yields;                         /* something moves to which it gives way in time */
    double begun_ms;                     /* or since when it is the oldest */
    double cancellable_from_ms, kept_ms; /* as the job's; and how long that is from its beginning */
    double spent_ms;       /* in the renderer; the lane's thread alone writes and reads it */
    struct sp_pause pause; /* wait() and its user are the lane's */
    double held_since_ms;  /* while it is to stand still, else 0 */
    double stood_ms;       /* and since when it does; 0 = its threads still run */
    void *owner;           /* the lane's */
};

struct srv_frame_queue {
    struct srv_inflight ring[SP_IN_FLIGHT_MAX];
    unsigned first, count;
};

/* Begins a job behind the others, of which there are fewer than SP_IN_FLIGHT_MAX. It stays where it
 * is until it is taken out. */
struct srv_inflight *srv_frame_queue_begin(struct srv_frame_queue *flights,
                                           struct srv_render_job *job, double now_ms);

struct srv_inflight *
srv_frame_queue_oldest(struct srv_frame_queue *flights); /* NULL = there is none */
/* Takes out the oldest: the next one's clock starts. */
void srv_frame_queue_pop(struct srv_frame_queue *flights, double now_ms);
/* Takes out the newest, which was not begun after all. */
void srv_frame_queue_undo(struct srv_frame_queue *flights);

/* How long the flight has been drawn, without what it stood still. */
double srv_inflight_age_ms(const struct srv_inflight *flight, double now_ms);
/* The oldest stands still from now on, if it is the job of that order; and goes on. */
void srv_frame_queue_pause(struct srv_frame_queue *flights, uint64_t order, double now_ms);
void srv_frame_queue_resume(struct srv_frame_queue *flights, uint64_t order, double now_ms);
/* A thread of a flight that is to stand still does; the last one counts. Returns what is taken from
 * the time of the one for which it stands still, ms so far. */
double srv_inflight_paused(struct srv_inflight *flight, double now_ms);

/* Something begun is no longer what is wanted first: as struct srv_hub_options says. What may be
 * given up then is. */
void srv_frame_queue_interrupt(struct srv_frame_queue *flights, uint64_t of, enum srv_interrupt why,
                               double now_ms);
void srv_frame_queue_tick(struct srv_frame_queue *flights, double now_ms);
void srv_frame_queue_cancel(struct srv_frame_queue *flights); /* all of them */

/* Is this job's picture, a sharp one, among them? For whatever session. */
bool srv_frame_queue_has_sharp(const struct srv_frame_queue *flights,
                               const struct srv_render_job *job);

#endif
