/* SPDX-License-Identifier: Apache-2.0
 *
 * The front door of the renderer: validate the view, dispatch to a backend, time the stages.
 *
 *   volume + view ─► classify ─► splat ─► tile ─► frame
 *
 * A renderer belongs to one thread at a time. It caches what it computes from each volume (lists of
 * visible voxels, gradients) and keeps a reference to the volume with it, until the cache drops the
 * entry or sp_renderer_evict() does.
 *
 *   sp/inflight.h   several frames at a time, and pausing a frame: for schedulers
 *   sp/probe.h      the devices of this machine
 */
#ifndef SP_RENDERER_H
#define SP_RENDERER_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/atomic.h"
#include "sp/frame.h"
#include "sp/status.h"
#include "sp/view.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

struct sp_renderer; /* opaque */
struct sp_pause;    /* sp/inflight.h */
struct sp_budget;   /* sp/budget.h */

/* All zero = all defaults. Strings are copied. */
struct sp_renderer_options {
    /* A name of sp_backend_at(): "cpu", "gl", …; NULL = "auto". "auto" takes the first backend that
     * starts, and replaces it by the next one after three failures in a row (SP_ERR_BACKEND). A
     * single frame that needs too much memory (SP_ERR_MEMORY, SP_ERR_BUDGET) or whose shaders do
     * not compile is drawn by the next backend, which then has a cache of its own. A backend that
     * is named is never replaced: the caller gets the error. */
    const char *backend;
    /* sp_renderer_create() calls refused() for each backend that does not start, in the order of
     * the attempts, with the backend's name and the reason; both are valid during the call. It is
     * never called later. NULL = none. */
    void (*refused)(void *user, const char *backend, const struct sp_error *why);
    void *user;      /* passed to refused() */
    const char *gpu; /* "0", "1", …: the GPU of that number in sp_probe(); NULL = "auto", the first
                        that works */
    bool require_gpu; /* true = never use a backend without a GPU, now or later; default false */
    /* Instruction set of the CPU backend: "scalar" (the reference), "sse41", "avx2", "avx512",
     * "neon"; NULL = "auto", the widest that this machine runs. */
    const char *isa;
    unsigned threads; /* render threads, [1, 256]; 0 = one per core */
    /* Limit of the cache in main memory, bytes. The least recently used entry is evicted first; a
     * view that alone needs more fails (SP_ERR_BUDGET). 0 = half of the machine's memory. */
    uint64_t memory_bytes;
    /* Limit of everything that is kept in a GPU's own memory, bytes: cached data of volumes, and
     * buffers to draw in, which take at most about half. 0 = three eighths of that memory, so that
     * two renderers leave a quarter to other programs; half of memory_bytes and at most 1 GiB if
     * the GPU does not report its size; memory_bytes with software GL. */
    uint64_t video_bytes;
    /* What frames are drawn in (SP_BUDGET_ARENAS) is taken from it: main memory, beside the cache.
     * A frame for which it does not suffice fails with SP_ERR_FRAME_BUDGET. The memory is kept from
     * frame to frame while at most half of the budget is taken. The budget must outlive the
     * renderer. NULL = no limit. */
    struct sp_budget *frame_budget;
};

/* Starts a renderer. `options` may be NULL. Returns NULL if no backend starts: SP_ERR_INVALID
 * (options), SP_ERR_MEMORY, SP_ERR_BACKEND. The log says which backend was chosen and why others
 * were refused. Thread-safe. */
SP_API struct sp_renderer *sp_renderer_create(const struct sp_renderer_options *options,
                                              struct sp_error *err);
/* Accepts a NULL renderer and nulls *renderer. Frames in flight are dropped. */
SP_API void sp_renderer_destroy(struct sp_renderer **renderer);

struct sp_renderer_info {
    const char *backend;                 /* constant string */
    const char *isa;                     /* constant string; "" = the backend has none */
    char device[SP_DEVICE_NAME];         /* name of the CPU or GPU */
    char failover_reason[SP_ERROR_TEXT]; /* why this backend replaced the one before it for good;
                                            "" = it is the first */
    char fallback_reason[SP_ERROR_TEXT]; /* why another backend drew the first frame that this one
                                            could not draw; "" = there was none */
    unsigned threads;                    /* render threads, >= 1 */
    bool can_pause;                      /* its frames pause on request (struct sp_pause) */
    unsigned lanes; /* SIMD lanes: voxels or pixels per CPU instruction; 0 = not known */
    /* The choices of a view that SIMD kernels handle, by their names in a view; ends with NULL. All
     * others are computed one voxel or pixel at a time. NULL = not known. Constant data. */
    const char *const *vectorised;
};
/* The info changes only in calls that finish a frame: when the backend is replaced, or another one
 * draws a frame in its place. Call it on the renderer's thread. */
SP_API void sp_renderer_info(const struct sp_renderer *renderer, struct sp_renderer_info *info);

/* A backend of this build. Strings are constants. */
struct sp_backend_entry {
    const char *name;
    const char *doc; /* a phrase for --help */
};
/* Enumerates the backends in the order in which "auto" tries them: i from 0; NULL past the end.
 * Thread-safe. */
SP_API const struct sp_backend_entry *sp_backend_at(unsigned i);

enum { SP_MIP_LEVEL_MAX = 2 };

/* All zero = all defaults. */
struct sp_render_options {
    enum sp_pixel_format format; /* 0 = SP_RGBA8 */
    /* [0, SP_MIP_LEVEL_MAX]: draw 2^n × 2^n × 2^n voxels as one, averaged after classification:
     * blurred, and up to 8^n times faster. 0 = full detail. The level that was drawn is in
     * sp_frame_stats.mip_level: post-classification stops at 1, but sheets do not. */
    unsigned mip_level;
    /* The view is valid (sp_view_validate()): it is not checked again. false = it is checked. */
    bool is_valid;
    /* Set it to true from any thread to stop the frame with SP_ERR_CANCELLED; it is polled a few
     * hundred times per frame. Must live until the frame is finished. NULL = never. */
    const sp_atomic_bool *cancel;
    /* Returns a reference to the volume that a layer names (sp_layer.id), or NULL: the frame then
     * fails with SP_ERR_VOLUME_UNKNOWN. Called while the frame is begun. NULL = none is found. */
    struct sp_volume *(*find)(void *user, const char *id);
    void *user; /* passed to find() */
    /* How long the frame waits for bricks of a volume that is larger than memory [ms]; then it
     * shows coarser ones (sp_frame_stats.bricks). 0 = until all are read; below 0 = not at all. */
    double wait_ms;
    /* It waits no longer than until the next bricks are there, even if others are missing
     * (sp_frame_bricks.is_being_read). So a view at rest is shown again and again, each time with
     * more of them. */
    bool takes_parts;
    /* Lets a scheduler pause the frame (sp/inflight.h); without effect unless
     * sp_renderer_info.can_pause. Must live until the frame is finished. NULL = never. */
    struct sp_pause *pause;
};

/* Renders a frame of view->size and returns one reference to it. View and options (may be NULL) are
 * copied; a reference to the volume may be cached. No frame may be in flight. Returns NULL on
 * failure: SP_ERR_INVALID, SP_ERR_VOLUME_UNKNOWN or SP_ERR_UNSUPPORTED (view; err->place is the
 * JSON pointer), SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED, SP_ERR_BACKEND. The renderer is
 * then ready for the next call. One thread at a time. */
SP_API struct sp_frame *sp_renderer_render(struct sp_renderer *renderer, struct sp_volume *volume,
                                           const struct sp_view *view, struct sp_frame_pool *pool,
                                           const struct sp_render_options *options,
                                           struct sp_error *err);

/* True if this renderer can draw the view: the backend supports all its choices. The view must be
 * valid (sp_view_validate()). SP_ERR_UNSUPPORTED; err->place is the JSON pointer. Thread-safe, also
 * while another thread renders. */
SP_API bool sp_renderer_supports(const struct sp_renderer *renderer, const struct sp_view *view,
                                 struct sp_error *err);

/* Drops everything cached for the volume, and the reference to it. Harmless if nothing is cached.
 * Frames in flight may cache it again: finish them first. */
SP_API void sp_renderer_evict(struct sp_renderer *renderer, const struct sp_volume *volume);

/* Frees the memory that is kept from frame to frame to draw in. No frame may be in flight. Call it
 * on the renderer's thread. */
SP_API void sp_renderer_trim(struct sp_renderer *renderer);

/* Returns the bytes that are cached for the volume; NULL = for all volumes, with the buffers that a
 * GPU draws in. Call it on the renderer's thread. */
SP_API uint64_t sp_renderer_memory(const struct sp_renderer *renderer,
                                   const struct sp_volume *volume);

#ifdef __cplusplus
}
#endif

#endif
