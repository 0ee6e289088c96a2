/* SPDX-License-Identifier: Apache-2.0
 *
 * Frames in flight: functions for a scheduler, in addition to sp_renderer_render(). A GPU draws one
 * frame while the CPU plans the next one and reads the one before; a CPU frame can pause for a
 * shorter one of another renderer.
 *
 *   begin A ─ begin B ─ finish A ─ begin C ─ finish B ─ finish C      oldest first
 *
 * While frames are in flight, the renderer belongs to the thread that began them, because the
 * context of a GPU is bound to that thread. No other thread may call a function that takes a
 * non-const renderer.
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

/* Returns how many frames may be in flight: the number of frames that the backend works on at a
 * time, [1, SP_IN_FLIGHT_MAX]. The number can fall when a backend is replaced; frames in flight
 * then stay in flight. Thread-safe. */
SP_API unsigned sp_renderer_depth(const struct sp_renderer *renderer);

/* Begins a frame of view->size after the frames in flight. Fewer than sp_renderer_depth() frames
 * may be in flight before the call. View and options are copied; options may be NULL. Volume and
 * frame are referenced. Returns when the backend has accepted the frame: a GPU draws it while the
 * next frame begins; the CPU draws it in sp_renderer_finish(). False if no frame was begun:
 * SP_ERR_INVALID, SP_ERR_NOT_FOUND or SP_ERR_UNSUPPORTED (view; err->place is the JSON pointer),
 * SP_ERR_MEMORY. sp_renderer_finish() reports all other failures. One thread at a time. */
SP_API bool sp_renderer_begin(struct sp_renderer *renderer, struct sp_volume *volume,
                              const struct sp_view *view, struct sp_frame_pool *pool,
                              const struct sp_render_options *options, struct sp_error *err);

/* Waits for the oldest in-flight frame, which must exist, and returns a reference to it. After the
 * call the frame is no longer in flight, also after a failure: NULL with SP_ERR_UNSUPPORTED (a
 * replacing backend does not support the view, or the driver of a GPU does not compile the
 * shaders), SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED, SP_ERR_BACKEND. If the failure destroys
 * later in-flight frames, the renderer draws them again. stats.render_ms and stats.cpu_ms count
 * only the two calls of this frame. One thread at a time. */
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
