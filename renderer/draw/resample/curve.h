/* SPDX-License-Identifier: Apache-2.0
 *
 * The transfer function for intervals of a ray (Engel, Kraus and Ertl 2001): between two samples
 * the value changes linearly, so its mean optical depth and colour are a difference of integrals.
 *
 *   mean of f over [a, b] = (F(b) − F(a))/(b − a)        F = ∫ f
 *
 * Samples are stored as 16-bit *codes*, evenly spaced over the values that matter.
 */
#ifndef SP_RESAMPLE_CURVE_H
#define SP_RESAMPLE_CURVE_H

#include "base/parallel_for.h"
#include "classify/transfer.h"

enum {
    CURVE_BINS = 4096,
    CURVE_CODE_MIN = 1024, /* the code of the smallest value that matters */
    CURVE_CODE_MAX = 31744,
    CURVE_CODE_NONE = 0 /* of a sample that is not finite: below all bins, transparent */
};

struct sp_curve {
    double base, codes_per_unit; /* code = CURVE_CODE_MIN + (value − base)·codes_per_unit */
    double data[2];              /* range of the data; real numbers outside count as not finite */
    /* bin = code·bins_per_code + first_bin. Bin 0 and all lower values are transparent. */
    float bins_per_code, first_bin;
    float above[4];   /* what values above all bins add per bin */
    bool has_above;   /* false: they are transparent */
    float visible[2]; /* range of codes; codes outside are transparent */
    /* Integrals up to the start of each bin, of red, green and blue times depth, and of depth
     * [bins]. */
    float (*integral)[4]; /* [CURVE_BINS + 2] */
    const struct sp_transfer_function *tf;
};

enum { CURVE_BYTES = (CURVE_BINS + 2) * 4 * (int)sizeof(float) };

/* Fills the curve for a volume with values in `range`. `integral`: CURVE_BYTES of memory, 16-byte
 * aligned. The curve borrows `integral` and `tf`: they must live as long as the curve. */
void sp_curve_init(struct sp_curve *curve, const struct sp_transfer_function *tf,
                   const double range[2], float (*integral)[4], struct sp_pool *pool);

/* True if the transfer function makes any value of [low, high] visible. The range may be empty. */
bool sp_curve_shows(const struct sp_transfer_function *tf, double low, double high);
/* True if the transfer function makes all values of [low, high] visible, except single values. */
bool sp_curve_shows_all(const struct sp_transfer_function *tf, double low, double high);

#endif
