/* SPDX-License-Identifier: Apache-2.0
 *
 * One frame on the GPU.
 *
 *   00_classify, 01_mip (levels.h): lists, where the processor finds that they have to change
 *   ─► for each band of tiles, for each batch of layers in it:
 *
 *     10_project    entry → record; its pairs are counted by tile and layer
 *     20, 21        counts → where each bin begins
 *     22_scatter    records → bins: by tile, in it by layer
 *     23_order      single splats alone: a bin in the order of its records
 *     30_composite  a tile: layers summed, classified (order post), composited; in turns
 *
 *   ─► 40_resolve ─► read back
 *
 * Bands bound the memory of pixels, batches that of records and bins. Pairs of a record and a tile
 * are counted before they are written: where they are more than there is room for, nothing is
 * drawn, and the band is drawn again with more room, or in smaller pieces (room.h). So nothing is
 * read back in the middle of a frame, and nothing is left out.
 */
#ifndef GL_DRAW_H
#define GL_DRAW_H

#include "backend/gl/bins.h"
#include "backend/gl/buffer.h"
#include "backend/gl/context.h"
#include "backend/gl/curve.h"
#include "backend/gl/frame.h"
#include "backend/gl/readback.h"
#include "backend/gl/timer.h"
#include "backend/gl/upload.h"
#include "backend/gl/workload.h"

/* What a frame's times are kept of, in the order of its stages. */
enum gl_stage {
    GL_STAGE_CLASSIFY,
    GL_STAGE_SPLAT,
    GL_STAGE_BIN,
    GL_STAGE_TILE,
    GL_STAGE_RESOLVE,
    GL_STAGE_READ, /* what the GPU copies for the processor, and the processor from there */
    GL_STAGES
};

enum { GL_IN_FLIGHT = 2 }; /* frames that may be begun and not ended */

/* A frame that was begun: the bands above row y are in its picture, and the GPU draws the rows
 * [y, end), unless end is y: then nothing was handed over yet. All that it has for itself is where
 * its picture and its times come back: what one frame writes for the GPU and what the GPU writes
 * for itself is taken by the next in the order in which they were begun, which GL keeps. */
struct gl_slot {
    struct gl_readback readback;
    struct gl_timer timer;
    struct gl_pieces pieces;
    uint32_t y, end; /* px */
    double stage_ms[GL_STAGES];
    uint64_t visible, splats, fragments; /* as in sp_frame_stats */
    unsigned mip_level;
    uint64_t frames; /* that it was used for */
};

struct gl_state {
    struct gl_options options;  /* of the context */
    uint64_t video_bytes;       /* as in sp_backend_options */
    struct gl_context *context; /* NULL = was lost; the next frame makes another */
    struct sp_pool *pool;       /* classifies, and fills what is uploaded */
    struct sp_arena arena;
    struct sp_classify_cache cache;
    struct gl_residency residency;
    struct gl_slot slots[GL_IN_FLIGHT];
    unsigned oldest, begun; /* slots in use: `begun` of them from `oldest` on, round the end */
    struct gl_bins bins;
    struct gl_curve curve;
    struct gl_partition partition;
    struct gl_upload upload;
    unsigned project, resolve; /* programs */
    /* The compositor's, made when they are first asked for: 0 = not yet, or the driver does not
     * compile it, and is not asked again. By compositing, kernel
     * (Gaussian, cubic, flat), whether planes clip, attenuation is linear, pixels are classified.
     */
    struct gl_compositor {
        unsigned program;
        bool is_refused;
    } composite[3][2][2][2][2][2];
    struct {
        struct gl_buffer records, spans, image, cubic, pixels;
    } buffers;
    struct gl_workload workload;
    uint64_t needed; /* pairs, the most that a batch had; memory.c sets it back */
    uint64_t block_bytes;
    char device[SP_DEVICE_NAME];
};

/* Hands a frame over to the GPU, behind those that were begun before; at most GL_IN_FLIGHT. Where
 * that would take waiting for one of them, nothing is handed over before they are ended. Nothing is
 * begun after a failure. The context must be current. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_draw_begin(struct gl_state *state, const struct sp_backend_job *job, struct sp_error *err);

/* Waits for the oldest frame that was begun, with the same job, and fills its pixels and stats. It
 * is no longer begun then, whatever comes of it. What it had no room for is drawn again here. */
bool gl_draw_end(struct gl_state *state, const struct sp_backend_job *job, struct sp_error *err);

/* Bytes of video memory beside those of lists. */
uint64_t gl_draw_bytes(const struct gl_state *state);

/* Leaves all frames that were begun. The context must be current. */
void gl_draw_drop(struct gl_state *state);

/* Programs and tables that do not change; what was made before a failure is gl_draw_finish()'s.
 * After that a state can be initialised again, in another context too. */
bool gl_draw_init(struct gl_state *state, struct sp_error *err);
void gl_draw_finish(struct gl_state *state);

#endif
