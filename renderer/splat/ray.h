/* SPDX-License-Identifier: Apache-2.0
 *
 * The ray through a point of the image, and a walk through the cells that the ray crosses
 * (Amanatides and Woo 1987). It works on a grid with any direction matrix and any coordinates: in
 * distances along the grid's axes the ray is straight and cells are boxes.
 *
 *   SP_RAY_AROUND    cell i lies around sample i, between the middles of its two gaps
 *   SP_RAY_BETWEEN   cell i lies between the samples i and i + 1
 */
#ifndef SP_SPLAT_RAY_H
#define SP_SPLAT_RAY_H

#include "base/vec.h"
#include "data/volume/grid.h"
#include "sp/view.h"

/* Points from + t·way, t in [begin, end]; world units. */
struct sp_ray {
    struct sp_vec3 from, way; /* world; way has unit length */
    struct sp_vec3 a, b;      /* distances along the axes: a + t·b */
    double begin, end;        /* begin >= end = nothing is left of the ray */
};

/* Computes the ray through point `at` of an image of `size` px. The ray begins at the near plane at
 * the earliest, and it is cut to the volume and to the part that the clip keeps. The view must be
 * valid. */
void sp_ray_init(struct sp_ray *ray, const struct sp_view *view, const struct sp_grid *grid,
                 const uint32_t size[2], const double at[2]);

/* Like sp_ray_init(), but the border of the volume does not cut the ray. Only the clip planes and
 * those faces of the clip box that lie inside the volume cut it. */
void sp_ray_init_open(struct sp_ray *ray, const struct sp_view *view, const struct sp_grid *grid,
                      const uint32_t size[2], const double at[2]);

enum sp_ray_cells { SP_RAY_AROUND, SP_RAY_BETWEEN };

/* The current cell of a walk along a ray. */
struct sp_ray_walk {
    const struct sp_grid *grid;
    enum sp_ray_cells cells;
    uint32_t count[3]; /* of cells */
    uint32_t cell[3];
    double leaves[3]; /* t where the ray leaves the current cell along each axis */
};

/* Starts in the cell at t. False: the grid has no cells between samples, because an axis has only
 * one sample. */
bool sp_ray_walk_start(struct sp_ray_walk *walk, const struct sp_ray *ray,
                       const struct sp_grid *grid, enum sp_ray_cells cells, double t);

/* Moves to the next cell; false after the last one. */
bool sp_ray_walk_step(struct sp_ray_walk *walk, const struct sp_ray *ray);

/* Returns t where the ray leaves the current cell, at most ray->end. */
double sp_ray_walk_leave(const struct sp_ray_walk *walk, const struct sp_ray *ray);

#endif
