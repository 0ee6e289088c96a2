/* SPDX-License-Identifier: Apache-2.0
 *
 * The front door of the renderer: validate the view, dispatch to a backend, time the stages.
 *
 *   volume + view ─► classify ─► splat ─► tile ─► frame
 *
 * A renderer belongs to one thread at a time. It caches data that it computes from each volume
 * (lists of visible voxels, gradients), together with a reference to the volume, until the cache or
 * sp_renderer_evict() drops the entry.
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
     * the caller names is never replaced: the caller gets the error. */
    const char *backend;
    /* sp_renderer_create() calls refused() for each backend that does not start, in the order of
     * the attempts, with the backend's name and the reason; both are valid during the call. It is
     * never called later. NULL = none. */
    void (*refused)(void *user, const char *backend, const struct sp_error *why);
    void *user;       /* passed to refused() */
    const char *gpu;  /* "0", "1", …: the GPU with this number in sp_probe(); NULL = "auto", the
                         first GPU that works */
    bool require_gpu; /* true = never use a backend without a GPU, now or later; default false */
    /* Instruction set of the CPU backend: "scalar" (the reference), "sse41", "avx2", "avx512",
     * "neon"; NULL = "auto", the widest that this machine runs. */
    const char *isa;
    unsigned threads; /* render threads, [1, 256]; 0 = one per core */
    /* Limit of the cache in main memory, bytes. The least recently used entry is evicted first. A
     * view that needs more than the limit alone fails (SP_ERR_BUDGET). 0 = half of the machine's
     * memory. */
    uint64_t memory_bytes;
    /* Limit of the memory that the renderer keeps on a GPU, bytes: cached data of volumes, and
     * frame buffers, which take at most about half. 0 = a default: three eighths of the GPU's
     * memory, so that two renderers leave a quarter to other programs; if the GPU does not report
     * its memory, half of memory_bytes, at most 1 GiB; with software GL, memory_bytes. */
    uint64_t video_bytes;
    /* The working memory of frames (SP_BUDGET_ARENAS) is acquired from this budget: main memory, in
     * addition to the cache. A frame for which the budget does not suffice fails with
     * SP_ERR_FRAME_BUDGET. The renderer keeps the memory from frame to frame while at most half of
     * the budget is acquired. The budget must outlive the renderer. NULL = no limit. */
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
    char failover_reason[SP_ERROR_TEXT]; /* why this backend permanently replaced the previous
                                            backend; "" = it is the first */
    char fallback_reason[SP_ERROR_TEXT]; /* why another backend drew the first frame that this
                                            backend could not draw; "" = there was no such frame */
    unsigned threads;                    /* render threads, >= 1 */
    bool can_pause;                      /* frames pause on request (struct sp_pause) */
    bool has_depth;                      /* frames of some views have depth on request */
    unsigned lanes; /* SIMD lanes: voxels or pixels per CPU instruction; 0 = not known */
    /* The options of a view that SIMD kernels handle, by their names in a view; NULL ends the list.
     * All other options are computed one voxel or pixel at a time. NULL = not known. Constant
     * data. */
    const char *const *vectorised;
};
/* Describes the renderer. The description changes only in calls that finish a frame: when the
 * backend is replaced, or when another backend draws a frame in its place. Call it on the
 * renderer's thread. */
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
    /* true = the frame gets depth and spread (sp/frame.h), if the view has a depth (a mean or sum
     * of values has none) and the backend computes it: "cpu" for all such views, "gl" for sheets of
     * interpolated values, which are the default, other backends never
     * (sp_renderer_info.has_depth). Otherwise, and if false, sp_frame.depth is NULL. The pixels are
     * the same with and without. */
    bool wants_depth;
    /* n in [0, SP_MIP_LEVEL_MAX]: draw 2^n × 2^n × 2^n voxels as one, averaged after
     * classification. The image is blurred, and up to 8^n times faster to draw. 0 = full detail.
     * The renderer may draw a lower level, see sp_frame_stats.mip_level: post-classification stops
     * at level 1, except for sheets. */
    unsigned mip_level;
    /* true = the frame may be a draft, for a view that moves: the "cpu" backend draws sheets of
     * interpolated values in about half the time, scans 35 to 46 dB from the whole frame
     * (renderer/draw/resample/drafts.md). Volumes with fewer than 24 samples along an axis are
     * drawn whole. Everything else is drawn as with false
     * (sp_frame_stats.is_draft). */
    bool draft;
    /* true = the view has passed sp_view_validate() and is not checked again; false = the renderer
     * checks it */
    bool is_valid;
    /* Set it to true from any thread to stop the frame with SP_ERR_CANCELLED; the renderer polls it
     * a few hundred times per frame. It must live until the frame is finished. NULL = the frame is
     * never cancelled. */
    const sp_atomic_bool *cancel;
    /* Returns a reference to the volume that a layer names (sp_layer.id), or NULL: the frame then
     * fails with SP_ERR_VOLUME_UNKNOWN. Called while the frame is begun. NULL = none is found. */
    struct sp_volume *(*find)(void *user, const char *id);
    void *user; /* passed to find() */
    /* How long the frame waits for bricks of a volume that is larger than memory [ms]. After that
     * it shows coarser bricks (sp_frame_stats.bricks). 0 = wait until all bricks are read; below 0
     * = do not wait. */
    double wait_ms;
    /* The frame waits only until the next bricks are read, even if others are still missing
     * (sp_frame_bricks.is_being_read). So the caller can draw a view at rest again and again, each
     * time with more bricks. */
    bool takes_parts;
    /* Lets a scheduler pause the frame (sp/inflight.h); without effect unless
     * sp_renderer_info.can_pause. Must live until the frame is finished. NULL = never. */
    struct sp_pause *pause;
};

/* Renders a frame of view->size and returns one reference to it. View and options are copied;
 * options may be NULL. The renderer may cache a reference to the volume. There must be no in-flight
 * frame. Returns NULL on failure: SP_ERR_INVALID, SP_ERR_VOLUME_UNKNOWN or SP_ERR_UNSUPPORTED
 * (view; err->place is the JSON pointer), SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED,
 * SP_ERR_BACKEND. After a failure the renderer is ready for the next call. One thread at a time. */
SP_API struct sp_frame *sp_renderer_render(struct sp_renderer *renderer, struct sp_volume *volume,
                                           const struct sp_view *view, struct sp_frame_pool *pool,
                                           const struct sp_render_options *options,
                                           struct sp_error *err);

/* True if this renderer can draw the view: the backend supports all options of the view. The view
 * must be valid (sp_view_validate()). SP_ERR_UNSUPPORTED; err->place is the JSON pointer of the
 * unsupported option. Thread-safe, also while another thread renders. */
SP_API bool sp_renderer_supports(const struct sp_renderer *renderer, const struct sp_view *view,
                                 struct sp_error *err);

/* Drops everything that is cached for the volume, and the reference to the volume. Harmless if
 * nothing is cached. Frames that are in flight may cache the volume again: finish
 * them first. */
SP_API void sp_renderer_evict(struct sp_renderer *renderer, const struct sp_volume *volume);

/* Frees the working memory that the renderer keeps from frame to frame. There must be no in-flight
 * frame. Call it on the renderer's thread. */
SP_API void sp_renderer_trim(struct sp_renderer *renderer);

/* Returns the bytes that are cached for the volume; NULL = for all volumes, plus the frame buffers
 * of a GPU. Call it on the renderer's thread. */
SP_API uint64_t sp_renderer_memory(const struct sp_renderer *renderer,
                                   const struct sp_volume *volume);

#ifdef __cplusplus
}
#endif

#endif
