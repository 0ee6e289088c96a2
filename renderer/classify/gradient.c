/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/gradient.h"

#include "base/vec.h"

static double sample(const struct sp_gradient_grid *grid, uint64_t at) {
    switch (grid->type) {
    case SP_UINT8:
        return ((const uint8_t *)grid->voxels)[at];
    case SP_INT8:
        return ((const int8_t *)grid->voxels)[at];
    case SP_UINT16:
        return ((const uint16_t *)grid->voxels)[at];
    case SP_INT16:
        return ((const int16_t *)grid->voxels)[at];
    case SP_INT32:
        return ((const int32_t *)grid->voxels)[at];
    case SP_FLOAT32:
        return (double)((const float *)grid->voxels)[at];
    case SP_FLOAT64:
        return ((const double *)grid->voxels)[at];
    case SP_TYPE_COUNT:
        break;
    }
    return 0;
}

/* The longest difference over one gap of an axis, in differences over its mean one. */
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
    grid->scale = largest > 1e-300 ? 1 / largest : 1e300;
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
    grid->unit = grid->bound / grid->scale;
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

uint16_t sp_gradient_pack_direction(const double gradient[3]) {
    enum { LAST = 2 * SP_DIRECTION_STEPS };
    double u, v, sum = fabs(gradient[0]) + fabs(gradient[1]) + fabs(gradient[2]);
    if (!(sum > 1e-150) || !isfinite(sum))
        return 0;
    unfold(gradient, &u, &v);
    uint32_t qu = (uint32_t)(lround(u * SP_DIRECTION_STEPS) + SP_DIRECTION_STEPS);
    uint32_t qv = (uint32_t)(lround(v * SP_DIRECTION_STEPS) + SP_DIRECTION_STEPS);
    if (!qu && !qv) /* all corners of the map are the same direction, and 0 is taken */
        qu = qv = LAST;
    return (uint16_t)(qv << 8 | qu);
}
