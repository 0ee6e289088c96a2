/* SPDX-License-Identifier: Apache-2.0
 *
 * The sample that stands for several samples in a coarser level of labels. A mean of labels would
 * be the label of something else.
 */
#ifndef SP_VOLUME_MAJORITY_H
#define SP_VOLUME_MAJORITY_H

/* Returns the most frequent of `count` > 0 finite values; of equally frequent values, the first. */
static inline double sp_majority(const double *values, int count) {
    double found = values[0];
    int most = 0;
    for (int i = 0; i < count && 2 * most < count; i++) {
        int same = 0;
        for (int k = i; k < count; k++)
            same += values[k] == values[i];
        found = same > most ? values[i] : found;
        most = same > most ? same : most;
    }
    return found;
}

#endif
