/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses which values are visible, with which opacity and colour.
 */
#ifndef SP_DEFAULT_VIEW_TRANSFER_H
#define SP_DEFAULT_VIEW_TRANSFER_H

#include "data/default_view/samples.h"
#include "sp/view.h"

/* Fills points, point_count and reference_length of *tf; the rest stays. True if the volume is a
 * smooth field, or if its inside is shown through a shell: then light matters less than values. */
bool sp_default_transfer(const struct sp_default_samples *samples, struct sp_transfer_function *tf);

/* Splits the bins [begin, end) into `count` classes, at most 4, with the least variance inside them
 * (Otsu 1979, by dynamic programming over the cuts). Counts are damped to their square root, so
 * that a large class does not decide alone. cut[c] becomes the first bin of class c, cut[count] the
 * end.
 */
void sp_default_split(const uint64_t histogram[SP_FIRST_BINS], unsigned begin, unsigned end,
                      unsigned count, unsigned *cut);

/* Computes the extinction in the middle of each bin, per world unit. */
void sp_default_extinction(const struct sp_default_samples *samples,
                           const struct sp_transfer_function *tf, double extinction[SP_FIRST_BINS]);

#endif
