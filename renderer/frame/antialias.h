/* SPDX-License-Identifier: Apache-2.0
 *
 * The low-pass filter of pixels. A ray through the centre of a pixel shows one point of the pixel's
 * area. The mean over the area is estimated from the pixel and its neighbours:
 *
 *   a·b  a·c  a·b        b = a, c = 1 − 2a, per axis
 *   c·a  c·c  c·a        a = strength · ANTIALIAS_WEIGHT
 *   a·b  a·c  a·b
 *
 * (Ours.) A smaller weight, 0.07, gives images of scans that are nearest to means of 16 rays per
 * pixel; this one is up to 1.4 dB farther, but a turning head changes by at most 1.3 times as much
 * per frame as its means (tests/bench/results/notes/exact.md).
 */
#ifndef SP_FRAME_ANTIALIAS_H
#define SP_FRAME_ANTIALIAS_H

#include "base/arena.h"
#include "base/parallel_for.h"
#include "sp/frame.h"

#define ANTIALIAS_WEIGHT 0.11f

/* Filters the pixels in place, weighted by their alpha; pixels beside the image are like those at
 * its border. strength: [0, 1]. Allocates rows from the arena. False with *err set on failure, and
 * changes nothing: SP_ERR_MEMORY, SP_ERR_FRAME_BUDGET. */
bool sp_antialias(struct sp_frame *frame, float strength, struct sp_arena *arena,
                  struct sp_pool *pool, struct sp_error *err);

#endif
