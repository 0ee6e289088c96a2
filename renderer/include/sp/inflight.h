/* SPDX-License-Identifier: Apache-2.0
 *
 * Frames in flight: what a scheduler needs beside sp_renderer_render(). A GPU draws one frame while
 * the CPU plans the next one and reads the one before; a CPU frame can pause for a shorter one of
 * another renderer.
 *
 *   begin A ─ begin B ─ finish A ─ begin C ─ finish B ─ finish C      oldest first
 *
 * While frames are in flight, the renderer belongs to the thread that began them: no other thread
 * may call a function that takes a renderer that is not const, because a GPU's context is bound to
 * it.
 */
#ifndef SP_INFLIGHT_H
#define SP_INFLIGHT_H

#include "sp/api.h"
#include "sp/atomic.h"
#include "sp/renderer.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SP_IN_FLIGHT_MAX = 4 };

/* Returns how many frames may be in flight: the number that the backend works on at a time, [1,
 * SP_IN_FLIGHT_MAX]. It can fall when a backend is replaced; frames in flight then stay in flight.
 * Thread-safe. */
SP_API unsigned sp_renderer_depth(const struct sp_renderer *renderer);

/* Begins a frame of view->size behind those in flight, of which there must be fewer than
 * sp_renderer_depth(). View and options (may be NULL) are copied; volume and frame are referenced.
 * Returns when the backend has the frame: a GPU then draws it while the next one begins, the CPU
 * draws it in sp_renderer_finish(). False if nothing was begun: SP_ERR_INVALID, SP_ERR_NOT_FOUND or
 * SP_ERR_UNSUPPORTED (view; err->place is the JSON pointer), SP_ERR_MEMORY. sp_renderer_finish()
 * reports all other failures. One thread at a time. */
SP_API bool sp_renderer_begin(struct sp_renderer *renderer, struct sp_volume *volume,
                              const struct sp_view *view, struct sp_frame_pool *pool,
                              const struct sp_render_options *options, struct sp_error *err);

/* Waits for the oldest frame in flight, of which there must be one, and returns a reference to it.
 * It is then no longer in flight, also after a failure: NULL with SP_ERR_UNSUPPORTED (by the
 * backend that took over, or a GPU whose driver does not compile the shaders), SP_ERR_MEMORY,
 * SP_ERR_BUDGET, SP_ERR_CANCELLED, SP_ERR_BACKEND. If the failure destroys the frames behind it,
 * they are drawn again. stats.render_ms and cpu_ms count this frame's own two calls only. One
 * thread at a time. */
SP_API struct sp_frame *sp_renderer_finish(struct sp_renderer *renderer, struct sp_error *err);

/* Pauses a frame that is being drawn, so that another renderer can use the processor for a short
 * frame. Render threads poll `requested` a few hundred times per frame; a thread that finds it set
 * calls wait(), which returns when the frame may resume or is cancelled. */
struct sp_pause {
    sp_atomic_bool requested;
    sp_atomic_double paused_ms; /* total time paused so far; not part of the frame's times */
    void (*wait)(void *user);   /* called by any thread of the renderer; not NULL */
    void *user;                 /* passed to wait() */
};

#ifdef __cplusplus
}
#endif

#endif
