/* SPDX-License-Identifier: Apache-2.0
 *
 * The range of values in each region. Lines of samples are read once per slab of regions. Minima
 * and maxima are taken across lines first, sample by sample, and along them last: vectors of
 * samples do most of it. Integers of 8 and 16 bits are compared as they are, the rest as floats.
 */
#include "draw/resample/ranges.h"

#include <math.h>
#include <string.h>

#include "base/minmax.h"
#include "data/volume/sample.h"

struct ranges {
    struct sp_samples *samples;
    const struct sp_interrupt *interrupt;
};

/* Regions beside each other along the first axis. */
enum { RUN = 64, RUN_SAMPLES = RUN * SAMPLES_REGION + 3 };

/* Beyond this a margin would overflow. */
static const float largest = 1e37f;

/* The samples of a line that a run needs, and where they lie in it. */
struct stretch {
    uint32_t begin[3]; /* the first one */
    int count, at;
};

/* Is line i among a region's own, which lie between its first and its last slice? */
static bool is_own(uint32_t i, uint32_t region) {
    return i >= region * SAMPLES_REGION && i <= (region + 1) * SAMPLES_REGION;
}

/* Is it at most one farther? From first_near() on. */
static bool is_near(uint32_t i, uint32_t region) {
    return i <= (region + 1) * SAMPLES_REGION + 1;
}

static uint32_t first_near(uint32_t region) {
    return region > 0 ? region * SAMPLES_REGION - 1 : 0;
}

/* Of line (y, z), from sample first − 1 on. */
static struct stretch compute_stretch(const struct sp_samples *s, uint32_t first, uint32_t y,
                                      uint32_t z) {
    uint32_t begin = first > 0 ? first - 1 : 0, end = first - 1 + RUN_SAMPLES;
    end = end < s->dims[0] ? end : s->dims[0];
    return (struct stretch){ { begin, y, z }, (int)(end - begin), (int)(begin + 1 - first) };
}

/* The samples of a stretch: where they lie, or in blocks a copy of them. */
static const void *get_samples(const struct sp_samples *s, const struct stretch *stretch,
                               void *copy) {
    const uint32_t *at = stretch->begin;
    if (!s->blocks)
        return (const char *)s->voxels +
               (((uint64_t)at[2] * s->dims[1] + at[1]) * s->dims[0] + at[0]) *
                   sp_type_size(s->type);
    sp_blocks_read(s->blocks, 0, at, (size_t)stretch->count, copy);
    return copy;
}

/* Integers are used as they are. */
#define READ_INTEGERS(s, stretch, line, low_out, high_out)                                         \
    do {                                                                                           \
        *(low_out) = get_samples(s, stretch, (line)->low);                                         \
        *(high_out) = *(low_out);                                                                  \
    } while (0)

#define ELEMENT uint8_t
#define LINES(name) name##_uint8
#define LEAST 0
#define MOST UINT8_MAX
#define READ_LINE READ_INTEGERS
#include "draw/resample/lines.h"

#define ELEMENT int8_t
#define LINES(name) name##_int8
#define LEAST INT8_MIN
#define MOST INT8_MAX
#define READ_LINE READ_INTEGERS
#include "draw/resample/lines.h"

#define ELEMENT uint16_t
#define LINES(name) name##_uint16
#define LEAST 0
#define MOST UINT16_MAX
#define READ_LINE READ_INTEGERS
#include "draw/resample/lines.h"

#define ELEMENT int16_t
#define LINES(name) name##_int16
#define LEAST INT16_MIN
#define MOST INT16_MAX
#define READ_LINE READ_INTEGERS
#include "draw/resample/lines.h"

/* The range of a sample as floats: (−∞, −∞) if it is not finite, (−∞, ∞) if it is too large. */
static void read_sample(double x, float *low, float *high) {
    *low = -INFINITY;
    *high = isfinite(x) ? INFINITY : -INFINITY;
    if (!(fabs(x) <= (double)largest))
        return;
    *low = *high = (float)x;
    if ((double)*low > x)
        *low = nextafterf(*low, -INFINITY);
    if ((double)*high < x)
        *high = nextafterf(*high, INFINITY);
}

static void read_floats(const struct sp_samples *s, const struct stretch *stretch, float *low,
                        float *high) {
    double copy[RUN_SAMPLES]; /* memory for samples of any type */
    const void *samples = get_samples(s, stretch, copy);
    if (s->type == SP_FLOAT32)
        for (int i = 0; i < stretch->count; i++) {
            float x = ((const float *)samples)[i];
            low[i] = fabsf(x) <= largest ? x : -INFINITY;
            high[i] = fabsf(x) <= largest ? x : fabsf(x) < INFINITY ? INFINITY : -INFINITY;
        }
    else
        for (int i = 0; i < stretch->count; i++)
            read_sample(sp_sample(samples, s->type, (uint64_t)i), &low[i], &high[i]);
}

#define ELEMENT float
#define LINES(name) name##_float
#define LEAST (-INFINITY)
#define MOST INFINITY
#define READ_LINE(s, stretch, line, low_out, high_out)                                             \
    read_floats(s, stretch, (line)->low, (line)->high)
#include "draw/resample/lines.h"

static void compute_ranges(void *user, size_t begin, size_t end, unsigned worker) {
    const struct ranges *r = user;
    const struct sp_samples *s = r->samples;
    size_t runs = (s->regions[0] + RUN - 1) / RUN;
    (void)worker;
    for (size_t i = begin; i < end && !sp_interrupt_is_cancelled(r->interrupt); i++) {
        uint32_t first = (uint32_t)(i % runs) * RUN, slab = (uint32_t)(i / runs);
        switch (s->type) {
        case SP_UINT8:
            compute_run_uint8(s, first, slab);
            break;
        case SP_INT8:
            compute_run_int8(s, first, slab);
            break;
        case SP_UINT16:
            compute_run_uint16(s, first, slab);
            break;
        case SP_INT16:
            compute_run_int16(s, first, slab);
            break;
        default:
            compute_run_float(s, first, slab);
        }
    }
}

void sp_ranges_compute(struct sp_samples *samples, struct sp_pool *pool,
                       const struct sp_interrupt *interrupt) {
    struct ranges ranges = { samples, interrupt };
    size_t runs = (samples->regions[0] + RUN - 1) / RUN;
    sp_parallel_for(pool, runs * samples->regions[2], 1, compute_ranges, &ranges);
}
