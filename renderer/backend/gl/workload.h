/* SPDX-License-Identifier: Apache-2.0
 *
 * Chooses how much work a batch, a band and a dispatch hold. The counters of a band come back with
 * its image. If something did not fit, the band was not drawn; it is drawn again with more memory
 * or in smaller pieces, and the next frames begin with these sizes.
 *
 *   too many                         remedy
 *   pairs in a batch                 a larger buffer; beyond the limit fewer layers or records
 *   pairs of a tile in a batch       more passes: dispatches of the compositor, each of which
 *                                    continues where the previous one stopped
 *   pairs of a bin that is sorted    fewer records
 *   bins of a splat                  fewer rows, then fewer layers
 *
 * The duration of a dispatch is known only after it has run. All sizes halve after a dispatch that
 * took too long, or if memory is short. They grow again, slowly, while all dispatches are short.
 */
#ifndef GL_WORKLOAD_H
#define GL_WORKLOAD_H

#include <stdbool.h>
#include <stdint.h>

#include "backend/gl/bins.h"
#include "sp/status.h"

enum {
    GL_PAIRS_MIN = 1 << 20, /* capacity at the start */
    GL_SPAN_BYTES = 8,      /* per record */
    GL_PIXEL_BYTES = 48,    /* per pixel while the image is composited */
    GL_SHORT_BANDS = 256    /* bands in a row without a long dispatch, before sizes grow */
};

/* The limits on memory and on the duration of a dispatch. */
struct gl_limits {
    uint32_t records; /* of a batch */
    uint32_t bins;    /* per batch: tiles times layers; at least one layer */
    uint32_t tiles;   /* per band; at least one row */
    uint64_t pairs;   /* of a batch */
    uint32_t loops;   /* loop rounds of one invocation */
    /* A round that waits for memory counts as this many rounds; 1 = all rounds count the same. */
    uint32_t stall_factor;
    uint64_t record_bytes; /* per batch: memory for records and their spans */
    double dispatch_ms;    /* a longer dispatch is too long; INFINITY = none is */
};

struct gl_workload {
    struct gl_limits limits;
    uint64_t pairs;           /* of a batch */
    uint32_t records, layers; /* of a batch, at most */
    uint32_t rows;            /* of tiles of a band, at most */
    uint32_t passes;          /* of the compositor, a batch */
    uint32_t element_passes;  /* the same of other layers */
    unsigned halvings;        /* of the limits of records, bins, tiles, pairs and loops */
    unsigned short_bands;     /* short bands in a row */
};

/* The costs of a frame. */
struct gl_costs {
    uint32_t columns;                 /* of tiles */
    uint32_t pair_rounds, pair_loads; /* of the compositor per pair; loads wait for memory */
    uint32_t element_rounds;          /* of other layers per pair; 0 = there are none */
    uint32_t record_bytes;            /* without its span */
    uint64_t block_bytes;             /* largest buffer of records; 0 = not known */
};

/* How a band was drawn, for comparison with its counters. */
struct gl_pieces {
    uint32_t layers, records; /* of a batch, at most */
    uint32_t rows;            /* of tiles */
    uint64_t pairs;           /* capacity per batch */
    uint32_t pass_pairs;      /* capacity per tile and pass */
    uint32_t passes;
    uint32_t element_pairs, element_passes; /* the same of other layers */
    uint32_t bin_pairs;                     /* capacity of a bin that is sorted */
    uint32_t splat_rounds;                  /* of one splat, over its tiles and layers */
    unsigned halvings;                      /* at that time */
};

/* Returns the limits after the present halvings; each allows at least the smallest piece. */
struct gl_limits gl_workload_limits(const struct gl_workload *workload);

/* Plans a band, except its layers and rows. */
struct gl_pieces gl_workload_plan(const struct gl_workload *workload, const struct gl_costs *costs);

/* Halves the limits; false if they are at their minimum. */
bool gl_workload_halve(struct gl_workload *workload);

/* Adapts to the longest dispatch of a band: halves the limits if it was too long, and undoes one
 * halving after GL_SHORT_BANDS bands in a row that were far below the limit. */
void gl_workload_adapt(struct gl_workload *workload, const struct gl_pieces *was,
                       double longest_ms);

/* Sets the sizes of the first frame. The limits must be set. */
void gl_workload_init(struct gl_workload *workload);

/* True if the whole band was drawn. */
bool gl_workload_fits(const struct gl_pieces *was, const struct gl_bins_head *head);

/* gl_workload_retry(): after a band that did not fit, chooses sizes for the next attempt;
 * SP_ERR_BUDGET if nothing can be made smaller. gl_workload_grow(): after a band that did fit, uses
 * larger pieces if most of the capacity was free. */
bool gl_workload_retry(struct gl_workload *workload, const struct gl_pieces *was,
                       const struct gl_bins_head *head, struct sp_error *err);
void gl_workload_grow(struct gl_workload *workload, const struct gl_pieces *was,
                      const struct gl_bins_head *head);

#endif
