/* SPDX-License-Identifier: Apache-2.0
 *
 * How noisy the samples of a volume are. At a surface without noise, a fine and a smooth gradient
 * point to the same side. So the part of a fine gradient across a smooth one is a measure of noise:
 *
 *   fine     per axis, differences over one sample, interpolated as images are (degree 5)
 *   smooth   Sobel's operator in three dimensions: the means (1, 2, 1)/4 of differences over two
 *   across   fine − its part in the direction of smooth
 *
 * Of 4,096 to 32,768 places, one per 2,048 voxels, spread evenly, the quarter with the longest
 * smooth gradients counts: these are surfaces. The median of `across` there is the noise, in such a
 * unit that white noise of deviation s gives s. Details of the data also count if most surfaces
 * have some (measured: at most 0.5 % of the range for exact fields, but 1.3 % for a field that
 * oscillates everywhere; 0.4 to 2 % for scans).
 */
#ifndef SP_VOLUME_NOISE_H
#define SP_VOLUME_NOISE_H

#include "base/parallel_for.h"
#include "sp/volume.h"

/* Returns the standard deviation of the noise [data unit]; 0 if all samples are equal, for labels,
 * and if an axis has fewer than 7 samples. info: grid, type, meaning and data[] of the voxels. The
 * result does not depend on the number of threads. False without memory. */
bool sp_noise_estimate(const struct sp_volume_info *info, const void *voxels, struct sp_pool *pool,
                       double *noise);

#endif
