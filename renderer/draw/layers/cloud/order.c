/* SPDX-License-Identifier: Apache-2.0
 *
 *   depths, by block ─► seen ones as items, in order of number ─► splat_list/radix.h ─► numbers
 *   └ of elements, or of splats that are set up first
 */
#include "draw/layers/cloud/order.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "draw/layers/splat_list/radix.h"

enum {
    RECORDS_MAX = 1 << 22, /* and splats that are set up first */
    BLOCK = 1 << 12,
    GROUP = 1 << 9, /* elements that are set up at a time */
    AHEAD = 32      /* elements that are read in advance: chosen ones lie apart in memory */
};

struct block {
    float low, high; /* depths of the seen ones */
    uint32_t seen, first;
};

struct sort {
    const struct sp_cloud *cloud;
    const struct sp_cloud_choice *choice;
    const struct sp_voxel_frame *frame;
    const struct sp_interrupt *interrupt;
    struct sp_cloud_record *records; /* by element of the choice; NULL = none */
    sp_voxel_set_up_fn *set_up;      /* NULL = splats are set up later */
    struct sp_voxel_record *splats;  /* a block's begin at its first element; NULL = none */
    float *depths;                   /* by element of the choice, or splat; infinity = not seen */
    struct block *blocks;
    float low, scale; /* key = (depth − low)·scale */
    uint32_t count;
    struct sp_radix_item *items; /* [count] */
    uint32_t *elements;          /* [count] */
};

/* Element i of the choice. Division is slow, and most clouds have one part. */
static uint32_t element_at(const struct sort *s, size_t i) {
    const uint32_t parts = s->cloud->parts;
    return s->choice->elements[parts == 1 ? i : i / parts];
}

/* Number i of the choice, with parts. */
static uint32_t choose(const struct sort *s, size_t i) {
    if (!s->choice)
        return (uint32_t)i;
    const uint32_t parts = s->cloud->parts;
    return element_at(s, i) * parts + (parts == 1 ? 0 : (uint32_t)(i % parts));
}

/* Depth of an element or, with parts, of one of its parts; infinity if it cannot be seen. */
static float compute_depth(const struct sort *s, const struct sp_cloud_element *e, uint32_t part) {
    const struct sp_cloud *c = s->cloud;
    const float depth = sp_cloud_depth(c, s->frame, e);
    if (!(depth < INFINITY) || c->parts == 1)
        return depth;
    return depth + c->part_at[part] * sp_cloud_deviation(c, e->factor);
}

static void record(const struct sp_cloud *cloud, uint32_t number, const struct sp_cloud_element *e,
                   struct sp_cloud_record *to) {
    if (sp_cloud_has_colors(cloud))
        to->color = sp_cloud_color_number(cloud, number);
    memcpy(to->position, e->position, sizeof to->position);
    memcpy(to->factor, e->factor, sizeof to->factor);
    to->value = *e->value;
    to->volume = *e->volume;
}

/* True for merged points, whose depths the choice may have. They need no record: they are one line
 * of the cache as well. */
static bool is_merged(const struct sort *s, size_t i) {
    return s->choice && element_at(s, i) >= s->cloud->elements->shape.count;
}

static bool has_depth(const struct sort *s, size_t i) {
    return s->cloud->parts == 1 && is_merged(s, i) && s->choice->depths;
}

static void prefetch(const struct sort *s, size_t i) {
    if (has_depth(s, i))
        return;
    const struct sp_cloud_element e = sp_cloud_element_at(s->cloud, choose(s, i) / s->cloud->parts);
    __builtin_prefetch(e.position);
    __builtin_prefetch(e.value);
    __builtin_prefetch(e.volume);
    if (s->records)
        __builtin_prefetch(e.factor);
}

static void add_depth(struct block *b, float depth) {
    b->seen++;
    b->low = depth < b->low ? depth : b->low;
    b->high = depth > b->high ? depth : b->high;
}

/* Reads an element, makes its record and returns its depth. */
static float read_element(const struct sort *s, size_t i) {
    const uint32_t parts = s->cloud->parts, number = choose(s, i), part = number % parts;
    const struct sp_cloud_element e = sp_cloud_element_at(s->cloud, number / parts);
    if (s->records && part == 0 && !is_merged(s, i))
        record(s->cloud, number / parts, &e, &s->records[i / parts]);
    return compute_depth(s, &e, part);
}

static void compute_depths(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sort *s = user;
    struct block *b = &s->blocks[begin / BLOCK];
    (void)worker;
    *b = (struct block){ .low = INFINITY, .high = -INFINITY };
    if (sp_interrupt_is_cancelled(s->interrupt))
        return;
    for (size_t i = begin; i < end; i++) {
        if (s->choice && i + AHEAD < end)
            prefetch(s, i + AHEAD);
        const float depth = has_depth(s, i) ? s->choice->depths[i] : read_element(s, i);
        s->depths[i] = depth;
        if (depth < INFINITY)
            add_depth(b, depth);
    }
}

/* Sets up splats in the order of memory, so that it is read line by line. */
static void set_up_splats(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sort *s = user;
    struct block *b = &s->blocks[begin / BLOCK];
    uint32_t numbers[GROUP];
    size_t to = begin;
    (void)worker;
    *b = (struct block){ .low = INFINITY, .high = -INFINITY };
    if (sp_interrupt_is_cancelled(s->interrupt))
        return;
    for (size_t first = begin; first < end; first += GROUP) {
        const uint32_t count = end - first < GROUP ? (uint32_t)(end - first) : GROUP;
        for (uint32_t i = 0; i < count; i++)
            numbers[i] = (uint32_t)first + i;
        const size_t last = to + s->set_up(s->frame, s->cloud, numbers, count, s->splats + to);
        for (; to < last; to++)
            add_depth(b, s->depths[to] = s->splats[to].u2);
    }
    for (; to < end; to++)
        s->depths[to] = INFINITY;
}

static void collect(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sort *s = user;
    struct sp_radix_item *to = s->items + s->blocks[begin / BLOCK].first;
    (void)worker;
    if (!s->blocks[begin / BLOCK].seen)
        return;
    for (size_t i = begin; i < end; i++)
        if (s->depths[i] < INFINITY)
            *to++ = (struct sp_radix_item){ (uint32_t)((s->depths[i] - s->low) * s->scale),
                                            s->splats || (s->records && !is_merged(s, i))
                                                ? (uint32_t)i
                                                : choose(s, i) };
}

static void copy_elements(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sort *s = user;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        s->elements[i] = s->items[i].value;
}

/* Finds the range of keys and where the items of each block go. */
static void sum_blocks(struct sort *s, size_t blocks) {
    float high = -INFINITY;
    s->low = INFINITY;
    for (size_t b = 0; b < blocks; b++) {
        s->blocks[b].first = s->count;
        s->count += s->blocks[b].seen;
        s->low = fminf(s->low, s->blocks[b].low);
        high = fmaxf(high, s->blocks[b].high);
    }
    const float steps = (float)SP_RADIX_KEYS - 2;
    s->scale = high > s->low ? fminf(steps / (high - s->low), FLT_MAX) : 0;
}

bool sp_cloud_sort(struct sp_cloud *cloud, const struct sp_cloud_choice *choice,
                   const struct sp_voxel_frame *frame, sp_voxel_set_up_fn *set_up,
                   struct sp_pool *pool, struct sp_arena *arena,
                   const struct sp_interrupt *interrupt, struct sp_voxel_order *order) {
    struct sort s = {
        .cloud = cloud, .choice = choice, .frame = frame, .interrupt = interrupt, .set_up = set_up
    };
    const size_t n = (size_t)cloud->parts * (choice ? choice->count : cloud->elements->shape.count),
                 blocks = (n + BLOCK - 1) / BLOCK;
    *order = (struct sp_voxel_order){ 0 };
    s.depths = sp_arena_alloc(arena, "depths of elements", n + 1, sizeof *s.depths);
    s.blocks = sp_arena_alloc(arena, "blocks of elements", blocks + 1, sizeof *s.blocks);
    if (cloud->tree && choice->count <= RECORDS_MAX)
        s.records = sp_arena_alloc(arena, "points", choice->count + (size_t)1, sizeof *s.records);
    if (set_up && n <= RECORDS_MAX)
        s.splats = sp_arena_alloc(arena, "splats", n + 1, sizeof *s.splats);
    if (arena->failed)
        return false;
    sp_parallel_for(pool, n, BLOCK, s.splats ? set_up_splats : compute_depths, &s);
    if (sp_interrupt_is_cancelled(interrupt))
        return true;
    sum_blocks(&s, blocks);
    s.items = sp_arena_alloc(arena, "order of elements", s.count + (size_t)1, sizeof *s.items);
    s.elements =
        sp_arena_alloc(arena, "order of elements", s.count + (size_t)1, sizeof *s.elements);
    if (!s.items || !s.elements)
        return false;
    sp_parallel_for(pool, n, BLOCK, collect, &s);
    s.items = sp_radix_sort(s.items, s.count, pool, arena);
    if (!s.items)
        return false;
    sp_parallel_for(pool, s.count, BLOCK, copy_elements, &s);
    cloud->records = s.records;
    cloud->splats = s.splats;
    *order = (struct sp_voxel_order){ .voxels = s.elements, .count = s.count };
    return true;
}
