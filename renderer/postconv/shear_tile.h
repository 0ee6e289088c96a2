/* SPDX-License-Identifier: Apache-2.0
 *
 * One tile of the plane while it is drawn: what shear_tile.c (voxels → samples) and shear_filter.c
 * (samples → composited samples) share. Compiled once per instruction set (base/isa.h).
 */
#ifndef SP_POSTCONV_SHEAR_TILE_H
#define SP_POSTCONV_SHEAR_TILE_H

#include "base/isa.h"
#include "base/wide.h"
#include "postconv/shear.h"

struct sp_shear_open_tile {
    const struct sp_shear *shear;
    struct sp_shear_scratch *scratch;
    int x, y;        /* sample of the plane at the scratch's first column and row */
    int columns;     /* of the scratch, with margins; a multiple of 16 */
    double distance; /* that the weights are made for; 0 = none */
    /* Samples of the tile that are not opaque, [begin, end): columns in sixteens, rows in blocks.
     */
    int live[2][2];
    /* Of a layer, likewise: samples that are composited, that the filters before need, and that
     * hold deposits or zeros. In columns and rows of the scratch, but columns of `done` in the
     * tile's. */
    int done[2][2], filtered[2][2], used[2][2];
};

/* Finds the length of rays and clears the tile. */
void sp_shear_start_tile(struct sp_shear_open_tile *tile);

/* Makes filters for slices at a distance from the eye [voxels]. */
void sp_shear_make_weights(struct sp_shear_open_tile *tile, double distance);

/* Filters the grid and composites the layer. */
void sp_shear_close_layer(struct sp_shear_open_tile *tile);

/* Finds the columns and rows that are not opaque; false if there are none. */
bool sp_shear_is_visible(struct sp_shear_open_tile *tile);

/* Copies the tile into the plane. */
void sp_shear_finish_tile(const struct sp_shear_open_tile *tile);

#endif
