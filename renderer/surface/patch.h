/* SPDX-License-Identifier: Apache-2.0
 *
 * The pieces of surface in one cell. A corner c has the place (c & 1, c >> 1 & 1, c >> 2).
 */
#ifndef SP_SURFACE_PATCH_H
#define SP_SURFACE_PATCH_H

#include <stdint.h>

enum { SURFACE_PATCHES_MAX = 4 }; /* per cell */

struct sp_surface_patch {
    float at[3];   /* in the cell, [0, 1] */
    float area[3]; /* vector area, in faces of the cell, from inside to outside */
};

/* Number of pieces of a cell whose inside corners are the bits of `inside`, not all and not none.
 */
int sp_surface_patch_count(unsigned inside);

/* Writes the pieces of a cell and returns their number; f: value at each corner minus the
 * iso-value, finite, and >= 0 inside. */
int sp_surface_patches(const float f[8], struct sp_surface_patch out[SURFACE_PATCHES_MAX]);

#endif
