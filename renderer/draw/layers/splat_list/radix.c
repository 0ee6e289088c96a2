/* SPDX-License-Identifier: Apache-2.0
 *
 * Two passes of 11 bits. Chunks of items are counted and moved independently.
 */
#include "draw/layers/splat_list/radix.h"

#include <string.h>

enum {
    DIGITS = 1 << 11,
    DIGIT_BITS = 11,
    CHUNKS = 16,
    APART = DIGITS + 16 /* so that the counts of a digit do not share a set of the cache */
};

struct sort {
    struct sp_radix_item *items, *moved;     /* [count] */
    uint32_t count, shift, (*counts)[APART]; /* [CHUNKS] */
};

/* The items of a chunk. */
static struct sp_radix_item *chunk_of(const struct sort *s, size_t chunk, uint32_t *count) {
    uint64_t begin = s->count * (uint64_t)chunk / CHUNKS;
    *count = (uint32_t)(s->count * (uint64_t)(chunk + 1) / CHUNKS - begin);
    return s->items + begin;
}

static void count_digits(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sort *s = user;
    (void)worker;
    for (size_t chunk = begin; chunk < end; chunk++) {
        uint32_t n, *counts = s->counts[chunk];
        const struct sp_radix_item *items = chunk_of(s, chunk, &n);
        memset(counts, 0, sizeof s->counts[chunk]);
        for (uint32_t i = 0; i < n; i++)
            counts[items[i].key >> s->shift & (DIGITS - 1)]++;
    }
}

static void move_items(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sort *s = user;
    (void)worker;
    for (size_t chunk = begin; chunk < end; chunk++) {
        uint32_t n, *next = s->counts[chunk];
        const struct sp_radix_item *items = chunk_of(s, chunk, &n);
        for (uint32_t i = 0; i < n; i++)
            s->moved[next[items[i].key >> s->shift & (DIGITS - 1)]++] = items[i];
    }
}

/* Sorts by the digit at `shift`, keeping the order of equal ones. */
static void sort_digit(struct sort *s, struct sp_pool *pool, uint32_t shift) {
    uint32_t at = 0;
    s->shift = shift;
    sp_parallel_for(pool, CHUNKS, 1, count_digits, s);
    for (int digit = 0; digit < DIGITS; digit++)
        for (int chunk = 0; chunk < CHUNKS; chunk++) {
            uint32_t had = s->counts[chunk][digit];
            s->counts[chunk][digit] = at;
            at += had;
        }
    sp_parallel_for(pool, CHUNKS, 1, move_items, s);
    struct sp_radix_item *moved = s->moved;
    s->moved = s->items;
    s->items = moved;
}

struct sp_radix_item *sp_radix_sort(struct sp_radix_item *items, uint32_t count,
                                    struct sp_pool *pool, struct sp_arena *arena) {
    struct sort s = { .items = items, .count = count };
    s.moved = sp_arena_alloc(arena, "items to sort", count + (size_t)1, sizeof *s.moved);
    s.counts = sp_arena_alloc(arena, "counts of digits", CHUNKS, sizeof *s.counts);
    if (!s.moved || !s.counts)
        return NULL;
    sort_digit(&s, pool, 0);
    sort_digit(&s, pool, DIGIT_BITS);
    return s.items;
}
