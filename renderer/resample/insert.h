/* SPDX-License-Identifier: Apache-2.0
 *
 * Fragments of other layers (frame/fragments.h) in a block of rays: they are composited in order of
 * s with the intervals of the volume. Call these functions only for blocks that have fragments,
 * except sp_resample_open_fragments().
 */
#ifndef SP_RESAMPLE_INSERT_H
#define SP_RESAMPLE_INSERT_H

#include "base/isa.h"
#include "resample/kernels.h"

/* Finds the first fragment of each pixel; sets has_fragments. The block is empty. */
void sp_resample_open_fragments(const struct sp_resample_open_tile *t,
                                struct sp_resample_block *block);

/* Composites all fragments that lie before s. */
void sp_resample_insert_before(const struct sp_resample_open_tile *t,
                               struct sp_resample_block *block, float s);

/* Composites the interval [begin, end) of pixel i, and the fragments in it. */
void sp_resample_insert(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                        int i, float begin, float end, float opacity, const float color[3]);

#endif
