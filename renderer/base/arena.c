/* SPDX-License-Identifier: Apache-2.0 */
#include "base/arena.h"

#include <stdlib.h>
#include <sys/mman.h>

enum {
    ALIGN = 64,
    BLOCK_MIN = 1 << 16,
    HUGE_PAGE = 1 << 21,
    HUGE_BLOCK = 8 * HUGE_PAGE /* smaller blocks would waste memory */
};

struct sp_arena_block {
    struct sp_arena_block *next;
    size_t capacity;
    unsigned char *bytes;
};

void sp_arena_init(struct sp_arena *arena) {
    *arena = (struct sp_arena){ 0 };
}

static void free_blocks(struct sp_arena *arena) {
    while (arena->blocks) {
        struct sp_arena_block *next = arena->blocks->next;
        free(arena->blocks->bytes);
        free(arena->blocks);
        arena->blocks = next;
    }
    arena->used = arena->capacity = 0;
}

void sp_arena_finish(struct sp_arena *arena) {
    free_blocks(arena);
    *arena = (struct sp_arena){ 0 };
}

static int add_block(struct sp_arena *arena, size_t bytes_min) {
    const size_t align = bytes_min < HUGE_BLOCK ? ALIGN : HUGE_PAGE;
    const size_t capacity = (bytes_min + align - 1) / align * align;
    struct sp_arena_block *block = malloc(sizeof *block);
    unsigned char *bytes = block ? aligned_alloc(align, capacity) : NULL;
    if (!bytes) {
        free(block);
        return 0;
    }
    if (align == HUGE_PAGE) /* splats are read far apart: each would need a page of its own */
        (void)madvise(bytes, capacity, MADV_HUGEPAGE);
    arena->system_allocations += 2;
    *block = (struct sp_arena_block){ .next = arena->blocks, .capacity = capacity, .bytes = bytes };
    arena->blocks = block;
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
    arena->total = 0;
    arena->failed = NULL;
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
