/* SPDX-License-Identifier: Apache-2.0
 *
 * Slices: images of a plane through a volume, with values interpolated linearly between the eight
 * samples around each pixel's centre. struct sp_slice defines where the pixels lie;
 * sp_slice_sample() computes their values.
 *
 *   world(column, row) = origin + column · step[0] + row · step[1]       pixel centres
 *
 * The volume reaches half a gap beyond its outermost samples. In this margin the value equals the
 * outermost sample. Outside the volume, and where one of the eight samples is not finite, the value
 * is NaN.
 */
#ifndef SP_SLICE_H
#define SP_SLICE_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/frame.h"
#include "sp/status.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SP_SLICE_SIDE_MAX = 2048 }; /* px */

struct sp_slice {
    uint32_t size[2];  /* columns, rows; [1, SP_SLICE_SIDE_MAX] px */
    double origin[3];  /* world position of the centre of the first pixel */
    double step[2][3]; /* world vectors to the next column and to the next row; not zero */
    /* Type of the values. If every pixel lies on a sample, it is the type of the volume. Otherwise
     * it is SP_FLOAT64 for volumes of SP_INT32 and SP_FLOAT64, and SP_FLOAT32 for other volumes. */
    enum sp_type type;
    /* Origin and steps as distances along the axes of the grid from its first sample, world
     * units. */
    double grid_origin[3], grid_step[2][3];
};

/* Computes the slice through sample `index` of an axis. The slice is parallel to the other two axes
 * of the grid: columns follow the lower axis, and row 0 has index 0. There is one pixel per sample.
 * Along a rectilinear axis, a pixel is as wide as the smallest gap. An axis that would need more
 * than SP_SLICE_SIDE_MAX pixels gets SP_SLICE_SIDE_MAX pixels from its first to its last sample.
 * SP_ERR_INVALID: the axis or the index is out of range. Thread-safe. */
SP_API bool sp_slice_init_orthogonal(struct sp_slice *slice, const struct sp_volume_info *info,
                                     uint32_t axis, uint32_t index, struct sp_error *err);

/* All vectors in world space, finite. */
struct sp_slice_plane {
    double origin[3]; /* the centre of the image */
    double normal[3]; /* points to the viewer; any length but 0 */
    double up[3]; /* points up in the image, projected onto the plane; not parallel to the normal;
                     {0, 0, 0} = the world axis z, or y if the normal is close to z */
    uint32_t size[2]; /* px, [1, SP_SLICE_SIDE_MAX] */
    double spacing;   /* world units per px, > 0; 0 = the smallest spacing of the volume */
};
/* Computes a slice on any plane. SP_ERR_INVALID: err->place is the name of the invalid field.
 * Thread-safe. */
SP_API bool sp_slice_init_oblique(struct sp_slice *slice, const struct sp_volume_info *info,
                                  const struct sp_slice_plane *plane, struct sp_error *err);

/* Adapts a slice to another volume whose axes have the same directions, such as a part of the
 * volume for which the slice was made. Thread-safe. */
SP_API void sp_slice_move(struct sp_slice *slice, const struct sp_volume_info *to);

/* Writes size[0] · size[1] values of slice->type, row by row. The slice must have been made for
 * this volume. Takes some nanoseconds per pixel. Thread-safe. */
SP_API void sp_slice_sample(const struct sp_volume *volume, const struct sp_slice *slice,
                            void *values);

struct sp_transfer_function; /* sp/view.h */

/* Draws the slice into a frame of the slice's size and of format SP_RGBA8. `colors` NULL = grey:
 * black at or below window[0] − window[1] / 2, white at or above window[0] + window[1] / 2;
 * window[1] > 0. Otherwise the frame has the colours of the points of `colors`, linear between
 * points; their opacity and the window are ignored. NaN is transparent. Sets frame->is_opaque.
 * Thread-safe. */
SP_API void sp_slice_draw(const struct sp_volume *volume, const struct sp_slice *slice,
                          const double window[2], const struct sp_transfer_function *colors,
                          struct sp_frame *frame);

/* Computes centre and width of the default window of a volume. The window leaves out half a percent
 * of the samples at each end of the histogram. The width is above 0. Thread-safe. */
SP_API void sp_slice_default_window(const struct sp_volume_info *info, double window[2]);

#ifdef __cplusplus
}
#endif

#endif
