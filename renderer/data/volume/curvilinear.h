/* SPDX-License-Identifier: Apache-2.0
 *
 * Points that are the nodes of a structured grid: their kernels come from the grid.
 *
 *   A = ∂p/∂i     L·Lᵀ = σ²·A·Aᵀ     volume = |det A|         (mathematics: "Curvilinear grids")
 *
 * Derivatives are central differences, at borders one-sided. So the cell of a node at a border is a
 * whole one that reaches half a gap beyond it, as in every grid of this program. If the first and
 * the last nodes of an axis coincide, the axis is closed: both have central differences across the
 * seam and half a cell each.
 */
#ifndef SP_VOLUME_CURVILINEAR_H
#define SP_VOLUME_CURVILINEAR_H

#include "data/volume/volume.h"

/* Standard deviation of a kernel, in cells. */
#define SP_CURVILINEAR_SIGMA 0.7

/* Finds factors and volumes of product(dims) points, the first axis fastest, that begin at `first`.
 * An axis with one node gets a direction perpendicular to the others and the smallest of their
 * gaps. A cell that is flat, or folded (its determinant has the sign that fewer cells have), gets
 * the value NaN, so that it is not drawn. Returns the number of such cells. */
uint64_t sp_curvilinear_finish(const struct sp_elements *points, uint64_t first,
                               const uint32_t dims[3]);

#endif
