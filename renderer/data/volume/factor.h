/* SPDX-License-Identifier: Apache-2.0
 *
 * The triangular factors L of variances L·Lᵀ, as struct sp_elements has them.
 */
#ifndef SP_VOLUME_FACTOR_H
#define SP_VOLUME_FACTOR_H

/* Computes the factor L of the variance M·Mᵀ. */
void sp_factor(const double m[3][3], float factor[6]);

/* Computes the factor for a Gaussian with the standard deviations `scales` along axes that the
 * quaternion (w, x, y, z) rotates: M = R·diag(scales). The quaternion may have any length; length 0
 * means no rotation. */
void sp_gaussian_factor(const double scales[3], const double rotation[4], float factor[6]);

#endif
