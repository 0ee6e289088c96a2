/* SPDX-License-Identifier: Apache-2.0
 *
 * The range of values in each region. Lines of samples are read once per slab of regions; minima
 * and maxima are taken along the lines first, then across them.
 */
#include "resample/ranges.h"

#include <math.h>

#include "volume/sample.h"

struct ranges {
    struct sp_samples *samples;
    const struct sp_interrupt *interrupt;
};

/* Interpolation overshoots. It hardly ever exceeds the samples around a cell by more than this
 * share of the range of those one sample farther; what does may be missing from the image. */
static const float overshoot = 0.25f;

/* Regions beside each other along the first axis. */
enum { RUN = 64, RUN_SAMPLES = RUN * SAMPLES_REGION + 3 };

struct run_range {
    float low[RUN], high[RUN];
};

struct row { /* the ranges of a run on row y of samples, over all lines of a slab of regions */
    struct run_range own, wide;
};

static void empty(struct run_range *range) {
    for (int i = 0; i < RUN; i++) {
        range->low[i] = INFINITY;
        range->high[i] = -INFINITY;
    }
}

static void join(struct run_range *range, const struct run_range *other) {
    for (int i = 0; i < RUN; i++) {
        range->low[i] = other->low[i] < range->low[i] ? other->low[i] : range->low[i];
        range->high[i] = other->high[i] > range->high[i] ? other->high[i] : range->high[i];
    }
}

#define READ(type)                                                                                 \
    for (uint32_t i = begin; i < end; i++)                                                         \
    low[i + 1 - first] = high[i + 1 - first] = (float)((const type *)line)[i]

/* Beyond this a margin would overflow. */
static const double largest = 1e37;

/* The range of a sample as floats: (−∞, −∞) if it is not finite, (−∞, ∞) if it is too large. */
static void read_sample(double x, float *low, float *high) {
    *low = -INFINITY;
    *high = isfinite(x) ? INFINITY : -INFINITY;
    if (!(fabs(x) <= largest))
        return;
    *low = *high = (float)x;
    if ((double)*low > x)
        *low = nextafterf(*low, -INFINITY);
    if ((double)*high < x)
        *high = nextafterf(*high, INFINITY);
}

/* Reads line (y, z) from sample first − 1 on; beyond its ends samples are (∞, −∞). */
static void read_line(const struct sp_samples *s, uint32_t first, uint32_t y, uint32_t z,
                      float low[RUN_SAMPLES], float high[RUN_SAMPLES]) {
    uint64_t at = ((uint64_t)z * s->dims[1] + y) * s->dims[0];
    const void *line = (const char *)s->voxels + at * sp_type_size(s->type);
    uint32_t begin = first > 0 ? first - 1 : 0, end = first - 1 + RUN_SAMPLES;
    end = end < s->dims[0] ? end : s->dims[0];
    for (int i = 0; i < RUN_SAMPLES; i++) {
        low[i] = INFINITY;
        high[i] = -INFINITY;
    }
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
    default:
        for (uint32_t i = begin; i < end; i++)
            read_sample(sp_sample(s->voxels, s->type, at + i), &low[i + 1 - first],
                        &high[i + 1 - first]);
    }
}

static inline float least(float a, float b) {
    return a < b ? a : b;
}

static inline float most(float a, float b) {
    return a > b ? a : b;
}

/* The ranges of the regions on a line: of their own samples, and with one more at both ends. */
static void find_line_ranges(const float low[RUN_SAMPLES], const float high[RUN_SAMPLES],
                             struct run_range *own, struct run_range *wide) {
    for (int i = 0; i < RUN; i++) {
        const float *l = low + i * SAMPLES_REGION, *h = high + i * SAMPLES_REGION;
        own->low[i] = least(least(least(l[1], l[2]), least(l[3], l[4])), l[5]);
        own->high[i] = most(most(most(h[1], h[2]), most(h[3], h[4])), h[5]);
        wide->low[i] = least(own->low[i], least(l[0], l[6]));
        wide->high[i] = most(own->high[i], most(h[0], h[6]));
    }
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
    float low[RUN_SAMPLES], high[RUN_SAMPLES];
    struct row line;
    empty(&row->own);
    empty(&row->wide);
    for (uint32_t z = first_near(slab); z < s->dims[2] && is_near(z, slab); z++) {
        read_line(s, first, y, z, low, high);
        find_line_ranges(low, high, &line.own, &line.wide);
        if (is_own(z, slab))
            join(&row->own, &line.own);
        join(&row->wide, &line.wide);
    }
}

void sp_ranges_widen(const float own[2], const float wide[2], float range[2]) {
    range[0] = INFINITY;
    range[1] = -INFINITY;
    if (!(wide[1] > -INFINITY))
        return;
    float margin = overshoot * (wide[1] - wide[0]);
    bool is_finite = margin < INFINITY;
    /* A region without finite samples of its own is reached from beside it. */
    range[0] = is_finite ? least(own[0], wide[1]) - margin : -INFINITY;
    range[1] = is_finite ? most(own[1], wide[0]) + margin : INFINITY;
}

static void write_ranges(const struct row *rows, uint32_t count, float (*range)[2]) {
    for (uint32_t i = 0; i < count; i++) {
        const float own[2] = { rows->own.low[i], rows->own.high[i] };
        const float wide[2] = { rows->wide.low[i], rows->wide.high[i] };
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
