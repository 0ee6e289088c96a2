/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/cloud/tree_cells.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/grow.h"
#include "data/volume/volume.h"

enum {
    LEAF_POINTS = 8,
    LEVELS = 20, /* points that are closer than the box / 2^LEVELS stay together */
    SORTED = 4,  /* levels that one pass sorts by; LEVELS is a multiple */
    KEYS = 1 << (3 * SORTED),
    CHUNKS = 16,      /* of a sort */
    PART = 1 << 18,   /* points at most that one thread divides */
    BLOCK = 1 << 14,  /* points of a loop */
    CELLS_MIN = 1024, /* of a list that grows */
};

/* A point and its place in the box, in steps of 2^−LEVELS. */
struct item {
    uint32_t at[3], point;
};

struct list {
    struct sp_cloud_cell *cells;
    uint32_t count, capacity;
};

/* What one thread has. */
struct worker {
    struct item *moved; /* [PART] */
    struct list made;   /* by part: its root, then the cells inside, which are numbered from it */
    bool failed;
};

struct build {
    const struct sp_elements *points;
    const struct sp_interrupt *interrupt;
    struct sp_pool *pool;
    float low[3], scale; /* a place is (position − low)·scale */
    float side;          /* of the box */
    struct item *items;  /* of the points that are drawn, cell by cell */
    struct list top;
    struct sp_cloud_cells *cells;
    struct worker *workers;
    /* The sort that is going on. */
    const struct item *from; /* NULL = the points */
    struct item *to;
    uint32_t from_count, level;
    uint32_t (*counts)[KEYS]; /* [CHUNKS] */
};

static bool is_drawn(const struct sp_elements *e, uint32_t i) {
    const float *p = e->positions[i];
    return isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]) && isfinite(e->values[i]) &&
           e->volumes[i] > 0 && isfinite(e->volumes[i]);
}

/* Appends cells; returns the first one's number. UINT32_MAX: out of memory. */
static uint32_t add_cells(struct list *list, uint32_t count) {
    const uint32_t first = list->count;
    if (first + count > list->capacity) {
        const uint32_t capacity = 2 * list->capacity + CELLS_MIN;
        void *cells = realloc(list->cells, capacity * sizeof *list->cells);
        if (!cells)
            return UINT32_MAX;
        list->cells = cells;
        list->capacity = capacity;
    }
    list->count += count;
    return first;
}

/* Item i of the sort; false if it is not drawn. */
static inline bool read_item(const struct build *b, uint32_t i, struct item *item) {
    if (b->from) {
        *item = b->from[i];
        return true;
    }
    if (!is_drawn(b->points, i))
        return false;
    item->point = i;
    for (int a = 0; a < 3; a++) {
        const float at = (b->points->positions[i][a] - b->low[a]) * b->scale;
        const float most = (float)((1 << LEVELS) - 1);
        item->at[a] = (uint32_t)(at > 0 ? at < most ? at : most : 0);
    }
    return true;
}

/* The octants of the next SORTED levels, the uppermost first. */
static inline uint32_t key_of(const struct item *item, uint32_t level) {
    const uint32_t shift = LEVELS - SORTED - level;
    uint32_t key = 0;
    for (uint32_t a = 0; a < 3; a++) {
        const uint32_t bits = item->at[a] >> shift & ((1 << SORTED) - 1);
        key |= ((bits & 1) | (bits & 2) << 2 | (bits & 4) << 4 | (bits & 8) << 6) << a;
    }
    return key;
}

static uint32_t chunk_begin(const struct build *b, size_t chunk) {
    return (uint32_t)(b->from_count * (uint64_t)chunk / CHUNKS);
}

static void count_keys(void *user, size_t begin, size_t end, unsigned worker) {
    struct build *b = user;
    struct item item;
    (void)worker;
    for (size_t chunk = begin; chunk < end; chunk++) {
        uint32_t *counts = b->counts[chunk];
        memset(counts, 0, sizeof b->counts[chunk]);
        for (uint32_t i = chunk_begin(b, chunk); i < chunk_begin(b, chunk + 1); i++)
            if (read_item(b, i, &item))
                counts[key_of(&item, b->level)]++;
    }
}

static void move_items(void *user, size_t begin, size_t end, unsigned worker) {
    struct build *b = user;
    struct item item;
    (void)worker;
    for (size_t chunk = begin; chunk < end; chunk++) {
        uint32_t *next = b->counts[chunk];
        for (uint32_t i = chunk_begin(b, chunk); i < chunk_begin(b, chunk + 1); i++)
            if (read_item(b, i, &item))
                b->to[next[key_of(&item, b->level)]++] = item;
    }
}

/* Sorts `count` items of `from`, which has no common memory with `to`, by their keys, keeping the
 * order of equal ones; starts[KEYS + 1]. */
static void sort(struct build *b, const struct item *from, uint32_t count, uint32_t level,
                 struct item *to, uint32_t *starts) {
    uint32_t at = 0;
    b->from = from;
    b->from_count = count;
    b->level = level;
    b->to = to;
    sp_parallel_for(b->pool, CHUNKS, 1, count_keys, b);
    for (int key = 0; key < KEYS; key++) {
        starts[key] = at;
        for (int chunk = 0; chunk < CHUNKS; chunk++) {
            const uint32_t had = b->counts[chunk][key];
            b->counts[chunk][key] = at;
            at += had;
        }
    }
    starts[KEYS] = at;
    sp_parallel_for(b->pool, CHUNKS, 1, move_items, b);
}

static bool divide_top(struct build *b, uint32_t cell, uint32_t level);

static bool add_part(struct build *b, uint32_t cell, uint32_t level) {
    struct sp_cloud_cells *cells = b->cells;
    if (!sp_grow(&cells->parts, cells->part_count, sizeof *cells->parts))
        return false;
    cells->parts[cells->part_count++] = (struct sp_cloud_part){ .root = cell, .level = level };
    return true;
}

/* Makes the cells inside `cell`, whose points have the keys from `key` on. The sorted cells lie
 * `rest` levels below. */
static bool make_top(struct build *b, uint32_t cell, uint32_t level, const uint32_t *starts,
                     uint32_t base, uint32_t key, uint32_t rest) {
    const struct sp_cloud_cell own = b->top.cells[cell];
    if (own.count <= LEAF_POINTS)
        return true;
    if (rest == 0)
        return divide_top(b, cell, level);
    const uint32_t step = 1u << (3 * (rest - 1));
    uint32_t used = 0;
    for (uint32_t o = 0; o < 8; o++)
        used += starts[key + (o + 1) * step] > starts[key + o * step];
    const uint32_t inside = add_cells(&b->top, used);
    if (inside == UINT32_MAX)
        return false;
    b->top.cells[cell] = (struct sp_cloud_cell){ inside, used, false, own.side };
    for (uint32_t o = 0, to = inside; o < 8; o++) {
        const uint32_t begin = starts[key + o * step], end = starts[key + (o + 1) * step];
        if (begin == end)
            continue;
        b->top.cells[to] =
            (struct sp_cloud_cell){ base + begin, end - begin, true, 0.5f * own.side };
        if (!make_top(b, to++, level + 1, starts, base, key + o * step, rest - 1))
            return false;
    }
    return true;
}

/* Divides a cell of the top, or leaves it to one thread. Recurses LEVELS / SORTED deep. */
static bool divide_top(struct build *b, uint32_t cell, uint32_t level) {
    const struct sp_cloud_cell own = b->top.cells[cell];
    if (level == LEVELS || sp_interrupt_is_cancelled(b->interrupt))
        return true;
    if (own.count <= PART)
        return add_part(b, cell, level);
    struct item *items = b->items + own.first, *copy = malloc(own.count * sizeof *copy);
    uint32_t *starts = malloc((KEYS + 1) * sizeof *starts);
    bool ok = copy && starts;
    if (ok) {
        memcpy(copy, items, own.count * sizeof *copy);
        sort(b, copy, own.count, level, items, starts);
    }
    free(copy);
    ok = ok && make_top(b, cell, level, starts, own.first, 0, SORTED);
    free(starts);
    return ok;
}

/* Sorts items by octant; starts[9]. */
static void sort_octants(struct worker *w, struct item *items, uint32_t count, uint32_t level,
                         uint32_t starts[9]) {
    const uint32_t bit = LEVELS - 1 - level;
    uint32_t next[8] = { 0 };
#define OCTANT(i)                                                                                  \
    ((items[i].at[0] >> bit & 1) | (items[i].at[1] >> bit & 1) << 1 |                              \
     (items[i].at[2] >> bit & 1) << 2)
    for (uint32_t i = 0; i < count; i++)
        next[OCTANT(i)]++;
    starts[0] = 0;
    for (int o = 0; o < 8; o++) {
        starts[o + 1] = starts[o] + next[o];
        next[o] = starts[o];
    }
    for (uint32_t i = 0; i < count; i++)
        w->moved[next[OCTANT(i)]++] = items[i];
#undef OCTANT
    memcpy(items, w->moved, count * sizeof *items);
}

/* Divides a cell that the thread has made: the cell of `root` or a cell inside it. Recurses at most
 * LEVELS deep. */
static void divide(struct build *b, struct worker *w, uint32_t root, uint32_t cell,
                   uint32_t level) {
    const struct sp_cloud_cell own = w->made.cells[cell];
    uint32_t starts[9], used = 0;
    if (own.count <= LEAF_POINTS || level == LEVELS || w->failed)
        return;
    sort_octants(w, b->items + own.first, own.count, level, starts);
    for (int o = 0; o < 8; o++)
        used += starts[o + 1] > starts[o];
    const uint32_t inside = add_cells(&w->made, used);
    if (inside == UINT32_MAX) {
        w->failed = true;
        return;
    }
    w->made.cells[cell] = (struct sp_cloud_cell){ inside - root, used, false, own.side };
    for (uint32_t o = 0, to = inside; o < 8; o++) {
        if (starts[o + 1] == starts[o])
            continue;
        w->made.cells[to] =
            (struct sp_cloud_cell){ own.first + starts[o], starts[o + 1] - starts[o], true,
                                    0.5f * own.side };
        divide(b, w, root, to++, level + 1);
    }
}

static void divide_parts(void *user, size_t begin, size_t end, unsigned worker) {
    struct build *b = user;
    struct worker *w = &b->workers[worker];
    if (!w->moved)
        w->moved = malloc(PART * sizeof *w->moved);
    w->failed |= !w->moved;
    for (size_t i = begin; i < end && !w->failed; i++) {
        struct sp_cloud_part *part = &b->cells->parts[i];
        if (sp_interrupt_is_cancelled(b->interrupt))
            return;
        const uint32_t root = add_cells(&w->made, 1);
        w->failed = root == UINT32_MAX;
        if (w->failed)
            return;
        w->made.cells[root] = b->top.cells[part->root];
        divide(b, w, root, root, part->level);
        part->count = w->made.count - root - 1;
        part->made = root;
        part->worker = worker;
    }
}

/* Copies the cells of parts to where they stay. */
static void place_parts(void *user, size_t begin, size_t end, unsigned worker) {
    const struct build *b = user;
    struct sp_cloud_cell *all = b->cells->cells;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const struct sp_cloud_part *part = &b->cells->parts[i];
        const uint32_t inside = part->first;
        const struct sp_cloud_cell *from = b->workers[part->worker].made.cells + part->made;
        for (uint32_t k = 0; k <= part->count; k++) {
            struct sp_cloud_cell *to = &all[k ? inside + k - 1 : part->root];
            *to = from[k];
            to->first += to->is_leaf ? 0 : inside - 1;
        }
    }
}

static void write_order(void *user, size_t begin, size_t end, unsigned worker) {
    const struct build *b = user;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        b->cells->order[i] = b->items[i].point;
}

static bool divide_all(struct build *b, uint32_t *starts) {
    const uint32_t n = b->points->shape.count;
    sort(b, NULL, n, 0, b->items, starts);
    if (add_cells(&b->top, 1) != 0)
        return false;
    b->top.cells[0] = (struct sp_cloud_cell){ 0, starts[KEYS], true, b->side };
    if (!make_top(b, 0, 0, starts, 0, 0, SORTED))
        return false;
    sp_parallel_for(b->pool, b->cells->part_count, 1, divide_parts, b);
    for (unsigned i = 0; i < sp_pool_threads(b->pool); i++)
        if (b->workers[i].failed)
            return false;
    return true;
}

/* Puts all cells into one array: the top, then part by part. */
static bool join(struct build *b) {
    struct sp_cloud_cells *cells = b->cells;
    uint32_t count = cells->top_count = b->top.count;
    for (uint32_t i = 0; i < cells->part_count; i++) {
        struct sp_cloud_part *part = &cells->parts[i];
        part->first = count;
        count += part->count;
    }
    cells->cells = realloc(b->top.cells, count * sizeof *b->top.cells);
    if (!cells->cells)
        return false;
    b->top = (struct list){ 0 };
    cells->count = count;
    sp_parallel_for(b->pool, cells->part_count, 64, place_parts, b);
    return true;
}

/* Cells are cubes, so that a flat cloud has no more of them than its image needs. */
static void compute_box(struct build *b, const struct sp_grid *grid) {
    for (int a = 0; a < 3; a++) {
        b->low[a] = (float)(grid->origin[a] - 0.5 * grid->spacing[a]);
        b->side = fmaxf(b->side, (float)grid->spacing[a]);
    }
    b->scale = (float)(1 << LEVELS) / b->side;
}

bool sp_cloud_cells_make(const struct sp_volume *volume, struct sp_pool *pool,
                         const struct sp_interrupt *interrupt, struct sp_cloud_cells *cells,
                         struct sp_error *err) {
    struct build b = {
        .points = sp_volume_elements(volume), .interrupt = interrupt, .pool = pool, .cells = cells
    };
    const size_t n = b.points->shape.count + (size_t)1;
    *cells = (struct sp_cloud_cells){ 0 };
    compute_box(&b, &sp_volume_info(volume)->grid);
    b.items = malloc(n * sizeof *b.items);
    b.counts = malloc(CHUNKS * sizeof *b.counts);
    b.workers = calloc(sp_pool_threads(pool), sizeof *b.workers);
    uint32_t *starts = malloc((KEYS + 1) * sizeof *starts);
    cells->order = malloc(n * sizeof *cells->order);
    bool ok = b.items && b.counts && b.workers && starts && cells->order && divide_all(&b, starts);
    if (ok && !sp_interrupt_is_cancelled(interrupt)) {
        ok = join(&b);
        if (ok)
            sp_parallel_for(pool, starts[KEYS], BLOCK, write_order, &b);
    }
    for (unsigned i = 0; b.workers && i < sp_pool_threads(pool); i++) {
        free(b.workers[i].moved);
        free(b.workers[i].made.cells);
    }
    free(b.top.cells);
    free(b.items);
    free(b.counts);
    free(b.workers);
    free(starts);
    return ok || sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the levels of points");
}
