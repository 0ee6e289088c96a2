/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/nearest.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/minmax.h"

enum {
    LEAF = 16,    /* points of a range that is not divided */
    LEVELS = 10,  /* which make 2^LEVELS ranges, the work of one thread each */
    SEEDS = 24,   /* at least, around a leaf */
    NEAR = 1024,  /* candidates for the neighbours of a leaf; if there are more, its points are
                     searched for one by one */
    PADDING = 16, /* of arrays, so that loops go through whole vectors */
};

struct range {
    size_t begin, end;
    size_t node;
    float low[3], high[3];
};

/* While a tree is built: the ranges of one level and of the next one. */
struct build {
    struct import_nearest_tree *tree;
    struct range ranges[2][1 << LEVELS];
    int from; /* which of both is divided */
};

/* Of the reach of a group, squared. */
static const float slack = 1.25f;

static size_t middle_of(size_t begin, size_t end) {
    return begin + (end - begin) / 2;
}

void import_nearest_swap(const struct import_nearest_tree *t, size_t a, size_t b) {
    float position[3], value = t->values[a];
    memcpy(position, t->positions[a], sizeof position);
    memcpy(t->positions[a], t->positions[b], sizeof position);
    memcpy(t->positions[b], position, sizeof position);
    t->values[a] = t->values[b];
    t->values[b] = value;
}

/* Orders the range so that its middle point is not less than the points before it and not greater
 * than those behind it: quickselect (Hoare). The pivots look random, so that no file
 * can make it slow. */
static void divide(struct import_nearest_tree *t, size_t begin, size_t end, int axis) {
    const int64_t middle = (int64_t)middle_of(begin, end);
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
                import_nearest_swap(t, (size_t)i++, (size_t)j--);
        }
        if (middle <= j)
            high = j;
        else if (middle >= i)
            low = i;
        else
            return; /* between both parts: equal to the pivot */
    }
}

/* Divides a range across the longest side of its box; one that is a leaf stays whole, and the other
 * part is empty. */
static void split(struct import_nearest_tree *t, const struct range *all, struct range parts[2]) {
    parts[0] = parts[1] = *all;
    parts[0].node = 2 * all->node;
    parts[1].node = 2 * all->node + 1;
    if (all->end - all->begin <= LEAF) {
        parts[1].begin = parts[1].end;
        return;
    }
    const size_t middle = middle_of(all->begin, all->end);
    int axis = 0;
    for (int a = 1; a < 3; a++)
        if (all->high[a] - all->low[a] > all->high[axis] - all->low[axis])
            axis = a;
    divide(t, all->begin, all->end, axis);
    const float plane = t->positions[middle][axis];
    t->planes[all->node] = (struct import_nearest_plane){ plane, axis };
    parts[0].end = parts[1].begin = middle;
    parts[0].high[axis] = parts[1].low[axis] = plane;
}

static void split_all(struct import_nearest_tree *t, const struct range *all) {
    struct range parts[2];
    if (all->end - all->begin <= LEAF)
        return;
    split(t, all, parts);
    split_all(t, &parts[0]);
    split_all(t, &parts[1]);
}

static void split_level(void *user, size_t begin, size_t end, unsigned worker) {
    struct build *b = user;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        split(b->tree, &b->ranges[b->from][i], &b->ranges[!b->from][2 * i]);
}

static void split_rest(void *user, size_t begin, size_t end, unsigned worker) {
    struct build *b = user;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        split_all(b->tree, &b->ranges[b->from][i]);
}

static void compute_box(const struct import_nearest_tree *t, struct range *r) {
    for (int a = 0; a < 3; a++) {
        r->low[a] = INFINITY;
        r->high[a] = -INFINITY;
    }
    for (size_t i = r->begin; i < r->end; i++)
        for (int a = 0; a < 3; a++) {
            r->low[a] = sp_minf(r->low[a], t->positions[i][a]);
            r->high[a] = sp_maxf(r->high[a], t->positions[i][a]);
        }
}

bool import_nearest_build(struct import_nearest_tree *tree, struct sp_pool *pool) {
    size_t nodes = 2;
    while (tree->count / nodes >= LEAF / 2) /* the larger half of any range rounds up */
        nodes *= 2;
    struct build *b = malloc(sizeof *b);
    tree->planes = malloc(nodes * sizeof *tree->planes);
    if (!b || !tree->planes) {
        free(b);
        return false;
    }
    b->tree = tree;
    b->from = 0;
    b->ranges[0][0] = (struct range){ .begin = 0, .end = tree->count, .node = 1 };
    compute_box(tree, &b->ranges[0][0]);
    for (int level = 0; level < LEVELS; level++) {
        sp_parallel_for(pool, (size_t)1 << level, 1, split_level, b);
        b->from = !b->from;
    }
    sp_parallel_for(pool, (size_t)1 << LEVELS, 1, split_rest, b);
    free(b);
    return true;
}

void import_nearest_finish(struct import_nearest_tree *tree) {
    free(tree->planes);
    tree->planes = NULL;
}

/* One by one. */
struct search {
    const struct import_nearest_tree *tree;
    const float *point;
    float offset[3]; /* from the point to the range that is visited, along each axis */
    float distances[IMPORT_NEAREST]; /* squared; they rise */
    struct import_nearest nearest;
};

static void consider(struct search *s, const float *other) {
    float square = 0;
    for (int a = 0; a < 3; a++)
        square += (other[a] - s->point[a]) * (other[a] - s->point[a]);
    unsigned i = s->nearest.found;
    if (i == IMPORT_NEAREST) {
        if (!(square < s->distances[IMPORT_NEAREST - 1]))
            return;
        i--;
    } else {
        s->nearest.found++;
    }
    for (; i > 0 && s->distances[i - 1] > square; i--) {
        s->distances[i] = s->distances[i - 1];
        s->nearest.neighbours[i] = s->nearest.neighbours[i - 1];
    }
    s->distances[i] = square;
    s->nearest.neighbours[i] = other;
}

/* Visits the points of a range at the given squared distance, the nearer half first. */
static void search_range(struct search *s, size_t node, size_t begin, size_t end, float square) {
    const struct import_nearest_tree *t = s->tree;
    if (end - begin <= LEAF) {
        for (size_t i = begin; i < end; i++)
            if (t->positions[i] != s->point)
                consider(s, t->positions[i]);
        return;
    }
    const size_t middle = middle_of(begin, end);
    const struct import_nearest_plane plane = t->planes[node];
    const float beyond = plane.at - s->point[plane.axis], before = s->offset[plane.axis];
    const bool low_first = beyond > 0;
    for (int i = 0; i < 2; i++) {
        if (low_first == (i == 0))
            search_range(s, 2 * node, begin, middle, square);
        else
            search_range(s, 2 * node + 1, middle, end, square);
        square += beyond * beyond - before * before;
        if (i == 0 && s->nearest.found == IMPORT_NEAREST &&
            square >= s->distances[IMPORT_NEAREST - 1])
            return;
        s->offset[plane.axis] = i == 0 ? beyond : before;
    }
}

static void search_one(const struct import_nearest_tree *t, size_t point,
                       const struct import_nearest_visitor *visitor) {
    struct search s = { .tree = t, .point = t->positions[point] };
    search_range(&s, 1, 0, t->count, 0);
    s.nearest.square = s.nearest.found ? s.distances[0] : INFINITY;
    visitor->visit(visitor->user, point, &s.nearest);
}

/* The search for all points of a leaf at once. Arrays end with PADDING extra numbers, so that whole
 * vectors can be read. */
struct group {
    const struct import_nearest_tree *tree;
    struct range leaf;              /* its box is that of its points */
    float reach;                    /* square of the distance within which all neighbours are */
    float offset[3];                /* from the leaf to the range that is visited */
    float middle[3], half[3];       /* of its box */
    size_t count;                   /* of candidates; more than NEAR: too many */
    size_t own;                     /* where the leaf's points are among them */
    float at[3][NEAR + PADDING];    /* of candidates */
    float squares[NEAR + PADDING];  /* distances of the point that is searched for */
    uint32_t index[NEAR + PADDING]; /* of candidates, then of those within its reach */
    float near[NEAR + PADDING];
    uint32_t near_index[NEAR + PADDING];
};

/* Computes a bound with at least k of the `count` squares: with exactly k if no others are equal to
 * the k-th. `high` is such a bound. */
static float compute_bound(const float *squares, size_t count, unsigned k, float high) {
    float low = 0;
    unsigned zeros = 0;
    for (size_t i = 0; i < count; i++)
        zeros += squares[i] <= 0;
    if (zeros >= k) /* halving ends above zero, which would be beyond more than k of them */
        return 0;
    for (;;) {
        const float middle = 0.5f * (low + high);
        if (!(middle > low && middle < high))
            return high;
        unsigned below = 0;
        for (size_t i = 0; i < count; i++)
            below += squares[i] <= middle;
        if (below >= k)
            high = middle;
        else
            low = middle;
        if (below == k)
            return high;
    }
}

/* Returns an upper bound of the distance of a point's neighbours: there are as many seeds within
 * it. */
static float measure_reach(const struct import_nearest_tree *t, size_t point, size_t begin,
                           size_t end) {
    float squares[2 * SEEDS], high = 0;
    for (size_t i = begin; i < end; i++) {
        float square = 0;
        for (int a = 0; a < 3; a++)
            square += (t->positions[i][a] - t->positions[point][a]) *
                      (t->positions[i][a] - t->positions[point][a]);
        squares[i - begin] = square;
        high = sp_maxf(high, square);
    }
    return compute_bound(squares, end - begin, IMPORT_NEAREST + 1, high); /* the point is one */
}

/* Adds the points of a leaf of the tree that are within reach. */
static void add_candidates(struct group *g, size_t begin, size_t end) {
    if (g->count + (end - begin) > NEAR) {
        g->count = NEAR + 1;
        return;
    }
    if (begin == g->leaf.begin)
        g->own = g->count;
    const bool is_own = begin == g->leaf.begin;
    const size_t first = g->count, count = end - begin;
    float squares[LEAF] = { 0 };
    for (int a = 0; a < 3; a++) {
        float *at = g->at[a] + first;
        for (size_t i = 0; i < count; i++)
            at[i] = g->tree->positions[begin + i][a];
        for (size_t i = 0; i < LEAF; i++) { /* without a branch */
            const float beyond = fabsf(at[i] - g->middle[a]) - g->half[a];
            const float twice = beyond + fabsf(beyond);
            squares[i] += 0.25f * twice * twice;
        }
    }
    for (size_t i = 0; i < count; i++) {
        const size_t to = g->count;
        for (int a = 0; a < 3; a++)
            g->at[a][to] = g->at[a][first + i];
        g->index[to] = (uint32_t)(begin + i);
        g->count += (squares[i] <= g->reach) | is_own;
    }
}

/* Collects candidates from a range, whose box has the given squared distance. */
static void collect(struct group *g, size_t node, size_t begin, size_t end, float square) {
    if (end - begin <= LEAF) {
        if (g->count <= NEAR)
            add_candidates(g, begin, end);
        return;
    }
    const size_t middle = middle_of(begin, end);
    const struct import_nearest_plane plane = g->tree->planes[node];
    const int axis = plane.axis;
    const float before = g->offset[axis];
    const float aways[2] = { sp_maxf(g->leaf.low[axis] - plane.at, 0),
                             sp_maxf(plane.at - g->leaf.high[axis], 0) };
    for (int side = 0; side < 2; side++) {
        const float away = sp_maxf(aways[side], before);
        const float there = square + away * away - before * before;
        if (there > g->reach)
            continue;
        g->offset[axis] = away;
        collect(g, 2 * node + (size_t)side, side ? middle : begin, side ? end : middle, there);
        g->offset[axis] = before;
    }
}

/* Of the points at the distance of the bound, those are neighbours that lie nearest in the tree: on
 * the border of a lattice they keep the size of its points. */
static void choose_equal(const struct group *g, size_t point, size_t count, float bound,
                         uint32_t *chosen, unsigned found) {
    size_t above = 0;
    while (above < count && g->near_index[above] < point)
        above++;
    for (size_t below = above; found < IMPORT_NEAREST && (below > 0 || above < count);) {
        const bool is_below = below > 0 && (above == count || point - g->near_index[below - 1] <
                                                                  g->near_index[above] - point);
        const size_t at = is_below ? --below : above++;
        if (g->near[at] == bound)
            chosen[found++] = g->near_index[at];
    }
}

/* Finds the neighbours of point `own` of the leaf. False if there are fewer within `reach`. */
static bool find_neighbours(struct group *g, size_t own, float reach, struct import_nearest *n) {
    const float *p = g->tree->positions[g->leaf.begin + own];
    const float x = p[0], y = p[1], z = p[2];
    size_t count = 0;
    for (size_t i = 0; i < g->count; i++) {
        const float dx = g->at[0][i] - x, dy = g->at[1][i] - y, dz = g->at[2][i] - z;
        g->squares[i] = dx * dx + dy * dy + dz * dz;
    }
    g->squares[g->own + own] = INFINITY;
    for (size_t i = 0; i < g->count; i++) {
        g->near[count] = g->squares[i];
        g->near_index[count] = g->index[i];
        count += g->squares[i] <= reach;
    }
    if (count < IMPORT_NEAREST)
        return false;
    const float bound = compute_bound(g->near, count, IMPORT_NEAREST, reach);
    uint32_t chosen[IMPORT_NEAREST + 1];
    unsigned found = 0;
    float square = reach;
    for (size_t i = 0; i < count; i++) {
        chosen[found] = g->near_index[i];
        found += g->near[i] < bound;
        square = sp_minf(square, g->near[i]);
    }
    if (found < IMPORT_NEAREST)
        choose_equal(g, g->leaf.begin + own, count, bound, chosen, found);
    for (unsigned i = 0; i < IMPORT_NEAREST; i++)
        n->neighbours[i] = g->tree->positions[chosen[i]];
    n->found = IMPORT_NEAREST;
    n->square = square;
    return true;
}

static void search_group(struct group *g, const struct range *seeds,
                         const struct import_nearest_visitor *visitor) {
    const struct import_nearest_tree *t = g->tree;
    const size_t points = g->leaf.end - g->leaf.begin;
    float reaches[LEAF] = { 0 };
    bool has_seeds = seeds->end - seeds->begin > IMPORT_NEAREST;
    float least_reach = INFINITY;
    for (size_t i = 0; i < points && has_seeds; i++) {
        reaches[i] = measure_reach(t, g->leaf.begin + i, seeds->begin, seeds->end);
        least_reach = sp_minf(least_reach, reaches[i]);
    }
    /* A reach that suits its most crowded point suits most of the others. */
    g->reach = slack * least_reach;
    compute_box(t, &g->leaf);
    for (int a = 0; a < 3; a++) {
        g->middle[a] = 0.5f * (g->leaf.low[a] + g->leaf.high[a]);
        g->half[a] = 0.5f * (g->leaf.high[a] - g->leaf.low[a]);
    }
    memset(g->offset, 0, sizeof g->offset);
    g->count = 0;
    if (has_seeds)
        collect(g, 1, 0, t->count, 0);
    for (size_t i = 0; i < points; i++) {
        struct import_nearest n;
        if (has_seeds && g->count <= NEAR && g->reach < INFINITY &&
            find_neighbours(g, i, sp_minf(reaches[i], g->reach), &n))
            visitor->visit(visitor->user, g->leaf.begin + i, &n);
        else
            search_one(t, g->leaf.begin + i, visitor);
    }
}

/* Searches for the points of a range. `seeds`: the smallest range around it with SEEDS points. */
static void search_leaves(struct group *g, size_t begin, size_t end, struct range seeds,
                          const struct import_nearest_visitor *visitor) {
    if (end - begin >= SEEDS)
        seeds = (struct range){ .begin = begin, .end = end };
    if (end - begin > LEAF) {
        const size_t middle = middle_of(begin, end);
        search_leaves(g, begin, middle, seeds, visitor);
        search_leaves(g, middle, end, seeds, visitor);
    } else if (end > begin) {
        g->leaf.begin = begin;
        g->leaf.end = end;
        search_group(g, &seeds, visitor);
    }
}

struct each {
    const struct import_nearest_tree *tree;
    const struct import_nearest_visitor *visitor;
};

/* Range i of the last of LEVELS levels. */
static void search_ranges(void *user, size_t first, size_t last, unsigned worker) {
    const struct each *each = user;
    struct group g; /* on the stack: 33 KB */
    g.tree = each->tree;
    for (size_t i = first; i < last; i++) {
        size_t begin = 0, end = each->tree->count;
        struct range seeds = { .begin = begin, .end = end };
        for (int level = LEVELS; level-- > 0;) {
            if (end - begin >= SEEDS)
                seeds = (struct range){ .begin = begin, .end = end };
            const bool is_above = i >> level & 1;
            const size_t middle = end - begin > LEAF ? middle_of(begin, end) : end;
            begin = is_above ? middle : begin;
            end = is_above ? end : middle;
        }
        search_leaves(&g, begin, end, seeds, each->visitor);
        each->visitor->report(each->visitor->user, end - begin, worker);
    }
}

void import_nearest_each(const struct import_nearest_tree *tree, struct sp_pool *pool,
                         const struct import_nearest_visitor *visitor) {
    struct each each = { tree, visitor };
    sp_parallel_for(pool, (size_t)1 << LEVELS, 1, search_ranges, &each);
}

static size_t find_at(const struct import_nearest_tree *t, size_t node, size_t begin, size_t end,
                      const float position[3]) {
    if (end - begin <= LEAF) {
        for (size_t i = begin; i < end; i++)
            if (t->positions[i][0] == position[0] && t->positions[i][1] == position[1] &&
                t->positions[i][2] == position[2])
                return i;
        return SIZE_MAX;
    }
    const size_t middle = middle_of(begin, end);
    const struct import_nearest_plane plane = t->planes[node];
    size_t at = SIZE_MAX;
    if (position[plane.axis] <= plane.at)
        at = find_at(t, 2 * node, begin, middle, position);
    if (at == SIZE_MAX && position[plane.axis] >= plane.at)
        at = find_at(t, 2 * node + 1, middle, end, position);
    return at;
}

size_t import_nearest_at(const struct import_nearest_tree *tree, const float position[3]) {
    return find_at(tree, 1, 0, tree->count, position);
}
