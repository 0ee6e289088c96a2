/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/coarse.h"

#include <stdlib.h>
#include <string.h>

#include "classify/gradient.h"

enum { CELL = 8 }; /* fine voxels in a coarse one */

void sp_coarse_grid(const struct sp_grid *fine, struct sp_grid *coarse) {
    *coarse = *fine;
    for (int a = 0; a < 3; a++) {
        coarse->dims[a] = (fine->dims[a] + 1) / 2;
        coarse->spacing[a] = 2 * fine->spacing[a];
        for (int r = 0; r < 3; r++)
            coarse->origin[r] += fine->direction[r][a] * fine->spacing[a] * 0.5;
    }
}

/* What the eight voxels of a cell add up to. */
struct sum {
    float depth, color[3], normal[3];
};

struct merge {
    const struct sp_level *fine;
    struct sp_level *coarse;
    struct sum *rows; /* one of coarse dims[0] cells a worker, all zero between rows */
    const atomic_bool *cancel;
    bool counting; /* first pass: how many entries a slice gets */
};

/* Shading has two sides, so a normal counts as its opposite does: the two faces of a thin wall
 * agree instead of cancelling. A steep gradient counts more than the noise inside of matter. */
static void add_normal(uint32_t packed, float depth, float sum[3]) {
    float n[3], share = (float)(packed >> 22) / SP_GRADIENT_MAGNITUDES;
    sp_gradient_unpack(packed, n);
    float weight = depth * share * share; /* the magnitude is stored as a square root */
    if (n[0] * sum[0] + n[1] * sum[1] + n[2] * sum[2] < 0)
        weight = -weight;
    for (int k = 0; k < 3; k++)
        sum[k] += n[k] * weight;
}

static void add_voxel(const struct merge *m, uint64_t e, struct sum *sum) {
    const struct sp_visible *list = &m->fine->lists[2];
    struct sp_class c = sp_transfer_class(&m->fine->transfer, list->key[e]);
    sum->depth += c.depth;
    for (int k = 0; k < 3; k++)
        sum->color[k] += c.color[k] * c.depth;
    if (list->normal)
        add_normal(list->normal[e], c.depth, sum->normal);
}

static void write_entry(const struct merge *m, uint64_t out, uint32_t position,
                        const struct sum *sum) {
    static const struct sp_gradient_grid unit = { .bound = 1 };
    struct sp_visible *list = &m->coarse->lists[2];
    struct sp_class *c = &m->coarse->transfer.table[out];
    list->position[out] = position;
    list->key[out] = (uint32_t)out;
    c->depth = sum->depth / CELL;
    for (int k = 0; k < 3; k++)
        c->color[k] = sum->color[k] / sum->depth;
    if (list->normal) {
        double n[3];
        for (int k = 0; k < 3; k++)
            n[k] = (double)(sum->normal[k] / sum->depth);
        list->normal[out] = sp_gradient_pack(&unit, n);
    }
}

/* Merges two slices row by row; entries of a slice are in the order of memory. Returns how many
 * cells got something; writes them from `out` on unless it only counts. */
static uint64_t merge_slices(const struct merge *m, uint32_t slice, struct sum *row, uint64_t out) {
    const struct sp_visible *from = &m->fine->lists[2];
    uint64_t at[2] = { 0, 0 }, end[2] = { 0, 0 }, first = out;
    for (uint32_t i = 0; i < 2 && 2 * slice + i < from->slices; i++) {
        at[i] = from->first[2 * slice + i];
        end[i] = from->first[2 * slice + i + 1];
    }
    while (at[0] < end[0] || at[1] < end[1]) {
        uint32_t y = UINT32_MAX, left = UINT32_MAX, right = 0;
        for (int i = 0; i < 2; i++)
            if (at[i] < end[i] && from->position[at[i]] >> 17 < y)
                y = from->position[at[i]] >> 17;
        for (int i = 0; i < 2; i++)
            for (; at[i] < end[i] && from->position[at[i]] >> 17 == y; at[i]++) {
                uint32_t x = (from->position[at[i]] & 0xffff) >> 1;
                add_voxel(m, at[i], &row[x]);
                left = x < left ? x : left;
                right = x > right ? x : right;
            }
        for (uint32_t x = left; x <= right; x++) {
            if (!(row[x].depth > 0))
                continue;
            if (!m->counting)
                write_entry(m, out, x | y << 16, &row[x]);
            out++;
        }
        memset(row + left, 0, (right - left + (size_t)1) * sizeof *row);
    }
    return out - first;
}

static void merge_block(void *user, size_t begin, size_t end, unsigned worker) {
    const struct merge *m = user;
    struct sp_visible *list = &m->coarse->lists[2];
    struct sum *row = m->rows + (size_t)worker * m->coarse->grid.dims[0];
    for (size_t s = begin; s < end; s++) {
        if (m->cancel && atomic_load_explicit(m->cancel, memory_order_relaxed))
            return;
        uint64_t n = merge_slices(m, (uint32_t)s, row, m->counting ? 0 : list->first[s]);
        if (m->counting)
            list->first[s + 1] = n;
    }
}

static bool was_cancelled(const struct sp_classify_job *job, struct sp_error *err) {
    if (!job->cancel || !atomic_load_explicit(job->cancel, memory_order_relaxed))
        return false;
    sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    return true;
}

static bool merge_level(struct merge *m, const struct sp_classify_job *job, struct sp_error *err) {
    struct sp_visible *list = &m->coarse->lists[2];
    struct sp_transfer *transfer = &m->coarse->transfer;
    m->counting = true;
    sp_parallel_for(job->pool, list->slices, 1, merge_block, m);
    if (was_cancelled(job, err))
        return false;
    for (uint32_t s = 0; s < list->slices; s++)
        list->first[s + 1] += list->first[s];
    list->count = list->first[list->slices];
    if (list->count > UINT32_MAX)
        return sp_fail(err, SP_ERR_MEMORY, "", "too many visible voxels for a coarse level: %llu",
                       (unsigned long long)list->count);
    uint64_t entry = sizeof *list->position + sizeof *list->key + sizeof *transfer->table +
                     (m->fine->lists[2].normal ? sizeof *list->normal : 0);
    if (job->bytes_max && list->count * entry > job->bytes_max)
        return sp_fail(
            err, SP_ERR_BUDGET, "/transfer_function",
            "a coarse level of %llu voxels takes %llu bytes and %llu are left: make fewer "
            "voxels visible, or allow more memory",
            (unsigned long long)list->count, (unsigned long long)(list->count * entry),
            (unsigned long long)job->bytes_max);
    if (!sp_visible_allocate(list, m->fine->lists[2].normal != NULL, err))
        return false;
    transfer->table = malloc((list->count ? list->count : 1) * sizeof *transfer->table);
    if (!transfer->table)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for %llu classes of a coarse level",
                       (unsigned long long)list->count);
    transfer->count = (uint32_t)list->count;
    m->counting = false;
    sp_parallel_for(job->pool, list->slices, 1, merge_block, m);
    return !was_cancelled(job, err);
}

bool sp_coarse_make(struct sp_level *coarse, const struct sp_level *fine,
                    const struct sp_classify_job *job, struct sp_error *err) {
    sp_coarse_grid(&fine->grid, &coarse->grid);
    struct sp_visible *list = &coarse->lists[2];
    struct merge m = { .fine = fine, .coarse = coarse, .cancel = job->cancel };
    m.rows = calloc((size_t)coarse->grid.dims[0] * sp_pool_threads(job->pool), sizeof *m.rows);
    list->first = calloc(coarse->grid.dims[2] + (size_t)1, sizeof *list->first);
    list->slices = coarse->grid.dims[2];
    bool ok = m.rows && list->first
                  ? merge_level(&m, job, err)
                  : sp_fail(err, SP_ERR_MEMORY, "", "no memory for %u slices", list->slices);
    free(m.rows);
    return ok;
}
