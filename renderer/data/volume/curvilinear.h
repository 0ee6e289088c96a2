/* SPDX-License-Identifier: Apache-2.0
 *
 * Kernels of points that are the nodes of a structured grid: the grid gives the kernels.
 *
 *   A = ∂p/∂i     L·Lᵀ = σ²·A·Aᵀ     volume = |det A|         (mathematics: "Curvilinear grids")
 *
 * Derivatives are central differences; at borders they are one-sided. So a node at a border has a
 * whole cell, which reaches half a gap beyond the node, as in every grid of this program. If the
 * first and the last nodes of an axis coincide, the axis is closed: both have central differences
 * across the seam and half a cell each.
 */
#ifndef SP_VOLUME_CURVILINEAR_H
#define SP_VOLUME_CURVILINEAR_H

#include "data/volume/volume.h"

/* Standard deviation of a kernel, in cells. */
#define SP_CURVILINEAR_SIGMA 0.7

/* Computes factors and volumes of product(dims) points, the first axis fastest, from point `first`
 * on. An axis with one node gets a direction perpendicular to the other axes, and their smallest
 * gap. A cell that is flat, or folded (its determinant has the sign that fewer cells have), gets
 * the value NaN, so that it is not drawn. Returns the number of such cells. */
uint64_t sp_curvilinear_finish(const struct sp_elements *points, uint64_t first,
                               const uint32_t dims[3]);

#endif
