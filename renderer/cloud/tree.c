/* SPDX-License-Identifier: Apache-2.0 */
#include "cloud/tree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "volume/volume.h"

enum {
    LEAF_POINTS = 8,
    LEVELS = 20 /* points that are closer than the box / 2^LEVELS stay together */
};

struct build {
    const struct sp_elements *points;
    struct sp_cloud_tree *tree;
    const struct sp_interrupt *interrupt;
    uint32_t *moved;   /* [points] */
    uint32_t capacity; /* of cells */
};

/* True if the point can be drawn. */
static bool is_drawn(const struct sp_elements *e, uint32_t i) {
    const float *p = e->positions[i];
    return isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]) && isfinite(e->values[i]) &&
           e->volumes[i] > 0 && isfinite(e->volumes[i]);
}

/* Appends cells; returns the first one's number. UINT32_MAX: out of memory. */
static uint32_t add_cells(struct build *b, uint32_t count) {
    uint32_t *used = &b->tree->merged.shape.count, first = *used;
    if (first + count > b->capacity) {
        uint32_t capacity = 2 * b->capacity + 64;
        void *cells = realloc(b->tree->cells, capacity * sizeof *b->tree->cells);
        if (!cells)
            return UINT32_MAX;
        b->tree->cells = cells;
        b->capacity = capacity;
    }
    *used += count;
    return first;
}

/* Sorts the points [first, first + count) of the order by octant around the centre; starts[9]. */
static void sort_octants(struct build *b, uint32_t first, uint32_t count, const float centre[3],
                         uint32_t starts[9]) {
    uint32_t *order = b->tree->order + first, next[8] = { 0 };
    const float(*p)[3] = (const float(*)[3])b->points->positions;
#define OCTANT(i)                                                                                  \
    ((p[i][0] >= centre[0]) | (p[i][1] >= centre[1]) << 1 | (p[i][2] >= centre[2]) << 2)
    for (uint32_t i = 0; i < count; i++)
        next[OCTANT(order[i])]++;
    starts[0] = 0;
    for (int o = 0; o < 8; o++) {
        starts[o + 1] = starts[o] + next[o];
        next[o] = starts[o];
    }
    for (uint32_t i = 0; i < count; i++)
        b->moved[next[OCTANT(order[i])]++] = order[i];
#undef OCTANT
    memcpy(order, b->moved, count * sizeof *order);
}

/* Divides a cell of points around `centre`. Recurses at most LEVELS deep. False: out of memory. */
static bool divide(struct build *b, uint32_t cell, const float centre[3], const float half[3],
                   int level) {
    const struct sp_cloud_cell own = b->tree->cells[cell];
    uint32_t starts[9], used = 0;
    if (own.count <= LEAF_POINTS || level == LEVELS || sp_interrupt_is_cancelled(b->interrupt))
        return true;
    sort_octants(b, own.first, own.count, centre, starts);
    for (int o = 0; o < 8; o++)
        used += starts[o + 1] > starts[o];
    uint32_t inside = add_cells(b, used);
    if (inside == UINT32_MAX)
        return false;
    b->tree->cells[cell] = (struct sp_cloud_cell){ inside, used, own.side, false };
    const float next[3] = { 0.5f * half[0], 0.5f * half[1], 0.5f * half[2] };
    for (uint32_t o = 0, to = inside; o < 8; o++) {
        if (starts[o + 1] == starts[o])
            continue;
        b->tree->cells[to] =
            (struct sp_cloud_cell){ own.first + starts[o], starts[o + 1] - starts[o],
                                    0.5f * own.side, true };
        float at[3];
        for (unsigned a = 0; a < 3; a++)
            at[a] = centre[a] + (o >> a & 1 ? next[a] : -next[a]);
        if (!divide(b, to++, at, next, level + 1))
            return false;
    }
    return true;
}

static bool make_cells(struct build *b, const struct sp_grid *grid) {
    const uint32_t n = b->points->shape.count;
    uint32_t count = 0;
    float centre[3], half[3];
    b->tree->order = malloc((n + (size_t)1) * sizeof *b->tree->order);
    b->moved = malloc((n + (size_t)1) * sizeof *b->moved);
    if (!b->tree->order || !b->moved || add_cells(b, 1) != 0)
        return false;
    for (uint32_t i = 0; i < n; i++)
        if (is_drawn(b->points, i))
            b->tree->order[count++] = i;
    for (int a = 0; a < 3; a++) {
        centre[a] = (float)grid->origin[a];
        half[a] = 0.5f * (float)grid->spacing[a];
    }
    b->tree->cells[0] =
        (struct sp_cloud_cell){ 0, count, 2 * fmaxf(half[0], fmaxf(half[1], half[2])), true };
    return divide(b, 0, centre, half, 0);
}

/* Sums over the children of a cell. */
struct sums {
    double volume, value, place[3], square[6]; /* of L·Lᵀ + p·pᵀ, row by row */
};

static const int row_of[6] = { 0, 1, 1, 2, 2, 2 }, column_of[6] = { 0, 0, 1, 0, 1, 2 };

/* Adds a child. Places are relative to `from`, so that squares keep their digits. */
static void add_child(const struct sp_elements *e, uint32_t i, const float from[3],
                      struct sums *sums) {
    const double weight = (double)e->volumes[i];
    const float *l = e->factors[i];
    double p[3];
    sums->volume += weight;
    sums->value += weight * (double)e->values[i];
    for (int a = 0; a < 3; a++) {
        p[a] = (double)e->positions[i][a] - (double)from[a];
        sums->place[a] += weight * p[a];
    }
    for (int k = 0; k < 6; k++) {
        int r = row_of[k], c = column_of[k];
        double product = p[r] * p[c];
        for (int m = 0; m <= c; m++)
            product += (double)l[r * (r + 1) / 2 + m] * (double)l[c * (c + 1) / 2 + m];
        sums->square[k] += weight * product;
    }
}

/* The triangular factor of a symmetric matrix that is not negative. */
static void find_factor(const double v[6], float out[6]) {
    double l[6];
    for (int k = 0; k < 6; k++) {
        int r = row_of[k], c = column_of[k];
        double rest = v[k];
        for (int m = 0; m < c; m++)
            rest -= l[r * (r + 1) / 2 + m] * l[c * (c + 1) / 2 + m];
        double pivot = r == c ? sqrt(fmax(rest, 0)) : l[c * (c + 1) / 2 + c];
        l[k] = r == c ? pivot : pivot > 0 ? rest / pivot : 0;
        out[k] = (float)l[k];
    }
}

/* A lattice of kernels with the standard deviation 0.7 has coarser kernels of the same one, in
 * cells: 0.49·side². The merged points of a cell have 0.49/4 + 1/16 of it, and get the rest. */
static const double rest = 0.49 - 0.49 / 4 - 1.0 / 16;

static void merge(const struct sp_cloud_tree *tree, const struct sp_elements *points,
                  uint32_t cell) {
    const struct sp_cloud_cell *c = &tree->cells[cell];
    const struct sp_elements *to = &tree->merged, *from = c->is_leaf ? points : to;
    struct sums sums = { 0 };
    double v[6];
    if (!c->count)
        return;
    const float *base = from->positions[c->is_leaf ? tree->order[c->first] : c->first];
    for (uint32_t k = c->first; k < c->first + c->count; k++)
        add_child(from, c->is_leaf ? tree->order[k] : k, base, &sums);
    for (int a = 0; a < 3; a++) {
        sums.place[a] /= sums.volume;
        to->positions[cell][a] = (float)((double)base[a] + sums.place[a]);
    }
    for (int k = 0; k < 6; k++) {
        v[k] = sums.square[k] / sums.volume - sums.place[row_of[k]] * sums.place[column_of[k]];
        if (row_of[k] == column_of[k] && c->count > 1)
            v[k] += rest * (double)c->side * (double)c->side;
    }
    find_factor(v, to->factors[cell]);
    to->values[cell] = (float)(sums.value / sums.volume);
    to->volumes[cell] = (float)sums.volume;
}

/* Cells come after those that they are inside of. */
static bool merge_cells(const struct build *b) {
    struct sp_elements *m = &b->tree->merged;
    const size_t n = m->shape.count;
    m->shape.kind = SP_KIND_POINTS;
    m->positions = calloc(n, sizeof *m->positions);
    m->factors = calloc(n, sizeof *m->factors);
    m->values = calloc(n, sizeof *m->values);
    m->volumes = calloc(n, sizeof *m->volumes);
    if (!m->positions || !m->factors || !m->values || !m->volumes)
        return false;
    for (size_t i = n; i-- > 0 && !sp_interrupt_is_cancelled(b->interrupt);)
        merge(b->tree, b->points, (uint32_t)i);
    b->tree->bytes = n * (sizeof *b->tree->cells + sizeof *m->positions + sizeof *m->factors +
                          2 * sizeof(float)) +
                     b->points->shape.count * sizeof *b->tree->order;
    return true;
}

bool sp_cloud_tree_build(const struct sp_volume *volume, const struct sp_interrupt *interrupt,
                         struct sp_cloud_tree *tree, struct sp_error *err) {
    struct build b = { .points = sp_volume_elements(volume), .tree = tree, .interrupt = interrupt };
    *tree = (struct sp_cloud_tree){ 0 };
    bool ok = make_cells(&b, &sp_volume_info(volume)->grid) && merge_cells(&b);
    free(b.moved);
    if (ok && !sp_interrupt_is_cancelled(interrupt))
        return true;
    sp_cloud_tree_finish(tree);
    return ok ? sp_fail(err, SP_ERR_CANCELLED, "", "cancelled")
              : sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the levels of points");
}

void sp_cloud_tree_finish(struct sp_cloud_tree *tree) {
    free(tree->cells);
    free(tree->order);
    free(tree->merged.positions);
    free(tree->merged.factors);
    free(tree->merged.values);
    free(tree->merged.volumes);
    *tree = (struct sp_cloud_tree){ 0 };
}

static void empty_slot(struct sp_cloud_slot *slot) {
    sp_cloud_tree_finish(&slot->tree);
    sp_volume_unref(&slot->volume);
    slot->used = 0;
}

void sp_cloud_evict(struct sp_cloud_cache *cache, const struct sp_volume *volume) {
    for (int i = 0; i < SP_CLOUD_SLOTS; i++)
        if (cache->slots[i].volume && sp_volume_is_of(cache->slots[i].volume, volume))
            empty_slot(&cache->slots[i]);
}

uint64_t sp_cloud_bytes(const struct sp_cloud_cache *cache, const struct sp_volume *volume) {
    uint64_t bytes = 0;
    for (int i = 0; i < SP_CLOUD_SLOTS; i++)
        if (cache->slots[i].volume && sp_volume_is_of(cache->slots[i].volume, volume))
            bytes += cache->slots[i].tree.bytes;
    return bytes;
}

/* About what a tree takes while it is made: two orders, and a cell of 60 bytes per three points. */
static uint64_t expected_bytes(uint32_t points) {
    return (uint64_t)points * (8 + 60 / 3);
}

bool sp_cloud_cache_get(struct sp_cloud_cache *cache, struct sp_volume *volume, uint64_t bytes_max,
                        const struct sp_interrupt *interrupt, const struct sp_cloud_tree **tree,
                        struct sp_error *err) {
    const struct sp_elements_shape *shape = &sp_volume_elements(volume)->shape;
    struct sp_cloud_slot *slot = &cache->slots[0];
    *tree = NULL;
    if (shape->kind != SP_KIND_POINTS || shape->count < SP_CLOUD_TREE_MIN ||
        expected_bytes(shape->count) > bytes_max)
        return true;
    for (int i = 0; i < SP_CLOUD_SLOTS; i++) {
        if (cache->slots[i].volume == volume) {
            cache->slots[i].used = ++cache->clock;
            *tree = &cache->slots[i].tree;
            return true;
        }
        if (cache->slots[i].used < slot->used)
            slot = &cache->slots[i];
    }
    empty_slot(slot);
    if (!sp_cloud_tree_build(volume, interrupt, &slot->tree, err))
        return false;
    slot->volume = sp_volume_ref(volume);
    slot->used = ++cache->clock;
    *tree = &slot->tree;
    return true;
}
