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

/* The deviation of a kernel's depth [cells]. */
static inline float sp_cloud_deviation(const struct sp_cloud *c, const float l[6]) {
    const float *w = c->place[2];
    const float row[3] = { w[0] * l[0] + w[1] * l[1] + w[2] * l[3], w[1] * l[2] + w[2] * l[4],
                           w[2] * l[5] };
    return c->size * sqrtf(row[0] * row[0] + row[1] * row[1] + row[2] * row[2]);
}

/* How far kernels reach beyond their centres [deviations] that are drawn although the centre lies
 * before the near plane (splat/close.h): points end at the cutoff, Gaussians where their opacity is
 * below SP_TRAINED_OPACITY_MIN. */
static inline float sp_cloud_reach(const struct sp_cloud *cloud,
                                   const struct sp_voxel_frame *frame) {
    if (cloud->is_orthographic || frame->has_streaks)
        return 0;
    return frame->is_trained ? 3.33f : frame->ewa.radius;
}

/* True if an element whose centre has the depth u2 may reach beyond the near plane. */
static inline bool sp_cloud_is_beyond(const struct sp_cloud *cloud,
                                      const struct sp_voxel_frame *frame, const float factor[6],
                                      float u2) {
    if (u2 >= frame->ewa.near)
        return true;
    const float reach = sp_cloud_reach(cloud, frame);
    return reach > 0 && u2 + reach * sp_cloud_deviation(cloud, factor) >= frame->ewa.near;
}

/* Returns the depth of an element's centre [cells]; infinity if the element is not drawn. */
static inline float sp_cloud_depth(const struct sp_cloud *cloud, const struct sp_voxel_frame *frame,
                                   const struct sp_cloud_element *e) {
    const float *p = e->position;
    float u[3];
    for (int r = 0; r < 3; r++)
        u[r] = cloud->place[r][0] * p[0] + cloud->place[r][1] * p[1] + cloud->place[r][2] * p[2] +
               cloud->offset[r];
    const bool is_drawn = sp_cloud_is_beyond(cloud, frame, e->factor, u[2]) && u[2] < 1e18f &&
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
