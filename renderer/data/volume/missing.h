/* SPDX-License-Identifier: Apache-2.0
 *
 * Values that stand for missing data: −9999, −32768, 1e20, the padding of a scanner. They are
 * ordinary samples, but they lie so far from the data that a window or a histogram that includes
 * them would show nothing else.
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

/* True if the bins next to the first bin (side 0) or the last bin (side 1) are empty: the extreme
 * value is far from all other values. */
bool sp_missing_is_likely(const uint64_t histogram[SP_HISTOGRAM_BINS], int side);

/* True if the extreme value stands for missing data: it occurs often and lies far from all other
 * values. Far means: below zero, at a distance larger than the spread of the others; or above them,
 * at a disproportionate distance. For values that programs commonly use for missing data, a shorter
 * distance suffices. */
bool sp_missing_is(const struct sp_extreme *extreme);

/* Returns the range of the data, without values that stand for missing data; the range of all
 * samples if such values were not searched for. */
static inline const double *sp_missing_data(const struct sp_volume_info *info) {
    return info->data[1] > info->data[0] ? info->data : info->range;
}

/* True if values that stand for missing data lie outside of the data. */
static inline bool sp_missing_are_there(const struct sp_volume_info *info) {
    const double *data = sp_missing_data(info);
    return data[0] > info->range[0] || data[1] < info->range[1];
}

/* True if samples are left out: NaN and infinite samples, and in volumes of float or double also
 * values that stand for missing data. */
static inline bool sp_missing_are_holes(const struct sp_volume_info *info) {
    const bool is_real = info->type == SP_FLOAT32 || info->type == SP_FLOAT64;
    return info->nonfinite > 0 || (is_real && sp_missing_are_there(info));
}

/* Computes the limits of the volume (volume.h) without values that stand for missing data. Such
 * values count as the nearest limit, which lies slightly outside of the data. */
void sp_missing_limits(const struct sp_volume_info *info, double limits[2]);

/* Adds a note about a value to info->warnings. */
void sp_missing_note(struct sp_volume_info *info, double value, uint64_t count, uint64_t all);

#endif
