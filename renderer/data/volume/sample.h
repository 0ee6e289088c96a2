/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_VOLUME_SAMPLE_H
#define SP_VOLUME_SAMPLE_H

#include <stddef.h>
#include <stdint.h>

#include "sp/volume.h"

#define SP_TYPE_CASE(type, T, run)                                                                 \
    case type:                                                                                     \
        run(T);                                                                                    \
        break;

/* The cases of a switch over enum sp_type, which run `run(T)` with the C type T of the samples:
 * SP_SHORT_CASES for types of at most 16 bits, SP_TYPE_CASES for all types. */
#define SP_SHORT_CASES(run)                                                                        \
    SP_TYPE_CASE(SP_UINT8, uint8_t, run)                                                           \
    SP_TYPE_CASE(SP_INT8, int8_t, run)                                                             \
    SP_TYPE_CASE(SP_UINT16, uint16_t, run)                                                         \
    SP_TYPE_CASE(SP_INT16, int16_t, run)
#define SP_TYPE_CASES(run)                                                                         \
    SP_SHORT_CASES(run)                                                                            \
    SP_TYPE_CASE(SP_INT32, int32_t, run)                                                           \
    SP_TYPE_CASE(SP_FLOAT32, float, run)                                                           \
    SP_TYPE_CASE(SP_FLOAT64, double, run)                                                          \
    case SP_TYPE_COUNT:                                                                            \
        break;

/* Returns sample `at` of an array of that type. NaN and infinities are returned unchanged. */
static inline double sp_sample(const void *voxels, enum sp_type type, uint64_t at) {
    switch (type) {
#define SAMPLE(T) return (double)((const T *)voxels)[at]
        SP_TYPE_CASES(SAMPLE)
#undef SAMPLE
    }
    return 0;
}

/* Sets sample `at` of an array of that type. The value must lie in the range of the type; a
 * fraction that the type cannot hold is cut off. */
static inline void sp_sample_set(void *voxels, enum sp_type type, uint64_t at, double value) {
    switch (type) {
#define SET(T) ((T *)voxels)[at] = (T)value
        SP_TYPE_CASES(SET)
#undef SET
    }
}

/* Writes samples [begin, begin + n) of an array of that type as doubles, which hold them exactly.
 */
void sp_samples_to_doubles(const void *voxels, enum sp_type type, size_t begin, size_t n,
                           double *out);

#endif
