/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/visible.h"

#include <stdlib.h>

enum { BRICKS_GRAIN = 32 }; /* bricks sorted at a time */

static void *allocate(uint64_t count, size_t size) {
    return count > SIZE_MAX / 2 / size ? NULL : malloc(count ? count * size : 1);
}

bool sp_visible_init(struct sp_visible *visible, const uint32_t dims[3], uint32_t key_bytes,
                     struct sp_error *err) {
    *visible = (struct sp_visible){ .key_bytes = key_bytes };
    for (int a = 0; a < 3; a++)
        visible->bricks[a] = (dims[a] + SP_BRICK - 1) >> SP_BRICK_SHIFT;
    uint32_t bricks = sp_visible_bricks(visible);
    visible->first = calloc(bricks + (size_t)1, sizeof *visible->first);
    if (visible->first)
        return true;
    *visible = (struct sp_visible){ 0 };
    return sp_fail(err, SP_ERR_MEMORY, "", "no memory for %u bricks", bricks);
}

void sp_visible_sum(struct sp_visible *visible) {
    uint32_t bricks = sp_visible_bricks(visible);
    for (uint32_t b = 0; b < bricks; b++)
        visible->first[b + 1] += visible->first[b];
    visible->count = visible->first[bricks];
}

bool sp_visible_allocate(struct sp_visible *visible, bool normals, struct sp_error *err) {
    visible->local = allocate(visible->count, sizeof *visible->local);
    visible->key = allocate(visible->count, visible->key_bytes);
    if (normals)
        visible->normal = allocate(visible->count, sizeof *visible->normal);
    if (visible->local && visible->key && (!normals || visible->normal))
        return true;
    return sp_fail(err, SP_ERR_MEMORY, "", "no memory for a list of %llu visible voxels",
                   (unsigned long long)visible->count);
}

void sp_visible_finish(struct sp_visible *visible) {
    free(visible->first);
    free(visible->local);
    free(visible->key);
    free(visible->normal);
    *visible = (struct sp_visible){ 0 };
}

uint64_t sp_visible_entry_bytes(const struct sp_visible *v, uint64_t count, bool normals) {
    return count * (sizeof *v->local + v->key_bytes + (normals ? sizeof *v->normal : 0));
}

uint64_t sp_visible_bytes(const struct sp_visible *visible) {
    if (!visible->first)
        return 0;
    return (sp_visible_bricks(visible) + UINT64_C(1)) * sizeof *visible->first +
           sp_visible_entry_bytes(visible, visible->count, visible->normal != NULL);
}

struct sort {
    const struct sp_visible *visible;
    struct sp_slices *slices;
    unsigned shift;     /* of the axis in `local` */
    atomic_ullong runs; /* a sum of integers: the same in any order */
};

/* A counting sort, so that the entries of a slice stay in their order. */
static void sort_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct sort *sort = user;
    unsigned long long runs = 0;
    for (size_t b = begin; b < end; b++) {
        uint64_t first = sort->visible->first[b];
        uint32_t count = (uint32_t)(sort->visible->first[b + 1] - first);
        const uint16_t *local = sort->visible->local + first;
        uint16_t next[SP_BRICK] = { 0 }, *start = sort->slices->start[b], sum = 0;
        for (uint32_t e = 0; e < count; e++)
            next[local[e] >> sort->shift & (SP_BRICK - 1)]++;
        for (int s = 0; s < SP_BRICK; s++) {
            uint16_t n = next[s];
            runs += n > 0;
            next[s] = start[s] = sum;
            sum = (uint16_t)(sum + n);
        }
        start[SP_BRICK] = sum;
        if (!sort->slices->place)
            continue;
        uint16_t *place = sort->slices->place + first;
        for (uint32_t e = 0; e < count; e++)
            place[next[local[e] >> sort->shift & (SP_BRICK - 1)]++] = (uint16_t)e;
    }
    atomic_fetch_add_explicit(&sort->runs, runs, memory_order_relaxed);
}

bool sp_slices_make(struct sp_slices *slices, const struct sp_visible *visible, unsigned axis,
                    struct sp_pool *pool, struct sp_error *err) {
    uint32_t bricks = sp_visible_bricks(visible);
    *slices = (struct sp_slices){ .start = allocate(bricks, sizeof *slices->start) };
    if (axis < 2)
        slices->place = allocate(visible->count, sizeof *slices->place);
    if (!slices->start || (axis < 2 && !slices->place)) {
        sp_slices_finish(slices);
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for the order of %llu visible voxels",
                       (unsigned long long)visible->count);
    }
    struct sort sort = { .visible = visible, .slices = slices, .shift = axis * SP_BRICK_SHIFT };
    sp_parallel_for(pool, bricks, BRICKS_GRAIN, sort_bricks, &sort);
    slices->runs = sort.runs;
    return true;
}

void sp_slices_finish(struct sp_slices *slices) {
    free(slices->start);
    free(slices->place);
    *slices = (struct sp_slices){ 0 };
}

uint64_t sp_slices_bytes(const struct sp_visible *visible, unsigned axis) {
    const struct sp_slices *s = NULL;
    return sp_visible_bricks(visible) * sizeof *s->start +
           (axis < 2 ? visible->count * sizeof *s->place : 0);
}
