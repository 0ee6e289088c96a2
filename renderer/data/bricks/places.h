/* SPDX-License-Identifier: Apache-2.0
 *
 * Where the samples of each level lie along the axes, even or rectilinear, as distances from sample
 * 0 of level 0 [world unit].
 */
#ifndef SP_BRICKS_PLACES_H
#define SP_BRICKS_PLACES_H

#include "data/bricks/format.h"

/* Numbers that the rectilinear axes of level 0 have, and those of all levels together. */
size_t sp_brick_places_first(const struct sp_brick_header *header);
size_t sp_brick_places_count(const struct sp_brick_header *header);

/* Fills the places of coarser levels behind those of level 0, axis by axis, which the first numbers
 * are. Sets the places of the levels and the coordinates of the grid, which point into `numbers`.
 */
void sp_brick_places_fill(struct sp_brick_header *header, double *numbers);

/* The distance of a place between samples of a level, or beyond them. */
double sp_brick_distance(const struct sp_brick_header *header, unsigned level, int axis, double at);

/* The other way round. */
double sp_brick_sample(const struct sp_brick_header *header, unsigned level, int axis,
                       double distance);

#endif
