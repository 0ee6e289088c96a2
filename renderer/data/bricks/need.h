/* SPDX-License-Identifier: Apache-2.0
 *
 * The need of a frame: a box of bricks of one level, which of them may show something, and how
 * much each of them matters.
 */
#ifndef SP_BRICKS_NEED_H
#define SP_BRICKS_NEED_H

#include "data/bricks/file.h"

/* Numbers of bricks. */
enum {
    BRICK_HIDDEN, /* shows nothing */
    BRICK_COARSE, /* may show something; a coarser level will do */
    BRICK_WANTED  /* from here on: it is read; larger numbers are read first */
};

enum { BRICK_BATCH = 16 }; /* bricks or chunks that a thread reads until progress is told */

/* Which bricks of a level a frame needs. */
struct sp_brick_need {
    unsigned level;
    uint32_t first[3], count[3]; /* bricks of a box, which is not empty */
    uint16_t *wanted; /* malloc'ed [count], i0 fastest: numbers as above, by importance */
    /* The frame can be drawn from blocks (data/volume/blocks.h), so that only wanted bricks take
     * memory. It can also be drawn from an array. */
    bool is_sparse;
    bool has_vectors; /* the frame also needs vectors; the file must have them. Not with blocks. */
};

/* The arrays of a need, as bits. Lost data is described by a set of these bits per brick. */
enum { BRICK_SAMPLES = 1, BRICK_VECTORS = 2 };

static inline unsigned sp_brick_need_arrays(const struct sp_brick_need *need) {
    return need->has_vectors ? BRICK_SAMPLES | BRICK_VECTORS : BRICK_SAMPLES;
}

static inline uint64_t sp_brick_need_count(const struct sp_brick_need *need) {
    return (uint64_t)need->count[0] * need->count[1] * need->count[2];
}

/* Returns the number, in its level, of brick i of the box. */
uint64_t sp_brick_need_at(const struct sp_brick_need *need, const struct sp_brick_level *level,
                          uint64_t i);

/* Computes the first sample of the box and the size of the box in samples. */
void sp_brick_need_box(const struct sp_brick_need *need, const struct sp_brick_level *level,
                       uint32_t first[3], uint32_t size[3]);

/* Returns the number of samples of the box. */
uint64_t sp_brick_need_samples(const struct sp_brick_file *file, const struct sp_brick_need *need);

/* Returns the bytes of all samples of the box, with the vectors if the need has them. */
uint64_t sp_brick_need_bytes(const struct sp_brick_file *file, const struct sp_brick_need *need);

/* Returns the offset of the vectors in the memory of sp_brick_need_bytes(). */
uint64_t sp_brick_need_vectors_at(const struct sp_brick_file *file,
                                  const struct sp_brick_need *need);

/* Finds brick i of the box of `need` in the box of `in`, of the same level: its number there. False
 * if it lies outside. */
bool sp_brick_need_find(const struct sp_brick_need *need, uint64_t i,
                        const struct sp_brick_need *in, uint64_t *at);

/* True if each wanted brick of `need` is one of `have`, of the same level, and if a frame that
 * needs `need` can be drawn from a subvolume of `have`: it has vectors if `need` has them. */
bool sp_brick_need_is_in(const struct sp_brick_need *need, const struct sp_brick_need *have);

/* Allocates `wanted` for the box; every brick has that number. False if memory ran out. */
bool sp_brick_need_allocate(struct sp_brick_need *need, uint16_t number);

/* Returns the number of wanted bricks. */
uint64_t sp_brick_need_wanted(const struct sp_brick_need *need);

/* Returns the number of bricks that a coarser level shows. */
uint64_t sp_brick_need_coarse(const struct sp_brick_need *need);

/* Returns the indices of the numbers that are at least BRICK_WANTED, malloc'ed: the largest number
 * first, equal numbers in their order. Sets *count. NULL if memory ran out. */
uint32_t *sp_brick_order(const uint16_t *numbers, uint64_t length, size_t *count);

/* True if `have` shows all of `need` at its level or coarsely. */
bool sp_brick_need_is_covered(const struct sp_brick_need *need, const struct sp_brick_need *have);

/* Copies a need and its `wanted`. False if memory ran out. */
bool sp_brick_need_copy(const struct sp_brick_need *need, struct sp_brick_need *copy);

/* Returns a value of the brick's range, which fills a brick that is not wanted. */
double sp_brick_value(const struct sp_brick_entry *entry, enum sp_type type);

#endif
