/* SPDX-License-Identifier: Apache-2.0
 *
 * The elements of a cloud that the camera may see, sorted by the depth of their centres.
 */
#ifndef SP_CLOUD_ORDER_H
#define SP_CLOUD_ORDER_H

#include "base/arena.h"
#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "cloud/kernels.h"
#include "voxels/order.h"

/* What is sorted; NULL = all elements of the cloud. */
struct sp_cloud_choice {
    uint32_t *elements; /* [count] */
    uint32_t count;
};

/* Sorts the elements front to back: by depth, in steps of 2^−22 of the range of depths, then by
 * number. Leaves out what sp_cloud_prepare() leaves out. Levels of detail become records of the
 * cloud unless they are too many. With `set_up`, which is for Gaussians, elements become splats of
 * the cloud unless they are too many, and those that are not in the image are left out. The same
 * for any number of threads. False if memory ran out (the arena says for what). Incomplete after a
 * cancellation. */
bool sp_cloud_sort(struct sp_cloud *cloud, const struct sp_cloud_choice *choice,
                   const struct sp_voxel_frame *frame, sp_voxel_set_up_fn *set_up,
                   struct sp_pool *pool, struct sp_arena *arena,
                   const struct sp_interrupt *interrupt, struct sp_voxel_order *order);

#endif
