/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws a list of voxels on the CPU, each composited on its own: a shell (shell/) or a layer of
 * vectors (vectors/); or other splats (cloud/). README.md of this folder explains how.
 *
 *   list ─► order ─► records ─► tiles ─┬► image
 *         (order.h)       (kernels.h)  └► fragments
 */
#ifndef SP_SPLAT_LIST_DRAW_H
#define SP_SPLAT_LIST_DRAW_H

#include "draw/layers/splat_list/kernels.h"
#include "draw/layers/splat_list/order.h"
#include "sp/volume.h"

/* Splats of something else than a list of voxels, as points are (cloud/). */
struct sp_voxel_source {
    struct sp_voxel_frame frame;
    struct sp_voxel_order order; /* what the camera may see, front to back */
    sp_voxel_set_up_fn *set_up;
    const void *from;
    uint32_t count;     /* with what the camera cannot see */
    unsigned mip_level; /* at which it is drawn */
};

/* All pointers are borrowed until the frame is drawn. */
struct sp_voxel_input {
    const struct sp_view *view;
    const struct sp_layer *layer;
    const struct sp_grid *grid; /* of the volume */
    const struct sp_voxel_list *list;
    const struct sp_voxel_source *source; /* instead of grid, list and shade; NULL = of the list */
    struct sp_frame *frame; /* sp_voxel_draw(): its pixels; NULL for sp_voxel_prepare() */
    const struct sp_camera_transform *camera;
    const struct sp_shade *shade; /* NULL = not lit */
    const struct sp_voxel_kernels *kernels;
    struct sp_interrupt interrupt;
    bool keeps_hidden; /* draws hidden voxels as well; for tests */
    bool by_depth;     /* voxels of the list come in order of depth: among other layers */
    struct sp_pool *pool;
    struct sp_arena *arena;
};

/* A prepared frame. */
struct sp_voxel_layer {
    const struct sp_voxel_input *input;
    struct sp_voxel_source source;   /* of the input, or of its list */
    int columns, rows;               /* of tiles */
    struct sp_voxel_record *records; /* of the voxels that are in the image */
    uint32_t *first;                 /* [columns · rows + 1] */
    uint32_t *entries;               /* of tile t: record numbers [first[t], first[t + 1]) */
    uint64_t drawn;                  /* records */
    double area;                     /* of their footprints, px */
};

/* Makes the splats of a frame those of a layer of vectors. */
void sp_voxel_init_streaks(const struct sp_layer *layer, const struct sp_camera_transform *camera,
                           struct sp_voxel_frame *frame);

/* Draws a frame that shows nothing but the layer: every pixel, and the stats (visible_voxels: of
 * the list; splats: without hidden ones and those outside of the image). Memory of the frame does
 * not depend on the number of voxels but for 4 bytes each. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_voxel_draw(const struct sp_voxel_input *input, struct sp_error *err);

/* Finds what a layer is drawn from, its `source`. Errors as above. */
bool sp_voxel_source_acquire(const struct sp_voxel_input *input, struct sp_voxel_layer *layer,
                             struct sp_error *err);

/* Prepares the same layer for sp_voxel_tile(). The arena holds about 80 bytes per drawn voxel.
 * Errors as above. */
bool sp_voxel_prepare(const struct sp_voxel_input *input, struct sp_voxel_layer *layer,
                      struct sp_error *err);

/* Adds the fragments of tile (column, row) of SP_FRAGMENT_TILE px to `tile`, which lies there.
 * Splats of a pixel at about the same depth become one fragment at their mean depth (kernels.h).
 * Tiles may be drawn on several threads at a time. */
void sp_voxel_tile(const struct sp_voxel_layer *layer, int column, int row,
                   struct sp_fragment_tile *tile);

#endif
