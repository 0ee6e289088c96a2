/* SPDX-License-Identifier: Apache-2.0
 *
 * The visible voxels of one level, in bricks of 16³, each in slices along one axis.
 *
 *   brick b ─► entries first[b] + [start[b][s], start[b][s + 1]) in slice s, up to first[b + 1]
 *   entry e ─► place[e] in its slice, key[e], normal[e]
 *
 * A brick can be rebuilt without the others, skipped as a whole, and turned to another axis while
 * it is in the CPU's cache. Its entries are in the order in which a view draws them. In a slice the
 * entries are in rising order of place, so that the order does not depend on the history of the
 * list.
 *
 * Keys are as wide as the volume's type needs. Normals take 2 bytes for 8 and 16 bits, otherwise 4.
 * An entry of 8 / 16 bits / other types thus takes 2 / 3 / 5 bytes, with normals 4 / 5 / 9. Coarse
 * levels keep microflakes instead of normals.
 */
#ifndef SP_CLASSIFY_VISIBLE_H
#define SP_CLASSIFY_VISIBLE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/parallel_for.h"
#include "classify/gradient.h"
#include "classify/microflakes.h"
#include "classify/transfer.h"

enum { SP_BRICK = 16, SP_BRICK_SHIFT = 4, SP_BRICK_VOXELS = 4096, SP_PLACES_BEYOND = 16 };

/* The smallest and the largest value of a brick, in the unit of sp_transfer_value();
 * low > high = the brick has no values. */
struct sp_range {
    float low, high;
};

struct sp_visible {
    uint32_t bricks[3];              /* per axis, axis 0 fastest; 0 = no list */
    uint64_t count;                  /* entries */
    uint64_t *first;                 /* [bricks + 1] */
    uint16_t (*start)[SP_BRICK + 1]; /* [bricks] */
    uint8_t *axis;  /* [bricks]: slices are perpendicular to it; sp_dense_turn() makes all equal */
    uint8_t *place; /* place in the slice; axis 2: i0 | i1 << 4, 1: i0 | i2 << 4, 0: i1 | i2 << 4.
                       SP_PLACES_BEYOND more bytes can be read. NULL = entries are only counted; the
                       GPU has them */
    void *key;      /* see transfer.h; sp_visible_key() reads them */
    uint32_t key_bytes;    /* per key: 1, 2 or 4, unsigned */
    void *normal;          /* see gradient.h; sp_visible_normal() reads them; NULL = not made */
    uint32_t normal_bytes; /* per entry: 2 (direction only), 4, or 8 = struct sp_microflakes */
};

/* Returns the number of bricks. It is below 2^25, because volumes have at most 2^36 voxels. */
static inline uint32_t sp_visible_brick_count(const uint32_t bricks[3]) {
    return bricks[0] * bricks[1] * bricks[2];
}

static inline uint32_t sp_visible_bricks(const struct sp_visible *visible) {
    return sp_visible_brick_count(visible->bricks);
}

/* Computes the index of the first voxel of a brick. */
static inline void sp_visible_brick_corner(const uint32_t bricks[3], uint32_t brick,
                                           uint32_t corner[3]) {
    uint32_t row = brick / bricks[0];
    corner[0] = brick % bricks[0] << SP_BRICK_SHIFT;
    corner[1] = row % bricks[1] << SP_BRICK_SHIFT;
    corner[2] = row / bricks[1] << SP_BRICK_SHIFT;
}

/* Returns the key of entry e of the whole list. */
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

/* Returns the packed gradient of entry e; the list must have gradients, not microflakes. A 2-byte
 * gradient has no magnitude: the function returns the largest magnitude, unless the gradient is
 * zero. */
static inline uint32_t sp_visible_normal(const struct sp_visible *visible, uint64_t e) {
    if (visible->normal_bytes == 2)
        return sp_gradient_widen(((const uint16_t *)visible->normal)[e]);
    return ((const uint32_t *)visible->normal)[e];
}

static inline void sp_visible_set_normal(const struct sp_visible *visible, uint64_t e,
                                         uint32_t packed) {
    if (visible->normal_bytes == 2)
        ((uint16_t *)visible->normal)[e] = (uint16_t)packed; /* a direction */
    else
        ((uint32_t *)visible->normal)[e] = packed;
}

/* Converts a place in slice s along an axis to a place in the brick, i0 | i1 << 4 | i2 << 8. */
static inline uint16_t sp_visible_local(unsigned axis, uint32_t s, uint8_t place) {
    uint32_t column = place & 15u, row = place >> 4;
    return (uint16_t)(axis == 2   ? column | row << 4 | s << 8
                      : axis == 1 ? column | s << 4 | row << 8
                                  : s | column << 4 | row << 8);
}

/* Computes local[i], the place in the brick as above, of `count` entries of a brick: order[begin],
 * order[begin + 1], …, relative to the brick's first entry. order: NULL = the entries begin,
 * begin + 1, …. */
void sp_visible_locals(const struct sp_visible *visible, uint32_t brick, const uint16_t *order,
                       uint32_t begin, uint32_t count, uint16_t *local);

static inline bool sp_visible_has_microflakes(const struct sp_visible *visible) {
    return visible->normal && visible->normal_bytes == sizeof(struct sp_microflakes);
}

/* Returns the microflakes of entry e; the list must have microflakes. */
static inline struct sp_microflakes *sp_visible_microflakes(const struct sp_visible *visible,
                                                            uint64_t e) {
    return (struct sp_microflakes *)visible->normal + e;
}

/* Sets bricks and widths and allocates the arrays per brick, all zero. SP_ERR_MEMORY. */
bool sp_visible_init(struct sp_visible *visible, const uint32_t dims[3], uint32_t key_bytes,
                     uint32_t normal_bytes, struct sp_error *err);

/* Turns first[b + 1] = number of entries of brick b into prefix sums, and sets count. */
void sp_visible_sum(struct sp_visible *visible);

/* Allocates visible->count entries, with normals or without. SP_ERR_MEMORY. */
bool sp_visible_allocate(struct sp_visible *visible, bool normals, struct sp_error *err);

void sp_visible_finish(struct sp_visible *visible);
uint64_t sp_visible_bytes(const struct sp_visible *visible);

/* Returns the bytes of `count` entries of this list, with normals or without. */
uint64_t sp_visible_entry_bytes(const struct sp_visible *visible, uint64_t count, bool normals);

#endif
