/* SPDX-License-Identifier: Apache-2.0
 *
 * Levels of detail: merges points that lie close together and face the same way.
 */
#ifndef SP_SURFACE_MERGE_H
#define SP_SURFACE_MERGE_H

#include "draw/layers/surface/points.h"
#include "sp/view.h"
#include "splat/camera.h"

/* Returns the coarsest level whose larger kernels the low-pass filter hides. 0 = all points are
 * drawn. */
unsigned sp_surface_level(const struct sp_view *view, const struct sp_grid *grid,
                          const struct sp_camera_transform *camera);

/* True if points of the grid can be merged, that is, if the grid is not rectilinear. */
bool sp_surface_can_merge(const struct sp_grid *grid);

/* Returns the factor by which kernels of the level are larger than kernels of level 0. It follows
 * from the spread of the points of a group in the plane of the surface. is_enlarged: the factor at
 * which kernels overlap as much as on level 0. */
double sp_surface_growth(unsigned level, double sigma, bool is_enlarged);

/* Merges the points of level 0 in groups of 2^level parts of cells per axis. Points stay apart if
 * their vector areas lie in different octants or along different axes, so that both sides of thin
 * walls remain. The order of the points does not depend on the number of threads. SP_ERR_MEMORY,
 * SP_ERR_BUDGET, SP_ERR_CANCELLED; *out is then empty. */
bool sp_surface_merge(const struct sp_surface_points *points, unsigned level,
                      const struct sp_surface_job *job, uint64_t bytes_max,
                      struct sp_surface_points *out, struct sp_error *err);

#endif
