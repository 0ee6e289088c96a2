/* SPDX-License-Identifier: Apache-2.0
 *
 * Values that stand for missing data: −9999, −32768, 1e20, the padding of a scanner. They are
 * samples like all others, but a window or a histogram that reaches to them would show nothing
 * else.
 */
#ifndef SP_VOLUME_MISSING_H
#define SP_VOLUME_MISSING_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/volume.h"

/* The lowest or the highest value of a volume, and its neighbour. */
struct sp_extreme {
    double value, next; /* next: the nearest other value */
    double far;         /* the other end of the range */
    uint64_t count;     /* samples of this value */
};

/* True if the bins beside the first one (side 0) or the last one (side 1) are empty, as they are
 * where its value is far from all others. */
bool sp_missing_is_likely(const uint64_t histogram[SP_HISTOGRAM_BINS], int side);

/* True if the extreme value stands for missing data: it occurs often, and lies far from all others:
 * below zero and farther than they spread, or above them and out of all proportion; or less far, if
 * it is one that programs use for that. */
bool sp_missing_is(const struct sp_extreme *extreme);

/* The range of the data; that of all samples if it was not measured for values that stand for
 * missing data. */
static inline const double *sp_missing_data(const struct sp_volume_info *info) {
    return info->data[1] > info->data[0] ? info->data : info->range;
}

/* True if values that stand for missing data lie outside of the data. */
static inline bool sp_missing_are_there(const struct sp_volume_info *info) {
    const double *data = sp_missing_data(info);
    return data[0] > info->range[0] || data[1] < info->range[1];
}

/* True if samples are left out: those that are not finite, and of real numbers those that stand for
 * missing data. */
static inline bool sp_missing_are_holes(const struct sp_volume_info *info) {
    const bool is_real = info->type == SP_FLOAT32 || info->type == SP_FLOAT64;
    return info->nonfinite > 0 || (is_real && sp_missing_are_there(info));
}

/* The limits of the volume (volume.h), but values that stand for missing data count as the limit
 * that is next to them, a little outside of the data. */
void sp_missing_limits(const struct sp_volume_info *info, double limits[2]);

/* Adds a note about a value to info->warnings. */
void sp_missing_note(struct sp_volume_info *info, double value, uint64_t count, uint64_t all);

#endif
