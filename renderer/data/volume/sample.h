/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_VOLUME_SAMPLE_H
#define SP_VOLUME_SAMPLE_H

#include <stddef.h>
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

/* Sets sample `at` of an array of that type. The value must lie in the range of the type; a
 * fraction that the type cannot hold is cut off. */
static inline void sp_sample_set(void *voxels, enum sp_type type, uint64_t at, double value) {
    switch (type) {
    case SP_UINT8:
        ((uint8_t *)voxels)[at] = (uint8_t)value;
        break;
    case SP_INT8:
        ((int8_t *)voxels)[at] = (int8_t)value;
        break;
    case SP_UINT16:
        ((uint16_t *)voxels)[at] = (uint16_t)value;
        break;
    case SP_INT16:
        ((int16_t *)voxels)[at] = (int16_t)value;
        break;
    case SP_INT32:
        ((int32_t *)voxels)[at] = (int32_t)value;
        break;
    case SP_FLOAT32:
        ((float *)voxels)[at] = (float)value;
        break;
    case SP_FLOAT64:
        ((double *)voxels)[at] = value;
        break;
    case SP_TYPE_COUNT:
        break;
    }
}

/* Writes samples [begin, begin + n) of an array of that type as doubles, which hold them exactly.
 */
void sp_samples_to_doubles(const void *voxels, enum sp_type type, size_t begin, size_t n,
                           double *out);

#endif
