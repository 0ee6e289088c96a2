/* SPDX-License-Identifier: Apache-2.0 */
#include "import/neighbours.h"

#include <float.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/parallel_for.h"
#include "volume/curvilinear.h"
#include "volume/volume.h"

enum {
    NEIGHBOURS = 18,
    SHAPED = 6,      /* neighbours that tell the shape of the space around a point */
    LEAF = 12,       /* points of a range that is not divided */
    SUBTREES = 64,   /* that threads build on their own */
    GRAIN = 1 << 12, /* points */
};

/* Variance along an axis of a point and its neighbours in a cubic lattice of spacing 1: six are at
 * distance 1, twelve at √2. */
static const double lattice_variance = 10.0 / 19;

static const double thinnest = 0.1; /* of a kernel, in mean widths */

struct tree {
    float (*positions)[3];
    float *values;
    uint8_t *axes; /* axes[m] divides the range whose middle is m; owned */
    size_t count;  /* of finite points, which come first */
    double least;  /* spacing of points that coincide */
    const struct sp_elements *points;
    const struct import_progress *progress;
    uint64_t filled; /* bytes that the reader has filled */
    atomic_size_t done;
    struct range {
        size_t begin, end;
        float low[3], high[3];
    } subtrees[SUBTREES];
};

static void swap_points(struct tree *t, size_t a, size_t b) {
    float position[3], value = t->values[a];
    memcpy(position, t->positions[a], sizeof position);
    memcpy(t->positions[a], t->positions[b], sizeof position);
    memcpy(t->positions[b], position, sizeof position);
    t->values[a] = t->values[b];
    t->values[b] = value;
}

static bool is_finite(const float p[3]) {
    return isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]);
}

/* Moves points that are not finite behind the others and finds the box of all others. */
static void sort_out(struct tree *t, struct range *all) {
    *all = (struct range){ .begin = 0 };
    for (int a = 0; a < 3; a++) {
        all->low[a] = INFINITY;
        all->high[a] = -INFINITY;
    }
    for (size_t i = 0; i < t->count;) {
        if (!is_finite(t->positions[i])) {
            swap_points(t, i, --t->count);
            continue;
        }
        for (int a = 0; a < 3; a++) {
            all->low[a] = fminf(all->low[a], t->positions[i][a]);
            all->high[a] = fmaxf(all->high[a], t->positions[i][a]);
        }
        i++;
    }
    all->end = t->count;
}

/* Orders the range so that its middle is not less than those before and not greater than those
 * behind: quickselect (Hoare). The pivots look random, so that no file can make it slow. */
static void divide(struct tree *t, size_t begin, size_t end, int axis) {
    const int64_t middle = (int64_t)(begin + (end - begin) / 2);
    int64_t low = (int64_t)begin, high = (int64_t)end - 1;
    uint64_t seed = begin * UINT64_C(0x9e3779b97f4a7c15) + end;
    while (low < high) {
        seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
        const float pivot =
            t->positions[low + (int64_t)((seed >> 33) % (uint64_t)(high - low + 1))][axis];
        int64_t i = low, j = high;
        while (i <= j) {
            while (t->positions[i][axis] < pivot)
                i++;
            while (t->positions[j][axis] > pivot)
                j--;
            if (i <= j)
                swap_points(t, (size_t)i++, (size_t)j--);
        }
        if (middle <= j)
            high = j;
        else if (middle >= i)
            low = i;
        else
            return; /* between both parts: equal to the pivot */
    }
}

/* Divides a range of more than LEAF points across the longest side of its box. */
static void split(struct tree *t, const struct range *all, struct range parts[2]) {
    const size_t middle = all->begin + (all->end - all->begin) / 2;
    int axis = 0;
    for (int a = 1; a < 3; a++)
        if (all->high[a] - all->low[a] > all->high[axis] - all->low[axis])
            axis = a;
    divide(t, all->begin, all->end, axis);
    t->axes[middle] = (uint8_t)axis;
    parts[0] = parts[1] = *all;
    parts[0].end = middle;
    parts[1].begin = middle + 1;
    parts[0].high[axis] = parts[1].low[axis] = t->positions[middle][axis];
}

static void build(struct tree *t, const struct range *all) {
    struct range parts[2];
    if (all->end - all->begin <= LEAF)
        return;
    split(t, all, parts);
    build(t, &parts[0]);
    build(t, &parts[1]);
}

static void build_subtrees(void *user, size_t begin, size_t end, unsigned worker) {
    struct tree *t = user;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        build(t, &t->subtrees[i]);
}

/* One thread divides the first levels. */
static void build_all(struct tree *t, struct sp_pool *pool) {
    struct range parts[2];
    size_t n = 1;
    while (n < SUBTREES) {
        for (size_t i = n; i-- > 0;) {
            if (t->subtrees[i].end - t->subtrees[i].begin > LEAF)
                split(t, &t->subtrees[i], parts);
            else {
                parts[0] = parts[1] = t->subtrees[i];
                parts[1].begin = parts[1].end;
            }
            t->subtrees[2 * i + 1] = parts[1];
            t->subtrees[2 * i] = parts[0];
        }
        n *= 2;
    }
    sp_parallel_for(pool, SUBTREES, 1, build_subtrees, t);
}

struct search { /* for the neighbours of one point */
    const float (*positions)[3];
    const uint8_t *axes;
    const float *point;
    float offset[3]; /* from the point to the range that is visited, along each axis */
    unsigned found;
    float distances[NEIGHBOURS]; /* squared; they rise */
    const float *neighbours[NEIGHBOURS];
};

static void consider(struct search *s, const float *other) {
    float square = 0;
    for (int a = 0; a < 3; a++)
        square += (other[a] - s->point[a]) * (other[a] - s->point[a]);
    unsigned i = s->found;
    if (i == NEIGHBOURS) {
        if (!(square < s->distances[NEIGHBOURS - 1]))
            return;
        i--;
    } else {
        s->found++;
    }
    for (; i > 0 && s->distances[i - 1] > square; i--) {
        s->distances[i] = s->distances[i - 1];
        s->neighbours[i] = s->neighbours[i - 1];
    }
    s->distances[i] = square;
    s->neighbours[i] = other;
}

/* Visits the points of a range at the given squared distance, the nearer half first. */
static void visit(struct search *s, size_t begin, size_t end, float square) {
    if (end - begin <= LEAF) {
        for (size_t i = begin; i < end; i++)
            if (s->positions[i] != s->point)
                consider(s, s->positions[i]);
        return;
    }
    const size_t middle = begin + (end - begin) / 2;
    const int axis = s->axes[middle];
    const float beyond = s->positions[middle][axis] - s->point[axis], before = s->offset[axis];
    const bool low_first = beyond > 0;
    if (low_first)
        visit(s, begin, middle, square);
    else
        visit(s, middle + 1, end, square);
    square += beyond * beyond - before * before;
    if (s->found == NEIGHBOURS && square >= s->distances[NEIGHBOURS - 1])
        return;
    if (s->positions[middle] != s->point)
        consider(s, s->positions[middle]);
    s->offset[axis] = beyond;
    if (low_first)
        visit(s, middle + 1, end, square);
    else
        visit(s, begin, middle, square);
    s->offset[axis] = before;
}

/* The covariance of the point and its neighbours around their centre; returns the mean variance. */
static double covariance(const struct search *s, double c[3][3]) {
    double sum[3] = { 0 }, n = s->found + 1.0;
    memset(c, 0, 9 * sizeof c[0][0]);
    for (unsigned k = 0; k < s->found; k++) {
        double d[3];
        for (int a = 0; a < 3; a++) {
            d[a] = (double)s->neighbours[k][a] - (double)s->point[a];
            sum[a] += d[a];
        }
        for (int i = 0; i < 3; i++)
            for (int j = 0; j <= i; j++)
                c[i][j] += d[i] * d[j];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j <= i; j++)
            c[i][j] = (c[i][j] - sum[i] * sum[j] / n) / n;
    return (c[0][0] + c[1][1] + c[2][2]) / 3;
}

/* Cholesky. No number on the diagonal becomes smaller than `least`. */
static void factor(const double c[3][3], double least, float out[6]) {
    double l[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j <= i; j++) {
            double rest = c[i][j];
            for (int k = 0; k < j; k++)
                rest -= l[i][k] * l[j][k];
            l[i][j] = i == j ? sqrt(fmax(rest, least * least)) : rest / l[j][j];
            *out++ = (float)l[i][j];
        }
}

static void set_size(const struct tree *t, size_t i, const struct search *s) {
    const struct sp_elements *points = t->points;
    double c[3][3], mean = covariance(s, c) / lattice_variance;
    double nearest = s->found ? fmin((double)s->distances[0], mean) : mean;
    double spacing = sqrt(mean + 0.1 * (mean - nearest));
    if (!(spacing > t->least) || !isfinite(spacing))
        spacing = t->least;
    for (int row = 0; row < 3 && s->found < SHAPED; row++)
        for (int column = 0; column <= row; column++)
            c[row][column] = row == column ? mean * lattice_variance : 0;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column <= row; column++)
            c[row][column] *= SP_CURVILINEAR_SIGMA * SP_CURVILINEAR_SIGMA / lattice_variance;
    const double width = SP_CURVILINEAR_SIGMA * spacing;
    factor((const double(*)[3])c, s->found ? thinnest * width : width, points->factors[i]);
    const double volume = spacing * spacing * spacing;
    points->volumes[i] = (float)fmin(fmax(volume, (double)FLT_MIN), (double)FLT_MAX);
}

static void set_sizes(void *user, size_t begin, size_t end, unsigned worker) {
    struct tree *t = user;
    for (size_t i = begin; i < end; i++) {
        struct search s = { .positions = (const float(*)[3])t->positions,
                            .axes = t->axes,
                            .point = t->positions[i] };
        if (i < t->count)
            visit(&s, 0, t->count, 0);
        set_size(t, i, &s);
    }
    size_t done = atomic_fetch_add_explicit(&t->done, end - begin, memory_order_relaxed);
    if (worker == 0) /* the thread that may report */
        import_report(t->progress, t->filled + done * 7 * sizeof(float));
}

bool import_neighbours_finish(const struct sp_elements *points,
                              const struct import_progress *progress, struct sp_error *err) {
    struct tree *t = calloc(1, sizeof *t);
    uint8_t *axes = malloc((size_t)points->shape.count + 1);
    struct sp_pool *pool = t && axes ? sp_pool_create(sp_volume_threads(), err) : NULL;
    if (pool) {
        *t = (struct tree){ .positions = points->positions,
                            .values = points->values,
                            .axes = axes,
                            .count = points->shape.count,
                            .points = points,
                            .progress = progress,
                            .filled = 4 * sizeof(float) * (uint64_t)points->shape.count };
        sort_out(t, &t->subtrees[0]);
        double diagonal = 0;
        for (int a = 0; a < 3 && t->count; a++)
            diagonal =
                hypot(diagonal, (double)t->subtrees[0].high[a] - (double)t->subtrees[0].low[a]);
        t->least = diagonal > 0 ? 1e-6 * diagonal : 1;
        build_all(t, pool);
        sp_parallel_for(pool, points->shape.count, GRAIN, set_sizes, t);
    } else if (!t || !axes) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the neighbours of points");
    }
    bool ok = pool != NULL;
    sp_pool_destroy(&pool);
    free(axes);
    free(t);
    return ok;
}
