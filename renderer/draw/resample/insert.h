/* SPDX-License-Identifier: Apache-2.0
 *
 * Inserts fragments of other layers (frame/fragments.h) into a block of rays: composites fragments
 * and intervals of the volume in order of s. Call these functions only for blocks that have
 * fragments, except sp_resample_open_fragments().
 */
#ifndef SP_RESAMPLE_INSERT_H
#define SP_RESAMPLE_INSERT_H

#include "draw/resample/kernels.h"

/* Finds the first fragment of each pixel of a block of which nothing is drawn yet. Sets
 * has_fragments. */
void sp_resample_open_fragments(const struct sp_resample_open_tile *t,
                                struct sp_resample_block *block);

/* Prefetches the data that compositing the fragments before s reads: the lists of a tile do not fit
 * the first-level cache. */
void sp_resample_prefetch_fragments(const struct sp_resample_block *block, float s);

/* Returns s of a depth on the ray of pixel i of the block. */
float sp_resample_fragment_s(const struct sp_resample_open_tile *t,
                             const struct sp_resample_block *block, int i, float depth);

/* Composites all fragments that lie before s. */
void sp_resample_insert_before(const struct sp_resample_open_tile *t,
                               struct sp_resample_block *block, float s);

/* An interval of SP_WIDE rays of a block. */
struct sp_resample_part {
    int pixel;        /* the first one */
    float begin, end; /* s */
    sp_wide opacity;  /* opacity between begin and end, inside the half-spaces */
    sp_wide color[3];
};

/* Composites an interval and the fragments in it. */
void sp_resample_insert(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                        const struct sp_resample_part *part);

#endif
