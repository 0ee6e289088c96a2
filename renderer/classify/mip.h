/* SPDX-License-Identifier: Apache-2.0
 *
 * Mip levels: 2×2×2 voxels averaged after classification.
 *
 *   extinction = Σ depth·v / V      colour = Σ colour·depth·v / Σ depth·v
 *   microflakes = means of |normal·axis|, weighted by depth·v        (microflakes.h)
 *   order post: value, gradient = means, weighted by v
 *
 * v is the volume of a voxel and V the volume of the coarse cell. Averaging after classification
 * keeps the energy of thin structures; averaged samples could fall below the threshold of the
 * transfer function. The grid has half the samples per axis, rounded up; a sample lies in the
 * middle of the cells that it replaces.
 */
#ifndef SP_CLASSIFY_MIP_H
#define SP_CLASSIFY_MIP_H

#include "classify/level.h"

/* Makes coarse->grid from the next finer grid. Along axes that are not evenly spaced, the level
 * owns the new coordinates. SP_ERR_MEMORY. */
bool sp_mip_grid(struct sp_level *coarse, const struct sp_grid *fine, struct sp_error *err);

/* Makes *coarse, which must be empty, from *fine: its grid, its table of classes (one class per
 * entry: key = entry) and its list. The list has microflakes if the fine list has normals or
 * microflakes; order post: normals. job->bytes_max limits this level alone. After a failure call
 * sp_level_finish() on *coarse: SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
bool sp_mip_make(struct sp_level *coarse, const struct sp_level *fine,
                 const struct sp_classify_job *job, struct sp_error *err);

#endif
