/* SPDX-License-Identifier: Apache-2.0
 *
 * The triangular factors L of variances L·Lᵀ, as struct sp_elements has them.
 */
#ifndef SP_VOLUME_FACTOR_H
#define SP_VOLUME_FACTOR_H

/* Finds the factor of the variance M·Mᵀ. */
void sp_factor(const double m[3][3], float factor[6]);

/* The same for a Gaussian with these standard deviations along axes that the quaternion (w, x, y,
 * z) of any length turns: M = R·diag(scales). A quaternion of length 0 turns nothing. */
void sp_gaussian_factor(const double scales[3], const double rotation[4], float factor[6]);

#endif
