/* SPDX-License-Identifier: Apache-2.0
 *
 * What the processor decides of a frame: lists and levels, constants, and in which pieces it is
 * drawn. All the rest happens on the GPU.
 *
 *   layers   0 … … … … … … … … n         sheets, slabs or distances, front to back
 *   batch    |--- 0 ---|- 1 -|-- 2 --|   as many layers as records and bins have room for
 *
 * A brick is in every batch that has one of its layers, with a record for each of its entries. What
 * a batch leaves open (one layer with more entries than there are records) the next one resumes.
 */
#ifndef GL_FRAME_H
#define GL_FRAME_H

#include "backend/backend.h"
#include "backend/gl/levels.h"
#include "backend/gl/program.h"
#include "base/arena.h"
#include "splat/detail.h"
#include "splat/ewa.h"

/* shaders/frame.glsl: std430. */
struct gl_constants {
    struct gl_part {
        float step[3][4], kernel[3][4];
        float view[4], footprint[4], bounds[4];
        uint32_t kind[4];
        float planes[GL_CUTS][4];
    } parts[GL_PARTS]; /* level · 2 + enlarged */
    float to_camera[3][4], phong[4], glint[4];
    struct {
        float direction[4], world[4], color[4];
    } lights[SP_LIGHTS_MAX];
    uint32_t choice[4], picture[4], compose[4];
    float slabs[4], lens[4];
};

/* shaders/10_project.glsl. */
struct gl_brick {
    float base[4];
    uint32_t list[4], place[4];
};

struct gl_batch {
    uint32_t first, layers; /* layers [first, first + layers) */
    uint32_t records;
    bool resumes, stays_open;                     /* in the middle of its layer; then layers = 1 */
    uint32_t brick[SP_LEVELS], bricks[SP_LEVELS]; /* by level: first, count */
};

struct gl_frame {
    const struct sp_grid *grid; /* the volume's */
    const struct gl_list *lists[SP_LEVELS];
    unsigned coarse, finest, axis;
    uint32_t drawn; /* bit l: level l */
    enum sp_compositing compositing;
    bool is_post;
    bool is_enlarged; /* by distance: some brick of the one level is (splat/detail.h) */
    uint32_t stride;  /* of a record, in words of four: shaders/records.glsl */
    double thickness; /* of a layer by distance [cells] … */
    int64_t nearest;  /* … and the first that some brick has, counted from the eye */
    enum sp_filter_mode mode;
    uint64_t visible;   /* voxels of the volume */
    double classify_ms; /* lists: the processor's work and the GPU's, which is waited for */
    struct gl_constants constants;
    uint32_t *sheets; /* [sheet_count]: by sheet, place front to back */
    uint32_t sheet_count;
    uint32_t layer_count; /* of all that is drawn */
    uint32_t spanned;     /* layers that a kernel lies in, at most */
    struct sp_camera_frame camera;
    struct sp_detail detail;
    struct sp_ewa_frame ewa[SP_LEVELS][2];
    const uint8_t *modes[SP_LEVELS][2]; /* adaptive: by brick; else NULL */
    struct gl_item *items;              /* bricks that are not empty, level by level */
    uint32_t item_count;
    struct gl_brick *bricks; /* of the batches, one after the other */
    uint32_t brick_count;
    struct gl_batch *batches;
    uint32_t batch_count;
};

/* The frame of the finest level, as it is drawn by distance. */
static inline const struct sp_ewa_frame *gl_frame_ewa(const struct gl_frame *frame) {
    return &frame->ewa[frame->finest][frame->is_enlarged];
}

/* What of the backend's state a frame needs. */
struct gl_sources {
    struct sp_classify_cache *cache;
    struct gl_lists *lists;
    struct sp_pool *pool;
    struct sp_arena *arena; /* of the frame's memory */
};

/* All but bricks and batches. A context must be current. SP_ERR_MEMORY, SP_ERR_BUDGET,
 * SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_frame_begin(struct gl_frame *frame, const struct sp_backend_job *job,
                    const struct gl_sources *from, struct sp_error *err);

/* Cuts the frame into batches of at most `layers` layers and `records` records, which is at least
 * SP_BRICK_VOXELS; may be called again. False when the arena could not allocate. */
bool gl_frame_cut(struct gl_frame *frame, uint32_t layers, uint32_t records,
                  struct sp_arena *arena);

#endif
