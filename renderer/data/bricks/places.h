/* SPDX-License-Identifier: Apache-2.0
 *
 * The places of the samples of each level along the axes, even or rectilinear, as distances from
 * sample 0 of level 0 [world unit].
 */
#ifndef SP_BRICKS_PLACES_H
#define SP_BRICKS_PLACES_H

#include "data/bricks/format.h"

/* Return how many numbers the rectilinear axes have: of level 0, and of all levels together. */
size_t sp_brick_places_first(const struct sp_brick_header *header);
size_t sp_brick_places_count(const struct sp_brick_header *header);

/* `numbers` begins with the places of level 0, axis by axis. Appends the places of the coarser
 * levels. Sets the places of the levels and the coordinates of the grid, which point into
 * `numbers`. */
void sp_brick_places_fill(struct sp_brick_header *header, double *numbers);

/* Returns the distance of position `at` of a level, in samples, which may lie between samples or
 * beyond them. */
double sp_brick_distance(const struct sp_brick_header *header, unsigned level, int axis, double at);

/* The inverse of sp_brick_distance(): returns the position in samples. */
double sp_brick_sample(const struct sp_brick_header *header, unsigned level, int axis,
                       double distance);

#endif
