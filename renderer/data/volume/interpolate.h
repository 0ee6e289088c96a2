/* SPDX-License-Identifier: Apache-2.0
 *
 * Values between samples, as sp/measure.h defines them.
 *
 *   world ──(inverse direction)──► distances along the axes ──► cells ──► value
 */
#ifndef SP_VOLUME_INTERPOLATE_H
#define SP_VOLUME_INTERPOLATE_H

#include <stddef.h>

#include "sp/volume.h"

enum { SP_INTERPOLATE_RUN = 256 }; /* points per call of sp_interpolate_run(), at most */

/* Where a point lies along one axis: between sample `low` and the next one. */
struct sp_cell {
    uint32_t low;
    double fraction; /* [0, 1); 0 at a sample and beyond the last one */
};

struct sp_interpolator {
    const struct sp_grid *grid;
    const void *voxels;
    enum sp_type type;
    double inverse[3][3]; /* inverse of the direction matrix */
    double extent[3][2];  /* the ends of the volume along each axis, world units from sample 0 */
};

void sp_interpolator_init(struct sp_interpolator *self, const struct sp_volume *volume);
/* Initialises an interpolator for distances and cells only: it has no samples. */
void sp_interpolator_init_grid(struct sp_interpolator *self, const struct sp_grid *grid);
/* Computes the distances of a world position from sample 0 along the axes, world units. */
void sp_interpolator_distances(const struct sp_interpolator *self, const double position[3],
                               double distances[3]);
/* Finds the cell at a distance along an axis. False: the distance is outside of the volume. */
bool sp_interpolator_cell(const struct sp_interpolator *self, unsigned axis, double distance,
                          struct sp_cell *cell);
/* Returns the value between eight samples; not finite if a sample with a weight above 0 is not
 * finite. */
double sp_interpolator_value(const struct sp_interpolator *self, const struct sp_cell cells[3]);
/* Computes the value at a world position in one step. False: the position is outside of the
 * volume. */
bool sp_interpolator_at(const struct sp_interpolator *self, const double position[3],
                        double *value);
/* Returns the number of the last coordinate at or before the distance, below `last`, which is at
 * least 1. Coordinates rise. */
uint32_t sp_interpolate_low(const double *coordinates, uint32_t last, double distance);
/* Writes the values at n ≤ SP_INTERPOLATE_RUN points, given by their distances along the axes: NaN
 * outside of the volume, and where a sample with a weight above 0 is not finite. Faster than the
 * functions above, because it branches on the type once. */
void sp_interpolate_run(const struct sp_interpolator *self, size_t n, const double (*distances)[3],
                        double *values);

/* Returns the grey of a value in a window {centre, width}, [0, 1]. The value is not NaN. */
static inline double sp_grey_level(double value, const double window[2]) {
    double grey = (value - window[0]) / window[1] + 0.5;
    return grey < 0 ? 0 : grey > 1 ? 1 : grey;
}

#endif
