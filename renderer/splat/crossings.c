/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/crossings.h"

#include <math.h>

#include "data/volume/sample.h"

enum { BISECTIONS = 60 };

/* Keeps the part of the ray between the first and the last sample of each axis. */
static void keep_between(struct sp_ray *ray, const struct sp_grid *grid) {
    for (unsigned axis = 0; axis < 3; axis++) {
        double last = sp_grid_distance(grid, axis, grid->dims[axis] - 1);
        double a = ray->a.v[axis], b = ray->b.v[axis];
        if (b == 0 && !(a >= 0 && a <= last)) {
            ray->end = -INFINITY;
        } else if (b != 0) {
            ray->begin = fmax(ray->begin, ((b > 0 ? 0 : last) - a) / b);
            ray->end = fmin(ray->end, ((b > 0 ? last : 0) - a) / b);
        }
    }
}

void sp_crossings_init(struct sp_crossings *self, const struct sp_ray *ray,
                       const struct sp_view *view, const struct sp_volume *volume) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    *self = (struct sp_crossings){ .ray = *ray,
                                   .voxels = sp_volume_voxels(volume),
                                   .type = info->type };
    for (uint32_t i = 0; i < view->layer_count; i++) {
        const struct sp_layer *layer = &view->layers[i];
        if (layer->type != SP_LAYER_SURFACE || !layer->visible || !(layer->opacity > 0))
            continue;
        self->state[self->layer_count] = -1;
        self->layers[self->layer_count++] = layer;
    }
    keep_between(&self->ray, &info->grid);
    self->t = self->ray.begin;
    self->is_done =
        self->layer_count == 0 || !(self->ray.begin < self->ray.end) ||
        !sp_ray_walk_start(&self->walk, &self->ray, &info->grid, SP_RAY_BETWEEN, self->t);
}

/* Reads the eight samples around the current cell. False if one is not finite. */
static bool read_corners(const struct sp_crossings *self, double corners[8]) {
    const uint32_t *dims = self->walk.grid->dims, *cell = self->walk.cell;
    const uint64_t step[3] = { 1, dims[0], (uint64_t)dims[0] * dims[1] };
    const uint64_t first = cell[0] + step[1] * cell[1] + step[2] * cell[2];
    bool ok = true;
    for (unsigned i = 0; i < 8; i++) {
        uint64_t at = first + (i & 1 ? step[0] : 0) + (i & 2 ? step[1] : 0) + (i & 4 ? step[2] : 0);
        corners[i] = sp_sample(self->voxels, self->type, at);
        ok = ok && isfinite(corners[i]);
    }
    return ok;
}

static double mix(double a, double b, double share) {
    return a + (b - a) * share;
}

/* The interpolant at distance t of the ray, which lies in the current cell. */
static double interpolate(const struct sp_crossings *self, const double corners[8], double t) {
    double share[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        uint32_t i = self->walk.cell[axis];
        double low = sp_grid_distance(self->walk.grid, axis, i);
        double gap = sp_grid_distance(self->walk.grid, axis, i + 1) - low;
        double at = (self->ray.a.v[axis] + t * self->ray.b.v[axis] - low) / gap;
        share[axis] = fmin(fmax(at, 0), 1);
    }
    double rows[4];
    for (int i = 0; i < 4; i++)
        rows[i] = mix(corners[2 * i], corners[2 * i + 1], share[0]);
    return mix(mix(rows[0], rows[1], share[1]), mix(rows[2], rows[3], share[1]), share[2]);
}

static double cubic(const double c[4], double s) {
    return c[0] + s * (c[1] + s * (c[2] + s * c[3]));
}

/* The cubic polynomial through its values at 0, 1/3, 2/3 and 1. */
static void fit_cubic(const double f[4], double c[4]) {
    c[0] = f[0];
    c[1] = (-11 * f[0] + 18 * f[1] - 9 * f[2] + 2 * f[3]) / 2;
    c[2] = (18 * f[0] - 45 * f[1] + 36 * f[2] - 9 * f[3]) / 2;
    c[3] = (-9 * f[0] + 27 * f[1] - 27 * f[2] + 9 * f[3]) / 2;
}

/* Writes 0, the turning points of the cubic inside (0, 1) and 1: between two of them it is
 * monotone. Returns how many. */
static int compute_turns(const double c[4], double turns[4]) {
    int count = 0;
    double a = 3 * c[3], b = 2 * c[2], root[2] = { NAN, NAN };
    double discriminant = b * b - 4 * a * c[1];
    turns[count++] = 0;
    if (discriminant > 0) {
        double q = -0.5 * (b + copysign(sqrt(discriminant), b));
        root[0] = q / a;
        root[1] = c[1] / q;
    }
    if (root[0] > root[1]) {
        double larger = root[0];
        root[0] = root[1];
        root[1] = larger;
    }
    for (int i = 0; i < 2; i++)
        if (root[i] > turns[count - 1] && root[i] < 1)
            turns[count++] = root[i];
    turns[count++] = 1;
    return count;
}

static double bisect(const double c[4], double low, double high) {
    bool is_high_inside = cubic(c, high) >= 0;
    for (int i = 0; i < BISECTIONS; i++) {
        double middle = 0.5 * (low + high);
        if ((cubic(c, middle) >= 0) == is_high_inside)
            high = middle;
        else
            low = middle;
    }
    return 0.5 * (low + high);
}

/* Adds a crossing behind all crossings that are not farther away. */
static void add(struct sp_crossings *self, double t, const struct sp_layer *layer) {
    uint32_t at = self->count++;
    for (; at > 0 && self->found[at - 1].t > t; at--)
        self->found[at] = self->found[at - 1];
    self->found[at] = (struct sp_crossing){ .t = t, .layer = layer };
}

/* Finds the crossings of one surface in the current cell, which the ray leaves at `leave`. f: the
 * values at thirds of the way. */
static void cross(struct sp_crossings *self, uint32_t i, const double f[4], double leave) {
    double above[4], c[4], turns[4];
    const struct sp_layer *layer = self->layers[i];
    for (int k = 0; k < 4; k++)
        above[k] = f[k] - layer->value;
    fit_cubic(above, c);
    int count = compute_turns(c, turns), state = above[0] >= 0;
    if (self->state[i] >= 0 && self->state[i] != state)
        add(self, self->t, layer);
    for (int k = 1; k < count; k++) {
        int next = (k + 1 == count ? above[3] : cubic(c, turns[k])) >= 0;
        if (next != state)
            add(self, mix(self->t, leave, bisect(c, turns[k - 1], turns[k])), layer);
        state = next;
    }
    self->state[i] = state;
}

/* Finds what is in the current cell, and moves to the next one. */
static void advance(struct sp_crossings *self) {
    double corners[8], leave = fmax(self->t, sp_ray_walk_leave(&self->walk, &self->ray));
    self->count = self->next = 0;
    if (read_corners(self, corners)) {
        double f[4];
        for (int k = 0; k < 4; k++)
            f[k] = interpolate(self, corners, mix(self->t, leave, k / 3.0));
        for (uint32_t i = 0; i < self->layer_count; i++)
            cross(self, i, f, leave);
    } else {
        for (uint32_t i = 0; i < self->layer_count; i++)
            self->state[i] = -1;
    }
    self->t = leave;
    self->is_done = !sp_ray_walk_step(&self->walk, &self->ray);
}

const struct sp_crossing *sp_crossings_peek(struct sp_crossings *self) {
    while (self->next == self->count && !self->is_done)
        advance(self);
    return self->next < self->count ? &self->found[self->next] : NULL;
}

void sp_crossings_pop(struct sp_crossings *self) {
    self->next++;
}
