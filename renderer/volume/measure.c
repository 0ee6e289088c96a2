/* SPDX-License-Identifier: Apache-2.0
 *
 * Range and histogram, in two passes, and the longest vector. Samples are widened to double in
 * short runs, so that one loop serves all types. Double represents every type exactly.
 */
#include <assert.h>
#include <math.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>

#include "base/parallel_for.h"
#include "volume/sample.h"
#include "volume/volume.h"

enum { RUN = 512, GRAIN = 1 << 18 }; /* samples */
enum { THREADS_MAX = 16 };           /* of sp_volume_threads() */

struct partial { /* of one worker; merged by sums, minima and maxima, so order has no influence */
    double low, high;
    uint64_t finite;
    uint64_t bins[SP_HISTOGRAM_BINS];
};

struct measure {
    const void *voxels;
    enum sp_type type;
    double low, half_span; /* half: the span of float64 may overflow */
    struct partial *partials;
};

unsigned sp_volume_threads(void) {
    cpu_set_t set;
    int n = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    return n < 1 ? 1 : n > THREADS_MAX ? THREADS_MAX : (unsigned)n;
}

#define WIDEN(T)                                                                                   \
    for (size_t i = 0; i < n; i++)                                                                 \
    out[i] = ((const T *)voxels)[begin + i]

void sp_samples_widen(const void *voxels, enum sp_type type, size_t begin, size_t n, double *out) {
    switch (type) {
    case SP_UINT8:
        WIDEN(uint8_t);
        break;
    case SP_INT8:
        WIDEN(int8_t);
        break;
    case SP_UINT16:
        WIDEN(uint16_t);
        break;
    case SP_INT16:
        WIDEN(int16_t);
        break;
    case SP_INT32:
        WIDEN(int32_t);
        break;
    case SP_FLOAT32:
        WIDEN(float);
        break;
    case SP_FLOAT64:
    case SP_TYPE_COUNT:
        memcpy(out, (const double *)voxels + begin, n * sizeof *out);
        break;
    }
}

static void find_range(void *user, size_t begin, size_t end, unsigned worker) {
    const struct measure *m = user;
    struct partial *p = &m->partials[worker];
    double run[RUN], low = p->low, high = p->high;
    uint64_t finite = 0;
    for (size_t at = begin; at < end; at += RUN) {
        size_t n = end - at < RUN ? end - at : RUN;
        sp_samples_widen(m->voxels, m->type, at, n, run);
        for (size_t i = 0; i < n; i++) {
            if (!isfinite(run[i]))
                continue;
            finite++;
            low = run[i] < low ? run[i] : low;
            high = run[i] > high ? run[i] : high;
        }
    }
    p->low = low;
    p->high = high;
    p->finite += finite;
}

static void fill_bins(void *user, size_t begin, size_t end, unsigned worker) {
    const struct measure *m = user;
    uint64_t *bins = m->partials[worker].bins;
    double run[RUN], half_low = m->low * 0.5;
    for (size_t at = begin; at < end; at += RUN) {
        size_t n = end - at < RUN ? end - at : RUN;
        sp_samples_widen(m->voxels, m->type, at, n, run);
        for (size_t i = 0; i < n; i++) {
            if (!isfinite(run[i]))
                continue;
            int bin = (int)((run[i] * 0.5 - half_low) / m->half_span * SP_HISTOGRAM_BINS);
            bins[bin < SP_HISTOGRAM_BINS ? bin : SP_HISTOGRAM_BINS - 1]++;
        }
    }
}

bool sp_volume_measure(struct sp_volume_info *info, const void *voxels, uint64_t count,
                       struct sp_error *err) {
    assert(info->type < SP_TYPE_COUNT);
    uint64_t blocks = count / GRAIN + 1;
    unsigned threads = sp_volume_threads();
    if (threads > blocks)
        threads = (unsigned)blocks;
    struct partial *partials = calloc(threads, sizeof *partials);
    if (!partials)
        return sp_fail(err, SP_ERR_MEMORY, info->source, "out of memory for the histogram");
    struct sp_pool *pool = sp_pool_create(threads, err);
    if (!pool) {
        free(partials);
        return false;
    }
    for (unsigned t = 0; t < threads; t++)
        partials[t] = (struct partial){ .low = INFINITY, .high = -INFINITY };
    struct measure m = { .voxels = voxels, .type = info->type, .partials = partials };
    sp_parallel_for(pool, count, GRAIN, find_range, &m);

    double low = INFINITY, high = -INFINITY;
    uint64_t finite = 0;
    for (unsigned t = 0; t < threads; t++) {
        low = fmin(low, partials[t].low);
        high = fmax(high, partials[t].high);
        finite += partials[t].finite;
    }
    memset(info->histogram, 0, sizeof info->histogram);
    info->nonfinite = count - finite;
    info->range[0] = finite ? low : 0;
    info->range[1] = finite ? high : 0;
    m.low = info->range[0];
    m.half_span = info->range[1] * 0.5 - info->range[0] * 0.5;
    if (m.half_span > 0) {
        sp_parallel_for(pool, count, GRAIN, fill_bins, &m);
        for (unsigned t = 0; t < threads; t++)
            for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
                info->histogram[b] += partials[t].bins[b];
    } else {
        info->histogram[0] = finite; /* one value: all of it in the first bin */
    }
    sp_pool_destroy(&pool);
    free(partials);
    return true;
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

static void find_longest(void *user, size_t begin, size_t end, unsigned worker) {
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
    sp_parallel_for(pool, count, GRAIN, find_longest, &lengths);
    *longest = 0;
    for (int t = 0; t < THREADS_MAX; t++)
        *longest = fmax(*longest, sqrt(squares[t]));
    sp_pool_destroy(&pool);
    return true;
}
