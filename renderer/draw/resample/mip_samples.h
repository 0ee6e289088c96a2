/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples of one mip level.
 *
 * A region holds 4 × 4 × 4 cells between samples. Its range includes what interpolation inside of
 * it may give, so that a transfer function which shows nothing of the range shows nothing of the
 * region. Where it may show something, the four intervals between slices are looked at one by one.
 */
#ifndef SP_RESAMPLE_MIP_SAMPLES_H
#define SP_RESAMPLE_MIP_SAMPLES_H

#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "data/volume/blocks.h"
#include "draw/resample/curve.h"
#include "sp/view.h"
#include "sp/volume.h"

enum { SAMPLES_REGION = 4, SAMPLES_CLASSES = 4 };

/* Samples as a transfer function shows them. */
struct sp_samples_class {
    struct sp_transfer_function tf;
    unsigned axis;         /* of the slices */
    struct sp_curve curve; /* owns its integral */
    /* By region: bit k = something between its slices k and k + 1 may be visible. */
    uint8_t *visible;
    uint64_t visible_count; /* regions with a bit */
    uint64_t used;          /* when it was asked for last; 0 = it is not filled */
    uint64_t made;          /* number of these contents, which no others of the cache have */
};

struct sp_samples {
    const void *voxels;             /* of the volume, or `owned`; NULL = they lie in blocks */
    const struct sp_blocks *blocks; /* of the volume, or NULL */
    void *owned;
    void *turned; /* the same samples with axis 0 last, owned; NULL = there was no memory or no need
                   */
    enum sp_type type; /* as in the volume */
    uint64_t made;     /* number of these samples, which no others of the cache have */
    uint32_t dims[3];
    uint32_t regions[3]; /* per axis, at least 1 */
    float (*range)[2];   /* by region, first axis fastest: smallest and largest value, data unit;
                            {∞, −∞} without finite samples, {−∞, ∞} with other ones, too */
    struct sp_samples_class classes[SAMPLES_CLASSES]; /* that frames have asked for */
};

#endif
