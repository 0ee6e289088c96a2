/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/dense.h"

#include <string.h>

enum { ROWS = SP_BRICK * SP_BRICK, FULL = 0xffff };
enum { BRICKS_GRAIN = 16 }; /* bricks turned between two polls of the cancel flag */

uint32_t sp_dense_count(const struct sp_dense *dense) {
    /* Counts the bits of four rows at a time: in pairs, in fours, in bytes, then the sum of the
     * bytes. */
    uint64_t count = 0;
    for (int r = 0; r < ROWS; r += 4) {
        uint64_t x;
        memcpy(&x, &dense->used[r], sizeof x);
        x -= x >> 1 & UINT64_C(0x5555555555555555);
        x = (x & UINT64_C(0x3333333333333333)) + (x >> 2 & UINT64_C(0x3333333333333333));
        x = (x + (x >> 4)) & UINT64_C(0x0f0f0f0f0f0f0f0f);
        count += x * UINT64_C(0x0101010101010101) >> 56;
    }
    return (uint32_t)count;
}

/* Copies the elements of a row whose bits are set; returns how many. */
static inline uint32_t pack_row(const void *from, void *to, uint32_t bits, uint32_t bytes) {
    if (bits == FULL) {
        memcpy(to, from, (size_t)SP_BRICK * bytes);
        return SP_BRICK;
    }
    uint32_t n = 0;
    for (; bits; bits &= bits - 1, n++) {
        size_t column = (size_t)__builtin_ctz(bits);
        memcpy((uint8_t *)to + n * bytes, (const uint8_t *)from + column * bytes, bytes);
    }
    return n;
}

/* Widths are constants here, so that each copy is one load and one store. */
static void pack_rows(const uint16_t used[ROWS], const void *from, void *to, uint32_t bytes) {
    const uint8_t *in = from;
    uint8_t *out = to;
    for (uint32_t r = 0; r < ROWS; r++) {
        const uint8_t *row = in + (size_t)r * SP_BRICK * bytes;
        uint32_t n = bytes == 1   ? pack_row(row, out, used[r], 1)
                     : bytes == 2 ? pack_row(row, out, used[r], 2)
                     : bytes == 4 ? pack_row(row, out, used[r], 4)
                                  : pack_row(row, out, used[r], 8);
        out += (size_t)n * bytes;
    }
}

static void pack_places(const uint16_t used[ROWS], uint8_t *out, uint16_t start[SP_BRICK + 1]) {
    const uint8_t *begin = out;
    for (uint32_t r = 0; r < ROWS; r++) {
        uint32_t row = (r & 15) << 4, bits = used[r];
        if ((r & 15) == 0)
            start[r >> 4] = (uint16_t)(out - begin);
        if (bits == FULL)
            for (uint32_t i = 0; i < SP_BRICK; i++)
                *out++ = (uint8_t)(row | i);
        else
            for (; bits; bits &= bits - 1)
                *out++ = (uint8_t)(row | (uint32_t)__builtin_ctz(bits));
    }
    start[SP_BRICK] = (uint16_t)(out - begin);
}

void sp_dense_pack(const struct sp_dense *dense, const struct sp_visible *list, uint32_t brick) {
    uint64_t first = list->first[brick];
    pack_places(dense->used, list->place + first, list->start[brick]);
    pack_rows(dense->used, &dense->key, (uint8_t *)list->key + first * list->key_bytes,
              list->key_bytes);
    if (list->normal)
        pack_rows(dense->used, &dense->normal, (uint8_t *)list->normal + first * list->normal_bytes,
                  list->normal_bytes);
    list->axis[brick] = (uint8_t)dense->axis;
}

static inline void scatter(const void *from, void *to, const uint16_t *element, uint32_t count,
                           uint32_t bytes) {
    for (uint32_t e = 0; e < count; e++)
        memcpy((uint8_t *)to + (size_t)element[e] * bytes, (const uint8_t *)from + e * bytes,
               bytes);
}

static void scatter_all(const void *from, void *to, const uint16_t *element, uint32_t count,
                        uint32_t bytes) {
    if (bytes == 1)
        scatter(from, to, element, count, 1);
    else if (bytes == 2)
        scatter(from, to, element, count, 2);
    else if (bytes == 4)
        scatter(from, to, element, count, 4);
    else
        scatter(from, to, element, count, 8);
}

/* 16 bytes that are 0 or 1 → a bit each. */
static uint16_t gather_bits(const uint8_t present[SP_BRICK]) {
    uint16_t bits = 0;
    for (uint32_t half = 0; half < 2; half++) {
        uint64_t x = 0;
        for (uint32_t i = 0; i < 8; i++) /* a load, on little-endian machines */
            x |= (uint64_t)present[8 * half + i] << 8 * i;
        bits |= (uint16_t)((x * UINT64_C(0x0102040810204080) >> 56) << 8 * half);
    }
    return bits;
}

void sp_dense_unpack(struct sp_dense *dense, const struct sp_visible *list, uint32_t brick) {
    uint16_t element[SP_BRICK_VOXELS];
    uint8_t present[SP_BRICK_VOXELS] = { 0 };
    uint64_t first = list->first[brick];
    uint32_t count = (uint32_t)(list->first[brick + 1] - first);
    sp_visible_locals(list, brick, NULL, 0, count, element);
    for (uint32_t e = 0; dense->axis < 2 && e < count; e++)
        element[e] = (uint16_t)sp_dense_element(dense->axis, element[e]);
    for (uint32_t e = 0; e < count; e++)
        present[element[e]] = 1;
    for (uint32_t r = 0; r < ROWS; r++)
        dense->used[r] = gather_bits(present + r * SP_BRICK);
    scatter_all((const uint8_t *)list->key + first * list->key_bytes, &dense->key, element, count,
                list->key_bytes);
    if (list->normal)
        scatter_all((const uint8_t *)list->normal + first * list->normal_bytes, &dense->normal,
                    element, count, list->normal_bytes);
}

struct turn {
    const struct sp_visible *visible;
    struct sp_class *classes;
    unsigned axis;
    const atomic_bool *cancel;
    atomic_bool cancelled;
};

/* For each element along axis `to`, the element along axis `from`. */
static void map_elements(unsigned from, unsigned to, uint16_t map[SP_BRICK_VOXELS]) {
    for (uint32_t e = 0; e < SP_BRICK_VOXELS; e++)
        map[e] = (uint16_t)sp_dense_element(from, sp_visible_local(to, e >> 8, (uint8_t)(e & 255)));
}

static void permute(void *entries, uint32_t bytes, const uint16_t *map, struct sp_dense *dense) {
    if (bytes == 1)
        for (uint32_t e = 0; e < SP_BRICK_VOXELS; e++)
            dense->key.bytes[e] = ((const uint8_t *)entries)[map[e]];
    else if (bytes == 2)
        for (uint32_t e = 0; e < SP_BRICK_VOXELS; e++)
            dense->key.halves[e] = ((const uint16_t *)entries)[map[e]];
    else if (bytes == 4)
        for (uint32_t e = 0; e < SP_BRICK_VOXELS; e++)
            dense->key.words[e] = ((const uint32_t *)entries)[map[e]];
    else
        for (uint32_t e = 0; e < SP_BRICK_VOXELS; e++)
            dense->key.microflakes[e] = ((const struct sp_microflakes *)entries)[map[e]];
    memcpy(entries, &dense->key, (size_t)SP_BRICK_VOXELS * bytes);
}

/* Turns a brick of which all voxels are listed: its places stay. */
static void turn_full_brick(const struct sp_visible *list, uint32_t brick, const uint16_t *map,
                            struct sp_dense *dense) {
    uint64_t first = list->first[brick];
    permute((uint8_t *)list->key + first * list->key_bytes, list->key_bytes, map, dense);
    if (list->normal)
        permute((uint8_t *)list->normal + first * list->normal_bytes, list->normal_bytes, map,
                dense);
    list->axis[brick] = (uint8_t)dense->axis;
}

/* Brings the classes of a brick's entries into their order. */
static void sort_classes(const struct sp_visible *list, uint32_t brick, struct sp_class *classes) {
    struct sp_class sorted[SP_BRICK_VOXELS];
    uint64_t first = list->first[brick];
    uint32_t count = (uint32_t)(list->first[brick + 1] - first);
    uint32_t *keys = (uint32_t *)list->key + first;
    for (uint32_t e = 0; e < count; e++) {
        sorted[e] = classes[keys[e]];
        keys[e] = (uint32_t)first + e;
    }
    memcpy(classes + first, sorted, count * sizeof *sorted);
}

static void turn_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct turn *t = user;
    struct sp_dense dense;
    if (t->cancel && atomic_load_explicit(t->cancel, memory_order_relaxed)) {
        atomic_store_explicit(&t->cancelled, true, memory_order_relaxed);
        return;
    }
    dense.axis = t->axis;
    uint16_t map[SP_BRICK_VOXELS];
    unsigned mapped = 3; /* the axis that `map` is made from; 3 = none */
    for (size_t b = begin; b < end; b++) {
        unsigned from = t->visible->axis[b];
        if (from == t->axis)
            continue;
        if (t->visible->first[b + 1] - t->visible->first[b] == SP_BRICK_VOXELS) {
            if (mapped != from)
                map_elements(from, t->axis, map);
            mapped = from;
            turn_full_brick(t->visible, (uint32_t)b, map, &dense);
        } else {
            sp_dense_unpack(&dense, t->visible, (uint32_t)b);
            sp_dense_pack(&dense, t->visible, (uint32_t)b);
        }
        if (t->classes)
            sort_classes(t->visible, (uint32_t)b, t->classes);
    }
}

bool sp_dense_turn(const struct sp_visible *visible, struct sp_class *classes, unsigned axis,
                   struct sp_pool *pool, const atomic_bool *cancel) {
    uint32_t bricks = sp_visible_bricks(visible), b = 0;
    while (b < bricks && visible->axis[b] == axis)
        b++;
    if (b == bricks)
        return true;
    struct turn turn = { visible, classes, axis, cancel, false };
    sp_parallel_for(pool, bricks, BRICKS_GRAIN, turn_bricks, &turn);
    return !turn.cancelled;
}
