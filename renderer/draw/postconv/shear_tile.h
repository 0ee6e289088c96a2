/* SPDX-License-Identifier: Apache-2.0
 *
 * One tile of the plane while it is drawn: what shear_tile.c (voxels → samples) and shear_filter.c
 * (samples → composited samples) share. Compiled once per instruction set (base/isa.h).
 */
#ifndef SP_POSTCONV_SHEAR_TILE_H
#define SP_POSTCONV_SHEAR_TILE_H

#include "base/isa.h"
#include "base/wide.h"
#include "draw/postconv/shear.h"

struct sp_shear_open_tile {
    const struct sp_shear *shear;
    struct sp_shear_scratch *scratch;
    int x, y;        /* sample of the plane at the scratch's first column and row */
    int columns;     /* of the scratch, with margins; a multiple of 16 */
    double distance; /* that the weights are made for; 0 = none */
    int reach;       /* blocks that filters reach: 1 or 2 */
    int used[2][2];  /* columns and rows of the scratch that a slice may reach: [begin, end) */
    /* By block of rows of the scratch, a bit per 16 columns. `live`: columns of the tile that are
     * not opaque. Columns of the scratch: `needed` = that matter to live ones, `touched` = with
     * deposits. The grid is zero elsewhere. */
    uint32_t live[SHEAR_BLOCKS], needed[SHEAR_BLOCKS], touched[SHEAR_BLOCKS];
    uint32_t filled[2]; /* the same of both halves of the ring */
};

/* Columns of the scratch that columns of the tile need, and columns of the tile that columns of the
 * scratch reach. */
static inline uint32_t sp_shear_to_scratch(const struct sp_shear_open_tile *t, uint32_t columns) {
    return columns | columns << 1 | (t->reach > 1 ? columns << 2 : 0);
}

static inline uint32_t sp_shear_to_tile(const struct sp_shear_open_tile *t, uint32_t columns) {
    columns |= columns >> 1 | (t->reach > 1 ? columns >> 2 : 0);
    return columns & ((UINT32_C(1) << t->shear->tile[0] / 16) - 1);
}

/* Finds the length of rays and clears the tile. */
void sp_shear_start_tile(struct sp_shear_open_tile *tile);

/* Makes filters for slices at a distance from the eye [voxels]. */
void sp_shear_make_weights(struct sp_shear_open_tile *tile, double distance);

/* Filters the grid and composites the layer. */
void sp_shear_close_layer(struct sp_shear_open_tile *tile);

/* Finds the samples that are not opaque; false if there are none. */
bool sp_shear_is_visible(struct sp_shear_open_tile *tile);

/* Copies the tile into the plane. */
void sp_shear_finish_tile(const struct sp_shear_open_tile *tile);

#endif
