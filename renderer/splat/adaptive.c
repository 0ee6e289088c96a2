/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/adaptive.h"

#include "data/volume/grid.h"
#include "splat/cubic.h"

/* Smallest and largest singular value of `a`. Jacobi rotations of aᵀa, which converge
 * quadratically. */
static void singular_values(const struct sp_mat3 *a, double value[2]) {
    struct sp_mat3 t = sp_mat3_transpose(a), s = sp_mat3_multiply(&t, a);
    for (int sweep = 0; sweep < 12; sweep++)
        for (int p = 0; p < 2; p++)
            for (int q = p + 1; q < 3; q++) {
                if (s.m[p][q] == 0)
                    continue;
                double theta = 0.5 * atan2(2 * s.m[p][q], s.m[q][q] - s.m[p][p]);
                struct sp_mat3 r = { { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
                r.m[p][p] = r.m[q][q] = cos(theta);
                r.m[p][q] = sin(theta);
                r.m[q][p] = -sin(theta);
                struct sp_mat3 rt = sp_mat3_transpose(&r), half = sp_mat3_multiply(&rt, &s);
                s = sp_mat3_multiply(&half, &r);
            }
    value[0] = sqrt(fmax(0, fmin(s.m[0][0], fmin(s.m[1][1], s.m[2][2]))));
    value[1] = sqrt(fmax(s.m[0][0], fmax(s.m[1][1], s.m[2][2])));
}

/* Computes the smallest and the largest local spacing of the voxels [first, last] of an axis,
 * divided by the axis's mean spacing. */
static void stretch_of(const struct sp_grid *grid, unsigned axis, uint32_t first, uint32_t last,
                       double stretch[2]) {
    stretch[0] = stretch[1] = 1;
    if (!grid->coordinates[axis])
        return;
    for (uint32_t i = first; i <= last; i++) {
        double s = sp_grid_local_spacing(grid, axis, i) / grid->spacing[axis];
        stretch[0] = i == first ? s : fmin(stretch[0], s);
        stretch[1] = i == first ? s : fmax(stretch[1], s);
    }
}

double sp_adaptive_c_max(const struct sp_filter *filter, const struct sp_camera *camera) {
    double tangent = camera->projection == SP_PERSPECTIVE ? tan(camera->fov_y * (M_PI / 360)) : 0;
    return isnan(filter->c_max) ? 2.5 * (1 + 2 * tangent * tangent) : filter->c_max;
}

double sp_kernel_sigma(const struct sp_filter *filter) {
    return filter->kernel == SP_KERNEL_CUBIC ? SP_CUBIC_SIGMA : filter->sigma;
}

double sp_kernel_reach(const struct sp_filter *filter) {
    return filter->kernel == SP_KERNEL_CUBIC ? SP_CUBIC_RADIUS : filter->sigma * filter->cutoff;
}

void sp_kernel_radii(const struct sp_grid *grid, double sigma, double radius[2]) {
    double low = INFINITY, high = 0;
    struct sp_mat3 step = sp_grid_steps(grid, 1);
    for (unsigned a = 0; a < 3; a++) {
        double stretch[2];
        stretch_of(grid, a, 0, grid->dims[a] - 1, stretch);
        low = fmin(low, stretch[0]);
        high = fmax(high, stretch[1]);
    }
    singular_values(&step, radius);
    radius[0] *= sigma * low;
    radius[1] *= sigma * high;
}

void sp_adaptive_init(struct sp_adaptive *adaptive, const struct sp_camera_transform *camera,
                      const struct sp_grid *grid, const struct sp_view *view,
                      const struct sp_filter *filter) {
    *adaptive = (struct sp_adaptive){ .projection = camera->projection,
                                      .scale = camera->scale,
                                      .grid = grid,
                                      .lowpass = filter->lowpass,
                                      .c_min = filter->c_min,
                                      .c_max = sp_adaptive_c_max(filter, &view->camera) };
    struct sp_mat3 step = sp_grid_steps(grid, 1);
    for (int r = 0; r < 3; r++) {
        for (int a = 0; a < 3; a++)
            adaptive->depth[a] += camera->w.m[2][r] * grid->direction[r][a];
        adaptive->base += camera->w.m[2][r] * (grid->origin[r] - camera->eye.v[r]);
    }
    for (int a = 0; a < 3; a++) {
        adaptive->blocks[a] = (grid->dims[a] + SP_BRICK - 1) / SP_BRICK;
    }
    singular_values(&step, adaptive->radius);
    for (int i = 0; i < 2; i++)
        adaptive->radius[i] *= sp_kernel_sigma(filter);
}

enum sp_filter_mode sp_adaptive_mode(const struct sp_adaptive *a, const double radius[2],
                                     double nearest, double farthest) {
    double low, high; /* R of the smallest radius at the largest distance, and of the largest radius
                         at the smallest distance */
    if (a->projection == SP_ORTHOGRAPHIC) {
        low = a->scale * radius[0];
        high = a->scale * radius[1];
    } else {
        low = farthest > 0 ? a->scale * radius[0] / farthest : INFINITY;
        high = nearest > 0 ? a->scale * radius[1] / nearest : INFINITY;
    }
    if (low * a->c_min > a->lowpass)
        return SP_FILTER_RECONSTRUCTION;
    if (high * a->c_max < a->lowpass)
        return SP_FILTER_LOWPASS;
    return SP_FILTER_EWA;
}

enum sp_filter_mode sp_adaptive_block(const struct sp_adaptive *a, const uint32_t block[3]) {
    double nearest = a->base, farthest = a->base, low = INFINITY, high = 0;
    for (unsigned i = 0; i < 3; i++) {
        uint32_t first = block[i] * SP_BRICK, last = first + SP_BRICK - 1;
        if (last >= a->grid->dims[i])
            last = a->grid->dims[i] - 1;
        double p = a->depth[i] * sp_grid_distance(a->grid, i, first), stretch[2];
        double q = a->depth[i] * sp_grid_distance(a->grid, i, last);
        nearest += fmin(p, q);
        farthest += fmax(p, q);
        stretch_of(a->grid, i, first, last, stretch);
        low = fmin(low, stretch[0]);
        high = fmax(high, stretch[1]);
    }
    double radius[2] = { a->radius[0] * low, a->radius[1] * high };
    return sp_adaptive_mode(a, radius, nearest, farthest);
}

uint64_t sp_adaptive_count(const struct sp_grid *grid) {
    uint64_t count = 1;
    for (int a = 0; a < 3; a++)
        count *= (grid->dims[a] + SP_BRICK - 1) / SP_BRICK;
    return count;
}

enum sp_filter_mode sp_adaptive_fill(const struct sp_adaptive *a, uint8_t *modes) {
    enum sp_filter_mode shared = SP_FILTER_ADAPTIVE;
    uint64_t n = 0;
    for (uint32_t b2 = 0; b2 < a->blocks[2]; b2++)
        for (uint32_t b1 = 0; b1 < a->blocks[1]; b1++)
            for (uint32_t b0 = 0; b0 < a->blocks[0]; b0++) {
                enum sp_filter_mode mode = sp_adaptive_block(a, (uint32_t[3]){ b0, b1, b2 });
                modes[n] = (uint8_t)mode;
                shared = n++ == 0 || shared == mode ? mode : SP_FILTER_ADAPTIVE;
            }
    return shared;
}
