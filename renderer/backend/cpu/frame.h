/* SPDX-License-Identifier: Apache-2.0
 *
 * The data of a frame that the fast path and the general path share: camera, mip levels, classified
 * lists, and the constants for setting up footprints.
 */
#ifndef SP_BACKEND_CPU_FRAME_H
#define SP_BACKEND_CPU_FRAME_H

#include "backend/backend.h"
#include "backend/cpu/kernels.h"
#include "base/arena.h"
#include "classify/cache.h"
#include "draw/layers/cloud/cache.h"
#include "draw/layers/shell/cache.h"
#include "draw/layers/surface/cache.h"
#include "draw/layers/vectors/cache.h"
#include "draw/postconv/postconv.h"
#include "splat/cubic.h"

struct cpu_state {
    struct sp_pool *pool;
    struct sp_arena arena;          /* of one frame */
    struct sp_arena *worker_arenas; /* [threads]: of one frame, for parallel loops */
    struct cpu_kernels kernels;
    struct sp_classify_cache cache;
    struct sp_samples_cache samples; /* of resampled sheets */
    struct sp_light_cache light;     /* of lit sheets */
    struct sp_shell_cache shells;
    struct sp_vectors_cache vectors;
    struct sp_cloud_cache clouds;
    struct sp_surface_cache surfaces;
    uint64_t memory_bytes; /* of all caches */
    struct sp_cubic_table cubic;
    struct sp_postconv_tables postconv;
    char device[SP_DEVICE_NAME];
};

enum cpu_stage { CPU_CLASSIFY, CPU_SPLAT, CPU_BIN, CPU_TILE, CPU_RESOLVE, CPU_STAGES };

struct cpu_frame {
    const struct sp_backend_job *job;
    struct cpu_state *state;
    struct sp_fragments *fragments; /* of other layers; NULL = none */
    double stage_ms[CPU_STAGES];
    struct sp_camera_transform camera;
    struct sp_detail detail; /* the cut: bricks and their mip levels, without clipped bricks */
    unsigned axis;           /* axis of the sheets; SP_NO_AXIS = not sheet compositing */
    unsigned mip_level;      /* as in the job: no finer level is drawn */
    unsigned finest;         /* the finest level that is drawn */
    bool is_enlarged; /* some bricks of this level are enlarged (sp_detail_brick.is_enlarged) */
    uint64_t visible; /* visible voxels of the volume */
    const struct sp_level *levels;
    struct sp_level_frame parts[SP_LEVELS];
    const struct sp_level *level;   /* levels[finest] */
    const struct sp_ewa_frame *ewa; /* of that level */
    struct sp_shade shade;          /* set if the view is lit */
    const struct sp_shade *shading; /* &shade; NULL = not lit */
};

/* Chooses the levels and classifies them. Memory is the state's arena, which the caller has reset.
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool cpu_frame_init(struct cpu_frame *frame, struct cpu_state *state,
                    const struct sp_backend_job *job, struct sp_error *err);

static inline bool cpu_frame_is_cancelled(const struct cpu_frame *frame) {
    return sp_job_is_cancelled(frame->job);
}

/* Adds the time since `since` to a stage and returns the current time [ms]. */
static inline double cpu_frame_add_time(struct cpu_frame *frame, enum cpu_stage stage,
                                        double since) {
    double now = sp_job_clock_ms(frame->job);
    frame->stage_ms[stage] += now - since;
    return now;
}

/* Fills the stats that do not depend on the path. */
static inline void cpu_frame_write_stats(const struct cpu_frame *frame) {
    struct sp_frame_stats *stats = &frame->job->frame->stats;
    stats->mip_level = frame->mip_level;
    stats->visible_voxels = frame->mip_level ? frame->level->visible.count : frame->visible;
}

#endif
