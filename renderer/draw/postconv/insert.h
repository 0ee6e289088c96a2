/* SPDX-License-Identifier: Apache-2.0
 *
 * Inserts fragments of other layers (frame/fragments.h) into sheets. As in
 * draw/footprints/insert.h, a fragment divides the sheet that contains it: each part has its share
 * of the optical depth, by length.
 *
 *   place of a fragment   l + s: in layer l, a share s in [0, 1) of it lies in front; each layer is
 *                         composited as one, and may be several slices
 */
#ifndef SP_POSTCONV_INSERT_H
#define SP_POSTCONV_INSERT_H

#include "draw/postconv/postconv.h"
#include "frame/fragments.h"

/* A frame's fragments among its layers. */
struct sp_postconv_insert {
    const struct sp_fragments *fragments;
    /* The number of slices in front of a point, counted from where the volume begins:
     * offset + u2·depth + (right·x + down·y)·s. The point has depth u2 and lies (x, y) px from the
     * camera's centre; s = u2 in perspective, 1 in orthographic projection. */
    double offset, depth, right, down, centre[2];
    bool is_perspective;
    uint32_t slices;
    const float (*begin)[2]; /* by slice: the place where it begins, its part of a layer */
};

/* The fragments of a tile that are not composited yet. Pixels are in the order of the kernels. */
struct sp_postconv_inserted {
    _Alignas(64) float place[POSTCONV_TILE][POSTCONV_TILE]; /* of the first; infinite = none */
    const struct sp_fragment *next[POSTCONV_TILE][POSTCONV_TILE];
    uint8_t left[POSTCONV_TILE][POSTCONV_TILE]; /* number of fragments from `next` on */
};

#endif
