/* SPDX-License-Identifier: Apache-2.0
 *
 * Slabs on the fast path. A sheet has no thickness, but kernels overlap along the ray. So each
 * sheet is spread over the slabs around it, whose faces lie half way between slices:
 *
 *   sheets   n−1      n      n+1        the kernel of a voxel along the ray, in slices:
 *             │   ┊   │   ┊   │         Gaussian of variance s² around its slice
 *   slabs     └ m−1 ┘ └ m ┘ └ m+1 ┘     share of slab m: its integral between the slab's faces
 *
 * Where rays are oblique to the slices, the part of a kernel in slab m is narrower than the kernel
 * and lies beside its centre. Position x in the image and depth along the ray are jointly normal,
 * so that the part is, to good approximation, a Gaussian as well:
 *
 *   shift = D·(depth of the part)     D = cov(x, depth)/s²     variance = V − D·Dᵀ·(variance of
 * depths)
 *
 * Deposits are made once per voxel. Before the filter, the samples of up to seven sheets are added
 * with their shares. The samples of each layer lie where the shifts move them, so that equal
 * samples of all sheets belong together; the filter of a slab moves them back to the pixels.
 */
#ifndef SP_POSTCONV_SLAB_H
#define SP_POSTCONV_SLAB_H

#include "draw/postconv/postconv.h"

enum {
    SLAB_REACH = 3,                  /* sheets to each side whose kernels reach into a slab */
    SLAB_SLOTS = 2 * SLAB_REACH + 2, /* sheets that a slab may need, and the next one */
    SLAB_PARTS = 8                   /* most slabs per slice */
};

/* The constants of a tile. */
struct sp_slab_tile {
    const struct sp_postconv_brick *brick; /* one of those that the tile meets */
    float ratio[2];                        /* u0/u2 and u1/u2 of the tile's middle */
    float range[2];                        /* of 1/u2 of all its bricks */
    int scale[2];                          /* of the samples of all layers */
    int reach;                             /* sheets to each side of a slab, at most */
};

/* How a layer is spread over slabs. */
struct sp_slab_layer {
    struct sp_postconv_group group; /* with the filter of its slabs, not moved back yet */
    int reach;                      /* sheets to each side */
    /* By slab of the slice and by sheet, from the nearest one to the eye on. */
    float share[SLAB_PARTS][SLAB_SLOTS];
    double step[2]; /* shift from layer to layer [samples] */
};

/* The samples of one layer. */
struct sp_slab_sheet {
    float (*grid)[POSTCONV_PITCH][4]; /* [POSTCONV_GRID]; zero where no block is marked */
    uint32_t deposited[POSTCONV_GRID];
    int row0, row1;
    double place[2]; /* sum of the shifts of the layers before [samples] */
    struct sp_slab_layer layer;
};

/* Finds the constants of a tile; false if it meets no brick, or if there are no filters for it. */
bool sp_slab_tile_init(const struct sp_postconv *postconv, uint32_t tile,
                       struct sp_slab_tile *slab);

/* Returns 1/u2 of a layer in the middle of a tile, within the range of its bricks. */
float sp_slab_layer_place(const struct sp_postconv *postconv, const struct sp_slab_tile *slab,
                          uint32_t layer);

/* Chooses filters and shares for a layer at this 1/u2. False if there are none. */
bool sp_slab_layer_init(const struct sp_postconv *postconv, const struct sp_slab_tile *slab,
                        float w, struct sp_slab_layer *layer);

/* Makes the filter of a group, along an axis, whose samples lie `part` of a sample after those of
 * the pixels' grid, [0, 1). */
void sp_slab_filter_init(const struct sp_postconv *postconv, const struct sp_postconv_group *group,
                         int axis, float part, struct sp_postconv_filter *filter);

#endif
