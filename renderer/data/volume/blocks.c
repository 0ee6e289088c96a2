/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/blocks.h"

#include <math.h>
#include <string.h>

#include "data/volume/sample.h"

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

/* Coarse samples that a run of a block lies between, at most: they are no closer than its own. */
enum { LINE = SP_BLOCK_SIDE + 2 };

/* Integers are rounded; interpolated values lie between the values of samples. */
#define NARROW(T)                                                                                  \
    for (size_t i = 0; i < n; i++)                                                                 \
    ((T *)out)[i] = (T)((T)0.5f > 0 ? x[i] : (T)-1 > 0 ? x[i] + 0.5 : floor(x[i] + 0.5))

static void narrow(const double *x, enum sp_type type, size_t n, void *out) {
    switch (type) { SP_TYPE_CASES(NARROW) }
}

/* A place between two samples of the coarser grid. */
struct between {
    uint32_t low, high;
    double share; /* of the high one */
};

static inline struct between compute_between(const struct sp_blocks_coarse *c, unsigned axis,
                                             uint32_t i) {
    const double last = c->dims[axis] - 1.0, wanted = c->first[axis] + c->step[axis] * i;
    const double at = wanted < 0 ? 0 : wanted < last ? wanted : last;
    const uint32_t low = (uint32_t)at;
    return (struct between){ low, low < c->dims[axis] - 1 ? low + 1 : low, at - low };
}

/* Reads a line of the coarser grid. */
static void read_line(const struct sp_blocks *b, unsigned axis, const uint32_t at[3], size_t n,
                      double *out) {
    const struct sp_blocks_coarse *c = &b->coarse;
    const size_t strides[3] = { 1, c->dims[0], (size_t)c->dims[0] * c->dims[1] };
    const size_t size = sp_type_size(b->type);
    double samples[LINE]; /* memory for any type */
    if (c->blocks)
        sp_blocks_read(c->blocks, axis, at, n, samples);
    else
        copy((const char *)c->samples + (at[0] + at[1] * strides[1] + at[2] * strides[2]) * size,
             strides[axis], size, n, samples);
    sp_samples_to_doubles(samples, b->type, 0, n, out);
}

/* A run inside of a block, linear between eight samples. */
static void read_coarse(const struct sp_blocks *b, unsigned axis, const uint32_t at[3], size_t n,
                        void *out) {
    const unsigned beside[2] = { axis == 0, axis == 2 ? 1 : 2 };
    const uint32_t first = compute_between(&b->coarse, axis, at[axis]).low;
    const uint32_t last = compute_between(&b->coarse, axis, at[axis] + (uint32_t)n - 1).high;
    const size_t count = last - first + 1;
    double sum[LINE] = { 0 }, line[LINE], values[SP_BLOCK_SIDE];
    for (int k = 0; k < 4; k++) {
        uint32_t place[3];
        double weight = 1;
        for (int j = 0; j < 2; j++) {
            const struct between p = compute_between(&b->coarse, beside[j], at[beside[j]]);
            place[beside[j]] = k >> j & 1 ? p.high : p.low;
            weight *= k >> j & 1 ? p.share : 1 - p.share;
        }
        place[axis] = first;
        if (weight == 0)
            continue;
        read_line(b, axis, place, count, line);
        for (size_t i = 0; i < count; i++)
            sum[i] += weight * line[i];
    }
    for (size_t i = 0; i < n; i++) {
        const struct between p = compute_between(&b->coarse, axis, at[axis] + (uint32_t)i);
        const double low = sum[p.low - first], high = sum[p.high - first];
        values[i] = p.share > 0 ? low + p.share * (high - low) : low;
    }
    narrow(values, b->type, n, out);
}

void sp_blocks_read(const struct sp_blocks *blocks, unsigned axis, const uint32_t at[3], size_t n,
                    void *out) {
    const uint32_t last = SP_BLOCK_SIDE - 1;
    const size_t size = sp_type_size(blocks->type), stride = (size_t)1 << SP_BLOCK_BITS * axis;
    uint32_t place[3] = { at[0], at[1], at[2] };
    for (char *to = out; n > 0;) {
        const struct sp_block *block = sp_blocks_at(blocks, place);
        const size_t inside =
            (((size_t)(place[2] & last) << SP_BLOCK_BITS | (place[1] & last)) << SP_BLOCK_BITS) |
            (place[0] & last);
        const size_t left = SP_BLOCK_SIDE - (place[axis] & last), count = n < left ? n : left;
        if (!block->samples)
            read_coarse(blocks, axis, place, count, to);
        else if (block->is_constant)
            copy(block->samples, 0, size, count, to);
        else
            copy((const char *)block->samples + inside * size, stride, size, count, to);
        to += count * size;
        place[axis] += (uint32_t)count;
        n -= count;
    }
}
