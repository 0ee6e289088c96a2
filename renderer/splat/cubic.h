/* SPDX-License-Identifier: Apache-2.0
 *
 * The cubic reconstruction kernel (Crawfis and Max 1993, with coefficients that are C1 at both
 * joints): spherical in index space, with compact support and an invisible ripple.
 *
 *   g(r) = 0.557526 − 1.157743 r² + 0.671033 r³           r ≤ 0.889392
 *          0.067599 (t−r)² + 0.282474 (t−r)³              0.889392 < r ≤ t = 1.556228      [voxels]
 *
 *   footprint F(ρ) = ∫ g(√(ρ²+z²)) dz, and its part before z: both in closed form
 *
 * A linear map turns the sphere into an ellipsoid, so that one table by ρ serves every footprint.
 * To share the code of the Gaussian, lengths are measured in the kernel's standard deviation s =
 * 0.44655 voxels per axis: the footprint has the variance V̂ = s²·M Mᵀ, and the Mahalanobis radius
 * m of a pixel is ρ/s. A low-pass filter adds its variance h² to V̂, as for a Gaussian: the
 * variance of the convolution is exact, but its shape is approximated by the shape of the cubic.
 */
#ifndef SP_SPLAT_CUBIC_H
#define SP_SPLAT_CUBIC_H

#include "base/wide.h"

#define SP_CUBIC_RADIUS 1.556228        /* t, voxels */
#define SP_CUBIC_SIGMA 0.44654961306714 /* s, voxels: √(⅓ ∫ g r² dV / ∫ g dV) */

/* g(r), r ≥ 0 in voxels; 0 beyond the radius. */
double sp_cubic(double r);

/* ∫ g(√(ρ²+ζ²)) dζ over [0, z]; z ≥ 0. */
double sp_cubic_part(double rho, double z);

/* F(ρ) = 2·sp_cubic_part(ρ, ∞) [per voxel²]. */
double sp_cubic_footprint(double rho);

enum { SP_CUBIC_STEPS = 512, SP_CUBIC_ROWS = 32, SP_CUBIC_COLUMNS = 64 };

/* Tables for pixel loops, by q = (ρ/t)², with linear interpolation. */
struct sp_cubic_table {
    float weight[SP_CUBIC_STEPS + 2];                     /* F(ρ)/F(0) */
    float share[SP_CUBIC_ROWS + 2][SP_CUBIC_COLUMNS + 2]; /* ∫₀^z / F(ρ), by z/√(t²−ρ²) */
};

void sp_cubic_table_init(struct sp_cubic_table *table);

/* F(ρ)/F(0) at q in [0, 1]; 0 beyond. */
static inline sp_wide sp_wide_cubic_weight(const struct sp_cubic_table *table, sp_wide q) {
    sp_wide_mask inside = sp_wide_lt(q, sp_wide_all(1));
    sp_wide at = sp_wide_keep(inside, q) * SP_CUBIC_STEPS;
    sp_wide_int i = sp_wide_to_int(at);
    sp_wide low = sp_wide_gather(table->weight, i), high = sp_wide_gather(table->weight + 1, i);
    return sp_wide_keep(inside, low + (at - sp_wide_from_int(i)) * (high - low));
}

/* Returns the share of the kernel along a ray that lies before ζ: ½ at ζ = 0, 1 where the ray
 * leaves the kernel. q = (ρ/t)² in [0, 1); ζ in standard deviations. */
static inline sp_wide sp_wide_cubic_share(const struct sp_cubic_table *table, sp_wide q,
                                          sp_wide zeta) {
    enum { ROW = SP_CUBIC_COLUMNS + 2 };
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    const float radius = (float)(SP_CUBIC_RADIUS / SP_CUBIC_SIGMA);
    sp_wide_mask in_kernel = sp_wide_lt(q, one), is_late = sp_wide_lt(zero, zeta);
    sp_wide end = radius * sp_wide_sqrt(sp_wide_keep(in_kernel, 1 - q)), z = sp_wide_abs(zeta);
    sp_wide_mask inside = sp_wide_lt(z, end);
    sp_wide row = sp_wide_keep(inside, q) * SP_CUBIC_ROWS;
    sp_wide column = sp_wide_keep(inside, z / end * SP_CUBIC_COLUMNS);
    sp_wide_int i = sp_wide_to_int(row), k = sp_wide_to_int(column), at = i * ROW + k;
    sp_wide f = column - sp_wide_from_int(k);
    sp_wide a = sp_wide_gather(table->share[0], at), b = sp_wide_gather(table->share[1], at);
    sp_wide low = a + f * (sp_wide_gather(table->share[0] + 1, at) - a);
    sp_wide high = b + f * (sp_wide_gather(table->share[1] + 1, at) - b);
    sp_wide part = low + (row - sp_wide_from_int(i)) * (high - low);
    return sp_wide_select(inside, sp_wide_select(is_late, 0.5f + part, 0.5f - part),
                          sp_wide_select(is_late, one, zero));
}

#endif
