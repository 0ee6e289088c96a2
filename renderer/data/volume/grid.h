/* SPDX-License-Identifier: Apache-2.0
 *
 * Where the samples of a grid lie, whether it is evenly spaced or rectilinear.
 *
 *   |--gap--|--gap--|     distance[i] along the axis; a cell reaches from the middle of one gap to
 *   i-1     i       i+1   the middle of the next, so that its size is the mean of the two gaps
 */
#ifndef SP_VOLUME_GRID_H
#define SP_VOLUME_GRID_H

#include <stdbool.h>
#include <string.h>

#include "base/vec.h"
#include "sp/volume.h"

/* Returns the matrix that converts distances along the axes to world offsets: its columns are the
 * directions of the axes. */
static inline struct sp_mat3 sp_grid_directions(const struct sp_grid *grid) {
    struct sp_mat3 m;
    memcpy(m.m, grid->direction, sizeof m.m);
    return m;
}

/* Returns the matrix that converts indices to world offsets, times `scale`: the columns are the
 * directions times the mean spacings. */
static inline struct sp_mat3 sp_grid_steps(const struct sp_grid *grid, double scale) {
    struct sp_mat3 m;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            m.m[r][a] = grid->direction[r][a] * grid->spacing[a] * scale;
    return m;
}

/* Returns the distance of sample i from sample 0 along an axis, world units. i < dims[axis]. */
static inline double sp_grid_distance(const struct sp_grid *grid, unsigned axis, uint32_t i) {
    const double *c = grid->coordinates[axis];
    return c ? c[i] : grid->spacing[axis] * i;
}

/* Returns the local spacing, world units: the mean of the two gaps next to sample i; at a border,
 * the only gap; for a single sample, the spacing of the axis. */
static inline double sp_grid_local_spacing(const struct sp_grid *grid, unsigned axis, uint32_t i) {
    const double *c = grid->coordinates[axis];
    uint32_t n = grid->dims[axis];
    if (!c || n < 2)
        return grid->spacing[axis];
    uint32_t low = i > 0 ? i - 1 : 0, high = i + 1 < n ? i + 1 : i;
    return (c[high] - c[low]) / (high - low);
}

/* Computes the ends of the volume along an axis: half a gap before the first sample and after the
 * last sample. Distances from sample 0, world units. */
static inline void sp_grid_extent(const struct sp_grid *grid, unsigned axis, double extent[2]) {
    uint32_t last = grid->dims[axis] - 1;
    extent[0] = -0.5 * sp_grid_local_spacing(grid, axis, 0);
    extent[1] = sp_grid_distance(grid, axis, last) + 0.5 * sp_grid_local_spacing(grid, axis, last);
}

static inline bool sp_grid_is_rectilinear(const struct sp_grid *grid) {
    return grid->coordinates[0] || grid->coordinates[1] || grid->coordinates[2];
}

/* Returns how many numbers suffice for the coordinates of three rectilinear axes. */
static inline size_t sp_grid_axes_max(const struct sp_grid *grid) {
    return (size_t)grid->dims[0] + grid->dims[1] + grid->dims[2];
}

/* Copies the coordinates, axis by axis, to `numbers`, and lets the grid point to the copy. */
void sp_grid_copy_axes(struct sp_grid *grid, double *numbers);

/* For outputs that cannot store rectilinear axes: fails with SP_ERR_UNSUPPORTED at `place` if
 * is_rectilinear. */
bool sp_grid_require_even(bool is_rectilinear, const char *place, struct sp_error *err);

/* Computes the (count + 1)/2 places of the samples of a coarser level along an axis: each is the
 * mean of two finer places; for an odd count, the last one is the last finer place. So the means of
 * a linear field lie on the field. `coarse` may be `places`. */
void sp_grid_coarsen(const double *places, uint32_t count, double *coarse);

/* Checks a grid from an untrusted header: dims and their product; spacing in [1e-12, 1e12];
 * coordinates that begin at 0 and rise by gaps in [1e-12, 1e12], the largest at most 10^6 times the
 * smallest of its axis, with their mean (to 1e-9) as spacing; origin within 1e15 and 2^40 of the
 * smallest gap (views would be too coarse there); direction columns of unit length (to 1e-6) and
 * not singular. On success *bytes is the size of the samples. SP_ERR_FORMAT otherwise, with `place`
 * as err->place and the field in the text. */
bool sp_grid_check(const struct sp_grid *grid, enum sp_type type, const char *place,
                   uint64_t *bytes, struct sp_error *err);

/* The field of a grid that sp_grid_check() refuses, for readers whose error places name fields. */
enum sp_grid_field {
    SP_GRID_GOOD,
    SP_GRID_DIMS,
    SP_GRID_SPACING,
    SP_GRID_COORDINATES,
    SP_GRID_ORIGIN,
    SP_GRID_DIRECTION
};
enum sp_grid_field sp_grid_invalid_field(const struct sp_grid *grid);

#endif
