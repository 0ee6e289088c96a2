/* SPDX-License-Identifier: Apache-2.0
 *
 * The ranges of bricks that no file gives, learned when bricks are read: the range of a whole
 * brick, and the ranges near its six faces, within the reach of interpolation from a neighbour. The
 * range of an entry is known once the brick and its 26 neighbours are known. Not thread-safe.
 */
#ifndef SP_BRICKS_LEARNED_H
#define SP_BRICKS_LEARNED_H

#include "data/bricks/format.h"
#include "data/bricks/samples.h"

struct sp_brick_learned;

/* NULL if memory ran out. */
struct sp_brick_learned *sp_brick_learned_create(const struct sp_brick_level *level);
/* Accepts NULL; nulls *learned. */
void sp_brick_learned_destroy(struct sp_brick_learned **learned);

/* Bytes of memory for a level. */
uint64_t sp_brick_learned_bytes(const struct sp_brick_level *level);

/* The ranges of a brick's samples: all of them, then those within BRICK_MARGIN of each face: low
 * and high end of axis 0, 1 and 2. */
struct sp_brick_ranges {
    double low[7], high[7]; /* low > high = no sample is finite */
};

/* Computes the ranges of the samples in the box of the view, which is one brick. */
void sp_brick_ranges_measure(const struct sp_brick_view *view, struct sp_brick_ranges *ranges);

/* Stores the ranges of brick `number`, and writes the range of each entry that is known now. */
void sp_brick_learned_add(struct sp_brick_learned *learned, const struct sp_brick_level *level,
                          uint64_t number, const struct sp_brick_ranges *ranges,
                          struct sp_brick_entry *entries);

#endif
