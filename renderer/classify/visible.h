/* SPDX-License-Identifier: Apache-2.0
 *
 * The visible voxels of one level, in bricks of 16³.
 *
 *   brick b ─► entries [first[b], first[b+1])      entry e: local[e], key[e], normal[e]
 *
 * A brick can be made anew without the others, be skipped as a whole, and be sorted for a view
 * while it is in the cache. Keys are as wide as the volume's type needs: an entry takes 3
 * bytes for 8 bits, 4 for 16 and 6 for others, and 4 more with normals.
 */
#ifndef SP_CLASSIFY_VISIBLE_H
#define SP_CLASSIFY_VISIBLE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/parallel_for.h"
#include "classify/transfer.h"

enum { SP_BRICK = 16, SP_BRICK_SHIFT = 4, SP_BRICK_VOXELS = 4096 };

/* Smallest and largest value of a brick, as sp_transfer_value() gives them; low > high: none. */
struct sp_range {
    float low, high;
};

struct sp_visible {
    uint32_t bricks[3]; /* an axis, axis 0 fastest; 0 = no list */
    uint64_t count;     /* entries */
    uint64_t *first;    /* [bricks + 1] */
    uint16_t *local;    /* i0 | i1 << 4 | i2 << 8 inside the brick, rising */
    void *key;          /* see transfer.h; sp_visible_key() reads them */
    uint32_t key_bytes; /* of each: 1, 2 or 4, unsigned */
    uint32_t *normal;   /* packed gradient (gradient.h); NULL = not made */
};

/* Each brick's entries sorted by their index along one axis, stably. */
struct sp_slices {
    uint16_t (*start)[SP_BRICK + 1]; /* [bricks]: slice s of a brick is the places [start[s],
                                        start[s+1]); NULL = not made */
    uint16_t *place; /* [entries], by visible.first: the entry of the brick at each place; NULL =
                        each its own (axis 2) */
    uint64_t runs;   /* slices of bricks that are not empty */
};

/* Number of bricks; under 2^25, as volumes go. */
static inline uint32_t sp_visible_bricks(const struct sp_visible *visible) {
    return visible->bricks[0] * visible->bricks[1] * visible->bricks[2];
}

/* Index of the first voxel of a brick. */
static inline void sp_visible_corner(const struct sp_visible *visible, uint32_t brick,
                                     uint32_t corner[3]) {
    uint32_t row = brick / visible->bricks[0];
    corner[0] = brick % visible->bricks[0] << SP_BRICK_SHIFT;
    corner[1] = row % visible->bricks[1] << SP_BRICK_SHIFT;
    corner[2] = row / visible->bricks[1] << SP_BRICK_SHIFT;
}

/* Key of entry e of the whole list. */
static inline uint32_t sp_visible_key(const struct sp_visible *visible, uint64_t e) {
    if (visible->key_bytes == 1)
        return ((const uint8_t *)visible->key)[e];
    if (visible->key_bytes == 2)
        return ((const uint16_t *)visible->key)[e];
    return ((const uint32_t *)visible->key)[e];
}

static inline void sp_visible_set_key(const struct sp_visible *visible, uint64_t e, uint32_t key) {
    if (visible->key_bytes == 1)
        ((uint8_t *)visible->key)[e] = (uint8_t)key;
    else if (visible->key_bytes == 2)
        ((uint16_t *)visible->key)[e] = (uint16_t)key;
    else
        ((uint32_t *)visible->key)[e] = key;
}

/* Sets bricks and the width of keys and takes memory for `first`, all zero; SP_ERR_MEMORY. */
bool sp_visible_init(struct sp_visible *visible, const uint32_t dims[3], uint32_t key_bytes,
                     struct sp_error *err);

/* Turns first[b + 1] = entries of brick b into places and sets count. */
void sp_visible_sum(struct sp_visible *visible);

/* Memory for visible->count entries, with normals or without; SP_ERR_MEMORY. */
bool sp_visible_allocate(struct sp_visible *visible, bool normals, struct sp_error *err);

void sp_visible_finish(struct sp_visible *visible);
uint64_t sp_visible_bytes(const struct sp_visible *visible);

/* Bytes of `count` entries of such a list. */
uint64_t sp_visible_entry_bytes(const struct sp_visible *visible, uint64_t count, bool normals);

/* Sorts the bricks along `axis`; SP_ERR_MEMORY. *slices is empty before, and after a failure. */
bool sp_slices_make(struct sp_slices *slices, const struct sp_visible *visible, unsigned axis,
                    struct sp_pool *pool, struct sp_error *err);

void sp_slices_finish(struct sp_slices *slices);

/* Bytes of the slices of a list along an axis. */
uint64_t sp_slices_bytes(const struct sp_visible *visible, unsigned axis);

#endif
