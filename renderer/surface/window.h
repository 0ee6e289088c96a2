/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples of a block of cells and those one farther, minus the iso-value, scaled to about ±2.
 */
#ifndef SP_SURFACE_WINDOW_H
#define SP_SURFACE_WINDOW_H

#include "surface/ranges.h"

enum { SURFACE_WINDOW = SURFACE_BLOCK + 3 }; /* samples per axis */

struct sp_surface_window {
    /* [z][y][x], from the sample before the block on; NaN beyond the volume and where a sample is
     * not finite. */
    float f[SURFACE_WINDOW][SURFACE_WINDOW][SURFACE_WINDOW];
    float gap[3][SURFACE_WINDOW]; /* from each sample to the next one, world units */
};

void sp_surface_window_read(struct sp_surface_window *window, const struct sp_volume *volume,
                            double value, const uint32_t corner[3]);

/* The slopes along the axes at a sample of the block [1/world unit]: central differences; one-sided
 * beside samples that are missing; 0 between two of them. */
void sp_surface_window_slope(const struct sp_surface_window *window, int x, int y, int z,
                             float slope[3]);

#endif
