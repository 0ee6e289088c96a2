/* SPDX-License-Identifier: Apache-2.0
 *
 * Drops splats that earlier splats hide: splats that touch only tiles that are opaque already. For
 * kernel sources only.
 */
#ifndef SP_SPLAT_LIST_CLOSED_H
#define SP_SPLAT_LIST_CLOSED_H

#include "draw/layers/splat_list/kernels.h"
#include "splat/outline.h"

/* True if all tiles that the box of a splat touches are closed. */
static inline bool sp_voxel_is_covered(const struct sp_voxel_frame *frame, int x0, int y0, int x1,
                                       int y1) {
    int low = (y0 - frame->ewa.rows[0]) / SP_VOXEL_TILE;
    int high = (y1 - 1 - frame->ewa.rows[0]) / SP_VOXEL_TILE;
    int left = x0 / SP_VOXEL_TILE, right = (x1 - 1) / SP_VOXEL_TILE;
    for (int row = low; row <= high; row++)
        for (int column = left; column <= right; column++)
            if (!frame->closed[row * frame->columns + column])
                return false;
    return true;
}

/* Clears the bits of hidden splats and returns the remaining bits. */
static inline unsigned sp_voxel_drop_covered(const struct sp_voxel_frame *frame,
                                             const struct sp_outlines *o, unsigned bits) {
    unsigned seen = bits;
    for (; bits; bits &= bits - 1) {
        int i = __builtin_ctz(bits);
        if (sp_voxel_is_covered(frame, (int)o->x0[i], (int)o->y0[i], (int)o->x1[i], (int)o->y1[i]))
            seen ^= 1u << i;
    }
    return seen;
}

#endif
