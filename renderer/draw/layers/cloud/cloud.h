/* SPDX-License-Identifier: Apache-2.0
 *
 * Clouds: points, with or without streaks along their vectors, and trained Gaussians. Their
 * elements have positions and variances of their own instead of a grid. Clouds are drawn like lists
 * of voxels (draw/layers/splat_list/draw.h), front to back.
 *
 *   points     ─► sp_cloud_prepare(): placed, culled, sorted by depth ─► set_up ─► splat_list/
 *   Gaussians  ─► sp_cloud_prepare(): set_up, sorted by depth ─► splat_list/
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
    struct sp_volume *volume;      /* has the elements of the layer */
    struct sp_volume *colors;      /* the volume that layer->color_by names; NULL = none */
    const struct sp_grid *clipped; /* grid of the frame's volume, to which the clip box refers */
    const struct sp_camera_transform *camera;
    sp_voxel_set_up_fn *set_up; /* sp_cloud_set_up(); NULL = elements are chosen, but not sorted */
    struct sp_cloud_cache *trees;
    uint64_t bytes_max; /* of the trees */
    unsigned mip_level; /* points are merged up to 4 px at level 1, 8 at 2; 0 = half a pixel */
    struct sp_interrupt interrupt;
    struct sp_pool *pool;
    struct sp_arena *arena;
};

/* Prepares the layer for draw/layers/splat_list/draw.h: the elements that the camera may see, or
 * their splats, front to back by the depth of their centres. Leaves out elements that
 * do not reach beyond the near plane, elements whose centre is clipped, transparent elements, and
 * elements that are not finite. Large clouds of points are drawn with levels of detail (tree.h).
 * Without set_up, `order` has the chosen points and merged points in no particular order, also
 * invisible ones; order.voxels NULL = all elements. Valid until the arena is reset. SP_ERR_MEMORY,
 * SP_ERR_CANCELLED. */
bool sp_cloud_prepare(const struct sp_cloud_input *input, struct sp_cloud *cloud,
                      struct sp_voxel_source *source, struct sp_error *err);

#endif
