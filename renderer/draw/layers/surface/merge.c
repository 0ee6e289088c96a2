/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/surface/merge.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/volume/grid.h"
#include "draw/layers/surface/filter.h"

bool sp_surface_can_merge(const struct sp_grid *grid) {
    return !sp_grid_is_rectilinear(grid);
}

/* The distance of the nearest corner of the volume, along the view. */
static double compute_nearest(const struct sp_grid *grid,
                              const struct sp_camera_transform *camera) {
    double nearest = INFINITY;
    for (int c = 0; c < 8; c++) {
        double depth = 0;
        for (int r = 0; r < 3; r++) {
            double at = grid->origin[r] - camera->eye.v[r];
            for (int a = 0; a < 3; a++)
                if (c >> a & 1)
                    at += grid->direction[r][a] * grid->spacing[a] * (grid->dims[a] - 1);
            depth += camera->w.m[2][r] * at;
        }
        nearest = fmin(nearest, depth);
    }
    return nearest;
}

unsigned sp_surface_level(const struct sp_view *view, const struct sp_grid *grid,
                          const struct sp_camera_transform *camera) {
    /* Pairs as large as two deviations of the low-pass filter, larger groups as half of one: they
     * take details away that kernels of that size would show. */
    const double pair = 2, group = 0.5;
    const struct sp_filter filter = sp_surface_filter(&view->filter);
    double size = 0, nearest = compute_nearest(grid, camera);
    uint8_t split[3];
    unsigned level = 0;
    if (view->level_of_detail != SP_LOD_AUTO || !sp_surface_can_merge(grid))
        return 0;
    sp_surface_points_split(grid, split);
    for (int a = 0; a < 3; a++)
        size = fmax(size, grid->spacing[a] / split[a]);
    size *= camera->scale;
    if (camera->projection == SP_PERSPECTIVE)
        size = nearest > 0 ? size / nearest : INFINITY;
    while (level < SURFACE_LEVELS - 1 &&
           ldexp(size, (int)level + 1) <= (level ? group : pair) * filter.lowpass)
        level++;
    return level;
}

/* Variance of evenly spaced points. */
static double spread_of(unsigned level) {
    return (ldexp(1, 2 * (int)level) - 1) / 12;
}

double sp_surface_growth(unsigned level, double sigma, bool is_enlarged) {
    return is_enlarged ? ldexp(1, (int)level) : sqrt(1 + spread_of(level) / (sigma * sigma));
}

/* A merged point: sums, weighted by area. */
struct sum {
    float weight, at[3], area[3], normal[3], bend;
};

/* Directions have the same octant, and the same axis as their largest part. */
enum { DIRECTIONS = 3 * 8, KEYS_MAX = 16 * 16 * 16 * DIRECTIONS }; /* level 1, cells in 4³ parts */

struct merging {
    const struct sp_surface_points *from;
    struct sp_surface_points *to;
    const struct sp_surface_job *job;
    unsigned shift; /* place in parts → group */
    uint32_t groups[3], keys;
    uint32_t most;    /* points of a block */
    struct sum *sums; /* [threads][most] */
};

/* Points of a group that face the same way have the same key. */
static uint32_t compute_key(const struct merging *m, uint64_t i) {
    const struct sp_surface_points *p = m->from;
    uint32_t group = 0;
    int axis = 0;
    for (int a = 2; a >= 0; a--) {
        group = group * m->groups[a] + ((uint32_t)p->at[a][i] * p->split[a] >> m->shift);
        axis = abs(p->area[a][i]) > abs(p->area[axis][i]) ? a : axis;
    }
    const unsigned signs =
        (p->area[0][i] < 0) | (p->area[1][i] < 0) << 1 | (p->area[2][i] < 0) << 2;
    return group * DIRECTIONS + (uint32_t)axis * 8 + signs;
}

/* Numbers the merged points of a block. numbers: [KEYS_MAX], 0 = none yet. */
static uint32_t assign_number(const struct merging *m, uint64_t i, uint16_t *numbers,
                              uint32_t *count) {
    uint16_t *number = &numbers[compute_key(m, i)];
    if (!*number)
        *number = (uint16_t)++ * count;
    return *number - 1u;
}

static void count_points(void *user, size_t begin, size_t end, unsigned worker) {
    const struct merging *m = user;
    uint16_t numbers[KEYS_MAX];
    (void)worker;
    for (size_t b = begin; b < end && !sp_interrupt_is_cancelled(&m->job->interrupt); b++) {
        const struct sp_surface_block *block = &m->from->blocks[b];
        struct sp_surface_block *to = &m->to->blocks[b];
        *to = *block;
        to->count = 0;
        memset(numbers, 0, m->keys * sizeof *numbers);
        for (uint32_t i = 0; i < block->count; i++)
            assign_number(m, block->first + i, numbers, &to->count);
    }
}

static void add_point(const struct sp_surface_points *p, uint64_t i, struct sum *sum) {
    float square = 0;
    for (int a = 0; a < 3; a++)
        square += (float)p->area[a][i] * (float)p->area[a][i];
    const float weight = fmaxf(sqrtf(square), 1);
    sum->weight += weight;
    sum->bend += weight * (float)p->bend[i];
    for (int a = 0; a < 3; a++) {
        sum->at[a] += weight * (float)p->at[a][i];
        sum->area[a] += (float)p->area[a][i];
        sum->normal[a] += weight * (float)p->normal[a][i];
    }
}

static int16_t to_steps(float x) {
    return (int16_t)lrintf(x < -INT16_MAX ? -INT16_MAX : x > INT16_MAX ? INT16_MAX : x);
}

static void store_point(struct sp_surface_points *p, struct sp_surface_block *block, uint64_t to,
                        const struct sum *sum) {
    const float area = ldexpf(1, -2 * p->level);
    const float *n = sum->normal;
    for (int a = 0; a < 3; a++) {
        long place = lrintf(sum->at[a] / sum->weight);
        p->at[a][to] = (uint16_t)(place < UINT16_MAX ? place : UINT16_MAX);
        p->area[a][to] = to_steps(sum->area[a] * area);
        p->normal[a][to] = to_steps(n[a] / sum->weight);
        block->low[a] = p->at[a][to] < block->low[a] ? p->at[a][to] : block->low[a];
        block->high[a] = p->at[a][to] > block->high[a] ? p->at[a][to] : block->high[a];
    }
    p->bend[to] = to_steps(sum->bend / sum->weight);
}

static void merge_points(void *user, size_t begin, size_t end, unsigned worker) {
    const struct merging *m = user;
    struct sum *sums = m->sums + (size_t)worker * m->most;
    uint16_t numbers[KEYS_MAX];
    for (size_t b = begin; b < end && !sp_interrupt_is_cancelled(&m->job->interrupt); b++) {
        const struct sp_surface_block *block = &m->from->blocks[b];
        struct sp_surface_block *to = &m->to->blocks[b];
        uint32_t count = 0;
        memset(numbers, 0, m->keys * sizeof *numbers);
        memset(sums, 0, to->count * sizeof *sums);
        for (uint32_t i = 0; i < block->count; i++)
            add_point(m->from, block->first + i,
                      &sums[assign_number(m, block->first + i, numbers, &count)]);
        for (int a = 0; a < 3; a++) {
            to->low[a] = UINT16_MAX;
            to->high[a] = 0;
        }
        for (uint32_t i = 0; i < count; i++)
            store_point(m->to, to, to->first + i, &sums[i]);
    }
}

static bool finish(struct merging *m, struct sp_error *err, enum sp_code code, const char *text) {
    free(m->sums);
    sp_surface_points_finish(m->to);
    return sp_fail(err, code, "", "%s", text);
}

bool sp_surface_merge(const struct sp_surface_points *points, unsigned level,
                      const struct sp_surface_job *job, uint64_t bytes_max,
                      struct sp_surface_points *out, struct sp_error *err) {
    struct merging m = {
        .from = points, .to = out, .job = job, .shift = 13 + level, .keys = DIRECTIONS
    };
    *out =
        (struct sp_surface_points){ .block_count = points->block_count, .level = (uint8_t)level };
    for (int a = 0; a < 3; a++) {
        out->split[a] = points->split[a];
        m.groups[a] = ((SURFACE_BLOCK * points->split[a] - 1u) >> level) + 1;
        m.keys *= m.groups[a];
    }
    out->blocks = malloc((out->block_count ? out->block_count : 1) * sizeof *out->blocks);
    if (!out->blocks)
        return finish(&m, err, SP_ERR_MEMORY, "out of memory for a level of a surface");
    sp_parallel_for(job->pool, out->block_count, 16, count_points, &m);
    if (sp_interrupt_is_cancelled(&job->interrupt))
        return finish(&m, err, SP_ERR_CANCELLED, "cancelled");
    for (uint32_t b = 0; b < out->block_count; b++) {
        out->blocks[b].first = out->count;
        out->count += out->blocks[b].count;
        m.most = out->blocks[b].count > m.most ? out->blocks[b].count : m.most;
    }
    if (sp_surface_points_bytes(out) > bytes_max)
        return finish(&m, err, SP_ERR_BUDGET, "no memory may be used for a level of a surface");
    m.sums = malloc((sp_pool_threads(job->pool) * (size_t)m.most + 1) * sizeof *m.sums);
    if (!m.sums || !sp_surface_points_allocate(out))
        return finish(&m, err, SP_ERR_MEMORY, "out of memory for a level of a surface");
    sp_parallel_for(job->pool, out->block_count, 16, merge_points, &m);
    if (sp_interrupt_is_cancelled(&job->interrupt))
        return finish(&m, err, SP_ERR_CANCELLED, "cancelled");
    free(m.sums);
    return true;
}
