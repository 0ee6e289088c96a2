/* SPDX-License-Identifier: Apache-2.0
 *
 * Loops over the samples of a box, for each type.
 */
#ifndef SP_BRICKS_SAMPLES_H
#define SP_BRICKS_SAMPLES_H

#include "sp/volume.h"

/* A box inside of an array of samples, i0 fastest. */
struct sp_brick_view {
    const void *samples; /* of the array's sample (0, 0, 0) */
    enum sp_type type;
    bool are_labels;
    size_t width, height; /* of the array: samples per row, rows per slice */
    uint32_t first[3], size[3];
};

/* The finite samples of a box. */
struct sp_brick_range {
    double least, most; /* least > most = there are none */
    uint64_t nonfinite;
    bool is_constant; /* all samples have the same bytes */
};
struct sp_brick_range sp_brick_measure_range(const struct sp_brick_view *view);

/* Copies the samples of a box, one after the other. */
void sp_brick_copy(const struct sp_brick_view *view, void *out);

/* Writes the means of 2 × 2 × 2 samples of the box, whose first sample has even coordinates. Only
 * finite samples count; the mean is NaN if there are none. At an odd end, a mean has fewer samples.
 * Of labels it writes the most frequent sample. The output has (size + 1)/2 samples per axis.
 * Integers are rounded as in draw/resample/levels.c. */
void sp_brick_average(const struct sp_brick_view *view, void *out);

/* Like sp_brick_average(), for vectors, whose components are the samples of the view. Only finite
 * vectors count; the mean is NaN if there are none. */
void sp_brick_average_vectors(const struct sp_brick_view *view, float (*out)[3]);

/* Returns the length of the longest finite vector; 0 = there is none. */
double sp_brick_longest(const float (*vectors)[3], size_t count);

/* Adds the finite samples to a histogram of the range. */
void sp_brick_count_values(const void *samples, enum sp_type type, size_t count,
                           const double range[2], uint64_t histogram[SP_HISTOGRAM_BINS]);

#endif
