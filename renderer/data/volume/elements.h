/* SPDX-License-Identifier: Apache-2.0
 *
 * Elements in the memory of a volume: one array after the other, each 64-byte aligned, behind the
 * only sample of the grid.
 */
#ifndef SP_VOLUME_ELEMENTS_H
#define SP_VOLUME_ELEMENTS_H

#include "sp/elements.h"
#include "sp/volume.h"

/* Checks a shape from an untrusted header. Returns NULL, or what is wrong with it: a constant
 * string. */
const char *sp_elements_shape_problem(const struct sp_elements_shape *shape);

/* Returns the bytes of the memory that elements of this shape need, a multiple of 64, the sample
 * included. The shape must have passed the check and be no grid. */
uint64_t sp_elements_bytes(const struct sp_elements_shape *shape);

/* Finds the arrays in such memory, which is 64-byte aligned. */
struct sp_elements sp_elements_at(const struct sp_elements_shape *shape, void *memory);

/* True if all triangles name vertices that exist. */
bool sp_elements_are_sound(const struct sp_elements *elements);

/* The grid of a volume that has these elements: one sample, in the box around those positions whose
 * coordinates are below 1e15. Sides are at least a thousandth of the longest. */
void sp_elements_grid(const struct sp_elements *elements, struct sp_grid *grid);

/* True for elements that count when the camera looks for them: not too far away to be seen, and not
 * nearly transparent.
 */
bool sp_elements_counts(const struct sp_elements *elements, uint32_t element);

/* The box, along the axes of the world, that holds the elements but for the few that lie far away,
 * as those of trained scenes do. False if there are none, or without memory. */
bool sp_elements_core(const struct sp_elements *elements, double low[3], double high[3]);

/* The share of elements that may lie outside of the core on each side. */
double sp_elements_tail(enum sp_kind kind);

/* Typical size of an element, world units, > 0: the edge of the cube around a point, or a scale of
 * a Gaussian, as a geometric mean of those that are drawn; of a mesh a thousandth of its diameter.
 */
double sp_elements_spacing(const struct sp_elements *elements, const struct sp_grid *grid);

#endif
