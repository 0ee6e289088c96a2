/* SPDX-License-Identifier: Apache-2.0 */
#include "inspect/measure/region.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "data/volume/bins.h"
#include "data/volume/grid.h"
#include "data/volume/interpolate.h"
#include "data/volume/sample.h"
#include "inspect/measure/statistics.h"

/* Sine of the angle between two planes that count as one. */
#define SAME_PLANE 1e-7
/* Share of a side by which rounding may move a centre off the border. */
#define ON_BORDER 1e-9

struct lattice {
    struct sp_interpolator interpolator;
    bool is_ellipse, is_aligned;
    struct sp_vec3 corner;         /* a; of an ellipse: the centre */
    struct sp_vec3 sides[2];       /* to b and c */
    struct sp_vec3 along[2];       /* (P − corner)·along[i] is the share of side i */
    unsigned axes[3];              /* aligned: the axes of columns, rows and of the normal */
    struct sp_cell depth;          /* aligned: the cell along the normal's axis */
    double depth_distance;         /* aligned: where the plane lies, along that axis */
    uint32_t first[2], samples[2]; /* columns and rows */
    bool is_outside;               /* the plane does not meet the volume */
};

static struct sp_vec3 axis_direction(const struct sp_grid *grid, unsigned axis) {
    return (struct sp_vec3){ { grid->direction[0][axis], grid->direction[1][axis],
                               grid->direction[2][axis] } };
}

/* Finds two axes of the grid that lie in the plane with this normal. */
static bool find_axes(const struct sp_grid *grid, struct sp_vec3 normal, unsigned axes[3]) {
    for (unsigned third = 0; third < 3; third++) {
        const unsigned columns = third == 0 ? 1 : 0, rows = third == 2 ? 1 : 2;
        const struct sp_vec3 of_grid = sp_vec3_normalize(
            sp_vec3_cross(axis_direction(grid, columns), axis_direction(grid, rows)));
        if (sp_vec3_length(sp_vec3_cross(of_grid, normal)) > SAME_PLANE)
            continue;
        axes[0] = columns;
        axes[1] = rows;
        axes[2] = third;
        return true;
    }
    return false;
}

/* Returns the first sample at or after the distance; dims[axis] = none. */
static uint32_t first_at(const struct sp_grid *grid, unsigned axis, double distance) {
    uint32_t low = 0, high = grid->dims[axis];
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (sp_grid_distance(grid, axis, middle) < distance)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* The columns and rows of the box around the region. The border gets some slack here, because each
 * sample is tested on its own. */
static void place_aligned(struct lattice *l) {
    const struct sp_grid *grid = l->interpolator.grid;
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
    for (unsigned corner = 0; corner < 4; corner++) {
        struct sp_vec3 p = l->corner;
        double at[3];
        for (unsigned side = 0; side < 2; side++) {
            const bool is_far = corner >> side & 1;
            const double share = is_far ? 1 : l->is_ellipse ? -1 : 0;
            p = sp_vec3_add(p, sp_vec3_scale(l->sides[side], share));
        }
        sp_interpolator_distances(&l->interpolator, p.v, at);
        for (unsigned axis = 0; axis < 3; axis++) {
            low[axis] = fmin(low[axis], at[axis]);
            high[axis] = fmax(high[axis], at[axis]);
        }
    }
    for (unsigned i = 0; i < 2; i++) {
        const unsigned axis = l->axes[i];
        const double slack = 1e-6 * (grid->spacing[axis] + high[axis] - low[axis]);
        l->first[i] = first_at(grid, axis, low[axis] - slack);
        const uint32_t end = first_at(grid, axis, high[axis] + slack);
        l->samples[i] = end > l->first[i] ? end - l->first[i] : 0;
    }
    l->depth_distance = (low[l->axes[2]] + high[l->axes[2]]) / 2;
    l->is_outside =
        !sp_interpolator_cell(&l->interpolator, l->axes[2], l->depth_distance, &l->depth);
}

static void place_oblique(struct lattice *l) {
    const struct sp_grid *grid = l->interpolator.grid;
    const double cell = fmin(grid->spacing[0], fmin(grid->spacing[1], grid->spacing[2]));
    for (unsigned i = 0; i < 2; i++) {
        const double cells = round(sp_vec3_length(l->sides[i]) * (l->is_ellipse ? 2 : 1) / cell);
        l->samples[i] = (uint32_t)fmax(1, fmin(cells, UINT32_MAX / 2));
    }
}

static void lattice_init(struct lattice *l, const struct sp_volume *volume,
                         const struct sp_measure *region) {
    *l = (struct lattice){ .is_ellipse = region->kind == SP_MEASURE_ELLIPSE,
                           .corner = sp_vec3_from(region->points[0]) };
    sp_interpolator_init(&l->interpolator, volume);
    for (unsigned i = 0; i < 2; i++)
        l->sides[i] = sp_vec3_sub(sp_vec3_from(region->points[i + 1]), l->corner);
    const struct sp_vec3 normal = sp_vec3_cross(l->sides[0], l->sides[1]);
    const double square = sp_vec3_dot(normal, normal);
    l->along[0] = sp_vec3_scale(sp_vec3_cross(l->sides[1], normal), 1 / square);
    l->along[1] = sp_vec3_scale(sp_vec3_cross(normal, l->sides[0]), 1 / square);
    l->is_aligned = find_axes(l->interpolator.grid, sp_vec3_normalize(normal), l->axes);
    if (l->is_aligned)
        place_aligned(l);
    else
        place_oblique(l);
}

static bool is_inside(const struct lattice *l, double s, double t) {
    return l->is_ellipse
               ? s * s + t * t <= 1 + ON_BORDER
               : s >= -ON_BORDER && s <= 1 + ON_BORDER && t >= -ON_BORDER && t <= 1 + ON_BORDER;
}

/* Called for runs of samples inside the region and the volume. */
typedef void run_fn(void *user, const struct sp_run *run);

struct visit {
    run_fn *add_run;
    void *user;
    struct sp_run run;
};

static void flush(struct visit *visit) {
    visit->add_run(visit->user, &visit->run);
    visit->run.count = 0;
}

static inline void add_sample(struct visit *visit, double value, double weight) {
    visit->run.values[visit->run.count] = value;
    visit->run.weights[visit->run.count] = weight;
    if (++visit->run.count == SP_RUN)
        flush(visit);
}

/* The value of a sample of the grid, or between it and the next one along the normal. */
struct sampler {
    const void *voxels;
    enum sp_type type;
    uint64_t step; /* to the next sample along the normal */
    double fraction;
};

static inline double sample_at(const struct sampler *s, uint64_t at) {
    const double low = sp_sample(s->voxels, s->type, at);
    return s->fraction > 0
               ? low * (1 - s->fraction) + sp_sample(s->voxels, s->type, at + s->step) * s->fraction
               : low;
}

static void visit_row(const struct lattice *l, const struct sampler *sampler, struct visit *visit,
                      uint32_t row, const uint64_t steps[3], struct sp_vec3 from) {
    const struct sp_grid *grid = l->interpolator.grid;
    const bool is_weighted = sp_grid_is_rectilinear(grid);
    const struct sp_vec3 direction = axis_direction(grid, l->axes[0]);
    const double s0 = sp_vec3_dot(from, l->along[0]), t0 = sp_vec3_dot(from, l->along[1]);
    const double ds = sp_vec3_dot(direction, l->along[0]), dt = sp_vec3_dot(direction, l->along[1]);
    const double height = is_weighted ? sp_grid_local_spacing(grid, l->axes[1], row) : 1;
    const uint64_t start = row * steps[l->axes[1]] + l->depth.low * steps[l->axes[2]];
    for (uint32_t i = 0; i < l->samples[0]; i++) {
        const uint32_t column = l->first[0] + i;
        const double x = sp_grid_distance(grid, l->axes[0], column);
        if (!is_inside(l, s0 + ds * x, t0 + dt * x))
            continue;
        const double width = is_weighted ? sp_grid_local_spacing(grid, l->axes[0], column) : 1;
        add_sample(visit, sample_at(sampler, start + column * steps[l->axes[0]]), width * height);
    }
}

static void visit_aligned(const struct lattice *l, struct visit *visit) {
    const struct sp_grid *grid = l->interpolator.grid;
    const uint64_t steps[3] = { 1, grid->dims[0], (uint64_t)grid->dims[0] * grid->dims[1] };
    const struct sampler sampler = { .voxels = l->interpolator.voxels,
                                     .type = l->interpolator.type,
                                     .step = steps[l->axes[2]],
                                     .fraction = l->depth.fraction };
    const struct sp_vec3 from =
        sp_vec3_sub(sp_vec3_add(sp_vec3_from(grid->origin),
                                sp_vec3_scale(axis_direction(grid, l->axes[2]), l->depth_distance)),
                    l->corner);
    for (uint32_t j = 0; j < l->samples[1]; j++) {
        const uint32_t row = l->first[1] + j;
        visit_row(l, &sampler, visit, row, steps,
                  sp_vec3_add(from, sp_vec3_scale(axis_direction(grid, l->axes[1]),
                                                  sp_grid_distance(grid, l->axes[1], row))));
    }
}

static void visit_oblique(const struct lattice *l, struct visit *visit) {
    const double low = l->is_ellipse ? -1 : 0, span = l->is_ellipse ? 2 : 1;
    for (uint32_t j = 0; j < l->samples[1]; j++) {
        const double t = low + span * (j + 0.5) / l->samples[1];
        const struct sp_vec3 row = sp_vec3_add(l->corner, sp_vec3_scale(l->sides[1], t));
        for (uint32_t i = 0; i < l->samples[0]; i++) {
            const double s = low + span * (i + 0.5) / l->samples[0];
            const struct sp_vec3 p = sp_vec3_add(row, sp_vec3_scale(l->sides[0], s));
            double value;
            if (is_inside(l, s, t) && sp_interpolator_at(&l->interpolator, p.v, &value))
                add_sample(visit, value, 1);
        }
    }
}

static void visit_all(const struct lattice *l, run_fn *add_run, void *user) {
    struct visit visit = { .add_run = add_run, .user = user };
    if (l->is_outside)
        return;
    if (l->is_aligned)
        visit_aligned(l, &visit);
    else
        visit_oblique(l, &visit);
    flush(&visit);
}

static void add_to_sums(void *user, const struct sp_run *run) {
    sp_sums_add(user, run);
}

static void add_to_histogram(void *user, const struct sp_run *run) {
    struct sp_measure_result *result = user;
    const struct sp_bins bins =
        sp_bins_between(result->statistics.min, result->statistics.max, SP_MEASURE_BINS);
    for (unsigned i = 0; i < run->count; i++)
        if (isfinite(run->values[i]))
            result->histogram[sp_bin_of(&bins, run->values[i])]++;
}

static double samples_of(const struct lattice *l) {
    return l->is_outside ? 0 : (double)l->samples[0] * (double)l->samples[1];
}

double sp_region_cost(const struct sp_volume *volume, const struct sp_measure *region) {
    struct lattice lattice;
    lattice_init(&lattice, volume, region);
    return samples_of(&lattice);
}

bool sp_region_compute(const struct sp_volume *volume, const struct sp_measure *region,
                       struct sp_measure_result *result, struct sp_error *err) {
    struct lattice lattice;
    struct sp_sums sums = { 0 };
    lattice_init(&lattice, volume, region);
    if (samples_of(&lattice) > SP_MEASURE_SAMPLES)
        return sp_fail(err, SP_ERR_INVALID, "/points",
                       "the region covers %.0f x %.0f samples, more than %d; make it smaller",
                       (double)lattice.samples[0], (double)lattice.samples[1], SP_MEASURE_SAMPLES);
    visit_all(&lattice, add_to_sums, &sums);
    sp_sums_finish(&sums, &result->statistics);
    result->has_statistics = true;
    result->has_histogram = result->statistics.count > 0;
    memset(result->histogram, 0, sizeof result->histogram);
    if (result->has_histogram)
        visit_all(&lattice, add_to_histogram, result);
    return true;
}
