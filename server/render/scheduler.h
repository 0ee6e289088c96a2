/* SPDX-License-Identifier: Apache-2.0
 *
 * The render thread and the encode threads.
 *
 *   sessions (pull) ─┐  render thread       ┌─► encode thread ─► outboxes of the participants
 *                    ├─► owns sp_renderer ──┤   (each its own    or
 *   stills (queue) ──┘   and frame pool     └─► sp_encoder)      done() of the still
 *
 * Moving views go first; a waiting still gets every fifth frame at the latest; refinements of
 * resting views and stills take turns. A refinement is cancelled when its view changes; a moving
 * frame never is, so that a long drag always shows something.
 */
#ifndef SRV_RENDER_SCHEDULER_H
#define SRV_RENDER_SCHEDULER_H

#include "render/catalog.h"
#include "session/hub.h"
#include "sp/renderer.h"

struct srv_scheduler;

struct srv_still_result {
    bool ok;
    struct sp_error err;  /* if not ok */
    const uint8_t *bytes; /* valid during the call */
    size_t size;
    struct sp_frame_stats stats;
    double encode_ms;
};
struct srv_still {
    struct sp_view view;
    struct srv_volume *volume; /* a use, taken over by submit */
    enum sp_image_format format;
    int quality;
    /* Called once, from another thread. */
    void (*done)(void *user, const struct srv_still_result *result);
    void *user;
};

struct srv_scheduler_options {
    struct srv_catalog *catalog;
    unsigned queue_max; /* stills that wait */
    unsigned encode_threads;
};

/* Takes over *renderer on success. NULL with *err set. */
struct srv_scheduler *srv_scheduler_create(const struct srv_scheduler_options *options,
                                           struct sp_renderer **renderer, struct sp_error *err);
/* Threads start with the hub that they serve. */
bool srv_scheduler_start(struct srv_scheduler *scheduler, struct srv_hub *hub,
                         struct sp_error *err);
/* Cancels what is under way; waiting stills are answered with SP_ERR_CANCELLED. */
void srv_scheduler_stop(struct srv_scheduler *scheduler);
void srv_scheduler_destroy(struct srv_scheduler **scheduler); /* stops first */

/* False with SP_ERR_BUDGET when the queue is full or SP_ERR_CANCELLED when stopping; the volume is
 * released then and done() is not called. */
bool srv_scheduler_submit(struct srv_scheduler *scheduler, const struct srv_still *still,
                          struct sp_error *err);
unsigned srv_scheduler_waiting(struct srv_scheduler *scheduler); /* stills not yet answered */

/* For srv_hub_options and srv_catalog_options; `user` is the scheduler. */
void srv_scheduler_wake(void *scheduler);
void srv_scheduler_interrupt(void *scheduler, uint64_t session);
void srv_scheduler_forget(void *scheduler, struct sp_volume *volume);
bool srv_scheduler_supports(void *scheduler, const struct sp_view *view, struct sp_error *err);

#endif
