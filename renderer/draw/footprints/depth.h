/* SPDX-License-Identifier: Apache-2.0
 *
 * Orders voxels by distance from the eye, in layers of equal thickness, for slabs and single
 * splats.
 *
 *   layer of a voxel = ⌊(distance − reach)/thickness⌋, counted from the first that is not empty
 *
 * Bricks that the frame's clip planes remove are left out. Inside a layer, voxels stay in the order
 * of the list. sp_ewa_distance() computes the distances.
 */
#ifndef SP_FOOTPRINTS_DEPTH_H
#define SP_FOOTPRINTS_DEPTH_H

#include "base/arena.h"
#include "base/parallel_for.h"
#include "draw/footprints/order.h"

struct sp_depth_job {
    const struct sp_ewa_frame *frame;
    const struct sp_visible *list;
    unsigned level; /* mip level of the list; all of it is drawn */
    bool is_enlarged;
    double
        thickness; /* of a layer [cells], > 0; enlarged if there would be more than 65,000 layers */
    double reach;  /* distance from a kernel's near end to its voxel [cells]; single splats: 0 */
    struct sp_pool *pool;
    struct sp_arena *arena;
};

/* Returns the thickness that sp_order_distance() will use. */
double sp_depth_thickness(const struct sp_ewa_frame *frame, double thickness, double reach);

/* Fills *order with memory of the arena. Sets *nearest to the distance at which layer 0 begins
 * [cells]. False if the arena cannot allocate. */
bool sp_order_distance(const struct sp_depth_job *job, struct sp_order *order, double *nearest);

#endif
