/* SPDX-License-Identifier: Apache-2.0
 *
 * Inserts fragments of other layers (frame/fragments.h) into the sheets, slabs and splats of the
 * volume.
 *
 *   sheet or slab   divided at the fragment: each part has its share of the optical depth, and the
 *                   mean colour. So the image changes evenly where a fragment moves along the ray.
 *   splat           divided by the share of its kernel before the fragment: the rest is composited
 *                   behind it
 *
 * Splats as wholes before or behind a surface would show the lattice of the voxels as stripes.
 */
#ifndef SP_FOOTPRINTS_INSERT_H
#define SP_FOOTPRINTS_INSERT_H

#include "base/arena.h"
#include "draw/footprints/tile.h"
#include "frame/fragments.h"
#include "splat/camera.h"

/* How depths relate to the layers of a frame's order. */
struct sp_insert {
    const struct sp_fragments *fragments;
    const struct sp_camera_transform *camera;
    bool has_splats; /* layers hold single splats by ranges of distance, not sheets or slabs */
    /* Sheets: slice i of the grid lies between the planes normal·u = offset[i] and offset[i + 1] in
     * camera space; offsets rise. The slice is layer number layer[i]. 0 planes = the layers are
     * ranges of distance. */
    double normal[3];
    const double *offset;  /* [planes] */
    const uint32_t *layer; /* [planes − 1] */
    uint32_t planes;
    double nearest, thickness; /* ranges of distance: where layer 0 begins, and the thickness of a
                                  layer [world unit] */
    /* Splats: the longest distance that a kernel reaches along the ray, and the width of a cell
     * [world unit]. */
    double reach, unit;
};

/* The fragments of a tile that are not composited yet. Single splats: the tile's sums hold the
 * parts of splats that lie behind the first of these fragments, as opacity and premultiplied
 * colour. */
struct sp_tile_insert {
    uint8_t next[SP_TILE_AREA]; /* number of the first of these fragments, by pixel */
    /* The layer that contains this fragment, or the first layer behind it. Splats: the first layer
     * that it does not divide. UINT32_MAX = the fragment lies behind all layers, or the pixel has
     * none. */
    uint32_t layer[SP_TILE_AREA];
    /* The share of that layer in front of the fragment, [0, 1]. Splats: the distance of the
     * fragment [cells]; 1e30 = the pixel has none. */
    float share[SP_TILE_AREA];
};

/* Fills the planes of sheets along `axis`. False if the arena cannot allocate. */
bool sp_insert_init_sheets(struct sp_insert *insert, const struct sp_grid *grid, unsigned axis,
                           struct sp_arena *arena);

/* Starts a tile: finds the first fragment of each pixel. tile->insert must have memory. */
void sp_insert_open(struct sp_tile *tile, const struct sp_insert *insert);

/* Composites the fragments in the box [tile px] that lie in front of all splats of `layer`. */
void sp_insert_before(struct sp_tile *tile, const struct sp_insert *insert,
                      const struct sp_box *box, uint32_t layer);

/* Composites the fragments in front of and inside a sheet or slab, in columns [begin, end) of row
 * y, and the parts of the layer in front of them. `sum` has T and E of the row (blend.h); the part
 * behind the last fragment stays in `sum`. */
void sp_insert_row(struct sp_tile *tile, const struct sp_insert *insert, uint32_t layer, int y,
                   int begin, int end, bool linear, float *sum);

/* Composites the remaining fragments of the tile. */
void sp_insert_rest(struct sp_tile *tile, const struct sp_insert *insert);

#endif
