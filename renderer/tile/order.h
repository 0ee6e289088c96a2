/* SPDX-License-Identifier: Apache-2.0
 *
 * Which slices of the grid are the sheets, and in which order they are composited.
 *
 * Sheets lie perpendicular to the view as far as the grid allows: along the axis whose slices'
 * normal is closest to the view direction. A ray from the eye crosses them in the order of their
 * distance from the eye, on either side of it:
 *
 *        6   4   2   0 | 1   3   5        slices, numbered front to back
 *                    eye inside the volume
 *
 * A ray meets the sheets of one side only, so that how the sides are interleaved matters to
 * footprints alone that reach across; nearest first is the order closest to theirs.
 */
#ifndef SP_TILE_ORDER_H
#define SP_TILE_ORDER_H

#include <stdint.h>

#include "splat/camera.h"

/* The major axis, 0 … 2; of equal ones the highest. */
unsigned sp_order_axis(const struct sp_camera_frame *camera, const struct sp_grid *grid);

/* Fills slices[dims[axis]]: element k is the index of the sheet that comes k-th, front to back. */
void sp_order_slices(const struct sp_camera_frame *camera, const struct sp_grid *grid,
                     unsigned axis, uint32_t *slices);

#endif
