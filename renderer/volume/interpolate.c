/* SPDX-License-Identifier: Apache-2.0 */
#include "volume/interpolate.h"

#include <math.h>

#include "base/vec.h"
#include "volume/grid.h"
#include "volume/sample.h"

void sp_interpolator_init(struct sp_interpolator *self, const struct sp_volume *volume) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    struct sp_mat3 direction;
    double determinant;
    self->grid = &info->grid;
    self->voxels = sp_volume_voxels(volume);
    self->type = info->type;
    for (unsigned row = 0; row < 3; row++)
        for (unsigned axis = 0; axis < 3; axis++)
            direction.m[row][axis] = info->grid.direction[row][axis];
    const struct sp_mat3 inverse = sp_mat3_inverse(&direction, &determinant);
    for (unsigned axis = 0; axis < 3; axis++) {
        for (unsigned column = 0; column < 3; column++)
            self->inverse[axis][column] = inverse.m[axis][column];
        sp_grid_extent(&info->grid, axis, self->extent[axis]);
    }
}

void sp_interpolator_distances(const struct sp_interpolator *self, const double position[3],
                               double distances[3]) {
    double from[3];
    for (unsigned i = 0; i < 3; i++)
        from[i] = position[i] - self->grid->origin[i];
    for (unsigned axis = 0; axis < 3; axis++)
        distances[axis] = self->inverse[axis][0] * from[0] + self->inverse[axis][1] * from[1] +
                          self->inverse[axis][2] * from[2];
}

/* Returns the last sample at or before the distance, which lies between two samples. */
static uint32_t find_low(const double *coordinates, uint32_t last, double distance) {
    uint32_t low = 0, high = last;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (coordinates[middle] <= distance)
            low = middle;
        else
            high = middle;
    }
    return low;
}

bool sp_interpolator_cell(const struct sp_interpolator *self, unsigned axis, double distance,
                          struct sp_cell *cell) {
    const double *coordinates = self->grid->coordinates[axis];
    const uint32_t last = self->grid->dims[axis] - 1;
    if (!(distance >= self->extent[axis][0] && distance <= self->extent[axis][1]))
        return false;
    *cell = (struct sp_cell){ .low = 0 };
    if (last == 0 || distance <= 0)
        return true;
    if (distance >= sp_grid_distance(self->grid, axis, last)) {
        cell->low = last;
        return true;
    }
    if (coordinates) {
        cell->low = find_low(coordinates, last, distance);
        cell->fraction = (distance - coordinates[cell->low]) /
                         (coordinates[cell->low + 1] - coordinates[cell->low]);
    } else {
        const double index = distance / self->grid->spacing[axis];
        cell->low = (uint32_t)index < last ? (uint32_t)index : last - 1;
        cell->fraction = index - cell->low;
    }
    /* A point that rounding moved off a sample must not read the sample behind it. */
    if (cell->fraction < 1e-9)
        cell->fraction = 0;
    if (cell->fraction > 1 - 1e-9)
        *cell = (struct sp_cell){ .low = cell->low + 1 };
    return true;
}

double sp_interpolator_value(const struct sp_interpolator *self, const struct sp_cell cells[3]) {
    const uint64_t step[3] = { 1, self->grid->dims[0],
                               (uint64_t)self->grid->dims[0] * self->grid->dims[1] };
    const uint64_t first =
        cells[0].low + step[1] * (uint64_t)cells[1].low + step[2] * (uint64_t)cells[2].low;
    double sum = 0;
    for (unsigned corner = 0; corner < 8; corner++) {
        double weight = 1;
        uint64_t at = first;
        for (unsigned axis = 0; axis < 3; axis++) {
            const bool is_high = corner >> axis & 1;
            weight *= is_high ? cells[axis].fraction : 1 - cells[axis].fraction;
            at += is_high ? step[axis] : 0;
        }
        if (weight > 0) /* else the sample may lie behind the end of the array */
            sum += weight * sp_sample(self->voxels, self->type, at);
    }
    return sum;
}

bool sp_interpolator_at(const struct sp_interpolator *self, const double position[3],
                        double *value) {
    double distances[3];
    struct sp_cell cells[3];
    sp_interpolator_distances(self, position, distances);
    for (unsigned axis = 0; axis < 3; axis++)
        if (!sp_interpolator_cell(self, axis, distances[axis], &cells[axis]))
            return false;
    *value = sp_interpolator_value(self, cells);
    return true;
}
