/* SPDX-License-Identifier: Apache-2.0
 *
 * From cell to cell along a ray (Amanatides and Woo 1987), on a grid with any direction matrix and
 * any coordinates: in distances along the grid's axes the ray is straight and cells are boxes.
 */
#include "sp/pick.h"

#include <math.h>
#include <stdint.h>

#include "base/vec.h"
#include "classify/gradient.h"
#include "classify/transfer.h"
#include "splat/camera.h"
#include "volume/sample.h"

/* Points from + t·way, t in [begin, end]; world units. */
struct ray {
    struct sp_vec3 from, way; /* world; way has unit length */
    struct sp_vec3 a, b;      /* distances along the axes: a + t·b */
    double begin, end;
};

static struct ray ray_from(const struct sp_view *view, const uint32_t size[2], const double at[2]) {
    struct sp_camera_transform camera;
    sp_camera_transform_init(&camera, &view->camera, size);
    struct sp_mat3 to_world = sp_mat3_transpose(&camera.w);
    struct sp_vec3 shift = { { (at[0] - camera.centre[0]) / camera.scale,
                               (at[1] - camera.centre[1]) / camera.scale, 0 } };
    struct ray ray = { .end = INFINITY };
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
static void keep(struct ray *ray, double offset, double slope) {
    if (slope > 0)
        ray->begin = fmax(ray->begin, -offset / slope);
    else if (slope < 0)
        ray->end = fmin(ray->end, -offset / slope);
    else if (!(offset >= 0))
        ray->end = -INFINITY;
}

static void clip(struct ray *ray, const struct sp_grid *grid, const struct sp_clip *clip) {
    for (unsigned axis = 0; axis < 3; axis++) {
        double extent[2], low, high;
        sp_grid_extent(grid, axis, extent);
        low = extent[0] + clip->box[0][axis] * (extent[1] - extent[0]);
        high = extent[0] + clip->box[1][axis] * (extent[1] - extent[0]);
        keep(ray, ray->a.v[axis] - low, ray->b.v[axis]);
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

/* Returns the upper end of cell i of an axis. */
static double upper_end(const struct sp_grid *grid, unsigned axis, uint32_t i) {
    if (i + 1 == grid->dims[axis]) {
        double extent[2];
        sp_grid_extent(grid, axis, extent);
        return extent[1];
    }
    return 0.5 * (sp_grid_distance(grid, axis, i) + sp_grid_distance(grid, axis, i + 1));
}

/* Returns the index of the cell at a distance along an axis, clamped to the first and the last
 * cell. */
static uint32_t cell_at(const struct sp_grid *grid, unsigned axis, double distance) {
    uint32_t low = 0, high = grid->dims[axis] - 1;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (upper_end(grid, axis, middle) <= distance)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* The current cell of the walk along the ray. */
struct walk {
    const struct sp_grid *grid;
    uint32_t cell[3];
    double leaves[3]; /* t where the ray leaves the current cell along each axis */
};

static void set_leave(struct walk *walk, const struct ray *ray, unsigned axis) {
    uint32_t i = walk->cell[axis];
    double slope = ray->b.v[axis];
    bool is_last = slope > 0 ? i + 1 == walk->grid->dims[axis] : i == 0;
    walk->leaves[axis] = slope == 0 || is_last ? INFINITY
                         : slope > 0
                             ? (upper_end(walk->grid, axis, i) - ray->a.v[axis]) / slope
                             : (upper_end(walk->grid, axis, i - 1) - ray->a.v[axis]) / slope;
}

/* Moves to the next cell; false after the last one. */
static bool step(struct walk *walk, const struct ray *ray) {
    const double *t = walk->leaves;
    unsigned axis = t[0] <= t[1] && t[0] <= t[2] ? 0 : t[1] <= t[2] ? 1 : 2;
    if (!(t[axis] < ray->end))
        return false;
    walk->cell[axis] += ray->b.v[axis] > 0 ? 1 : UINT32_MAX;
    set_leave(walk, ray, axis);
    return true;
}

/* Returns the optical depth per world unit. */
static double extinction(const struct sp_gradient_grid *samples,
                         const struct sp_transfer_function *tf, const uint32_t cell[3],
                         double value) {
    struct sp_class class;
    sp_transfer_function_eval(tf, value, &class);
    double depth = (double)class.depth;
    if (depth > 0 && tf->gradient_count > 0) {
        double gradient[3];
        sp_gradient_at(samples, cell, gradient);
        double magnitude = sp_vec3_length(sp_vec3_from(gradient)) / samples->scale;
        depth = -log1p(sp_transfer_function_scale(tf, magnitude) * expm1(-depth));
    }
    return depth / tf->reference_length;
}

/* Accumulates the opacity of the cells. Records the first position where it reaches one half. */
static void march(const struct ray *ray, const struct sp_gradient_grid *samples,
                  const struct sp_transfer_function *tf, struct walk *walk, struct sp_pick *pick) {
    const uint32_t *dims = walk->grid->dims;
    const double half = log(2), opaque = 50;
    double depth = 0, t = ray->begin;
    do {
        double leave =
            fmin(fmin(walk->leaves[0], walk->leaves[1]), fmin(walk->leaves[2], ray->end));
        uint64_t at = walk->cell[0] + dims[0] * (walk->cell[1] + (uint64_t)dims[1] * walk->cell[2]);
        double value = sp_sample(samples->voxels, samples->type, at);
        double per_unit = extinction(samples, tf, walk->cell, value);
        double more = per_unit * fmax(leave - t, 0);
        if (!pick->is_hit && depth + more >= half) {
            pick->is_hit = true;
            pick->value = value;
            for (int r = 0; r < 3; r++)
                pick->position[r] =
                    ray->from.v[r] + (t + (half - depth) / per_unit) * ray->way.v[r];
        }
        depth += more;
        t = fmax(t, leave);
    } while (depth < opaque && step(walk, ray));
    pick->opacity = -expm1(-depth);
}

void sp_pick_at(const struct sp_volume *volume, const struct sp_view *view, const uint32_t size[2],
                const double at[2], struct sp_pick *pick) {
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    struct ray ray = ray_from(view, size, at);
    struct sp_mat3 direction;
    double det;
    *pick = (struct sp_pick){ .opacity = 0 };
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            direction.m[r][a] = grid->direction[r][a];
    struct sp_mat3 to_axes = sp_mat3_inverse(&direction, &det);
    ray.a = sp_mat3_apply(&to_axes, sp_vec3_sub(ray.from, sp_vec3_from(grid->origin)));
    ray.b = sp_mat3_apply(&to_axes, ray.way);
    clip(&ray, grid, &view->clip);
    if (!(ray.begin < ray.end))
        return;
    struct sp_gradient_grid samples;
    sp_gradient_grid_init(&samples, volume);
    struct walk walk = { .grid = grid };
    for (unsigned axis = 0; axis < 3; axis++) {
        walk.cell[axis] = cell_at(grid, axis, ray.a.v[axis] + ray.begin * ray.b.v[axis]);
        set_leave(&walk, &ray, axis);
    }
    march(&ray, &samples, &view->transfer_function, &walk, pick);
}
