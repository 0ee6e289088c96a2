/* SPDX-License-Identifier: Apache-2.0
 *
 * What one sees at a point of the picture, computed on the processor from the volume itself: every
 * sample fills its cell (from the middle of one gap to the middle of the next) with the colour and
 * extinction of the transfer function, at the magnitude of its own gradient if that counts, and the
 * ray adds up the extinction of the cells that it crosses, exactly. Kernels, filters and slabs are
 * of pictures and play no part; near plane and clip do.
 *
 *   τ(t) = Σ extinction(cell) · length in it     opacity(t) = 1 − e^−τ(t)
 */
#ifndef SP_PICK_H
#define SP_PICK_H

#include <stdbool.h>

#include "sp/view.h"
#include "sp/volume.h"

struct sp_pick {
    double opacity;     /* of the whole ray, [0,1] */
    bool is_hit;        /* it reaches a half; then: */
    double position[3]; /* world, where it does */
    double value;       /* of the sample whose cell that is in, data unit */
};

/* Looks along the ray of `at`: px of a picture of `size` px from its upper left corner, x to the
 * right, y down, so that (0.5, 0.5) is the middle of the first pixel; finite. The view is valid.
 * Steps at most from cell to cell: dims[0] + dims[1] + dims[2] of them. Any thread. */
void sp_pick_at(const struct sp_volume *volume, const struct sp_view *view, const uint32_t size[2],
                const double at[2], struct sp_pick *pick);

#endif
