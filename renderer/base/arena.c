/* SPDX-License-Identifier: Apache-2.0 */
#include "base/arena.h"

#include <stdlib.h>
#include <sys/mman.h>

enum {
    ALIGN = 64,
    BLOCK_MIN = 1 << 16,
    HUGE_PAGE = 1 << 21,
    HUGE_BLOCK = 8 * HUGE_PAGE, /* smaller blocks would waste memory */
    GROWTH_MAX = 4 * HUGE_BLOCK /* no block is larger beyond what is asked for */
};

struct sp_arena_block {
    struct sp_arena_block *next;
    size_t capacity;
    unsigned char *bytes;
};

void sp_arena_init(struct sp_arena *arena) {
    *arena = (struct sp_arena){ 0 };
}

static uint64_t size_of(const struct sp_arena_block *block) {
    return block->capacity + sizeof *block;
}

static void free_blocks(struct sp_arena *arena) {
    while (arena->blocks) {
        struct sp_arena_block *next = arena->blocks->next;
        sp_budget_release(arena->budget, SP_BUDGET_ARENAS, size_of(arena->blocks));
        free(arena->blocks->bytes);
        free(arena->blocks);
        arena->blocks = next;
    }
    arena->used = arena->capacity = 0;
    arena->held = 0;
}

void sp_arena_finish(struct sp_arena *arena) {
    free_blocks(arena);
    *arena = (struct sp_arena){ 0 };
}

void sp_arena_trim(struct sp_arena *arena) {
    free_blocks(arena);
    arena->total = arena->refused = 0;
    arena->failed = NULL;
}

bool sp_arena_fail(const struct sp_arena *arena, const char *fallback, struct sp_error *err) {
    const char *what = arena->failed ? arena->failed : fallback;
    if (arena->refused)
        return sp_budget_fail(arena->budget, what, arena->refused, err);
    return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the frame's %s", what);
}

static int add_block(struct sp_arena *arena, size_t bytes_min) {
    const size_t align = bytes_min < HUGE_BLOCK ? ALIGN : HUGE_PAGE;
    const size_t capacity = (bytes_min + align - 1) / align * align;
    const uint64_t size = capacity + sizeof(struct sp_arena_block);
    if (!sp_budget_acquire(arena->budget, SP_BUDGET_ARENAS, size)) {
        arena->refused = size;
        return 0;
    }
    struct sp_arena_block *block = malloc(sizeof *block);
    unsigned char *bytes = block ? aligned_alloc(align, capacity) : NULL;
    if (!bytes) {
        free(block);
        sp_budget_release(arena->budget, SP_BUDGET_ARENAS, size);
        arena->refused = 0;
        return 0;
    }
    if (align == HUGE_PAGE) /* splats are read far apart: each would need a page of its own */
        (void)madvise(bytes, capacity, MADV_HUGEPAGE);
    arena->system_allocations += 2;
    *block = (struct sp_arena_block){ .next = arena->blocks, .capacity = capacity, .bytes = bytes };
    arena->blocks = block;
    arena->held += size;
    arena->used = 0;
    arena->capacity = capacity;
    return 1;
}

void sp_arena_reset(struct sp_arena *arena) {
    if (arena->blocks && arena->blocks->next) {
        size_t whole = 0;
        for (const struct sp_arena_block *b = arena->blocks; b; b = b->next)
            whole += b->capacity;
        free_blocks(arena);
        add_block(arena, whole); /* a failure only means smaller blocks again */
    }
    arena->used = 0;
    arena->total = arena->refused = 0;
    arena->failed = NULL;
}

/* Blocks double up to this size, so that little of a small budget is left unused. */
static size_t growth_max(const struct sp_arena *arena) {
    const uint64_t share = sp_budget_limit(arena->budget) / 32;
    return share < GROWTH_MAX ? (size_t)share : GROWTH_MAX;
}

void *sp_arena_alloc(struct sp_arena *arena, const char *name, size_t count, size_t size) {
    size_t bytes;
    if (__builtin_mul_overflow(count, size, &bytes) || bytes > SIZE_MAX / 4) {
        if (!arena->failed)
            arena->failed = name;
        return NULL;
    }
    bytes = bytes ? (bytes + ALIGN - 1) / ALIGN * ALIGN : ALIGN;
    if (arena->capacity - arena->used < bytes) {
        size_t capacity = arena->capacity * 2 > BLOCK_MIN ? arena->capacity * 2 : BLOCK_MIN;
        if (capacity > growth_max(arena))
            capacity = growth_max(arena);
        if (capacity < bytes)
            capacity = bytes;
        if (!add_block(arena, capacity) && !(capacity > bytes && add_block(arena, bytes))) {
            if (!arena->failed)
                arena->failed = name;
            return NULL;
        }
    }
    void *p = arena->blocks->bytes + arena->used;
    arena->used += bytes;
    arena->total += bytes;
    return p;
}
