/* SPDX-License-Identifier: Apache-2.0
 *
 * Coarse levels: 2×2×2 voxels averaged after classification, for pictures that must be quick.
 *
 *   extinction = Σ depth·v / V      colour = Σ colour·depth·v / Σ depth·v
 *   flakes = means of |normal·axis|, by depth·v        (microflakes.h; order post: mean gradients)
 *
 * with v a voxel's volume and V the coarse one's. Averaging what was classified keeps the energy of
 * thin structures, which averaging the samples would push under the threshold of the transfer
 * function. The grid has half the samples an axis, rounded up; a sample lies in the middle of the
 * cells that it stands for.
 */
#ifndef SP_CLASSIFY_MIP_H
#define SP_CLASSIFY_MIP_H

#include "classify/classification.h"

/* Makes coarse->grid of the next finer one, with coordinates of its own where that one is not even.
 * SP_ERR_MEMORY. */
bool sp_mip_grid(struct sp_level *coarse, const struct sp_grid *fine, struct sp_error *err);

/* Makes *coarse, which is empty, from *fine: its grid, its table of classes (one an entry: key =
 * entry) and its list, with flakes if the fine list has normals or flakes; order post: normals. On
 * failure *coarse is left for sp_level_finish(): SP_ERR_MEMORY, SP_ERR_BUDGET (job->bytes_max is
 * what this level may take), SP_ERR_CANCELLED. */
bool sp_mip_make(struct sp_level *coarse, const struct sp_level *fine,
                 const struct sp_classify_job *job, struct sp_error *err);

#endif
