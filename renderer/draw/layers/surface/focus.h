/* SPDX-License-Identifier: Apache-2.0
 *
 * Close to the eye, the discs of a surface are made smaller, and more of them are drawn. A
 * footprint is the image of a disc by the affine map at its centre. The error of that map grows
 * with the square of the disc's radius over its distance, and has no bound: a disc beside the eye
 * would cover the image. With discs that are as wide as a fixed share of their distance the error
 * is the same everywhere, and the sum of weights stays 1, because the size of discs changes slowly
 * from place to place.
 */
#ifndef SP_SURFACE_FOCUS_H
#define SP_SURFACE_FOCUS_H

#include "draw/layers/surface/points.h"
#include "splat/ewa_frame.h"

/* The smallest parts of cells: a power of 2. */
#define SURFACE_SIZE_MIN (1 / 16.0f)
/* Discs that are wider than this share of their distance are left out, as by a near plane: the
 * smallest ones, closer to the eye than a fifth of a cell. */
#define SURFACE_WIDEST 0.2f

struct sp_surface_focus {
    const struct sp_ewa_frame *frame; /* in perspective */
    float growth;  /* of discs with their distance, as a share of their size far away [1/cells]; 0 =
                      no block is close */
    float least;   /* size of the smallest discs, as a share of their size far away */
    float nearest; /* distance of the nearest discs [cells] */
    float coarse;  /* size of a disc far away, in discs of one cell: 1, or more in previews */
};

/* The place of a cell in camera space. */
struct sp_surface_frame_cell {
    float u[3];        /* the corner [cells] */
    float edges[3][3]; /* by axis: the way along its edge [cells] */
};

/* Sets the place of the `cells`³ cells whose first sample is `corner`, as one cell. */
void sp_surface_focus_place(const struct sp_surface_focus *focus, const uint32_t corner[3],
                            uint32_t cells, struct sp_surface_frame_cell *out);

/* Computes the sizes of the smallest and the largest discs in a cube of a cell that starts at
 * `start` with edges of `size` [0, 1], as shares of their size far away. Both are 1 if the image
 * shows nothing of the cube. */
void sp_surface_focus_sizes(const struct sp_surface_focus *focus,
                            const struct sp_surface_frame_cell *cell, const float start[3],
                            const float size[3], float sizes[2]);

/* The same for the block that begins at `corner`. */
void sp_surface_focus_block(const struct sp_surface_focus *focus, const uint32_t corner[3],
                            float sizes[2]);

/* True if the block that begins at `corner` has discs in the image that are smaller than far away.
 */
static inline bool sp_surface_focus_has(const struct sp_surface_focus *focus,
                                        const uint32_t corner[3]) {
    float sizes[2];
    sp_surface_focus_block(focus, corner, sizes);
    return sizes[0] < 1;
}

#endif
