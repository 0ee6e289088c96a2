/* SPDX-License-Identifier: Apache-2.0
 *
 * Sorts the elements of a cloud that the camera may see by the depth of their centres.
 */
#ifndef SP_CLOUD_ORDER_H
#define SP_CLOUD_ORDER_H

#include <math.h>

#include "base/arena.h"
#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "draw/layers/cloud/kernels.h"
#include "draw/layers/splat_list/order.h"

/* The elements to sort; NULL = all elements of the cloud. */
struct sp_cloud_choice {
    uint32_t *elements; /* [count] */
    float *depths;      /* [count]: sp_cloud_depth() of merged points; NULL = not known */
    uint32_t count;
};

/* True if the clip planes keep the point u. */
static inline bool sp_cloud_is_kept(const struct sp_clip_frame *clip, const float u[3]) {
    for (uint32_t i = 0; i < clip->count; i++) {
        const struct sp_clip_half *h = &clip->planes[i];
        if (h->normal[0] * u[0] + h->normal[1] * u[1] + h->normal[2] * u[2] < h->offset)
            return false;
    }
    return true;
}

/* Returns the depth of an element's centre [cells]; infinity if the element is not drawn. */
static inline float sp_cloud_depth(const struct sp_cloud *cloud, const struct sp_voxel_frame *frame,
                                   const struct sp_cloud_element *e) {
    const float *p = e->position;
    float u[3];
    for (int r = 0; r < 3; r++)
        u[r] = cloud->place[r][0] * p[0] + cloud->place[r][1] * p[1] + cloud->place[r][2] * p[2] +
               cloud->offset[r];
    const bool is_drawn = u[2] >= frame->ewa.near && u[2] < 1e18f &&
                          (e->volume ? isfinite(*e->value) && *e->volume > 0
                                     : *e->value * cloud->opacity > SP_TRAINED_OPACITY_MIN) &&
                          sp_cloud_is_kept(&frame->ewa.clip, u);
    return is_drawn ? u[2] : INFINITY;
}

/* Sorts the elements front to back: by depth, in steps of 2^−22 of the range of depths, then by
 * number. Leaves out the same elements as sp_cloud_prepare(). With levels of detail, copies the
 * chosen points to cloud->records unless there are too many. With `set_up`, which is for Gaussians,
 * stores splats in cloud->splats unless there are too many, and leaves out splats outside the
 * image. The result is the same for any number of threads. False if memory runs out; the arena
 * names the allocation. Incomplete after a cancellation. */
bool sp_cloud_sort(struct sp_cloud *cloud, const struct sp_cloud_choice *choice,
                   const struct sp_voxel_frame *frame, sp_voxel_set_up_fn *set_up,
                   struct sp_pool *pool, struct sp_arena *arena,
                   const struct sp_interrupt *interrupt, struct sp_voxel_order *order);

#endif
