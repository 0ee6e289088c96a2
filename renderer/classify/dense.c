/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/dense.h"

#include <string.h>

enum { ROWS = SP_BRICK * SP_BRICK, FULL = 0xffff };

uint32_t sp_dense_count(const struct sp_dense *dense) {
    uint32_t count = 0;
    for (int r = 0; r < ROWS; r++)
        count += (uint32_t)__builtin_popcount(dense->used[r]);
    return count;
}

/* Copies the elements of a row whose bits are set. */
static inline void pack_row(const void *from, void *to, uint32_t bits, uint32_t bytes) {
    if (bits == FULL) {
        memcpy(to, from, (size_t)SP_BRICK * bytes);
        return;
    }
    for (uint32_t n = 0; bits; bits &= bits - 1, n++) {
        size_t column = (size_t)__builtin_ctz(bits);
        memcpy((uint8_t *)to + n * bytes, (const uint8_t *)from + column * bytes, bytes);
    }
}

/* The widths as constants, so that each copy is one load and one store. */
static void pack_rows(const uint16_t used[ROWS], const void *from, void *to, uint32_t bytes) {
    const uint8_t *in = from;
    uint8_t *out = to;
    for (uint32_t r = 0; r < ROWS; r++) {
        const uint8_t *row = in + (size_t)r * SP_BRICK * bytes;
        if (bytes == 1)
            pack_row(row, out, used[r], 1);
        else if (bytes == 2)
            pack_row(row, out, used[r], 2);
        else
            pack_row(row, out, used[r], 4);
        out += (size_t)__builtin_popcount(used[r]) * bytes;
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
    else
        scatter(from, to, element, count, 4);
}

void sp_dense_unpack(struct sp_dense *dense, const struct sp_visible *list, uint32_t brick) {
    uint16_t element[SP_BRICK_VOXELS];
    uint64_t first = list->first[brick];
    uint32_t count = (uint32_t)(list->first[brick + 1] - first);
    memset(dense->used, 0, sizeof dense->used);
    sp_visible_locals(list, brick, NULL, 0, count, element);
    for (uint32_t e = 0; e < count; e++) {
        uint32_t at = sp_dense_element(dense->axis, element[e]);
        element[e] = (uint16_t)at;
        dense->used[at >> 4] |= (uint16_t)(1u << (at & 15));
    }
    scatter_all((const uint8_t *)list->key + first * list->key_bytes, &dense->key, element, count,
                list->key_bytes);
    if (list->normal)
        scatter_all((const uint8_t *)list->normal + first * list->normal_bytes, &dense->normal,
                    element, count, list->normal_bytes);
}
