/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/cloud/colors.h"

#include <math.h>
#include <stdlib.h>

enum {
    TOP = 4, /* levels above the cells that threads take one by one */
    CELLS_MAX = 1 << (3 * TOP)
};

struct sum {
    double number, volume; /* Σ volume·number, Σ volume */
};

struct merging {
    const struct sp_cloud *cloud;
    const struct sp_cloud_tree *tree;
    const struct sp_interrupt *interrupt;
    float *numbers;
    uint32_t count;
    uint32_t *cells;  /* [count]: cells of level TOP and leaves above, in the order of the tree */
    struct sum *sums; /* [count] */
    uint32_t next;    /* of `sums`, to be read */
};

static struct sum sum_points(const struct merging *m, const struct sp_cloud_cell *leaf) {
    struct sum sum = { 0, 0 };
    for (uint32_t k = leaf->first; k < leaf->first + leaf->count; k++) {
        const uint32_t i = m->tree->order[k];
        const double number = (double)sp_cloud_color_number(m->cloud, i);
        const double volume = (double)m->cloud->elements->volumes[i];
        sum.number += isfinite(number) ? volume * number : 0;
        sum.volume += isfinite(number) ? volume : 0;
    }
    return sum;
}

/* Fills a cell and those inside. `levels`: those below have their sums already. */
static struct sum merge(struct merging *m, uint32_t number, uint32_t levels) {
    const struct sp_cloud_cell *cell = &m->tree->nodes[number].cell;
    struct sum sum = { 0, 0 };
    if (levels == 0 || (levels <= TOP && cell->is_leaf))
        return m->sums[m->next++];
    if (cell->is_leaf)
        sum = sum_points(m, cell);
    for (uint32_t k = 0; !cell->is_leaf && k < cell->count; k++) {
        const struct sum inside = merge(m, cell->first + k, levels - 1);
        sum.number += inside.number;
        sum.volume += inside.volume;
    }
    m->numbers[number] = sum.volume > 0 ? (float)(sum.number / sum.volume) : NAN;
    return sum;
}

static void merge_cells(void *user, size_t begin, size_t end, unsigned worker) {
    struct merging *m = user;
    (void)worker;
    for (size_t i = begin; i < end && !sp_interrupt_is_cancelled(m->interrupt); i++)
        m->sums[i] = merge(m, m->cells[i], UINT32_MAX);
}

static void list_cells(struct merging *m, uint32_t number, uint32_t levels) {
    const struct sp_cloud_cell *cell = &m->tree->nodes[number].cell;
    if (levels == 0 || cell->is_leaf)
        m->cells[m->count++] = number;
    for (uint32_t k = 0; levels > 0 && !cell->is_leaf && k < cell->count; k++)
        list_cells(m, cell->first + k, levels - 1);
}

bool sp_cloud_merge_colors(const struct sp_cloud *cloud, const struct sp_cloud_tree *tree,
                           struct sp_pool *pool, const struct sp_interrupt *interrupt,
                           float *numbers, struct sp_error *err) {
    struct merging m = { .cloud = cloud, .tree = tree, .interrupt = interrupt, .numbers = numbers };
    m.cells = malloc(CELLS_MAX * sizeof *m.cells);
    m.sums = malloc(CELLS_MAX * sizeof *m.sums);
    bool ok = m.cells && m.sums;
    if (!ok)
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the colours of points");
    if (ok) {
        list_cells(&m, 0, TOP);
        sp_parallel_for(pool, m.count, 1, merge_cells, &m);
        ok = !sp_interrupt_is_cancelled(interrupt) ||
             sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    }
    if (ok)
        (void)merge(&m, 0, TOP);
    free(m.cells);
    free(m.sums);
    return ok;
}
