/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples of a block of cells and those one farther, minus the iso-value, scaled to about ±2,
 * and their slopes.
 */
#ifndef SP_SURFACE_WINDOW_H
#define SP_SURFACE_WINDOW_H

#include "draw/layers/surface/ranges.h"

enum {
    SURFACE_WINDOW = SURFACE_BLOCK + 3, /* samples per axis */
    SURFACE_WINDOW_ROW = 16,            /* floats per row: vectors may go beyond the samples */
    SURFACE_SLOPES = SURFACE_BLOCK + 1, /* samples of the block per axis */
    SURFACE_SLOPES_ROW = 12
};

struct sp_surface_window {
    /* [z][y][x], from the sample before the block on; NaN beyond the volume and where a sample is
     * not finite. */
    float f[SURFACE_WINDOW][SURFACE_WINDOW][SURFACE_WINDOW_ROW];
    float gap[3][SURFACE_WINDOW_ROW]; /* from each sample to the next one, world units */
};

/* Along each axis, at the samples of the block [1/world unit]: central differences; one-sided
 * beside samples that are missing; 0 between two of them. */
struct sp_surface_slopes {
    float along[3][SURFACE_SLOPES * SURFACE_SLOPES * SURFACE_SLOPES_ROW];
};

/* The samples of the block, bit x of [z][y]. */
struct sp_surface_bits {
    uint16_t inside[SURFACE_SLOPES][SURFACE_SLOPES], finite[SURFACE_SLOPES][SURFACE_SLOPES];
};

void sp_surface_window_read(struct sp_surface_window *window, const struct sp_volume *volume,
                            double value, const uint32_t corner[3]);
void sp_surface_window_compare(const struct sp_surface_window *window, struct sp_surface_bits *out);
void sp_surface_window_slopes(const struct sp_surface_window *window,
                              struct sp_surface_slopes *out);

#endif
