/* SPDX-License-Identifier: Apache-2.0
 *
 * A frame: one finished image, reference-counted. A pool recycles the memory of frames, so that a
 * stream of frames of one size allocates once. Row 0 is the top row.
 */
#ifndef SP_FRAME_H
#define SP_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Both formats hold the image over the view's background. */
enum sp_pixel_format {
    SP_RGBA8,  /* 4 bytes per pixel: sRGB display values, straight (not premultiplied) alpha */
    SP_RGBAF32 /* 4 floats per pixel: display values, premultiplied alpha; an opaque background
                  gives alpha 1 */
};

enum { SP_STAGES_MAX = 8, SP_DEVICE_NAME = 128 };

struct sp_stage_time {
    const char *name; /* constant: "classify", "light", "splat", "bin", "tile", "resolve"; on a GPU
                         also "read" */
    double ms;        /* wall-clock time of the stage, >= 0 */
};

/* How completely a frame shows a volume that is larger than memory (sp/bricks.h). For other volumes
 * all fields are 0. */
struct sp_frame_bricks {
    bool is_incomplete; /* finer samples are being read, or some bricks are damaged */
    bool is_being_read; /* a later frame of the same view shows more of them */
    /* level of the samples, or of the colours of streaks if those are coarser: 0 = all voxels; in
     * brick files, a sample of level n stands for 2^n × 2^n × 2^n voxels */
    uint32_t level;
    uint32_t asked; /* the level that the pixels ask for; `level` is coarser if the memory does not
                       suffice */
    uint64_t wanted, resident; /* bricks that the frame needs, and how many of them it shows */
    uint64_t lost;             /* wanted bricks that cannot be read; coarser samples replace them */
    uint32_t lost_box[2][3]; /* voxels of one lost brick: the first voxel, and one past the last */
    uint64_t memory_bytes;   /* bytes of the volume's samples in memory, for all frames together */
};

/* True if the frame shows all that its pixels ask for. */
static inline bool sp_frame_bricks_is_complete(const struct sp_frame_bricks *bricks) {
    return !bricks->is_incomplete && bricks->level <= bricks->asked;
}

/* How a frame was drawn. All fields are set by the renderer. */
struct sp_frame_stats {
    const char *backend;         /* constant: "cpu", "gl", "null", … */
    const char *isa;             /* constant: instruction set, "scalar", "avx2", …; "" = none */
    char device[SP_DEVICE_NAME]; /* name of the CPU or GPU */
    uint32_t threads;            /* render threads of the backend */
    uint32_t mip_level; /* [0, SP_MIP_LEVEL_MAX]; n = 2^n × 2^n × 2^n voxels averaged into one;
                           0 = full detail */
    bool is_draft;      /* the frame may differ from a whole one (sp_render_options.draft) */
    struct sp_frame_bricks bricks;
    uint64_t visible_voxels; /* voxels that are visible after classification; for a surface, its
                                points */
    uint64_t splats;         /* footprints that were drawn, not counting culled footprints */
    uint64_t fragments;      /* area of these footprints inside the image [px], before early
                                termination */
    double render_ms;        /* wall-clock time of the renderer's calls for this frame */
    double cpu_ms;           /* CPU time of these calls, summed over all threads */
    uint32_t stage_count;    /* [0, SP_STAGES_MAX] */
    struct sp_stage_time stages[SP_STAGES_MAX]; /* in the order in which the stages ran */
};

struct sp_frame {
    uint32_t width, height; /* px, [1, SP_SIZE_MAX] */
    enum sp_pixel_format format;
    size_t stride_bytes; /* bytes from row to row; a multiple of 64 */
    void *pixels;        /* height · stride_bytes bytes, 64-byte aligned; owned by the frame */
    bool is_opaque;      /* true = every alpha is 1, to 8 bits; false = not known */
    /* The depth of what each pixel shows, and its spread: height rows of depth_stride_bytes, width
     * floats each, 64-byte aligned; owned by the frame. Both NULL = the frame has no depth
     * (sp_render_options.wants_depth). See below. */
    float *depth, *spread;
    size_t depth_stride_bytes; /* a multiple of 64; 0 = no depth */
    struct sp_frame_stats stats;
};

/* Depth z of a point is its distance from the plane of the eye along the view direction [world
 * unit], not along the ray; in orthographic projection it may be negative. A pixel shows intervals
 * of the volume and elements of other layers, each of opacity α behind the transmittance T. Its
 * depth and spread are the mean and the standard deviation of their depths, weighted by what each
 * adds to the opacity of the pixel:
 *
 *   depth = Σ T α z / Σ T α        spread = √(Σ T α z² / Σ T α − depth²)   [world unit, ≥ 0]
 *
 * The background counts for nothing. A pixel whose opacity is below SP_DEPTH_ALPHA_MIN shows
 * nothing: its depth is +infinity and its spread 0. All other depths are finite; in perspective
 * they are at least the depth of the near plane. A spread far below
 * the depth of the scene says that the pixel shows a surface, a large one that it shows haze, or
 * several surfaces.
 *
 * Depth belongs to the ray of the pixel. The low-pass filter of pixels (frame/antialias.h) does not
 * mix depths: beside a silhouette a pixel may have some colour of its neighbours and no depth. A
 * maximum or minimum has the depth where its ray meets the value, and a spread of 0. */
#define SP_DEPTH_ALPHA_MIN (1.0f / 1024)

struct sp_frame_pool; /* opaque */
struct sp_budget;     /* sp/budget.h */

/* Creates a pool that keeps at most cap_bytes of idle frame memory for reuse (0 = none). Returns
 * NULL on failure: SP_ERR_MEMORY. Thread-safe. */
SP_API struct sp_frame_pool *sp_frame_pool_create(size_t cap_bytes, struct sp_error *err);
/* Accepts a NULL pool and nulls *pool. Frames that are still referenced stay valid; their memory is
 * freed with their last reference. */
SP_API void sp_frame_pool_destroy(struct sp_frame_pool **pool);

/* Makes the pool acquire the memory of its frames from the budget (sp/budget.h, SP_BUDGET_IMAGES).
 * Idle frames count as well. The budget must outlive the pool and its frames. Call it before the
 * first frame. */
SP_API void sp_frame_pool_set_budget(struct sp_frame_pool *pool, struct sp_budget *budget);
/* Frees the memory of idle frames. Thread-safe. */
SP_API void sp_frame_pool_trim(struct sp_frame_pool *pool);

/* Returns one reference to a frame with uninitialised pixels. width and height in px, [1,
 * SP_SIZE_MAX]. Returns NULL on failure: SP_ERR_MEMORY, SP_ERR_FRAME_BUDGET. Thread-safe. */
SP_API struct sp_frame *sp_frame_create(struct sp_frame_pool *pool, uint32_t width, uint32_t height,
                                        enum sp_pixel_format format, struct sp_error *err);
/* The same with planes for depth and spread, uninitialised. */
SP_API struct sp_frame *sp_frame_create_with_depth(struct sp_frame_pool *pool, uint32_t width,
                                                   uint32_t height, enum sp_pixel_format format,
                                                   struct sp_error *err);
/* Adds a reference and returns its argument. Thread-safe. */
SP_API struct sp_frame *sp_frame_ref(struct sp_frame *frame);
/* Drops a reference and nulls *frame, which may be NULL. The last reference gives the memory back
 * to the pool. Thread-safe. */
SP_API void sp_frame_unref(struct sp_frame **frame);

#ifdef __cplusplus
}
#endif

#endif
