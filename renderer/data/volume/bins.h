/* SPDX-License-Identifier: Apache-2.0
 *
 * Bins of equal width between two values. Every histogram of samples uses them, because the values
 * come from files: the distance of the ends may overflow a double, or be too small for one.
 */
#ifndef SP_VOLUME_BINS_H
#define SP_VOLUME_BINS_H

#include <math.h>

struct sp_bins {
    double factor; /* a power of two, so that it rounds nothing: values are multiplied first */
    double low, span;
    double count;
};

/* low, high: finite. If high is not above low, all values are in the first bin. */
static inline struct sp_bins sp_bins_between(double low, double high, unsigned count) {
    const double factor = fmax(fabs(low), fabs(high)) < 1 ? 0x1p64 : 0.5;
    const double span = high * factor - low * factor;
    return (struct sp_bins){ factor, low * factor, span > 0 ? span : INFINITY, count };
}

/* Returns the bin of a value, [0, count): the last one for `high`. Values outside of the range,
 * infinities and NaN get the first or the last bin, so the caller must leave out values that do not
 * count. Where denormals are flushed to zero (base/parallel_for.h), they get the bin of zero. */
static inline unsigned sp_bin_of(const struct sp_bins *bins, double value) {
    const double bin = (value * bins->factor - bins->low) / bins->span * bins->count;
    return bin > 0 ? (unsigned)fmin(bin, bins->count - 1) : 0;
}

#endif
