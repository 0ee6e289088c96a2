/* SPDX-License-Identifier: Apache-2.0
 *
 * Converts the outline of a splat to its record. For kernel sources only.
 */
#ifndef SP_SPLAT_LIST_RECORD_H
#define SP_SPLAT_LIST_RECORD_H

#include "draw/layers/splat_list/kernels.h"
#include "splat/close_place.h"

/* Writes the record of splat i, except its colour and its streaks. close: NULL = it is affine. */
static inline void sp_voxel_record_write(const struct sp_outlines *o, int i, float depth, float u2,
                                         const struct sp_close *close,
                                         struct sp_voxel_record *out) {
    out->x = o->x[i];
    out->y = o->y[i];
    out->a = o->a[i];
    out->b = o->b[i];
    out->c = o->c[i];
    out->depth = depth;
    out->u2 = u2;
    out->x0 = (int16_t)o->x0[i];
    out->y0 = (int16_t)o->y0[i];
    out->x1 = (int16_t)o->x1[i];
    out->y1 = (int16_t)o->y1[i];
    out->area = o->area[i];
    out->close.kind = SP_CLOSE_FAR;
    if (close)
        out->close = *close;
}

#endif
