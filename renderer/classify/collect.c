/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/collect.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/dense.h"
#include "classify/gradient.h"
#include "classify/reach.h"

enum {
    BRICKS_GRAIN = 16, /* bricks that a thread takes at a time */
    INTERVALS_MAX = 4, /* of keys: more are looked up one by one */
};

/* The listed keys, as a small number of ranges. */
struct intervals {
    int count; /* -1: too many */
    uint16_t low[INTERVALS_MAX], span[INTERVALS_MAX];
};

struct collect {
    const struct sp_transfer *transfer;
    const void *voxels;
    const uint32_t *dims;
    struct sp_visible *list;
    unsigned axis;         /* that rebuilt bricks are cut along */
    const uint64_t *cells; /* order post: what can matter, by brick; else NULL */
    struct sp_range *ranges;
    const uint8_t *listed; /* by key; NULL = what is visible, or can matter */
    struct intervals intervals;
    bool measures;               /* ranges have yet to be found */
    const struct sp_level *from; /* NULL = nowhere to copy from */
    const struct sp_change *change;
    struct sp_gradient_grid gradients;
    const struct sp_classify_job *job;
};

static struct intervals list_intervals(const uint8_t *listed, uint32_t count) {
    struct intervals in = { 0 };
    for (uint32_t k = 0; listed && k < count; k++) {
        if (!listed[k])
            continue;
        if (in.count == INTERVALS_MAX) {
            in.count = -1;
            break;
        }
        uint32_t low = k;
        while (k + 1 < count && listed[k + 1])
            k++;
        in.low[in.count] = (uint16_t)low;
        in.span[in.count++] = (uint16_t)(k - low);
    }
    return in;
}

static struct collect make_collect(struct sp_level *level, const struct sp_volume *volume,
                                   const struct sp_collect_source *source,
                                   const struct sp_classify_job *job) {
    return (struct collect){ .transfer = &level->transfer,
                             .voxels = sp_volume_voxels(volume),
                             .dims = level->grid.dims,
                             .list = &level->visible,
                             .axis = job->axis < 3 ? job->axis : 2,
                             .cells = level->cells,
                             .ranges = level->ranges,
                             .listed = level->listed,
                             .intervals = list_intervals(level->listed, level->transfer.count),
                             .from = source->level,
                             .change = &source->change,
                             .job = job };
}

/* Packs the gradient at a voxel, as wide as the list wants it. */
static uint32_t pack_normal(const struct sp_gradient_grid *grid, uint32_t bytes,
                            const uint32_t corner[3], uint32_t local) {
    uint32_t i[3] = { corner[0] + (local & 15), corner[1] + (local >> 4 & 15),
                      corner[2] + (local >> 8) };
    double gradient[3];
    sp_gradient_at(grid, i, gradient);
    return bytes == 2 ? sp_gradient_pack_direction(gradient) : sp_gradient_pack(grid, gradient);
}

/* The part of a brick that lies in the volume: its first voxel and how many along each axis. */
struct region {
    uint32_t brick, corner[3], size[3];
};

static struct region bound_region(const struct collect *c, uint32_t brick) {
    struct region region = { .brick = brick };
    sp_visible_brick_corner(c->list->bricks, brick, region.corner);
    for (int a = 0; a < 3; a++) {
        uint32_t left = c->dims[a] - region.corner[a];
        region.size[a] = left < SP_BRICK ? left : SP_BRICK;
    }
    return region;
}

static size_t row_begin(const struct collect *c, const struct region *region, uint32_t i1,
                        uint32_t i2) {
    return ((size_t)(region->corner[2] + i2) * c->dims[1] + region->corner[1] + i1) * c->dims[0] +
           region->corner[0];
}

/* Keys of `n` samples of 8 or 16 bits; those beyond repeat the first. */
static inline void read_keys(const void *voxels, size_t at, uint32_t n, uint32_t bytes,
                             int32_t first, uint16_t keys[SP_BRICK]) {
    if (bytes == 1) {
        uint8_t in[SP_BRICK];
        if (n == SP_BRICK) {
            memcpy(in, (const uint8_t *)voxels + at, sizeof in);
        } else {
            memset(in, ((const uint8_t *)voxels)[at], sizeof in);
            memcpy(in, (const uint8_t *)voxels + at, n);
        }
        for (int i = 0; i < SP_BRICK; i++)
            keys[i] = (uint8_t)(in[i] - (uint8_t)first); /* whether it is signed or not */
    } else {
        for (int i = 0; n < SP_BRICK && i < SP_BRICK; i++)
            keys[i] = ((const uint16_t *)voxels)[at];
        memcpy(keys, (const uint16_t *)voxels + at, (n < SP_BRICK ? n : SP_BRICK) * sizeof *keys);
        for (int i = 0; i < SP_BRICK; i++)
            keys[i] = (uint16_t)(keys[i] - (uint16_t)first);
    }
}

/* Returns one bit per key of a row: 1 = listed. */
static inline uint32_t mark_listed(const struct collect *c, const uint16_t keys[SP_BRICK]) {
    static const uint16_t bit[SP_BRICK] = { 1,   2,   4,    8,    16,   32,   64,    128,
                                            256, 512, 1024, 2048, 4096, 8192, 16384, 32768 };
    uint16_t bits = 0;
    for (int k = 0; k < c->intervals.count; k++) {
        uint16_t low = c->intervals.low[k], span = c->intervals.span[k];
        for (int i = 0; i < SP_BRICK; i++)
            bits |= (uint16_t)(keys[i] - low) <= span ? bit[i] : 0;
    }
    for (int i = 0; c->intervals.count < 0 && i < SP_BRICK; i++)
        bits |= (uint16_t)(c->listed[keys[i]] << i);
    return bits;
}

static inline void widen_keys(const uint16_t keys[SP_BRICK], uint16_t *low, uint16_t *high) {
    uint16_t least = *low, most = *high;
    for (int i = 0; i < SP_BRICK; i++) {
        least = keys[i] < least ? keys[i] : least;
        most = keys[i] > most ? keys[i] : most;
    }
    *low = least;
    *high = most;
}

/* Marks what is visible of a row: element `at` and those `stride` apart. */
static void mark_row(struct sp_dense *dense, uint32_t at, uint32_t stride, uint32_t bits) {
    if (stride == 1)
        dense->used[at >> 4] = (uint16_t)bits;
    for (; stride > 1 && bits; bits &= bits - 1) {
        uint32_t element = at + stride * (uint32_t)__builtin_ctz(bits);
        dense->used[element >> 4] |= (uint16_t)(1u << (element & 15));
    }
}

static void put_keys(struct sp_dense *dense, uint32_t at, uint32_t stride, uint32_t bytes,
                     const uint16_t keys[SP_BRICK]) {
    if (bytes == 1)
        for (uint32_t i = 0; i < SP_BRICK; i++)
            dense->key.bytes[at + i * stride] = (uint8_t)keys[i];
    else
        for (uint32_t i = 0; i < SP_BRICK; i++)
            dense->key.halves[at + i * stride] = keys[i];
}

/* Collects all rows of a brick by the listed keys, 16 samples at a time. */
static void load_table(const struct collect *c, const struct region *region, struct sp_dense *dense,
                       struct sp_range *range) {
    uint32_t bytes = c->list->key_bytes, inside = (1u << region->size[0]) - 1;
    uint32_t stride = sp_dense_element(dense->axis, 1);
    uint16_t keys[SP_BRICK], low = UINT16_MAX, high = 0;
    for (uint32_t i2 = 0; i2 < region->size[2]; i2++)
        for (uint32_t i1 = 0; i1 < region->size[1]; i1++) {
            size_t from = row_begin(c, region, i1, i2);
            read_keys(c->voxels, from, region->size[0], bytes, c->transfer->first, keys);
            uint32_t bits = mark_listed(c, keys) & inside;
            uint32_t at = sp_dense_element(dense->axis, i1 << 4 | i2 << 8);
            if (bits) {
                put_keys(dense, at, stride, bytes, keys);
                mark_row(dense, at, stride, bits);
            }
            if (range)
                widen_keys(keys, &low, &high);
        }
    if (range)
        *range = (struct sp_range){ low, high };
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

/* Collects the voxels of any type and order that are visible or can matter. */
static void load_any(const struct collect *c, const struct region *region, struct sp_dense *dense,
                     struct sp_range *range) {
    uint32_t bytes = c->list->key_bytes, stride = sp_dense_element(dense->axis, 1);
    struct sp_visible element = { .key = &dense->key, .key_bytes = bytes };
    uint32_t keys[SP_BRICK];
    uint8_t visible[SP_BRICK];
    for (uint32_t i2 = 0; i2 < region->size[2]; i2++)
        for (uint32_t i1 = 0; i1 < region->size[1]; i1++) {
            uint32_t bits = 0, local = i1 << 4 | i2 << 8;
            uint32_t at = sp_dense_element(dense->axis, local);
            sp_transfer_keys(c->transfer, c->voxels, row_begin(c, region, i1, i2), region->size[0],
                             keys, visible);
            for (uint32_t i0 = 0; i0 < region->size[0]; i0++) {
                if (c->cells)
                    visible[i0] = sp_reach_has(c->cells[region->brick], i0 | local) &&
                                  isfinite(sp_transfer_value(c->transfer, keys[i0]));
                sp_visible_set_key(&element, at + i0 * stride, keys[i0]);
                bits |= (uint32_t)visible[i0] << i0;
            }
            mark_row(dense, at, stride, bits);
            if (range)
                widen(c->transfer, keys, region->size[0], range);
        }
}

/* Reads a brick of the volume. range: of all its values; NULL = not wanted. */
static void load_brick(const struct collect *c, const struct region *region, struct sp_dense *dense,
                       struct sp_range *range) {
    memset(dense->used, 0, sizeof dense->used);
    if (range)
        *range = (struct sp_range){ INFINITY, -INFINITY };
    if (c->listed)
        load_table(c, region, dense, range);
    else
        load_any(c, region, dense, range);
}

/* True if the entries of the brick equal those of the source. */
static bool is_unchanged(const struct collect *c, uint32_t brick) {
    return c->from && !sp_change_affects(c->change, &c->ranges[brick]);
}

static uint32_t count_brick(const struct collect *c, struct sp_dense *dense, uint32_t brick) {
    if (is_unchanged(c, brick))
        return (uint32_t)(c->from->visible.first[brick + 1] - c->from->visible.first[brick]);
    struct region region = bound_region(c, brick);
    load_brick(c, &region, dense, c->measures ? &c->ranges[brick] : NULL);
    return sp_dense_count(dense);
}

/* Fills the normals of a rebuilt brick. Normals of voxels in the source list are copied. */
static void fill_normals(const struct collect *c, uint32_t brick, struct sp_dense *dense,
                         struct sp_dense *old) {
    struct sp_visible element = { .normal = &dense->normal, .normal_bytes = c->list->normal_bytes };
    uint32_t corner[3];
    old->axis = dense->axis;
    sp_visible_brick_corner(c->list->bricks, brick, corner);
    sp_dense_unpack(old, &c->from->visible, brick);
    memcpy(&dense->normal, &old->normal, SP_BRICK_VOXELS * (size_t)c->list->normal_bytes);
    for (uint32_t r = 0; r < SP_BRICK * SP_BRICK; r++)
        for (uint32_t bits = dense->used[r] & ~old->used[r]; bits; bits &= bits - 1) {
            uint32_t column = (uint32_t)__builtin_ctz(bits);
            uint16_t local = sp_visible_local(dense->axis, r >> 4, (uint8_t)(r << 4 | column));
            sp_visible_set_normal(&element, r << 4 | column,
                                  pack_normal(&c->gradients, c->list->normal_bytes, corner, local));
        }
}

static void copy_entries(const void *from, uint64_t at, void *to, uint64_t out, size_t count,
                         uint32_t bytes) {
    memcpy((uint8_t *)to + out * bytes, (const uint8_t *)from + at * bytes, count * bytes);
}

/* Copies an unchanged brick; false when it must be rebuilt. */
static bool copy_brick(const struct collect *c, uint32_t brick) {
    if (!is_unchanged(c, brick))
        return false;
    const struct sp_visible *from = &c->from->visible, *list = c->list;
    uint64_t to = list->first[brick], at = from->first[brick];
    size_t count = (size_t)(from->first[brick + 1] - at);
    list->axis[brick] = from->axis[brick];
    memcpy(list->start[brick], from->start[brick], sizeof list->start[brick]);
    copy_entries(from->place, at, list->place, to, count, sizeof *list->place);
    copy_entries(from->key, at, list->key, to, count, list->key_bytes);
    if (list->normal)
        copy_entries(from->normal, at, list->normal, to, count, list->normal_bytes);
    return true;
}

/* dense, old: of the worker. */
static void fill_brick(const struct collect *c, struct sp_dense *dense, struct sp_dense *old,
                       uint32_t brick) {
    if (c->list->first[brick] == c->list->first[brick + 1]) {
        c->list->axis[brick] = (uint8_t)c->axis;
        return;
    }
    if (copy_brick(c, brick))
        return;
    struct region region = bound_region(c, brick);
    load_brick(c, &region, dense, NULL);
    assert(sp_dense_count(dense) == c->list->first[brick + 1] - c->list->first[brick]);
    if (c->list->normal)
        fill_normals(c, brick, dense, old);
    sp_dense_pack(dense, c->list, brick);
}

static void count_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct collect *c = user;
    struct sp_dense dense;
    dense.axis = 2; /* rows as they lie in the volume */
    for (size_t b = begin; b < end && !sp_classify_cancelled(c->job, NULL); b++)
        c->list->first[b + 1] = count_brick(c, &dense, (uint32_t)b);
}

static void fill_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct collect *c = user;
    struct sp_dense dense, old;
    dense.axis = c->axis;
    for (size_t b = begin; b < end && !sp_classify_cancelled(c->job, NULL); b++)
        fill_brick(c, &dense, &old, (uint32_t)b);
}

static bool fill_cells(struct sp_level *level, const struct sp_volume *volume,
                       const struct sp_classify_job *job, struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    level->cells = malloc(bricks * sizeof *level->cells);
    if (!level->cells)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the cells of %u bricks", bricks);
    return sp_reach_fill(level, volume, job, level->cells, err);
}

/* Allocates the ranges of the bricks and copies the ranges of the source. *measures: the source has
 * none, so the caller measures them.
 */
static bool init_ranges(struct sp_level *level, const struct sp_level *from, bool *measures,
                        struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(&level->visible);
    *measures = false;
    if (level->ranges)
        return true;
    level->ranges = malloc(bricks * sizeof *level->ranges);
    if (!level->ranges)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the ranges of %u bricks", bricks);
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
    if (from && (!from->visible.place || !from->ranges ||
                 !sp_change_is_possible(&from->transfer, &level->transfer)))
        from = NULL;
    uint32_t key_bytes = sp_transfer_key_bytes(&level->transfer);
    uint32_t normal_bytes = key_bytes <= 2 && !sp_transfer_wants_magnitudes(job->tf) ? 2 : 4;
    if (!sp_visible_init(list, level->grid.dims, key_bytes, normal_bytes, err) ||
        !init_ranges(level, from, &measures, err))
        return false;
    if (from && !sp_change_init(&source->change, &from->transfer, from->listed, &level->transfer,
                                level->listed, err))
        return false;
    source->level = from;
    if (job->tf->order == SP_TF_POST && !fill_cells(level, volume, job, err))
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
    bool normals = job->normals && source->level && source->level->visible.normal &&
                   source->level->visible.normal_bytes == level->visible.normal_bytes;
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
    struct sp_visible *list; /* the normals are written to it */
    const struct sp_classify_job *job;
};

static void pack_normals(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct normals *n = user;
    const struct sp_visible *list = n->list;
    uint16_t local[SP_BRICK_VOXELS];
    for (size_t b = begin; b < end && !sp_classify_cancelled(n->job, NULL); b++) {
        uint32_t corner[3], count = (uint32_t)(list->first[b + 1] - list->first[b]);
        sp_visible_brick_corner(list->bricks, (uint32_t)b, corner);
        sp_visible_locals(list, (uint32_t)b, NULL, 0, count, local);
        if (list->normal_bytes == 2)
            sp_gradient_pack_directions(&n->grid, corner, local, count,
                                        (uint16_t *)list->normal + list->first[b]);
        for (uint32_t e = 0; list->normal_bytes == 4 && e < count; e++)
            sp_visible_set_normal(list, list->first[b] + e,
                                  pack_normal(&n->grid, list->normal_bytes, corner, local[e]));
    }
}

bool sp_collect_normals(struct sp_level *level, const struct sp_volume *volume,
                        const struct sp_classify_job *job, struct sp_error *err) {
    struct sp_visible *list = &level->visible;
    struct normals n = { .list = list, .job = job };
    list->normal = malloc(list->count ? list->count * list->normal_bytes : 1);
    if (!list->normal)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %llu gradients",
                       (unsigned long long)list->count);
    sp_gradient_grid_init(&n.grid, volume);
    sp_parallel_for(job->pool, sp_visible_bricks(list), BRICKS_GRAIN, pack_normals, &n);
    if (!sp_classify_cancelled(job, err))
        return true;
    free(list->normal);
    list->normal = NULL;
    return false;
}

enum { HISTOGRAM_GRAIN = 1 << 18 }; /* samples */

struct histogram {
    const struct sp_transfer *transfer;
    const void *voxels;
    uint64_t *counts; /* [transfer->count] a worker */
};

/* Two counters alternate, because equal neighbouring samples would wait for the same one. */
static void count_samples(void *user, size_t begin, size_t end, unsigned worker) {
    const struct histogram *h = user;
    int32_t first = h->transfer->first;
    uint64_t *counts = h->counts + 2 * (size_t)worker * h->transfer->count;
    uint64_t *other = counts + h->transfer->count;
    if (sp_transfer_key_bytes(h->transfer) == 1) {
        const uint8_t *in = h->voxels;
        for (size_t i = begin; i + 1 < end; i += 2) {
            counts[(uint8_t)(in[i] - (uint8_t)first)]++;
            other[(uint8_t)(in[i + 1] - (uint8_t)first)]++;
        }
        if ((end - begin) % 2)
            counts[(uint8_t)(in[end - 1] - (uint8_t)first)]++;
    } else {
        const uint16_t *in = h->voxels;
        for (size_t i = begin; i < end; i++)
            counts[(uint16_t)(in[i] - (uint16_t)first)]++;
    }
}

uint64_t *sp_collect_histogram(const struct sp_transfer *transfer, const struct sp_volume *volume,
                               struct sp_pool *pool, struct sp_error *err) {
    const uint32_t *dims = sp_volume_info(volume)->grid.dims;
    uint32_t parts = 2 * sp_pool_threads(pool);
    struct histogram h = { .transfer = transfer,
                           .voxels = sp_volume_voxels(volume),
                           .counts = calloc((size_t)transfer->count * parts, sizeof *h.counts) };
    if (!h.counts) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory while counting %u values", transfer->count);
        return NULL;
    }
    sp_parallel_for(pool, (size_t)dims[0] * dims[1] * dims[2], HISTOGRAM_GRAIN, count_samples, &h);
    for (uint32_t p = 1; p < parts; p++)
        for (uint32_t k = 0; k < transfer->count; k++)
            h.counts[k] += h.counts[(size_t)p * transfer->count + k];
    uint64_t *least = realloc(h.counts, transfer->count * sizeof *least);
    return least ? least : h.counts;
}
