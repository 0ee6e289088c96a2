/* SPDX-License-Identifier: Apache-2.0
 *
 * Fragments of other layers (frame/fragments.h) in a block of rays: they are composited in order of
 * s with the intervals of the volume. Call these functions only for blocks that have fragments,
 * except sp_resample_open_fragments().
 */
#ifndef SP_RESAMPLE_INSERT_H
#define SP_RESAMPLE_INSERT_H

#include "draw/resample/kernels.h"

/* Finds the first fragment of each pixel; sets has_fragments. The block is empty. */
void sp_resample_open_fragments(const struct sp_resample_open_tile *t,
                                struct sp_resample_block *block);

/* Prefetches what is read when the fragments before s are composited: the lists of a tile do not
 * fit the nearest cache. */
void sp_resample_prefetch_fragments(const struct sp_resample_block *block, float s);

/* Composites all fragments that lie before s. */
void sp_resample_insert_before(const struct sp_resample_open_tile *t,
                               struct sp_resample_block *block, float s);

/* An interval of SP_WIDE rays of a block. */
struct sp_resample_part {
    int pixel;        /* the first one */
    float begin, end; /* s */
    sp_wide opacity;  /* between those, inside the halves */
    sp_wide color[3];
};

/* Composites an interval and the fragments in it. */
void sp_resample_insert(const struct sp_resample_open_tile *t, struct sp_resample_block *block,
                        const struct sp_resample_part *part);

#endif
