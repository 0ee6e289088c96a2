/* SPDX-License-Identifier: Apache-2.0
 *
 * A stable radix sort by small keys. The result is the same for any number of threads.
 */
#ifndef SP_SPLAT_LIST_RADIX_H
#define SP_SPLAT_LIST_RADIX_H

#include "base/arena.h"
#include "base/parallel_for.h"

#define SP_RADIX_KEYS (UINT32_C(1) << 22)

struct sp_radix_item {
    uint32_t key; /* below SP_RADIX_KEYS */
    uint32_t value;
};

/* Sorts items[count], which may be overwritten. Returns the sorted items: either `items` or memory
 * of the arena. NULL if the arena cannot allocate. */
struct sp_radix_item *sp_radix_sort(struct sp_radix_item *items, uint32_t count,
                                    struct sp_pool *pool, struct sp_arena *arena);

#endif
