/* SPDX-License-Identifier: Apache-2.0 */
#include "cloud/cut.h"

#include <math.h>
#include <string.h>

enum { CELLS_MAX = 1024 }; /* among which the work is divided */

struct cut {
    const struct sp_cloud_tree *tree;
    const struct sp_cloud *cloud;
    const struct sp_voxel_frame *frame;
    float pixels;
    float grow;       /* from a length of the data to units of the frame */
    uint32_t *cells;  /* where the work is divided; together they have all points */
    uint32_t *counts; /* by such a cell: chosen points, then where they begin */
    uint32_t *out;
};

/* True if the cell is at most as wide as it may be: at its nearest, a diagonal before its merged
 * point. */
static bool is_small(const struct cut *c, uint32_t cell) {
    const float *p = c->tree->merged.positions[cell], *row = c->cloud->place[2];
    const float side = c->tree->cells[cell].side * c->grow, diagonal = 1.7321f;
    const float scale = c->frame->ewa.scale;
    if (c->frame->ewa.projection == SP_ORTHOGRAPHIC)
        return side * scale <= c->pixels;
    float u2 = row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + c->cloud->offset[2];
    return side * scale <= c->pixels * (u2 - diagonal * side);
}

/* Counts, and writes if `out` is not NULL, what is drawn of a cell. */
static uint32_t choose(const struct cut *c, uint32_t cell, uint32_t *out) {
    const struct sp_cloud_cell *at = &c->tree->cells[cell];
    uint32_t count = 0;
    if (at->count > 1 && is_small(c, cell)) {
        if (out)
            *out = c->cloud->elements->shape.count + cell;
        return 1;
    }
    for (uint32_t i = 0; !at->is_leaf && i < at->count; i++)
        count += choose(c, at->first + i, out ? out + count : NULL);
    for (uint32_t i = 0; out && at->is_leaf && i < at->count; i++)
        out[i] = c->tree->order[at->first + i];
    return at->is_leaf ? at->count : count;
}

static void count_cells(void *user, size_t begin, size_t end, unsigned worker) {
    const struct cut *c = user;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        c->counts[i] = choose(c, c->cells[i], NULL);
}

static void write_cells(void *user, size_t begin, size_t end, unsigned worker) {
    const struct cut *c = user;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        (void)choose(c, c->cells[i], c->out + c->counts[i]);
}

/* The factor by which the placement stretches lengths, in the mean. */
static float find_growth(const struct sp_cloud *cloud) {
    float square = 0;
    for (int k = 0; k < 9; k++)
        square += cloud->place[k / 3][k % 3] * cloud->place[k / 3][k % 3];
    return sqrtf(square / 3);
}

/* Replaces each cell that is not drawn as one point by those inside it. False if there is none, or
 * if there were too many. */
static bool divide(const struct cut *c, uint32_t count, uint32_t *inside, uint32_t *inside_count) {
    bool is_divided = false;
    *inside_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        const struct sp_cloud_cell *at = &c->tree->cells[c->cells[i]];
        bool is_whole = at->is_leaf || is_small(c, c->cells[i]);
        uint32_t first = is_whole ? c->cells[i] : at->first, n = is_whole ? 1 : at->count;
        if (*inside_count + n > CELLS_MAX)
            return false;
        is_divided = is_divided || !is_whole;
        for (uint32_t k = 0; k < n; k++)
            inside[(*inside_count)++] = first + k;
    }
    return is_divided;
}

/* Fills cells[CELLS_MAX] with cells that together have all points; returns how many. */
static uint32_t find_cells(struct cut *c) {
    uint32_t inside[CELLS_MAX], count = 1, next;
    c->cells[0] = 0;
    while (divide(c, count, inside, &next)) {
        memcpy(c->cells, inside, next * sizeof *inside);
        count = next;
    }
    return count;
}

bool sp_cloud_cut(const struct sp_cloud_tree *tree, const struct sp_cloud *cloud,
                  const struct sp_voxel_frame *frame, float pixels, struct sp_pool *pool,
                  struct sp_arena *arena, struct sp_cloud_choice *choice) {
    struct cut c = {
        .tree = tree, .cloud = cloud, .frame = frame, .pixels = pixels, .grow = find_growth(cloud)
    };
    c.cells = sp_arena_alloc(arena, "cells of points", CELLS_MAX, sizeof *c.cells);
    if (!c.cells)
        return false;
    const uint32_t cells = find_cells(&c);
    c.counts = sp_arena_alloc(arena, "cells of points", cells + (size_t)1, sizeof *c.counts);
    if (!c.counts)
        return false;
    sp_parallel_for(pool, cells, 1, count_cells, &c);
    uint32_t total = 0;
    for (uint32_t i = 0; i < cells; i++) {
        uint32_t had = c.counts[i];
        c.counts[i] = total;
        total += had;
    }
    c.out = sp_arena_alloc(arena, "points", total + (size_t)1, sizeof *c.out);
    if (!c.out)
        return false;
    sp_parallel_for(pool, cells, 1, write_cells, &c);
    *choice = (struct sp_cloud_choice){ .elements = c.out, .count = total };
    return true;
}
