/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/grid.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "sp/bricks.h"

/* A voxel may be 2^40 times its size away from the origin: 12 bits of a double then remain for
 * positions inside a voxel. */
#define ORIGIN_SAMPLES_MAX 0x1p40

static bool check_direction(const struct sp_grid *grid, const char *place, struct sp_error *err) {
    const struct sp_mat3 direction = sp_grid_directions(grid);
    for (int axis = 0; axis < 3; axis++) {
        double length = sp_vec3_length(sp_vec3_from(sp_mat3_transpose(&direction).m[axis]));
        if (!(fabs(length - 1) <= 1e-6))
            return sp_fail(err, SP_ERR_FORMAT, place,
                           "direction of axis %d has length %g instead of 1", axis, length);
    }
    double det = sp_mat3_determinant(&direction);
    if (!(fabs(det) >= 1e-6))
        return sp_fail(err, SP_ERR_FORMAT, place,
                       "directions are singular (determinant %g): the axes lie in one plane", det);
    return true;
}

static bool check_dims(const struct sp_grid *grid, const char *place, struct sp_error *err) {
    uint64_t voxels = 1;
    for (int axis = 0; axis < 3; axis++) {
        if (grid->dims[axis] < 1 || grid->dims[axis] > SP_DIM_MAX)
            return sp_fail(err, SP_ERR_FORMAT, place, "dims[%d] is %" PRIu32 ", outside [1, %u]",
                           axis, grid->dims[axis], SP_DIM_MAX);
        voxels *= grid->dims[axis]; /* 2^48 at most */
    }
    if (voxels > SP_VOXELS_MAX)
        return sp_fail(err, SP_ERR_FORMAT, place,
                       "dims %" PRIu32 " x %" PRIu32 " x %" PRIu32 " are more than %" PRIu64
                       " voxels",
                       grid->dims[0], grid->dims[1], grid->dims[2], SP_VOXELS_MAX);
    return true;
}

static bool check_spacing(const struct sp_grid *grid, const char *place, struct sp_error *err) {
    for (int axis = 0; axis < 3; axis++)
        if (!(grid->spacing[axis] >= 1e-12 && grid->spacing[axis] <= 1e12))
            return sp_fail(err, SP_ERR_FORMAT, place, "spacing[%d] is %g, outside [1e-12, 1e12]",
                           axis, grid->spacing[axis]);
    return true;
}

/* Gaps that differ more than this are a mistake, and no image could show them all. */
#define GAP_RATIO_MAX 1e6

/* *least becomes the smallest gap, world units. */
static bool check_axis(const struct sp_grid *grid, int axis, double *least, const char *place,
                       struct sp_error *err) {
    const double *c = grid->coordinates[axis];
    uint32_t last = grid->dims[axis] - 1;
    double low = INFINITY, high = 0;
    if (c[0] != 0)
        return sp_fail(err, SP_ERR_FORMAT, place,
                       "coordinates[%d] begin at %g; they must begin at 0", axis, c[0]);
    for (uint32_t i = 1; i <= last; i++) {
        double gap = c[i] - c[i - 1];
        if (!(gap >= 1e-12 && gap <= 1e12))
            return sp_fail(err, SP_ERR_FORMAT, place,
                           "coordinates[%d]: the step from element %" PRIu32 " (%g) to the next "
                           "(%g) is outside [1e-12, 1e12]",
                           axis, i - 1, c[i - 1], c[i]);
        low = fmin(low, gap);
        high = fmax(high, gap);
    }
    if (high > GAP_RATIO_MAX * low)
        return sp_fail(err, SP_ERR_FORMAT, place,
                       "coordinates[%d] have gaps from %g to %g, more than a factor of %g", axis,
                       low, high, GAP_RATIO_MAX);
    double mean = last ? c[last] / last : grid->spacing[axis];
    if (!(fabs(grid->spacing[axis] - mean) <= 1e-9 * mean))
        return sp_fail(err, SP_ERR_FORMAT, place,
                       "spacing[%d] is %g instead of the coordinates' mean, %g", axis,
                       grid->spacing[axis], mean);
    if (last)
        *least = low;
    return true;
}

/* *least becomes the smallest gap of the grid, world units. */
static bool check_coordinates(const struct sp_grid *grid, double *least, const char *place,
                              struct sp_error *err) {
    *least = INFINITY;
    for (int axis = 0; axis < 3; axis++) {
        double gap = grid->spacing[axis];
        if (grid->coordinates[axis] && !check_axis(grid, axis, &gap, place, err))
            return false;
        *least = fmin(*least, gap);
    }
    return true;
}

static bool check_origin(const struct sp_grid *grid, double least, const char *place,
                         struct sp_error *err) {
    for (int axis = 0; axis < 3; axis++) {
        if (!(fabs(grid->origin[axis]) <= 1e15))
            return sp_fail(err, SP_ERR_FORMAT, place, "origin[%d] is %g, outside [-1e15, 1e15]",
                           axis, grid->origin[axis]);
        if (fabs(grid->origin[axis]) > ORIGIN_SAMPLES_MAX * least)
            return sp_fail(err, SP_ERR_FORMAT, place,
                           "origin[%d] is %g, more than 2^40 times the spacing of %g: too far for "
                           "a view; move it closer to 0",
                           axis, grid->origin[axis], least);
    }
    return true;
}

void sp_grid_copy_axes(struct sp_grid *grid, double *numbers) {
    for (int a = 0; a < 3; a++)
        if (grid->coordinates[a]) {
            memcpy(numbers, grid->coordinates[a], grid->dims[a] * sizeof *numbers);
            grid->coordinates[a] = numbers;
            numbers += grid->dims[a];
        }
}

bool sp_grid_require_even(bool is_rectilinear, const char *place, struct sp_error *err) {
    return !is_rectilinear ||
           sp_fail(err, SP_ERR_UNSUPPORTED, place,
                   "its axes have uneven steps, which only %s files keep", SP_BRICKS_SUFFIX);
}

void sp_grid_coarsen(const double *places, uint32_t count, double *coarse) {
    for (uint32_t i = 0; 2 * i < count; i++) {
        const double first = places[2 * i], next = 2 * i + 1 < count ? places[2 * i + 1] : first;
        coarse[i] = 0.5 * (first + next);
    }
}

enum sp_grid_field sp_grid_invalid_field(const struct sp_grid *grid) {
    struct sp_error unused;
    double least;
    return !check_dims(grid, "", &unused)                  ? SP_GRID_DIMS
           : !check_coordinates(grid, &least, "", &unused) ? SP_GRID_COORDINATES
           : !check_spacing(grid, "", &unused)             ? SP_GRID_SPACING
           : !check_origin(grid, least, "", &unused)       ? SP_GRID_ORIGIN
           : !check_direction(grid, "", &unused)           ? SP_GRID_DIRECTION
                                                           : SP_GRID_GOOD;
}

bool sp_grid_check(const struct sp_grid *grid, enum sp_type type, const char *place,
                   uint64_t *bytes, struct sp_error *err) {
    double least;
    if (!check_dims(grid, place, err) || !check_coordinates(grid, &least, place, err) ||
        !check_spacing(grid, place, err) || !check_origin(grid, least, place, err) ||
        !check_direction(grid, place, err))
        return false;
    *bytes = (uint64_t)grid->dims[0] * grid->dims[1] * grid->dims[2] * sp_type_size(type);
    return true;
}
