/* SPDX-License-Identifier: Apache-2.0
 *
 * What a transfer function shows of a volume's samples, and in which colours, as
 * shaders/samples.glsl and post.glsl read it: a few bytes a point.
 */
#ifndef GL_VISIBLE_RANGES_H
#define GL_VISIBLE_RANGES_H

#include "backend/gl/buffer.h"
#include "classify/transfer.h"

/* Intervals of ordinals, low and high in turn, that hold just those samples whose value is shown.
 * An interval that lies between two samples has low > high. */
struct gl_visible_ranges {
    uint32_t count;
    int32_t ends[SP_TF_POINTS_MAX][2];
};

/* order post: values are those of pixels, which lie between samples as well. */
void gl_visible_ranges_init(struct gl_visible_ranges *ranges, const struct sp_transfer *transfer);

/* Whether samples of the volume have ordinals, and single precision tells them apart from the base
 * on: all but 64-bit reals, and reals that span all there are. */
bool gl_visible_ranges_is_possible(const struct sp_volume_info *info);

/* Writes the points of the transfer function, values counted from its base; adds to *uploaded.
 * A context must be current. SP_ERR_MEMORY. */
bool gl_visible_ranges_write_points(struct gl_buffer *buffer, const struct sp_transfer *transfer,
                                    uint64_t *uploaded, struct sp_error *err);

#endif
