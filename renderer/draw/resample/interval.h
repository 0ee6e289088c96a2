/* SPDX-License-Identifier: Apache-2.0
 *
 * An interval between two sheets: the state of its rays from classification to compositing
 * (integrate.c).
 */
#ifndef SP_RESAMPLE_INTERVAL_H
#define SP_RESAMPLE_INTERVAL_H

#include "draw/resample/seen.h"
#include "draw/resample/sheet_sample.h"

enum { INTERVAL_PARTS = RESAMPLE_PIXELS / SP_WIDE };

/* SP_WIDE rays of a block in one interval. */
struct sp_interval {
    int begin;        /* first pixel */
    sp_wide sheet[4]; /* values on the sheet before it, at its start, at its end and behind it */
    sp_wide value[3]; /* at its start, in its middle and at its end [codes] */
    sp_wide length;   /* of the ray inside, reference lengths */
    sp_wide front;    /* where it begins inside: 0 on the sheet at its start, 1 at its end */
    sp_wide share;    /* of the distance between both that lies inside */
    sp_wide mean[4];  /* of the curve over it */
    sp_wide
        first[4]; /* the first half's part of the mean; only if gradients are needed, like `half` */
    struct sp_seen_half half[2];
    sp_wide seen;        /* where it is seen: as `front` */
    sp_wide gradient[3]; /* there [gradient_unit] */
    sp_wide square;      /* of its length */
    sp_wide depth;       /* optical depth */
    sp_wide opacity;
    sp_wide color[3];
};

/* The interval behind sheet `number` of all rays of a block that may see something in it. Each step
 * is done for all rays before the next one, so that their latencies overlap. */
struct sp_interval_work {
    const struct sp_resample_open_tile *t;
    struct sp_resample_block *block;
    const float *light; /* transmittance of the pixels so far, through all channels */
    int number;
    bool is_cut; /* it does not reach from sheet to sheet */
    float start; /* s of the first sheet */
    float width; /* s from sheet to sheet */
    float decay; /* of a surface's normal, over it */
    int count;
    struct sp_interval parts[INTERVAL_PARTS];
};

static inline struct sp_rays sp_load_rays(const struct sp_resample_block *block, int begin) {
    return (struct sp_rays){ sp_wide_load(block->u + begin), sp_wide_load(block->v + begin),
                             sp_wide_load(block->du + begin), sp_wide_load(block->dv + begin) };
}

#endif
