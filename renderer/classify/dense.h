/* SPDX-License-Identifier: Apache-2.0
 *
 * One brick as an array of all its 16³ cells, with a mask of the used cells. Lists are packed from
 * this array, in the order that a view needs.
 *
 *   element (slice, row, column) at slice << 8 | row << 4 | column
 *   axis 2: (i2, i1, i0)      axis 1: (i1, i2, i0)      axis 0: (i0, i2, i1)
 *
 * The entries of a list are the used elements in rising order (visible.h), however often the list
 * was changed.
 */
#ifndef SP_CLASSIFY_DENSE_H
#define SP_CLASSIFY_DENSE_H

#include "classify/visible.h"

struct sp_dense {
    unsigned axis;
    uint16_t used[SP_BRICK * SP_BRICK]; /* [slice << 4 | row]: one bit per column */
    _Alignas(64) union {
        uint8_t bytes[SP_BRICK_VOXELS];
        uint16_t halves[SP_BRICK_VOXELS];
        uint32_t words[SP_BRICK_VOXELS];
        struct sp_microflakes microflakes[SP_BRICK_VOXELS];
    } key, normal; /* elements are as wide as the keys and normals of the list */
};

/* Returns the element of the voxel at i0 | i1 << 4 | i2 << 8. */
static inline uint32_t sp_dense_element(unsigned axis, uint32_t local) {
    if (axis == 2)
        return local;
    if (axis == 1)
        return (local & 15) | (local & 0xf0) << 4 | (local >> 8) << 4;
    return (local & 15) << 8 | local >> 4;
}

/* Returns the number of used elements. */
uint32_t sp_dense_count(const struct sp_dense *dense);

/* Writes the brick's entries from the used elements, with normals if the list has them. The list
 * must have memory for the entries. */
void sp_dense_pack(const struct sp_dense *dense, const struct sp_visible *list, uint32_t brick);

/* Reads a brick's entries into the order of dense->axis. Unused elements keep their old values. */
void sp_dense_unpack(struct sp_dense *dense, const struct sp_visible *list, uint32_t brick);

/* Turns all bricks of a list to slices along `axis`, without allocating. `classes`: the classes by
 * key of a list in which the keys are the numbers of the entries (mip.h); the function reorders the
 * classes like the entries, so that frames read them one after the other. NULL = keys stay with
 * their entries. False if cancelled: the axes of the bricks then differ. cancel: NULL = never. */
bool sp_dense_turn(const struct sp_visible *visible, struct sp_class *classes, unsigned axis,
                   struct sp_pool *pool, const atomic_bool *cancel);

#endif
