/* SPDX-License-Identifier: Apache-2.0
 *
 * Tiles. The image is cut into squares of SP_TILE px. A tile keeps the composited image so far and
 * its open layers: a sheet, or several slabs. Splats are set up in batches, front to back, sorted
 * into tiles (bin.h) and added by the compositor that the view chose (sheet.h, slab.h, splat.h); a
 * batch may end in the middle of a layer.
 *
 *   batch ─► records in order ─► per tile: list of records in order ─► layer sums ─► composite
 *
 * Every pixel is summed in the order of the records, whichever worker draws the tile: the image is
 * bit-equal for any number of threads.
 */
#ifndef SP_FOOTPRINTS_TILE_H
#define SP_FOOTPRINTS_TILE_H

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

/* A box of pixels in a tile: columns [x0, x1) and rows [y0, y1) [tile px]. */
struct sp_box {
    int x0, y0, x1, y1;
};

struct sp_tile {
    /* Sums of the open layers (blend.h: slots, planes). Layer k lies in slot k mod slots. Its plane
     * 0 is T = Σ τ, its planes 1 … 3 are E = Σ c·τ. Post-classification: Σ length, Σ
     * gradient·length, Σ value·length. The planes alternate row by row, so that a footprint touches
     * memory that lies close together. The owner of the tiles sets both pointers. */
    float *sums;          /* [slots][SP_TILE][planes][SP_TILE]: sp_sums_row() */
    struct sp_box *dirty; /* [slots]: box of the sums that are not zero; empty if x1 <= x0 */
    /* Composited so far: plane 0 is the transmittance, 1 … 3 the premultiplied colour. */
    _Alignas(64) float done[SP_PLANES][SP_TILE][SP_TILE];
    int x, y;      /* of the tile's corner in the image, px */
    int64_t sheet; /* number of the first open layer, or SP_NO_SHEET */
    /* Fragments of other layers (insert.h); not read if blend->insert is NULL. The owner of the
     * tiles sets the pointer. */
    struct sp_tile_insert *insert;
    struct sp_tile_depth *depth; /* tile_depth.h; NULL = the frame has no depth; likewise */
    uint32_t closed;             /* layers composited */
    bool saturated;              /* every pixel inside the image has a transmittance below 1/512 */
};

/* The tiles of the rows that are being drawn. */
struct sp_tile_grid {
    int columns, rows;
    int y; /* image row of the first tiles */
    struct sp_tile *tiles;
};

struct sp_blend;

/* Empties the tile at (x, y) of an image of `size` px. Pixels outside the image count as opaque.
 * tile->sums and tile->dirty must have memory for blend->slots layers; tile->insert and
 * tile->depth must have memory if blend->insert and blend->places are set. */
void sp_tile_init(struct sp_tile *tile, int x, int y, const int size[2],
                  const struct sp_blend *blend);

#endif
