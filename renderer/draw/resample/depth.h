/* SPDX-License-Identifier: Apache-2.0
 *
 * Depth of a block's pixels (frame/depth.h): the place d is s, counted from the block's first one.
 * Depth is linear in s along each ray. An interval counts at the place where it is seen (seen.h).
 */
#ifndef SP_RESAMPLE_DEPTH_H
#define SP_RESAMPLE_DEPTH_H

#include "draw/resample/kernels.h"
#include "frame/depth.h"

/* Call it before anything is added at s: s becomes the block's origin unless it has one. */
static inline void sp_resample_open_depth(struct sp_resample_block *block, float s) {
    if (isnan(block->origin))
        block->origin = s;
}

/* Adds what the SP_WIDE rays from pixel i on show at s. share: T α. */
static inline void sp_resample_add_depth(struct sp_resample_block *block, int i, sp_wide share,
                                         sp_wide s) {
    sp_moments_add(block->moment[0] + i, block->moment[1] + i, share, s - block->origin);
}

/* The steps from the eye's plane along the ray of a pixel that is (x, y) px away from the image's
 * centre: the coordinate of depth u2 along the slices' axis is step[0] + u2·step[1]. */
static inline void sp_resample_depth_steps(const struct sp_resample_open_tile *t, double x,
                                           double y, double step[2]) {
    const struct sp_resample *r = t->r;
    const int axis = t->axis[2];
    const double aside = x * r->right[axis] + y * r->down[axis];
    const bool is_perspective = r->camera->projection == SP_PERSPECTIVE;
    step[0] = r->eye[axis] + (is_perspective ? 0 : aside);
    step[1] = r->ray[axis] + (is_perspective ? aside : 0);
}

#endif
