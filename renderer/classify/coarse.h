/* SPDX-License-Identifier: Apache-2.0
 *
 * Coarse levels: 2×2×2 voxels averaged after classification, for pictures that must be quick.
 *
 *   extinction = Σ depth / 8      colour = Σ colour·depth / Σ depth      normal = Σ ±gradient·depth
 * / Σ depth
 *
 * Averaging what was classified keeps the energy of thin structures, which averaging the samples
 * would push under the threshold of the transfer function. The grid has half the samples an axis,
 * rounded up; its first sample lies in the middle of the eight that it stands for.
 */
#ifndef SP_CLASSIFY_COARSE_H
#define SP_CLASSIFY_COARSE_H

#include "classify/visible.h"

/* The grid of the next coarser level. */
void sp_coarse_grid(const struct sp_grid *fine, struct sp_grid *coarse);

/* Makes *coarse, which is empty, from fine->lists[2]: its grid, its table of classes (one an entry:
 * key = entry) and its list along axis 2, with normals if the fine list has them. On failure
 * *coarse is left for sp_level_finish(): SP_ERR_MEMORY, SP_ERR_BUDGET
 * (job->bytes_max is what this level may take), SP_ERR_CANCELLED. */
bool sp_coarse_make(struct sp_level *coarse, const struct sp_level *fine,
                    const struct sp_classify_job *job, struct sp_error *err);

#endif
