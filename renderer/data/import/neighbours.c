/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/neighbours.h"

#include <float.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/nearest.h"
#include "data/volume/curvilinear.h"
#include "data/volume/volume.h"

enum {
    SHAPED = 6,      /* neighbours that tell the shape of the space around a point */
    GRAIN = 1 << 12, /* points */
};

/* Variance along an axis of a point and its neighbours in a cubic lattice of spacing 1: six are at
 * distance 1, twelve at √2. */
static const double lattice_variance = 10.0 / 19;

static const double thinnest = 0.1; /* of a kernel, in mean widths */

/* Of the work after reading, what the tree takes; its neighbours take the rest. */
static const double tree_share = 0.3;

struct sizes {
    struct import_nearest_tree tree; /* of finite points, one per place */
    const struct sp_elements *points;
    double least;       /* spacing of points that have no neighbours */
    atomic_bool shares; /* some have a neighbour at their place */
    bool is_separate;   /* these have left the tree */
    /* Points that lie at the place of a point of the tree; they come after all points of the tree.
     */
    size_t twin_count;
    uint32_t *places; /* [twin_count] the point of the tree; owned */
    uint32_t *copies; /* [tree.count] points at its place besides; owned */
    struct sp_pool *pool;
    const struct import_progress *progress;
    uint64_t begin, end; /* bytes to report at the begin and the end of the search */
    atomic_size_t done;  /* points */
};

static bool is_finite(const float p[3]) {
    return isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]);
}

/* Moves points that are not finite after the others. Returns the diagonal of the box of all
 * others. */
static double sort_out(struct sizes *s) {
    const struct sp_elements *e = s->points;
    double diagonal = 0;
    float low[3], high[3];
    size_t count = e->shape.count;
    for (int a = 0; a < 3; a++) {
        low[a] = INFINITY;
        high[a] = -INFINITY;
    }
    for (size_t i = 0; i < count;) {
        if (!is_finite(e->positions[i])) {
            import_nearest_swap(&s->tree, i, --count);
            continue;
        }
        for (int a = 0; a < 3; a++) {
            low[a] = fminf(low[a], e->positions[i][a]);
            high[a] = fmaxf(high[a], e->positions[i][a]);
        }
        i++;
    }
    s->tree.count = count;
    for (int a = 0; a < 3 && count; a++)
        diagonal = hypot(diagonal, (double)high[a] - (double)low[a]);
    return diagonal;
}

/* The covariance of the point and its neighbours around their centre; returns the mean variance. */
static double covariance(const float point[3], const struct import_nearest *near, double c[3][3]) {
    double sum[3] = { 0 }, n = near->found + 1.0;
    memset(c, 0, 9 * sizeof c[0][0]);
    for (unsigned k = 0; k < near->found; k++) {
        double d[3];
        for (int a = 0; a < 3; a++) {
            d[a] = (double)near->neighbours[k][a] - (double)point[a];
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

static void set_size(void *user, size_t i, const struct import_nearest *near) {
    struct sizes *s = user;
    const struct sp_elements *points = s->points;
    double c[3][3], mean = covariance(points->positions[i], near, c) / lattice_variance;
    double nearest = fmin((double)near->square, mean);
    double spacing = sqrt(mean + 0.1 * (mean - nearest));
    if (!(spacing > s->least) || !isfinite(spacing))
        spacing = s->least;
    for (int row = 0; row < 3 && near->found < SHAPED; row++)
        for (int column = 0; column <= row; column++)
            c[row][column] = row == column ? mean * lattice_variance : 0;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column <= row; column++)
            c[row][column] *= SP_CURVILINEAR_SIGMA * SP_CURVILINEAR_SIGMA / lattice_variance;
    const double width = SP_CURVILINEAR_SIGMA * spacing;
    factor((const double(*)[3])c, near->found ? thinnest * width : width, points->factors[i]);
    const double volume = spacing * spacing * spacing;
    points->volumes[i] = (float)fmin(fmax(volume, (double)FLT_MIN), (double)FLT_MAX);
    if (near->square == 0 && !s->is_separate) {
        points->volumes[i] = 0; /* separate_twins() looks for it */
        atomic_store_explicit(&s->shares, true, memory_order_relaxed);
    }
}

static void report(void *user, size_t points, unsigned worker) {
    struct sizes *s = user;
    const size_t done = points + atomic_fetch_add_explicit(&s->done, points, memory_order_relaxed);
    if (worker == 0 && done > 0) /* the thread that may report */
        import_report(s->progress, s->begin + (uint64_t)((double)(s->end - s->begin) *
                                                         (double)done / (double)s->tree.count));
}

/* Measures the sizes of the points of the tree. Reports until `end`. */
static bool measure_sizes(struct sizes *s, uint64_t end) {
    const struct import_nearest_visitor visitor = { set_size, report, s };
    s->begin = s->end + (uint64_t)(tree_share * (double)(end - s->end));
    s->end = end;
    s->done = 0;
    if (!import_nearest_build(&s->tree, s->pool))
        return false;
    import_report(s->progress, s->begin);
    import_nearest_each(&s->tree, s->pool, &visitor);
    return true;
}

/* A point and its value, as separate_twins() sorts them. */
struct placed {
    float position[3], value;
};

static int compare_places(const void *a, const void *b) {
    const struct placed *p = a, *q = b;
    for (int k = 0; k < 4; k++) {
        const float x = k < 3 ? p->position[k] : p->value, y = k < 3 ? q->position[k] : q->value;
        if (x < y || x > y)
            return x < y ? -1 : 1;
    }
    return 0;
}

/* Zeros of both signs are the same. */
static bool is_same(const float a[3], const float b[3]) {
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* Moves the points that share their place after the others, but for one of each place. */
static void separate_twins(struct sizes *s) {
    const struct sp_elements *e = s->points;
    size_t alone = s->tree.count, kept;
    for (size_t i = 0; i < alone;)
        if (e->volumes[i] > 0)
            i++;
        else {
            alone--;
            e->volumes[i] = e->volumes[alone];
            import_nearest_swap(&s->tree, i, alone);
        }
    const size_t count = s->tree.count - alone;
    struct placed *sorted = (void *)e->factors[alone]; /* which are found again */
    for (size_t i = 0; i < count; i++) {
        memcpy(sorted[i].position, e->positions[alone + i], sizeof sorted[i].position);
        sorted[i].value = e->values[alone + i];
    }
    qsort(sorted, count, sizeof *sorted, compare_places);
    kept = alone;
    for (size_t i = 0, last = alone + count; i < count; i++) {
        const bool is_first = i == 0 || !is_same(sorted[i].position, sorted[i - 1].position);
        const size_t to = is_first ? kept++ : --last;
        memcpy(e->positions[to], sorted[i].position, sizeof sorted[i].position);
        e->values[to] = sorted[i].value;
    }
    s->twin_count = s->tree.count - kept;
    s->tree.count = kept;
    s->is_separate = true;
}

static void fill_places(void *user, size_t begin, size_t end, unsigned worker) {
    struct sizes *s = user;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        s->places[i] =
            (uint32_t)import_nearest_at(&s->tree, s->points->positions[s->tree.count + i]);
}

/* Points at one place share the space around it. */
static void share(struct sizes *s) {
    const struct sp_elements *e = s->points;
    sp_parallel_for(s->pool, s->twin_count, GRAIN, fill_places, s);
    for (size_t i = 0; i < s->twin_count; i++)
        s->copies[s->places[i]]++;
    for (size_t i = 0; i < s->tree.count; i++)
        if (s->copies[i])
            e->volumes[i] = fmaxf(e->volumes[i] / (float)(s->copies[i] + 1), FLT_MIN);
    for (size_t i = 0; i < s->twin_count; i++) {
        const size_t twin = s->tree.count + i;
        e->volumes[twin] = e->volumes[s->places[i]];
        memcpy(e->factors[twin], e->factors[s->places[i]], sizeof e->factors[twin]);
    }
}

/* Sizes of the finite points, and of the others. */
static bool measure_all(struct sizes *s) {
    const struct sp_elements *e = s->points;
    const uint64_t count = e->shape.count, all = 11 * sizeof(float) * count;
    const struct import_nearest none = { .square = INFINITY };
    bool ok = measure_sizes(s, all);
    if (ok && s->shares) {
        s->end = 4 * sizeof(float) * count;
        import_nearest_finish(&s->tree);
        separate_twins(s);
        ok = measure_sizes(s, all);
        s->places = malloc((s->twin_count + 1) * sizeof *s->places);
        s->copies = calloc(s->tree.count + 1, sizeof *s->copies);
        ok = ok && s->places && s->copies;
        if (ok)
            share(s);
        free(s->places);
        free(s->copies);
    }
    for (size_t i = s->tree.count + s->twin_count; i < count; i++)
        set_size(s, i, &none);
    return ok;
}

bool import_neighbours_finish(const struct sp_elements *points,
                              const struct import_progress *progress, struct sp_error *err) {
    struct sizes s = { .tree = { .positions = points->positions, .values = points->values },
                       .points = points,
                       .progress = progress,
                       .end = 4 * sizeof(float) * (uint64_t)points->shape.count };
    s.pool = sp_pool_create(sp_volume_threads(), err);
    bool ok = s.pool != NULL;
    if (ok) {
        const double diagonal = sort_out(&s);
        s.least = diagonal > 0 ? 1e-6 * diagonal : 1;
        ok = measure_all(&s);
    }
    if (s.pool && !ok)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the neighbours of points");
    sp_pool_destroy(&s.pool);
    import_nearest_finish(&s.tree);
    return ok;
}
