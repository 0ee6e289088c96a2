/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses which slices of the grid are the sheets, and in which order a frame composites them.
 *
 * Sheets lie perpendicular to the view as far as the grid allows: along the major axis, whose
 * slices' normal is closest to the view direction. A ray from the eye crosses them in the order of
 * their distance from the eye, on either side of it:
 *
 *        6   4   2   0 | 1   3   5        slices, numbered front to back
 *                    eye inside the volume
 *
 * A ray meets the sheets of one side only. The way in which the two sides are interleaved therefore
 * matters only to footprints that reach across the eye's plane. Nearest first is the best order for
 * these footprints.
 */
#ifndef SP_SPLAT_SLICES_H
#define SP_SPLAT_SLICES_H

#include <stdint.h>

#include "sp/volume.h"
#include "splat/camera.h"

/* Returns the major axis, 0 … 2; the highest one if several are equal. */
unsigned sp_slices_major_axis(const struct sp_camera_transform *camera, const struct sp_grid *grid);

/* Fills slices[dims[axis]]: element k is the index of the k-th slice, front to back. */
void sp_slices_sort(const struct sp_camera_transform *camera, const struct sp_grid *grid,
                    unsigned axis, uint32_t *slices);

/* Returns the layer, counted front to back, of slice `slice` of a mip level. A slice of a coarser
 * level has the layer of the slice of the finest level that contains its centre; if the centre lies
 * between two slices, of the slice with the larger index. layers[count]: layer by slice of the
 * finest level. */
static inline uint32_t sp_slices_layer(const uint32_t *layers, uint32_t count, unsigned level,
                                       uint32_t slice) {
    uint64_t centre = ((uint64_t)slice << level) + (level ? UINT64_C(1) << (level - 1) : 0);
    return layers[centre < count ? centre : count - 1];
}

#endif
