/* SPDX-License-Identifier: Apache-2.0
 *
 * The values that a transfer function makes visible, and their colours, in the form that
 * shaders/samples.glsl and post.glsl read.
 */
#ifndef GL_VISIBLE_RANGES_H
#define GL_VISIBLE_RANGES_H

#include "backend/gl/buffer.h"
#include "classify/transfer.h"

/* Intervals of ordinals [low, high] that contain exactly the samples with a visible value. An
 * interval between two samples has low > high. */
struct gl_visible_ranges {
    uint32_t count;
    int32_t ends[SP_TF_POINTS_MAX][2];
};

/* Fills the ranges. Order post: uses the values of pixels, which also lie between samples. */
void gl_visible_ranges_init(struct gl_visible_ranges *ranges, const struct sp_transfer *transfer);

/* True if samples of the volume have ordinals and single precision distinguishes them relative to
 * the base. False for 64-bit reals, and for reals that span the whole range of floats. */
bool gl_visible_ranges_is_possible(const struct sp_volume_info *info);

/* Writes the points of the transfer function, with values relative to its base; adds to *uploaded.
 * A context must be current. SP_ERR_MEMORY. */
bool gl_visible_ranges_write_points(struct gl_buffer *buffer, const struct sp_transfer *transfer,
                                    uint64_t *uploaded, struct sp_error *err);

#endif
