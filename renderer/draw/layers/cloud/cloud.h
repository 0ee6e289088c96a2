/* SPDX-License-Identifier: Apache-2.0
 *
 * Clouds: points, with streaks along their vectors or without, and trained Gaussians, which have
 * positions and variances of their own instead of a grid. They are drawn as lists of voxels are
 * (draw/layers/splat_list/draw.h), front to back.
 *
 *   points     ─► sp_cloud_prepare(): placed, culled, sorted by depth ─► set_up ─► voxels/
 *   Gaussians  ─► sp_cloud_prepare(): set_up, sorted by depth ─► voxels/
 *
 * README.md of this folder has the formulas.
 */
#ifndef SP_CLOUD_CLOUD_H
#define SP_CLOUD_CLOUD_H

#include "classify/transfer.h"
#include "draw/layers/cloud/cache.h"
#include "draw/layers/cloud/kernels.h"
#include "draw/layers/splat_list/draw.h"

/* All pointers are borrowed until the frame is drawn. */
struct sp_cloud_input {
    const struct sp_view *view;
    const struct sp_layer *layer;  /* of type SP_LAYER_POINTS, SP_LAYER_GAUSSIANS, or of
                                      SP_LAYER_VECTORS for points with vectors */
    struct sp_volume *shown;       /* with the elements of the layer */
    struct sp_volume *colors;      /* that layer->color_by names; NULL = none */
    const struct sp_grid *clipped; /* of the frame's volume: what the clip box is a fraction of */
    const struct sp_camera_transform *camera;
    sp_voxel_set_up_fn *set_up; /* sp_cloud_set_up(); NULL = elements are chosen and not sorted */
    struct sp_cloud_cache *trees;
    uint64_t bytes_max; /* of the trees */
    unsigned mip_level; /* points are merged up to 4 px at level 1, 8 at 2; 0 = half a pixel */
    struct sp_interrupt interrupt;
    struct sp_pool *pool;
    struct sp_arena *arena;
};

/* Prepares the layer for draw/layers/splat_list/draw.h: elements that the camera may see, or their
 * splats, front to back by the depth of their centres. Those behind the near plane, those whose
 * centre is clipped, transparent ones and those that are not finite are left out. Many points are
 * drawn with levels of detail (tree.h). Without set_up, `order` has what is drawn of the levels of
 * detail, in no order and with what cannot be seen; voxels NULL = all elements. Valid until the
 * arena is reset. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_cloud_prepare(const struct sp_cloud_input *input, struct sp_cloud *cloud,
                      struct sp_voxel_source *source, struct sp_error *err);

#endif
