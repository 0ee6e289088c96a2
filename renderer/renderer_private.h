/* SPDX-License-Identifier: Apache-2.0
 *
 * What the three files of the front door share:
 *
 *   renderer.c   creates a renderer, checks a view, keeps the queue of frames in flight
 *   prepare.c    chooses what a frame shows: bricks, edits, the order of classification, layers
 *   failover.c   draws it on the backend; on another one where the backend cannot, or fails
 */
#ifndef SP_RENDERER_PRIVATE_H
#define SP_RENDERER_PRIVATE_H

#include <stdatomic.h>

#include "backend/backend.h"
#include "base/arena.h"
#include "draw/layers/layer_volumes.h"
#include "sp/inflight.h"
#include "sp/renderer.h"

/* A frame in flight. */
struct sp_renderer_frame {
    struct sp_backend_job job;      /* with references to volume and frame */
    struct sp_volume *original;     /* a reference: the volume without the view's edits */
    struct sp_layer_volumes others; /* with references */
    struct sp_view view;
    struct sp_frame_bricks bricks;
    bool is_begun;       /* the backend works on it */
    bool may_be_pre;     /* order "auto" chose post, and pre is also possible */
    struct sp_error why; /* why the backend's begin() failed; SP_OK = it did not fail */
    double ms, cpu_ms;   /* spent in sp_renderer_begin() */
};

/* Draws frames that the backend cannot draw. All zero until the first such frame. */
struct sp_fallback {
    const struct sp_backend *backend;
    void *state;
    struct sp_renderer_info info;
    bool is_missing; /* no other backend starts */
};

struct sp_renderer {
    _Atomic(const struct sp_backend *) backend; /* other threads read it */
    void *state;
    struct sp_renderer_info info;
    struct sp_fallback fallback;
    struct sp_backend_options wanted; /* for every backend that is started; isa is owned */
    bool is_auto;                     /* created with "auto": may change the backend */
    unsigned failures;                /* of the backend, in a row */
    struct sp_renderer_frame queue[SP_IN_FLIGHT_MAX];
    struct sp_volume *edited;     /* the last one that was drawn, a reference; NULL = none */
    unsigned oldest, begun;       /* a ring: `begun` frames from queue[oldest] on */
    struct sp_pool *workers;      /* compose slices, filter pixels; NULL until they are needed */
    struct sp_frame_pool *frames; /* for slices; NULL until the first ones */
    struct sp_arena rows;         /* for the filter of pixels */
};

/* Returns the frame in flight that is number `i` from the oldest one. */
static inline struct sp_renderer_frame *sp_renderer_frame_at(struct sp_renderer *r, unsigned i) {
    return &r->queue[(r->oldest + i) % SP_IN_FLIGHT_MAX];
}

/* Fills *frame, but for `is_begun`, `why` and the times. The view must be valid and suit the
 * volume. On failure the frame has no references. (prepare.c) */
bool sp_renderer_prepare(const struct sp_renderer *renderer, struct sp_renderer_frame *frame,
                         struct sp_volume *volume, const struct sp_view *view,
                         struct sp_frame_pool *pool, const struct sp_render_options *options,
                         struct sp_error *err);

/* Adopts a backend that has just started. (failover.c) */
void sp_renderer_adopt(struct sp_renderer *renderer, const struct sp_backend *backend, void *state);
/* Names the backend that draws the frame in its statistics, and clears the others. (failover.c) */
void sp_renderer_name_backend(struct sp_frame *frame, const struct sp_renderer_info *by);
/* Draws the frame. A backend that fails is tried again, so that no frame is lost if its device
 * comes back, and replaced after three failures in a row. Failures that are due to the view or to
 * memory do not count. (failover.c) */
bool sp_renderer_draw(struct sp_renderer *renderer, struct sp_renderer_frame *frame,
                      struct sp_error *err);

#endif
