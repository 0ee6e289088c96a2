/* SPDX-License-Identifier: Apache-2.0
 *
 * The memory of one frame: named allocations from blocks. The arena keeps its blocks from frame to
 * frame, so that the steady state allocates nothing from the system. sp_arena_reset() ends all
 * allocations and keeps the memory; if the last frame needed several blocks, the function joins
 * them into one. The arena asks the system for huge pages for large blocks. One thread may use an
 * arena at a time.
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
    uint64_t system_allocations;   /* calls of the system's allocator since init; constant in the
                                      steady state */
    const char *failed; /* name of the first allocation that failed since the last reset, a constant
                           string; NULL = none */
    /* Blocks are charged to this budget (SP_BUDGET_ARENAS). Set it before the first allocation; it
     * is borrowed and must outlive the arena. NULL = no limit. */
    struct sp_budget *budget;
    uint64_t held;    /* bytes of all blocks */
    uint64_t refused; /* size of the block that the budget refused since the last reset [bytes]; 0 =
                         the budget refused none */
};

void sp_arena_init(struct sp_arena *arena);
void sp_arena_finish(struct sp_arena *arena);
/* Ends all allocations and frees the memory; the arena stays usable, with its budget. */
void sp_arena_trim(struct sp_arena *arena);
/* Reports that sp_arena_alloc() failed: sets *err to SP_ERR_FRAME_BUDGET or SP_ERR_MEMORY and
 * returns false. `fallback` names the allocation if the arena has no name for it. */
bool sp_arena_fail(const struct sp_arena *arena, const char *fallback, struct sp_error *err);
void sp_arena_reset(struct sp_arena *arena);

/* Returns `count` elements of `size` bytes, 64-byte aligned, uninitialised, valid until the next
 * reset; NULL when out of memory or when the product overflows. `name` is a constant string for
 * error messages. */
void *sp_arena_alloc(struct sp_arena *arena, const char *name, size_t count, size_t size);

#endif
