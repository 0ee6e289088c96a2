/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of a frame that the processor computes: mip levels, changes of lists, the partition, and
 * constants. The GPU does everything else.
 */
#ifndef GL_FRAME_H
#define GL_FRAME_H

#include "backend/backend.h"
#include "backend/gl/mip_levels.h"
#include "backend/gl/partition.h"
#include "backend/gl/program.h"
#include "base/arena.h"
#include "splat/detail.h"
#include "splat/ewa.h"

/* shaders/frame.glsl: std430. */
struct gl_constants {
    float to_camera[3][4], phong[4], glint[4];
    uint32_t choice[4], image_info[4], compose[4];
    float slabs[4], lens[4];
    struct gl_light {
        float direction[4], world[4], color[4];
    } lights[GL_LIGHTS];
    struct gl_part {
        float step[3][4], kernel[3][4];
        float view[4], footprint[4], bounds[4];
        uint32_t kind[4], rows[4], dims[4], origin[4];
    } parts[GL_PARTS]; /* level · 2 + enlarged */
    float planes[GL_PARTS][GL_CLIP_PLANES][4];
};

struct gl_frame {
    const struct sp_grid *grid; /* the volume's */
    const struct gl_visible_list *lists[SP_LEVELS];
    unsigned mip_level, finest, axis;
    uint32_t drawn; /* bit l: level l */
    uint32_t parts; /* bit 2l + enlarged: some bricks of level l are drawn this way */
    enum sp_compositing compositing;
    bool is_post;
    bool is_enlarged;   /* by distance: some bricks of the level are enlarged (splat/detail.h) */
    bool has_depths;    /* records say where kernels lie along the ray */
    uint32_t stride;    /* of a record, in words of four: shaders/records.glsl */
    double thickness;   /* of a layer by distance [cells] */
    double reach;       /* by distance: most that a kernel reaches along the ray [cells] */
    uint64_t visible;   /* voxels of the volume */
    double classify_ms; /* time for lists: processor time and waiting for the GPU [ms] */
    struct gl_constants constants;
    struct sp_camera_transform camera;
    struct sp_detail detail;
    struct sp_ewa_frame ewa[SP_LEVELS][2];
};

/* Returns the constants of the finest level, for layers by distance. */
static inline const struct sp_ewa_frame *gl_frame_ewa(const struct gl_frame *frame) {
    return &frame->ewa[frame->finest][frame->is_enlarged];
}

/* The parts of the backend's state that a frame needs. */
struct gl_sources {
    struct sp_classify_cache *cache;
    struct gl_residency *residency;
    struct sp_pool *pool;
    struct sp_arena *arena; /* of the frame's memory */
    struct gl_partition *partition;
};

/* Writes the constants for shading: all fields up to the lights, except the fields that describe
 * layers. */
void gl_frame_write_shading(struct gl_constants *constants,
                            const struct sp_camera_transform *camera, const struct sp_view *view);

/* Prepares a frame: its levels, lists and layers. A context must be current. SP_ERR_MEMORY,
 * SP_ERR_BUDGET, SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_frame_begin(struct gl_frame *frame, const struct sp_backend_job *job,
                    const struct gl_sources *from, struct sp_error *err);

/* Writes clip planes as shaders read them. */
void gl_write_planes(float (*to)[4], const struct sp_clip_frame *clip);

#endif
