/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/missing.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "data/volume/volume.h"

/* Values that programs use, whatever the others are: of rasters and tables, of the types of whole
 * numbers, and of CT scanners outside their circle. Fill values such as 1e20 lie so far away that
 * they need no list. Zero is a measurement. */
static bool is_usual(double value) {
    static const double known[] = { -9999,   -99999, 9999,   99999, -999,     -9999.9, -999.9,
                                    -999.99, -32768, -32767, 32767, 65535,    -2000,   -2048,
                                    -3024,   -8192,  -1e4,   -1e5,  INT32_MIN };
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (fabs(value - known[i]) < 1e-6 * fabs(known[i])) /* as float */
            return true;
    return false;
}

void sp_missing_limits(const struct sp_volume_info *info, double limits[2]) {
    const double beside = 0.02; /* of the range of the data */
    const double span = info->data[1] - info->data[0];
    memcpy(limits, sp_volume_limits(info), sizeof info->range);
    if (info->whole.dims[0] || !sp_missing_are_there(info))
        return;
    limits[0] = fmax(limits[0], info->data[0] - beside * span);
    limits[1] = fmin(limits[1], info->data[1] + beside * span);
}

bool sp_missing_is_likely(const uint64_t histogram[SP_HISTOGRAM_BINS], int side) {
    enum { BESIDE = SP_HISTOGRAM_BINS / 16 };
    const int end = side ? SP_HISTOGRAM_BINS - 1 : 0, step = side ? -1 : 1;
    for (int i = 1; i <= BESIDE; i++)
        if (histogram[end + step * i])
            return false;
    return true;
}

bool sp_missing_is(const struct sp_extreme *e) {
    const uint64_t often = 8;
    /* Halves, because spans of float64 may overflow. */
    const double gap = fabs(e->next / 2 - e->value / 2), spread = fabs(e->far / 2 - e->next / 2);
    /* Below the data, a value that is far away is at most surroundings. Above them it may be an
     * object of one value, so it must be out of all proportion. */
    const bool is_below = e->value < e->next;
    const double least = is_usual(e->value) ? 0.1 : is_below ? 1.5 : 1e4;
    return e->count >= often && spread > 0 && gap > least * spread && (!is_below || e->value < 0);
}

void sp_missing_note(struct sp_volume_info *info, double value, uint64_t count, uint64_t all) {
    for (int i = 0; i < SP_WARNINGS_MAX; i++)
        if (!info->warnings[i][0]) {
            snprintf(info->warnings[i], sizeof info->warnings[i],
                     "The value %g, which %.2g %% of the samples have, seems to stand for missing "
                     "data. The histogram and the first window leave it out.",
                     value, 100.0 * (double)count / (double)all);
            return;
        }
}
