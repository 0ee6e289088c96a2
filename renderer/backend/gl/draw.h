/* SPDX-License-Identifier: Apache-2.0
 *
 * One frame on the GPU.
 *
 *   classify (processor, frame.h) ─► for each band of tiles, for each batch of layers in it:
 *
 *     10_project    entry → record; its pairs are counted by tile and layer
 *     20, 21        counts → where each bin begins
 *     22_scatter    records → bins: by tile, in it by layer
 *     23_order      single splats alone: a bin in the order of its records
 *     30_composite  a tile: layers summed, classified (order post), composited
 *
 *   ─► 40_resolve ─► read back
 *
 * Bands bound the memory of pixels, batches that of records and bins. Pairs of a record and a tile
 * are counted before they are written: where they are more than there is room for, nothing is
 * drawn, and the band is drawn again with more room, or in smaller pieces. So nothing is read back
 * in the middle of a frame, and nothing is left out.
 */
#ifndef GL_DRAW_H
#define GL_DRAW_H

#include "backend/gl/bins.h"
#include "backend/gl/buffer.h"
#include "backend/gl/context.h"
#include "backend/gl/curve.h"
#include "backend/gl/frame.h"
#include "backend/gl/timer.h"

/* Sizes of the pieces that a frame is drawn in. They bound memory, and what one dispatch takes. */
struct gl_limits {
    uint32_t records; /* of a batch */
    uint32_t bins;    /* of a batch: tiles times layers, but one layer at least */
    uint32_t tiles;   /* of a band, but one row at least */
    uint64_t pairs;   /* of a batch */
    uint32_t loops;   /* rounds of all loops of one invocation */
};

struct gl_state {
    struct gl_options options;  /* of the context */
    struct gl_context *context; /* NULL = was lost; the next frame makes another */
    struct sp_pool *pool;       /* classifies, and fills what is uploaded */
    struct sp_arena arena;
    struct sp_classify_cache cache;
    struct gl_lists lists;
    struct gl_timer timer;
    struct gl_bins bins;
    struct gl_curve curve;
    unsigned project, resolve; /* programs */
    /* The compositor's, made when they are first asked for: 0 = not yet. By compositing, kernel
     * (Gaussian, cubic, flat), whether planes clip, attenuation is linear, pixels are classified.
     */
    unsigned composite[3][2][2][2][2][2];
    struct {
        struct gl_buffer constants, bricks, records, spans, image, cubic, pixels, back;
    } buffers;
    struct gl_limits limits;
    uint64_t pairs; /* room for them */
    /* Most records and layers of a batch, and rows of tiles of a band: fewer after one was too
     * much. */
    uint32_t records, layers, rows;
    uint64_t block_bytes;
    char device[SP_DEVICE_NAME];
};

/* The context must be current. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_draw(struct gl_state *state, const struct sp_backend_job *job, struct sp_error *err);

/* Programs and tables that do not change; what was made before a failure is gl_draw_finish()'s.
 * After that a state can be initialised again, in another context too. */
bool gl_draw_init(struct gl_state *state, struct sp_error *err);
void gl_draw_finish(struct gl_state *state);

#endif
