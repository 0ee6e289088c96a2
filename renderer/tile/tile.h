/* SPDX-License-Identifier: Apache-2.0
 *
 * Splats → tiles. The picture is cut into squares of SP_TILE px; each keeps what it has composited
 * so far and the sheet that is being added up. Splats are set up in batches, front to back, sorted
 * into tiles (bin.h) and added (sheet.h); a batch may end in the middle of a sheet.
 *
 *   batch ─► records in order ─► per tile: list of records in order ─► sheet sums ─► composite
 *
 * Every pixel's sum is formed in the order of the records, whoever does the tile: the image is
 * bit-equal for any number of threads.
 */
#ifndef SP_TILE_TILE_H
#define SP_TILE_TILE_H

#include <stdbool.h>
#include <stdint.h>

#include "splat/ewa.h"

enum {
    SP_TILE = 32,     /* px, both ways */
    SP_TILE_ROW = 40, /* floats a row of a sheet's sums: loops may run over the right edge */
    SP_TILE_STEP = 4, /* … by up to this minus one */
    SP_PLANES = 4,    /* depth, and emission red, green, blue */
    SP_NO_SHEET = -1
};

struct sp_tile {
    /* Sums of the open sheet: plane 0 is T = Σ τ, 1 … 3 are E = Σ c·τ. */
    _Alignas(64) float sums[SP_PLANES][SP_TILE][SP_TILE_ROW];
    /* Composited so far: plane 0 is the transmittance, 1 … 3 the associated colour. */
    _Alignas(64) float done[SP_PLANES][SP_TILE][SP_TILE];
    int x, y;        /* of the tile's corner in the picture, px */
    int64_t sheet;   /* the open sheet's place in the order, or SP_NO_SHEET */
    int dirty[4];    /* x0, y0, x1, y1 of the open sheet's sums, tile px, half open */
    uint32_t closed; /* sheets composited */
    bool saturated;  /* no pixel of the picture in it lets more than 1/512 through */
};

/* The tiles of the rows that are being drawn. */
struct sp_tile_grid {
    int columns, rows;
    int y; /* picture row of the first tiles */
    struct sp_tile *tiles;
};

/* Empty tile at (x, y) of a picture of `size` px: pixels outside the picture count as opaque. */
void sp_tile_init(struct sp_tile *tile, int x, int y, const int size[2]);

#endif
