/* SPDX-License-Identifier: Apache-2.0
 *
 * Weighted mean and deviation of many values, which are added in runs. The mean and deviation of a
 * run are computed in two passes and then merged into the sums:
 *
 * Chan, Golub, LeVeque: Updating Formulae and a Pairwise Algorithm for Computing Sample Variances,
 * COMPSTAT 1982, eq. 1.5, with weights for counts. No difference of large sums occurs, so a large
 * mean costs no digits.
 */
#ifndef SP_MEASURE_STATISTICS_H
#define SP_MEASURE_STATISTICS_H

#include "sp/measure.h"

enum { SP_RUN = 512 };

struct sp_run {
    unsigned count; /* [0, SP_RUN] */
    double values[SP_RUN], weights[SP_RUN];
};

struct sp_sums { /* {0} at the beginning */
    uint64_t count, nonfinite;
    double weights, squares; /* Σw, Σw² */
    double mean, moment;     /* moment: Σ w(x − mean)² */
    double min, max;
};

/* Adds a run of values with weights above 0. */
void sp_sums_add(struct sp_sums *sums, const struct sp_run *run);
void sp_sums_finish(const struct sp_sums *sums, struct sp_statistics *statistics);

#endif
