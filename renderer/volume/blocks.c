/* SPDX-License-Identifier: Apache-2.0 */
#include "volume/blocks.h"

#include <string.h>

#define COPY(type)                                                                                 \
    for (size_t i = 0; i < n; i++)                                                                 \
    ((type *)out)[i] = ((const type *)from)[i * stride]

/* Copies n samples that are `stride` samples apart. */
static void copy(const void *from, size_t stride, size_t size, size_t n, void *out) {
    if (stride == 1) {
        memcpy(out, from, n * size);
        return;
    }
    switch (size) {
    case 1:
        COPY(uint8_t);
        break;
    case 2:
        COPY(uint16_t);
        break;
    case 4:
        COPY(uint32_t);
        break;
    default:
        COPY(uint64_t);
    }
}

void sp_blocks_read(const struct sp_blocks *blocks, unsigned axis, const uint32_t at[3], size_t n,
                    void *out) {
    const uint32_t last = SP_BLOCK_SIDE - 1;
    const size_t size = blocks->size, stride = (size_t)1 << SP_BLOCK_BITS * axis;
    uint32_t place[3] = { at[0], at[1], at[2] };
    for (char *to = out; n > 0;) {
        const struct sp_block *block = sp_blocks_find(blocks, place);
        const size_t inside =
            (((size_t)(place[2] & last) << SP_BLOCK_BITS | (place[1] & last)) << SP_BLOCK_BITS) |
            (place[0] & last);
        const size_t left = SP_BLOCK_SIDE - (place[axis] & last), count = n < left ? n : left;
        if (block->is_constant)
            copy(block->samples, 0, size, count, to);
        else
            copy((const char *)block->samples + inside * size, stride, size, count, to);
        to += count * size;
        place[axis] += (uint32_t)count;
        n -= count;
    }
}
