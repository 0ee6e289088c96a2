/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples of one mip level.
 *
 * A region holds 4 × 4 × 4 cells between samples. Its range includes all values that interpolation
 * in the region may give. If a transfer function shows no value of the range, it shows nothing of
 * the region. Otherwise each of the four intervals between slices in the region is checked.
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

/* The class of samples under a transfer function. */
struct sp_samples_class {
    struct sp_transfer_function tf;
    unsigned axis;         /* of the slices */
    struct sp_curve curve; /* owns its integral */
    /* By region: bit k = a value between its slices k and k + 1 may be visible. */
    uint8_t *visible;
    uint64_t visible_count; /* number of regions with a bit set */
    uint64_t used;          /* clock of the last use; 0 = not filled */
    uint64_t made;          /* serial number of these contents, unique in the cache */
};

struct sp_samples {
    const void *voxels;             /* the volume's, or `owned`; NULL = the samples lie in blocks */
    const struct sp_blocks *blocks; /* of the volume, or NULL */
    void *owned;
    void *turned;      /* the same samples with axis 0 last, owned; NULL = no memory or no need */
    enum sp_type type; /* as in the volume */
    uint64_t made;     /* serial number of these samples, unique in the cache */
    uint32_t dims[3];
    uint32_t regions[3]; /* per axis, at least 1 */
    /* By region, first axis fastest: smallest and largest value [data unit]. {∞, −∞} = no finite
     * samples, {−∞, ∞} = finite samples and others. */
    float (*range)[2];
    struct sp_samples_class classes[SAMPLES_CLASSES]; /* the classes that frames use */
};

#endif
