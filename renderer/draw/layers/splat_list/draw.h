/* SPDX-License-Identifier: Apache-2.0
 *
 * Draws a list of voxels on the CPU and composites each voxel on its own: a shell (shell/) or a
 * layer of vectors (vectors/). Also draws other splats (cloud/). README.md of this folder explains
 * how.
 *
 *   list ─► order ─► records ─► tiles ─┬► image
 *         (order.h)       (kernels.h)  └► fragments
 */
#ifndef SP_SPLAT_LIST_DRAW_H
#define SP_SPLAT_LIST_DRAW_H

#include "draw/layers/splat_list/kernels.h"
#include "draw/layers/splat_list/order.h"
#include "sp/volume.h"

/* A source of splats other than a list of voxels, for instance points (cloud/). */
struct sp_voxel_source {
    struct sp_voxel_frame frame;
    struct sp_voxel_order order; /* elements that the camera may see, front to back */
    sp_voxel_set_up_fn *set_up;
    const void *from;
    uint32_t count;     /* all elements, also elements that the camera cannot see */
    unsigned mip_level; /* at which it is drawn */
};

/* All pointers are borrowed until the frame is drawn. */
struct sp_voxel_input {
    const struct sp_view *view;
    const struct sp_layer *layer;
    const struct sp_grid *grid; /* of the volume */
    const struct sp_voxel_list *list;
    const struct sp_voxel_source *source; /* instead of grid, list and shade; NULL = the list */
    struct sp_frame *frame; /* sp_voxel_draw(): its pixels; NULL for sp_voxel_prepare() */
    const struct sp_camera_transform *camera;
    const struct sp_shade *shade; /* NULL = not lit */
    const struct sp_voxel_kernels *kernels;
    struct sp_interrupt interrupt;
    bool keeps_hidden; /* draws hidden voxels as well; for tests */
    bool by_depth;     /* sort the voxels of the list by depth: for use among other layers */
    struct sp_pool *pool;
    struct sp_arena *arena;
};

/* A prepared frame. */
struct sp_voxel_layer {
    const struct sp_voxel_input *input;
    struct sp_voxel_source source;   /* the input's source, or one made from its list */
    int columns, rows;               /* of tiles */
    struct sp_voxel_record *records; /* of the voxels that are in the image */
    uint32_t *first;                 /* [columns · rows + 1] */
    uint32_t *entries;               /* of tile t: record numbers [first[t], first[t + 1]) */
    uint64_t drawn;                  /* records */
    double area;                     /* of their footprints, px */
};

/* Changes the splats of a frame to the splats of a layer of vectors. */
void sp_voxel_init_streaks(const struct sp_layer *layer, const struct sp_camera_transform *camera,
                           struct sp_voxel_frame *frame);

/* Draws a frame that shows only the layer: fills every pixel and the stats. visible_voxels counts
 * the voxels of the list; splats does not count hidden voxels and voxels outside the image. The
 * frame needs 4 bytes per voxel; the rest of its memory does not depend on the number of voxels.
 * SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_voxel_draw(const struct sp_voxel_input *input, struct sp_error *err);

/* Sets layer->source, from which the layer is drawn. Errors as above. */
bool sp_voxel_source_acquire(const struct sp_voxel_input *input, struct sp_voxel_layer *layer,
                             struct sp_error *err);

/* Prepares a layer for sp_voxel_tile(). The arena holds about 80 bytes per drawn voxel. Errors as
 * above. */
bool sp_voxel_prepare(const struct sp_voxel_input *input, struct sp_voxel_layer *layer,
                      struct sp_error *err);

/* Adds the fragments of the layer in tile (column, row) of SP_FRAGMENT_TILE px to `tile`, which
 * lies at the same place. Splats of a pixel at about the same depth become one fragment at their
 * mean depth (kernels.h). Several threads may draw different tiles at a time. */
void sp_voxel_tile(const struct sp_voxel_layer *layer, int column, int row,
                   struct sp_fragment_tile *tile);

#endif
