/* SPDX-License-Identifier: Apache-2.0
 *
 * The range of values in each region. Lines of samples are read once per slab of regions. Minima
 * and maxima are taken across lines first, sample by sample, and along them last: vectors of
 * samples do most of it.
 */
#include "resample/ranges.h"

#include <math.h>
#include <string.h>

#include "volume/sample.h"

struct ranges {
    struct sp_samples *samples;
    const struct sp_interrupt *interrupt;
};

/* Regions beside each other along the first axis. */
enum { RUN = 64, RUN_SAMPLES = RUN * SAMPLES_REGION + 3 };

/* Smallest and largest value per sample of a run, from the sample before it on. */
struct line {
    float low[RUN_SAMPLES], high[RUN_SAMPLES];
};

struct row { /* row y of samples, over all lines of a slab of regions */
    struct line own, wide;
};

static void empty(struct line *line) {
    for (int i = 0; i < RUN_SAMPLES; i++) {
        line->low[i] = INFINITY;
        line->high[i] = -INFINITY;
    }
}

static void join(struct line *line, const struct line *other) {
    for (int i = 0; i < RUN_SAMPLES; i++) {
        line->low[i] = other->low[i] < line->low[i] ? other->low[i] : line->low[i];
        line->high[i] = other->high[i] > line->high[i] ? other->high[i] : line->high[i];
    }
}

#define READ(type)                                                                                 \
    do {                                                                                           \
        const type *x = (const type *)from + begin;                                                \
        for (int i = 0; i < count; i++)                                                            \
            low[i] = (float)x[i];                                                                  \
        memcpy(high, low, (size_t)count * sizeof *low);                                            \
    } while (0)

/* Beyond this a margin would overflow. */
static const float largest = 1e37f;

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

/* Reads line (y, z) from sample first − 1 on; beyond its ends samples are (∞, −∞). */
static void read_line(const struct sp_samples *s, uint32_t first, uint32_t y, uint32_t z,
                      struct line *line) {
    uint64_t at = ((uint64_t)z * s->dims[1] + y) * s->dims[0];
    const void *from = (const char *)s->voxels + at * sp_type_size(s->type);
    uint32_t begin = first > 0 ? first - 1 : 0, end = first - 1 + RUN_SAMPLES;
    end = end < s->dims[0] ? end : s->dims[0];
    float *low = line->low + (begin + 1 - first), *high = line->high + (begin + 1 - first);
    int count = (int)(end - begin);
    if (count < RUN_SAMPLES)
        empty(line);
    switch (s->type) {
    case SP_UINT8:
        READ(uint8_t);
        break;
    case SP_INT8:
        READ(int8_t);
        break;
    case SP_UINT16:
        READ(uint16_t);
        break;
    case SP_INT16:
        READ(int16_t);
        break;
    case SP_FLOAT32:
        for (int i = 0; i < count; i++) {
            float x = ((const float *)from)[begin + (uint32_t)i];
            low[i] = fabsf(x) <= largest ? x : -INFINITY;
            high[i] = fabsf(x) <= largest ? x : fabsf(x) < INFINITY ? INFINITY : -INFINITY;
        }
        break;
    default:
        for (int i = 0; i < count; i++)
            read_sample(sp_sample(s->voxels, s->type, at + begin + (uint32_t)i), &low[i], &high[i]);
    }
}

static inline float least(float a, float b) {
    return a < b ? a : b;
}

static inline float most(float a, float b) {
    return a > b ? a : b;
}

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

static void find_row(const struct sp_samples *s, uint32_t first, uint32_t y, uint32_t slab,
                     struct row *row) {
    struct line line;
    empty(&row->own);
    empty(&row->wide);
    for (uint32_t z = first_near(slab); z < s->dims[2] && is_near(z, slab); z++) {
        read_line(s, first, y, z, &line);
        join(is_own(z, slab) ? &row->own : &row->wide, &line);
    }
    join(&row->wide, &row->own);
}

/* Writes the ranges of `count` regions beside each other. */
static void write_ranges(const struct row *row, uint32_t count, float (*range)[2]) {
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t at = i * SAMPLES_REGION;
        float own[2] = { INFINITY, -INFINITY }, wide[2] = { INFINITY, -INFINITY };
        for (uint32_t k = 0; k < SAMPLES_REGION + 3; k++) {
            wide[0] = least(wide[0], row->wide.low[at + k]);
            wide[1] = most(wide[1], row->wide.high[at + k]);
        }
        for (uint32_t k = 1; k < SAMPLES_REGION + 2; k++) {
            own[0] = least(own[0], row->own.low[at + k]);
            own[1] = most(own[1], row->own.high[at + k]);
        }
        sp_ranges_widen(own, wide, range[i]);
    }
}

/* Task i: a run of regions along the first axis, all along the second one, in one slab. */
static void find_ranges(void *user, size_t begin, size_t end, unsigned worker) {
    enum { KEPT = 8 }; /* rows of samples: neighbouring regions share three of seven */
    const struct ranges *r = user;
    const struct sp_samples *s = r->samples;
    const uint32_t *regions = s->regions, runs = (regions[0] + RUN - 1) / RUN;
    struct row rows[KEPT], all;
    (void)worker;
    for (size_t i = begin; i < end && !sp_interrupt_is_cancelled(r->interrupt); i++) {
        uint32_t first = (uint32_t)(i % runs) * RUN, slab = (uint32_t)(i / runs), known = 0;
        uint32_t count = regions[0] - first < RUN ? regions[0] - first : RUN;
        for (uint32_t q = 0; q < regions[1]; q++) {
            empty(&all.own);
            empty(&all.wide);
            for (uint32_t y = first_near(q); y < s->dims[1] && is_near(y, q); y++) {
                const struct row *row = &rows[y % KEPT];
                for (; known <= y; known++)
                    find_row(s, first * SAMPLES_REGION, known, slab, &rows[known % KEPT]);
                if (is_own(y, q))
                    join(&all.own, &row->own);
                join(&all.wide, &row->wide);
            }
            size_t region = ((size_t)slab * regions[1] + q) * regions[0] + first;
            write_ranges(&all, count, s->range + region);
        }
    }
}

void sp_ranges_find(struct sp_samples *samples, struct sp_pool *pool,
                    const struct sp_interrupt *interrupt) {
    struct ranges ranges = { samples, interrupt };
    size_t runs = (samples->regions[0] + RUN - 1) / RUN;
    sp_parallel_for(pool, runs * samples->regions[2], 1, find_ranges, &ranges);
}
