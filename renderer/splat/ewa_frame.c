/* SPDX-License-Identifier: Apache-2.0 */
#include <float.h>

#include "base/minmax.h"
#include "data/volume/grid.h"
#include "splat/adaptive.h"
#include "splat/cubic.h"
#include "splat/ewa_frame.h"
#include "splat/exp2.h"

/* Computes the radius, the cutoff and the peak of the kernel; returns its standard deviation in
 * voxels. */
static double init_kernel(struct sp_ewa_frame *frame, const struct sp_filter *filter) {
    double sigma = sp_kernel_sigma(filter), radius = filter->cutoff, peak;
    if (filter->kernel == SP_KERNEL_CUBIC) {
        radius = SP_CUBIC_RADIUS / SP_CUBIC_SIGMA;
        peak = SP_CUBIC_SIGMA * SP_CUBIC_SIGMA * sp_cubic_footprint(0);
    } else {
        peak = 1 / (2 * M_PI * -expm1(-0.5 * radius * radius));
    }
    frame->sigma = (float)sigma;
    frame->radius = (float)radius;
    frame->cut = (float)(0.5 * radius * radius) * SP_LOG2E;
    frame->peak = (float)peak;
    frame->flat = (float)(0.8 / sigma);
    return sigma;
}

void sp_ewa_frame_init(struct sp_ewa_frame *frame, const struct sp_camera_transform *camera,
                       const struct sp_grid *grid, const struct sp_view *view,
                       const struct sp_filter *filter) {
    struct sp_mat3 step = sp_grid_steps(grid, 1);
    double unit = cbrt(fabs(sp_mat3_determinant(&step))); /* v = unit³ */
    struct sp_vec3 away = sp_vec3_sub(sp_vec3_from(grid->origin), camera->eye);
    struct sp_vec3 base = sp_mat3_apply(&camera->w, away);
    step = sp_mat3_multiply(&camera->w, &step);
    bool perspective = camera->projection == SP_PERSPECTIVE;
    *frame = (struct sp_ewa_frame){
        .projection = camera->projection,
        .grid = grid,
        .unit = unit,
        .scale = sp_finite_float(perspective ? camera->scale : camera->scale * unit),
        .centre = { (float)camera->centre[0], (float)camera->centre[1] },
        .near = sp_finite_float(fmax(camera->near / unit, 1e-3)),
        .lowpass2 = fmaxf((float)(filter->lowpass * filter->lowpass), SP_VARIANCE_MIN),
        .post = view->transfer_function.order == SP_TF_POST,
        .gain = sp_finite_float(unit / view->transfer_function.reference_length),
        .size = { (int)view->size[0], (int)view->size[1] },
        .rows = { 0, (int)view->size[1] },
    };
    double sigma = init_kernel(frame, filter);
    for (int r = 0; r < 3; r++) {
        frame->base[r] = base.v[r] / unit;
        for (int a = 0; a < 3; a++) {
            frame->step_hi[r][a] = step.m[r][a] / unit;
            frame->step[r][a] = (float)frame->step_hi[r][a];
            frame->kernel[r][a] = (float)(sigma * frame->step_hi[r][a]);
        }
    }
    for (int i = 0; i < 2; i++)
        frame->ratio_max[i] = SP_EWA_MARGIN * (float)camera->tan_half[i] + SP_EWA_SLACK;
    double across[3] = { 0 };
    for (unsigned a = 0; a < 3; a++) {
        double extent[2];
        sp_grid_extent(grid, a, extent);
        for (int r = 0; r < 3; r++) /* the largest distance between two corners: an upper bound */
            across[r] += fabs(step.m[r][a]) / grid->spacing[a] * (extent[1] - extent[0]) / unit;
    }
    frame->diameter = sp_vec3_length(sp_vec3_from(across));
}

float sp_ewa_distance(const struct sp_ewa_frame *f, const float u[3]) {
    if (f->projection == SP_ORTHOGRAPHIC)
        return u[2];
    return sqrtf(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
}

void sp_ewa_brick_init(struct sp_ewa_brick *brick, const struct sp_ewa_frame *f,
                       const uint32_t first[3]) {
    static const float even[SP_BRICK] = { 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15 };
    static const float ones[SP_BRICK] = { 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1 };
    const struct sp_grid *grid = f->grid;
    double base[3] = { f->base[0], f->base[1], f->base[2] };
    for (unsigned a = 0; a < 3; a++) {
        double inv = 1 / grid->spacing[a], start = first[a];
        brick->at[a] = even;
        brick->size[a] = ones;
        if (grid->coordinates[a]) {
            start = sp_grid_distance(grid, a, first[a]) * inv;
            for (uint32_t i = 0; i < SP_BRICK && first[a] + i < grid->dims[a]; i++) {
                double at = sp_grid_distance(grid, a, first[a] + i) * inv;
                brick->own[a][0][i] = (float)(at - start);
                brick->own[a][1][i] = (float)(sp_grid_local_spacing(grid, a, first[a] + i) * inv);
            }
            brick->at[a] = brick->own[a][0];
            brick->size[a] = brick->own[a][1];
        }
        for (int r = 0; r < 3; r++)
            base[r] += f->step_hi[r][a] * start;
    }
    for (int r = 0; r < 3; r++)
        brick->base[r] = sp_finite_float(base[r]);
}

/* The voxels of a brick along one axis [mean spacings]. */
struct stretch {
    double first, last; /* distances from sample 0 */
    double widest;      /* local spacing */
};

static struct stretch measure_stretch(const struct sp_grid *grid, unsigned a, uint32_t first) {
    const double inv = 1 / grid->spacing[a];
    const uint32_t end = grid->dims[a] - first > SP_BRICK ? first + SP_BRICK : grid->dims[a];
    struct stretch s = { .first = sp_grid_distance(grid, a, first) * inv,
                         .last = sp_grid_distance(grid, a, end - 1) * inv,
                         .widest = 1 };
    if (!grid->coordinates[a])
        return s;
    s.widest = 0;
    for (uint32_t i = first; i < end; i++)
        s.widest = fmax(s.widest, sp_grid_local_spacing(grid, a, i) * inv);
    return s;
}

/* The corner that lies farthest inside the plane decides: planes are linear, and the widest kernel
 * reaches farthest. The slack is more than what sp_extent_cut() rounds. */
bool sp_ewa_brick_is_clipped(const struct sp_ewa_frame *f, const uint32_t first[3]) {
    const double rounding = 1e-6, tail = fmax((double)f->radius, SP_CUT_TAIL);
    struct stretch at[3];
    double size = 0; /* at least the largest component of u */
    for (unsigned a = 0; a < 3 && f->clip.count; a++) {
        at[a] = measure_stretch(f->grid, a, first[a]);
        size += fabs(f->base[a]);
        for (int r = 0; r < 3; r++)
            size += fabs(f->step_hi[r][a]) * (fabs(at[a].first) + fabs(at[a].last));
    }
    for (uint32_t i = 0; i < f->clip.count; i++) {
        const struct sp_clip_half *h = &f->clip.planes[i];
        double inside = -(double)h->offset, variance = 0;
        for (int a = 0; a < 3; a++) {
            double along = 0;
            for (int r = 0; r < 3; r++)
                along += (double)h->normal[r] * f->step_hi[r][a];
            inside +=
                (double)h->normal[a] * f->base[a] + fmax(along * at[a].first, along * at[a].last);
            variance += along * along * at[a].widest * at[a].widest;
        }
        double reach = tail * (double)f->sigma * sqrt(variance);
        double slack = rounding * (size + fabs((double)h->offset) + reach);
        if (inside < -reach - slack)
            return true;
    }
    return false;
}
