/* SPDX-License-Identifier: Apache-2.0
 *
 * The size of points, from their nearest neighbours.
 *
 *   C        covariance of a point and its 18 nearest neighbours
 *   m, n²    mean of its diagonal / (10/19); squared distance of the nearest neighbour, at most m
 *   L·Lᵀ   = σ²·C / (10/19)                  of a cubic lattice: σ²·spacing²
 *   volume = (m + (m − n²) / 10)^(3/2)                           spacing³
 *
 * 18 neighbours are the two nearest shells of a cubic lattice, without a choice among equal ones.
 * The term with n² is 0 there. It makes the volumes of points at random add up to the space that
 * they fill: without it they give 9 % less. Points at one place share its space: their neighbours
 * are at other places, and each of k points there has a k-th of the volume. nearest.h finds the
 * neighbours.
 */
#ifndef SP_IMPORT_NEIGHBOURS_H
#define SP_IMPORT_NEIGHBOURS_H

#include "data/import/format.h"

/* Finds factors and volumes; changes the order of the points. Needs three bytes per point, and up
 * to 16 more where many share their place. Defined for all input:
 *   - fewer than 19 points: the neighbours are all other points; fewer than 7: each point is a
 *     sphere of the mean width;
 *   - points on a plane or line: the thickness of a kernel is at least a tenth of its mean width;
 *   - all points at one place: the spacing is 1; otherwise it is at least a millionth of the
 *     diagonal of all points;
 *   - points that are not finite: they get this smallest spacing, and are no point's neighbours.
 * Volumes are in the range of normal floats. SP_ERR_MEMORY. */
bool import_neighbours_finish(const struct sp_elements *points,
                              const struct import_progress *progress, struct sp_error *err);

#endif
