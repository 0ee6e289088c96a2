/* SPDX-License-Identifier: Apache-2.0
 *
 * A renderer with one volume and one view, shared by the tests of the CPU and the null backend.
 * Every function fails the test if it cannot do its work.
 */
#ifndef UNIT_BACKEND_RIG_H
#define UNIT_BACKEND_RIG_H

#include <stdbool.h>
#include <stdint.h>

#include "frame/pool.h"
#include "sp/renderer.h"

struct rig {
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
    struct sp_volume *volume;
    struct sp_view view;
};

/* Returns a cube of n³ voxels that holds a ball: its values rise from 0 at the border to 1000 in
 * the middle, so that it has sheets of every size, edges and gradients. */
struct sp_volume *rig_make_ball(uint32_t n, const double spacing[3]);

/* Returns a volume of one voxel, of value 1. */
struct sp_volume *rig_make_voxel(void);

/* Creates a rig with the default view of the volume at 100 × 75 pixels. It takes the reference to
 * the volume. rig_finish() ends it. */
struct rig rig_make(const char *backend, unsigned threads, struct sp_volume *volume);
void rig_finish(struct rig *rig);

/* Renders the rig's view. The caller unrefs the frame. */
struct sp_frame *rig_draw(struct rig *rig, enum sp_pixel_format format);

/* True if two frames of the same size and format have the same bytes. */
bool rig_is_same(const struct sp_frame *a, const struct sp_frame *b);

/* Returns the four channels of a pixel of a frame in SP_RGBAF32. */
const float *rig_pixel(const struct sp_frame *f, uint32_t x, uint32_t y);

/* Fails unless every pixel is finite and every alpha is in [0, 1]. Returns the sum of red. */
double rig_check_finite(const struct sp_frame *f);

#endif
