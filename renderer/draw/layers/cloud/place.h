/* SPDX-License-Identifier: Apache-2.0
 *
 * Computes the places of elements in camera space. For kernel sources only.
 */
#ifndef SP_CLOUD_PLACE_H
#define SP_CLOUD_PLACE_H

#include "draw/layers/cloud/kernels.h"
#include "splat/outline.h"

/* Computes the positions and kernels of SP_WIDE elements in camera space. */
static inline void sp_cloud_place(const struct sp_cloud *cloud, const sp_wide position[3],
                                  const sp_wide factor[6], struct sp_places *p) {
    static const int row_of[6] = { 0, 1, 1, 2, 2, 2 }, column_of[6] = { 0, 0, 1, 0, 1, 2 };
    for (int r = 0; r < 3; r++) {
        p->u[r] = sp_wide_all(cloud->offset[r]);
        for (int a = 0; a < 3; a++) {
            p->u[r] += cloud->place[r][a] * position[a];
            p->kernel[r][a] = sp_wide_all(0);
        }
        for (int k = 0; k < 6; k++)
            p->kernel[r][column_of[k]] += cloud->place[r][row_of[k]] * cloud->size * factor[k];
    }
}

#endif
