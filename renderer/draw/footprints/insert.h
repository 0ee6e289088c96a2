/* SPDX-License-Identifier: Apache-2.0
 *
 * Fragments of other layers (frame/fragments.h) inside of the sheets, slabs and splats of the
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
    bool has_splats; /* layers are ranges of distance of single splats, not sheets or slabs */
    /* Sheets: slice i of the grid lies between the planes normal·u = offset[i] and offset[i + 1] of
     * camera space, which rise; it is layer number layer[i]. 0 planes = the layers are ranges of
     * distance. */
    double normal[3];
    const double *offset;  /* [planes] */
    const uint32_t *layer; /* [planes − 1] */
    uint32_t planes;
    double nearest, thickness; /* of ranges of distance: of layer 0, and of each [world unit] */
    double reach, unit; /* splats: most that a kernel reaches along the ray, a cell [world unit] */
};

/* The fragments of a tile that are not composited yet. Splats: what lies behind the first of them
 * is in the tile's sums as opacity and premultiplied colour. */
struct sp_tile_insert {
    uint8_t next[SP_TILE_AREA];   /* the first of them, by pixel */
    uint32_t layer[SP_TILE_AREA]; /* the layer that it lies in, or the first one behind it; splats:
                                     the first one that it does not divide; UINT32_MAX = it is
                                     behind all of them, or there is none */
    float share[SP_TILE_AREA];    /* of that layer in front of it, [0, 1]; splats: the distance of
                                     the fragment [cells], 1e30 = there is none */
};

/* Fills the planes of sheets along `axis`. False if the arena cannot allocate. */
bool sp_insert_init_sheets(struct sp_insert *insert, const struct sp_grid *grid, unsigned axis,
                           struct sp_arena *arena);

/* Finds the first fragment of each pixel; tile->insert must have memory. */
void sp_insert_open(struct sp_tile *tile, const struct sp_insert *insert);

/* Composites the fragments that a range of splats is behind, in the box [tile px]. */
void sp_insert_before(struct sp_tile *tile, const struct sp_insert *insert,
                      const struct sp_box *box, uint32_t layer);

/* Composites the fragments before and in columns [begin, end) of row y of a sheet or slab, and what
 * lies before the last of them: `sum` has T and E of the row (blend.h), and keeps what is left. */
void sp_insert_row(struct sp_tile *tile, const struct sp_insert *insert, uint32_t layer, int y,
                   int begin, int end, bool linear, float *sum);

/* Composites those that are left. */
void sp_insert_rest(struct sp_tile *tile, const struct sp_insert *insert);

#endif
