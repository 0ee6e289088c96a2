/* SPDX-License-Identifier: Apache-2.0
 *
 * The numbers that projections of a volume show: rays through some samples, along the three axes of
 * the grid and, for means, along the four diagonals of its box. A mean counts only the part of a
 * ray inside the volume, so an object at an edge fills the rays that only touch the volume there.
 *
 *   samples ─► per ray: maximum, mean, sum ─► per direction: percentiles ─► one for all directions
 *
 * An axis counts by the area of the side that is seen along it, because a flat object is seen from
 * its broad side. A percentile of the samples would not do: a projection mixes all samples of a
 * ray.
 */
#include <math.h>
#include <stdlib.h>

#include "base/compare.h"
#include "data/volume/grid.h"
#include "data/volume/missing.h"
#include "data/volume/sample.h"
#include "data/volume/volume.h"

enum {
    SIDE = 96, /* samples per axis at most */
    CELLS = 64 /* of an image along a diagonal, per side: a ray gathers the samples of a cell */
};
enum { AXES = 3, DIAGONALS = 4, DIRECTIONS = AXES + DIAGONALS };
/* Shares of the rays below and above the ends. The background of a maximum is noise. */
static const double maximum_tails[2] = { 0.05, 0.005 }, tails[2] = { 0.01, 0.005 };

struct ray {
    double maximum, sum, length; /* values in [0, 1], of the range; lengths of finite samples */
};

struct walk {
    uint32_t count[3], step[3]; /* samples, and voxels between them */
    double size[3][SIDE];       /* of a sample along each axis, world units */
    double place[3][SIDE];      /* [0, 1] from end to end of the grid */
    size_t ray_count[DIRECTIONS];
    struct ray *rays[DIRECTIONS];
    double *sorted; /* of one number of all rays of a direction */
};

static bool walk_init(struct walk *w, const struct sp_grid *grid) {
    size_t most = 0;
    for (unsigned a = 0; a < 3; a++) {
        w->step[a] = (grid->dims[a] + SIDE - 1) / SIDE;
        w->count[a] = (grid->dims[a] + w->step[a] - 1) / w->step[a];
        for (uint32_t i = 0; i < w->count[a]; i++) {
            w->size[a][i] = w->step[a] * sp_grid_local_spacing(grid, a, i * w->step[a]);
            w->place[a][i] = (i + 0.5) / w->count[a];
        }
    }
    bool ok = true;
    for (unsigned d = 0; d < DIRECTIONS; d++) {
        const size_t rays = d < AXES ? (size_t)w->count[(d + 1) % 3] * w->count[(d + 2) % 3]
                                     : (size_t)CELLS * CELLS;
        w->ray_count[d] = rays;
        ok = (w->rays[d] = calloc(rays, sizeof(struct ray))) && ok;
        most = rays > most ? rays : most;
    }
    return (w->sorted = malloc(most * sizeof *w->sorted)) && ok;
}

static void walk_finish(struct walk *w) {
    for (unsigned d = 0; d < DIRECTIONS; d++)
        free(w->rays[d]);
    free(w->sorted);
}

static void add(struct ray *ray, double value, double size) {
    ray->maximum = fmax(ray->maximum, value);
    ray->sum += value * size;
    ray->length += size;
}

/* Adds a sample to the rays along the diagonals (1, ±1, ±1), in fractions of the grid. Both
 * coordinates of a cell lie in (−1, 1). */
static void add_diagonals(struct walk *w, double x, double y, double z, double value) {
    for (unsigned d = 0; d < DIAGONALS; d++) {
        const double u = d & 1 ? x - y : x + y - 1, v = d & 2 ? x - z : x + z - 1;
        const size_t column = (size_t)((u + 1) * (CELLS / 2)),
                     row = (size_t)((v + 1) * (CELLS / 2));
        add(&w->rays[AXES + d][row * CELLS + column], value, 1);
    }
}

static void walk_samples(struct walk *w, const struct sp_volume_info *info, const void *voxels) {
    const uint32_t *dims = info->grid.dims, *count = w->count;
    const double low = sp_missing_data(info)[0] / 2,
                 span = sp_missing_data(info)[1] / 2 - low; /* may overflow whole */
    for (uint32_t k = 0; k < count[2]; k++)
        for (uint32_t j = 0; j < count[1]; j++) {
            const uint64_t row =
                ((uint64_t)k * w->step[2] * dims[1] + (uint64_t)j * w->step[1]) * dims[0];
            for (uint32_t i = 0; i < count[0]; i++) {
                const double value =
                    (sp_sample(voxels, info->type, row + (uint64_t)i * w->step[0]) / 2 - low) /
                    span;
                if (!(value >= 0 && value <= 1))
                    continue;
                add(&w->rays[0][(size_t)k * count[1] + j], value, w->size[0][i]);
                add(&w->rays[1][(size_t)i * count[2] + k], value, w->size[1][j]);
                add(&w->rays[2][(size_t)j * count[0] + i], value, w->size[2][k]);
                add_diagonals(w, w->place[0][i], w->place[1][j], w->place[2][k], value);
            }
        }
}

enum number { MAXIMUM, MEAN, SUM };

/* The ends beyond which the shares of the rays of a direction lie. False: no ray has a sample. */
static bool compute_ends(struct walk *w, unsigned direction, enum number number,
                         const double shares[2], double ends[2]) {
    size_t n = 0;
    for (size_t i = 0; i < w->ray_count[direction]; i++) {
        const struct ray *ray = &w->rays[direction][i];
        if (ray->length > 0)
            w->sorted[n++] = number == MAXIMUM ? ray->maximum
                             : number == MEAN  ? ray->sum / ray->length
                                               : ray->sum;
    }
    if (n == 0)
        return false;
    qsort(w->sorted, n, sizeof *w->sorted, sp_compare_doubles);
    ends[0] = w->sorted[(size_t)(shares[0] * (double)(n - 1))];
    ends[1] = w->sorted[n - 1 - (size_t)(shares[1] * (double)(n - 1))];
    return true;
}

/* The mean of the ends of the axes, each counted by the area of its side. */
static void mean_ends(struct walk *w, const struct sp_grid *grid, enum number number,
                      const double shares[2], double ends[2]) {
    double total = 0, own[2];
    ends[0] = ends[1] = 0;
    for (unsigned a = 0; a < AXES; a++) {
        double extent[2];
        sp_grid_extent(grid, a, extent);
        if (!compute_ends(w, a, number, shares, own))
            continue;
        const double area = 1 / (extent[1] - extent[0]); /* over the volume of the box */
        total += area;
        ends[0] += area * own[0];
        ends[1] += area * own[1];
    }
    for (int end = 0; end < 2 && total > 0; end++)
        ends[end] /= total;
}

/* Raises the upper end to the highest of the diagonals. */
static void include_diagonals(struct walk *w, double ends[2]) {
    double own[2];
    for (unsigned d = AXES; d < DIRECTIONS; d++)
        if (compute_ends(w, d, MEAN, tails, own))
            ends[1] = fmax(ends[1], own[1]);
}

bool sp_volume_project(struct sp_volume_info *info, const void *voxels, struct sp_error *err) {
    struct walk w = { .sorted = NULL };
    struct sp_projected *projected = &info->projected;
    double sums[2];
    *projected = (struct sp_projected){ .sum = 0 };
    if (!(sp_missing_data(info)[1] > sp_missing_data(info)[0]))
        return true;
    const bool ok = walk_init(&w, &info->grid) ||
                    sp_fail(err, SP_ERR_MEMORY, info->source, "out of memory for projections");
    if (ok) {
        walk_samples(&w, info, voxels);
        mean_ends(&w, &info->grid, MAXIMUM, maximum_tails, projected->maximum);
        mean_ends(&w, &info->grid, MEAN, tails, projected->mean);
        include_diagonals(&w, projected->mean);
        mean_ends(&w, &info->grid, SUM, tails, sums);
        projected->sum = sums[1];
    }
    walk_finish(&w);
    return ok;
}
