/* SPDX-License-Identifier: Apache-2.0
 *
 * The mean extinction of each cell. Between two neighbouring samples the value changes linearly, so
 * the mean of the transfer function is a difference of its integral: a surface that is thinner than
 * a sample keeps its optical depth. A position takes the mean over the pairs along
 * all three axes, and a cell joins its positions (cells.c).
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/transfer.h"
#include "data/volume/grid.h"
#include "draw/light/light.h"
#include "splat/exp2.h"

static double depth_at(const struct sp_transfer_function *tf, double value) {
    struct sp_class class;
    sp_transfer_function_eval(tf, value, &class);
    return (double)class.depth;
}

static void init_integral(struct sp_light_cells *c) {
    enum { PARTS = 4 };
    const struct sp_transfer_function *tf = c->tf;
    double low = tf->points[0].value, high = tf->points[tf->point_count - 1].value;
    if (!(high > low))
        high = low + fmax(1e-6, fabs(low) * 1e-6);
    double step = high / LIGHT_BINS - low / LIGHT_BINS, sum = 0; /* the difference may overflow */
    c->low = low;
    c->per_unit = fmin(1 / step, 1e30);
    c->fits_floats = fabs(low) < 1e6 && c->per_unit > 1e-6 && c->per_unit < 1e6;
    c->means[0] = (float)depth_at(tf, low);
    c->first_visible = c->means[0] > 0 ? -INFINITY : INFINITY;
    for (int i = 0; i < LIGHT_BINS; i++) {
        double mean = 0;
        for (int k = 0; k < PARTS; k++)
            mean += depth_at(tf, low + (i + (k + 0.5) / PARTS) * step) / PARTS;
        c->sums[i + 1] = (float)sum;
        c->means[i + 1] = (float)mean;
        sum += mean;
        if (mean > 0)
            c->first_visible = fminf(c->first_visible, (float)i);
    }
    c->sums[LIGHT_BINS + 1] = (float)sum;
    c->means[LIGHT_BINS + 1] = (float)depth_at(tf, high);
    if (c->means[LIGHT_BINS + 1] > 0)
        c->first_visible = fminf(c->first_visible, LIGHT_BINS);
}

/* The samples at evenly spaced coordinates. */
static bool list_positions(struct sp_light_cells *x, unsigned side) {
    const struct sp_grid *grid = &x->info->grid;
    x->is_even = true;
    for (unsigned a = 0; a < 3; a++) {
        uint32_t count = (x->dims[a] - 2) * x->per_cell + 1, last = grid->dims[a] - 1, s = 0;
        x->width[a] = grid->spacing[a] * side / x->per_cell;
        x->sample[a] = malloc(count * sizeof *x->sample[a]);
        if (!x->sample[a])
            return false;
        for (uint32_t i = 0; i < count; i++) {
            double at = (double)i * side / x->per_cell * grid->spacing[a];
            while (s < last && sp_grid_distance(grid, a, s + 1) <= at * (1 + 1e-9))
                s++;
            x->sample[a][i] = s;
            x->is_even = x->is_even && (a > 0 || s == (i < last ? i : last));
        }
    }
    return true;
}

static void add_half(struct sp_light_cells *x, const double normal[3], double offset) {
    double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    struct sp_light_half *half = &x->halves[x->half_count++];
    for (int a = 0; a < 3; a++)
        half->normal[a] = normal[a] / length;
    half->offset = offset / length;
}

/* What clipping keeps, in cell coordinates: world = origin + direction·distance, and
 * distance = (cell − first)·side·spacing. */
static void list_halves(struct sp_light_cells *x, const struct sp_light_slot *slot) {
    const struct sp_grid *grid = &x->info->grid;
    const struct sp_clip *clip = &slot->clip;
    double side = slot->side, first = sp_light_first(slot);
    for (unsigned a = 0; a < 3; a++)
        for (int end = 0; end < 2; end++) {
            double extent[2], normal[3] = { 0 }, sign = end ? -1 : 1;
            if (clip->box[end][a] == end)
                continue;
            sp_grid_extent(grid, a, extent);
            double distance = extent[0] + clip->box[end][a] * (extent[1] - extent[0]);
            normal[a] = sign;
            add_half(x, normal, sign * (distance / grid->spacing[a] / side + first));
        }
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        const double *n = clip->planes[i].normal;
        double largest = fmax(fabs(n[0]), fmax(fabs(n[1]), fabs(n[2]))), normal[3] = { 0 };
        double offset = clip->planes[i].offset / largest;
        for (int r = 0; r < 3; r++) {
            offset -= n[r] / largest * grid->origin[r];
            for (int a = 0; a < 3; a++)
                normal[a] += n[r] / largest * grid->direction[r][a] * grid->spacing[a] * side;
        }
        for (int a = 0; a < 3; a++)
            offset += normal[a] * first;
        add_half(x, normal, offset);
    }
}

struct work {
    const struct sp_light_cells *cells;
    const struct sp_light_job *job;
};

static void compute_slices(void *user, size_t begin, size_t end, unsigned worker) {
    const struct work *work = user;
    for (size_t k = begin; k < end && !sp_interrupt_is_cancelled(&work->job->interrupt); k++)
        work->job->kernels->compute_cells(work->cells, (uint32_t)k, worker);
}

static bool compute_extinction(struct sp_light_cells *c, const struct sp_light_slot *slot,
                               const struct sp_light_job *job) {
    const struct work work = { c, job };
    c->worker_floats = sp_light_cells_floats(c->dims[0] - 2, c->per_cell);
    c->rows = malloc(c->worker_floats * sp_pool_threads(job->pool) * sizeof *c->rows);
    if (!c->rows || !list_positions(c, slot->side))
        return false;
    init_integral(c);
    for (int a = 0; a < 3; a++) {
        double depth = (double)SP_LOG2E * c->width[a] / slot->tf.reference_length;
        c->column_depth[a] = (float)-fmin(depth, 1e30);
        c->per_column[a] =
            (float)(sp_light_cell_width(slot) / (c->width[a] * c->per_cell) / 3 / (double)SP_LOG2E);
    }
    list_halves(c, slot);
    sp_parallel_for(job->pool, c->dims[2], 1, compute_slices, (void *)&work);
    return true;
}

bool sp_extinction_compute(struct sp_light_slot *slot, const struct sp_light_job *job,
                           struct sp_error *err) {
    struct sp_light_cells *c = malloc(sizeof *c);
    if (!c)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the volume's extinction");
    *c = (struct sp_light_cells){ .voxels = sp_volume_voxels(job->volume),
                                  .info = sp_volume_info(job->volume),
                                  .tf = &slot->tf,
                                  .per_cell = sp_light_per_cell(slot),
                                  .extinction = slot->extinction,
                                  .field = slot->field };
    memcpy(c->dims, slot->dims, sizeof c->dims);
    bool ok = compute_extinction(c, slot, job);
    free(c->rows);
    for (int a = 0; a < 3; a++)
        free(c->sample[a]);
    free(c);
    if (!ok)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the volume's extinction");
    return !sp_interrupt_is_cancelled(&job->interrupt) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}
