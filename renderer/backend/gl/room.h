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
 */
#ifndef GL_ROOM_H
#define GL_ROOM_H

#include <stdbool.h>
#include <stdint.h>

#include "backend/gl/bins.h"
#include "sp/status.h"

enum {
    GL_PAIRS_MIN = 1 << 20, /* that there is room for in the beginning */
    GL_PIXEL_BYTES = 48     /* of the image, while it is composited */
};

/* What bounds memory, and how long a dispatch takes. */
struct gl_limits {
    uint32_t records; /* of a batch */
    uint32_t bins;    /* of a batch: tiles times layers, but one layer at least */
    uint32_t tiles;   /* of a band, but one row at least */
    uint64_t pairs;   /* of a batch */
    uint32_t loops;   /* rounds of all loops of one invocation */
};

struct gl_room {
    struct gl_limits limits;
    uint64_t pairs;           /* of a batch */
    uint32_t records, layers; /* of a batch, at most */
    uint32_t rows;            /* of tiles of a band, at most */
    uint32_t turns;           /* of the compositor, a batch */
};

/* How a band was drawn: what it turns out to need is held against this. */
struct gl_pieces {
    uint32_t layers, records; /* of a batch, at most */
    uint32_t rows;            /* of tiles */
    uint64_t pairs;           /* room for those of a batch, … */
    uint32_t turn_pairs;      /* … those of a tile in one turn, … */
    uint32_t turns;
    uint32_t bin_pairs; /* … and those of a bin that is put in order */
};

/* What frames begin with, but for the limits, which are set. */
void gl_room_init(struct gl_room *room);

/* Whether all of the band was drawn. */
bool gl_room_is_enough(const struct gl_pieces *was, const struct gl_bins_head *head);

/* After it was not: SP_ERR_BUDGET where nothing can be made smaller. After it was: larger pieces
 * again, where most of the room was left. */
bool gl_room_make(struct gl_room *room, const struct gl_pieces *was,
                  const struct gl_bins_head *head, struct sp_error *err);
void gl_room_grow(struct gl_room *room, const struct gl_pieces *was,
                  const struct gl_bins_head *head);

#endif
