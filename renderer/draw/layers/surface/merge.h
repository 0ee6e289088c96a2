/* SPDX-License-Identifier: Apache-2.0
 *
 * Levels of detail: points that lie close together and face the same way become one.
 */
#ifndef SP_SURFACE_MERGE_H
#define SP_SURFACE_MERGE_H

#include "draw/layers/surface/points.h"
#include "sp/view.h"
#include "splat/camera.h"

/* The coarsest level whose kernels the low-pass filter hides. 0 = all points. */
unsigned sp_surface_level(const struct sp_view *view, const struct sp_grid *grid,
                          const struct sp_camera_transform *camera);

/* Whether points of the grid can be merged: in rectilinear grids they cannot. */
bool sp_surface_can_merge(const struct sp_grid *grid);

/* How much larger kernels of the level are: as much as the points of a group spread, in the plane
 * of the surface, or, `is_enlarged`, so that they overlap as those of level 0. */
double sp_surface_growth(unsigned level, double sigma, bool is_enlarged);

/* Merges the points of level 0 in groups of 2^level parts of cells per axis; those whose vector
 * areas are in other octants or along other axes stay apart: both sides of thin walls remain. The
 * order of the points does not depend on threads. SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED;
 * *out is then empty. */
bool sp_surface_merge(const struct sp_surface_points *points, unsigned level,
                      const struct sp_surface_job *job, uint64_t bytes_max,
                      struct sp_surface_points *out, struct sp_error *err);

#endif
