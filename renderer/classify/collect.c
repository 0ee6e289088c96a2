/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/collect.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/gradient.h"
#include "classify/reach.h"

enum { BRICKS_GRAIN = 16 }; /* bricks between two looks at the cancel flag */

struct collect {
    const struct sp_transfer *transfer;
    const void *voxels;
    const uint32_t *dims;
    struct sp_visible *list;
    const uint64_t *cells; /* order post: what can matter, by brick; else NULL */
    struct sp_range *ranges;
    bool measures;               /* ranges have yet to be found */
    const struct sp_level *from; /* NULL = nowhere to copy from */
    const struct sp_change *change;
    struct sp_gradient_grid gradients;
    const struct sp_classify_job *job;
};

static struct collect make_collect(struct sp_level *level, const struct sp_volume *volume,
                                   const struct sp_collect_source *source,
                                   const struct sp_classify_job *job) {
    return (struct collect){ .transfer = &level->transfer,
                             .voxels = sp_volume_voxels(volume),
                             .dims = level->grid.dims,
                             .list = &level->visible,
                             .cells = level->cells,
                             .ranges = level->ranges,
                             .from = source->level,
                             .change = &source->change,
                             .job = job };
}

static uint32_t pack_normal(const struct sp_gradient_grid *grid, const uint32_t corner[3],
                            uint32_t local) {
    uint32_t i[3] = { corner[0] + (local & 15), corner[1] + (local >> 4 & 15),
                      corner[2] + (local >> 8) };
    double gradient[3];
    sp_gradient_at(grid, i, gradient);
    return sp_gradient_pack(grid, gradient);
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

/* Whether the brick's entries are those of the source. */
static bool is_unchanged(const struct collect *c, uint32_t brick) {
    return c->from && !sp_change_meets(c->change, &c->ranges[brick]);
}

static void widen(const struct sp_transfer *transfer, const uint32_t *keys, uint32_t count,
                  struct sp_range *range) {
    for (uint32_t i = 0; i < count; i++) {
        float v = sp_transfer_value(transfer, keys[i]);
        if (isfinite(v)) {
            range->low = v < range->low ? v : range->low;
            range->high = v > range->high ? v : range->high;
        }
    }
}

static uint32_t count_brick(const struct collect *c, uint32_t brick) {
    if (is_unchanged(c, brick))
        return (uint32_t)(c->from->visible.first[brick + 1] - c->from->visible.first[brick]);
    struct part part = find_part(c, brick);
    struct sp_range range = { INFINITY, -INFINITY };
    uint32_t keys[SP_BRICK], count = 0;
    uint8_t visible[SP_BRICK] = { 0 };
    for (uint32_t i2 = 0; i2 < part.size[2]; i2++)
        for (uint32_t i1 = 0; i1 < part.size[1]; i1++) {
            read_row(c, &part, i1, i2, keys, visible);
            for (int i = 0; i < SP_BRICK; i++)
                count += visible[i];
            if (c->measures)
                widen(c->transfer, keys, part.size[0], &range);
        }
    if (c->measures)
        c->ranges[brick] = range;
    return count;
}

/* Normals of a brick that was made anew: those of voxels that the source lists are its own. Both
 * lists are in the same order. */
static void merge_normals(const struct collect *c, uint32_t brick) {
    const struct sp_visible *list = c->list, *from = &c->from->visible;
    uint64_t old = from->first[brick], stop = from->first[brick + 1];
    uint32_t corner[3];
    sp_visible_corner(list, brick, corner);
    for (uint64_t e = list->first[brick]; e < list->first[brick + 1]; e++) {
        uint32_t local = list->local[e];
        while (old < stop && from->local[old] < local)
            old++;
        list->normal[e] = old < stop && from->local[old] == local
                              ? from->normal[old]
                              : pack_normal(&c->gradients, corner, local);
    }
}

/* Copies an unchanged brick; false when it has to be made anew. */
static bool copy_brick(const struct collect *c, uint32_t brick) {
    if (!is_unchanged(c, brick))
        return false;
    const struct sp_visible *from = &c->from->visible;
    uint64_t to = c->list->first[brick], at = from->first[brick];
    size_t count = (size_t)(from->first[brick + 1] - at);
    memcpy(c->list->local + to, from->local + at, count * sizeof *from->local);
    memcpy((uint8_t *)c->list->key + to * from->key_bytes,
           (const uint8_t *)from->key + at * from->key_bytes, count * from->key_bytes);
    if (c->list->normal)
        memcpy(c->list->normal + to, from->normal + at, count * sizeof *from->normal);
    return true;
}

static void fill_brick(const struct collect *c, uint32_t brick) {
    uint64_t out = c->list->first[brick], stop = c->list->first[brick + 1];
    if (out == stop || copy_brick(c, brick))
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
                    sp_visible_set_key(c->list, out++, keys[i0]);
                }
        }
    assert(out == stop);
    if (c->list->normal)
        merge_normals(c, brick);
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

/* Memory for the bricks' ranges, and what of them the source knows; *measures: nothing. */
static bool find_ranges(struct sp_level *level, const struct sp_level *from, bool *measures,
                        struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    *measures = false;
    if (level->ranges)
        return true;
    level->ranges = malloc(bricks * sizeof *level->ranges);
    if (!level->ranges)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for the ranges of %u bricks", bricks);
    *measures = !from;
    if (from)
        memcpy(level->ranges, from->ranges, bricks * sizeof *level->ranges);
    return true;
}

bool sp_collect_count(struct sp_level *level, const struct sp_volume *volume,
                      const struct sp_classify_job *job, struct sp_collect_source *source,
                      struct sp_error *err) {
    struct sp_visible *list = &level->visible;
    const struct sp_level *from = job->from ? &job->from->levels[0] : NULL;
    bool measures;
    *source = (struct sp_collect_source){ 0 };
    if (from && (!from->visible.first || !from->ranges ||
                 !sp_change_is_possible(&from->transfer, &level->transfer)))
        from = NULL;
    uint32_t key_bytes = sp_transfer_key_bytes(&level->transfer);
    if (!sp_visible_init(list, level->grid.dims, key_bytes, err) ||
        !find_ranges(level, from, &measures, err))
        return false;
    if (from && !sp_change_init(&source->change, &from->transfer, &level->transfer, err))
        return false;
    source->level = from;
    if (job->tf->order == SP_TF_POST && !find_cells(level, volume, job, err))
        return false;
    struct collect collect = make_collect(level, volume, source, job);
    collect.measures = measures;
    sp_parallel_for(job->pool, sp_visible_bricks(list), BRICKS_GRAIN, count_bricks, &collect);
    if (sp_classify_cancelled(job, err)) {
        free(level->ranges); /* not all of them were found */
        level->ranges = NULL;
        return false;
    }
    sp_visible_sum(list);
    return true;
}

bool sp_collect_fill(struct sp_level *level, const struct sp_volume *volume,
                     const struct sp_classify_job *job, const struct sp_collect_source *source,
                     struct sp_error *err) {
    bool normals = job->normals && source->level && source->level->visible.normal;
    if (!sp_visible_allocate(&level->visible, normals, err))
        return false;
    struct collect collect = make_collect(level, volume, source, job);
    sp_gradient_grid_init(&collect.gradients, volume);
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
        for (uint64_t e = n->list->first[b]; e < n->list->first[b + 1]; e++)
            n->normal[e] = pack_normal(&n->grid, corner, n->list->local[e]);
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
