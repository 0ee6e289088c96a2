/* SPDX-License-Identifier: Apache-2.0
 *
 * The cubic kernel of Crawfis and Max, spherical in index space, as on the mathematics page. Its
 * integrals are computed by quadrature, as the reference for closed forms and tables elsewhere.
 */
#ifndef TESTS_SUPPORT_CUBIC_H
#define TESTS_SUPPORT_CUBIC_H

#define TEST_CUBIC_RADIUS 1.556228 /* t, voxels */

/* g(r), r ≥ 0 in voxels; 0 beyond the radius. */
double test_cubic(double r);

/* Returns ∫ g(√(ρ² + z²)) dz for z from -∞ to `end`, along a ray at distance ρ ≥ 0 from the centre.
 * With `end` = INFINITY it is the footprint F(ρ). The error is below 1e-8. */
double test_cubic_gathered(double rho, double end);

/* Variance along one axis: ∫ x² g / ∫ g over space [voxel²]. */
double test_cubic_variance(void);

#endif
