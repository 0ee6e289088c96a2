/* SPDX-License-Identifier: Apache-2.0 */
#include "cloud/tree.h"

#include <math.h>
#include <stdlib.h>

#include "volume/volume.h"

enum { AHEAD = 32 }; /* points that are read in advance: they may lie apart in memory */

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
    const double l0 = (double)l[0], l1 = (double)l[1], l2 = (double)l[2], l3 = (double)l[3],
                 l4 = (double)l[4], l5 = (double)l[5];
    const double square[6] = {
        l0 * l0 + p[0] * p[0],           l1 * l0 + p[1] * p[0],
        l1 * l1 + l2 * l2 + p[1] * p[1], l3 * l0 + p[2] * p[0],
        l3 * l1 + l4 * l2 + p[2] * p[1], l3 * l3 + l4 * l4 + l5 * l5 + p[2] * p[2]
    };
    for (int k = 0; k < 6; k++)
        sums->square[k] += weight * square[k];
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

struct merging {
    const struct sp_cloud_tree *tree;
    const struct sp_elements *points;
    const struct sp_cloud_cells *cells;
    const struct sp_interrupt *interrupt;
};

/* The points of the leaf that come AHEAD earlier in the order: cells are merged from the last one
 * on. */
static void prefetch(const struct merging *m, const struct sp_cloud_cell *leaf) {
    const struct sp_elements *e = m->points;
    const uint32_t begin = leaf->first > AHEAD ? leaf->first - AHEAD : 0;
    for (uint32_t k = begin; k < begin + leaf->count; k++) {
        const uint32_t i = m->tree->order[k];
        __builtin_prefetch(e->positions[i]);
        __builtin_prefetch(e->factors[i]);
        __builtin_prefetch(&e->values[i]);
        __builtin_prefetch(&e->volumes[i]);
    }
}

/* Cells come after those that they are inside of. */
static void merge_parts(void *user, size_t begin, size_t end, unsigned worker) {
    const struct merging *m = user;
    (void)worker;
    for (size_t p = begin; p < end; p++) {
        const struct sp_cloud_part *part = &m->cells->parts[p];
        if (sp_interrupt_is_cancelled(m->interrupt))
            return;
        for (uint32_t i = part->first + part->count; i-- > part->first;) {
            if (m->tree->cells[i].is_leaf)
                prefetch(m, &m->tree->cells[i]);
            merge(m->tree, m->points, i);
        }
    }
}

static bool merge_cells(const struct merging *m, struct sp_pool *pool, struct sp_cloud_tree *tree) {
    struct sp_elements *to = &tree->merged;
    const size_t n = to->shape.count;
    to->shape.kind = SP_KIND_POINTS;
    to->positions = malloc(n * sizeof *to->positions);
    to->factors = malloc(n * sizeof *to->factors);
    to->values = malloc(n * sizeof *to->values);
    to->volumes = malloc(n * sizeof *to->volumes);
    if (!to->positions || !to->factors || !to->values || !to->volumes)
        return false;
    sp_parallel_for(pool, m->cells->part_count, 1, merge_parts, (void *)m);
    for (uint32_t i = m->cells->top_count; i-- > 0;)
        merge(tree, m->points, i);
    tree->bytes = n * (sizeof *tree->cells + sizeof *to->positions + sizeof *to->factors +
                       2 * sizeof(float)) +
                  m->points->shape.count * sizeof *tree->order;
    return true;
}

bool sp_cloud_tree_build(const struct sp_volume *volume, struct sp_pool *pool,
                         const struct sp_interrupt *interrupt, struct sp_cloud_tree *tree,
                         struct sp_error *err) {
    struct sp_cloud_cells cells;
    struct merging m = {
        .tree = tree, .points = sp_volume_elements(volume), .cells = &cells, .interrupt = interrupt
    };
    *tree = (struct sp_cloud_tree){ 0 };
    bool ok = sp_cloud_cells_make(volume, pool, interrupt, &cells, err);
    tree->cells = cells.cells;
    tree->order = cells.order;
    tree->merged.shape.count = cells.count;
    if (ok && !sp_interrupt_is_cancelled(interrupt) && !merge_cells(&m, pool, tree))
        ok = sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the levels of points");
    if (ok && sp_interrupt_is_cancelled(interrupt))
        ok = sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    free(cells.parts);
    if (!ok)
        sp_cloud_tree_finish(tree);
    return ok;
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

/* About what a tree takes while it is made: an order, places of 16 bytes, and a cell of 60 bytes
 * per three points. */
static uint64_t expected_bytes(uint32_t points) {
    return (uint64_t)points * (4 + 16 + 60 / 3);
}

bool sp_cloud_cache_get(struct sp_cloud_cache *cache, struct sp_volume *volume, uint64_t bytes_max,
                        struct sp_pool *pool, const struct sp_interrupt *interrupt,
                        const struct sp_cloud_tree **tree, struct sp_error *err) {
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
    if (!sp_cloud_tree_build(volume, pool, interrupt, &slot->tree, err))
        return false;
    slot->volume = sp_volume_ref(volume);
    slot->used = ++cache->clock;
    *tree = &slot->tree;
    return true;
}
