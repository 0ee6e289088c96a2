/* SPDX-License-Identifier: Apache-2.0
 *
 * Memory of one frame: named allocations from blocks that are kept from frame to frame, so that the
 * steady state allocates nothing. sp_arena_reset() ends all allocations and keeps the memory; if
 * the last frame needed several blocks, it joins them into one. Large blocks ask for huge pages.
 * One thread at a time.
 */
#ifndef SP_BASE_ARENA_H
#define SP_BASE_ARENA_H

#include <stddef.h>
#include <stdint.h>

#include "sp/budget.h"

struct sp_arena_block;

struct sp_arena {
    struct sp_arena_block *blocks; /* newest first */
    size_t used, capacity;         /* bytes of the newest block */
    size_t total;                  /* bytes handed out since the last reset */
    uint64_t system_allocations;   /* calls to the system's allocator since init; constant in the
                                      steady state */
    const char *failed; /* name of the first allocation that failed since the last reset, a constant
                           string; NULL = none */
    struct sp_budget *budget; /* from which blocks are taken (SP_BUDGET_ARENAS); NULL = no limit.
                                 Set it before the first allocation; it must outlive the arena */
    uint64_t held;            /* bytes of all blocks */
    uint64_t refused; /* bytes of the block that the budget refused since the last reset; 0 =
                         none */
};

void sp_arena_init(struct sp_arena *arena);
void sp_arena_finish(struct sp_arena *arena);
/* Ends all allocations and frees the memory; the arena stays usable, with its budget. */
void sp_arena_trim(struct sp_arena *arena);
/* Fails because sp_arena_alloc() failed: SP_ERR_FRAME_BUDGET or SP_ERR_MEMORY. `fallback` names
 * what failed if the arena does not know. Returns false. */
bool sp_arena_fail(const struct sp_arena *arena, const char *fallback, struct sp_error *err);
void sp_arena_reset(struct sp_arena *arena);

/* Returns `count` elements of `size` bytes, 64-byte aligned, uninitialised, valid until the next
 * reset; NULL when out of memory or when the product overflows. `name` is a constant string for
 * error messages. */
void *sp_arena_alloc(struct sp_arena *arena, const char *name, size_t count, size_t size);

#endif
