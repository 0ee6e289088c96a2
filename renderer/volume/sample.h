/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_VOLUME_SAMPLE_H
#define SP_VOLUME_SAMPLE_H

#include <stdint.h>

#include "sp/volume.h"

/* Returns sample `at` of an array of that type. NaN and infinities are returned unchanged. */
static inline double sp_sample(const void *voxels, enum sp_type type, uint64_t at) {
    switch (type) {
    case SP_UINT8:
        return ((const uint8_t *)voxels)[at];
    case SP_INT8:
        return ((const int8_t *)voxels)[at];
    case SP_UINT16:
        return ((const uint16_t *)voxels)[at];
    case SP_INT16:
        return ((const int16_t *)voxels)[at];
    case SP_INT32:
        return ((const int32_t *)voxels)[at];
    case SP_FLOAT32:
        return (double)((const float *)voxels)[at];
    case SP_FLOAT64:
        return ((const double *)voxels)[at];
    case SP_TYPE_COUNT:
        break;
    }
    return 0;
}

#endif
