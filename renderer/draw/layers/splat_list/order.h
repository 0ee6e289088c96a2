/* SPDX-License-Identifier: Apache-2.0
 *
 * The order in which the voxels of a list are drawn, front to back, without those that the eye
 * cannot see (Botha and Post 2003, section 2.2; perspective is their future work).
 *
 *   along each axis     slices away from the eye, on either side of it (splat/slices.h)
 *   slices of the major axis ─► rows ─► voxels of a row
 *
 * Each index moves away from the eye along its axis. A ray keeps to one side of each of the three
 * planes through the eye, that is, to one of at most eight parts; so it meets the cells of voxels
 * in this order, whichever way the parts are interleaved. Slices of the major axis come first
 * because they are closest to perpendicular to the view: Gaussians reach beyond their cells, and
 * within such a slice they have nearly the same distance.
 *
 * Among other layers they are sorted by the depth of their centres instead (by_depth), which makes
 * the splats of a pixel fragments in order of depth.
 *
 * Hidden: a face of a voxel's cell is turned to the eye if the eye lies beyond the face's plane; at
 * most three are. A voxel is hidden if the neighbours on all of these faces are opaque.
 */
#ifndef SP_SPLAT_LIST_ORDER_H
#define SP_SPLAT_LIST_ORDER_H

#include "base/arena.h"
#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "draw/layers/splat_list/list.h"
#include "splat/camera.h"

struct sp_voxel_order_job {
    const struct sp_voxel_list *list;
    const struct sp_camera_transform *camera;
    const struct sp_grid *grid;
    bool keeps_hidden; /* hidden voxels are not left out */
    bool by_depth;     /* sorted by u2 of their centres */
    struct sp_pool *pool;
    struct sp_arena *arena;
    const struct sp_interrupt *interrupt;
};

/* Voxels of the list, front to back. */
struct sp_voxel_order {
    uint32_t *voxels; /* [count] */
    uint32_t count;
};

/* False if memory ran out (the arena says for what). Incomplete after a cancellation. */
bool sp_voxel_sort(const struct sp_voxel_order_job *job, struct sp_voxel_order *order);

#endif
