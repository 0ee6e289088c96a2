/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/collect.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "classify/gradient.h"
#include "classify/reach.h"

enum { BRICKS_GRAIN = 16 }; /* bricks between two looks at the cancel flag */

struct collect {
    const struct sp_transfer *transfer;
    const void *voxels;
    const uint32_t *dims;
    struct sp_visible *list;
    const uint64_t *cells; /* order post: what can matter, by brick; else NULL */
    const struct sp_classify_job *job;
};

static struct collect make_collect(struct sp_level *level, const struct sp_volume *volume,
                                   const struct sp_classify_job *job) {
    return (struct collect){ .transfer = &level->transfer,
                             .voxels = sp_volume_voxels(volume),
                             .dims = level->grid.dims,
                             .list = &level->visible,
                             .cells = level->cells,
                             .job = job };
}

/* The part of a brick that lies in the volume: its first voxel and how many along each axis. */
struct part {
    uint32_t brick, corner[3], size[3];
};

static struct part find_part(const struct collect *c, uint32_t brick) {
    struct part part = { .brick = brick };
    sp_visible_corner(c->list, brick, part.corner);
    for (int a = 0; a < 3; a++) {
        uint32_t left = c->dims[a] - part.corner[a];
        part.size[a] = left < SP_BRICK ? left : SP_BRICK;
    }
    return part;
}

/* Keys of one row of a brick, and which of its voxels are visible, or can matter. */
static void read_row(const struct collect *c, const struct part *part, uint32_t i1, uint32_t i2,
                     uint32_t keys[SP_BRICK], uint8_t visible[SP_BRICK]) {
    size_t at = ((size_t)(part->corner[2] + i2) * c->dims[1] + part->corner[1] + i1) * c->dims[0] +
                part->corner[0];
    sp_transfer_keys(c->transfer, c->voxels, at, part->size[0], keys, visible);
    for (uint32_t i0 = 0; c->cells && i0 < part->size[0]; i0++)
        visible[i0] = sp_reach_has(c->cells[part->brick], i0 | i1 << 4 | i2 << 8) &&
                      isfinite(sp_transfer_value(c->transfer, keys[i0]));
}

static uint32_t count_brick(const struct collect *c, uint32_t brick) {
    struct part part = find_part(c, brick);
    uint32_t keys[SP_BRICK], count = 0;
    uint8_t visible[SP_BRICK] = { 0 };
    for (uint32_t i2 = 0; i2 < part.size[2]; i2++)
        for (uint32_t i1 = 0; i1 < part.size[1]; i1++) {
            read_row(c, &part, i1, i2, keys, visible);
            for (int i = 0; i < SP_BRICK; i++)
                count += visible[i];
        }
    return count;
}

static void fill_brick(const struct collect *c, uint32_t brick) {
    uint64_t out = c->list->first[brick], stop = c->list->first[brick + 1];
    if (out == stop)
        return;
    struct part part = find_part(c, brick);
    uint32_t keys[SP_BRICK];
    uint8_t visible[SP_BRICK];
    for (uint32_t i2 = 0; i2 < part.size[2]; i2++)
        for (uint32_t i1 = 0; i1 < part.size[1]; i1++) {
            read_row(c, &part, i1, i2, keys, visible);
            for (uint32_t i0 = 0; i0 < part.size[0]; i0++)
                if (visible[i0]) {
                    c->list->local[out] = (uint16_t)(i0 | i1 << 4 | i2 << 8);
                    c->list->key[out++] = keys[i0];
                }
        }
    assert(out == stop);
}

static void count_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct collect *c = user;
    if (sp_classify_cancelled(c->job, NULL))
        return;
    for (size_t b = begin; b < end; b++)
        c->list->first[b + 1] = count_brick(c, (uint32_t)b);
}

static void fill_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct collect *c = user;
    if (sp_classify_cancelled(c->job, NULL))
        return;
    for (size_t b = begin; b < end; b++)
        fill_brick(c, (uint32_t)b);
}

static bool find_cells(struct sp_level *level, const struct sp_volume *volume,
                       const struct sp_classify_job *job, struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    level->cells = malloc(bricks * sizeof *level->cells);
    if (!level->cells)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for the cells of %u bricks", bricks);
    return sp_reach_fill(level, volume, job, level->cells, err);
}

bool sp_collect_count(struct sp_level *level, const struct sp_volume *volume,
                      const struct sp_classify_job *job, struct sp_error *err) {
    struct sp_visible *list = &level->visible;
    if (!sp_visible_init(list, level->grid.dims, err))
        return false;
    if (job->tf->order == SP_TF_POST && !find_cells(level, volume, job, err))
        return false;
    struct collect collect = make_collect(level, volume, job);
    sp_parallel_for(job->pool, sp_visible_bricks(list), BRICKS_GRAIN, count_bricks, &collect);
    if (sp_classify_cancelled(job, err))
        return false;
    sp_visible_sum(list);
    return true;
}

bool sp_collect_fill(struct sp_level *level, const struct sp_volume *volume,
                     const struct sp_classify_job *job, struct sp_error *err) {
    if (!sp_visible_allocate(&level->visible, false, err))
        return false;
    struct collect collect = make_collect(level, volume, job);
    sp_parallel_for(job->pool, sp_visible_bricks(&level->visible), BRICKS_GRAIN, fill_bricks,
                    &collect);
    free(level->cells);
    level->cells = NULL;
    return !sp_classify_cancelled(job, err);
}

struct normals {
    struct sp_gradient_grid grid;
    const struct sp_visible *list;
    uint32_t *normal;
    const struct sp_classify_job *job;
};

static void pack_normals(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct normals *n = user;
    if (sp_classify_cancelled(n->job, NULL))
        return;
    for (size_t b = begin; b < end; b++) {
        uint32_t corner[3];
        sp_visible_corner(n->list, (uint32_t)b, corner);
        for (uint64_t e = n->list->first[b]; e < n->list->first[b + 1]; e++) {
            uint32_t p = n->list->local[e],
                     i[3] = { corner[0] + (p & 15), corner[1] + (p >> 4 & 15),
                              corner[2] + (p >> 8) };
            double gradient[3];
            sp_gradient_at(&n->grid, i, gradient);
            n->normal[e] = sp_gradient_pack(&n->grid, gradient);
        }
    }
}

bool sp_collect_normals(struct sp_level *level, const struct sp_volume *volume,
                        const struct sp_classify_job *job, struct sp_error *err) {
    struct sp_visible *list = &level->visible;
    struct normals n = { .list = list, .job = job };
    n.normal = malloc(list->count ? list->count * sizeof *n.normal : 1);
    if (!n.normal)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for %llu gradients",
                       (unsigned long long)list->count);
    sp_gradient_grid_init(&n.grid, volume);
    sp_parallel_for(job->pool, sp_visible_bricks(list), BRICKS_GRAIN, pack_normals, &n);
    if (sp_classify_cancelled(job, err)) {
        free(n.normal);
        return false;
    }
    list->normal = n.normal;
    return true;
}
