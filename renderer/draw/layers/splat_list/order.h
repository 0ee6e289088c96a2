/* SPDX-License-Identifier: Apache-2.0
 *
 * Computes the order in which the voxels of a list are drawn, front to back, without hidden voxels
 * (after Botha and Post 2003, section 2.2; the paper leaves perspective to future work).
 *
 *   along each axis     slices away from the eye, on either side of it (splat/slices.h)
 *   slices of the major axis ─► rows ─► voxels of a row
 *
 * Each index moves away from the eye along its axis. A ray stays on one side of each of the three
 * planes through the eye, that is, in one of at most eight parts. So it meets the cells of voxels
 * in this order, whichever way the parts are interleaved. Slices of the major axis come first
 * because they are closest to perpendicular to the view: Gaussians reach beyond their cells, and
 * within such a slice they have nearly the same distance.
 *
 * Among other layers, voxels are sorted by the depth of their centres instead (by_depth), so that
 * the splats of a pixel become fragments in order of depth.
 *
 * Hidden voxels: a face of a voxel's cell is turned to the eye if the eye lies beyond the face's
 * plane; at most three faces are. A voxel is hidden if the neighbours on all of these faces are
 * opaque.
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

/* Sorts the voxels of the list. False if memory runs out; the arena names the allocation.
 * Incomplete after a cancellation. */
bool sp_voxel_sort(const struct sp_voxel_order_job *job, struct sp_voxel_order *order);

#endif
