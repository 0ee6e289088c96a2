/* SPDX-License-Identifier: Apache-2.0
 *
 * From the outline of a splat to its record. For kernel sources only.
 */
#ifndef SP_VOXELS_RECORD_H
#define SP_VOXELS_RECORD_H

#include "splat/outline.h"
#include "voxels/kernels.h"

/* Returns the record of splat i, without its colour. */
static inline struct sp_voxel_record sp_voxel_record_at(const struct sp_outlines *o, int i,
                                                        float depth, float u2) {
    return (struct sp_voxel_record){ .x = o->x[i],
                                     .y = o->y[i],
                                     .a = o->a[i],
                                     .b = o->b[i],
                                     .c = o->c[i],
                                     .depth = depth,
                                     .u2 = u2,
                                     .x0 = (int16_t)o->x0[i],
                                     .y0 = (int16_t)o->y0[i],
                                     .x1 = (int16_t)o->x1[i],
                                     .y1 = (int16_t)o->y1[i],
                                     .area = o->area[i] };
}

#endif
