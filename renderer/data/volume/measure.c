/* SPDX-License-Identifier: Apache-2.0
 *
 * Range and histogram, in two passes, noise (noise.h), and the longest vector. Samples are widened
 * to double in short runs, so that one loop serves all types. Double represents every type exactly.
 */
#include <assert.h>
#include <float.h>
#include <math.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>

#include "base/parallel_for.h"
#include "data/volume/bins.h"
#include "data/volume/missing.h"
#include "data/volume/noise.h"
#include "data/volume/sample.h"
#include "data/volume/volume.h"

enum { RUN = 512, GRAIN = 1 << 18 }; /* samples */
enum { EVERY_MAX = 1 << 16 };
enum { THREADS_MAX = 16 }; /* of sp_volume_threads() */

struct partial { /* of one worker; merged by sums, minima and maxima, so order has no influence */
    double low, high;
    uint64_t finite;
    struct sp_extreme extreme;
    uint64_t bins[SP_HISTOGRAM_BINS];
};

struct measure {
    const void *voxels;
    enum sp_type type;
    double low, high;
    unsigned every; /* the histogram counts one of so many runs, times this number */
    int side;       /* of the extreme that is looked at: 0 = low, 1 = high */
    struct partial *partials;
    unsigned workers;
    struct sp_pool *pool;
    uint64_t count;
};

unsigned sp_volume_threads(void) {
    cpu_set_t set;
    int n = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    return n < 1 ? 1 : n > THREADS_MAX ? THREADS_MAX : (unsigned)n;
}

#define WIDEN(T)                                                                                   \
    for (size_t i = 0; i < n; i++)                                                                 \
    out[i] = ((const T *)voxels)[begin + i]

void sp_samples_to_doubles(const void *voxels, enum sp_type type, size_t begin, size_t n,
                           double *out) {
    switch (type) { SP_TYPE_CASES(WIDEN) }
}

enum { LANES = 32 }; /* of the loops below, which compilers turn into vector instructions */

/* Range of samples [begin, end) of an integer type. */
#define DEFINE_RANGE(T)                                                                            \
    static void range_of_##T(const T *v, size_t begin, size_t end, struct partial *p) {            \
        T low = v[begin], high = v[begin];                                                         \
        for (size_t i = begin; i < end; i++) {                                                     \
            low = v[i] < low ? v[i] : low;                                                         \
            high = v[i] > high ? v[i] : high;                                                      \
        }                                                                                          \
        p->low = (double)low < p->low ? (double)low : p->low;                                      \
        p->high = (double)high > p->high ? (double)high : p->high;                                 \
        p->finite += end - begin;                                                                  \
    }
DEFINE_RANGE(uint8_t)
DEFINE_RANGE(int8_t)
DEFINE_RANGE(uint16_t)
DEFINE_RANGE(int16_t)
DEFINE_RANGE(int32_t)

/* Range of the finite samples [begin, end) of a floating-point type. Comparisons with NaN are
 * false, so it changes no lane. */
#define DEFINE_FINITE_RANGE(T, N, MOST)                                                            \
    static void range_of_##T(const T *v, size_t begin, size_t end, struct partial *p) {            \
        T low[LANES], high[LANES];                                                                 \
        N finite[LANES] = { 0 };                                                                   \
        uint64_t count = 0;                                                                        \
        size_t i = begin;                                                                          \
        for (int lane = 0; lane < LANES; lane++) {                                                 \
            low[lane] = (T)INFINITY;                                                               \
            high[lane] = (T)-INFINITY;                                                             \
        }                                                                                          \
        for (; i + LANES <= end; i += LANES)                                                       \
            for (int lane = 0; lane < LANES; lane++) {                                             \
                const T x = v[i + (size_t)lane];                                                   \
                const T above = x >= -(MOST) ? x : (T)INFINITY;                                    \
                const T below = x <= (MOST) ? x : (T)-INFINITY;                                    \
                low[lane] = above < low[lane] ? above : low[lane];                                 \
                high[lane] = below > high[lane] ? below : high[lane];                              \
                finite[lane] += (N)(x >= -(MOST)) & (N)(x <= (MOST));                              \
            }                                                                                      \
        for (; i < end; i++)                                                                       \
            if (v[i] >= -(MOST) && v[i] <= (MOST)) {                                               \
                low[0] = v[i] < low[0] ? v[i] : low[0];                                            \
                high[0] = v[i] > high[0] ? v[i] : high[0];                                         \
                count++;                                                                           \
            }                                                                                      \
        for (int lane = 0; lane < LANES; lane++) {                                                 \
            p->low = (double)low[lane] < p->low ? (double)low[lane] : p->low;                      \
            p->high = (double)high[lane] > p->high ? (double)high[lane] : p->high;                 \
            count += (uint64_t)finite[lane];                                                       \
        }                                                                                          \
        p->finite += count;                                                                        \
    }
DEFINE_FINITE_RANGE(float, int32_t, FLT_MAX)
DEFINE_FINITE_RANGE(double, int64_t, DBL_MAX)

#define RANGE_OF(T) range_of_##T(m->voxels, begin, end, p)

static void measure_range(void *user, size_t begin, size_t end, unsigned worker) {
    const struct measure *m = user;
    struct partial *p = &m->partials[worker];
    if (begin >= end)
        return;
    switch (m->type) { SP_TYPE_CASES(RANGE_OF) }
}

/* Chooses one run of each `every`, which is a power of two, at a place that differs from group to
 * group: a period of the grid must not choose the same part of each row. */
static bool is_counted(const struct measure *m, size_t run) {
    const size_t group = run / m->every;
    return run % m->every == (group * UINT64_C(0x9E3779B97F4A7C15) >> 32) % m->every;
}

static void fill_bins(void *user, size_t begin, size_t end, unsigned worker) {
    const struct measure *m = user;
    uint64_t *bins = m->partials[worker].bins;
    const struct sp_bins range = sp_bins_between(m->low, m->high, SP_HISTOGRAM_BINS);
    double run[RUN];
    for (size_t at = begin; at < end; at += RUN) {
        size_t n = end - at < RUN ? end - at : RUN;
        if (!is_counted(m, at / RUN))
            continue;
        sp_samples_to_doubles(m->voxels, m->type, at, n, run);
        for (size_t i = 0; i < n; i++)
            if (run[i] >= m->low && run[i] <= m->high)
                bins[sp_bin_of(&range, run[i])] += m->every;
    }
}

/* Counts the samples of the value at one end, and finds its neighbour. */
static void count_extreme(void *user, size_t begin, size_t end, unsigned worker) {
    const struct measure *m = user;
    struct sp_extreme *e = &m->partials[worker].extreme;
    const double sign = m->side ? -1 : 1, least = m->side ? -m->high : m->low;
    double run[RUN], next = e->next;
    uint64_t count = 0;
    for (size_t at = begin; at < end; at += RUN) {
        size_t n = end - at < RUN ? end - at : RUN;
        sp_samples_to_doubles(m->voxels, m->type, at, n, run);
        for (size_t i = 0; i < n; i++) {
            const double value = sign * run[i];
            count += value == least;
            next = value > least && value < next ? value : next;
        }
    }
    e->next = next;
    e->count += count;
}

static void count_bins(const struct measure *m, uint64_t histogram[SP_HISTOGRAM_BINS]) {
    memset(histogram, 0, SP_HISTOGRAM_BINS * sizeof *histogram);
    for (unsigned t = 0; t < m->workers; t++)
        memset(m->partials[t].bins, 0, sizeof m->partials[t].bins);
    sp_parallel_for(m->pool, m->count, GRAIN, fill_bins, (void *)m);
    for (unsigned t = 0; t < m->workers; t++)
        for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
            histogram[b] += m->partials[t].bins[b];
}

/* Leaves out the value at one end if it stands for missing data. */
static bool drop_extreme(struct measure *m, int side, struct sp_volume_info *info) {
    if (!(m->high > m->low) || !sp_missing_is_likely(info->histogram, side))
        return false;
    m->side = side;
    for (unsigned t = 0; t < m->workers; t++)
        m->partials[t].extreme = (struct sp_extreme){ .next = INFINITY };
    sp_parallel_for(m->pool, m->count, GRAIN, count_extreme, m);
    struct sp_extreme e = { .value = side ? m->high : m->low,
                            .far = side ? m->low : m->high,
                            .next = INFINITY };
    for (unsigned t = 0; t < m->workers; t++) {
        e.count += m->partials[t].extreme.count;
        e.next = fmin(e.next, m->partials[t].extreme.next);
    }
    e.next *= side ? -1 : 1;
    if (!sp_missing_is(&e))
        return false;
    *(side ? &m->high : &m->low) = e.next;
    count_bins(m, info->histogram);
    sp_missing_note(info, e.value, e.count, m->count);
    return true;
}

/* Measures the range of all samples, the range of samples that stand for data, and the histogram of
 * the latter. */
static void measure_values(struct measure *m, struct sp_volume_info *info) {
    double low = INFINITY, high = -INFINITY;
    uint64_t finite = 0;
    for (unsigned t = 0; t < m->workers; t++)
        m->partials[t] = (struct partial){ .low = INFINITY, .high = -INFINITY };
    sp_parallel_for(m->pool, m->count, GRAIN, measure_range, m);
    for (unsigned t = 0; t < m->workers; t++) {
        low = fmin(low, m->partials[t].low);
        high = fmax(high, m->partials[t].high);
        finite += m->partials[t].finite;
    }
    m->low = info->range[0] = finite ? low : 0;
    m->high = info->range[1] = finite ? high : 0;
    info->nonfinite = m->count - finite;
    memset(info->histogram, 0, sizeof info->histogram);
    if (m->high > m->low)
        count_bins(m, info->histogram);
    else
        info->histogram[0] = finite; /* one value: all of it in the first bin */
    const int values_max = 4;        /* that stand for missing data */
    for (int i = 0; i < values_max && info->meaning != SP_MEANING_LABELS; i++)
        if (!drop_extreme(m, 0, info) && !drop_extreme(m, 1, info))
            break;
    info->data[0] = m->low;
    info->data[1] = m->high;
}

/* Few labels may be in few runs, so all of them are counted. */
static unsigned choose_every(const struct sp_volume_info *info, uint64_t count, uint64_t most) {
    unsigned every = 1;
    while (most && info->meaning != SP_MEANING_LABELS && every < EVERY_MAX && count / every > most)
        every *= 2;
    return every;
}

bool sp_volume_measure(struct sp_volume_info *info, const void *voxels, uint64_t count,
                       uint64_t most, struct sp_error *err) {
    assert(info->type < SP_TYPE_COUNT);
    uint64_t blocks = count / GRAIN + 1;
    struct measure m = { .voxels = voxels,
                         .type = info->type,
                         .every = choose_every(info, count, most),
                         .workers = sp_volume_threads(),
                         .count = count };
    if (m.workers > blocks)
        m.workers = (unsigned)blocks;
    m.partials = calloc(m.workers, sizeof *m.partials);
    if (!m.partials)
        return sp_fail(err, SP_ERR_MEMORY, info->source, "out of memory for the histogram");
    m.pool = sp_pool_create(m.workers, err);
    bool ok = m.pool != NULL;
    if (ok) {
        measure_values(&m, info);
        /* A coarse level says nothing about the noise of the finest one. */
        ok = info->elements.kind != SP_KIND_GRID || info->whole.dims[0] > 0 ||
             sp_noise_estimate(info, voxels, m.pool, &info->noise) ||
             sp_fail(err, SP_ERR_MEMORY, info->source, "out of memory for the estimate of noise");
    }
    sp_pool_destroy(&m.pool);
    free(m.partials);
    return ok;
}

struct lengths {
    const float (*vectors)[3];
    double *longest; /* by worker */
};

static double square_of(const float v[3]) {
    return (double)v[0] * v[0] + (double)v[1] * v[1] + (double)v[2] * v[2];
}

void sp_volume_lengths(const float (*vectors)[3], uint64_t count, float *lengths) {
    for (uint64_t i = 0; i < count; i++)
        lengths[i] = (float)sqrt(square_of(vectors[i]));
}

static void measure_longest(void *user, size_t begin, size_t end, unsigned worker) {
    const struct lengths *l = user;
    double longest = l->longest[worker];
    for (size_t i = begin; i < end; i++) {
        double square = square_of(l->vectors[i]);
        if (isfinite(square) && square > longest)
            longest = square;
    }
    l->longest[worker] = longest;
}

bool sp_volume_measure_vectors(const float (*vectors)[3], uint64_t count, double *longest,
                               struct sp_error *err) {
    struct sp_pool *pool = sp_pool_create(sp_volume_threads(), err);
    if (!pool)
        return false;
    double squares[THREADS_MAX] = { 0 };
    struct lengths lengths = { vectors, squares };
    sp_parallel_for(pool, count, GRAIN, measure_longest, &lengths);
    *longest = 0;
    for (int t = 0; t < THREADS_MAX; t++)
        *longest = fmax(*longest, sqrt(squares[t]));
    sp_pool_destroy(&pool);
    return true;
}
