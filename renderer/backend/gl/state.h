/* SPDX-License-Identifier: Apache-2.0
 *
 * One frame on the GPU.
 *
 *   classify, make_level (mip_levels.h): lists, if the processor finds that they must change
 *   ─► for each band of tiles, for each batch of layers in it:
 *
 *     project                  entry → record; counts its pairs by tile and layer
 *     scan_bins, scan_totals   counts → where each bin begins
 *     scatter                  records → bins: by tile, in it by layer
 *     sort_bins                single splats only: sorts a bin in the order of its records
 *     composite                per tile: sums layers, classifies (order post), composites
 *
 *   ─► resolve ─► read back
 *
 * Bands bound the memory for pixels, batches the memory for records and bins. Pairs of a record and
 * a tile are counted before they are written. If there are more than the buffer can hold, nothing
 * is drawn, and the band is drawn again with a larger buffer or in smaller pieces (workload.h).
 * So every pair is drawn, and the CPU never waits for a counter in the middle of a frame.
 */
#ifndef GL_STATE_H
#define GL_STATE_H

#include "backend/gl/bins.h"
#include "backend/gl/buffer.h"
#include "backend/gl/context.h"
#include "backend/gl/curve.h"
#include "backend/gl/frame.h"
#include "backend/gl/layers.h"
#include "backend/gl/program.h"
#include "backend/gl/readback.h"
#include "backend/gl/resample_programs.h"
#include "backend/gl/timer.h"
#include "backend/gl/upload.h"
#include "backend/gl/workload.h"
#include "draw/resample/levels.h"

/* The measured stages of a frame, in order. */
enum gl_stage {
    GL_STAGE_CLASSIFY,
    GL_STAGE_SPLAT,
    GL_STAGE_BIN,
    GL_STAGE_TILE,
    GL_STAGE_RESOLVE,
    GL_STAGE_READ,   /* readback: the copies by the GPU and by the processor */
    GL_STAGE_LAYERS, /* other than the volume */
    GL_STAGES
};

/* The data from which a frame is drawn. */
enum gl_path {
    GL_PATH_SPLATS,
    GL_PATH_RESAMPLED, /* resample.h */
    GL_PATH_LAYERS     /* no volume, but perhaps other layers (fragments.h) */
};

enum { GL_IN_FLIGHT = 2 }; /* frames that may be in flight */

/* A frame in flight: the bands above row y are in its image, and the GPU draws the rows [y, end);
 * if end is y, nothing was submitted yet. Each frame has its own readback and time stamps. Frames
 * share all other buffers, because GL runs their commands in order. */
struct gl_slot {
    struct gl_readback readback;
    struct gl_timer timer;
    struct gl_pieces pieces;
    uint32_t y, end; /* px */
    double stage_ms[GL_STAGES];
    uint64_t visible, splats, fragments; /* as in sp_frame_stats */
    unsigned mip_level;
    enum gl_path path;
    float depth_origin;      /* of frames with depth: depths on the GPU count from here */
    bool has_pieces;         /* splats of the volume, or elements */
    bool has_layers;         /* other than the volume, or none at all */
    uint32_t fragments_most; /* most fragments of other layers in the memory of the band */
    uint64_t frames;         /* number of frames that used this slot */
};

struct gl_state {
    struct gl_options options;  /* of the context */
    uint64_t video_bytes;       /* as in sp_backend_options */
    struct gl_context *context; /* NULL = lost; the next frame creates another */
    struct sp_pool *pool;       /* classifies, and fills uploads */
    struct sp_arena arena;
    uint64_t memory_bytes; /* as in sp_backend_options: limit of the caches of the processor */
    struct sp_classify_cache cache;
    struct sp_samples_cache samples;
    struct gl_layers layers;
    struct gl_residency residency;
    struct gl_slot slots[GL_IN_FLIGHT];
    unsigned oldest, begun; /* slots in use: `begun` of them from `oldest` on, cyclically */
    struct gl_bins bins;
    struct gl_curve curve;
    struct gl_partition partition;
    struct gl_upload upload;
    struct gl_resample resample;
    struct gl_surfaces_kept {
        struct gl_late_program program;
        struct gl_buffer constants[SP_LAYERS_MAX];
        double per_pixel; /* fragments per pixel for which the band has memory */
    } surfaces;
    struct {
        struct gl_late_program set_up[GL_SPLAT_KINDS], blend[GL_SPLAT_KINDS][2]; /* 1: alone */
        struct gl_buffer constants[SP_LAYERS_MAX], order[SP_LAYERS_MAX], choice[SP_LAYERS_MAX];
    } splats;
    struct {
        struct gl_late_program depths, digits, starts, move;
    } depth_order;
    struct {
        struct gl_late_program triangles, samples;
        struct gl_buffer constants[SP_LAYERS_MAX];
    } meshes;
    unsigned project, resolve; /* programs */
    /* Programs that are compiled when a view first needs them. The compositor by compositing,
     * kernel (Gaussian, cubic, flat), clipping planes, linear attenuation, classification of
     * pixels, and other layers.
     */
    struct gl_late_program fragments, composite[3][2][2][2][2][2][2];
    struct {
        struct gl_buffer records, spans, image, cubic, pixels, fragments, sheets, items[2], digits,
            range;
    } buffers;
    struct gl_workload workload;
    uint64_t needed; /* most pairs of a batch since memory.c reset it */
    uint64_t block_bytes;
    char device[SP_DEVICE_NAME];
};

/* Submits a frame to the GPU after the begun frames; at most GL_IN_FLIGHT frames are begun. If the
 * submission would have to wait for one of them, it happens only when they have ended. After a
 * failure the frame is not in flight. The context must be current. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_draw_begin(struct gl_state *state, const struct sp_backend_job *job, struct sp_error *err);

/* Waits for the oldest frame in flight, with the same job, and fills its pixels and stats.
 * Afterwards it is no longer in flight, whatever the result. Bands that did not fit are drawn again
 * here. */
bool gl_draw_end(struct gl_state *state, const struct sp_backend_job *job, struct sp_error *err);

/* Returns the bytes of video memory besides samples and lists. */
uint64_t gl_draw_bytes(const struct gl_state *state);

/* Abandons all begun frames. The context must be current. */
void gl_draw_drop(struct gl_state *state);

/* Creates the programs and tables that do not change. Call gl_draw_finish() also after a failure;
 * then the state can be initialised again, also in another context. */
bool gl_draw_init(struct gl_state *state, struct sp_error *err);
void gl_draw_finish(struct gl_state *state);

#endif
