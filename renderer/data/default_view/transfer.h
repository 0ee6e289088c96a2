/* SPDX-License-Identifier: Apache-2.0
 *
 * Which values are visible, how much and in which colour.
 */
#ifndef SP_DEFAULT_VIEW_TRANSFER_H
#define SP_DEFAULT_VIEW_TRANSFER_H

#include "data/default_view/samples.h"
#include "sp/view.h"

/* Fills points, point_count and reference_length of *tf; the rest stays. True if the volume is a
 * smooth field, or if its inside is shown through a shell: then light matters less than values. */
bool sp_default_transfer(const struct sp_default_samples *samples, struct sp_transfer_function *tf);

/* Extinction in the middle of each bin, per world unit. */
void sp_default_extinction(const struct sp_default_samples *samples,
                           const struct sp_transfer_function *tf, double extinction[SP_FIRST_BINS]);

#endif
