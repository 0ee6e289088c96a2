/* SPDX-License-Identifier: Apache-2.0
 *
 * A backend turns a validated, supported view of a volume into pixels. It is one `static const`
 * vtable at the end of one file, listed in registry.c.
 *
 *   renderer.c ── validate, check capabilities, time ──► backend ── stages ──► frame
 *
 * renderer.c checks the input, unless its caller has checked it (sp_render_options.is_valid). The
 * backend trusts the input: a view that reaches render() is valid and asks for nothing outside the
 * capabilities. One thread at a time calls the functions of a state, not always the same thread.
 * Backends never include each other. README.md explains how a backend is chosen.
 */
#ifndef SP_BACKEND_BACKEND_H
#define SP_BACKEND_BACKEND_H

#include <stdatomic.h>
#include <stdbool.h>

#include "base/interrupt.h"
#include "sp/frame.h"
#include "sp/inflight.h"
#include "sp/probe.h"
#include "sp/renderer.h"
#include "sp/view.h"
#include "sp/volume.h"

/* What a backend can do, as data: bit n of a mask stands for value n of the enum in sp/view.h;
 * 0 = it supports no value. */
struct sp_capabilities {
    uint32_t projections, filters, kernels, compositings, attenuations;
    uint32_t orders, shadings, levels_of_detail;
    uint32_t layers; /* types of layers besides the volume. With "auto" another backend draws views
                        with other types. */
    bool gradient_axis; /* transfer_function.gradient */
    /* Sheets that are classified after interpolation. Without it render() fails with
     * SP_ERR_UNSUPPORTED for them, so that with "auto" another backend draws them. */
    bool interpolated_sheets;
    bool light; /* shading.occlusion and shading.shadow on such sheets; otherwise as above */
    bool clip_box, clip_planes;
    bool depth;  /* fills sp_frame.depth and spread, if the frame has them */
    bool blocks; /* interpolated sheets and projections of a volume whose samples lie in blocks */
};
#define SP_CAN(value) (UINT32_C(1) << (value))
#define SP_CAN_ALL UINT32_MAX

struct sp_backend_options {
    unsigned threads;               /* [1, 256] */
    uint64_t memory_bytes;          /* as in sp_renderer_options, > 0 */
    uint64_t video_bytes;           /* as in sp_renderer_options */
    struct sp_budget *frame_budget; /* as in sp_renderer_options */
    const char *isa;  /* "auto" or a name; SP_ERR_INVALID if the backend does not know it */
    int gpu;          /* index of the GPU to use; −1 = the first that works. GPU backends only */
    bool require_gpu; /* start GPU backends only */
    /* A GPU backend calls passes() for each device on which it has created a state, before it uses
     * the device. False with *err set: the device is refused and the next one is tried.
     * NULL = every device passes. */
    bool (*passes)(void *user, void *state, struct sp_error *err);
    void *user;
    /* As in sp_renderer_options; for choose.c, not for backends. */
    void (*refused)(void *user, const char *backend, const struct sp_error *why);
    void *refused_user;
};

/* One frame to make. */
struct sp_backend_job {
    struct sp_volume *volume; /* borrowed until the frame is finished */
    /* The order of its transfer function is never SP_TF_AUTO. It has only the visible layers,
     * possibly none. */
    const struct sp_view *view;
    /* By layer of the view: the volume whose elements the layer shows, borrowed; may be `volume`;
     * NULL for layers of other types. */
    struct sp_volume *layer_volumes[SP_LAYERS_MAX];
    /* By layer of the view: the volume that layer->color_by names, borrowed; NULL = none. */
    struct sp_volume *colors[SP_LAYERS_MAX];
    /* If the frame shows a part of the volume: the clip of the whole volume, which casts shadows;
     * NULL = the view's clip. */
    const struct sp_clip *light_clip;
    unsigned mip_level;        /* as in sp_render_options; a backend without levels ignores it */
    bool is_draft;             /* sp_render_options.draft; a backend may ignore it */
    struct sp_frame *frame;    /* size and format are set; the backend fills pixels and stats */
    const atomic_bool *cancel; /* NULL = never */
    struct sp_pause *pause;    /* NULL = never */
};

/* Returns the interrupt by which the caller cancels or pauses the job. */
static inline struct sp_interrupt sp_job_interrupt(const struct sp_backend_job *job) {
    return (struct sp_interrupt){ job->cancel, job->pause };
}

/* True if the caller has cancelled the job; waits while the job is paused. Poll it often. */
static inline bool sp_job_is_cancelled(const struct sp_backend_job *job) {
    struct sp_interrupt interrupt = sp_job_interrupt(job);
    return sp_interrupt_is_cancelled(&interrupt);
}

/* Returns the monotonic time without the pauses of the job [ms], to measure its stages. */
static inline double sp_job_clock_ms(const struct sp_backend_job *job) {
    struct sp_interrupt interrupt = sp_job_interrupt(job);
    return sp_interrupt_clock_ms(&interrupt);
}

struct sp_backend {
    struct sp_backend_entry entry; /* as sp_backend_at() returns it */
    bool by_name_only;             /* "auto" skips it */
    bool is_gpu; /* starts only on hardware, never on software that emulates a GPU */
    struct sp_capabilities capabilities;

    /* Mandatory. Returns the backend's state, or NULL with *err set: the reason is then logged, and
     * "auto" tries the next backend. */
    void *(*create)(const struct sp_backend_options *options, struct sp_error *err);
    void (*destroy)(void *state);                                   /* never NULL */
    void (*info)(const void *state, struct sp_renderer_info *info); /* all fields; constant */

    /* Mandatory. Fills every pixel, and depth and spread if the frame has them: a backend that
     * cannot compute them for this view sets both pointers to NULL. It also fills in the stats
     * visible_voxels, splats, fragments and the stages. False with *err set: the pixels of the
     * frame are undefined and the state is still usable. After SP_ERR_MEMORY, SP_ERR_BUDGET or
     * SP_ERR_UNSUPPORTED (this device cannot draw this view), "auto" lets another backend draw the
     * frame. SP_ERR_CANCELLED. SP_ERR_BACKEND: all begun frames are lost; the same call may succeed
     * now, and the caller repeats it. */
    bool (*render)(void *state, const struct sp_backend_job *job, struct sp_error *err);

    /* Optional: render() in two halves, so that the processor prepares a frame while the device
     * draws the previous one. begin() hands a frame to the device; false = the frame is not begun.
     * finish() waits for the oldest begun frame, with the same job, and ends it, also on failure.
     * At most `depth` frames are begun at a time; they are finished in the order in which they were
     * begun. Errors as for render(); SP_ERR_BACKEND from either call ends all begun frames. */
    unsigned depth; /* [2, SP_IN_FLIGHT_MAX]; 0 = both are NULL */
    bool (*begin)(void *state, const struct sp_backend_job *job, struct sp_error *err);
    bool (*finish)(void *state, const struct sp_backend_job *job, struct sp_error *err);

    /* Optional; NULL = the backend caches nothing of a volume. */
    void (*evict)(void *state, const struct sp_volume *volume);
    uint64_t (*memory)(const void *state, const struct sp_volume *volume); /* bytes */

    /* Optional; NULL = the backend keeps no memory for drawing from frame to frame. Frees this
     * memory. No frame may be begun. */
    void (*trim)(void *state);

    /* Optional; NULL = the backend has no devices to list. Lists the devices for sp_probe(); needs
     * no state. */
    void (*probe)(const struct sp_backend_options *options, sp_device_visit *visit, void *user);
};

/* registry.c: the compiled backends in the order in which "auto" tries them; NULL past the end. */
const struct sp_backend *sp_registry_at(unsigned i);

/* choose.c: starts the named backend, or with "auto" the first backend that starts, and sets
 * *state. NULL with *err set if no backend starts. Each refusal is logged and passed to
 * options->refused(). */
const struct sp_backend *sp_registry_start(const char *name,
                                           const struct sp_backend_options *options, void **state,
                                           struct sp_error *err);

/* choose.c: lists the devices of a backend. Each device must pass the checks of a start. */
void sp_registry_probe(const struct sp_backend *backend, const struct sp_backend_options *options,
                       sp_device_visit *visit, void *user);

/* choose.c: like sp_registry_start() with "auto", but only tries the backends after `failed`. */
const struct sp_backend *sp_registry_follow(const struct sp_backend *failed,
                                            const struct sp_backend_options *options, void **state,
                                            struct sp_error *err);

#endif
