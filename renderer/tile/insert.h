/* SPDX-License-Identifier: Apache-2.0
 *
 * Fragments of other layers (frame/fragments.h) between the sheets, slabs or splats of the volume:
 * each is composited before the first sheet or slab whose middle is behind it.
 */
#ifndef SP_TILE_INSERT_H
#define SP_TILE_INSERT_H

#include "base/arena.h"
#include "frame/fragments.h"
#include "splat/camera.h"
#include "tile/tile.h"

/* How depths relate to the layers of a frame's order. */
struct sp_insert {
    const struct sp_fragments *fragments;
    const struct sp_camera_transform *camera;
    /* Sheets: slice i of the grid lies on the plane normal·u = offset[i] of camera space, rising
     * with i; it is layer number layer[i]. NULL = the layers are ranges of distance. */
    double normal[3];
    const double *offset;  /* [slices] */
    const uint32_t *layer; /* [slices] */
    uint32_t slices;
    double nearest, thickness; /* of ranges of distance: of layer 0, and of each [world unit] */
};

/* The fragments of a tile that are not composited yet. */
struct sp_tile_insert {
    uint8_t next[SP_TILE_AREA];   /* the first of them, by pixel */
    uint32_t layer[SP_TILE_AREA]; /* the first layer behind it; UINT32_MAX = it is behind all of
                                     them, or there is none */
};

/* Fills the planes of sheets along `axis`. False if the arena cannot allocate. */
bool sp_insert_init_sheets(struct sp_insert *insert, const struct sp_grid *grid, unsigned axis,
                           struct sp_arena *arena);

/* Finds the first fragment of each pixel; tile->insert must have memory. */
void sp_insert_open(struct sp_tile *tile, const struct sp_insert *insert);

/* Composites the fragments in front of the middle of a layer, in the box [tile px]. */
void sp_insert_before(struct sp_tile *tile, const struct sp_insert *insert,
                      const struct sp_box *box, uint32_t layer);

/* Composites those that are left. */
void sp_insert_rest(struct sp_tile *tile, const struct sp_insert *insert);

#endif
