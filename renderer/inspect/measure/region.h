/* SPDX-License-Identifier: Apache-2.0
 *
 * Statistics of a rectangle or an ellipse in a plane, as sp/measure.h defines them.
 *
 *   region ─► lattice: rows of samples (of the grid, or of cells on an oblique plane)
 *                 │ first pass: weighted mean and deviation, minimum, maximum
 *                 └ second pass: histogram from minimum to maximum
 */
#ifndef SP_MEASURE_REGION_H
#define SP_MEASURE_REGION_H

#include "sp/measure.h"

/* Returns an upper bound of the samples that sp_region_compute() reads. */
double sp_region_cost(const struct sp_volume *volume, const struct sp_measure *region);
/* Fills the statistics and the histogram of *result. False with *err set: the region has more than
 * SP_MEASURE_SAMPLES samples. */
bool sp_region_compute(const struct sp_volume *volume, const struct sp_measure *region,
                       struct sp_measure_result *result, struct sp_error *err);

#endif
