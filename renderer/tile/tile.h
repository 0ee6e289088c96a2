/* SPDX-License-Identifier: Apache-2.0
 *
 * Splats → tiles. The picture is cut into squares of SP_TILE px; each keeps what it has composited
 * so far and the layers that are being added up: a sheet, or several slabs. Splats are set up in
 * batches, front to back, sorted into tiles (bin.h) and added by the compositor that the view chose
 * (sheet.h, slab.h, splat.h); a batch may end in the middle of a layer.
 *
 *   batch ─► records in order ─► per tile: list of records in order ─► layer sums ─► composite
 *
 * Every pixel's sum is formed in the order of the records, whoever does the tile: the image is
 * bit-equal for any number of threads.
 */
#ifndef SP_TILE_TILE_H
#define SP_TILE_TILE_H

#include <stdbool.h>
#include <stdint.h>

#include "base/isa.h"
#include "base/wide.h"
#include "splat/ewa.h"

enum {
    SP_TILE = 32, /* px, both ways: a multiple of every SP_WIDE */
    SP_TILE_AREA = SP_TILE * SP_TILE,
    SP_PLANES = 4, /* composited: transmittance and red, green, blue */
    SP_NO_SHEET = -1
};

/* Columns and rows of a tile: x0, y0, x1, y1 in tile px, half open. */
struct sp_box {
    int x0, y0, x1, y1;
};

struct sp_tile {
    /* Sums of the open layers (blend.h: slots, planes): layer k lies in slot k mod slots, its plane
     * 0 is T = Σ τ, 1 … 3 are E = Σ c·τ; post: Σ length, Σ gradient·length, Σ value·length. Planes
     * alternate by rows, so that what a footprint touches lies close together. The owner of the
     * tiles sets both pointers. */
    float *sums;          /* [slots][SP_TILE][planes][SP_TILE]: sp_sums_row() */
    struct sp_box *dirty; /* [slots] what is not zero in them; empty when x1 <= x0 */
    /* Composited so far: plane 0 is the transmittance, 1 … 3 the associated colour. */
    _Alignas(64) float done[SP_PLANES][SP_TILE][SP_TILE];
    int x, y;        /* of the tile's corner in the picture, px */
    int64_t sheet;   /* the first open layer's place in the order, or SP_NO_SHEET */
    uint32_t closed; /* layers composited */
    bool saturated;  /* no pixel of the picture in it lets more than 1/512 through */
};

/* The tiles of the rows that are being drawn. */
struct sp_tile_grid {
    int columns, rows;
    int y; /* picture row of the first tiles */
    struct sp_tile *tiles;
};

struct sp_blend;

/* Empty tile at (x, y) of a picture of `size` px: pixels outside the picture count as opaque. Its
 * sums and dirty boxes are memory for blend->slots layers. */
void sp_tile_init(struct sp_tile *tile, int x, int y, const int size[2],
                  const struct sp_blend *blend);

#endif
