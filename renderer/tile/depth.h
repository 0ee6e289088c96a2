/* SPDX-License-Identifier: Apache-2.0
 *
 * The order of voxels by distance from the eye: layers of equal thickness, what slabs and single
 * splats are composited in.
 *
 *   layer of a voxel = ⌊(distance − reach)/thickness⌋, counted from the first that is not empty
 *
 * Inside a layer voxels stay in the order of the list. Distances are those of sp_ewa_distance().
 */
#ifndef SP_TILE_DEPTH_H
#define SP_TILE_DEPTH_H

#include "base/arena.h"
#include "base/parallel_for.h"
#include "tile/order.h"

struct sp_depth_job {
    const struct sp_ewa_frame *frame;
    const struct sp_visible *list;
    unsigned level; /* of the list, for the runs; all of it is drawn */
    bool is_enlarged;
    double
        thickness; /* cells, > 0; made larger where the volume would have more than 65,000 layers */
    double reach;  /* cells before a voxel where its kernel begins; single splats: 0 */
    struct sp_pool *pool;
    struct sp_arena *arena;
};

/* The thickness that sp_order_distance() will use. */
double sp_depth_thickness(const struct sp_ewa_frame *frame, double thickness, double reach);

/* Fills *order from the arena; *nearest is the distance where layer 0 begins [cells]. False when
 * the arena could not allocate. */
bool sp_order_distance(const struct sp_depth_job *job, struct sp_order *order, double *nearest);

#endif
