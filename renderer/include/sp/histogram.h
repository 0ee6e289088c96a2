/* SPDX-License-Identifier: Apache-2.0
 *
 * The joint histogram of value and gradient magnitude, for an editor of transfer functions
 * (Kindlmann and Durkin, Semi-Automatic Generation of Transfer Functions, 1998). The histogram of
 * the values alone is in struct sp_volume_info.
 */
#ifndef SP_HISTOGRAM_H
#define SP_HISTOGRAM_H

#include <stdint.h>

#include "sp/api.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SP_JOINT_VALUES = 128, SP_JOINT_GRADIENTS = 64, SP_JOINT_SAMPLES = 1 << 18 };

struct sp_joint_histogram {
    double values[2];    /* range of the values of the volume, as sp_volume_info.range */
    double gradients[2]; /* 0 and the largest magnitude found [data units per world unit]; 1 if all
                            are 0 */
    uint64_t samples;    /* number of counted samples; only finite samples are counted */
    /* Bins of equal width; the last bin of an axis includes the upper end of its range. */
    uint32_t counts[SP_JOINT_GRADIENTS][SP_JOINT_VALUES];
};

/* Counts every sample of a volume that has at most SP_JOINT_SAMPLES. Of a larger volume, it counts
 * one sample at a pseudo-random place in each of SP_JOINT_SAMPLES equal parts of the array. The
 * places are the same in every call. Gradients are central differences, as in the gradient axis of
 * a view. Takes tens of milliseconds on one thread, for a volume of any size. False: SP_ERR_MEMORY.
 * Thread-safe. */
SP_API bool sp_joint_histogram_count(const struct sp_volume *volume,
                                     struct sp_joint_histogram *histogram, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
