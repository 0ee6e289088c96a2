/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/ray.h"

#include <math.h>

#include "data/volume/grid.h"
#include "splat/camera.h"

static struct sp_ray ray_from(const struct sp_view *view, const uint32_t size[2],
                              const double at[2]) {
    struct sp_camera_transform camera;
    sp_camera_transform_init(&camera, &view->camera, size);
    struct sp_mat3 to_world = sp_mat3_transpose(&camera.w);
    struct sp_vec3 shift = { { (at[0] - camera.centre[0]) / camera.scale,
                               (at[1] - camera.centre[1]) / camera.scale, 0 } };
    struct sp_ray ray = { .end = INFINITY };
    if (camera.projection == SP_ORTHOGRAPHIC) {
        ray.from = sp_vec3_add(camera.eye, sp_mat3_apply(&to_world, shift));
        ray.way = sp_vec3_from(camera.w.m[2]);
        ray.begin = camera.near;
    } else {
        shift.v[2] = 1;
        ray.from = camera.eye;
        ray.way = sp_vec3_normalize(sp_mat3_apply(&to_world, shift));
        ray.begin = camera.near * sp_vec3_length(shift);
    }
    return ray;
}

/* Keeps the part of the ray with offset + t·slope >= 0. */
static void keep(struct sp_ray *ray, double offset, double slope) {
    if (slope > 0)
        ray->begin = fmax(ray->begin, -offset / slope);
    else if (slope < 0)
        ray->end = fmin(ray->end, -offset / slope);
    else if (!(offset >= 0))
        ray->end = -INFINITY;
}

static void clip(struct sp_ray *ray, const struct sp_grid *grid, const struct sp_clip *clip,
                 bool is_open) {
    for (unsigned axis = 0; axis < 3; axis++) {
        double extent[2], low, high;
        sp_grid_extent(grid, axis, extent);
        low = extent[0] + clip->box[0][axis] * (extent[1] - extent[0]);
        high = extent[0] + clip->box[1][axis] * (extent[1] - extent[0]);
        if (!is_open || clip->box[0][axis] > 0)
            keep(ray, ray->a.v[axis] - low, ray->b.v[axis]);
        if (!is_open || clip->box[1][axis] < 1)
            keep(ray, high - ray->a.v[axis], -ray->b.v[axis]);
    }
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        const struct sp_clip_plane *plane = &clip->planes[i];
        double largest =
            fmax(fabs(plane->normal[0]), fmax(fabs(plane->normal[1]), fabs(plane->normal[2])));
        struct sp_vec3 n;
        for (int r = 0; r < 3; r++) /* normals may be of any length */
            n.v[r] = plane->normal[r] / largest;
        keep(ray, sp_vec3_dot(n, ray->from) - plane->offset / largest, sp_vec3_dot(n, ray->way));
    }
}

static void init(struct sp_ray *ray, const struct sp_view *view, const struct sp_grid *grid,
                 const uint32_t size[2], const double at[2], bool is_open) {
    double det;
    *ray = ray_from(view, size, at);
    struct sp_mat3 direction = sp_grid_directions(grid);
    struct sp_mat3 to_axes = sp_mat3_inverse(&direction, &det);
    ray->a = sp_mat3_apply(&to_axes, sp_vec3_sub(ray->from, sp_vec3_from(grid->origin)));
    ray->b = sp_mat3_apply(&to_axes, ray->way);
    clip(ray, grid, &view->clip, is_open);
}

void sp_ray_init(struct sp_ray *ray, const struct sp_view *view, const struct sp_grid *grid,
                 const uint32_t size[2], const double at[2]) {
    init(ray, view, grid, size, at, false);
}

void sp_ray_init_open(struct sp_ray *ray, const struct sp_view *view, const struct sp_grid *grid,
                      const uint32_t size[2], const double at[2]) {
    init(ray, view, grid, size, at, true);
}

/* Returns the upper end of cell i of an axis. */
static double upper_end(const struct sp_ray_walk *walk, unsigned axis, uint32_t i) {
    const struct sp_grid *grid = walk->grid;
    if (walk->cells == SP_RAY_BETWEEN)
        return sp_grid_distance(grid, axis, i + 1);
    if (i + 1 == grid->dims[axis]) {
        double extent[2];
        sp_grid_extent(grid, axis, extent);
        return extent[1];
    }
    return 0.5 * (sp_grid_distance(grid, axis, i) + sp_grid_distance(grid, axis, i + 1));
}

/* Returns the index of the cell at a distance along an axis, clamped to the first and the last
 * cell. */
static uint32_t cell_at(const struct sp_ray_walk *walk, unsigned axis, double distance) {
    uint32_t low = 0, high = walk->count[axis] - 1;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (upper_end(walk, axis, middle) <= distance)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static void set_leave(struct sp_ray_walk *walk, const struct sp_ray *ray, unsigned axis) {
    uint32_t i = walk->cell[axis];
    double slope = ray->b.v[axis];
    bool is_last = slope > 0 ? i + 1 == walk->count[axis] : i == 0;
    walk->leaves[axis] = slope == 0 || is_last ? INFINITY
                         : slope > 0           ? (upper_end(walk, axis, i) - ray->a.v[axis]) / slope
                                     : (upper_end(walk, axis, i - 1) - ray->a.v[axis]) / slope;
}

bool sp_ray_walk_start(struct sp_ray_walk *walk, const struct sp_ray *ray,
                       const struct sp_grid *grid, enum sp_ray_cells cells, double t) {
    *walk = (struct sp_ray_walk){ .grid = grid, .cells = cells };
    for (unsigned axis = 0; axis < 3; axis++) {
        walk->count[axis] = grid->dims[axis] - (cells == SP_RAY_BETWEEN ? 1 : 0);
        if (walk->count[axis] == 0)
            return false;
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        walk->cell[axis] = cell_at(walk, axis, ray->a.v[axis] + t * ray->b.v[axis]);
        set_leave(walk, ray, axis);
    }
    return true;
}

bool sp_ray_walk_step(struct sp_ray_walk *walk, const struct sp_ray *ray) {
    const double *t = walk->leaves;
    unsigned axis = t[0] <= t[1] && t[0] <= t[2] ? 0 : t[1] <= t[2] ? 1 : 2;
    if (!(t[axis] < ray->end))
        return false;
    walk->cell[axis] += ray->b.v[axis] > 0 ? 1 : UINT32_MAX;
    set_leave(walk, ray, axis);
    return true;
}

double sp_ray_walk_leave(const struct sp_ray_walk *walk, const struct sp_ray *ray) {
    return fmin(fmin(walk->leaves[0], walk->leaves[1]), fmin(walk->leaves[2], ray->end));
}
