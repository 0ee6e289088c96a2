/* SPDX-License-Identifier: Apache-2.0
 *
 * The first view of a volume: the default that sp_view_choose() finds in its samples.
 *
 *   samples.c ──► transfer.c ──► orient.c ──► frame.c
 *   an even       what is        which side   how close
 *   choice        visible        is up
 *
 * README.md states the rules. The result depends on the samples alone, not on threads or time.
 */
#ifndef SP_DEFAULT_VIEW_SAMPLES_H
#define SP_DEFAULT_VIEW_SAMPLES_H

#include <stdbool.h>
#include <stddef.h>

#include "sp/volume.h"

enum {
    SP_FIRST_SIDE = 128,        /* samples along an axis at most */
    SP_FIRST_BINS = 256,        /* values are sorted into bins between `low` and `high` */
    SP_FIRST_NONE = UINT16_MAX, /* the bin of a sample that is not finite */
};

struct sp_default_samples {
    const struct sp_volume_info *info; /* borrowed */
    uint32_t begin[3], dims[3];        /* the box of voxels that the samples come from */
    uint32_t count[3];                 /* [1, SP_FIRST_SIDE] samples along each axis */
    double *along[3]; /* distance of these samples along their axis, world units; owned */
    double cell[3];   /* mean distance between them; world units */
    double low, high; /* nearly all values; low < high */
    bool is_log;      /* bins have equal ratios: the values span many powers of ten; low > 0 */
    uint16_t *bins;   /* product(count), axis 0 fastest, [0, SP_FIRST_BINS) or NONE; owned */
    uint64_t histogram[SP_FIRST_BINS];
    /* Histograms of the outermost samples of the volume: face 2·axis is the first layer, 2·axis + 1
     * the last. Empty for an axis of fewer than 4 samples. */
    uint64_t faces[6][SP_FIRST_BINS];
};

/* Takes samples of a box of voxels; begin NULL = of the whole volume. False if memory runs out, or
 * if the volume has no two different finite samples; then nothing has to be finished. */
bool sp_default_samples_init(struct sp_default_samples *samples, const struct sp_volume *volume,
                             const uint32_t begin[3], const uint32_t dims[3]);
void sp_default_samples_finish(struct sp_default_samples *samples);

/* Returns the value at the lower end of a bin; bin may be SP_FIRST_BINS. */
double sp_default_value(const struct sp_default_samples *samples, double bin);

/* Computes the world position of a taken sample. */
void sp_default_position(const struct sp_default_samples *samples, const uint32_t at[3],
                         double position[3]);

#endif
