/* SPDX-License-Identifier: Apache-2.0
 *
 * Sorts splats by tile and layer: a counting sort. The pass `project` makes the counts.
 *
 *   bin = tile · layers + layer
 *   count[bin] ─ scan_bins, scan_totals ─► where each bin begins ─ scatter ─► pairs[] by bin
 *
 * Inside a bin the order is arbitrary, unless sort_bins restores the order of the records. If there
 * are more pairs than the buffer can hold, no pair is written.
 */
#ifndef GL_BINS_H
#define GL_BINS_H

#include "backend/gl/buffer.h"

enum { GL_BINS_HEAD = 16 }; /* words of the head */

/* Counters that the shaders write at the beginning of gl_bins.counts. */
struct gl_bins_head {
    uint32_t splats;           /* splats drawn */
    uint32_t fragments, carry; /* px inside the cutoffs of splats: low and high word */
    uint32_t needed;           /* most pairs of a batch; UINT32_MAX = that many or more */
    uint32_t total;            /* pairs of the last batch */
    uint32_t longest;          /* most pairs of a tile in a batch */
    uint32_t planned;          /* scratch value between the passes */
    uint32_t crowded;          /* pairs of the longest bin that was too long to sort */
    uint32_t widest; /* most loop rounds of a splat that was left out because it needs too many */
    uint32_t stored; /* fragments of other layers, including fragments that did not fit */
    uint32_t longest_elements; /* as `longest`, of other layers */
};

struct gl_bins {
    unsigned scan, totals_program, scatter, order; /* programs */
    struct gl_buffer counts;                       /* head, then one word per bin */
    struct gl_buffer totals;                       /* per GL_SCAN_BLOCK bins */
    struct gl_buffer pairs;                        /* numbers of records */
};

/* The tiles and layers of a batch: the uniform `tiles` of shaders/bins.glsl. */
struct gl_bins_space {
    uint32_t columns; /* of tiles */
    uint32_t y, end;  /* first row of the image, and last + 1 [px] */
    uint32_t rows;    /* of tiles */
    uint32_t layers;
};

/* Returns a / b, rounded up. */
static inline uint32_t gl_divide_up(uint32_t a, uint32_t b) {
    return a / b + (a % b > 0);
}

static inline uint32_t gl_bins_count(const struct gl_bins_space *space) {
    return space->columns * space->rows * space->layers;
}

/* Compiles the programs. SP_ERR_BACKEND. Call gl_bins_finish() also after a failure. A context must
 * be current, here and below. */
bool gl_bins_init(struct gl_bins *bins, struct sp_error *err);
void gl_bins_finish(struct gl_bins *bins);

/* Reserves memory for `count` bins and `pairs`; `most` and errors as in gl_buffer_reserve(). */
bool gl_bins_reserve(struct gl_bins *bins, uint64_t count, uint64_t pairs, uint64_t most,
                     struct sp_error *err);

/* Set the head to zero; set the counts to zero. */
void gl_bins_clear_head(const struct gl_bins *bins);
void gl_bins_clear(const struct gl_bins *bins, const struct gl_bins_space *space);

/* Sets the uniform of the program in use. */
void gl_bins_set_space(const struct gl_bins_space *space);

/* Sorts the counted spans of `records` records into at most `pairs` pairs. Afterwards a bin ends at
 * pair counts[bin] + totals[bin / GL_SCAN_BLOCK]. */
void gl_bins_sort(const struct gl_bins *bins, const struct gl_bins_space *space,
                  const struct gl_buffer *spans, uint32_t records, uint32_t pairs);

/* Sorts the records of each bin in rising order, except in bins with more than `longest` pairs.
 * Call it after gl_bins_sort(). */
void gl_bins_order(const struct gl_bins *bins, const struct gl_bins_space *space, uint32_t pairs,
                   uint32_t longest);

#endif
