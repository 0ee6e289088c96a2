/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples of a block of cells and their neighbours, minus the iso-value and scaled to about ±2,
 * and the slopes of the samples.
 */
#ifndef SP_SURFACE_SAMPLES_H
#define SP_SURFACE_SAMPLES_H

#include "draw/layers/surface/ranges.h"

enum {
    SURFACE_SAMPLES = SURFACE_BLOCK + 3, /* samples per axis */
    SURFACE_SAMPLES_ROW = 16,            /* floats per row: vectors may go beyond the samples */
    SURFACE_SLOPES = SURFACE_BLOCK + 1,  /* samples of the block per axis */
    SURFACE_SLOPES_ROW = 12
};

struct sp_surface_samples {
    /* [z][y][x], from the sample before the block on; NaN beyond the volume and where a sample is
     * not finite. */
    float f[SURFACE_SAMPLES][SURFACE_SAMPLES][SURFACE_SAMPLES_ROW];
    float gap[3][SURFACE_SAMPLES_ROW]; /* from each sample to the next one, world units */
};

/* Slopes along each axis at the samples of the block [1/world unit]: central differences; one-sided
 * beside a missing sample, 0 between two missing samples. */
struct sp_surface_slopes {
    float along[3][SURFACE_SLOPES * SURFACE_SLOPES * SURFACE_SLOPES_ROW];
};

/* Which samples of the block are inside, and which are finite: bit x of [z][y]. */
struct sp_surface_bits {
    uint16_t inside[SURFACE_SLOPES][SURFACE_SLOPES], finite[SURFACE_SLOPES][SURFACE_SLOPES];
};

void sp_surface_samples_read(struct sp_surface_samples *samples, const struct sp_volume *volume,
                             double value, const uint32_t corner[3]);
void sp_surface_samples_compare(const struct sp_surface_samples *samples,
                                struct sp_surface_bits *out);
void sp_surface_samples_slopes(const struct sp_surface_samples *samples,
                               struct sp_surface_slopes *out);

#endif
