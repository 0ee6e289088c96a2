/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/interpolate.h"

#include <assert.h>
#include <math.h>

#include "base/vec.h"
#include "data/volume/grid.h"
#include "data/volume/sample.h"

void sp_interpolator_init_grid(struct sp_interpolator *self, const struct sp_grid *grid) {
    struct sp_mat3 direction;
    double determinant;
    *self = (struct sp_interpolator){ .grid = grid };
    for (unsigned row = 0; row < 3; row++)
        for (unsigned axis = 0; axis < 3; axis++)
            direction.m[row][axis] = grid->direction[row][axis];
    const struct sp_mat3 inverse = sp_mat3_inverse(&direction, &determinant);
    for (unsigned axis = 0; axis < 3; axis++) {
        for (unsigned column = 0; column < 3; column++)
            self->inverse[axis][column] = inverse.m[axis][column];
        sp_grid_extent(grid, axis, self->extent[axis]);
    }
}

void sp_interpolator_init(struct sp_interpolator *self, const struct sp_volume *volume) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    sp_interpolator_init_grid(self, &info->grid);
    self->voxels = sp_volume_voxels(volume);
    self->type = info->type;
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

uint32_t sp_interpolate_low(const double *coordinates, uint32_t last, double distance) {
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
        cell->low = sp_interpolate_low(coordinates, last, distance);
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

/* The samples around a point. */
struct corners {
    uint64_t first;
    uint64_t next[3]; /* to the neighbour along each axis; 0 = the point lies on the sample */
    double fraction[3];
    bool is_inside;
};

static void compute_corners(const struct sp_interpolator *self, const double distances[3],
                            struct corners *corners) {
    const uint64_t step[3] = { 1, self->grid->dims[0],
                               (uint64_t)self->grid->dims[0] * self->grid->dims[1] };
    *corners = (struct corners){ .is_inside = true };
    for (unsigned axis = 0; axis < 3 && corners->is_inside; axis++) {
        struct sp_cell cell;
        corners->is_inside = sp_interpolator_cell(self, axis, distances[axis], &cell);
        if (!corners->is_inside)
            return;
        corners->first += step[axis] * cell.low;
        corners->next[axis] = cell.fraction > 0 ? step[axis] : 0;
        corners->fraction[axis] = cell.fraction;
    }
}

static double mix(const double v[8], const double fraction[3]) {
    double x[4], y[2];
    for (int i = 0; i < 4; i++)
        x[i] = v[2 * i] + (v[2 * i + 1] - v[2 * i]) * fraction[0];
    for (int i = 0; i < 2; i++)
        y[i] = x[2 * i] + (x[2 * i + 1] - x[2 * i]) * fraction[1];
    return y[0] + (y[1] - y[0]) * fraction[2];
}

/* Sets values[i] from the samples of type T around each point that is inside. */
#define INTERPOLATE(T)                                                                             \
    for (size_t i = 0; i < n; i++) {                                                               \
        const struct corners *c = &corners[i];                                                     \
        const T *samples = (const T *)self->voxels + c->first;                                     \
        double v[8];                                                                               \
        if (!c->is_inside)                                                                         \
            continue;                                                                              \
        values[i] = (double)samples[0];                                                            \
        if (!(c->next[0] | c->next[1] | c->next[2]))                                               \
            continue;                                                                              \
        for (unsigned k = 0; k < 8; k++)                                                           \
            v[k] = (double)samples[(k & 1 ? c->next[0] : 0) + (k & 2 ? c->next[1] : 0) +           \
                                   (k & 4 ? c->next[2] : 0)];                                      \
        values[i] = mix(v, c->fraction);                                                           \
    }

void sp_interpolate_run(const struct sp_interpolator *self, size_t n, const double (*distances)[3],
                        double *values) {
    struct corners corners[SP_INTERPOLATE_RUN];
    assert(n <= SP_INTERPOLATE_RUN);
    for (size_t i = 0; i < n; i++) {
        compute_corners(self, distances[i], &corners[i]);
        values[i] = NAN;
    }
    switch (self->type) { SP_TYPE_CASES(INTERPOLATE) }
    for (size_t i = 0; i < n; i++)
        if (!isfinite(values[i]))
            values[i] = NAN;
}
