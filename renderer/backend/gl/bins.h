/* SPDX-License-Identifier: Apache-2.0
 *
 * Sorting splats by tile and layer: a counting sort whose counts are made when splats are set up.
 *
 *   bin = tile · layers + layer
 *   count[bin] ─ 20_scan, 21_totals ─► where each bin begins ─ 22_scatter ─► pairs[] by bin
 *
 * Inside a bin the order is free, unless 23_order makes it that of the records. Where pairs are
 * more than there is room for, none is written.
 */
#ifndef GL_BINS_H
#define GL_BINS_H

#include "backend/gl/buffer.h"

enum { GL_BINS_HEAD = 16 }; /* words of the head */

/* What the shaders note beside the counts, at the beginning of gl_bins.counts. */
struct gl_bins_head {
    uint32_t splats;           /* drawn */
    uint32_t fragments, carry; /* px inside their cutoffs: low and high word */
    uint32_t needed;           /* pairs of the batch that had most; UINT32_MAX: that many or more */
    uint32_t total;            /* pairs of the last batch */
    uint32_t longest;          /* pairs of the tile that had most in a batch */
    uint32_t planned;          /* used in between */
    uint32_t crowded;          /* pairs of the longest bin that was not put in order */
    uint32_t widest;           /* rounds of the splat that had most, of those left out for it */
};

struct gl_bins {
    unsigned scan, totals_program, scatter, order; /* programs */
    struct gl_buffer counts;                       /* head, then a word a bin */
    struct gl_buffer totals;                       /* by GL_SCAN_BLOCK bins */
    struct gl_buffer pairs;                        /* numbers of records */
};

/* Tiles and layers that are sorted into: the uniform `tiles` of shaders/bins.glsl. */
struct gl_bins_space {
    uint32_t columns; /* of tiles */
    uint32_t y, end;  /* first and last + 1 row of the picture [px] */
    uint32_t rows;    /* of tiles */
    uint32_t layers;
};

/* Groups of b that a needs. */
static inline uint32_t gl_divide_up(uint32_t a, uint32_t b) {
    return a / b + (a % b > 0);
}

static inline uint32_t gl_bins_count(const struct gl_bins_space *space) {
    return space->columns * space->rows * space->layers;
}

/* SP_ERR_BACKEND. gl_bins_finish() also after a failure. A context must be current. */
bool gl_bins_init(struct gl_bins *bins, struct sp_error *err);
void gl_bins_finish(struct gl_bins *bins);

/* Memory for so many bins and pairs; `most` as in gl_buffer_reserve(). */
bool gl_bins_reserve(struct gl_bins *bins, uint64_t count, uint64_t pairs, uint64_t most,
                     struct sp_error *err);

/* All zero: the head, and the counts. */
void gl_bins_clear_head(const struct gl_bins *bins);
void gl_bins_clear(const struct gl_bins *bins, const struct gl_bins_space *space);

/* Sets the uniform of the program in use. */
void gl_bins_set_space(const struct gl_bins_space *space);

/* Sorts the spans of `records` records, which were counted; room for `pairs` of them. Then
 * counts[bin] + totals[bin / GL_SCAN_BLOCK] is where the bin ends. */
void gl_bins_sort(const struct gl_bins *bins, const struct gl_bins_space *space,
                  const struct gl_buffer *spans, uint32_t records, uint32_t pairs);

/* Then puts the records of each bin in rising order, but for bins of more than `longest`. */
void gl_bins_order(const struct gl_bins *bins, const struct gl_bins_space *space, uint32_t pairs,
                   uint32_t longest);

#endif
