/* SPDX-License-Identifier: Apache-2.0
 *
 * The visible voxels of one level, in bricks of 16³, each in slices along one axis.
 *
 *   brick b ─► entries first[b] + [start[b][s], start[b][s + 1]) in slice s, up to first[b + 1]
 *   entry e ─► place[e] in its slice, key[e], normal[e]
 *
 * A brick can be made anew without the others, be skipped as a whole, and be turned to another axis
 * while it is in the cache; its entries then lie in the order in which a view draws them. In a
 * slice they rise by place, so that the order is the same whatever happened to the list before.
 *
 * Keys are as wide as the volume's type needs, and normals half a word for 8 and 16 bits: there an
 * entry takes 2 and 3 bytes, 4 and 5 with normals; 5 and 9 for other types. Coarse levels keep
 * flakes in their place.
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

/* Smallest and largest value of a brick, as sp_transfer_value() gives them; low > high: none. */
struct sp_range {
    float low, high;
};

struct sp_visible {
    uint32_t bricks[3];              /* an axis, axis 0 fastest; 0 = no list */
    uint64_t count;                  /* entries */
    uint64_t *first;                 /* [bricks + 1] */
    uint16_t (*start)[SP_BRICK + 1]; /* [bricks] */
    uint8_t *axis;  /* [bricks]: that each is cut along; sp_visible_turn() makes them one */
    uint8_t *place; /* SP_PLACES_BEYOND more may be read; axis 2: i0 | i1 << 4, 1: i0 | i2 << 4, 0:
                       i1 | i2 << 4; NULL = entries are counted, and somebody else has them */
    void *key;      /* see transfer.h; sp_visible_key() reads them */
    uint32_t key_bytes;    /* of each: 1, 2 or 4, unsigned */
    void *normal;          /* see gradient.h; sp_visible_normal() reads them; NULL = not made */
    uint32_t normal_bytes; /* of each: 2 (direction alone) or 4; 8: struct sp_microflakes instead */
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

/* Packed gradient of entry e of a list that has them, and no flakes; of 2 bytes the magnitude is
 * unknown, and full unless the gradient is zero. */
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

/* Place in the brick, i0 | i1 << 4 | i2 << 8, of a place in slice s along an axis. */
static inline uint16_t sp_visible_local(unsigned axis, uint32_t s, uint8_t place) {
    uint32_t column = place & 15u, row = place >> 4;
    return (uint16_t)(axis == 2   ? column | row << 4 | s << 8
                      : axis == 1 ? column | s << 4 | row << 8
                                  : s | column << 4 | row << 8);
}

/* The same of entries order[begin …] of a brick, counted from its first, `count` of them; order:
 * NULL = as they are. */
void sp_visible_locals(const struct sp_visible *visible, uint32_t brick, const uint16_t *order,
                       uint32_t begin, uint32_t count, uint16_t *local);

static inline bool sp_visible_has_microflakes(const struct sp_visible *visible) {
    return visible->normal && visible->normal_bytes == sizeof(struct sp_microflakes);
}

/* Flakes of entry e of a list that has them. */
static inline struct sp_microflakes *sp_visible_microflakes(const struct sp_visible *visible,
                                                            uint64_t e) {
    return (struct sp_microflakes *)visible->normal + e;
}

/* Sets bricks and widths and takes memory for what there is a brick, all zero; SP_ERR_MEMORY. */
bool sp_visible_init(struct sp_visible *visible, const uint32_t dims[3], uint32_t key_bytes,
                     uint32_t normal_bytes, struct sp_error *err);

/* Turns first[b + 1] = entries of brick b into places and sets count. */
void sp_visible_sum(struct sp_visible *visible);

/* Memory for visible->count entries, with normals or without; SP_ERR_MEMORY. */
bool sp_visible_allocate(struct sp_visible *visible, bool normals, struct sp_error *err);

void sp_visible_finish(struct sp_visible *visible);
uint64_t sp_visible_bytes(const struct sp_visible *visible);

/* Bytes of `count` entries of such a list. */
uint64_t sp_visible_entry_bytes(const struct sp_visible *visible, uint64_t count, bool normals);

/* Cuts all bricks along `axis`, without taking memory; false when cancelled, the list then holds
 * bricks of several axes. cancel: NULL = never. */
bool sp_visible_turn(const struct sp_visible *visible, unsigned axis, struct sp_pool *pool,
                     const atomic_bool *cancel);

#endif
