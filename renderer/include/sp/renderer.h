/* SPDX-License-Identifier: Apache-2.0
 *
 * The front door of the renderer: validate, dispatch to a backend, time the stages.
 *
 *   volume + view ─► classify ─► splat ─► tile ─► frame
 *
 * A renderer belongs to one thread at a time. It keeps what it derived from the volumes that it has
 * seen (gradients, visible voxels), and with it a reference to each of them, until
 * sp_renderer_evict().
 */
#ifndef SP_RENDERER_H
#define SP_RENDERER_H

#include <stdatomic.h>
#include <stdbool.h>

#include "sp/frame.h"
#include "sp/status.h"
#include "sp/view.h"
#include "sp/volume.h"

struct sp_renderer;

struct sp_renderer_options {
    /* A name of sp_backend_at(): "cpu", "null", …; "auto" (default, NULL) is the first that starts,
     * and while it renders the next one when that has failed (SP_ERR_BACKEND) three times in a row;
     * a frame that it has no memory for (SP_ERR_MEMORY, SP_ERR_BUDGET) is drawn by the next one,
     * with what that derives from the volume beside it. Who names a backend gets the error. */
    const char *backend;
    /* sp_renderer_create() calls refused() for each backend that does not start, in the order of
     * the attempts, with the backend's name and the reason; both are valid during the call. It is
     * never called later. NULL (default) = not needed. `user` is passed through. */
    void (*refused)(void *user, const char *backend, const struct sp_error *why);
    void *user;
    const char *gpu;  /* "auto" (default, NULL) is the first that works; "0", "1", …: this one of
                         sp_probe() */
    bool require_gpu; /* default false: true takes nothing but a GPU, at the start and ever after */
    /* Instruction set of the CPU backend: "auto" (default, NULL) is the best that this machine has
     * of "scalar" (the reference), "sse41", "avx2", "avx512", "neon". */
    const char *isa;
    unsigned threads; /* [1, 256]; 0 = one a core */
    /* Most that is derived from volumes and kept between frames: the least recently used goes
     * first, and a view that needs more than all of it is refused (SP_ERR_BUDGET). 0 = half of the
     * machine's memory. */
    uint64_t memory_bytes;
    /* The same of a GPU's own memory, for all that is kept there: what is derived from volumes, and
     * what pictures are drawn in, which takes at most about half. 0 = three eighths of it, so
     * that two renderers leave a quarter for other programs; where the GPU does not tell how much
     * it has, half of memory_bytes and at most 1 GiB; with software GL memory_bytes. */
    uint64_t video_bytes;
};

/* NULL with *err set when no backend starts: SP_ERR_INVALID (options), SP_ERR_MEMORY,
 * SP_ERR_BACKEND. Every refusal is logged with its reason, and so is what was taken. `options` may
 * be NULL; its strings are copied. */
struct sp_renderer *sp_renderer_create(const struct sp_renderer_options *options,
                                       struct sp_error *err);
void sp_renderer_destroy(struct sp_renderer **renderer);

struct sp_renderer_info {
    const char *backend, *isa; /* constant strings; isa: "" = has none */
    char device[SP_DEVICE_NAME];
    char failover_reason[SP_ERROR_TEXT]; /* why the backend before this one was given up while
                                     rendering;
                                     "" = there was none */
    char
        fallback_reason[SP_ERROR_TEXT]; /* why another one drew frames in its place, the first time;
                                        "" = none did */
    unsigned threads;
    bool can_pause; /* its frames stand still while they are to (struct sp_pause) */
    unsigned lanes; /* voxels or pixels that the CPU's kernels handle at a time; 0 = not known */
    /* The choices of a view that they handle so, by the names that a view has for them; ends with
     * NULL. NULL = not known. All else is handled one by one. */
    const char *const *vectorised;
};
/* For the renderer's thread. It changes only where a frame is finished: a backend is given up or
 * overburdened. */
void sp_renderer_info(const struct sp_renderer *renderer, struct sp_renderer_info *info);

/* One compiled backend a call in the order in which "auto" tries them, i from 0; NULL past the end.
 */
struct sp_backend_entry {
    const char *name, *doc;
};
const struct sp_backend_entry *sp_backend_at(unsigned i);

/* What one GPU can do at most; 0 = it does not tell. */
struct sp_gpu_limits {
    uint64_t video_bytes;         /* its own memory; what is free of it, with some drivers */
    uint64_t storage_block_bytes; /* one buffer as a shader sees it */
    unsigned storage_blocks;      /* buffers that a compute shader sees at a time */
    unsigned storage_alignment;   /* [B], of where in a buffer a block begins */
    unsigned shared_bytes;        /* memory that a work group shares */
    unsigned group_invocations;   /* of a work group */
    unsigned group_size[3], group_count[3];
};

/* Something to render on, or a way to it that fails. Texts are cut to fit. */
struct sp_device {
    const char *backend;       /* constant; the one that would use it */
    char place[96];            /* "EGL device 0 (/dev/dri/card0)", "surfaceless display", … */
    enum sp_code refusal_code; /* SP_OK = it works, and what follows is set; else why it does not */
    char refusal[SP_ERROR_TEXT];  /* the same for people; "" = it works */
    bool is_gpu;                  /* a hardware GPU */
    int gpu;                      /* its number for sp_renderer_options.gpu; −1 = has none */
    char name[SP_DEVICE_NAME];    /* what sp_renderer_info.device will be */
    char vendor[SP_DEVICE_NAME];  /* "" = not told, here and below */
    char version[SP_DEVICE_NAME]; /* of OpenGL; instruction sets of a processor */
    char driver[SP_DEVICE_NAME];
    unsigned threads;            /* of a processor; 0 elsewhere */
    struct sp_gpu_limits limits; /* of a GPU, or of what acts as one */
};

/* Called once for each, before sp_probe() returns; *device lives as long as the call. */
typedef void sp_device_visit(void *user, const struct sp_device *device);

/* Tries everything that backends could render on, GPUs first, and tells what came of it. Returns
 * whether a hardware GPU works. Any thread; takes a few hundred ms. */
bool sp_probe(sp_device_visit *visit, void *user);

enum { SP_MIP_LEVEL_MAX = 2 };

/* Makes a frame that is being drawn stand still, so that another renderer has the processor for
 * something short. `wanted` is polled a few hundred times a frame; a thread that finds it set calls
 * wait(), which returns when the frame may go on or is cancelled. */
struct sp_pause {
    atomic_bool requested;
    _Atomic double paused_ms; /* how long it stood still so far: no part of the frame's times */
    void (*wait)(void *user); /* any thread of the renderer's */
    void *user;
};

struct sp_render_options {
    enum sp_pixel_format format; /* default (0) SP_RGBA8 */
    unsigned mip_level; /* [0, SP_MIP_LEVEL_MAX], default 0: draw 2^n × 2^n × 2^n voxels as one,
                        averaged after classification: blurred, and up to 8^n times faster.
                        The frame's stats say what was done */
    const atomic_bool *cancel; /* NULL = never; polled a few hundred times a frame; true = stop with
                                  SP_ERR_CANCELLED */
    struct sp_pause *pause; /* NULL = never; of no effect unless sp_renderer_info.can_pause. It must
                             live as long as *cancel */
};

enum { SP_IN_FLIGHT_MAX = 4 };

/* Frames that may be begun and not finished: as many as the backend keeps under way at a time, [1,
 * SP_IN_FLIGHT_MAX]. It may fall when a backend is given up; what is begun then stays so. */
unsigned sp_renderer_depth(const struct sp_renderer *renderer);

/* Begins a frame of view->size, behind those that were begun before. View and options are copied,
 * volume and pool's frame referenced; *options->cancel must live until the frame is finished. It
 * returns when the frame is with the backend: a GPU draws it while the next one is begun, the
 * processor when it is finished. False with *err set when nothing was begun: SP_ERR_INVALID (view),
 * SP_ERR_UNSUPPORTED (view, with the pointer), SP_ERR_MEMORY. Whatever else happens to the frame is
 * told by sp_renderer_finish(). `options` may be NULL. */
bool sp_renderer_begin(struct sp_renderer *renderer, struct sp_volume *volume,
                       const struct sp_view *view, struct sp_frame_pool *pool,
                       const struct sp_render_options *options, struct sp_error *err);

/* Waits for the oldest frame that was begun, of which there must be one, and returns its reference,
 * or NULL with *err set: SP_ERR_UNSUPPORTED (by the backend that took over, or by a GPU whose
 * driver does not compile what the view takes), SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED,
 * SP_ERR_BACKEND. It is begun no longer then; the frames behind it are, and are drawn again if its
 * failure takes them along. stats.render_ms and cpu_ms are of its own two calls: what passes
 * between them is other frames'. */
struct sp_frame *sp_renderer_finish(struct sp_renderer *renderer, struct sp_error *err);

/* The two in one: renders a frame. Nothing may be begun. After an error the renderer is ready for
 * the next call. */
struct sp_frame *sp_renderer_render(struct sp_renderer *renderer, struct sp_volume *volume,
                                    const struct sp_view *view, struct sp_frame_pool *pool,
                                    const struct sp_render_options *options, struct sp_error *err);

/* Checks whether this renderer could draw the view, without drawing: validity and support. Any
 * thread may call it, also while another one renders. */
bool sp_renderer_supports(const struct sp_renderer *renderer, const struct sp_view *view,
                          struct sp_error *err);

/* Drops everything derived from the volume. Harmless if there is nothing, and to frames of it that
 * are begun, which may derive it anew: finish them first. */
void sp_renderer_evict(struct sp_renderer *renderer, const struct sp_volume *volume);

/* Bytes of derived data kept for the volume (gradients, lists); NULL = for all, with what a GPU has
 * beside it to draw pictures in. */
uint64_t sp_renderer_memory(const struct sp_renderer *renderer, const struct sp_volume *volume);

#endif
