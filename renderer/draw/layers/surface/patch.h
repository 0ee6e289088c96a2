/* SPDX-License-Identifier: Apache-2.0
 *
 * The pieces of a surface in cells. Corner c of a cell lies at (c & 1, c >> 1 & 1, c >> 2).
 */
#ifndef SP_SURFACE_PATCH_H
#define SP_SURFACE_PATCH_H

#include <stdbool.h>
#include <stdint.h>

enum {
    SURFACE_PARTS_MAX = 4, /* pieces per cell */
    SURFACE_BATCH = 64     /* pieces that are computed together: a multiple of every SP_WIDE */
};

/* The pieces of a cell: one piece per connected part of the inside corners. If the inside corners
 * are one part: one piece per connected part of the outside corners. */
struct sp_surface_parts {
    uint8_t count, corners[SURFACE_PARTS_MAX];
    bool are_outside;
};

/* Fills *out. inside: bit c = corner c is inside; some, but not all, corners are inside. */
void sp_surface_parts_init(unsigned inside, struct sp_surface_parts *out);

struct sp_surface_patches {
    int count;
    float f[8][SURFACE_BATCH]; /* the corners' values minus the iso-value, finite; >= 0 inside */
    int32_t corners[SURFACE_BATCH]; /* of the part */
    float sign[SURFACE_BATCH];      /* 1: the part is inside, -1: outside */
    float at[3][SURFACE_BATCH];     /* output: place in the cell, [0, 1] */
    float area[3][SURFACE_BATCH]; /* output: vector area in faces of the cell, inside to outside */
};

/* Computes places and areas. The elements behind the last piece, up to a multiple of SP_WIDE, must
 * be initialised. */
void sp_surface_patches_compute(struct sp_surface_patches *patches);

#endif
