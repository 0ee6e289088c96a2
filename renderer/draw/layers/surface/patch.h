/* SPDX-License-Identifier: Apache-2.0
 *
 * The pieces of surface in cells. A corner c has the place (c & 1, c >> 1 & 1, c >> 2).
 */
#ifndef SP_SURFACE_PATCH_H
#define SP_SURFACE_PATCH_H

#include <stdbool.h>
#include <stdint.h>

enum {
    SURFACE_PARTS_MAX = 4, /* pieces per cell */
    SURFACE_BATCH = 64     /* pieces that are made together: a multiple of every SP_WIDE */
};

/* One piece per connected part of the inside corners or, if there is one, of the outside ones. */
struct sp_surface_parts {
    uint8_t count, corners[SURFACE_PARTS_MAX];
    bool are_outside;
};

/* inside: bit c = corner c is inside; not all and not none. */
void sp_surface_parts_init(unsigned inside, struct sp_surface_parts *out);

struct sp_surface_patches {
    int count;
    float f[8][SURFACE_BATCH]; /* the corners' values minus the iso-value, finite; >= 0 inside */
    int32_t corners[SURFACE_BATCH]; /* of the part */
    float sign[SURFACE_BATCH];      /* 1: the part is inside, -1: outside */
    float at[3][SURFACE_BATCH];     /* found: place in the cell, [0, 1] */
    float area[3][SURFACE_BATCH];   /* found: vector area in faces of the cell, inside to outside */
};

/* Finds places and areas. What lies behind the last piece must be initialised. */
void sp_surface_patches_compute(struct sp_surface_patches *patches);

#endif
