/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/cloud/tree.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "data/volume/volume.h"

enum { AHEAD = 32 }; /* points that are read in advance: they may lie apart in memory */

/* Sums over the children of a cell. */
struct sums {
    double volume, value, value2, place[3];
    double square[6]; /* of L·Lᵀ + p·pᵀ, row by row */
};

/* A point inside a cell, or the merged one of a cell inside. */
struct child {
    const float *position, *factor;
    float value, spread, volume, reach, deviation;
    uint32_t low, high;
};

static const int row_of[6] = { 0, 1, 1, 2, 2, 2 }, column_of[6] = { 0, 0, 1, 0, 1, 2 };

/* At least the deviation of a kernel along any line: the root of the largest sum of a row of
 * |L·Lᵀ|. */
static float bound_deviation(const float l[6]) {
    const float xx = l[0] * l[0], yy = l[1] * l[1] + l[2] * l[2];
    const float zz = l[3] * l[3] + l[4] * l[4] + l[5] * l[5];
    const float xy = fabsf(l[0] * l[1]), xz = fabsf(l[0] * l[3]);
    const float yz = fabsf(l[1] * l[3] + l[2] * l[4]);
    return sqrtf(fmaxf(fmaxf(xx + xy + xz, yy + xy + yz), zz + xz + yz));
}

/* Makes a bound of a length that is not negative; rounds up. */
static uint16_t make_bound(float length) {
    union {
        float value;
        uint32_t bits;
    } all = { .value = length };
    return length < FLT_MAX / 2 ? (uint16_t)((all.bits + 0xffff) >> 16) : 0x7f80; /* infinity */
}

static struct child child_at(const struct sp_cloud_tree *tree, const struct sp_elements *points,
                             const struct sp_cloud_cell *cell, uint32_t number) {
    if (cell->is_leaf) {
        const uint32_t i = tree->order[cell->first + number],
                       bin = sp_cloud_bin(tree, points->values[i]);
        return (struct child){ .position = points->positions[i],
                               .factor = points->factors[i],
                               .value = points->values[i],
                               .volume = points->volumes[i],
                               .deviation = bound_deviation(points->factors[i]),
                               .low = bin,
                               .high = bin };
    }
    const struct sp_cloud_node *node = &tree->nodes[cell->first + number];
    return (struct child){ .position = node->position,
                           .factor = node->factor,
                           .value = node->value,
                           .spread = sp_cloud_spread(tree, node),
                           .volume = node->volume,
                           .reach = sp_cloud_bound(node->reach),
                           .deviation = sp_cloud_bound(node->deviation),
                           .low = node->low,
                           .high = node->high };
}

/* Adds a child. Places are relative to `from`, so that squares keep their digits. */
static void add_child(const struct child *child, const float from[3], struct sums *sums) {
    const double weight = (double)child->volume;
    const float *l = child->factor;
    double p[3];
    sums->volume += weight;
    const double value = (double)child->value, spread = (double)child->spread;
    sums->value += weight * value;
    sums->value2 += weight * (value * value + spread * spread);
    for (int a = 0; a < 3; a++) {
        p[a] = (double)child->position[a] - (double)from[a];
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
static void compute_factor(const double v[6], float out[6]) {
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

/* Fills the bounds of the cell; its merged point is known. */
static void bound_cell(const struct sp_cloud_tree *tree, const struct sp_elements *points,
                       struct sp_cloud_node *to) {
    float reach = 0, deviation = bound_deviation(to->factor);
    uint32_t low = sp_cloud_bin(tree, to->value), high = low;
    for (uint32_t k = 0; k < to->cell.count; k++) {
        const struct child child = child_at(tree, points, &to->cell, k);
        float square = 0;
        for (int a = 0; a < 3; a++) {
            const float away = child.position[a] - to->position[a];
            square += away * away;
        }
        reach = fmaxf(reach, sqrtf(square) + child.reach);
        deviation = fmaxf(deviation, child.deviation);
        low = child.low < low ? child.low : low;
        high = child.high > high ? child.high : high;
    }
    const float rounding = 1.00001f;
    to->reach = make_bound(rounding * reach);
    to->deviation = make_bound(rounding * deviation);
    to->low = low & 0xfff;
    to->high = high & 0xfff;
}

/* Fills how far the values of a cell lie apart, after its bounds. */
static void compute_spread(const struct sp_cloud_tree *tree, const struct sums *sums,
                           struct sp_cloud_node *to) {
    const double mean = sums->value / sums->volume,
                 variance = sums->value2 / sums->volume - mean * mean,
                 step = (to->high - to->low + 1) * tree->bin / 510;
    const double steps = step > 0 && variance > 0 ? sqrt(variance) / step + 0.5 : 0;
    to->spread = (uint32_t)(steps < 255 ? steps : 255) & 0xff;
}

static void merge(const struct sp_cloud_tree *tree, const struct sp_elements *points,
                  const struct sp_cloud_cell *cell, struct sp_cloud_node *to) {
    struct sums sums = { 0 };
    double v[6];
    *to = (struct sp_cloud_node){ .cell = *cell };
    if (!cell->count)
        return;
    const struct child first = child_at(tree, points, cell, 0);
    for (uint32_t k = 0; k < cell->count; k++) {
        const struct child child = child_at(tree, points, cell, k);
        add_child(&child, first.position, &sums);
    }
    for (int a = 0; a < 3; a++) {
        sums.place[a] /= sums.volume;
        to->position[a] = (float)((double)first.position[a] + sums.place[a]);
    }
    for (int k = 0; k < 6; k++) {
        v[k] = sums.square[k] / sums.volume - sums.place[row_of[k]] * sums.place[column_of[k]];
        if (row_of[k] == column_of[k] && cell->count > 1)
            v[k] += rest * (double)cell->side * (double)cell->side;
    }
    compute_factor(v, to->factor);
    if (cell->count == 1)
        memcpy(to->factor, first.factor, sizeof to->factor);
    to->value = (float)(sums.value / sums.volume);
    to->volume = (float)sums.volume;
    bound_cell(tree, points, to);
    compute_spread(tree, &sums, to);
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

/* A cell comes after the cell that contains it. */
static void merge_parts(void *user, size_t begin, size_t end, unsigned worker) {
    const struct merging *m = user;
    (void)worker;
    for (size_t p = begin; p < end; p++) {
        const struct sp_cloud_part *part = &m->cells->parts[p];
        if (sp_interrupt_is_cancelled(m->interrupt))
            return;
        for (uint32_t i = part->first + part->count; i-- > part->first;) {
            const struct sp_cloud_cell *cell = &m->cells->cells[i];
            if (cell->is_leaf)
                prefetch(m, cell);
            merge(m->tree, m->points, cell, &m->tree->nodes[i]);
        }
    }
}

/* Allocates nodes. Frames read them at random: with pages of 4 KB, each read would wait for the
 * page table as well. */
static struct sp_cloud_node *allocate_nodes(size_t count) {
    const size_t page = 2 << 20,
                 bytes = (count * sizeof(struct sp_cloud_node) + page - 1) / page * page;
    void *nodes = aligned_alloc(page, bytes);
    if (nodes)
        (void)madvise(nodes, bytes, MADV_HUGEPAGE);
    return nodes;
}

static bool merge_cells(const struct merging *m, struct sp_pool *pool, struct sp_cloud_tree *tree) {
    tree->nodes = allocate_nodes(tree->count);
    if (!tree->nodes)
        return false;
    sp_parallel_for(pool, m->cells->part_count, 1, merge_parts, (void *)m);
    for (uint32_t i = m->cells->top_count; i-- > 0;)
        merge(tree, m->points, &m->cells->cells[i], &tree->nodes[i]);
    tree->bytes = tree->count * sizeof *tree->nodes + m->points->shape.count * sizeof *tree->order;
    return true;
}

bool sp_cloud_tree_build(const struct sp_volume *volume, struct sp_pool *pool,
                         const struct sp_interrupt *interrupt, struct sp_cloud_tree *tree,
                         struct sp_error *err) {
    struct sp_cloud_cells cells;
    struct merging m = {
        .tree = tree, .points = sp_volume_elements(volume), .cells = &cells, .interrupt = interrupt
    };
    const double *range = sp_volume_info(volume)->range;
    *tree = (struct sp_cloud_tree){ .low = range[0], .bin = (range[1] - range[0]) / SP_CLOUD_BINS };
    bool ok = sp_cloud_cells_make(volume, pool, interrupt, &cells, err);
    tree->order = cells.order;
    tree->count = cells.count;
    if (ok && !sp_interrupt_is_cancelled(interrupt) && !merge_cells(&m, pool, tree))
        ok = sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the levels of points");
    if (ok && sp_interrupt_is_cancelled(interrupt))
        ok = sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    free(cells.cells);
    free(cells.parts);
    if (!ok)
        sp_cloud_tree_finish(tree);
    return ok;
}

void sp_cloud_tree_finish(struct sp_cloud_tree *tree) {
    free(tree->nodes);
    free(tree->order);
    *tree = (struct sp_cloud_tree){ 0 };
}
