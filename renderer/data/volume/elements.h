/* SPDX-License-Identifier: Apache-2.0
 *
 * Elements in the memory of a volume: one array after the other, each 64-byte aligned, behind the
 * only sample of the grid.
 */
#ifndef SP_VOLUME_ELEMENTS_H
#define SP_VOLUME_ELEMENTS_H

#include "sp/elements.h"
#include "sp/volume.h"

/* Checks a shape from an untrusted header. Returns NULL if the shape is valid, otherwise the
 * problem: a constant string. */
const char *sp_elements_shape_problem(const struct sp_elements_shape *shape);

/* Returns the bytes of the memory that elements of this shape need, a multiple of 64, the sample
 * included. The shape must have passed the check and be no grid. */
uint64_t sp_elements_bytes(const struct sp_elements_shape *shape);

/* Returns pointers to the arrays in memory of sp_elements_bytes() bytes, which is 64-byte
 * aligned. */
struct sp_elements sp_elements_at(const struct sp_elements_shape *shape, void *memory);

/* True if all triangles name vertices that exist. */
bool sp_elements_are_sound(const struct sp_elements *elements);

/* Computes the grid of a volume with these elements: one sample, whose cell is the box around the
 * positions with coordinates below 1e15. Each side is at least a thousandth of the longest side. */
void sp_elements_grid(const struct sp_elements *elements, struct sp_grid *grid);

/* True if the element counts for the default camera: it is not too far away to be seen, and not
 * nearly transparent. */
bool sp_elements_counts(const struct sp_elements *elements, uint32_t element);

/* Computes the box along the world axes that holds the elements, without the few elements that lie
 * far away, as in trained scenes. False if there are no elements, or memory runs out. */
bool sp_elements_core(const struct sp_elements *elements, double low[3], double high[3]);

/* Returns the fraction of elements that may lie outside of the core on each side. */
double sp_elements_tail(enum sp_kind kind);

/* Returns the typical size of an element, world units, > 0. Points: geometric mean of the cube
 * edges of drawn points. Gaussians: geometric mean of the scales of drawn Gaussians. Mesh: a
 * thousandth of its diameter. */
double sp_elements_spacing(const struct sp_elements *elements, const struct sp_grid *grid);

#endif
