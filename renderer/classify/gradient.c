/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/gradient.h"

#include <float.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "base/vec.h"
#include "data/volume/sample.h"

static double sample(const struct sp_gradient_grid *grid, uint64_t at) {
    return sp_sample(grid->voxels, grid->type, at);
}

/* Returns the mean gap of an axis divided by its smallest gap: the factor by which a difference can
 * exceed the one over the mean gap. */
static double steepest(const struct sp_grid *grid, unsigned axis) {
    const double *c = grid->coordinates[axis];
    double least = grid->spacing[axis];
    for (uint32_t i = 1; c && i < grid->dims[axis]; i++)
        least = fmin(least, c[i] - c[i - 1]);
    return grid->spacing[axis] / least;
}

void sp_gradient_units_init(struct sp_gradient_grid *grid, const struct sp_volume_info *info) {
    *grid = (struct sp_gradient_grid){ .type = info->type, .grid = &info->grid };
    struct sp_mat3 step;
    double most[3];
    for (unsigned a = 0; a < 3; a++) {
        most[a] = steepest(&info->grid, a);
        for (int r = 0; r < 3; r++)
            step.m[r][a] = info->grid.direction[r][a] * info->grid.spacing[a];
    }
    double det;
    struct sp_mat3 inverse = sp_mat3_inverse(&step, &det);
    double largest = fmax(fabs(info->range[0]), fabs(info->range[1])), norm2 = 0;
    /* Not subnormal: threads that draw flush such numbers to 0. */
    grid->scale = largest > 1e-300 ? fmax(1 / largest, DBL_MIN) : 1e300;
    double span = info->range[1] * grid->scale - info->range[0] * grid->scale;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++) {
            grid->to_world[r][a] = inverse.m[a][r];
            norm2 += pow(inverse.m[a][r] * most[a], 2);
        }
    /* Each difference is at most the span over the shortest gap, so their vector at most √3 of
     * those long. */
    grid->bound = span * sqrt(3 * norm2);
    if (!(grid->bound > 0))
        grid->bound = 1;
    grid->unit = fmin(grid->bound / grid->scale, DBL_MAX);
}

void sp_gradient_grid_init(struct sp_gradient_grid *grid, const struct sp_volume *volume) {
    sp_gradient_units_init(grid, sp_volume_info(volume));
    grid->voxels = sp_volume_voxels(volume);
}

void sp_gradient_at(const struct sp_gradient_grid *grid, const uint32_t i[3], double gradient[3]) {
    const uint32_t *dims = grid->grid->dims;
    uint64_t stride[3] = { 1, dims[0], (uint64_t)dims[0] * dims[1] };
    uint64_t at = i[0] + stride[1] * i[1] + stride[2] * i[2];
    double middle = sample(grid, at) * grid->scale, difference[3];
    for (unsigned a = 0; a < 3; a++) {
        double low = middle, high = middle;
        uint32_t from = i[a], to = i[a];
        if (i[a] > 0) {
            double s = sample(grid, at - stride[a]) * grid->scale;
            if (isfinite(s)) {
                low = s;
                from--;
            }
        }
        if (i[a] + 1 < dims[a]) {
            double s = sample(grid, at + stride[a]) * grid->scale;
            if (isfinite(s)) {
                high = s;
                to++;
            }
        }
        const double *c = grid->grid->coordinates[a];
        double gaps = c ? (c[to] - c[from]) / grid->grid->spacing[a] : to - from;
        difference[a] = from < to ? (high - low) / gaps : 0;
    }
    for (int r = 0; r < 3; r++)
        gradient[r] = grid->to_world[r][0] * difference[0] + grid->to_world[r][1] * difference[1] +
                      grid->to_world[r][2] * difference[2];
}

/* Octahedral map of a direction that is not zero: u and v in [-1, 1]. */
static void unfold(const double d[3], double *u, double *v) {
    double sum = fabs(d[0]) + fabs(d[1]) + fabs(d[2]);
    *u = d[0] / sum;
    *v = d[1] / sum;
    if (d[2] < 0) {
        double folded = (1 - fabs(*v)) * (*u < 0 ? -1 : 1);
        *v = (1 - fabs(*u)) * (*v < 0 ? -1 : 1);
        *u = folded;
    }
}

uint32_t sp_gradient_pack(const struct sp_gradient_grid *grid, const double gradient[3]) {
    double d[3], u, v;
    for (int r = 0; r < 3; r++)
        d[r] = gradient[r] / grid->bound;
    double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    if (!(length > 1e-150) || !isfinite(length))
        return 0;
    unfold(d, &u, &v);
    /* A gradient that is not zero keeps its direction, however short it is. */
    double magnitude = fmax(1, round(sqrt(fmin(length, 1)) * SP_GRADIENT_MAGNITUDES));
    uint32_t qu = (uint32_t)(lround(u * SP_GRADIENT_STEPS) + SP_GRADIENT_STEPS);
    uint32_t qv = (uint32_t)(lround(v * SP_GRADIENT_STEPS) + SP_GRADIENT_STEPS);
    return (uint32_t)magnitude << 22 | qv << 11 | qu;
}

/* Packs a direction; used for one and for many. It has no branch, so that the compiler vectorises
 * loops over it. */
static inline uint16_t pack_direction(double x, double y, double z) {
    const double steps = SP_DIRECTION_STEPS;
    const int last = 2 * SP_DIRECTION_STEPS;
    double sum = fabs(x) + fabs(y) + fabs(z);
    bool has_direction = (sum > 1e-150) & (sum <= DBL_MAX);
    double u = has_direction ? x / sum : 0, v = has_direction ? y / sum : 0;
    double fold_u = copysign(1 - fabs(v), u), fold_v = copysign(1 - fabs(u), v);
    u = z < 0 ? fold_u : u;
    v = z < 0 ? fold_v : v;
    int qu = (int)(u * steps + (steps + 0.5)), qv = (int)(v * steps + (steps + 0.5));
    int code = qv << 8 | qu;
    code = code ? code : last << 8 | last; /* the map's corners are one direction, and 0 is taken */
    return (uint16_t)(has_direction ? code : 0);
}

uint16_t sp_gradient_pack_direction(const double gradient[3]) {
    return pack_direction(gradient[0], gradient[1], gradient[2]);
}

/* Neighbours along the axes of some voxels. */
enum { BATCH = 64 };
struct neighbours {
    int32_t low[3][BATCH], high[3][BATCH];
    double gaps[3][BATCH]; /* between them, in the mean one */
};

/* Along one axis of a brick: where its neighbours are, in samples of a stride, and their gaps. */
struct steps {
    int8_t low[16], high[16];
    double gaps[16];
};

static void compute_steps(const struct sp_grid *grid, unsigned axis, uint32_t corner,
                          struct steps *steps) {
    const double *c = grid->coordinates[axis];
    for (uint32_t k = 0; k < 16 && corner + k < grid->dims[axis]; k++) {
        uint32_t i = corner + k, from = i > 0 ? i - 1 : i;
        uint32_t to = i + 1 < grid->dims[axis] ? i + 1 : i;
        steps->low[k] = (int8_t)(from < i ? -1 : 0);
        steps->high[k] = (int8_t)(to > i);
        steps->gaps[k] = from == to ? 1 : c ? (c[to] - c[from]) / grid->spacing[axis] : to - from;
    }
}

static inline int32_t whole_sample(const void *voxels, enum sp_type type, ptrdiff_t at) {
    return type == SP_UINT8    ? ((const uint8_t *)voxels)[at]
           : type == SP_INT8   ? ((const int8_t *)voxels)[at]
           : type == SP_UINT16 ? ((const uint16_t *)voxels)[at]
                               : ((const int16_t *)voxels)[at];
}

static inline void read_neighbours(const struct sp_gradient_grid *grid, enum sp_type type,
                                   const uint32_t corner[3], const struct steps steps[3],
                                   const uint16_t *local, uint32_t count, struct neighbours *to) {
    const uint32_t *dims = grid->grid->dims;
    const ptrdiff_t stride[3] = { 1, dims[0], (ptrdiff_t)dims[0] * dims[1] };
    ptrdiff_t first = 0;
    for (int a = 0; a < 3; a++)
        first += stride[a] * corner[a];
    for (uint32_t n = 0; n < count; n++) {
        const uint32_t i[3] = { local[n] & 15u, local[n] >> 4 & 15u, local[n] >> 8 };
        ptrdiff_t at = first + stride[0] * i[0] + stride[1] * i[1] + stride[2] * i[2];
        for (int a = 0; a < 3; a++) {
            const struct steps *s = &steps[a];
            to->low[a][n] = whole_sample(grid->voxels, type, at + stride[a] * s->low[i[a]]);
            to->high[a][n] = whole_sample(grid->voxels, type, at + stride[a] * s->high[i[a]]);
            to->gaps[a][n] = s->gaps[i[a]];
        }
    }
}

static void pack_batch(const struct sp_gradient_grid *grid, const struct neighbours *from,
                       uint16_t packed[BATCH]) {
    const double scale = grid->scale;
    for (int n = 0; n < BATCH; n++) {
        double d[3], g[3];
        for (int a = 0; a < 3; a++)
            d[a] = (from->high[a][n] * scale - from->low[a][n] * scale) / from->gaps[a][n];
        for (int r = 0; r < 3; r++)
            g[r] = grid->to_world[r][0] * d[0] + grid->to_world[r][1] * d[1] +
                   grid->to_world[r][2] * d[2];
        packed[n] = pack_direction(g[0], g[1], g[2]);
    }
}

void sp_gradient_pack_directions(const struct sp_gradient_grid *grid, const uint32_t corner[3],
                                 const uint16_t *local, uint32_t count, uint16_t *packed) {
    struct steps steps[3];
    struct neighbours near = { .gaps = { { 0 } } };
    uint16_t batch[BATCH];
    for (unsigned a = 0; a < 3; a++)
        compute_steps(grid->grid, a, corner[a], &steps[a]);
    for (uint32_t at = 0; at < count; at += BATCH) {
        uint32_t n = count - at < BATCH ? count - at : BATCH;
        if (grid->type == SP_UINT8)
            read_neighbours(grid, SP_UINT8, corner, steps, local + at, n, &near);
        else if (grid->type == SP_INT8)
            read_neighbours(grid, SP_INT8, corner, steps, local + at, n, &near);
        else if (grid->type == SP_UINT16)
            read_neighbours(grid, SP_UINT16, corner, steps, local + at, n, &near);
        else
            read_neighbours(grid, SP_INT16, corner, steps, local + at, n, &near);
        pack_batch(grid, &near, batch);
        memcpy(packed + at, batch, n * sizeof *batch);
    }
}
