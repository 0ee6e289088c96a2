/* SPDX-License-Identifier: Apache-2.0
 *
 * Computes the points of a block, SURFACE_BATCH pieces of surface at a time.
 */
#ifndef SP_SURFACE_BATCH_H
#define SP_SURFACE_BATCH_H

#include "draw/layers/surface/patch.h"
#include "draw/layers/surface/points.h"
#include "draw/layers/surface/samples.h"

/* The constants of all blocks. */
struct sp_surface_batch_frame {
    const struct sp_surface_points *points;
    float to_world[3][3]; /* gradient along the axes → world */
    float unit;           /* edge of a cube with a cell's volume, world units */
    float share[3];       /* share of a cell that one of its parts has */
    float face[3];        /* share of a cell's face that a face of one part has */
};

struct sp_surface_batch {
    const struct sp_surface_batch_frame *frame;
    struct sp_surface_block *block;
    uint64_t to; /* number of the next point */
    struct sp_surface_slopes slopes;
    float gap[3][SURFACE_SAMPLES_ROW];
    struct sp_surface_patches patches;
    int32_t cell[3][SURFACE_BATCH]; /* index of the cell in the block */
    float start[3][SURFACE_BATCH];  /* where the part starts in its cell [parts] */
    float size[SURFACE_BATCH];      /* length of its edges [parts] */
};

void sp_surface_batch_frame_init(struct sp_surface_batch_frame *frame,
                                 const struct sp_surface_points *points,
                                 const struct sp_grid *grid);

/* Begins a block; block->first and block->count must be set. The caller sets `slopes` and `gap`
 * before it adds pieces. */
void sp_surface_batch_begin(struct sp_surface_batch *batch, struct sp_surface_block *block);

/* Adds the pieces of a cube in a cell, whose corners have the values f. `start` and `size` are
 * counted in the parts into which the points' cells are split. */
void sp_surface_batch_add(struct sp_surface_batch *batch, const float f[8],
                          const struct sp_surface_parts *parts, const int cell[3],
                          const float start[3], float size);
void sp_surface_batch_end(struct sp_surface_batch *batch);

#endif
