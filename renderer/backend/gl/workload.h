/* SPDX-License-Identifier: Apache-2.0
 *
 * How large the pieces of a frame may be. What a band turns out to need comes back with its
 * picture: where it had no room nothing of it was drawn, and the band is drawn again with more of
 * it, or in smaller pieces; the frames that follow begin with that.
 *
 *   too much                          is met by
 *   pairs of a batch                  more room; beyond the limit fewer layers, records or rows
 *   pairs of a tile in a batch        more turns: dispatches of the compositor, each of which goes
 *                                     on where the last one stopped
 *   pairs of a bin, put in order      fewer records
 *   bins of a splat                   fewer rows, then layers
 *
 * How long a dispatch takes cannot be known before one was measured: pieces of all kinds halve when
 * one took too long, and for want of memory; they grow again, slowly, while all are short.
 */
#ifndef GL_WORKLOAD_H
#define GL_WORKLOAD_H

#include <stdbool.h>
#include <stdint.h>

#include "backend/gl/bins.h"
#include "sp/status.h"

enum {
    GL_PAIRS_MIN = 1 << 20, /* that there is room for in the beginning */
    GL_SPAN_BYTES = 8,      /* a record */
    GL_PIXEL_BYTES = 48,    /* of the image, while it is composited */
    GL_CALM = 256           /* bands without a dispatch that is long, before pieces grow again */
};

/* What bounds memory, and how long a dispatch takes. */
struct gl_limits {
    uint32_t records; /* of a batch */
    uint32_t bins;    /* of a batch: tiles times layers, but one layer at least */
    uint32_t tiles;   /* of a band, but one row at least */
    uint64_t pairs;   /* of a batch */
    uint32_t loops;   /* rounds of all loops of one invocation */
    uint32_t dear;    /* rounds that one counts for when it waits for memory; 1 where only their
                         number matters */
    uint64_t record_bytes; /* of a batch: what its records may take with their spans */
    double dispatch_ms;    /* beyond which a dispatch is long; INFINITY: none is */
};

struct gl_workload {
    struct gl_limits limits;
    uint64_t pairs;           /* of a batch */
    uint32_t records, layers; /* of a batch, at most */
    uint32_t rows;            /* of tiles of a band, at most */
    uint32_t turns;           /* of the compositor, a batch */
    unsigned halvings;        /* of records, bins, tiles, pairs and loops */
    unsigned calm;            /* bands since one was last halved, or was no reason to grow */
};

/* What pieces of a frame cost. */
struct gl_costs {
    uint32_t columns;                 /* of tiles */
    uint32_t pair_rounds, pair_loads; /* of the compositor; loads wait for memory */
    uint32_t record_bytes;            /* without its span */
    uint64_t block_bytes;             /* the most that records take; 0 = not known */
};

/* How a band was drawn: what it turns out to need is held against this. */
struct gl_pieces {
    uint32_t layers, records; /* of a batch, at most */
    uint32_t rows;            /* of tiles */
    uint64_t pairs;           /* room for those of a batch, … */
    uint32_t turn_pairs;      /* … those of a tile in one turn, … */
    uint32_t turns;
    uint32_t bin_pairs;    /* … and those of a bin that is put in order */
    uint32_t splat_rounds; /* of one splat, over its tiles and layers */
    unsigned halvings;     /* at that time */
};

/* The limits as they are halved now; none is less than what a piece has at least. */
struct gl_limits gl_workload_limits(const struct gl_workload *workload);

/* How a band is to be drawn, but for its layers and rows. */
struct gl_pieces gl_workload_plan(const struct gl_workload *workload, const struct gl_costs *costs);

/* Halves pieces; false where they are as small as that makes them. */
bool gl_workload_halve(struct gl_workload *workload);

/* The longest dispatch of a band that was drawn so took longest_ms: halves pieces where that is
 * long, and unmakes one halving after GL_CALM bands in turn that were far from it. */
void gl_workload_adapt(struct gl_workload *workload, const struct gl_pieces *was,
                       double longest_ms);

/* What frames begin with, but for the limits, which are set. */
void gl_workload_init(struct gl_workload *workload);

/* Whether all of the band was drawn. */
bool gl_workload_fits(const struct gl_pieces *was, const struct gl_bins_head *head);

/* After it was not: SP_ERR_BUDGET where nothing can be made smaller. After it was: larger pieces
 * again, where most of the room was left. */
bool gl_workload_retry(struct gl_workload *workload, const struct gl_pieces *was,
                       const struct gl_bins_head *head, struct sp_error *err);
void gl_workload_grow(struct gl_workload *workload, const struct gl_pieces *was,
                      const struct gl_bins_head *head);

#endif
