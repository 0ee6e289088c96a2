/* SPDX-License-Identifier: Apache-2.0
 *
 * The numbers that give the colours of merged points (color_by): for each cell, the mean of the
 * numbers of the points inside, weighted by the volumes of the points. Numbers that are not finite
 * do not count; a cell that has no finite number has NaN.
 */
#ifndef SP_CLOUD_COLORS_H
#define SP_CLOUD_COLORS_H

#include "base/interrupt.h"
#include "base/parallel_for.h"
#include "draw/layers/cloud/kernels.h"

/* Fills numbers[tree->count] for the colouring of the cloud. The result is bit-equal for any number
 * of threads. SP_ERR_MEMORY, SP_ERR_CANCELLED. */
bool sp_cloud_merge_colors(const struct sp_cloud *cloud, const struct sp_cloud_tree *tree,
                           struct sp_pool *pool, const struct sp_interrupt *interrupt,
                           float *numbers, struct sp_error *err);

#endif
